"""Many runs side by side: those of a chart or a study, each in a folder of its own, found again when it is repeated."""

from __future__ import annotations

import json
import shutil
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path

from cgfibre import store
from cgfibre.engine.job import is_written
from cgfibre.errors import CgfibreError, EngineError, InputError
from cgfibre.plan.model import Plan
from cgfibre.scene import Scene
from cgfibre.scene_reading import load_scene
from cgfibre.workflow import RunOptions, plan_dict, plan_scene, run_scene

#: progress: (predicted seconds done, of all, what was done last)
Progress = Callable[[float, float, str], None]

#: files of a finished run that tell no more than results.h5
WORKING_FILES = ("deck", "log.lammps")


@dataclass(frozen=True)
class SweepRun:
    """One run to make or to find: its folder, what it is made of, its scene and plan."""

    folder: Path
    source: str | Path
    overrides: tuple[str, ...]
    scene: Scene
    plan: Plan

    @classmethod
    def planned(cls, folder: Path, source: str | Path, overrides: Sequence[str]) -> SweepRun:
        """The run of a scene with overrides, planned; InputError for what is wrong with it."""
        return cls(folder, source, tuple(overrides), *plan_scene(source, overrides))

    @property
    def name(self) -> str:
        """The folder's."""
        return self.folder.name

    def finished(self) -> bool:
        """Whether the folder holds this very run, of the same scene and plan, ended, with the time that it took."""
        try:
            summary = json.loads((self.folder / "summary.json").read_text())
            ended = "stopped" not in summary and summary["engine_cpu_s"] is not None
        except (OSError, ValueError, KeyError):
            return False
        return ended and (self.folder / "results.h5").exists() and self._same()

    def begun(self) -> bool:
        """Whether the folder holds this very run, stopped on its way."""
        return is_written(self.folder / "deck") and self._same()

    def _same(self) -> bool:
        """Whether the folder's scene and plan are this run's."""
        try:
            plan = json.loads((self.folder / "plan.json").read_text())
            scene = load_scene(self.folder / "scene.toml")
        except (OSError, ValueError, CgfibreError):
            return False
        return scene == self.scene and plan == json.loads(json.dumps(store.plain(plan_dict(self.plan))))


@dataclass(frozen=True)
class SweepOptions:
    """``jobs`` runs at a time; ``resume``: go on with those that were stopped (else anew: the time that a killed run
    took before is not known); ``trim``: leave the deck of a finished run out, results.h5 holds all of it."""

    jobs: int = 1
    resume: bool = False
    trim: bool = False


class _Told:
    """Progress of all runs together, in predicted seconds; threads tell it."""

    def __init__(self, runs: Sequence[SweepRun], todo: Sequence[SweepRun], progress: Progress | None) -> None:
        self._progress, self._lock = progress, threading.Lock()
        self._total = sum(r.plan.predicted_seconds for r in runs)
        self._done = self._total - sum(r.plan.predicted_seconds for r in todo)
        self._parts: dict[Path, float] = {}
        self._last = f"{len(runs) - len(todo)} runs found" if len(todo) < len(runs) else ""
        self._show()

    def part(self, run: SweepRun, share: float) -> None:
        with self._lock:
            self._parts[run.folder] = min(share, 1.0) * run.plan.predicted_seconds
            self._show()

    def ended(self, run: SweepRun) -> None:
        with self._lock:
            self._parts.pop(run.folder, None)
            self._done += run.plan.predicted_seconds
            self._last = f"{run.folder.parent.name}/{run.name}"
            self._show()

    def _show(self) -> None:
        if self._progress:
            self._progress(self._done + sum(self._parts.values()), self._total, self._last)


def run_all(runs: Sequence[SweepRun], options: SweepOptions, progress: Progress | None = None) -> dict[Path, str]:
    """Make the runs that are not there yet; returns the reasons of those that did not end, by folder.

    Each run has one rank. A run that fails is no reason to stop the others; an interrupt stops all of them.
    """
    given_up = threading.Event()
    todo = [run for run in runs if not run.finished()]
    if options.jobs > 1:
        todo.sort(key=lambda r: -r.plan.predicted_seconds)
    told = _Told(runs, todo, progress)
    failed: dict[Path, str] = {}

    def make(run: SweepRun) -> None:
        begun = options.resume and run.begun()  # checkpoints repeat the unbroken run
        own = RunOptions(run.folder, force=not begun, resume=begun, pictures=False)
        run_scene(
            run.source,
            own,
            run.overrides,
            lambda step, planned, *_: told.part(run, step / max(planned, 1)),
            cancelled=given_up.is_set,
        )
        if options.trim:
            shutil.rmtree(run.folder / WORKING_FILES[0], ignore_errors=True)
            (run.folder / WORKING_FILES[1]).unlink(missing_ok=True)

    with ThreadPoolExecutor(options.jobs) as pool:
        futures = {pool.submit(make, run): run for run in todo}
        try:
            for future in as_completed(futures):
                run = futures[future]
                try:
                    future.result()
                except EngineError as error:
                    failed[run.folder] = error.reason
                except InputError as error:
                    failed[run.folder] = str(error)
                told.ended(run)
        except BaseException:
            given_up.set()
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    return failed


def start_overrides(scene: Scene, start: int, jitter: float) -> tuple[str, ...]:
    """What makes specimen ``start`` of a scene: its seed, and ``jitter`` um where a bundle has less."""
    own: tuple[str, ...] = (f"assembly.seed={scene.assembly.seed + start}",)
    if not scene.is_weave and scene.bundle.jitter < jitter:
        own += (f"assembly.jitter={jitter!r} um",)
    return own
