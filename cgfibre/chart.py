"""Accuracy against speed: a scene at every level and spacing it allows, measured against the finest of them.

Every variant presses the same specimens, loading alone, at the platen speed that its accuracy asks for; the reference
is the finest. A start is a specimen: another seed of the jitter (or of the packing). Errors are those of one specimen
against the reference of the same one. Where the reference did not run for a start, the finest variant that did carries
it over: F_ref,k = F_ref,1 F_fin,k / F_fin,1, so that the scatter between specimens is not taken for an error (the
errors of that variant are then those of the first start).
"""

from __future__ import annotations

import json
import math
import os
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from cgfibre import plot_chart, store
from cgfibre.build.system import FloatArray
from cgfibre.errors import EngineError, InputError
from cgfibre.measure.compaction import thickness_at_pressure
from cgfibre.plan.filaments import SEGMENT, contact_shape
from cgfibre.plan.make import other_shape
from cgfibre.plan.model import Plan
from cgfibre.plan.motion import REFERENCE_DISPLACEMENT
from cgfibre.record import Curve
from cgfibre.review import speed_change
from cgfibre.scene import Scene
from cgfibre.scene_reading import load_scene
from cgfibre.sweep import Progress, SweepOptions, SweepRun, run_all, start_overrides
from cgfibre.workflow import RUN_FILES, plan_scene

#: parts of the reference's peak force at whose displacements forces are compared
FORCE_SHARES = (0.1, 0.4, 1.0)
#: accuracies of the ladder of chains at their usual spacing (capsules 4 D, beads D), and of every other step of it
ACCURACIES = (0.2, 0.1, 0.05, 0.025)
ACCURACY = 0.05
REFERENCE_ACCURACY = 0.0125  # finer than the ladder: at the same speed its error would not show
#: jitter over D of specimens whose scene has none
JITTER = 1 / 700
#: of the reference's predicted time, and seconds: variants that cost more than both have as few starts as it has
COSTLY, CHEAP = 0.25, 20.0
UNBOUNDED = 10**9
PLANNER = "planner"
COMPARED = "compared"  # in place of the level of what was made elsewhere
#: keys of the other level that a variant sets back to their defaults
_ALONG = (
    "model.spacing=auto",
    "model.axial_softening=auto",
    "model.torsion=none",
    "model.symmetry=auto",
    "contact.shape=auto",
)
_ACROSS = ("model.depth=auto", "model.spring=auto", "model.torsional_spring=exact")
#: what every run of a chart leaves out
LOADING_ALONE = ("platens.cycles=[]", "platens.unload=false", "platens.hold=0 us", "model.speed_check=false")


@dataclass(frozen=True)
class Variant:
    """A way to model the scene: ``spacing`` is s/D (0 for a section), ``shape`` how filaments touch ("capsule" or
    "beads", "" for a section), ``overrides`` make it of the scene."""

    name: str
    level: str
    shape: str
    spacing: float
    accuracy: float
    overrides: tuple[str, ...]


@dataclass(frozen=True)
class ChartOptions:
    """How to chart: folder, starts (specimens) a variant, and for the reference and what costs more than a quarter of
    it, the reference's accuracy, parallel runs, the names of the variants to run (empty: all), results made elsewhere
    to draw beside them ([LABEL=]PATH), the error aimed at."""

    out: Path
    seeds: int = 3
    reference_seeds: int = 1
    reference_accuracy: float = REFERENCE_ACCURACY
    jobs: int = 1
    force: bool = False
    only: tuple[str, ...] = ()
    compare: tuple[str, ...] = ()
    goal: float = 0.05


@dataclass(frozen=True)
class Row:
    """One variant of the chart: means over its starts, and their lowest and highest.

    ``shape`` how its filaments touch: "capsule", "beads" or "" (a section, or made elsewhere); ``cpu`` processor
    seconds of the engine; ``error`` the mean of abs(F/F_ref - 1) beyond the first 2/7 D; ``force_errors`` (3,) signed,
    at the chart's displacements; ``thickness_errors`` (3,) um, at its forces (nan: not reached).
    """

    name: str
    level: str
    shape: str
    spacing: float
    accuracy: float
    starts: int
    beads: int
    steps: int
    cpu: float
    cpu_range: tuple[float, float]
    error: float
    error_range: tuple[float, float]
    force_errors: tuple[float, ...]
    thickness_errors: tuple[float, ...]
    trusted: bool
    planner: bool = False
    reference: bool = False
    front: bool = False


