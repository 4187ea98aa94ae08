"""docs/figures/subbundle-tow.png: a tow of 11 719 filaments as sub-bundles of several sizes beside every filament.

Runs that are in the folder already are taken as they are. The one of every filament takes three minutes of processor
time, those of sub-bundles seconds; contacts are softened alike.

python analysis/subbundle.py [--out DIR] [--deep]

--deep: 1 519 filaments pressed to half of their height instead, with the runs' thicknesses alone.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from cgfibre.plot_subbundle import figure_tow
from cgfibre.store import Results, read_results
from cgfibre.workflow import RunOptions, run_scene

ROOT = Path(__file__).resolve().parent.parent
#: the springs of both: short filaments, linear
COMMON = [
    "platens.unload=false",
    "model.accuracy=0.1",
    "contact.softening=10",
    "output.frames=20",
    "assembly.length=0.7 mm",
]
DEPTH = 0.5  # mm
FORCES = np.array([0.1, 0.5, 1.0, 2.0, 5.0, 10.0])  # N/mm


def results_of(out: Path, scene: str, overrides: list[str]) -> Results:
    """Results of the run in the folder, made now unless it is there."""
    if not (out / "results.h5").exists():
        run_scene(scene, RunOptions(out, pictures=False), [*COMMON, *overrides])
    return read_results(out / "results.h5")


def loading(results: Results) -> tuple[np.ndarray, np.ndarray]:
    """(thickness um, force N) while loading."""
    curve = results.curve
    return curve["thickness_um"][curve.loading], curve["force_top_N"][curve.loading]


def thickness(pair: tuple[np.ndarray, np.ndarray], forces: np.ndarray) -> np.ndarray:
    """Thickness at forces a depth, nan beyond the last."""
    rising = np.maximum.accumulate(pair[1] / DEPTH)
    return np.where(forces <= rising[-1], np.interp(forces, rising, pair[0]), np.nan)


def main() -> None:
    """Run what is missing, draw, print the errors."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=ROOT / "results" / "subbundle")
    parser.add_argument("--deep", action="store_true")
    arguments = parser.parse_args()
    tow = ["assembly.count=1519", "platens.stop.displacement=180 um"] if arguments.deep else []
    tow = tow or ["platens.stop.displacement=150 um"]
    sizes = (7, 4) if arguments.deep else (127, 37, 19)
    prefix = "deep-" if arguments.deep else ""
    whole = results_of(arguments.out / f"{prefix}filaments", "carbon-12k-section", [*tow, "model.spring=exact"])
    reference = loading(whole)
    wanted = thickness(reference, FORCES)
    print(f"every filament: {whole.summary['engine_cpu_s']:.3g} CPU s; {np.round(wanted, 1)} um at {FORCES} N/mm")
    drawn = {}
    for n in sizes:
        results = results_of(
            arguments.out / f"{prefix}subbundle-{n}", "carbon-12k-tow", [*tow, f"assembly.subbundle.filaments={n}"]
        )
        discs = results.summary["n_beads"]
        drawn[f"{discs} sub-bundles of {results.summary['n_filaments'] / discs:.0f}"] = loading(results)
        got = thickness(loading(results), FORCES)
        moved = (reference[0][0] - got) / (reference[0][0] - wanted) - 1
        print(
            f"{discs} sub-bundles: {results.summary['engine_cpu_s']:.3g} CPU s; thickness off by "
            f"{np.round(100 * (got / wanted - 1), 2)} %, displacement by {np.round(100 * moved, 1)} %"
        )
    if not arguments.deep:
        figure_tow(reference, drawn, DEPTH).savefig(ROOT / "docs" / "figures" / "subbundle-tow.png")


if __name__ == "__main__":
    main()
