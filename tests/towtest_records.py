"""Synthetic tow compaction tests, from the empirical law with noise: no record of a real test ships."""

from dataclasses import dataclass

import numpy as np

from cgfibre.mechanics.compaction_laws import Conditions, EmpiricalLaw

#: a law that leaves something of every tow at 100 MPa, unlike the thesis' constants
LAW = EmpiricalLaw(a0=0.42, a1=0.7, a2=0.15, a3=0.04, b=0.18)


@dataclass(frozen=True)
class Bench:
    """The tester: ``anvil`` mm, ``force`` N at the turn, ``width`` and ``thickness`` mm of the tow at first,
    ``poisson`` its ratio, ``loss`` of the work, ``noise`` of the force, ``specimen`` scatter of strain, ``approach``
    samples before touching, ``offset`` N of the load cell."""

    anvil: float = 0.5
    force: float = 12.0
    width: float = 0.9
    thickness: float = 0.3
    poisson: float = 0.3
    loss: float = 0.4
    noise: float = 0.005
    specimen: float = 0.03
    approach: int = 30
    offset: float = 0.02
    samples: int = 150


def record(at: Conditions, bench: Bench, rng, law=LAW):
    """(displacement mm, force N, width mm) of one test: approach, loading at even steps of strain, unloading."""
    a = law.coefficient(at) * (1 + bench.specimen * rng.standard_normal())
    top = _strain_at(a, law.b, bench)
    strain = top * np.linspace(0, 1, bench.samples)
    force = _force(strain, a, law.b, bench)
    # unloading: the same force at a strain that comes back by the part (1 - loss)
    back = np.linspace(1, 0, bench.samples // 2)[1:]
    turned = strain[-1] * (1 - (1 - bench.loss) * (1 - back))
    force_back = force[-1] * back ** (1 / law.b)
    strain = np.concatenate([np.zeros(bench.approach), strain, turned])
    force = np.concatenate([np.zeros(bench.approach), force, force_back])
    lead = np.linspace(-0.1, 0, bench.approach + 1)[:-1] * bench.thickness
    displacement = bench.thickness * strain
    displacement[: bench.approach] += lead
    width = bench.width * (1 + bench.poisson * strain + 2e-3 * rng.standard_normal(len(strain)))
    noisy = force * (1 + bench.noise * rng.standard_normal(len(force))) + 1e-5 * rng.standard_normal(len(force))
    return displacement - displacement[0], noisy + bench.offset, width


def _force(strain, a, b, bench):
    """N at a strain: p = (eps/a)^(1/b) MPa on anvil x width mm2."""
    return (strain / a) ** (1 / b) * bench.anvil * bench.width * (1 + bench.poisson * strain)


def _strain_at(a, b, bench):
    """Strain at the bench's force, by bisection."""
    low, high = 0.0, 1.0
    for _ in range(80):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _force(middle, a, b, bench) < bench.force else (low, middle)
    return low


def written(at, bench, columns, form="csv"):
    """Text of an instrument: header lines, then displacement, force and width (None: not recorded)."""
    displacement, force, width = columns
    separator, decimal = {"csv": (",", "."), "tsv": ("\t", "."), "german": (";", ",")}[form]
    names = ["Displacement (mm)", "Force (N)"] + ([] if width is None else ["Width (mm)"])
    lines = [
        f"Tow size: {at.tow:g}k",
        f"Twist: {at.twist:g} turn/cm",
        f"Pre-load: {at.preload:g} cN",
        f"Initial thickness: {bench.thickness:g} mm",
        f"Anvil: {bench.anvil:g} mm",
        separator.join(names),
    ]
    data = [displacement, force] + ([] if width is None else [width])
    rows = [separator.join(f"{x:.8g}" for x in row) for row in zip(*data, strict=True)]
    text = "\n".join(lines + rows) + "\n"
    return text.replace(".", ",") if decimal == "," else text


def sized(at, **change):
    """A bench whose tow grows with its size: width and thickness of a 1.5k tow times sqrt(n/1.5)."""
    factor = (at.tow / 1.5) ** 0.5
    return Bench(**{"width": 0.9 * factor, "thickness": 0.3 * factor, **change})


def write_set(folder, conditions, trials, rng, law=LAW, **change):
    """Files of several trials of each condition; the paths."""
    paths = []
    for k, at in enumerate(conditions):
        bench = sized(at, **change)
        for trial in range(trials):
            path = folder / f"{at.tow:g}k-{at.twist:g}-{at.preload:g}-{trial + 1}.csv"
            path.write_text(written(at, bench, record(at, bench, rng, law), ("csv", "tsv", "german")[k % 3]))
            paths.append(path)
    return paths
