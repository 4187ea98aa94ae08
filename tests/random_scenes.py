"""Random scenes over the whole schema, and what becomes of each: refused, stopped, distrusted or trusted.

Never anything else: no other exception, no run beyond its time, no trusted result that is not finite or that half the
platen speed changes by far more than the accuracy asked for.
"""

from __future__ import annotations

import copy
import math
import time
import traceback
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st

from cgfibre import store, workflow
from cgfibre.engine.assemble import assemble
from cgfibre.errors import CgfibreError, EngineError, InputError
from cgfibre.materials import MATERIALS
from cgfibre.plan.make import make_plan
from cgfibre.plan.model import Plan
from cgfibre.plan.system import build_system
from cgfibre.review import speed_change
from cgfibre.scene import Scene
from cgfibre.scene_reading import scene_from_dict

#: keys that a refusal may name
TABLES = ("filament", "assembly", "ends", "platens", "contact", "model", "output")
#: length over diameter: short, middling, long
REACH = {1: (4.5, 16), 2: (16, 80), 3: (80, 3000)}
#: engine seconds that a scene may be planned to take; a dearer one is pressed faster
CAP = 2.5
#: seconds beyond which a scene counts as hung: planning and building, or all of it (on a busy machine)
SLOW_BUILD, SLOW_RUN = 60.0, 240.0
#: change of the force at half the speed, over the accuracy asked for, that makes a trusted result a wrong one
WRONG = 4.0


def _decades(low: float, high: float) -> st.SearchStrategy[float]:
    """Numbers spread evenly over decades."""
    return st.floats(math.log10(low), math.log10(high)).map(lambda e: float(f"{10**e:.4g}"))


def _maybe(strategy: st.SearchStrategy[Any], often: int = 1) -> st.SearchStrategy[Any]:
    """None ``often`` times as likely as a value."""
    return st.one_of(*[st.none()] * often, strategy)


@st.composite
def filaments(draw: st.DrawFn) -> dict[str, Any]:
    """A material of the library, changed or not, or one of odd constants."""
    if draw(st.integers(0, 2)):
        table: dict[str, Any] = {"material": draw(st.sampled_from(sorted(MATERIALS)))}
        if draw(st.integers(0, 3)) == 0:
            table["diameter"] = f"{draw(_decades(1, 300))} um"
        if draw(st.integers(0, 5)) == 0:
            table["E1"] = f"{draw(_decades(1e-2, 1e3))} GPa"
        return table
    e1 = draw(_decades(1e-3, 900))
    return {
        "diameter": f"{draw(_decades(1, 300))} um",
        "E1": f"{e1} GPa",
        "E2": f"{min(900.0, max(1e-5, e1 / draw(_decades(1, 100)))):.4g} GPa",
        "nu23": draw(st.sampled_from([0.0, 0.2, 0.3, 0.45, 0.5])),
        "G12": f"{max(1e-6, e1 / draw(_decades(0.5, 1e4))):.4g} GPa",
        "density": f"{draw(_decades(0.5, 20))} g/cm^3",
    }


