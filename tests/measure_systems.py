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
