"""The recipe: scene -> plan -> system -> deck -> run -> measure -> plot, one function a verb of the command line."""

from __future__ import annotations

import json
import math
import shutil
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from cgfibre import certify, store
from cgfibre.build.system import FilamentSystem
from cgfibre.engine.assemble import assemble
from cgfibre.engine.collect import Extremes, read_run
from cgfibre.engine.job import Note, Progress, Watch, is_finished, is_written, run_job, write_job
from cgfibre.engine.lammps import Engine, engine_version, find_engine
from cgfibre.engine.plugin import find_plugin
from cgfibre.errors import EngineError, InputError, StoreError
from cgfibre.measure.guards import Guard
from cgfibre.pictures import PICTURES, draw_all
from cgfibre.plan.make import make_plan
from cgfibre.plan.model import Plan
from cgfibre.plan.system import build_system
from cgfibre.record import Curve, Frames
from cgfibre.review import Review, quasi_static_from, review_run, speed_change
from cgfibre.review_fabric import fabric_summary
from cgfibre.scene import Scene
from cgfibre.scene_reading import load_scene, scene_from_dict

#: files by which an existing run is recognised, and which --force removes
RUN_FILES = ("scene.toml", "plan.json", "summary.json", "results.h5", "curve.csv", "log.lammps")

#: name of the guard on runs that stopped early
ENDED = "run to its end"


@dataclass(frozen=True)
class RunOptions:
    """How to run: folder, ranks, engine and launcher (None: the wheel's), what to do with an earlier run there.

    ``certify``: finer runs beside it state its error (:mod:`cgfibre.certify`). ``pictures`` off saves their time.
    """

    out: Path
    ranks: int = 1
    engine: str | None = None
    launcher: str | None = None
    resume: bool = False
    force: bool = False
    certify: bool = False
    pictures: bool = True


@dataclass(frozen=True)
class RunResult:
    """A finished run: its folder, curve, summary and what the guards said."""

    out: Path
    curve: Curve
    summary: dict[str, Any]
    review: Review

    @property
    def trusted(self) -> bool:
        """No guard failed."""
        return self.review.ok


def _with_plugin_or_beads(scene: Scene, engine: Engine | None, begun: Path | None) -> Scene:
    """The scene with contact.shape = "beads" where it leaves the choice and no plugin fits the engine.

    A run goes on as it was ``begun`` (its scene.toml), whatever has become of the plugin since: its deck has its own.
    """
    c = scene.contact
    capsules = c.law == "line" or c.kinetic_friction is not None or c.friction_by_angle is not None
    if c.shape != "auto" or capsules:
        return scene
    if begun is not None and begun.exists():
        missing = load_scene(begun).contact.shape == "beads"
    else:
        try:
            missing = find_plugin(engine or find_engine()) is None
        except EngineError:
            missing = True
    if not missing:
        return scene
    data = scene.model_dump(exclude_none=True)
    data["contact"]["shape"] = "beads"
    return scene_from_dict(data)


def plan_scene(
    source: str | Path, overrides: Sequence[str] = (), engine: Engine | None = None, begun: Path | None = None
) -> tuple[Scene, Plan]:
    """Scene and plan of a TOML file or shipped scene for an engine (None: the default one).

    Without a plugin for it filaments touch by their beads; those of a run that goes on touch as it was ``begun`` (its
    scene.toml). InputError says what is wrong with the scene.
    """
    scene = _with_plugin_or_beads(load_scene(source, overrides), engine, begun)
    plan = make_plan(scene)
    if plan.torsion == "dihedral":
        assemble(build_system(scene, plan), plan)  # refuses them on chains that are too straight as built
    return scene, plan


def plan_dict(plan: Plan) -> dict[str, Any]:
    """The plan as plain values for plan.json (per-bead arrays left out)."""
    values = asdict(plan)
    beads = values.pop("beads")
    values["far_field"] = beads["far_field"]
    values["stations"] = len(plan.beads.stations)
    values["planned_steps"] = plan.planned_steps
    values["promised_error"] = plan.promised_error
    return values


