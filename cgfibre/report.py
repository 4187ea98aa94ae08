"""What the command line prints: the plan, a progress bar, the result."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    ProgressColumn,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Table

from cgfibre.cases.limits import LimitMap
from cgfibre.chart import COMPARED, Chart, Row
from cgfibre.errors import InputError
from cgfibre.measure.ensemble import mean_of
from cgfibre.pictures import PICTURES
from cgfibre.plan.make import other_levels
from cgfibre.plan.model import Plan
from cgfibre.plan.promise import NOTHING
from cgfibre.scene import Scene
from cgfibre.stability import CSV_NAME, Finding
from cgfibre.study.file import LOADS
from cgfibre.study.outcome import reached
from cgfibre.study.run import Found, report_lines
from cgfibre.workflow import RunResult


def _seconds(t: float) -> str:
    return f"{t:.0f} s" if t < 100 else f"{t / 60:.0f} min" if t < 6000 else f"{t / 3600:.1f} h"


def _within(plan: Plan) -> str:
    """The promised error; in words from an error of all of the force on."""
    return "no promise" if plan.promised_error >= NOTHING else f"{plan.promised_error:.1%}"


def _promise_against(scene: Scene, plan: Plan) -> str:
    asked = scene.model.accuracy
    if plan.promised_error <= asked:
        return f"mean over the quasi-static loading; {asked:.0%} was asked for"
    worst = max(plan.promise, key=lambda part: part.value)
    return f"mean over the quasi-static loading; more than the {asked:.0%} asked for, most of it from {worst.what}"


def print_plan(scene: Scene, plan: Plan, brief: bool = False) -> None:
    """The plan as tables; ``brief``: one line."""
    console = Console()
    line = (
        f"{scene.name or 'scene'}: {plan.n_filaments} filaments, level {plan.level}, {plan.n_beads} beads, "
        f"{plan.planned_steps} steps of {plan.timestep:.3g} us, about {_seconds(plan.predicted_seconds)} on one core, "
        f"{'force within ' if plan.promised_error < NOTHING else ''}{_within(plan)}"
    )
    console.print(line, highlight=False)
    if brief:
        return
    chosen = Table("modelled", "value", "because", title="What is modelled", title_justify="left")
    for c in plan.choices:
        chosen.add_row(c.what, c.value, c.reason)
    left = Table("left out", "because", "error to expect", title="What is left out", title_justify="left")
    for o in plan.omissions:
        left.add_row(o.what, o.reason, o.error)
    console.print(chosen, left)
    parts = Table("error", "of the force", "because", title="What is promised", title_justify="left")
    for part in plan.promise:
        parts.add_row(part.what, f"{part.value:.1%}", part.reason)
    parts.add_row("sum", _within(plan), _promise_against(scene, plan))
    console.print(parts)
    others = Table("level", "time", "force within", "", title="What other levels would be", title_justify="left")
    for level, other in other_levels(scene, plan).items():
        if isinstance(other, InputError):
            others.add_row(level, "", "", f"not for this scene: {other.key} would have to be {other.expected}")
        else:
            worst = max(other.promise, key=lambda part: part.value)
            others.add_row(
                level,
                _seconds(other.predicted_seconds),
                _within(other),
                f"{other.n_beads} beads; most of the error: {worst.what}",
            )
    console.print(others)


class _LateProgress:
    """A bar that shows at the first sign of work, so that wrong input is answered by its one line alone; a context
    manager."""

    def __init__(self, *columns: ProgressColumn) -> None:
        self._progress = Progress(*columns, console=Console(stderr=True), refresh_per_second=4)
        self._task: TaskID | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._task is not None:  # stopping a bar that never showed prints an empty line
            self._progress.stop()

    def _begin(self, title: str, total: float | None = None, **fields: Any) -> TaskID:
        if self._task is None:
            self._progress.start()
            self._task = self._progress.add_task(title, total=total, **fields)
        return self._task


class RunProgress(_LateProgress):
    """Progress of a run: part done, rate, time left, present displacement and force; a context manager."""

    def __init__(self) -> None:
        super().__init__(
            TextColumn("[bold]{task.description}"),
            BarColumn(),
            TextColumn("{task.percentage:3.0f} %"),
            TextColumn("{task.fields[state]}"),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
        )

    def update(self, step: int, planned: int, displacement: float, force: float) -> None:
        """Show a state; the signature of :data:`cgfibre.workflow.Progress`."""
        task = self._begin("pressing", state="")
        elapsed = self._progress.tasks[0].elapsed or 0.0
        rate = f"{step / elapsed:.0f} steps/s" if elapsed > 1 else ""
        self._progress.update(
            task, completed=step, total=planned, state=f"{displacement:.2f} um  {force:.3g} N  {rate}"
        )

    def note(self, text: str) -> None:
        """A line above the bar."""
        self._begin("pressing", state="")
        self._progress.console.print(text, highlight=False)


def certificate_lines(found: Mapping[str, Any] | None) -> list[str]:
    """ "thickness at 0.1 MPa: 47.3 +- 0.4 um (speed 0.2, spacing 0.2)", one line a pressure; the force's error last."""
    if not found:
        return []
    lines = []
    for k, (p, t, error) in enumerate(
        zip(found["pressure_MPa"], found["thickness_um"], found["error_um"], strict=True)
    ):
        digits = _decimals(error)
        parts = ", ".join(f"{name} {part['error_um'][k]:.{digits}f}" for name, part in found["parts"].items())
        lines.append(
            f"thickness at {p:.3g} MPa: {t:.{digits}f} +- {error:.{digits}f} um ({parts})"
            + ("" if found["quasi_static"][k] else ", before the run is quasi-static")
        )
    mean, worst = found["force_error_mean"], found["force_error_worst"]
    if mean is not None:
        lines.append(
            f"force at a displacement: +- {mean:.1%} on average from {found['from_um']:.2g} um on, {worst:.0%} at "
            "worst (errors of the numbers; what the level leaves out: cgfibre plan)"
        )
    return lines


