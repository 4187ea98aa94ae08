"""docs/planner.md: what the planner promised for twelve scenes beside what they took and how far they were off.

Every scene runs as planned and once more as a reference: four times slower, on all of the assembly (no symmetry), with
real contacts, small bundles with segments of one diameter, sections at level chain. Finished runs are kept and not run
again.

python analysis/planner_scenes.py [--out DIR] [--only NAME,...]
"""

from __future__ import annotations

import argparse
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cgfibre import workflow
from cgfibre.store import read_results
from cgfibre.workflow import RunOptions, run_scene

ROOT = Path(__file__).resolve().parent.parent
LOADING = ("platens.unload=false", "model.speed_check=false", "output.frames=10")
SLOW = ("model.accuracy=0.0125", "model.symmetry=none", "contact.softening=1")


@dataclass(frozen=True)
class Case:
    """A scene with its overrides, and what its reference changes."""

    name: str
    base: str
    overrides: tuple[str, ...]
    reference: tuple[str, ...]


CASES = (
    Case("1 carbon", "carbon-2", ("assembly.count=1", "platens.stop.displacement=3 um"), (*SLOW, "model.spacing=7 um")),
    Case("2 carbon", "carbon-2", (), (*SLOW, "model.spacing=7 um")),
    Case("7 carbon", "carbon-7", ("platens.stop.displacement=6 um",), (*SLOW, "model.spacing=7 um")),
    Case(
        "7 carbon, clamped",
        "carbon-7",
        ("ends.support=clamped", "platens.stop.displacement=6 um"),
        SLOW,
    ),
    Case("7 E-glass", "carbon-7", ("filament.material=E-glass", "platens.stop.displacement=7 um"), SLOW),
    Case("7 nylon", "carbon-7", ("filament.material=nylon", "assembly.length=28 mm", "platens.width=20 mm",
         "assembly.jitter=0.4 um", "platens.stop.displacement=240 um"), SLOW),
    Case("7 carbon, twisted", "carbon-7", ("assembly.twist=12 turn/cm", "platens.stop.displacement=5 um"),
         ("model.accuracy=0.0125",)),
    Case("12 carbon, random", "carbon-7", ("assembly.count=12", "assembly.arrangement=random",
         "assembly.fibre_volume_fraction=0.55", "platens.stop.displacement=8 um"), SLOW),
    Case("19 carbon", "carbon-19", ("platens.stop.displacement=12 um",), SLOW),
    Case("19 E-glass, hexagonal", "carbon-19", ("filament.material=E-glass", "assembly.arrangement=hexagonal",
         "platens.stop.displacement=12 um"), SLOW),
    Case("37 carbon", "carbon-37", ("platens.stop.displacement=14 um",), SLOW),
    Case("37 carbon, section", "carbon-37-section", ("platens.stop.displacement=12 um",),
         ("model.level=chain", "model.accuracy=0.0125")),
)  # fmt: skip


def finished(folder: Path, base: str, overrides: tuple[str, ...]) -> Path:
    """The run's folder, run now unless it is there."""
    if not (folder / "summary.json").exists():
        workflow.draw_all = lambda *arguments, **keywords: []  # type: ignore[assignment,misc]
        run_scene(base, RunOptions(folder, force=True), overrides)
    return folder


def true_error(run: Path, reference: Path) -> float:
    """Mean of |F/F_ref - 1| over displacements, from where both are quasi-static to where the shorter one ends."""
    curves = [read_results(folder / "results.h5").curve for folder in (run, reference)]
    starts = [json.loads((folder / "summary.json").read_text())["quasi_static_from_um"] for folder in (run, reference)]
    if None in starts:
        return float("nan")
    d = [c["displacement_um"][c.loading] for c in curves]
    at = np.linspace(max(starts), min(x.max() for x in d), 200)
    force, exact = (np.interp(at, x, c["force_top_N"][c.loading]) for x, c in zip(d, curves, strict=True))
    return float(np.mean(np.abs(force / exact - 1)))


def row(case: Case, out: Path) -> dict[str, object]:
    """One line of the table."""
    slug = case.name.replace(",", "").replace(" ", "-")
    run = finished(out / slug, case.base, (*LOADING, *case.overrides))
    reference = finished(out / f"{slug}-reference", case.base, (*LOADING, *case.overrides, *case.reference))
    _, plan = workflow.plan_scene(run / "scene.toml")
    s = json.loads((run / "summary.json").read_text())
    return {
        "scene": case.name,
        "level": plan.level,
        "beads": plan.n_beads,
        "promised": plan.promised_error,
        "true": true_error(run, reference),
        "predicted": plan.predicted_seconds,
        "measured": s["engine_cpu_s"],
        "reference_cpu": json.loads((reference / "summary.json").read_text())["engine_cpu_s"],
        "trusted": s["trusted"],
    }


def table(rows: list[dict[str, object]]) -> str:
    """The document."""
    kept = sum(r["true"] <= r["promised"] for r in rows)  # type: ignore[operator]
    ratios = [float(r["measured"]) / float(r["predicted"]) for r in rows]  # type: ignore[arg-type]
    timed = sum(1 / 1.5 <= ratio <= 1.5 for ratio in ratios)
    lines = [
        "# What the planner promised, and what came of it",
        "",
        "Written by `python analysis/planner_scenes.py`. Every scene was run as planned (loading alone, accuracy 0.05",
        "unless its plan says otherwise) and once more as a reference: four times slower, without symmetry, with",
        "real contacts, the smallest with segments of one diameter; sections against level chain. Error: mean of",
        "|F/F_ref - 1| from the quasi-static start to the stop. Time: processor seconds of the engine on one core.",
        "",
        f"True error below the promised one: {kept} of {len(rows)}. Time within a factor 1.5: {timed} of {len(rows)}.",
        "",
        "| scene | level | beads | promised | true error | predicted, s | measured, s | reference, s | trusted |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for r in rows:
        lines.append(
            f"| {r['scene']} | {r['level']} | {r['beads']} | {r['promised']:.1%} | {r['true']:.1%} "
            f"| {r['predicted']:.1f} | {r['measured']:.1f} | {r['reference_cpu']:.0f} "
            f"| {'yes' if r['trusted'] else 'no'} |"
        )
    return "\n".join(lines) + "\n"


def main() -> None:
    """Run what is missing and write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=ROOT / "results" / "planner")
    parser.add_argument("--only", default="", help="names of scenes, separated by semicolons; writes no table")
    arguments = parser.parse_args()
    chosen = [c for c in CASES if not arguments.only or c.name in arguments.only.split(";")]
    rows = []
    for case in chosen:
        rows.append(row(case, arguments.out))
        print({k: f"{v:.3g}" if isinstance(v, float) else v for k, v in rows[-1].items()}, flush=True)
    if not arguments.only:
        (ROOT / "docs" / "planner.md").write_text(table(rows))


if __name__ == "__main__":
    main()