def build_scene(source: str | Path, out: Path, overrides: Sequence[str] = (), force: bool = False) -> Path:
    """Write the deck of a scene into ``out``/deck, beside scene.toml and plan.json; returns the deck's folder."""
    scene, plan = plan_scene(source, overrides)
    system = build_system(scene, plan)  # may refuse: before anything is written
    _claim(out, force)
    _write_inputs(out, scene, plan)
    return write_job(out / "deck", system, plan, _about(scene, plan))


def _claim(out: Path, force: bool) -> None:
    """Make ``out`` ready for a new run; refuse to overwrite an earlier one."""
    store.check_folder(out, (*RUN_FILES, "deck"), force, ", --resume goes on")
    for name in (*RUN_FILES, *PICTURES):
        (out / name).unlink(missing_ok=True)
    for name in ("deck", *certify.FOLDERS.values()):
        shutil.rmtree(out / name, ignore_errors=True)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError("--out", str(out), f"a folder that can be written ({error.strerror})") from error


def _write_inputs(out: Path, scene: Scene, plan: Plan) -> None:
    (out / "scene.toml").write_text(scene.to_toml())
    store.write_json(out / "plan.json", plan_dict(plan))


def _about(scene: Scene, plan: Plan) -> str:
    name = scene.name or "without a name"
    return f"cgfibre deck of the scene {name}, level {plan.level}. {scene.description}".strip()


def run_scene(
    source: str | Path,
    options: RunOptions,
    overrides: Sequence[str] = (),
    progress: Progress | None = None,
    note: Note | None = None,
    cancelled: Callable[[], bool] | None = None,
) -> RunResult:
    """Plan, build, run, measure and plot a scene; ``cancelled`` is asked now and then whether to give up.

    Raises InputError before anything is written, EngineError when the engine stopped (what it computed is measured
    and kept). A result that a guard distrusts is returned all the same: see ``RunResult.trusted``.
    """
    begin = time.perf_counter()
    if options.ranks < 1:
        raise InputError("--ranks", options.ranks, "1 or more")
    engine = find_engine(options.engine, options.launcher)
    engine.command(options.ranks)
    out = options.out
    scene, plan = plan_scene(source, overrides, engine, out / "scene.toml" if options.resume else None)
    system = build_system(scene, plan)  # may refuse: before anything is written
    wanted = certify.parts_of(plan) if options.certify else ("speed",) if scene.model.speed_check else ()
    finer = [certify.finer_run(part, scene, plan, system) for part in wanted]
    if options.resume:
        _check_same_scene(out, scene)
    else:
        _claim(out, options.force)
        _write_inputs(out, scene, plan)
    folder, about = out / "deck", _about(scene, plan)
    if not (options.resume and is_written(folder)):
        write_job(folder, system, plan, about, engine)
    with certify.FinerRuns(finer, engine, out, options.ranks, options.resume, about) as beside:
        try:
            spent = run_job(engine, folder, plan, options.ranks, options.resume, Watch(progress, note, cancelled))
            before = time.perf_counter()
            beside.wait(note)
        except EngineError as error:
            _keep_what_there_is(out, scene, plan, system, {"begin": begin, "stopped": str(error)}, options.pictures)
            raise
        finally:
            # a copy for convenience: on a full disk it must not hide the engine's own error
            with suppress(OSError):
                shutil.copyfile(folder / "log.lammps", out / "log.lammps")
        waited = time.perf_counter() - before
    facts = {
        **(_known_facts(out) if spent is None else {"engine_s": spent.wall, "engine_cpu_s": spent.cpu}),
        "speed_check_wait_s": waited,
        "engine_version": engine_version(engine),
        "ranks": options.ranks,
        "begin": begin,
        "certify": options.certify,
    }
    return _finish(out, scene, plan, system, facts, options.pictures)


def _check_same_scene(out: Path, scene: Scene) -> None:
    path = out / "scene.toml"
    if not path.exists():
        raise InputError("--resume", str(out), "the folder of an earlier run (it has no scene.toml)")
    if load_scene(path) != scene:
        raise InputError(
            "--resume", str(out), "the scene that was begun there (scene.toml differs); start anew with --force"
        )


def _keep_what_there_is(
    out: Path, scene: Scene, plan: Plan, system: FilamentSystem, facts: dict[str, Any], pictures: bool
) -> None:
    """After the engine stopped: make what it computed readable; never hide the engine's own error behind another."""
    with suppress(StoreError, InputError, ValueError, OSError):
        _finish(out, scene, plan, system, facts, pictures)