@dataclass(frozen=True)
class Chart:
    """What a chart found: its rows, where forces and thickness were compared, and what was left out and why."""

    scene: str
    out: Path
    rows: tuple[Row, ...]
    start: float
    displacements: tuple[float, ...]
    forces: tuple[float, ...]
    left_out: tuple[tuple[str, str], ...]
    goal: float

    @property
    def planner(self) -> Row | None:
        """The scene as it stands; None where its run failed."""
        return next((r for r in self.rows if r.planner), None)

    @property
    def cheapest(self) -> Row | None:
        """The cheapest trusted variant within the error aimed at."""
        ours = [r for r in self.rows if r.level != COMPARED and not r.reference and r.trusted]
        within = [r for r in ours if r.error <= self.goal]
        return min(within, key=lambda r: r.cpu, default=None)


# --- the ladder -------------------------------------------------------------------------------------------------------


def variant(level: str, spacing: float, accuracy: float, diameter: float, shape: str = "capsule") -> Variant:
    """A step of the ladder: ``spacing`` s/D and ``shape`` (both ignored for a section); as fast as its accuracy allows
    and no faster."""
    common = (
        f"model.level={level}",
        f"model.accuracy={accuracy!r}",
        f"model.most_steps={UNBOUNDED}",
        "model.timestep=auto",
        "platens.speed=auto",
    )
    if level == "section":
        return Variant(f"section-{accuracy:g}", level, "", 0.0, accuracy, (*common, *_ALONG))
    along = [f"contact.shape={shape}", f"model.spacing={spacing * diameter!r} um", *_ACROSS]
    if level == "rod":
        along.append("model.torsion=none")
    where = f"{spacing:g}D" if spacing >= 1 else f"D{1 / spacing:g}"
    beads = "beads-" if shape == "beads" else ""
    name = f"{level}-{beads}{where.removeprefix('1')}-{accuracy:g}"
    return Variant(name, level, shape, spacing, accuracy, (*common, *along))


def ladder(scene: Scene, reference_accuracy: float = REFERENCE_ACCURACY) -> tuple[list[Variant], Variant]:
    """(variants, the reference) of a scene: rods are the finest of filaments that twist or migrate, else chains.

    Where filaments touch as capsules, beads stand beside them. The reference, capsules at s = D or else beads at
    s = D/2, is of the whole assembly (no symmetry) and, by default, at half the platen speed of the ladder's finest.
    """
    d = scene.filament.diameter
    finest = "chain" if scene.bundle.straight else "rod"
    steps = [variant("section", 0.0, ACCURACY, d)]
    if contact_shape(scene).value == "capsule":
        steps += [variant("chain", SEGMENT, a, d) for a in ACCURACIES]
        steps += [variant("chain", s, ACCURACY, d) for s in (8.0, 2.0, 1.0)]
        steps.append(variant("rod", SEGMENT, ACCURACY, d))
        steps += [variant("chain", s, ACCURACY, d, "beads") for s in (1.0, 0.5)]
        reference = variant(finest, 1.0, reference_accuracy, d)
    else:
        steps += [variant("chain", 1.0, a, d, "beads") for a in ACCURACIES]
        steps.append(variant("chain", 0.5, ACCURACY, d, "beads"))
        if scene.bundle.count == 1:  # no neighbours for coarse beads to miss
            steps += [variant("chain", s, ACCURACY, d, "beads") for s in (2.0, 4.0)]
        steps.append(variant("rod", 1.0, ACCURACY, d, "beads"))
        reference = variant(finest, 0.5, reference_accuracy, d, "beads")
    reference = replace(reference, overrides=(*reference.overrides, "model.symmetry=none"))
    return [v for v in steps if v.name != reference.name], reference


# --- the runs ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Run(SweepRun):
    """One run to make or to find: of which variant, and which start."""

    variant: Variant
    start: int


def _start_overrides(scene: Scene, start: int) -> tuple[str, ...]:
    """Another seed, and a jitter where the scene has none."""
    return start_overrides(scene, start, JITTER * scene.filament.diameter if scene.bundle.jitter == 0 else 0.0)


