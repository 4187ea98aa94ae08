"""docs/speed_accuracy.md and docs/figures/speed-accuracy-*.png: what levels, spacings and speeds cost and get wrong.

python analysis/speed_accuracy.py [PART ...] [--jobs N] [--seeds N] [--compare LABEL=PATH ...]

Parts: carbon-37, carbon-127, one-filament, capstan, sliding (all, if none is named), or a TOML file of your own. A part
writes its own section of the page and leaves the others; a chart that was stopped goes on (results/charts/PART).
"""

from __future__ import annotations

import argparse
import math
import re
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from cgfibre import plot_chart
from cgfibre.cases import friction
from cgfibre.cases.experiment import Measured
from cgfibre.cases.pressing import pressed_alone
from cgfibre.chart import COMPARED, Chart, ChartOptions, chart_scene

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs" / "speed_accuracy.md"
FIGURES = ROOT / "docs" / "figures"
HEAD = """# Accuracy against speed

Written by `python analysis/speed_accuracy.py`, one section a part; `cgfibre chart SCENE` charts any scene.

Bundles: every variant presses the same jittered specimens, loading alone, at the platen speed that its accuracy asks
for. A name is level, spacing s (D: one diameter, D2: half of one) and accuracy; filaments touch as smooth capsules
unless it says beads. The error is that of the force against the finest variant, the mean of |F/F_ref - 1| beyond the
first 2/7 D, and the change at three displacements (where the reference carries 10 %, 40 % and all of its peak force);
± is half the range over the starts. Time is processor time of the engine: other work on the machine lengthens it by a
third and more. One filament, capstan and sliding: against closed forms.
"""


@dataclass(frozen=True)
class Bundle:
    """A scene to chart: what to change in it, how many starts, which variants (none: all)."""

    scene: str
    overrides: tuple[str, ...]
    seeds: int = 3
    only: tuple[str, ...] = ()
    reference_accuracy: float = 0.0125


BUNDLES = {
    # half the speed of the finest step would take twice as long
    "carbon-37": Bundle("carbon-37", ("platens.stop.displacement=14 um",), seeds=1),
    "carbon-127": Bundle(
        "carbon-127",
        ("platens.stop.displacement=5 um",),
        seeds=1,
        only=("section-0.05", "chain-4D-0.2", "chain-4D-0.1", "chain-4D-0.05", "chain-4D-0.025", "chain-beads-D-0.05"),
        reference_accuracy=0.025,
    ),
}


# --- bundles ----------------------------------------------------------------------------------------------------------


def chart_text(chart: Chart, figure: str) -> str:
    """Section of the page: picture, table, what was left out, and the bar."""
    d = ", ".join(f"{x:.3g}" for x in chart.displacements)
    lines = [f"![{chart.scene}: error against processor time](figures/{figure})\n"]
    lines.append(
        f"Loading to {chart.displacements[-1]:.3g} um; errors of the force at {d} um, of the thickness at the "
    )
    lines.append("forces there (" + ", ".join(f"{1e3 * f:.3g}" for f in chart.forces) + " mN).\n")
    at = " | ".join(f"F at {x:.3g} um" for x in chart.displacements)
    thick = " | ".join(f"t at {1e3 * f:.3g} mN, um" for f in chart.forces)
    lines.append(f"| variant | beads | steps | CPU s | starts | mean error | {at} | {thick} | |")
    lines.append("|" + "---|" * (7 + 2 * len(chart.displacements)))
    for r in sorted(chart.rows, key=lambda r: r.cpu):
        spread = f" ± {50 * (r.error_range[1] - r.error_range[0]):.1f}" if r.starts > 1 else ""
        mean = "reference" if r.reference else f"{100 * r.error:.1f}{spread} %"
        forces = " | ".join("" if math.isnan(e) else f"{e:+.1%}" for e in r.force_errors)
        off = " | ".join("" if math.isnan(e) else f"{e:+.2g}" for e in r.thickness_errors)
        words = [w for w, true in (("planner", r.planner), ("front", r.front), ("distrusted", not r.trusted)) if true]
        beads, steps = (str(n) if n else "" for n in (r.beads, r.steps))
        cells = (r.name, beads, steps, f"{r.cpu:.3g}", str(r.starts), mean, forces, off, ", ".join(words))
        lines.append("| " + " | ".join(cells) + " |")
    lines.append("")
    best = chart.cheapest
    if best is not None:
        lines.append(f"Cheapest trusted variant within {chart.goal:.0%}: {best.name}, {best.cpu:.3g} s.")
        for r in (r for r in chart.rows if r.level == COMPARED):
            lines.append(f"{r.name}: {r.cpu:.3g} s, {r.cpu / best.cpu:.2g} times as long, error {r.error:.1%}.")
    lines += [f"Left out: {name}: {reason}." for name, reason in chart.left_out]
    return "\n".join(lines)


