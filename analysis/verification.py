"""docs/verification.md and the short table in README.md: every case of the suite on its full grid, as measured.

python analysis/verification.py    about fifteen minutes of one core
"""

from __future__ import annotations

import math
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from cgfibre.cases import friction, suite
from cgfibre.cases.experiment import CAPSULES, Measured

ROOT = Path(__file__).resolve().parent.parent
MARKS = "<!-- verification -->", "<!-- /verification -->"

HEAD = """# Every level against closed forms

Written by `python analysis/verification.py` from `cgfibre/cases`: the decks of this package, run by LAMMPS, beside
closed forms. `make test` runs a short form of the same cases, `make validate` all of them; both hold every number to
the limits in `cgfibre/cases/suite.py`. One T700 carbon filament of 40 D unless said, real EA and contact stiffness, by
critical drag to rest. Times are processor seconds of the whole row.

*own error*: what theory says of the method itself at these spacings (discrete chains and rods solved by hand, the
ratio of secants, the polygon on a pulley, see the cases' docstrings); *off it*: the largest difference of the measured
error from that. *order*: slope of log |error| over log s by least squares. A dash: nothing to compare (exact, or not
known). Where the closed form is 0 the table gives the number itself.
"""

CAPSULE_HEAD = """Filaments that touch along their segments (plugin). *own error* of a crossing is what two points of
every touching stretch make of the law: of a lens of 0.2 R (an overlap of 0.5 % D at 90 degrees) 0.2 %, of 0.5 R (3 %)
2 %, of 1.5 R (34 %, where no law holds) a quarter.
"""


@dataclass(frozen=True)
class Finding:
    """A row of lammps-findings: its numbers by s/D, as errors or values, and what to say where ours are larger."""

    what: str
    key: tuple[str, str, str]
    numbers: dict[float, float]
    values: bool = False
    scale: float = 1.0
    note: str = ""


def _grid(*numbers: float) -> dict[float, float]:
    return dict(zip(suite.SPACINGS, numbers, strict=True))


OWN = "ours is theory's own error of the chain to 2e-6, so it cannot be less without another error; "
FINDINGS = (
    Finding(
        "chain, cantilever",
        ("cantilever", "deflection", "chain"),
        _grid(6e-5, 2.7e-4, 1.2e-3, 4.9e-3),
        note=OWN + "(s/L)^2/2",
    ),
    Finding(
        "chain, simply supported",
        ("simply supported", "deflection", "chain"),
        _grid(3e-4, 1.2e-3, 5e-3, 2e-2),
        note=OWN + "2 (s/L)^2; findings' numbers are rounded",
    ),
    Finding(
        "chain, pre-tensioned",
        ("pre-tensioned beam", "deflection", "chain"),
        _grid(1e-5, 2.5e-3, 1.1e-2, 3.2e-2),
        note=OWN + "findings' chain took K = EI/s over its natural length, so 1/64 of strain made its EI larger, "
        "-8.7e-4 in the deflection: that cancels the error at s = D/2 and hides as much of the others",
    ),
    Finding(
        "rod, cantilever",
        ("cantilever", "deflection", "rod"),
        _grid(5e-5, 5e-5, 5e-5, 5e-5),
        note="findings: 1e-5 to 5e-5 at every s",
    ),
    Finding(
        "rod, simply supported",
        ("simply supported", "deflection", "rod"),
        _grid(5e-5, 5e-5, 5e-5, 5e-5),
        note="findings: 1e-5 to 5e-5 at every s",
    ),
    Finding(
        "rod, elastica (over L)",
        ("elastica", "deflection", "rod"),
        _grid(1.6e-5, 7e-5, 3e-4, 1.2e-3),
        scale=0.811,
        note="ours times w/L = 0.811, as findings' errors are over the length",
    ),
    Finding("rod, buckling", ("buckling", "load", "rod"), _grid(5e-4, 9e-4, 2.4e-3, 8.6e-3)),
    Finding(
        "rod, torsion at 3 rad a bond",
        ("torsion, 3 rad a bond", "torque", "rod"),
        _grid(1e-9, 1e-9, 1e-9, 1e-9),
        note='findings: "exact", taken as 1e-9',
    ),
    Finding(
        "capstan, 60/30/15/8/4 nodes",
        ("capstan", "T2/T1", "chain"),
        dict(
            zip(
                (friction.Pulley().spacing(n) for n in suite.CAPSTAN_NODES),
                (1.8e-5, 6.6e-5, 2.6e-4, 9e-4, 3.6e-3),
                strict=True,
            )
        ),
    ),
    Finding(
        "bumps, peak F/N at s = D/8, D/4, D/2, D",
        ("sliding along", "peak F/N", "chain"),
        {0.125: 0.25, 0.25: 0.32, 0.5: 0.46, 1.0: 0.81},
        values=True,
    ),
    Finding(
        "bumps, mean F/N at s = D/8, D/4, D/2, D",
        ("sliding along", "mean F/N", "chain"),
        {0.125: 0.200, 0.25: 0.201, 0.5: 0.204, 1.0: 0.221},
        values=True,
    ),
    Finding(
        "nested distance over D at s = D",
        ("sliding along", "nested distance", "chain"),
        {1.0: 0.866},
        values=True,
        scale=1 / 7,
    ),
)