def _same_model(a: Plan, b: Plan) -> bool:
    """Whether two plans compute the same, whatever reasons they give."""

    def numbers(plan: Plan) -> str:
        values = asdict(plan)
        for key in ("choices", "omissions", "promise", "predicted_seconds"):
            values.pop(key)
        return json.dumps(store.plain(values))

    return numbers(a) == numbers(b)


@dataclass(frozen=True)
class _Work:
    """All runs of a chart by variant, the variants in order, which one is the reference and which the planner's."""

    runs: Mapping[str, Sequence[_Run]]
    reference: str
    planner: str
    left_out: tuple[tuple[str, str], ...]

    def __iter__(self) -> Iterator[_Run]:
        return (run for runs in self.runs.values() for run in runs)


def _lay_out(source: str | Path, overrides: Sequence[str], options: ChartOptions) -> _Work:
    """Plan every run of the chart; InputError where the scene itself or its reference cannot be run."""
    scene, asked = plan_scene(source, overrides)
    steps, reference = ladder(scene, options.reference_accuracy)
    refused = other_shape(scene, asked.level, reference.level)
    if refused is not None:
        raise refused
    if options.only:
        known = [v.name for v in steps]
        for name in options.only:
            if name not in known:
                raise InputError("--only", name, "one of " + ", ".join(known))
        steps = [v for v in steps if v.name in options.only]

    def plan_run(v: Variant, start: int) -> _Run:
        whole = (*overrides, *LOADING_ALONE, *_start_overrides(scene, start), *v.overrides)
        folder = options.out / "runs" / f"{v.name}-{start + 1}"
        return _Run(folder, source, whole, *plan_scene(source, whole), v, start)

    references = [plan_run(reference, k) for k in range(options.reference_seeds)]
    costly = max(COSTLY * references[0].plan.predicted_seconds, CHEAP)

    def plan_runs(v: Variant) -> list[_Run]:
        first = plan_run(v, 0)
        more = options.seeds if first.plan.predicted_seconds < costly else options.reference_seeds
        return [first, *(plan_run(v, k) for k in range(1, more))]

    runs, left_out = {}, []
    for v in steps:
        try:
            refused = other_shape(scene, asked.level, v.level)
            if refused is not None:
                raise refused
            runs[v.name] = plan_runs(v)
        except InputError as error:
            left_out.append((v.name, str(error)))
    runs[reference.name] = references
    own = Variant(PLANNER, "", "", 0.0, scene.model.accuracy, ())
    mine = plan_run(own, 0)
    same = [name for name, found in runs.items() if _same_model(found[0].plan, mine.plan)]
    if same:
        return _Work(runs, reference.name, same[0], tuple(left_out))
    spacing = mine.plan.spacing / scene.filament.diameter
    shape = "" if mine.plan.level == "section" else contact_shape(mine.scene).value
    own = replace(own, level=mine.plan.level, shape=shape, spacing=spacing)
    runs[PLANNER] = plan_runs(own)
    return _Work(runs, reference.name, PLANNER, tuple(left_out))


# --- errors -----------------------------------------------------------------------------------------------------------


def loading_of(curve: Curve) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(displacement um, thickness um, force N) of loading."""
    going = curve.loading
    return curve["displacement_um"][going], curve["thickness_um"][going], curve["force_top_N"][going]


@dataclass(frozen=True)
class Yardstick:
    """The reference's curve and where others are compared with it: from ``start`` um on, at ``displacements`` um, and
    at the ``forces`` N that it has there."""

    curve: Curve
    start: float
    displacements: tuple[float, ...]
    forces: tuple[float, ...]

    @classmethod
    def of(cls, curve: Curve, diameter: float) -> Yardstick:
        """Where the reference first reaches 10 and 40 % of its peak force and the peak itself; from 2/7 D on."""
        d, thickness, force = loading_of(curve)
        peak = float(np.max(force))
        if peak <= 0:
            raise InputError("scene", "its reference", "one that meets a force: press further")
        at = np.array(FORCE_SHARES) * peak
        found = thickness[0] - thickness_at_pressure(thickness, force, at)
        start = min(REFERENCE_DISPLACEMENT * diameter, float(d[-1]) / 2)
        return cls(curve, start, tuple(found.tolist()), tuple(at.tolist()))

    def for_start(self, finest: Curve, first: Curve) -> Yardstick:
        """That of another specimen, whose finest variant gave ``finest`` where the first one's gave ``first``."""
        d = self.curve["displacement_um"]
        theirs, ours = (np.interp(d, *loading_of(c)[::2]) for c in (finest, first))
        share = np.divide(theirs, ours, out=np.ones_like(d), where=ours > 0)
        columns = {**self.curve.columns, "force_top_N": self.curve["force_top_N"] * share}
        return replace(self, curve=replace(self.curve, columns=columns))

    def errors(self, curve: Curve) -> tuple[float, tuple[float, ...], tuple[float, ...]]:
        """(mean abs(F/F_ref - 1), signed F/F_ref - 1 at the displacements, thickness - that of the reference um)."""
        mean = speed_change(curve, self.curve, self.start)["mean"]
        d, thickness, force = loading_of(curve)
        rd, rthickness, rforce = loading_of(self.curve)
        at = np.array(self.displacements)
        here = np.where(at <= d[-1] * 1.01, np.interp(at, d, force), np.nan)
        off = thickness_at_pressure(thickness, force, self.forces) - thickness_at_pressure(
            rthickness, rforce, self.forces
        )
        return mean, tuple((here / np.interp(at, rd, rforce) - 1).tolist()), tuple(off.tolist())