def bundle(name: str, arguments: argparse.Namespace) -> str:
    """Chart a bundle; the section's text."""
    b = BUNDLES.get(name, Bundle(name, ()))
    label = Path(name).stem
    options = ChartOptions(
        ROOT / "results" / "charts" / label,
        seeds=arguments.seeds or b.seeds,
        reference_accuracy=b.reference_accuracy,
        jobs=arguments.jobs,
        only=b.only,
        compare=tuple(arguments.compare),
    )
    chart = chart_scene(
        b.scene, options, b.overrides, lambda done, total, last: print(f"{done / total:4.0%} {last}", flush=True)
    )
    figure = f"speed-accuracy-{label}.png"
    (options.out / "chart.png").replace(FIGURES / figure)
    return chart_text(chart, figure)


# --- against closed forms ---------------------------------------------------------------------------------------------

Trial = Callable[[Path], list[Measured]]


def of(case: Callable[..., list[Measured]], *arguments: object) -> Trial:
    """The case with its arguments, short of the folder."""
    return lambda folder: case(folder, *arguments)


def trials_text(part: str, title: str, trials: Sequence[tuple[str, Trial]]) -> str:
    """Run every trial in a folder of its own and draw its first number; the section's text."""
    found = []
    for name, trial in trials:
        with tempfile.TemporaryDirectory() as folder:
            m = trial(Path(folder))[0]
        print(f"{m.level} {m.spacing:g} {name}: {m.error:+.2e}, {m.cpu:.3g} s", flush=True)
        found.append((name, m))
    figure = f"speed-accuracy-{part}.png"
    fig = plot_chart.figure_trials([m for _, m in found], [name for name, _ in found], title)
    fig.savefig(FIGURES / figure)
    cells = (
        (m.level, f"{m.spacing:.3g}" if m.spacing else "", name, m.quantity, f"{m.cpu:.3g}", f"{m.error:+.1e}")
        for name, m in found
    )
    rows = "\n".join("| " + " | ".join(row) + " |" for row in cells)
    head = "| level | s/D | variant | quantity | CPU s | error |\n|---|---|---|---|---|---|"
    return f"![{title}](figures/{figure})\n\n{head}\n{rows}"


def one_filament(arguments: argparse.Namespace) -> str:
    """One filament alone under the platen, nothing below it, against the pre-tensioned beam."""
    ladder = [("section", 0.0, a) for a in (0.2, 0.05)]
    ladder += [("chain", spacing, a) for spacing in (4.0, 1.0) for a in (0.2, 0.1, 0.05, 0.0125)]
    ladder += [("rod", 4.0, a) for a in (0.2, 0.05)]
    trials = [(f"{a:g}", of(pressed_alone, level, spacing, a)) for level, spacing, a in ladder]
    text = trials_text("one-filament", "One filament bent by the platen, at the planned speed of an accuracy", trials)
    return text + "\n\nMean error of the force beyond 2/7 D; a variant's name is its accuracy."


def capstan(arguments: argparse.Namespace) -> str:
    """T2/T1 of a chain on a turning pulley."""
    pulley = friction.Pulley()
    trials = [(f"n = {n}", of(friction.capstan, "chain", pulley.spacing(n))) for n in (4, 8, 15, 30, 60)]
    return trials_text("capstan", "Capstan: T2/T1 against exp(mu theta), n nodes on the pulley", trials)


def sliding(arguments: argparse.Namespace) -> str:
    """Friction of one filament along another."""
    trials = [(f"s = {s:g} D", of(friction.sliding_along, "chain", s)) for s in (1.0, 0.5, 0.25)]
    return trials_text("sliding", "Sliding along a filament: mean friction", trials)


PARTS: dict[str, Callable[[argparse.Namespace], str]] = {
    "one-filament": one_filament,
    "capstan": capstan,
    "sliding": sliding,
}


def current_page() -> str:
    """The page's sections as they stand, below the head of today."""
    text = PAGE.read_text() if PAGE.exists() else ""
    return HEAD + ("\n" + text[text.index("<!-- ") :] if "<!-- " in text else "")


def put_section(page: str, part: str, text: str) -> str:
    """The page with the section of a part replaced, or added at its end."""
    section = f"<!-- {part} -->\n## {part}\n\n{text}\n<!-- end {part} -->"
    old = re.compile(rf"<!-- {re.escape(part)} -->.*?<!-- end {re.escape(part)} -->", re.S)
    if old.search(page):
        return old.sub(lambda _: section, page)
    return page.rstrip("\n") + "\n\n" + section + "\n"


def main() -> None:
    """Run the parts and write their sections."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*", default=[*BUNDLES, *PARTS])
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--seeds", type=int, default=0, help="starts a variant [the part's own]")
    parser.add_argument("--compare", action="append", default=[], metavar="LABEL=PATH", help="results made elsewhere")
    arguments = parser.parse_args()
    FIGURES.mkdir(parents=True, exist_ok=True)
    (ROOT / "results" / "charts").mkdir(parents=True, exist_ok=True)
    for part in arguments.parts:
        text = PARTS[part](arguments) if part in PARTS else bundle(part, arguments)
        PAGE.write_text(put_section(current_page(), Path(part).stem, text))
        print(f"{part}: {PAGE.relative_to(ROOT)}")


if __name__ == "__main__":
    main()