def _decimals(error: float) -> int:
    """Decimals that show two figures of an error, from none to four."""
    return min(4, max(0, 1 - math.floor(math.log10(error)))) if error > 0 else 4


def print_result(result: RunResult) -> None:
    """Where the files lie, the main numbers, and what not to trust."""
    console = Console(soft_wrap=True)
    s = result.summary
    share = s["bottom_over_top_at_peak"]
    console.print(
        f"peak force {s['peak_force_N']:.3g} N at {float(result.curve['displacement_um'].max()):.3g} um; "
        f"thickness {s['least_thickness_um']:.4g} um there, {s['final_thickness_um']:.4g} um at the end"
        + (f"; the bottom platen carried {share:.0%} of the peak" if share is not None else ""),
        highlight=False,
    )
    if s["speed_error"] is not None:
        console.print(
            f"error: halving the platen speed changes the force by {s['speed_error']:.1%} on average, "
            f"{s['speed_error_worst']:.0%} at worst",
            highlight=False,
        )
    for line in certificate_lines(s.get("certificate")):
        console.print(line, highlight=False)
    fit = s["fits"].get("power_law")
    if fit:
        console.print(
            f"eps = a p^b with a = {fit['a']:.3g} +- {fit['a_error']:.1g}, b = {fit['b']:.3g} +- {fit['b_error']:.1g} "
            "(p in MPa)",
            highlight=False,
        )
    for name in PICTURES:
        if (result.out / name).exists():
            console.print(f"picture  {result.out / name}", highlight=False)
    console.print(f"curve    {result.out / 'curve.csv'}\nresults  {result.out / 'results.h5'}", highlight=False)
    for warning in s["warnings"]:
        console.print(f"WARNING  {warning}", highlight=False)


class MapProgress(_LateProgress):
    """Progress of the stability maps: which map, points so far; a context manager."""

    def __init__(self) -> None:
        super().__init__(
            TextColumn("[bold]{task.description}"),
            BarColumn(),
            TextColumn("map {task.completed} of {task.total}"),
            TextColumn("{task.fields[points]}"),
            TimeElapsedColumn(),
        )

    def update(self, chart: LimitMap, number: int, of: int, points: int) -> None:
        """Show a state; the signature of :data:`cgfibre.stability.Progress`."""
        task = self._begin(chart.title, of, points="")
        self._progress.update(task, description=chart.title, completed=number, total=of, points=f"{points} points")


