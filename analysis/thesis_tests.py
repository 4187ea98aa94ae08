"""docs/figures/thesis-tests.png and results/thesis-tests/table.md: sections beside the compaction tests of the thesis.

Thickness at fixed pressure of flat and circular sections, straight filaments of the test's length and pre-load, beside
the empirical law of the tests (thesis Eq 5-4) with its 8 % and the scatter between laboratories, and the three moduli
of the thesis' own section. Runs that are in the folder already are found again; all of them take 10 minutes.

python analysis/thesis_tests.py [--out DIR] [--jobs N]
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cgfibre import plot
from cgfibre.build.packing import ArrangementSpec, arrange
from cgfibre.measure.compaction import compare_thickness, thickness_at_pressure
from cgfibre.mechanics.compaction_laws import DEVIATION, THESIS_LAW, Conditions, beyond_tests, most_anvil_pressure
from cgfibre.record import Curve
from cgfibre.store import read_results
from cgfibre.sweep import SweepOptions, SweepRun, run_all

ROOT = Path(__file__).resolve().parent.parent
FIGURES = ROOT / "docs" / "figures"
D = 7.0
#: ten layers of thirty; of a hundred and twenty
STRIP, LAYERS_ASPECT = 300, 3.47
WIDE, WIDE_ASPECT = 1200, 13.7
#: 345 mm between the supports; 50 cN on 12 000 filaments (the thesis' 0.04 cN is ten times that)
TESTED_LENGTH, SHORT_SPAN, TENSION = "345 mm", "0.7 mm", "0.004167 cN"
COMMON = (
    f"ends.tension={TENSION}",
    "contact.softening=1",
    "platens.unload=false",
    "platens.stop.pressure=30 MPa",
    "model.accuracy=0.1",
    "model.most_steps=400000",
)
TOW = Conditions(12, 0.26, 50)
PRESSURES = np.array([0.1, 0.3, 1.0, 3.7, 10.0, 30.0])
#: (strain, MPa) where the thesis' own section of 127 changes its modulus: 22, 125 and 1316 MPa (7.3.4)
THESIS_SECTION = np.cumsum([[0.0, 0.0], [0.46, 0.46 * 22], [0.08, 0.08 * 125], [0.03, 0.03 * 1316]], axis=0)


@dataclass(frozen=True)
class Case:
    """A section: label, colour, overrides; ``fraction``: a strip packed at random at that volume fraction."""

    label: str
    colour: str
    overrides: tuple[str, ...]
    fraction: float | None = None
    shape: tuple[int, float] = (STRIP, LAYERS_ASPECT)
    starts: int = 1
    dashed: bool = False

    def runs(self, out: Path) -> list[SweepRun]:
        """Its starts, planned."""
        return [self._planned(out, start) for start in range(1, self.starts + 1)]

    def _planned(self, out: Path, start: int) -> SweepRun:
        own: tuple[str, ...] = (f"assembly.seed={start}",)
        if self.fraction is not None:
            count, aspect = self.shape
            spec = ArrangementSpec("random-rectangular", count, volume_fraction=self.fraction, aspect=aspect)
            centres = arrange(spec, D, np.random.default_rng(start))
            path = out / f"centres-{count}-{self.fraction:g}-{start}.csv"
            path.parent.mkdir(parents=True, exist_ok=True)
            np.savetxt(path, centres, fmt="%.6f", delimiter=",", header="y_um,z_um", comments="")
            own = ("assembly.arrangement=file", f"assembly.centres={path}")
        name = self.label.replace(" ", "-").replace(",", "").replace("%", "")
        return SweepRun.planned(out / f"{name}-{start}", "carbon-127-section", (*COMMON, *self.overrides, *own))


LONG = (f"assembly.length={TESTED_LENGTH}",)
CASES = (
    Case("circle of 127", plot.GREY, (*LONG, "assembly.jitter=0.3 um"), starts=2),
    Case(
        "strip, layers, 31 % voids",
        plot.BLUE,
        (
            *LONG,
            "assembly.jitter=0.3 um",
            f"assembly.count={STRIP}",
            "assembly.arrangement=rectangular",
            f"assembly.aspect={LAYERS_ASPECT}",
        ),
    ),
    Case("strip, random, 50 % voids", plot.VERMILION, LONG, 0.5, starts=2),
    Case("wide strip, random, 50 % voids", "#E69F00", LONG, 0.5, (WIDE, WIDE_ASPECT)),
    Case("strip, random, 65 % voids", plot.GREEN, LONG, 0.35),
    Case("strip, random, 50 % voids, span 2 mm", "#56B4E9", ("assembly.length=2 mm",), 0.5, dashed=True),
    Case(
        f"strip, random, 50 % voids, span {SHORT_SPAN}",
        plot.VERMILION,
        (f"assembly.length={SHORT_SPAN}",),
        0.5,
        starts=3,
        dashed=True,
    ),
)


def loading(folder: Path) -> Curve:
    """Curve of a run."""
    return read_results(folder / "results.h5").curve


def _shown(value: float) -> str:
    return f"{value:.2f}" if np.isfinite(value) else ""


def rows(case: Case, curves: Sequence[Curve]) -> list[str]:
    """Thickness over the initial one at the pressures, and its deviation from the law's: means over the starts."""
    compared = [
        compare_thickness(c["thickness_um"][c.loading], c["pressure_MPa"][c.loading], THESIS_LAW, TOW, PRESSURES)
        for c in curves
    ]
    measured = np.mean([c.measured for c in compared], axis=0)
    away = np.mean([c.deviation for c in compared], axis=0)
    spread = np.mean(
        [
            thickness_at_pressure(c.width_um[c.loading] / c.width_um[0], c["pressure_MPa"][c.loading], PRESSURES)
            for c in curves
        ],
        axis=0,
    )
    fraction = np.mean(
        [
            thickness_at_pressure(c["fibre_volume_fraction"][c.loading], c["pressure_MPa"][c.loading], PRESSURES)
            for c in curves
        ],
        axis=0,
    )
    cells = [
        f"{m:.3f} ({a:+.0%}{', in band' if compared[0].low[k] <= m <= compared[0].high[k] else ''})"
        if np.isfinite(m)
        else "not reached"
        for k, (m, a) in enumerate(zip(measured, away, strict=True))
    ]
    return [
        f"| {case.label} | thickness | " + " | ".join(cells) + " |",
        "| | width | " + " | ".join(map(_shown, spread)) + " |",
        "| | fibre volume fraction | " + " | ".join(map(_shown, fraction)) + " |",
    ]


