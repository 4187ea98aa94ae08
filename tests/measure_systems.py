"""Small systems that the tests of measure and plot share."""

import numpy as np

from cgfibre.build.system import FilamentSystem, FilamentType

D, PITCH = 7.0, 8.028
CARBON = FilamentType(diameter=D, EA=8.85e9, EI=2.711e10, GJ=6.44e10, kGA=9e8, mass_per_length=69.3)


def hexagonal(rings: int, pitch: float = PITCH) -> np.ndarray:
    """Centres (n, 2) of a hexagonal bundle with `rings` rings."""
    i, j = np.mgrid[-rings : rings + 1, -rings : rings + 1].reshape(2, -1)
    keep = np.abs(i + j) <= rings
    return pitch * np.stack([i[keep] + j[keep] / 2, np.sqrt(3) / 2 * j[keep]], axis=1)


def system_of(chains, closed=False, box=None, periodic=(False, False, False)) -> FilamentSystem:
    positions = np.concatenate(chains)
    n = len(chains)
    return FilamentSystem(
        positions=positions,
        filament_start=np.concatenate([[0], np.cumsum([len(c) for c in chains])]),
        closed=np.full(n, closed),
        tow=np.zeros(n, dtype=np.int64),
        filament_type=np.zeros(n, dtype=np.int64),
        types=(CARBON,),
        box=np.array([[-1e3, 1e3]] * 3) if box is None else np.asarray(box, dtype=float),
        periodic=np.array(periodic),
        prestrain=np.zeros(n),
    )


def straight(centres, n=11, spacing=D):
    x = np.arange(n) * spacing
    return system_of([np.stack([x, np.full(n, y), np.full(n, z)], axis=1) for y, z in centres])


def rings(n_rings: int, pitch: float = PITCH) -> np.ndarray:
    """Centres (n, 2) of the thesis' circular arrangement, first filament of a ring on the y axis."""
    centres = [np.zeros((1, 2))]
    for k in range(1, n_rings + 1):
        angle = 2 * np.pi * np.arange(6 * k) / (6 * k)
        centres.append(k * pitch * np.stack([np.cos(angle), np.sin(angle)], axis=1))
    return np.concatenate(centres)


def pressed(centres: np.ndarray, thickness: float, steps: int = 60, sweeps: int = 12) -> np.ndarray:
    """Centres after platens have closed to `thickness`: overlapping discs pushed apart (no forces)."""
    c = centres + np.random.default_rng(0).normal(0, 0.05, centres.shape)
    i, j = np.triu_indices(len(c), k=1)
    start = np.ptp(centres[:, 1]) + D
    for gap in np.linspace(start, thickness, steps):
        for _ in range(sweeps):
            d = c[j] - c[i]
            length = np.maximum(np.linalg.norm(d, axis=1), 1e-9)
            near = length < D
            push = 0.5 * ((D - length[near]) / length[near])[:, None] * d[near]
            np.add.at(c, j[near], 0.6 * push)
            np.add.at(c, i[near], -0.6 * push)
            c[:, 1] = np.clip(c[:, 1], -gap / 2 + D / 2, gap / 2 - D / 2)
    return c


def bundle_between(ends: np.ndarray, middle: np.ndarray, n: int = 100, length: float = 700.0) -> FilamentSystem:
    """Filaments pinned at `ends` that pass `middle` under an anvil of five sevenths of their length."""
    x = np.linspace(0, length, n)
    share = np.clip(np.minimum(x, length - x) / (length / 7), 0, 1)
    share = share * share * (3 - 2 * share)
    return system_of(
        [np.column_stack([x, np.outer(1 - share, e) + np.outer(share, m)]) for e, m in zip(ends, middle, strict=True)]
    )