@st.composite
def random_scenes(draw: st.DrawFn) -> dict[str, Any]:
    """Tables of a scene that looks valid: most are, some are refused for a combination."""
    # a third of them so small and so softly asked that a run in a second can be quasi-static
    calm = draw(st.integers(0, 2)) == 0
    filament = draw(filaments())
    d = _number(filament["diameter"]) if "diameter" in filament else MATERIALS[filament["material"]].diameter
    arrangement = draw(
        st.sampled_from(
            ["circular"] * 6 + ["hexagonal", "rectangular", "elliptic", "racetrack", "virtual", "random", "random"]
        )
    )
    if arrangement == "circular":
        count = draw(st.sampled_from([1, 7, 7] if calm else [1, 7, 7, 19, 37]))
    else:
        count = draw(st.integers(1, 6 if calm else 37))
    level = draw(st.sampled_from(["auto", "auto", "chain", "chain", "rod", "section", "section"]))
    slender = draw(st.sampled_from([1] if calm else [1, 1, 1, 2, 3]).flatmap(lambda k: _decades(*REACH[k])))
    length = slender * d
    assembly: dict[str, Any] = {"count": count, "arrangement": arrangement, "length": _um(length)}
    if arrangement == "random":
        assembly["fibre_volume_fraction"] = draw(st.sampled_from([0.05, 0.3, 0.5, 0.65, 0.75]))
    elif draw(st.booleans()):
        assembly["void_fraction"] = draw(st.sampled_from([0.1, 0.2, 0.31, 0.5, 0.8, 0.95]))
    else:
        assembly["pitch"] = _um(d * draw(st.sampled_from([1.0, 1.01, 1.1, 1.3, 2.0, 3.0])))
    if arrangement in ("rectangular", "elliptic", "racetrack"):
        assembly["aspect"] = draw(st.sampled_from([0.2, 1.0, 2.5, 8.0]))
    if arrangement == "circular":
        assembly["first_angle"] = draw(st.sampled_from(["0 deg", "90 deg", "7 deg", "-33 deg"]))
    along = level != "section"
    if along and draw(st.integers(0, 3)) == 0:
        assembly["twist"] = f"{draw(_decades(1e-3, 0.5)) / length:.6g} turn/um"
        assembly["twist_direction"] = draw(st.sampled_from(["Z", "S"]))
        assembly["twist_state"] = draw(st.sampled_from(["stress-free", "tensioned"]))
    if along and draw(st.integers(0, 5)) == 0:
        assembly["migration"] = {
            "period": _um(max(length, 4 * d) * draw(st.sampled_from([0.5, 2.0, 10.0]))),
            "minimum_radius": draw(st.sampled_from([0.0, 0.3, 0.9])),
        }
    assembly["jitter"] = _um(
        d * draw(st.sampled_from([0.0, 1e-3, 1e-3, 9e-3, 0.05 if "pitch" not in assembly else 0.0]))
    )
    assembly["seed"] = draw(st.integers(0, 999))
    ends: dict[str, Any] = {}
    if along:
        ends["support"] = draw(st.sampled_from(["simply-supported"] * 5 + ["clamped"] * 2 + ["symmetry"]))
    kilopascal = 1e6 * _number(filament["E1"]) if "E1" in filament else MATERIALS[filament["material"]].E1
    # force that bends a filament by its diameter, nN
    bending = 48 * kilopascal * math.pi / 64 * d**5 / length**3
    strain = draw(_maybe(st.one_of(st.just(0.0), _decades(1e-8, 0.06), _decades(1e-6, 1e-3))))
    if strain is not None:
        ends["tension"] = f"{strain * kilopascal * math.pi * d**2 / 4:.4g} nN"
    platens: dict[str, Any] = {"friction": draw(st.sampled_from([0.0, 0.3, 0.3, 1.5]))}
    if draw(st.booleans()):
        platens["width"] = _um(min(0.999, max(d / length, draw(st.sampled_from([0.05, 0.3, 0.7, 0.95])))) * length)
        if along and draw(st.integers(0, 3)) == 0:
            platens |= {"shape": "crimped", "crimp_angle": draw(st.sampled_from(["0.5 deg", "4.4 deg", "40 deg"]))}
            platens |= {"curvature": draw(st.sampled_from(["convex", "concave"]))}
            platens |= {"crimp_side": draw(st.sampled_from(["both", "top"]))}
        if draw(st.integers(0, 3)) == 0:
            platens["bottom_width"] = draw(st.sampled_from([_um(max(d, 0.5 * length)), "full"]))
    if draw(st.booleans()):
        # some near what a short filament allows, a thousandth of its sound speed
        sound = math.sqrt(kilopascal / 2.0)
        speed = draw(st.one_of(_decades(1e-4, 300), _decades(1e-6, 1e-3).map(lambda x: float(f"{x * sound:.4g}"))))
        platens["speed"] = f"{speed} m/s"
    platens["stop"] = draw(
        st.one_of(
            st.sampled_from([0.02, 0.1, 0.3, 0.3, 0.45] + [0.6, 1.0, 2.0] * (count > 6)).map(
                lambda x: {"displacement": _um(x * d)}
            ),
            st.sampled_from([1.02, 1.5, 2.5, 4.0] if count > 6 else [1.01, 1.5]).map(
                lambda x: {"thickness": _um(x * d)}
            ),
            _decades(1e-6, 1.0).map(lambda x: {"force": f"{x} N"}),
            _decades(1e-2, 10).map(lambda x: {"force": f"{x * bending * count:.4g} nN"}),
            _decades(1e-4, 1e2).map(lambda x: {"pressure": f"{x} MPa"}),
        )
    )
    if draw(st.integers(0, 3)) == 0:
        platens["hold"] = f"{draw(_decades(1e-3, 1))} us"
    platens["unload"] = draw(st.booleans())
    contact: dict[str, Any] = {"friction": draw(st.sampled_from([0.0, 0.2, 0.2, 0.6, 2.0]))}
    contact["law"] = draw(st.sampled_from(["auto", "auto", "hooke"] + ["hertz"] * along))
    for key, values in (
        ("softening", st.one_of(st.sampled_from([1.0, 3.0]), _decades(1, 10), _decades(1, 1e4))),
        ("damping_ratio", st.sampled_from([0.01, 0.1, 1.0])),
        ("line_load", _decades(1e-2, 10).map(lambda x: f"{x} N/mm")),
    ):
        value = draw(_maybe(values, 3))
        if value is not None:
            contact[key] = value
    if "E2" in filament and draw(st.integers(0, 9)):
        # a load that a filament of this modulus bears
        contact["line_load"] = f"{1e3 * _number(filament['E2']) * d * 1e-3 * draw(_decades(1e-3, 0.05)):.4g} N/mm"
    model: dict[str, Any] = {"level": level, "accuracy": draw(st.sampled_from([0.05, 0.05, 0.02, 0.2]))}
    if along:
        options: Mapping[str, st.SearchStrategy[Any]] = {
            "spacing": st.sampled_from([0.25, 0.5, 0.8, 1.0, 3.0] if count == 1 else [0.3, 0.5, 0.8, 1.0]).map(
                lambda x: _um(x * d)
            ),
            "far_field": st.sampled_from(["none", "graded", "condensed"] if "width" in platens else ["none"]),
            "axial_softening": st.sampled_from([1.0, 3.0, 30.0, 1e3, 1e6]),
            "torsion": st.sampled_from(["dihedral"] if "twist" in assembly and level == "chain" else ["none"]),
        }
    else:
        options = {
            "depth": st.sampled_from([0.1, 1.0]).map(lambda x: _um(x * length)),
            "spring": st.sampled_from(["exact", "thesis"]),
            "torsional_spring": st.sampled_from(["exact", "thesis", "none"]),
        }
    for key, values in options.items():
        value = draw(_maybe(values, 3))
        if value is not None:
            model[key] = value
    if draw(st.integers(0, 7)) == 0:
        model["timestep"] = f"{draw(_decades(1e-6, 1e-2))} us"
    if calm:
        for table, key in ((platens, "speed"), (contact, "softening"), (contact, "law"), (model, "timestep")):
            table.pop(key, None)
        platens["stop"] = {"displacement": _um(d * (draw(st.sampled_from([0.45, 1.0])) if count > 6 else 0.3))}
        model.pop("axial_softening", None)
    output = {"frames": draw(st.sampled_from([2, 10, 30])), "samples": draw(st.sampled_from([10, 40, 100]))}
    return {
        "filament": filament,
        "assembly": assembly,
        "ends": ends,
        "platens": platens,
        "contact": contact,
        "model": model,
        "output": output,
    }


