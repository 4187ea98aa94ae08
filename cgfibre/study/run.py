"""The verb ``study``: make the runs of every case, compare them, leave table, curves, summary and plots."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cgfibre import plot_study, store
from cgfibre.build.system import FloatArray
from cgfibre.errors import EngineError, InputError
from cgfibre.measure.ensemble import Difference, Ensemble, mean_of
from cgfibre.measure.friction_power import FrictionFit
from cgfibre.mechanics.compaction_laws import THESIS_DRY, THESIS_WET, FrictionPower
from cgfibre.scene import Bundle, Scene
from cgfibre.scene_reading import joined_overrides, read_toml
from cgfibre.study.file import LOADS, Cell, Study, cells, load_study, slug
from cgfibre.study.outcome import (
    CaseFound,
    Specimen,
    axis_of,
    branches_of,
    depth_of,
    differences,
    find_case,
    fit_of,
    load_of,
    plain_fit,
    reached,
)
from cgfibre.sweep import Progress, SweepOptions, SweepRun, run_all, start_overrides
from cgfibre.workflow import RUN_FILES, plan_scene

#: jitter over D that makes another specimen of another seed; 0.01 um of 7 um leaves the same one (measured)
JITTER = 0.3 / 7
#: and of the gap between filaments at most: none overlap as built
JITTER_GAP = 0.45
FRAMES = 12
OUTPUTS = ("study.toml", "table.csv", "curves.csv", "summary.json", "study.png", "values.png")
BESIDE = {"thesis-dry": THESIS_DRY, "thesis-wet": THESIS_WET}


@dataclass(frozen=True)
class StudyOptions:
    """How to run a study: folder, parallel runs, specimens a case (None: the file's), labels of the cases to run
    (empty: all but the optional ones), whether to begin anew."""

    out: Path
    jobs: int = 1
    starts: int | None = None
    only: tuple[str, ...] = ()
    force: bool = False


@dataclass(frozen=True)
class Found:
    """What a study found: its cases in order, differences from the first, the fit, seconds."""

    study: Study
    out: Path
    cases: tuple[CaseFound, ...]
    differences: Mapping[str, Mapping[str, Difference]]
    fit: FrictionFit | None
    wall: float

    @property
    def failed(self) -> list[tuple[str, str]]:
        """(case, reason) of every run that did not end."""
        return [(case.cell.label, reason) for case in self.cases for reason in case.failed]

    @property
    def trusted(self) -> bool:
        """No guard spoke."""
        return all(case.trusted for case in self.cases)


def run_study(
    source: str | Path, options: StudyOptions, overrides: Sequence[str] = (), progress: Progress | None = None
) -> Found:
    """Run a study (a file, a shipped name, or one scene as an ensemble) and leave what it found in its folder.

    Runs that ended are found again, those that were stopped go on. Raises InputError before anything is written,
    EngineError when no run of any case ended.
    """
    begin = time.perf_counter()
    cores = os.cpu_count() or 1
    if not 1 <= options.jobs <= cores:
        raise InputError("--jobs", options.jobs, f"1 to {cores}, the cores of this machine")
    if options.starts is not None and not 1 <= options.starts <= 1000:
        raise InputError("--starts", options.starts, "1 to 1000")
    study = load_study(source, overrides, options.starts)
    chosen = _chosen(cells(study), options.only)
    work = {cell.slug: lay_out(cell, study, options.out) for cell in chosen}
    _claim(options, study)
    runs = [run for found in work.values() for run in found]
    failed = run_all(runs, SweepOptions(options.jobs, resume=True, trim=True), progress)
    cases = []
    for cell in chosen:
        mine = work[cell.slug]
        specimens = [_specimen(run, study) for run in mine if run.folder not in failed]
        cases.append(find_case(cell, specimens, [failed[r.folder] for r in mine if r.folder in failed], study.compare))
    if not any(case.specimens for case in cases):
        raise EngineError(f"no run ended: {next(iter(failed.values()))}", "look at the folders in runs/")
    full = [case for case in cases if case.specimens]
    found = Found(study, options.out, tuple(cases), differences(full), fit_of(study, full), time.perf_counter() - begin)
    write_study(found)
    return found


def _chosen(all_cells: Sequence[Cell], only: Sequence[str]) -> list[Cell]:
    """The cases named, or all but the optional ones."""
    for name in only:
        if slug(name) not in {cell.slug for cell in all_cells}:
            raise InputError("--only", name, "one of " + ", ".join(cell.slug for cell in all_cells))
    wanted = {slug(name) for name in only}
    return [cell for cell in all_cells if (cell.slug in wanted if only else not cell.optional)]


def specimen_jitter(scene: Scene, asked: float | str) -> float:
    """Jitter of a specimen, um: as asked; else 0.3/7 D, or what the gap between filaments leaves. 0 (as the scene has
    it) for random packing, whose seed is another packing already, and for what is no bundle."""
    bundle, d = scene.assembly, scene.filament.diameter
    if asked != "auto":
        return float(asked)
    if not isinstance(bundle, Bundle) or bundle.arrangement == "random":
        return 0.0
    pitch = bundle.pitch or d
    if bundle.void_fraction is not None:
        pitch = d * np.sqrt(np.pi / (2 * np.sqrt(3)) / (1 - bundle.void_fraction))
    return float(min(JITTER * d, max(JITTER_GAP * (pitch - d), 0.01 * d)))


def lay_out(cell: Cell, study: Study, out: Path) -> list[SweepRun]:
    """The runs of a case, planned; InputError names what is wrong with it."""
    asked = joined_overrides([f"output.frames={FRAMES}"], cell.overrides)
    try:
        scene, _ = plan_scene(cell.scene, asked)
        given = any(text.startswith("assembly.jitter") for text in cell.overrides)
        jitter = 0.0 if given else specimen_jitter(scene, study.jitter)
        if scene.is_weave and scene.model.resolve != "filament" and cell.starts > 1:
            raise InputError("starts", cell.starts, "1: tows have no seed, every specimen of this weave is the same")
        if study.compare.kind == "line_force" and scene.is_weave:
            expected = "pressures or forces: this assembly has no length along its filaments"
            raise InputError("compare.loads", list(study.compare.loads), expected)
        runs = []
        for start in range(cell.starts):
            own = start_overrides(scene, start, jitter)
            folder = out / "runs" / cell.slug / f"seed-{scene.assembly.seed + start}"
            runs.append(SweepRun.planned(folder, cell.scene, joined_overrides(asked, own)))
        return runs
    except InputError as error:
        raise InputError(f"case {cell.label!r}: {error.key}", error.value, error.expected) from None


def _claim(options: StudyOptions, study: Study) -> None:
    """Make the folder ready: the same study goes on, anything else is refused or, by force, removed."""
    out = options.out
    store.check_folder(out, [n for n in RUN_FILES if n not in ("summary.json",)], False)
    text = out / "study.toml"
    if options.force:
        shutil.rmtree(out / "runs", ignore_errors=True)
        for name in OUTPUTS:
            (out / name).unlink(missing_ok=True)
    elif text.exists() and (begun := read_toml(text.read_text(), "--out", str(text)).get("name")) != study.name:
        raise InputError(
            "--out", str(out), f"an empty folder or one of this study; it holds {begun}; --force empties it"
        )
    elif not text.exists() and (out / "summary.json").exists():
        raise InputError("--out", str(out), "an empty or new folder (it holds other results)")
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError("--out", str(out), f"a folder that can be written ({error.strerror})") from error
    text.write_text(study.to_toml())


def _specimen(run: SweepRun, study: Study) -> Specimen:
    """A finished run as the study sees it."""
    results = store.read_results(run.folder / "results.h5")
    load = load_of(results.curve, study.compare.kind, depth_of(run.scene, run.plan))
    summary = results.summary
    return Specimen(
        run.scene.assembly.seed,
        branches_of(results.curve, load),
        float(results.curve["thickness_um"][0]),
        tuple(g["name"] for g in summary["guards"] if not g["ok"]),
        float(summary["engine_cpu_s"] or 0.0),
    )


# --- what it leaves ---------------------------------------------------------------------------------------------------


def table_of(found: Found) -> dict[str, tuple[list[Any], str]]:
    """Columns of the table, one row a case: name -> (values, unit). ``_ci95`` is the half width of the interval of the
    mean, ``_sd`` the scatter, ``_n`` how many specimens got there; both are empty for one sample."""
    cases = found.cases
    columns: dict[str, tuple[list[Any], str]] = {
        "case": ([c.cell.label for c in cases], "text"),
        **{v.key: ([c.cell.values[v.key] for c in cases], "text") for v in found.study.vary},
        "starts": ([len(c.specimens) for c in cases], "1"),
        "samples": (["one sample" if len(c.specimens) == 1 else "mean" for c in cases], "text"),
        "failed": ([len(c.failed) for c in cases], "1"),
        "trusted": ([int(c.trusted) for c in cases], "1"),
        "guards": (["; ".join(c.guards()) for c in cases], "text"),
        "cpu_s": ([sum(s.cpu for s in c.specimens) for c in cases], "s"),
        "initial_thickness_um": ([c.initial for c in cases], "um"),
    }
    for name in dict.fromkeys(n for c in cases for n in c.metrics):
        metrics = [c.metrics.get(name) for c in cases]
        known = [reached(m.values) if m else [] for m in metrics]
        unit = next(m.unit for m in metrics if m)
        for k, suffix in enumerate(("", "_ci95", "_sd")):
            columns[name + suffix] = ([mean_of(values)[k] for values in known], unit)
        columns[name + "_n"] = ([len(values) for values in known], "1")
    return columns


def _curve_rows(found: Found) -> list[tuple[Any, ...]]:
    unit = LOADS[found.study.compare.kind][1]

    def rows(case: CaseFound, branch: str, what: tuple[str, str], e: Ensemble) -> list[tuple[Any, ...]]:
        columns = zip(e.x.tolist(), e.mean.tolist(), e.ci.tolist(), e.sd.tolist(), strict=True)
        return [(case.cell.label, branch, e.n, *what, x, mean, ci, sd) for x, mean, ci, sd in columns]

    found_rows: list[tuple[Any, ...]] = []
    for case in found.cases:
        for branch, e in case.thickness.items():
            found_rows += rows(case, branch, (f"load_{unit}", "thickness_um"), e)
        for branch, e in case.load.items():
            found_rows += rows(case, branch, ("displacement_um", f"load_{unit}"), e)
    return found_rows


def _summary(found: Found) -> dict[str, Any]:
    study = found.study
    cases = []
    for case in found.cases:
        numbers = {}
        for name, m in case.metrics.items():
            mean, ci, sd = mean_of(reached(m.values))
            numbers[name] = {"unit": m.unit, "mean": mean, "ci95": ci, "sd": sd, "samples": m.values}
        cases.append(
            {
                "case": case.cell.label,
                "values": case.cell.values,
                "starts": len(case.specimens),
                "one_sample": len(case.specimens) == 1,
                "seeds": [s.seed for s in case.specimens],
                "failed": case.failed,
                "trusted": case.trusted,
                "guards": case.guards(),
                "cpu_s": sum(s.cpu for s in case.specimens),
                "initial_thickness_um": case.initial,
                "numbers": numbers,
            }
        )
    return {
        "study": study.name,
        "title": study.title,
        "statement": study.statement,
        "finding": study.finding,
        "load": LOADS[study.compare.kind][1],
        "trusted": found.trusted,
        "cases": cases,
        "differences_from_first": {
            case: {
                name: {"value": d.value, "ci95": d.ci, "significant": d.significant if np.isfinite(d.ci) else None}
                for name, d in by_name.items()
            }
            for case, by_name in found.differences.items()
        },
        "fit": plain_fit(found.fit) if found.fit else None,
        "cpu_s": sum(s.cpu for c in found.cases for s in c.specimens),
        "wall_s": found.wall,
    }


def write_study(found: Found) -> None:
    """table.csv, curves.csv, summary.json, study.png and, where one number varies, values.png."""
    out = found.out
    store.write_table(out / "table.csv", table_of(found))
    header = ("case", "branch", "samples", "x_is", "y_is", "x", "mean", "ci95", "sd")
    store.write_rows(out / "curves.csv", header, _curve_rows(found))
    store.write_json(out / "summary.json", _summary(found))
    plot_study.figure_study(_lines(found), _view(found)).savefig(out / "study.png")
    values = _values(found)
    if values is not None:
        plot_study.figure_values(*values).savefig(out / "values.png")


def _view(found: Found) -> plot_study.StudyView:
    study = found.study
    return plot_study.StudyView(
        title=study.title or study.name,
        x=study.plot.x,
        kind=study.compare.kind,
        unit=LOADS[study.compare.kind][1],
        normalised=study.plot.normalised,
        log=study.plot.log,
        ordered=axis_of(study, found.cases) is not None,
    )


def _lines(found: Found) -> list[plot_study.Line]:
    """Every case's branches as the plot shows them."""
    by_load, scaled = found.study.plot.x == "thickness", found.study.plot.normalised
    lines = []
    for case in found.cases:
        unit = case.initial if scaled else 1.0
        for branch, e in (case.thickness if by_load else case.load).items():
            if branch.startswith("unloading") and not found.study.plot.unloading:
                continue
            x = e.x if by_load else e.x / unit
            of = unit if by_load else 1.0
            lines.append(plot_study.Line(case.label, branch, x, e.mean / of, _band(e.n, e.ci, e.sd) / of, e.n))
    return lines


def _band(n: int, ci: FloatArray, sd: FloatArray) -> FloatArray:
    """Half of what is drawn about a mean: of two samples their range, for Student's interval is nine times that and
    would hide the curves."""
    return ci if n > 2 else sd / np.sqrt(2)


def _values(found: Found) -> tuple[list[plot_study.Points], str, str] | None:
    """Thickness at each load against the number that varies, with the fit and the thesis' beside it."""
    study, full = found.study, [c for c in found.cases if c.specimens]
    axis = axis_of(study, full)
    if axis is None or len(full) < 2:
        return None
    label, x = axis
    unit = LOADS[study.compare.kind][1]
    beside = BESIDE.get(study.fit.beside) if study.fit else None
    series = []
    for load in study.compare.values:
        name = f"thickness_um_at_{load:.4g}_{unit.replace('/', '_per_')}"
        found_here = [mean_of(reached(c.metrics[name].values)) if name in c.metrics else (np.nan,) * 3 for c in full]
        mean, ci, sd = (np.array(column) for column in zip(*found_here, strict=True))
        samples = max(len(c.specimens) for c in full)

        def line(law: FrictionPower | None, load: float = load) -> np.ndarray | None:
            return None if law is None else 1e3 * law.thickness(load, np.array(x))

        fitted = line(found.fit.law) if found.fit else None
        series.append(
            plot_study.Points(
                f"{load:.3g} {unit}", np.array(x), mean, _band(samples, ci, sd), samples, fitted, line(beside)
            )
        )
    return series, label, study.title or study.name


def default_out(source: str | Path) -> Path:
    """results/study-<name>, where ``study`` writes when no folder is given."""
    return Path("results") / f"study-{Path(str(source)).stem}"


def report_lines(found: Found) -> list[str]:
    """What the command line says after the table."""
    lines = [f"failed   {label}: {reason.splitlines()[0]}" for label, reason in found.failed]
    for case in found.cases:
        lines += [f"WARNING  {case.cell.label}: {guard}" for guard in case.guards()]
    if found.fit:
        f = found.fit
        interval = {k: "" if np.isnan(v) else f" +- {v:.2g}" for k, v in (("c", f.c_ci), ("a", f.a_ci), ("b", f.b_ci))}
        lines.append(
            f"t = c P^(a mu - b): c = {f.law.c:.3g}{interval['c']} mm, a = {f.law.a:.3g}{interval['a']}, "
            f"b = {f.law.b:.3g}{interval['b']}; ln t within {f.misfit:.2g} (P in N/mm)"
        )
    for key, text in (("thesis", found.study.statement), ("found", found.study.finding)):
        if text:
            lines.append(f"{key:8s} {' '.join(text.split())}")
    lines.append(f"picture  {found.out / 'study.png'}")
    lines.append(f"table    {found.out / 'table.csv'}")
    return lines


__all__ = ["Found", "Progress", "StudyOptions", "default_out", "report_lines", "run_study"]
