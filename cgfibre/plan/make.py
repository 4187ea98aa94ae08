"""From a scene to a plan: one planner a level, in a table to extend."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cgfibre.errors import InputError
from cgfibre.plan.filaments import plan_filaments
from cgfibre.plan.level import choose_level
from cgfibre.plan.model import Choice, Plan
from cgfibre.plan.outline import Outline, outline
from cgfibre.plan.section import plan_section
from cgfibre.plan.subbundle import plan_subbundle
from cgfibre.plan.weave import plan_weave
from cgfibre.scene import Scene
from cgfibre.scene_reading import scene_from_dict

PLANNERS: dict[str, Callable[[Scene, Outline, str, list[Choice]], Plan]] = {
    "chain": plan_filaments,
    "rod": plan_filaments,
    "section": plan_section,
    "subbundle": plan_subbundle,
}


def make_plan(scene: Scene) -> Plan:
    """The plan of a scene; InputError names what in the scene cannot be modelled."""
    if scene.is_weave:
        return plan_weave(scene)
    out = outline(scene)
    level = choose_level(scene, out)
    if level.value not in PLANNERS:
        raise InputError("model.level", level.value, "one of " + ", ".join(PLANNERS))
    return PLANNERS[level.value](scene, out, level.value, [level, *_placing(scene, out)])


def _placing(scene: Scene, out: Outline) -> list[Choice]:
    """How far centres from a file were moved to clear their overlaps."""
    if scene.bundle.centres is None:
        return []
    asked = np.array(scene.bundle.centres)
    moved = np.hypot(*(out.centres - (asked - asked.mean(axis=0))).T)
    n = int(np.sum(moved > 1e-6 * scene.filament.diameter))
    if n == 0:
        return [Choice("centres", f"{len(asked)} from the file", "as they are: no two filaments overlap")]
    reason = f"{n} moved by up to {moved.max():.3g} um (r.m.s. of all {np.sqrt(np.mean(moved**2)):.2g} um)"
    return [Choice("centres", f"{len(asked)} from the file", f"{reason}: the least that clears all overlaps")]


def other_shape(scene: Scene, planned: str, level: str) -> InputError | None:
    """Why a scene planned at one level is another experiment at ``level``: crimped platens are curved along the
    filaments, in a section across them. None where it is the same."""
    if scene.platens.shape != "crimped" or (planned == "section") == (level == "section"):
        return None
    way = "across" if planned == "section" else "along"
    return InputError(
        "platens.shape", "crimped", f"'flat' at level {level}: here platens are curved {way} the filaments"
    )


def other_levels(scene: Scene, plan: Plan) -> dict[str, Plan | InputError]:
    """What the scene would be at every other level: its plan, or why it cannot be. Of a weave: as rods or chains, with
    its tows or with all their filaments."""
    found: dict[str, Plan | InputError] = {}
    if plan.woven is not None:
        level = "rod" if plan.level == "chain" else "chain"
        found[level] = _planned(scene, {"resolve": plan.woven.resolve, "level": level})
        resolve = "filament" if plan.woven.resolve == "tow" else "tow"
        found[resolve] = _planned(
            scene, {"resolve": resolve, "spacing": "auto"}, without=("law", "stiffness", "rise", "table")
        )
        return found
    for level in PLANNERS:
        if level == plan.level:
            continue
        refused = other_shape(scene, plan.level, level)
        if refused is not None:
            found[level] = refused
            continue
        found[level] = _planned(scene, {"level": level})
    return found


def _planned(scene: Scene, model: dict[str, str], without: tuple[str, ...] = ()) -> Plan | InputError:
    """Plan of the scene with these keys of ``[model]``, ``without`` some of ``[contact]``; or why there is none."""
    asked = scene.model_dump(exclude_none=True)
    asked["model"] |= model
    asked["contact"] = {key: value for key, value in asked["contact"].items() if key not in without}
    try:
        return make_plan(scene_from_dict(asked))
    except InputError as error:
        return error