def _um(value: float) -> str:
    return f"{value:.6g} um"


def _number(text: str) -> float:
    return float(text.split()[0])


def scenes_of(block: int, size: int = 25) -> list[dict[str, Any]]:
    """The ``size`` scenes of one block: the same number, the same scenes (of one version of hypothesis).

    Each from a seed of its own: hypothesis likes to repeat itself within one run.
    """
    return [_scene_of(block * size + i) for i in range(size)]


def _scene_of(number: int) -> dict[str, Any]:
    found: list[dict[str, Any]] = []

    @seed(number)
    @settings(
        max_examples=2, database=None, deadline=None, phases=[Phase.generate], suppress_health_check=list(HealthCheck)
    )
    @given(random_scenes())
    def collect(data: dict[str, Any]) -> None:
        found.append(copy.deepcopy(data))

    collect()
    return found[-1]  # the first is always the same, the simplest


@dataclass
class Fate:
    """What became of a scene: ``kind`` refused, stopped, flagged, trusted or dear; ``offence`` what must never be."""

    kind: str
    message: str = ""
    offence: str = ""
    seconds: float = 0.0
    change: float = math.nan
    guards: list[str] = field(default_factory=list)


def _kind_of(error: BaseException) -> tuple[str, str, str]:
    """(kind, message, offence) of what was raised."""
    text = f"{type(error).__name__}: {error}"
    if isinstance(error, InputError):
        key = error.key.split(".")[0] in TABLES and "." in error.key
        whole = key and bool(error.expected) and "\n" not in str(error) and "nan" not in error.expected
        return "refused", text, "" if whole else f"a refusal that says too little: {text}"
    if isinstance(error, EngineError):
        return "stopped", text, "" if error.reason and error.remedy else f"an engine error without a remedy: {text}"
    if isinstance(error, CgfibreError):
        return "stopped", text, f"not the error of a run: {text}"
    return "crashed", text, "".join(traceback.format_exception(error))[-1500:]