def pareto_front(cost: FloatArray, error: FloatArray) -> np.ndarray:
    """(n,) bool: points that no other point betters in both cost and error. Non-finite points are never on it."""
    c, e = np.asarray(cost, dtype=float), np.asarray(error, dtype=float)
    known = np.isfinite(c) & np.isfinite(e)
    better = (c[:, None] <= c) & (e[:, None] <= e) & ((c[:, None] < c) | (e[:, None] < e)) & known[:, None]
    return known & ~better.any(axis=0)


def _mean(values: Sequence[Sequence[float]]) -> tuple[float, ...]:
    return tuple(np.mean(np.array(values, dtype=float), axis=0).tolist())


def _range(values: Sequence[float]) -> tuple[float, float]:
    return (min(values), max(values))


def _row(runs: Sequence[_Run], yardsticks: Mapping[int, Yardstick], reference: bool) -> Row:
    summaries = [json.loads((run.folder / "summary.json").read_text()) for run in runs]
    cpu = [float(s["engine_cpu_s"]) for s in summaries]
    found = [
        yardsticks[run.start].errors(store.read_results(run.folder / "results.h5").curve)
        for run in runs
        if run.start in yardsticks
    ]
    v, errors = runs[0].variant, [mean for mean, _, _ in found]
    nothing = (math.nan,) * len(FORCE_SHARES)
    return Row(
        v.name,
        v.level,
        v.shape,
        v.spacing,
        v.accuracy,
        len(runs),
        summaries[0]["n_beads"],
        summaries[0]["n_steps"],
        float(np.mean(cpu)),
        _range(cpu),
        math.nan if reference else float(np.mean(errors)),
        (math.nan, math.nan) if reference else _range(errors),
        nothing if reference else _mean([f for _, f, _ in found]),
        nothing if reference else _mean([t for _, _, t in found]),
        all(s["trusted"] for s in summaries),
        reference=reference,
    )


def _yardsticks(work: _Work, curves: Callable[[_Run], Curve]) -> dict[int, Yardstick]:
    """One a start: of the reference, or of the first one carried over by the finest variant with all starts."""
    references = work.runs[work.reference]
    diameter = references[0].scene.filament.diameter
    own = {run.start: Yardstick.of(curves(run), diameter) for run in references}
    like = references[0].variant
    finest = [
        r
        for name, r in work.runs.items()
        if (r[0].variant.level, r[0].variant.shape) == (like.level, like.shape)
        and name != work.reference
        and len(r) > 1
    ]
    if finest:
        first, *others = min(finest, key=lambda r: (r[0].variant.accuracy, r[0].variant.spacing))
        for run in others:
            if run.start not in own:
                own[run.start] = own[0].for_start(curves(run), curves(first))
    return own