GROUPS: tuple[tuple[str, Callable[[Measured], bool]], ...] = (
    (
        "statics of one filament (axial, bending, tension, elastica)",
        lambda m: (
            m.case
            in (
                "axial",
                "end load doubled",
                "cantilever",
                "simply supported",
                "pre-tensioned beam",
                "flat platen",
                "elastica",
            )
        ),
    ),
    ("buckling load, bending frequency", lambda m: m.case in ("buckling", "bending frequency")),
    ("torsion, to 3 rad a bond", lambda m: m.case.startswith("torsion")),
    (
        "curved rods (quarter circle, helix)",
        lambda m: m.level == "rod" and m.case in ("helix", "curved rest shape") and m.quantity == "compliance",
    ),
    (
        "friction coefficient (filaments, platens)",
        lambda m: m.quantity == "F_t/F_n",
    ),
    ("contact at its design load and angle", lambda m: m.case in ("line contact, 1 N/mm", "crossing at 90 degrees")),
    (
        "balance of forces and energy, momentum, frames",
        lambda m: m.quantity in ("taken below", "energy at the stop", "unbalanced", "tip off") or m.case == "momentum",
    ),
    ("disc on its spring, stack of discs", lambda m: m.level == "section" and m.quantity.endswith("force")),
)


def number(x: float) -> str:
    """An error: two digits, 0 below rounding."""
    return "0" if abs(x) < 5e-13 else f"{x:.1e}"


def own_error(group: Sequence[Measured]) -> list[str]:
    """Columns: largest error of the method itself, and how far the measured ones are off it."""
    stated = max(abs(m.stated) for m in group)
    if stated < 1e-9:
        return ["-", "-"]
    return [number(stated), number(max(abs(m.error - m.stated) for m in group))]


def orders(case: suite.Case, group: Sequence[Measured]) -> list[str]:
    """Columns: measured and theory's order."""
    expected = suite.expected_order(case, group)
    if expected is None:
        return ["-", "-"]
    return [f"{suite.order_of([m.spacing for m in group], [m.error for m in group]):.2f}", f"{expected:.2f}"]