def print_limits(findings: Sequence[Finding], out: Path) -> None:
    """Every map in a line: points, how far from the closed form at worst, the step used, processor time."""
    table = Table("map", "points", "off the closed form", "step used / limit", "CPU", title_justify="left")
    for f in findings:
        off = "" if f.worst != f.worst else f"{f.worst:.1%}" if f.worst < 10 else f"{f.worst:.1e} times"
        used = "" if f.step_used != f.step_used else f"{f.step_used:.2f}"
        table.add_row(f.map.name, str(len(f.points)), off, used, f"{f.cpu:.1f} s")
    console = Console()
    console.print(table)
    console.print(f"table    {out / CSV_NAME}\npictures {out / 'stability-*.png'}", highlight=False, soft_wrap=True)


class SweepProgress(_LateProgress):
    """Progress of a chart or a study by predicted seconds of its runs; a context manager."""

    def __init__(self, title: str) -> None:
        super().__init__(
            TextColumn(f"[bold]{title}"),
            BarColumn(),
            TextColumn("{task.percentage:3.0f} %"),
            TextColumn("{task.fields[state]}"),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
        )

    def update(self, done: float, total: float, last: str) -> None:
        """Show a state; the signature of :data:`cgfibre.sweep.Progress`."""
        self._progress.update(self._begin("", total, state=last), completed=done, total=total, state=last)


def print_study(found: Found) -> None:
    """The table of a study: thickness at each load, mean and 95 % interval, and how many specimens that is of."""
    console = Console(soft_wrap=True, width=max(Console().width, 110))
    unit = LOADS[found.study.compare.kind][1]
    table = Table(title=f"{found.study.title or found.study.name}: thickness (um)", title_justify="left")
    for name in ("case", "samples", *(f"{load:.3g} {unit}" for load in found.study.compare.values), ""):
        table.add_column(name, no_wrap=True, justify="left" if name in ("case", "") else "right")
    for case in found.cases:
        cells = []
        for load in found.study.compare.values:
            metric = case.metrics.get(f"thickness_um_at_{load:.4g}_{unit.replace('/', '_per_')}")
            mean, ci, _ = mean_of(reached(metric.values)) if metric else (math.nan,) * 3
            interval = "" if math.isnan(ci) else f" ± {ci:.{_decimals(ci)}f}"
            cells.append("" if math.isnan(mean) else f"{mean:.2f}{interval}")
        n = len(case.specimens)
        samples = "none" if n == 0 else "one sample" if n == 1 else str(n)
        table.add_row(case.cell.label, samples, *cells, "" if case.trusted else "distrusted")
    console.print(table)
    for line in report_lines(found):
        console.print(line, highlight=False)


def print_chart(chart: Chart) -> None:
    """The table of a chart, what was left out, and the cheapest variant within the error aimed at."""
    console = Console(soft_wrap=True, width=max(Console().width, 110))
    table = Table(title_justify="left")
    table.title = f"{chart.scene}: error of the force against the reference, mean from {chart.start:.2g} um on"
    for name in ("variant", "CPU s", "mean", *(f"{d:.3g} um" for d in chart.displacements), ""):
        table.add_column(name, no_wrap=True, justify="left" if name in ("variant", "") else "right")
    for r in sorted(chart.rows, key=lambda r: r.cpu):
        spread = f" ± {50 * (r.error_range[1] - r.error_range[0]):.1f}" if r.starts > 1 else ""
        errors = [f"{100 * r.error:.1f}{spread} %", *("" if math.isnan(e) else f"{e:+.1%}" for e in r.force_errors)]
        if r.reference:
            errors = ["reference"]
        table.add_row(
            r.name, f"{r.cpu:.3g}", *errors, *("" for _ in chart.displacements[len(errors) - 1 :]), _remarks(r)
        )
    console.print(table)
    for name, reason in chart.left_out:
        console.print(f"left out {name}: {reason}", highlight=False)
    best = chart.cheapest
    if best is None:
        console.print(f"no variant errs by {chart.goal:.0%} or less", highlight=False)
    else:
        console.print(f"cheapest within {chart.goal:.0%}: {best.name}, {best.cpu:.3g} s", highlight=False)
        for r in chart.rows:
            if r.level == COMPARED:
                console.print(f"  {r.name} took {r.cpu:.3g} s, {r.cpu / best.cpu:.2g} times as long", highlight=False)
    console.print(f"picture  {chart.out / 'chart.png'}\ntable    {chart.out / 'chart.csv'}", highlight=False)


def _remarks(row: Row) -> str:
    words = (("planner", row.planner), ("front", row.front), ("distrusted", not row.trusted))
    return ", ".join(word for word, true in words if true)