def table(found: dict[Case, list[Curve]]) -> str:
    """The comparison as a table."""
    law = THESIS_LAW.thickness(1.0, PRESSURES, TOW)
    low, high = THESIS_LAW.thickness_band(PRESSURES, TOW)
    lines = [
        "| section | | " + " | ".join(f"{p:g} MPa" for p in PRESSURES) + " |",
        "|" + "---|" * (len(PRESSURES) + 2),
        "| tests: law 5-4, 12k | thickness | "
        + " | ".join(f"{t:.3f} ({a:.3f} to {b:.3f})" for t, a, b in zip(law, low, high, strict=True))
        + " |",
    ]
    strain, pressure = THESIS_SECTION.T
    thesis = 1 - np.interp(PRESSURES, pressure, strain)
    lines.append("| thesis' section, three moduli | thickness | " + " | ".join(f"{t:.3f}" for t in thesis) + " |")
    for case, curves in found.items():
        lines += rows(case, curves)
    return "\n".join(lines) + "\n"


def draw(found: dict[Case, list[Curve]]) -> None:
    """docs/figures/thesis-tests.png: pressure borne against thickness over the initial one, and volume fraction."""
    fig = plot.new_figure(11.0, 5.0)
    with plot.style():
        left, right = fig.subplots(1, 2)
    p = np.geomspace(0.03, 30, 200)
    low, high = THESIS_LAW.thickness_band(p, TOW)
    left.fill_betweenx(p, low, high, color=plot.INK, alpha=0.15, lw=0)
    left.plot(THESIS_LAW.thickness(1.0, p, TOW), p, color=plot.INK, label=f"tests, 12k: law 5-4 ± {DEVIATION:.0%}")
    width = most_anvil_pressure(6.5)
    left.axhline(float(width), color=plot.INK, lw=0.9, ls=":")
    left.text(
        0.985, 1.1 * float(width), "12 N on a flat tow", ha="right", fontsize=9, transform=left.get_yaxis_transform()
    )
    strain, pressure = THESIS_SECTION.T
    left.plot(1 - strain[1:], pressure[1:], "D", color="#CC79A7", ms=6, label="thesis' section, its three moduli")
    for case, curves in found.items():
        for k, c in enumerate(curves):
            keep = c.loading
            # as under a load that only grows: it stands where the section bears it for the first time
            borne = np.maximum.accumulate(c["pressure_MPa"][keep])
            style = {"color": case.colour, "lw": 1.4, "ls": "--" if case.dashed else "-"}
            t = c["thickness_um"] / c["thickness_um"][0]
            left.plot(t[keep], borne, label=case.label if k == 0 else None, **style)
            right.plot(c["fibre_volume_fraction"][keep], borne, **style)
    for ax in (left, right):
        ax.set_yscale("log")
        ax.set_ylim(0.03, 40)
        ax.set_ylabel("Pressure borne (MPa)")
    left.set_xlim(0.1, 1.02)
    left.set_xlabel("Thickness over the initial one (1)")
    right.set_xlabel("Fibre volume fraction between the platens (1)")
    right.axvline(np.pi / (2 * np.sqrt(3)), color=plot.INK, lw=0.9, ls=":")
    right.text(0.9, 0.035, "hexagonal 0.907", rotation=90, ha="right", va="bottom", fontsize=9)
    fig.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=9, frameon=False)
    fig.savefig(FIGURES / "thesis-tests.png")


def main() -> None:
    """Run what is missing, write the table, draw the figure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=ROOT / "results" / "thesis-tests")
    parser.add_argument("--jobs", type=int, default=1)
    arguments = parser.parse_args()
    runs = {case: case.runs(arguments.out) for case in CASES}
    failed = run_all([r for of in runs.values() for r in of], SweepOptions(arguments.jobs, resume=True, trim=True))
    for folder, reason in failed.items():
        print(f"{folder.name}: {reason}")
    found = {case: [loading(r.folder) for r in of if r.folder not in failed] for case, of in runs.items()}
    found = {case: curves for case, curves in found.items() if curves}
    text = table(found)
    (arguments.out / "table.md").write_text(text)
    print(text)
    print("the law beyond its tests:", "; ".join(beyond_tests(Conditions(0.127, 0.0, 0.5))))
    draw(found)


if __name__ == "__main__":
    main()
