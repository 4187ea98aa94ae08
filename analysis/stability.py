"""docs/stability.md and docs/figures/stability-*.png: where each method fails, measured by ``cgfibre stability``.

python analysis/stability.py [FOLDER]     FOLDER keeps the maps, so that a stopped run goes on [results/stability]
"""

from __future__ import annotations

import math
import shutil
import sys
from pathlib import Path

from cgfibre.stability import Finding, find_limits, picture_name

ROOT = Path(__file__).resolve().parent.parent
HEAD = """# Where each method fails

Written by `python analysis/stability.py` from the maps of `cgfibre stability`: limits found by bisection over short
runs of the package's own decks, beside closed forms. Points are measured, lines are predicted, crosses are what the
package uses by default; where a map shows a method failing, its distance from the closed form is large and no
default is near it. All of carbon T700 (D = 7 um) unless said. Processor seconds of the engine: {cpu:.0f} s.

| map | measured off its closed form, at worst | step used / limit measured, at worst |
|---|---|---|
"""


def _number(x: float) -> str:
    return "" if math.isnan(x) else f"{x:.4g}"


def _section(f: Finding) -> str:
    m = f.map
    unit = "" if m.unit == "1" else f" [{m.unit}]"
    lines = [
        f"## {m.title}\n",
        f"**Fails:** {m.fails}\n",
        f"**Closed form:** {m.formula}\n",
        f"**What the package does:** {m.handled}\n",
        f"![{m.title}](figures/{picture_name(m)})\n",
        f"| series | {m.parameter}{'' if m.parameter_unit == '1' else f' [{m.parameter_unit}]'} | {m.quantity}{unit} | "
        "closed form | used by default |\n|---|---|---|---|---|",
    ]
    rows = [
        f"| {p.series} | {p.parameter:.3g} | {_number(p.measured)} | {_number(p.predicted)} | {_number(p.used)} |"
        for p in f.points
    ]
    return "\n".join([*lines, *rows]) + "\n"


def main() -> None:
    """Measure what the folder lacks; write the document and its figures."""
    out = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "results" / "stability"
    found = find_limits(out)
    text = HEAD.format(cpu=sum(f.cpu for f in found))
    for f in found:
        used = "" if math.isnan(f.step_used) else f"{f.step_used:.2f}"
        worst = "" if math.isnan(f.worst) else f"{f.worst:.1%}" if f.worst < 10 else f"{f.worst:.1g} times"
        text += f"| {f.map.title} | {worst} | {used} |\n"
        shutil.copyfile(out / picture_name(f.map), ROOT / "docs" / "figures" / picture_name(f.map))
    text += "\n" + "\n".join(_section(f) for f in found)
    (ROOT / "docs" / "stability.md").write_text(text)


if __name__ == "__main__":
    main()
