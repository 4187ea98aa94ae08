"""Time and peak memory of the builders: python analysis/bench_build.py [--derive] (one process a case)."""

from __future__ import annotations

import argparse
import multiprocessing
import resource
import time
from collections.abc import Callable

import numpy as np

from cgfibre.build.bundle import BundleSpec, build_bundle, filament_type
from cgfibre.build.curves import MigrationSpec
from cgfibre.build.packing import ArrangementSpec, random_packing
from cgfibre.build.spacing import SpacingSpec
from cgfibre.build.system import FilamentSystem

D = 7.0
CARBON = filament_type(D, 2.3e8, 2.73e7, 1.8)
TWIST = 2.6e-5  # turns/um: 0.26 turns/cm


def bundle(
    count: int, length: float, spacing: SpacingSpec | None = None, migration: MigrationSpec | None = None, **kind: float
) -> FilamentSystem:
    """A circular bundle at 8.028 um."""
    spec = BundleSpec(
        CARBON,
        ArrangementSpec("circular", count, pitch=8.028),
        spacing or SpacingSpec(length, D),
        migration=migration,
        **kind,
    )
    return build_bundle(spec, np.random.default_rng(1))


def full_length() -> FilamentSystem:
    """345 mm, fine over 1 mm, 17 mm at most beyond."""
    half = 172500.0
    return bundle(37, 345e3, SpacingSpec(345e3, D, (half - 500, half + 500), 17e3, anchors=(half - 250, half + 250)))


def packing(count: int, fraction: float) -> FilamentSystem:
    """A random section as a bundle of two stations."""
    centres = random_packing(count, D, fraction, np.random.default_rng(1))
    return build_bundle(BundleSpec(CARBON, centres, np.array([0.0, D])), np.random.default_rng(1))


CASES: dict[str, Callable[[], FilamentSystem]] = {
    "tow, 11719 straight, L/D = 100": lambda: bundle(11719, 700.0),
    "the same with jitter 0.4 um": lambda: bundle(11719, 700.0, jitter=0.4),
    "the same twisted": lambda: bundle(11719, 700.0, twist=TWIST),
    "10 million beads, straight": lambda: bundle(11719, 6000.0),
    "10 million beads, twisted": lambda: bundle(11719, 6000.0, twist=TWIST),
    "37 at full length, graded": full_length,
    "127 migrating, 10 mm, period 5 mm": lambda: bundle(127, 1e4, migration=MigrationSpec(5e3)),
    "random, 127 at 0.60": lambda: packing(127, 0.6),
    "random, 1000 at 0.70": lambda: packing(1000, 0.7),
    "random, 1000 at 0.80": lambda: packing(1000, 0.8),
}


def measure(name: str, derive: bool, answer: multiprocessing.Queue[tuple[int, float, float]]) -> None:
    """Run one case; send beads, seconds and peak memory of the process in GiB."""
    start = time.perf_counter()
    system = CASES[name]()
    if derive:
        system.bonds(), system.angles(), system.tributary_lengths()
    wall = time.perf_counter() - start
    answer.put((system.n_beads, wall, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--derive", action="store_true", help="derive bonds, angles and tributary lengths too")
    derive = parser.parse_args().derive
    context = multiprocessing.get_context("spawn")
    print(f"{'case':36s} {'beads':>10s} {'time s':>8s} {'peak GiB':>9s}")
    for name in CASES:
        answer = context.Queue()
        process = context.Process(target=measure, args=(name, derive, answer))
        process.start()
        beads, wall, peak = answer.get()
        process.join()
        print(f"{name:36s} {beads:10d} {wall:8.2f} {peak:9.2f}")


if __name__ == "__main__":
    main()