@dataclass(frozen=True)
class Elsewhere:
    """What was made elsewhere: a run's ``curve`` with the seconds that all of it took, or points (label, s, error)."""

    label: str
    curve: Curve | None = None
    seconds: float = 0.0
    beads: int = 0
    points: tuple[tuple[str, float, float], ...] = ()

    @classmethod
    def read(cls, text: str) -> Elsewhere:
        """``[LABEL=]PATH``: a run's folder (curve.csv, summary.json) or a CSV with label,cpu_s,error; InputError."""
        label, _, where = ("", "", text) if Path(text).exists() else text.rpartition("=")
        path = Path(where)
        try:
            if not path.is_dir():
                return cls(label or path.stem, points=tuple(store.read_points(path)))
            summary = json.loads((path / "summary.json").read_text())
            spent = float(summary.get("engine_cpu_s") or summary["engine_s"])
            return cls(label or path.name, store.read_curve(path / "curve.csv"), spent, int(summary["n_beads"]))
        except (OSError, ValueError, KeyError, TypeError) as error:
            expected = f"[LABEL=]PATH of a run's folder or of a CSV with label,cpu_s,error ({error})"
            raise InputError("--compare", text, expected) from None

    def rows(self, yardstick: Yardstick) -> list[Row]:
        """Its points. Of a run that went on, further or back, the time counts to the reference's end, by its steps."""
        nothing = (math.nan,) * len(FORCE_SHARES)
        if self.curve is None:
            return [_compared(label, cpu, error, nothing, nothing, 0, 0) for label, cpu, error in self.points]
        d = loading_of(self.curve)[0]
        end = min(float(loading_of(yardstick.curve)[0][-1]), float(d[-1]))
        steps = float(np.interp(end, d, self.curve["step"][self.curve.loading]))
        cpu = self.seconds * steps / float(self.curve["step"][-1])
        return [_compared(self.label, cpu, *yardstick.errors(self.curve), self.beads, int(steps))]


def _compared(
    name: str, cpu: float, error: float, forces: tuple[float, ...], thickness: tuple[float, ...], beads: int, steps: int
) -> Row:
    return Row(
        name,
        COMPARED,
        "",
        math.nan,
        math.nan,
        1,
        beads,
        steps,
        cpu,
        (cpu, cpu),
        error,
        (error, error),
        forces,
        thickness,
        True,
    )


# --- all of it --------------------------------------------------------------------------------------------------------


def chart_scene(
    source: str | Path,
    options: ChartOptions,
    overrides: Sequence[str] = (),
    progress: Progress | None = None,
) -> Chart:
    """Run the ladder of a scene, measure cost and error of each variant, write table and picture.

    A chart that was stopped goes on: runs that ended are found again, others begin anew. Raises InputError before
    anything is written, EngineError when the reference cannot be had.
    """
    cores = os.cpu_count() or 1
    if not 1 <= options.jobs <= cores:
        raise InputError("--jobs", options.jobs, f"1 to {cores}, the cores of this machine")
    for key, value in (("--seeds", options.seeds), ("--reference-seeds", options.reference_seeds)):
        if not 1 <= value <= 100:
            raise InputError(key, value, "1 to 100")
    scene, _ = plan_scene(source, overrides)
    elsewhere = [Elsewhere.read(text) for text in options.compare]
    work = _lay_out(source, overrides, options)
    _claim(options, scene)
    reasons = run_all(list(work), SweepOptions(options.jobs), progress)
    failed = {folder.name: reason for folder, reason in reasons.items()}
    if any(run.name in failed for run in work.runs[work.reference]):
        raise EngineError(
            f"the reference {work.reference} did not run: {next(failed[r.name] for r in work.runs[work.reference])}",
            "look at its folder in runs/",
        )
    left_out = [*work.left_out, *((name, f"the engine stopped: {reason}") for name, reason in failed.items())]
    ended = {
        name: [r for r in runs if r.name not in failed]
        for name, runs in work.runs.items()
        if runs[0].name not in failed
    }
    found = _measured(replace(work, runs=ended, left_out=tuple(left_out)), scene, options, elsewhere)
    write_chart(found)
    return found


def _measured(work: _Work, scene: Scene, options: ChartOptions, elsewhere: Sequence[Elsewhere]) -> Chart:
    """The chart of runs that ended."""
    yardsticks = _yardsticks(work, lambda run: store.read_results(run.folder / "results.h5").curve)
    rows = [_row(runs, yardsticks, name == work.reference) for name, runs in work.runs.items()]
    for other in elsewhere:
        rows += other.rows(yardsticks[0])
    ours = np.array([not r.reference and r.level != COMPARED for r in rows])
    front = pareto_front(np.array([r.cpu for r in rows]), np.where(ours, [r.error for r in rows], np.nan))
    rows = [replace(r, front=bool(f), planner=r.name == work.planner) for r, f in zip(rows, front, strict=True)]
    first = yardsticks[0]
    return Chart(
        scene.name or "scene",
        options.out,
        tuple(rows),
        first.start,
        first.displacements,
        first.forces,
        work.left_out,
        options.goal,
    )


