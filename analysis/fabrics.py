"""Pictures of docs/fabrics.md: weaves in 3D, sections, crimp and sizes of tows, forces at crossings.

    python analysis/fabrics.py [--out results/fabrics]

Runs glass-weave and nylon-weave, and the filaments of a 2 x 2 cell of nylon yarns to 0.05 MPa (minutes), unless they
lie in the folder already, and writes docs/figures/fabric_*.png.
"""

import argparse
from pathlib import Path

import numpy as np

from cgfibre import plot_fabric, plot_weave, store
from cgfibre.build.system import FilamentSystem
from cgfibre.measure.fabric import fabric_of
from cgfibre.measure.fabric_section import cut_fabric
from cgfibre.pictures_fabric import crimp_history
from cgfibre.plot import new_figure
from cgfibre.review_fabric import planes_of
from cgfibre.workflow import RunOptions, run_scene

FIGURES = Path(__file__).parents[1] / "docs" / "figures"
DPI = 90
FILAMENTS = """
description = "Plain weave of nylon yarns, filament by filament, 2 x 2 cell"
[filament]
material = "nylon"
[assembly]
kind = "weave"
pattern = "plain"
tows = 2
spacing = "5 mm"
[assembly.tow]
section = "lenticular"
width = "4.4 mm"
thickness = "1.2 mm"
filaments = 30
[platens]
stop = { pressure = "0.05 MPa" }
[model]
resolve = "filament"
"""


def results_of(scene: str | Path, folder: Path) -> store.Results:
    """What a run of ``scene`` left in ``folder``, run if it is not there."""
    if not (folder / "results.h5").exists():
        run_scene(scene, RunOptions(folder))
    return store.read_results(folder / "results.h5")


def states(results: store.Results) -> dict[str, FilamentSystem]:
    """The fabric as built and at the largest displacement, by title."""
    frames, curve = results.frames, results.curve
    deepest = int(np.argmax(frames.displacement_um))
    pressure = float(np.interp(frames.step[deepest], curve["step"], curve["pressure_MPa"]))
    titles = {"as built": 0, f"at {pressure:.2g} MPa": deepest}
    return {title: frames.system_at(results.system, k) for title, k in titles.items()}


def views(results: store.Results) -> list[plot_fabric.CutView]:
    """Sections through a weft tow, as built and pressed."""
    fabric, frames = fabric_of(results.system), results.frames
    place = planes_of(fabric, frames.positions[0])[0]
    half = float(results.curve["thickness_um"][0]) / 2
    deepest = int(np.argmax(frames.displacement_um))
    return [
        plot_fabric.CutView(
            cut_fabric(fabric, frames.positions[k], 0, place),
            fabric.axis,
            -half,
            half - float(frames.displacement_um[k]),
            title,
        )
        for k, title in zip((0, deepest), states(results), strict=True)
    ]


def balance(results: store.Results) -> plot_fabric.Balance:
    """Force at the crossings beside the platen's."""
    at = results.frames.step, results.curve["step"]
    return plot_fabric.Balance(
        np.interp(*at, results.curve["pressure_MPa"]),
        np.interp(*at, results.curve["force_top_N"]),
        results.fabric["crossing_force"][0].sum(axis=1) * 1e-9,
    )


def main() -> None:
    """Run, draw, save."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("results/fabrics"))
    out = parser.parse_args().out
    out.mkdir(parents=True, exist_ok=True)
    (out / "nylon-filaments.toml").write_text(FILAMENTS)
    glass = results_of("glass-weave", out / "glass-weave")
    nylon = results_of("nylon-weave", out / "nylon-weave")
    yarns = results_of(out / "nylon-filaments.toml", out / "nylon-filaments")
    ax = new_figure(5.4, 3.8).add_subplot()
    plot_fabric.plot_balance(ax, balance(nylon))
    figures = {
        "weave": plot_weave.figure_weave(states(glass)),
        "filaments": plot_weave.figure_weave(states(yarns)),
        "sections": plot_fabric.figure_cuts(views(yarns)),
        "crimp": plot_fabric.figure_crimp(crimp_history(yarns.curve, yarns.frames, yarns.fabric)),
        "crossings": ax.figure,
    }
    for name, figure in figures.items():
        figure.savefig(FIGURES / f"fabric_{name}.png", dpi=DPI)


if __name__ == "__main__":
    main()
