"""docs/figures/carbon-12k-3d*: a tow of 11 719 filaments pressed by a fifth of its height, filament by filament in 3D,
beside the same tow as a section of discs and as sub-bundles.

Runs that are in the folder already are taken as they are (finished or not); the one in 3D takes an
hour and a half on two cores.

python analysis/whole_tow.py [--out DIR] [--ranks N]
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from PIL import Image

from cgfibre import plot
from cgfibre.record import Curve
from cgfibre.store import read_results
from cgfibre.workflow import RunOptions, run_scene

ROOT = Path(__file__).resolve().parent.parent
FIGURES = ROOT / "docs" / "figures"
#: contacts three times softer, for a step 1.7 times as long; overlaps of 5 % D, which a guard speaks of
SOFT = ("contact.softening=3",)
#: as deep and as long as the one in 3D
DEEP = ("platens.stop.displacement=200 um", "platens.unload=false", "assembly.length=1.1 mm")


def curve_of(out: Path, scene: str, overrides: tuple[str, ...], ranks: int) -> Curve:
    """Curve of the run in the folder, made now unless it is there."""
    if not (out / "results.h5").exists():
        return run_scene(scene, RunOptions(out, ranks=ranks), overrides).curve
    return read_results(out / "results.h5").curve


def main() -> None:
    """Run what is missing; draw both curves, copy the pictures of the sections, print what the tow did."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=ROOT / "results" / "whole-tow")
    parser.add_argument("--ranks", type=int, default=2)
    arguments = parser.parse_args()
    whole = arguments.out / "carbon-12k-3d"
    curves = {
        "11 719 filaments in 3D": curve_of(whole, "carbon-12k-3d", SOFT, arguments.ranks),
        "the same as a section": curve_of(arguments.out / "section", "carbon-12k-section", DEEP, 1),
        "the same as 91 sub-bundles": curve_of(arguments.out / "sub-bundles", "carbon-12k-tow", DEEP, 1),
    }
    ax = plot.plot_loadings(plot.new_axes(), curves)
    ax.figure.savefig(FIGURES / "carbon-12k-3d-curve.png")
    with Image.open(whole / "sections.png") as picture:
        picture.convert("RGB").quantize(128).save(FIGURES / "carbon-12k-3d-sections.png", optimize=True)
    at = np.array([20.0, 50.0, 100.0, 150.0, 190.0])
    for name, curve in curves.items():
        d, force = curve["displacement_um"][curve.loading], curve["force_top_N"][curve.loading]
        reached = at[at <= d[-1]]
        shown = ", ".join(f"{np.interp(x, d, force):.3g} N at {x:.0f} um" for x in reached)
        print(f"{name}: {shown}; end at {d[-1]:.4g} um, thickness {curve['thickness_um'][curve.loading][-1]:.4g} um")


if __name__ == "__main__":
    main()
