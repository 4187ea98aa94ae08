"""The weaves as built: plain, 2/2 twill and 5-harness satin, as chains, ribbons and all their filaments.

python analysis/weaves.py
"""

from __future__ import annotations

from pathlib import Path

from cgfibre.build.bundle import filament_type
from cgfibre.build.system import FilamentSystem
from cgfibre.build.weave import (
    TowShape,
    WeaveSpec,
    filament_system,
    holding,
    plain,
    ribbon_system,
    satin,
    tow_system,
    twill,
)
from cgfibre.plot import new_figure, style
from cgfibre.plot_weave import TowView, draw_tows

ROOT = Path(__file__).resolve().parent.parent
#: nylon of Table 8-2: 30 filaments of 300 um in yarns 1.2 mm thick, 5 mm apart
NYLON = {"E1": 1.05e6, "G12": 4e5, "density": 1.172}
THICK, FILAMENT, COUNT, SPACING = 1200.0, 300.0, 30, 5000.0
PATTERNS = {"plain": plain(), "twill 2/2": twill(2, 2), "satin 5": satin(5, 2)}


def systems() -> dict[str, FilamentSystem]:
    """Every pattern as round tows, flat ribbons and filaments."""
    tow, filament = filament_type(THICK, **NYLON), filament_type(FILAMENT, **NYLON)
    round_tow, flat = TowShape("circular", THICK, THICK), TowShape("racetrack", 2.5 * THICK, THICK)
    lens = holding("lenticular", THICK, COUNT, FILAMENT, 0.65)
    found = {}
    for name, pattern in PATTERNS.items():
        repeats = (2, 2) if len(pattern) == 2 else (1, 1)

        def spec(shape: TowShape, pattern=pattern, repeats=repeats) -> WeaveSpec:  # type: ignore[no-untyped-def]
            return WeaveSpec(pattern, shape, shape, SPACING, SPACING, repeats=repeats)

        found[f"{name}, round tows"] = tow_system(spec(round_tow), tow, 300.0)
        found[f"{name}, ribbons"] = ribbon_system(spec(flat), tow, 300.0)
        found[f"{name}, {COUNT} filaments a tow"] = filament_system(spec(lens), filament, COUNT, 300.0)
    return found


def main() -> None:
    """Draw them and print what overlaps."""
    built = systems()
    with style():
        fig = new_figure(13.0, 9.6)
        for k, (name, system) in enumerate(built.items()):
            draw_tows(fig.add_subplot(3, 3, k + 1), system, view=TowView(title=name))
            measured, gap = system.provenance["measured"], system.provenance["gap_added_um"]
            print(
                f"{name}: {system.n_filaments} chains, {system.n_beads} beads, largest overlap "
                f"{measured['largest_overlap_um'] / THICK:.2e} of the thickness, gap opened by {gap:.3g} um"
            )
    target = ROOT / "docs" / "figures" / "weaves.png"
    fig.savefig(target, dpi=75)
    print(target.relative_to(ROOT))


if __name__ == "__main__":
    main()