def table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Markdown."""
    lines = ["| " + " | ".join(columns) + " |", "|" + "---|" * len(columns)]
    return "\n".join([*lines, *("| " + " | ".join(row) + " |" for row in rows)]) + "\n"


def seconds(group: Sequence[Measured]) -> str:
    """Processor seconds, - where another row of the same runs has them."""
    total = sum(m.cpu for m in group)
    return f"{total:.1f}" if total else "-"


def document(found: dict[str, list[Measured]]) -> str:
    """docs/verification.md."""
    by_grid, capsules, other = [], [], []
    for case in suite.CASES:
        for (name, quantity, level), group in suite.grouped(found[case.name]).items():
            tail = [*own_error(group), *orders(case, group), seconds(group)]
            at = {m.spacing: m for m in group}
            smooth = level.endswith(CAPSULES)
            spacings = suite.CAPSULE_SPACINGS if smooth else suite.SPACINGS
            if set(at) <= set(spacings):
                errors = [number(at[s].error) if s in at else "" for s in spacings]
                (capsules if smooth else by_grid).append([name, quantity, level, *errors, *tail])
            else:
                values = ", ".join(f"{m.value:.5g}" for m in group)
                errors = [", ".join(number(m.error) for m in group)]
                where = ", ".join(f"{m.spacing:.3g}" for m in group) if group[0].spacing else "-"
                other.append([name, quantity, level, where, values, *errors, *tail])
    end = ["own error", "off it", "order", "theory", "s"]
    grid_columns = ["case", "quantity", "level", *(f"error, s = {s:g} D" for s in suite.SPACINGS), *end]
    capsule_columns = ["case", "quantity", "level", *(f"error, s = {s:g} D" for s in suite.CAPSULE_SPACINGS), *end]
    own_columns = ["case", "quantity", "level", "s/D", "measured", "error", *end]
    total = sum(m.cpu for group in found.values() for m in group)
    return "\n".join(
        [
            HEAD,
            "## Spacings D/2 to 4 D\n",
            table(grid_columns, by_grid),
            "## Capsules, spacings D to 8 D\n",
            CAPSULE_HEAD,
            table(capsule_columns, capsules),
            "## Cases with a grid of their own\n",
            table(own_columns, other),
            "## Beside what was measured before (lammps-findings)\n",
            comparison(found),
            f"All of it: {total:.0f} processor seconds.\n",
        ]
    )


def comparison(found: dict[str, list[Measured]]) -> str:
    """Every row of lammps-findings beside ours."""
    groups = suite.grouped([m for group in found.values() for m in group])
    rows = []
    for f in FINDINGS:
        ours = {}
        for m in groups[f.key]:
            for s in f.numbers:
                if abs(m.spacing - s) < 1e-6 * s:
                    ours[s] = (m.value if f.values else abs(m.error)) * f.scale
        theirs = [f.numbers[s] for s in sorted(f.numbers)]
        mine = [ours[s] for s in sorted(f.numbers)]
        if f.values:
            exact = [m.exact * f.scale for s in sorted(f.numbers) for m in groups[f.key] if m.spacing == s]
            theory = ", ".join(f"{x:.3g}" for x in exact)
            # findings' means and distances have three digits
            better = all(abs(a - e) <= abs(b - e) + 5e-4 for a, b, e in zip(mine, theirs, exact, strict=True))
            words = [", ".join(f"{x:.3g}" for x in v) for v in (theirs, mine)] + [theory]
        else:
            better = all(a <= 1.05 * b for a, b in zip(mine, theirs, strict=True))
            words = [", ".join(f"{x:.1e}" for x in v) for v in (theirs, mine)] + ["0"]
        verdict = "reproduced or bettered" if better else "larger"
        rows.append([f.what, *words, verdict + (f": {f.note}" if f.note else "")])
    return table(["row", "findings", "here", "closed form", "verdict"], rows)


def short_table(found: dict[str, list[Measured]]) -> str:
    """Worst error of each group of cases by level and spacing."""
    every = [m for group in found.values() for m in group]
    columns = [(level, s) for level in ("chain", "rod") for s in suite.SPACINGS] + [("section", 0.0)]
    rows = []
    for name, member in GROUPS:
        cells = []
        for level, s in columns:
            errors = [abs(m.error) for m in every if member(m) and m.level == level and m.spacing == s]
            worst = max(errors, default=math.nan)
            cells.append("" if math.isnan(worst) else "<1e-9" if worst < 1e-9 else f"{worst:.0e}".replace("e-0", "e-"))
        rows.append([name, *cells])
    names = [f"{level} {'D/2' if s == 0.5 else 'D' if s == 1 else f'{s:g} D'}" if s else level for level, s in columns]
    return table(["worst relative error, s =", *names], rows)


def main() -> int:
    """Run the suite, write both tables; the exit status says whether a number is beyond its limit."""
    found, bad = {}, []
    with tempfile.TemporaryDirectory() as folder:
        for case in suite.CASES:
            found[case.name] = suite.measure(case, Path(folder) / case.name.replace(" ", "-"))
            bad += suite.complaints(case, found[case.name])
            print(f"{case.name}: {sum(m.cpu for m in found[case.name]):.1f} s", flush=True)
    (ROOT / "docs" / "verification.md").write_text(document(found))
    readme = ROOT / "README.md"
    before, rest = readme.read_text().split(MARKS[0])
    after = rest.split(MARKS[1])[1]
    readme.write_text(before + MARKS[0] + "\n" + short_table(found) + MARKS[1] + after)
    print("\n".join(bad) or "every number within its limit")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