def _known_facts(out: Path) -> dict[str, Any]:
    """What an earlier summary knows and files do not tell again; empty without one."""
    old: Mapping[str, Any] = {}
    if (out / "summary.json").exists():
        old = json.loads((out / "summary.json").read_text())
    elif (out / "results.h5").exists():
        old = store.read_results(out / "results.h5").summary
    kept = ("engine_s", "engine_cpu_s", "speed_check_wait_s", "engine_version", "ranks", "wall_s", "stopped")
    facts = {key: old.get(key) for key in kept}
    if old.get("speed_error") is not None:
        facts["speed"] = {"mean": old["speed_error"], "worst": old["speed_error_worst"]}
    facts["certificate"] = old.get("certificate")
    return facts


def measure_folder(out: Path) -> RunResult:
    """Derive curve, statistics and pictures again from what a run left: the deck's files, or else results.h5."""
    out = Path(out)
    if not (out / "scene.toml").exists() and not (out / "results.h5").exists():
        raise InputError("DIR", str(out), "the folder of a run (it has neither scene.toml nor results.h5)")
    facts = _known_facts(out)
    if (out / "scene.toml").exists():
        scene = load_scene(out / "scene.toml")
    else:
        (out / "scene.toml").write_text(store.read_results(out / "results.h5").scene)
        scene = load_scene(out / "scene.toml")
    plan = make_plan(scene)
    return _finish(out, scene, plan, build_system(scene, plan), facts)


def _finish(
    out: Path, scene: Scene, plan: Plan, system: FilamentSystem, facts: dict[str, Any], pictures: bool = True
) -> RunResult:
    """Measure, judge, store and draw."""
    folder = out / "deck"
    stopped: str | None = facts.get("stopped")
    known: Sequence[Mapping[str, Any]] = ()
    if (folder / "record.txt").exists():
        curve, frames, extremes = read_run(folder, system, plan)
        if len(frames) == 0 and (out / "results.h5").exists():
            frames = store.read_results(out / "results.h5").frames
        stopped = None if is_finished(folder) else stopped or "stopped before its end; go on with --resume"
    elif (out / "results.h5").exists():
        stored = store.read_results(out / "results.h5")
        curve, frames, extremes = stored.curve, stored.frames, None
        known = stored.summary.get("guards", ())
    else:
        raise StoreError(f"{out}: neither deck/record.txt nor results.h5: nothing was computed yet")
    facts = {**facts, "stopped": stopped}
    speed, certified = _errors(out, scene, plan, system, curve, facts)
    review = review_run(scene, plan, system, curve, frames, extremes, speed)
    if certified:
        guard = certify.certificate_guard(certified, scene.model.accuracy)
        review = replace(review, guards=(*review.guards, guard))
    review = _complete(review, known, stopped, curve, plan)
    summary = _summary(scene, plan, curve, review, speed, facts) | {"certificate": certified}
    results = store.Results(
        system,
        curve,
        frames,
        plan.timestep,
        {} if scene.is_weave else review.statistics,
        scene.to_toml(),
        json.dumps(store.plain(plan_dict(plan))),
        summary,
        review.statistics if scene.is_weave else {},
    )
    store.write_results(out / "results.h5", results)
    store.write_curve(out / "curve.csv", curve)
    store.write_json(out / "summary.json", summary)
    if pictures:
        draw_all(out, scene, plan, system, curve, frames, summary, review.statistics)
    if not scene.output.dump and "stopped" not in summary:
        (folder / "trajectory.lammpstrj").unlink(missing_ok=True)  # its frames are in results.h5
    if facts.get("begin") is not None:
        summary["wall_s"] = time.perf_counter() - facts["begin"]
        store.write_json(out / "summary.json", summary)
    return RunResult(out, curve, summary, review)


