"""Pictures of docs/fabrics.md: weaves in 3D, sections, crimp, sizes of tows, forces at crossings, loading in the plane.

    python analysis/fabrics.py [--out results/fabrics]

Runs glass-weave and nylon-weave, the latter also strained, sheared and pulled, and the filaments of a 2 x 2 cell of
nylon yarns to 0.05 MPa (minutes), unless they lie in the folder already, and writes docs/figures/fabric_*.png.
"""

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from cgfibre import plot_fabric, plot_weave, store
from cgfibre.build.system import FilamentSystem
from cgfibre.measure.fabric import fabric_of
from cgfibre.measure.fabric_section import cut_fabric
from cgfibre.mechanics.trellis import bearing_angle
from cgfibre.pictures_fabric import crimp_history
from cgfibre.plan.tows import weave_spec
from cgfibre.plot import GREY, new_figure, style
from cgfibre.review_fabric import planes_of
from cgfibre.scene_reading import load_scene
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


#: what nylon-weave is pressed with in its plane, by the name in the picture
PLANE = {
    "held": "{}",
    "free edges": '{edges="free", when="during"}',
    "2 N a tow": '{tension="2 N", when="during"}',
    "1 % of warp": '{strain={x=0.01}, when="during"}',
    "30° of shear": '{shear="30 deg", when="during"}',
}
#: sheared between platens that hardly press: without friction what resists are the tows that bear on each other
TRELLIS = (
    'cell={shear="58 deg", when="during"}',
    "platens.stop.displacement=2 um",
    "platens.friction=0",
    "contact.friction=0",
    "model.accuracy=0.02",
    "model.speed_check=false",
)


def results_of(scene: str | Path, folder: Path, overrides: Sequence[str] = ()) -> store.Results:
    """What a run of ``scene`` left in ``folder``, run if it is not there."""
    if not (folder / "results.h5").exists():
        run_scene(scene, RunOptions(folder), overrides)
    return store.read_results(folder / "results.h5")


def figure_plane(pressed: Mapping[str, store.Results], sheared: Mapping[str, store.Results]) -> Figure:
    """Thickness against pressure of weaves loaded in their plane; the couple against the shear of a trellis, with the
    closed form's angle from which on tows press on each other beside their crossings."""
    fig = new_figure(10.5, 4.0)
    with style():
        left, right = fig.subplots(1, 2)
        for name, r in pressed.items():
            on = r.curve.loading
            left.plot(r.curve["pressure_MPa"][on], 1e-3 * r.curve["thickness_um"][on], label=name)
        left.set_xlim(0, 0.2)
        left.locator_params(nbins=6)
        left.set_ylim(2.22, 2.405)
        left.set_xlabel("pressure (MPa)")
        left.set_ylabel("thickness (mm)")
        left.legend()
        for (name, r), dash in zip(sheared.items(), ("-", "--"), strict=True):
            cell = r.curve.cell
            right.semilogy(np.degrees(cell["shear_rad"][1:]), cell["shear_couple_N_per_m"][1:], ls=dash, label=name)
        spec = weave_spec(load_scene("nylon-weave").weave)
        limit = bearing_angle(sum(spec.amplitudes), spec.amplitudes, (spec.weft_spacing, spec.warp_spacing))
        right.axvline(np.degrees(limit), color=GREY, lw=1.0, ls=":", label="tows bear beside crossings (closed form)")
        right.set_xlim(0, 58)
        right.set_ylim(1e-4, 1e3)
        right.set_xlabel("shear (°)")
        right.set_ylabel("couple over the area (N/m)")
        right.legend(loc="upper left")
    return fig


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
    fast = "model.speed_check=false"
    pressed = {
        name: results_of("nylon-weave", out / f"plane-{k}", (f"cell={cell}", fast))
        for k, (name, cell) in enumerate(PLANE.items())
    }
    patch = (*TRELLIS, "assembly.cell=patch")
    trellises = {
        "periodic cell": results_of("nylon-weave", out / "trellis", TRELLIS),
        "patch of 4 x 4": results_of("nylon-weave", out / "trellis-patch", patch),
    }
    ax = new_figure(5.4, 3.8).add_subplot()
    plot_fabric.plot_balance(ax, balance(nylon))
    figures = {
        "weave": plot_weave.figure_weave(states(glass)),
        "filaments": plot_weave.figure_weave(states(yarns)),
        "sections": plot_fabric.figure_cuts(views(yarns)),
        "crimp": plot_fabric.figure_crimp(crimp_history(yarns.curve, yarns.frames, yarns.fabric)),
        "crossings": ax.figure,
        "sheared": plot_weave.figure_weave(states(pressed["30° of shear"])),
        "plane": figure_plane(pressed, trellises),
    }
    for name, figure in figures.items():
        figure.savefig(FIGURES / f"fabric_{name}.png", dpi=DPI)


if __name__ == "__main__":
    main()
