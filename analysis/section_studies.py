"""The studies in docs/sections.md and docs/figures/section-*.png: section 7.5 of the thesis, by `cgfibre study`.

python analysis/section_studies.py [STUDY ...] [--runs FOLDER] [--jobs N] [--full]

Without --full some studies have fewer cases and starts than their file (QUICK), as on the page. A study that was
stopped goes on; its runs lie in FOLDER/STUDY [results/studies]. A study writes its own section and leaves the others.
"""

from __future__ import annotations

import argparse
import math
import shutil
from pathlib import Path

from cgfibre.measure.ensemble import mean_of
from cgfibre.study.outcome import CaseFound, reached
from cgfibre.study.run import Found, StudyOptions, run_study

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs" / "sections.md"
FIGURES = ROOT / "docs" / "figures"
#: where the sections of the studies begin; what stands before is written by hand
MARK = "<!-- studies: written by analysis/section_studies.py -->\n"

#: study -> (starts, cases; none: all)
QUICK: dict[str, tuple[int, tuple[str, ...]]] = {
    "start-point": (1, ("0.7-mm-dry", "0.7-mm-wet", "7-mm-dry")),
    "filament-count": (1, ("127", "169", "331")),
    "arrangement": (1, ()),
    "friction-dry": (2, ("0.2", "0.28", "0.36", "0.48")),
    "friction-wet": (1, ("0.02", "0.1", "0.18")),
    "crimp": (1, ()),
    "length": (1, ()),
    "pre-tension": (1, ()),
    "twist": (1, ()),
}


def _shown(value: float, ci: float) -> str:
    if math.isnan(value):
        return ""
    if math.isnan(ci):
        return f"{value:.1f}"
    return f"{value:.1f} ± {ci:.2g}"


def _row(case: CaseFound, names: list[str]) -> str:
    n = len(case.specimens)
    cells = [case.cell.label, "one sample" if n == 1 else str(n), f"{case.initial:.1f}"]
    for name in names:
        m = case.metrics.get(name)
        mean, ci, _ = mean_of(reached(m.values)) if m else (math.nan,) * 3
        cells.append(_shown(mean, ci))
    spoke = "; ".join(case.guards()) or "none"
    return "| " + " | ".join([*cells, spoke]) + " |"


def _label(name: str) -> str:
    """A column's heading from its name in table.csv."""
    again, _, load = name.rpartition("thickness_um_at_")
    return (again.replace("_", " ") + "t at " + load.replace("_N_per_mm", " N/mm").replace("_", " ")).strip()


def section(found: Found, name: str) -> str:
    """The study's part of the page."""
    study = found.study
    names = list(dict.fromkeys(n for c in found.cases for n in c.metrics if "thickness_um_at" in n))
    names = [n for n in names if not n.startswith("unloading")]
    lines = [
        f"## {study.title}\n",
        f"`cgfibre study {name}`\n",
        f"**Thesis.** {' '.join(study.statement.split())}\n",
        f"**Found.** {' '.join(study.finding.split())}\n",
        f"![{study.title}](figures/section-{name}.png)\n",
        "| case | samples | as built, um | " + " | ".join(_label(n) for n in names) + " | guards that spoke |",
        "|" + "---|" * (len(names) + 4),
        *(_row(case, names) for case in found.cases),
        "",
    ]
    if found.fit:
        f = found.fit
        parts = [
            f"{k} = {getattr(f.law, k):.3g}" + ("" if math.isnan(ci) else f" ± {ci:.2g}")
            for k, ci in (("c", f.c_ci), ("a", f.a_ci), ("b", f.b_ci))
        ]
        lines.append(
            f"Fit of t = c P^(a mu - b) (mm, N/mm): {', '.join(parts)}; ln t within {f.misfit:.2g}, "
            f"{f.n_points} points.\n"
        )
        lines.append(f"![{study.title}: thickness and fit](figures/section-{name}-fit.png)\n")
    cpu = sum(s.cpu for c in found.cases for s in c.specimens)
    lines.append(f"Engine: {cpu:.0f} CPU s for {sum(len(c.specimens) for c in found.cases)} runs.\n")
    return "\n".join(lines)


def insert(name: str, text: str) -> None:
    """Put a study's section on the page, in the order of QUICK."""
    head, _, body = PAGE.read_text().partition(MARK)
    parts = {}
    for part in body.split("\n## ")[1:]:
        own = part.partition("`cgfibre study ")[2].partition("`")[0]
        parts[own] = "## " + part.rstrip() + "\n"
    parts[name] = text.rstrip() + "\n"
    PAGE.write_text(head + MARK + "\n" + "\n".join(parts[n] for n in QUICK if n in parts))


def main() -> None:
    """Run what is missing; write the page and its figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("studies", nargs="*", metavar="STUDY", help=f"of {', '.join(QUICK)} [all]")
    parser.add_argument("--runs", type=Path, default=ROOT / "results" / "studies")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--full", action="store_true")
    arguments = parser.parse_args()
    for name in arguments.studies or QUICK:
        starts, only = (None, ()) if arguments.full else QUICK[name]
        out = arguments.runs / name
        options = StudyOptions(out, arguments.jobs, starts, only)
        found = run_study(name, options, (), lambda done, total, last: None)
        shutil.copyfile(out / "study.png", FIGURES / f"section-{name}.png")
        if found.fit:
            shutil.copyfile(out / "values.png", FIGURES / f"section-{name}-fit.png")
        insert(name, section(found, name))
        print(name, f"{found.wall:.0f} s", flush=True)


if __name__ == "__main__":
    main()