def planned(data: dict[str, Any]) -> tuple[Scene, Plan]:
    """Scene and plan; checks what every plan must hold."""
    scene = scene_from_dict(data)
    plan = make_plan(scene)
    numbers = [plan.timestep, plan.timestep_limit, plan.drag, plan.motion.first, plan.motion.last, plan.motion.growth]
    numbers += [plan.contact.kn, plan.contact.gamma, plan.platens.kn, plan.predicted_seconds, *plan.beads.mass]
    if not all(math.isfinite(x) and x > 0 for x in numbers):
        raise AssertionError(f"a plan that is not finite and positive: {numbers[:10]}")
    if plan.timestep >= plan.timestep_limit:
        raise AssertionError(f"time step {plan.timestep} above the limit {plan.timestep_limit}")
    return scene, plan


def built(data: dict[str, Any]) -> Fate:
    """Plan, build and assemble a scene without the engine: refused or built."""
    start = time.perf_counter()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            scene, plan = planned(data)
            system = build_system(scene, plan)
            deck = assemble(system, plan)
        columns = [np.asarray(c) for c in deck.data.atom_columns]
        if not all(np.all(np.isfinite(c)) for c in columns):
            raise AssertionError("a data file with values that are not finite")
        fate = Fate("built", f"{plan.level}, {plan.n_beads} beads, {plan.predicted_seconds:.3g} s")
    except Exception as error:
        fate = Fate(*_kind_of(error))
    fate.seconds = time.perf_counter() - start
    if fate.seconds > SLOW_BUILD:
        fate.offence = fate.offence or f"planning and building took {fate.seconds:.0f} s"
    return fate


def cost(plan: Plan) -> float:
    """Engine seconds, roughly; the plan's own prediction counts what comes before the first step."""
    bead = {"chain": 1e-7, "rod": 6e-7, "section": 3e-7}[plan.level]
    return plan.planned_steps * (1.5e-5 + bead * plan.n_beads)