def _claim(options: ChartOptions, scene: Scene) -> None:
    """Make the folder ready: a chart of the same scene goes on, anything else is refused or, by force, removed."""
    out = options.out
    if out.exists() and not out.is_dir():
        raise InputError("--out", str(out), "a folder, not a file")
    if any((out / name).exists() for name in RUN_FILES if name != "scene.toml"):
        raise InputError("--out", str(out), "a folder for a chart (it holds a run)")
    text = out / "scene.toml"
    if options.force:
        shutil.rmtree(out / "runs", ignore_errors=True)
        for name in ("scene.toml", "chart.csv", "chart.h5", "chart.json", "chart.png"):
            (out / name).unlink(missing_ok=True)
    elif text.exists() and load_scene(text) != scene:
        raise InputError("--out", str(out), "an empty folder or a chart of the same scene; --force begins anew")
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError("--out", str(out), f"a folder that can be written ({error.strerror})") from error
    text.write_text(scene.to_toml())


def table_of(chart: Chart) -> dict[str, tuple[list[Any], str]]:
    """Columns of the chart's table: name -> (values, unit)."""
    rows = chart.rows
    columns: dict[str, tuple[list[Any], str]] = {
        "variant": ([r.name for r in rows], "text"),
        "level": ([r.level for r in rows], "text"),
        "contact": ([r.shape for r in rows], "text"),
        "spacing": ([r.spacing for r in rows], "D"),
        "accuracy": ([r.accuracy for r in rows], "1"),
        "starts": ([r.starts for r in rows], "1"),
        "beads": ([r.beads for r in rows], "1"),
        "steps": ([r.steps for r in rows], "1"),
        "cpu_s": ([r.cpu for r in rows], "s"),
        "cpu_low_s": ([r.cpu_range[0] for r in rows], "s"),
        "cpu_high_s": ([r.cpu_range[1] for r in rows], "s"),
        "error": ([r.error for r in rows], "1"),
        "error_low": ([r.error_range[0] for r in rows], "1"),
        "error_high": ([r.error_range[1] for r in rows], "1"),
    }
    for k, d in enumerate(chart.displacements):
        columns[f"force_error_at_{d:.3g}_um"] = ([r.force_errors[k] for r in rows], "1")
    for k, force in enumerate(chart.forces):
        columns[f"thickness_error_at_{1e3 * force:.3g}_mN_um"] = ([r.thickness_errors[k] for r in rows], "um")
    for flag in ("trusted", "front", "planner", "reference"):
        columns[flag] = ([int(getattr(r, flag)) for r in rows], "1")
    return columns


def points_of(chart: Chart) -> list[plot_chart.ChartPoint]:
    """What the picture shows of each variant but the reference."""
    return [
        plot_chart.ChartPoint(
            r.name,
            f"{r.level}, {r.shape}" if r.shape else r.level,
            r.cpu,
            r.error,
            r.cpu_range,
            r.error_range,
            r.front,
            r.planner,
            r.trusted,
        )
        for r in chart.rows
        if not r.reference
    ]


def write_chart(chart: Chart) -> None:
    """chart.csv, chart.h5, chart.json and chart.png in the chart's folder."""
    table = table_of(chart)
    store.write_table(chart.out / "chart.csv", table)
    store.write_tables(chart.out / "chart.h5", [store.Table("chart", {}, table)])
    facts = {
        "scene": chart.scene,
        "from_um": chart.start,
        "displacement_um": chart.displacements,
        "force_N": chart.forces,
        "goal": chart.goal,
        "left_out": [{"variant": name, "reason": reason} for name, reason in chart.left_out],
    }
    store.write_json(chart.out / "chart.json", facts)
    reference = next(r for r in chart.rows if r.reference)
    fig = plot_chart.figure_chart(
        points_of(chart),
        chart.goal,
        f"Mean error of the force beyond {chart.start:.2g} µm (%)",
        f"{chart.scene}: against {reference.name}, which took {reference.cpu:.3g} s",
    )
    fig.savefig(chart.out / "chart.png")


def default_out(source: str | Path) -> Path:
    """results/chart-<name of the scene>, where ``chart`` writes when no folder is given."""
    return Path("results") / f"chart-{Path(str(source)).stem}"
