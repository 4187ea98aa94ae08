"""How far to trust a run: finer runs beside it, and what they say of its thickness at fixed pressures.

The finer runs load alone: the plan at half the platen speed; the scene at half the bead spacing and the same speed
(level section, where there is no spacing: half the contact softening). The error of a method of order q whose step h is
cut to r h is the change over 1 - r^q:

    e(h) - e(r h) = e(h) (1 - r^q)

so twice the change on halving the speed (q = 1: the filaments swing behind the platen by v/omega) and 4/3 of it on
halving the spacing (q = 2: the hinges of a chain, the bumps of its beads). The parts are added, not their squares:
nothing says that they are independent.
"""

from __future__ import annotations

import math
import os
import shutil
import threading
from collections.abc import Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from cgfibre.build.system import FilamentSystem, FloatArray
from cgfibre.engine.collect import read_run
from cgfibre.engine.job import Note, Watch, is_finished, is_written, run_job, write_job
from cgfibre.engine.lammps import Engine, EngineTime
from cgfibre.errors import EngineError, InputError
from cgfibre.measure.compaction import thickness_at_pressure
from cgfibre.measure.guards import Guard
from cgfibre.plan.make import make_plan
from cgfibre.plan.model import Plan
from cgfibre.plan.system import build_system
from cgfibre.record import Curve
from cgfibre.review import PRESSURES, SPEED_FACTOR, speed_change
from cgfibre.scene import Scene
from cgfibre.scene_reading import scene_from_dict

#: part of the error -> folder of the finer run that shows it, and what the run is called
FOLDERS = {"speed": "half-speed", "spacing": "half-spacing", "contact": "half-softening"}
CALLED = {
    "speed": "half the platen speed",
    "spacing": "half the bead spacing",
    "contact": "half the contact softening",
}
SPEED_ORDER, SPACING_ORDER = 1, 2
#: pressures nearer than this to each other are one
SAME = 1e-3
#: changes within this factor of a pressure speak for it
NEAR = 1.25


@dataclass(frozen=True)
class FinerRun:
    """A run that shows one part of the error: its plan and filaments, and the true error over the change it makes."""

    part: str
    plan: Plan
    system: FilamentSystem
    factor: float


# --- the finer runs ---------------------------------------------------------------------------------------------------


def half_speed(plan: Plan) -> Plan:
    """The same plan at half the platen speed, first loading alone."""
    return at_speed_of(plan, plan, 0.5)