def cheap(data: dict[str, Any], cap: float = CAP) -> dict[str, Any] | None:
    """The scene pressed less deep, cut shorter and then pressed faster until its planned time is at most ``cap`` s.

    None if nothing helps.

    Raises what planning raises.
    """
    scene, plan = planned(data)
    if cost(plan) <= cap:
        return data
    data = copy.deepcopy(data)
    d = scene.filament.diameter
    if plan.motion.planned_displacement > 0.3 * d and scene.platens.stop.kind in ("displacement", "thickness"):
        data["platens"]["stop"] = {"displacement": _um(0.3 * d)}
        scene, plan = planned(data)
    data["platens"].pop("hold", None)
    if "twist" not in data["assembly"] and data["platens"].get("width") is None:
        data["assembly"]["length"] = _um(min(scene.assembly.length, 12 * d))
        data["model"].pop("depth", None)
    for _ in range(4):
        _, plan = planned(data)
        if cost(plan) <= cap:
            return data
        faster = 1.2 * cost(plan) / cap
        speed = plan.motion.planned_displacement / (plan.motion.load_steps * plan.timestep) * faster
        if speed > 900:
            return None
        data["platens"]["speed"] = f"{speed:.4g} m/s"
    return None


def fate_of(data: dict[str, Any], folder: Path, check_speed: bool, cap: float = CAP) -> Fate:
    """Run a scene (made cheap) and say what became of it; with ``check_speed`` a trusted one runs at half speed too."""
    start = time.perf_counter()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            warnings.simplefilter("ignore", DeprecationWarning)
            affordable = cheap(data, cap)
            if affordable is None:
                return Fate("dear")
            fate = _run(affordable, folder, check_speed)
    except Exception as error:
        fate = Fate(*_kind_of(error))
        if fate.kind == "stopped":
            fate.offence = fate.offence or _readable(folder)
        if fate.kind == "refused" and (folder / "run").exists():
            fate.offence = f"refused after it had begun: {fate.message}"
    fate.seconds = time.perf_counter() - start
    if fate.seconds > SLOW_RUN:
        fate.offence = fate.offence or f"took {fate.seconds:.0f} s"
    return fate


def _run(data: dict[str, Any], folder: Path, check_speed: bool) -> Fate:
    folder.mkdir(parents=True)
    path = folder / "scene.toml"
    path.write_text(scene_from_dict(data).to_toml())
    end = time.perf_counter() + SLOW_RUN
    result = workflow.run_scene(path, workflow.RunOptions(folder / "run"), progress=_deadline(end))
    bad = [g.name for g in result.review.guards if not g.ok]
    if bad:
        return Fate("flagged", "; ".join(bad), guards=bad)
    fate = Fate("trusted")
    curve = result.curve
    if not all(np.all(np.isfinite(column)) for column in [*curve.columns.values(), curve.width_um]):
        fate.offence = "a trusted record that is not finite"
    elif result.review.quasi_static_um is None:
        fate.offence = "trusted, but quasi-static nowhere"
    elif check_speed:
        scene, plan = planned(data)
        slower = copy.deepcopy(data)
        slower["platens"] |= {"speed": f"{plan.motion.first / 2:.10g} m/s", "unload": False}
        slower["platens"].pop("hold", None)
        path.write_text(scene_from_dict(slower).to_toml())
        slow = workflow.run_scene(path, workflow.RunOptions(folder / "half"), progress=_deadline(end))
        fate.change = speed_change(curve, slow.curve, result.review.quasi_static_um)["mean"]
        if fate.change > WRONG * scene.model.accuracy:
            fate.offence = f"trusted, but half the speed changes the force by {fate.change:.1%}"
    return fate


class Overdue(Exception):
    """A run took longer than a scene may."""


def _deadline(end: float) -> workflow.Progress:
    def check(*_: object) -> None:
        if time.perf_counter() > end:
            raise Overdue(f"the run did not end in {SLOW_RUN:.0f} s")

    return check


def _readable(folder: Path) -> str:
    """What is wrong with what a stopped run left, if anything."""
    run = folder / "run"
    record = run / "deck" / "record.txt"
    if not record.exists() or len(record.read_text().splitlines()) < 4:
        return ""  # it never came to a first row
    try:
        stored = store.read_results(run / "results.h5")
    except Exception as error:
        return f"a stopped run whose results cannot be read: {type(error).__name__}: {error}"
    return "" if len(stored.curve) and not stored.summary["trusted"] else "a stopped run that is trusted"


__all__ = ["Fate", "built", "cheap", "fate_of", "random_scenes", "scenes_of"]