def _errors(
    out: Path, scene: Scene, plan: Plan, system: FilamentSystem, curve: Curve, facts: Mapping[str, Any]
) -> tuple[dict[str, float] | None, dict[str, Any] | None]:
    """(change of the force at half speed, certificate): of the finer runs that ended here, else as known before."""
    start = quasi_static_from(plan, system, curve)
    finer = {}
    for part in certify.parts_of(plan):
        if certify.finished_part(out, part):
            run = certify.finer_run(part, scene, plan, system)
            finer[part] = certify.read_finer(out, run), run.factor
    speed = facts.get("speed")
    if "speed" in finer and start is not None:
        speed = speed_change(curve, finer["speed"][0], start)
    known = facts.get("certificate")
    # a section with real contacts has one part alone, which a mere speed check shows as well
    asked = len(finer) > 1 or facts.get("certify") or known
    whole = asked and len(finer) == len(certify.parts_of(plan))
    return speed, certify.certificate(curve, finer, start) if whole else known


def _complete(
    review: Review, known: Sequence[Mapping[str, Any]], stopped: str | None, curve: Curve, plan: Plan
) -> Review:
    """The review with what it cannot see: verdicts on samples that are stored no more, and an early end."""
    judged = {g.name for g in review.guards}
    more = [
        Guard(**{**g, "value": math.nan if g["value"] is None else g["value"]})
        for g in known
        if g["name"] not in judged and g["name"] != ENDED
    ]
    if stopped is not None:
        done = float(curve["step"][-1])
        more.append(
            Guard(
                ENDED,
                False,
                done,
                float(plan.planned_steps),
                f"{ENDED}: at step {done:.0f} of about {plan.planned_steps}: {stopped.splitlines()[0]}",
            )
        )
    return replace(review, guards=(*review.guards, *more))


def _summary(
    scene: Scene, plan: Plan, curve: Curve, review: Review, speed: dict[str, float] | None, facts: dict[str, Any]
) -> dict[str, Any]:
    peak = int(np.argmax(curve["force_top_N"]))
    summary: dict[str, Any] = {
        "scene": scene.name,
        "level": plan.level,
        "trusted": review.ok,
        "n_filaments": plan.n_filaments,
        "n_beads": plan.n_beads,
        "n_steps": int(curve["step"][-1]),
        "timestep_us": plan.timestep,
        "platen_speed_m_per_s": plan.motion.first,
        "platen_speed_last_m_per_s": plan.motion.last,
        "wall_s": facts.get("wall_s"),
        "engine_s": facts.get("engine_s"),
        "engine_cpu_s": facts.get("engine_cpu_s"),
        "speed_check_wait_s": facts.get("speed_check_wait_s"),
        "engine_version": facts.get("engine_version"),
        "ranks": facts.get("ranks"),
        "promised_error": plan.promised_error,
        "predicted_s": plan.predicted_seconds,
        "peak_force_N": float(curve["force_top_N"][peak]),
        "bottom_over_top_at_peak": float(curve["force_bottom_N"][peak] / curve["force_top_N"][peak])
        if curve["force_top_N"][peak] > 0
        else None,
        "final_thickness_um": float(curve["thickness_um"][-1]),
        "least_thickness_um": float(np.min(curve["thickness_um"])),
        "energy_ratio": review.energy_ratio,
        "speed_error": speed["mean"] if speed else None,
        "speed_error_worst": speed["worst"] if speed else None,
        "quasi_static_from_um": review.quasi_static_um,
        "quasi_static_from_N": review.quasi_static_N,
        "fits": review.fits,
        "guards": [asdict(g) for g in review.guards],
        "warnings": [g.message for g in review.guards if not g.ok],
        "package_versions": _versions(),
    }
    if scene.is_weave:
        summary["fabric"] = fabric_summary(review.statistics)
    if facts.get("stopped"):
        summary["stopped"] = facts["stopped"]
    return summary


def _versions() -> dict[str, str]:
    from importlib import metadata

    return {name: metadata.version(name) for name in ("cgfibre", "lammps", "numpy")}


def default_out(source: str | Path) -> Path:
    """results/<name of the scene>, where ``run`` writes when no folder is given."""
    return Path("results") / Path(str(source)).stem


__all__ = [
    "Extremes",
    "Frames",
    "Progress",
    "RunOptions",
    "RunResult",
    "build_scene",
    "default_out",
    "measure_folder",
    "plan_dict",
    "plan_scene",
    "run_scene",
]