def at_speed_of(plan: Plan, other: Plan, share: float = 1.0) -> Plan:
    """``plan`` with ``share`` times the platen speed of ``other``, first loading alone, rows where its are.

    A little slower than that where the film has to end with a whole row.
    """
    m, s = other.motion, other.sampling
    longer = other.timestep / plan.timestep / share
    every = max(1, round(s.every * longer))
    sample = every * (s.sample // s.every)
    steps = max(1, math.ceil(m.load_steps * longer / sample - 1e-9)) * sample
    slower = share * m.load_steps * longer / steps
    motion = replace(
        m.first_loading(), first=m.first * slower, last=m.last * slower, load_steps=steps
    )  # v(d) keeps its shape, so the film is the same one, stretched
    sampling = replace(
        plan.sampling,
        sample=sample,
        every=every,
        frame=steps,
        checkpoint=max(1, round(s.checkpoint / s.sample)) * sample,
        block=max(1, round(s.block / s.sample)) * sample,
    )
    return replace(plan, motion=motion, sampling=sampling)


def parts_of(plan: Plan) -> tuple[str, ...]:
    """Parts of the error that a plan has; a section with real contacts has no softening to halve."""
    if plan.level != "section":
        return ("speed", "spacing")
    return ("speed", "contact") if plan.contact.softening > 1 else ("speed",)


def finer_run(part: str, scene: Scene, plan: Plan, system: FilamentSystem) -> FinerRun:
    """The run that shows a part of the error of ``plan``; InputError where the scene cannot be refined so far."""
    if part == "speed":
        return FinerRun(part, half_speed(plan), system, _factor(0.5, SPEED_ORDER))
    if part == "contact":
        softening = plan.contact.softening
        finer = max(1.0, softening / 2)
        refined = _refined(scene, plan, {"contact": {"softening": finer}})
        # contacts are softer than the real ones (softening 1) by the rest alone
        factor = (softening - 1) / (softening - finer)
    else:
        spacing = _half(plan, scene)
        refined = _refined(scene, plan, {"model": {"spacing": f"{spacing!r} um"}})
        factor = math.nan
    fine = make_plan(refined)
    if part == "spacing":
        factor = _factor(fine.spacing / plan.spacing, SPACING_ORDER)
    return FinerRun(part, at_speed_of(fine, plan), build_system(refined, fine), factor)


def _factor(ratio: float, order: int) -> float:
    return 1 / (1 - ratio**order)


def _half(plan: Plan, scene: Scene) -> float:
    half, least = plan.spacing / 2, scene.filament.diameter / 20
    if half < least:
        raise InputError("model.spacing", f"{plan.spacing:g} um", f"at least {2 * least:g} um: --certify halves it")
    return half


def _refined(scene: Scene, plan: Plan, changes: Mapping[str, Mapping[str, Any]]) -> Scene:
    """The scene at the plan's level with other values; a time step asked for would be too long for it."""
    data = scene.model_dump(exclude_none=True)
    data["model"] |= {"level": plan.level, "timestep": "auto"}
    for table, values in changes.items():
        data[table] |= values
    return scene_from_dict(data)


class FinerRuns:
    """Finer runs beside the main one, one after another where there are cores for them, else after it.

    A context manager: leaving it, by an error too, stops the engines that still run.
    """

    def __init__(
        self, runs: Sequence[FinerRun], engine: Engine, out: Path, ranks: int, resume: bool, about: str
    ) -> None:
        self._runs, self._engine, self._out, self._ranks, self._resume = tuple(runs), engine, out, ranks, resume
        self._given_up = threading.Event()
        self._slots = threading.Semaphore(max(1, (os.cpu_count() or 1) // ranks))
        self._pool = ThreadPoolExecutor(max(1, len(self._runs)))
        self._futures: list[Future[EngineTime | None]] = []
        for run in self._runs:
            folder = self._folder(run)
            if not (resume and is_written(folder)):
                shutil.rmtree(folder, ignore_errors=True)
                write_job(folder, run.system, run.plan, f"{about} At {CALLED[run.part]}, loading alone.", engine)

    def _folder(self, run: FinerRun) -> Path:
        return self._out / FOLDERS[run.part]

    def __enter__(self) -> FinerRuns:
        self._slots.acquire()  # the main run's
        self._futures = [self._pool.submit(self._run, run) for run in self._runs]
        return self

    def _run(self, run: FinerRun) -> EngineTime | None:
        while not self._slots.acquire(timeout=0.1):
            if self._given_up.is_set():
                raise EngineError(f"the run at {CALLED[run.part]} was given up", "go on with --resume")
        try:
            watch = Watch(cancelled=self._given_up.is_set)
            return run_job(self._engine, self._folder(run), run.plan, self._ranks, self._resume, watch)
        finally:
            self._slots.release()

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._given_up.set()
        self._pool.shutdown()

    def wait(self, note: Note | None) -> None:
        """Until they are done, after the main run; an error of an engine is raised here."""
        self._slots.release()
        for run, future in zip(self._runs, self._futures, strict=True):
            if note and not future.done():
                note(f"the run at {CALLED[run.part]} goes on")
            future.result()


# --- what they say ----------------------------------------------------------------------------------------------------


def finished_part(out: Path, part: str) -> bool:
    """Whether the finer run of a part ran to its end in the folder of a run."""
    return is_finished(out / FOLDERS[part])


def read_finer(out: Path, run: FinerRun) -> Curve:
    """The curve of a finished finer run."""
    return read_run(out / FOLDERS[run.part], run.system, run.plan)[0]


def certificate(curve: Curve, finer: Mapping[str, tuple[Curve, float]], start: float | None) -> dict[str, Any]:
    """Thickness with its error at the fixed pressures that all runs reached, and at the highest such pressure.

    ``finer``: part -> (loading curve, true error over the change). ``start`` um is the displacement from which on
    forces are compared (None: nowhere). The error at a pressure is that of the largest change from a NEAR-th of it to
    NEAR times it: the curves cross, and where they do says nothing. Returns pressure_MPa, thickness_um, error_um and
    quasi_static (lists; false: reached before ``start``), force_error_mean and _worst (relative, at fixed displacement;
    None without a common stretch), from_um, and ``parts`` with the change of each.
    """
    branches = {name: _loading(c) for name, c in (("", curve), *((part, c) for part, (c, _) in finer.items()))}
    highest = min(float(np.max(p)) for _, p in branches.values())
    at = np.array([p for p in PRESSURES if p < highest * (1 - SAME)] + ([highest] if highest > 0 else []))
    around = np.minimum(at[:, None] * np.geomspace(1 / NEAR, NEAR, 9), highest)
    own = thickness_at_pressure(*branches[""], at)
    parts: dict[str, Any] = {}
    for part, (c, factor) in finer.items():
        change = own - thickness_at_pressure(*branches[part], at)
        near = thickness_at_pressure(*branches[""], around) - thickness_at_pressure(*branches[part], around)
        largest = np.fmax(np.nanmax(np.abs(near), axis=1, initial=0.0), np.abs(change))
        force = {"mean": math.nan, "worst": math.nan} if start is None else speed_change(curve, c, start)
        parts[part] = {
            "factor": factor,
            "change_um": change.tolist(),
            "error_um": (factor * largest).tolist(),
            "force_change_mean": _number(force["mean"]),
            "force_change_worst": _number(force["worst"]),
            "force_error_mean": _number(factor * force["mean"]),
            "force_error_worst": _number(factor * force["worst"]),
        }
    begin = -math.inf if start is None else float(curve["thickness_um"][0]) - start
    return {
        "pressure_MPa": at.tolist(),
        "thickness_um": own.tolist(),
        "error_um": np.sum([p["error_um"] for p in parts.values()], axis=0).tolist(),
        "quasi_static": (own <= begin).tolist(),
        "force_error_mean": _sum(parts, "force_error_mean"),
        "force_error_worst": _sum(parts, "force_error_worst"),
        "from_um": start,
        "parts": parts,
    }


def _loading(curve: Curve) -> tuple[FloatArray, FloatArray]:
    return curve["thickness_um"][curve.loading], curve["pressure_MPa"][curve.loading]


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _sum(parts: Mapping[str, Mapping[str, Any]], key: str) -> float | None:
    values = [p[key] for p in parts.values()]
    return None if None in values else float(sum(values))


def certificate_guard(found: Mapping[str, Any], accuracy: float) -> Guard:
    """Whether the error of the force, its parts added, is what was asked for."""
    limit, error = SPEED_FACTOR * accuracy, found["force_error_mean"]
    value = math.nan if error is None else float(error)
    parts = ", ".join(f"{name} {p['force_error_mean'] or math.nan:.1%}" for name, p in found["parts"].items())
    return Guard(
        "certificate",
        value <= limit,
        value,
        limit,
        f"certificate: the force errs by {value:.1%} on average ({parts}; limit {limit:.0%}); "
        "lower model.accuracy or model.spacing"
        if error is not None
        else "certificate: no displacement at which the forces of all runs can be compared; press further or slower",
    )
