"""Platen motion of a weave: as fast as the fabric, a mass on the stiffness that it has at each load, lets it be."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from cgfibre.plan.model import Choice, Motion, Sampling
from cgfibre.plan.motion import SPEED_RATIO, film_time, in_steps, mean_pace, target
from cgfibre.scene import Scene

#: part of the load at the stop from which on the accuracy asked for shall hold
REFERENCE_LOAD = 0.1
#: the accuracy over which the platen's bound is taken, over that asked for
GAIN = 1.0
#: periods of the fabric over which it is strained, sheared or pulled in its plane: while the platens stand, and the
#: least while they go
PREPARATION, ALONGSIDE = 30.0, 10.0


class Estimate(Protocol):
    """What a fabric is expected to do between platens; forces nN on the whole cell, displacements um."""

    def displacement(self, force: float) -> float:
        """Of the platen at a force."""

    def force(self, displacement: float) -> float:
        """At a displacement of the platen."""

    def stiffness(self, force: float) -> float:
        """Tangent nN/um at a force."""


@dataclass(frozen=True)
class Stops:
    """The planned stop: displacement ``depth`` um and ``load`` nN there; ``earlier`` um of the cycles before it."""

    depth: float
    load: float
    earlier: tuple[float, ...] = ()


def way_in_plane(scene: Scene, stops: Stops) -> float:
    """Way of the platen over which the fabric is loaded in its plane (cell.when = "during"), um.

    "auto": of the first loading's planned way all where it stops by place, a third where it stops by load: such ways
    are planned longer than needed.
    """
    if scene.in_plane.over != "auto":
        return float(scene.in_plane.over)
    first = scene.platens.cycles[0] if scene.platens.cycles else scene.platens.stop
    depth = stops.earlier[0] if stops.earlier else stops.depth
    return depth if first.kind in ("displacement", "thickness") else depth / 3


def preparation_steps(scene: Scene, period: float, timestep: float) -> int:
    """Steps of loading in the plane while the platens stand; ``period`` us of the fabric, ``timestep`` us."""
    cell = scene.in_plane
    return 0 if cell.at_rest or cell.when == "during" else math.ceil(PREPARATION * period / timestep)


def plan_pressing(
    scene: Scene, estimate: Estimate, mass: float, timestep: float, stops: Stops
) -> tuple[Motion, Sampling, list[Choice]]:
    """Speeds, phases and sampling: v <= eps F/sqrt(k m) of the whole fabric, ``mass`` pg on its own stiffness, growing
    with F."""
    depth, load = stops.depth, stops.load
    eps = GAIN * scene.model.accuracy
    reference = estimate.displacement(REFERENCE_LOAD * load)
    d = np.linspace(reference if reference < 0.9 * depth else depth / 2, depth, 60)
    force = np.array([estimate.force(float(x)) for x in d])
    stiffness = np.array([estimate.stiffness(f) for f in force])
    bound = eps * force / np.sqrt(stiffness * mass)
    cell = scene.in_plane
    during = cell.when == "during" and not cell.at_rest
    period = 2 * math.pi * math.sqrt(mass / estimate.stiffness(REFERENCE_LOAD * load))
    first = float(bound[0]) / 2
    rise = np.minimum.accumulate(bound[::-1])[::-1] / first - 1
    growth = float(np.max(d / np.clip(rise, 1e-3, SPEED_RATIO - 1)))
    last = first * min(SPEED_RATIO, 1 + depth / growth)
    allowed = (first, last, growth)
    choices = []
    if scene.platens.speed == "auto":
        reason = f"v <= eps F/sqrt(k m) of the fabric on its contacts, eps = {eps:g}, from {REFERENCE_LOAD:.0%} load"
        most = scene.model.most_steps
        if most != "auto":
            faster = film_time(first, last, growth, depth) / timestep / most
            if faster > 1:
                first, last = first * faster, last * faster
                reason += f"; raised {faster:.3g} times to end within {most:.2g} steps"
        if during:
            way = way_in_plane(scene, stops)
            slower = max(1.0, ALONGSIDE * period / film_time(first, last, growth, way))
            first, last = first / slower, last / slower
            reason += f"; {ALONGSIDE:g} periods of the fabric at least for its loading in the plane"
        choices.append(Choice("platen speed", f"{first:.3g} to {last:.3g} m/s", reason))
    else:
        first = last = float(scene.platens.speed)
        growth = depth
        choices.append(Choice("platen speed", f"{first:.4g} m/s", "as asked in the scene"))
    impedance = math.sqrt(float(stiffness[0]) * mass) / eps
    choices.append(
        Choice(
            "quasi-static above",
            f"{impedance * first * 1e-9:.2g} N at first touch, {impedance * last * 1e-9:.2g} N at {last:.3g} m/s",
            "v sqrt(k m)/eps: below it inertia is more than the accuracy asked for",
        )
    )
    length = scene.weave.size[0]
    each = [cycle for cycle in scene.platens.cycles for _ in range(cycle.times)]
    cycles = tuple(target(s, x, length) for s, x in zip(each, stops.earlier, strict=True))
    if cycles:
        why = "unloaded till the platen feels nothing, then loaded from there as the first time"
        choices.append(Choice("cycles", f"{len(cycles)} before the last loading", why))
    main = target(scene.platens.stop, depth, length)
    motion = Motion(
        first=first,
        last=last,
        growth=growth,
        load_steps=0,
        hold_steps=0,
        unload=scene.platens.unload,
        stop_force=main.force,
        stop_pressure=main.pressure,
        planned_displacement=depth,
        quasi_static_impedance=impedance,
        eps=eps,
        fastest=math.inf,
        cycles=cycles,
    )
    held = preparation_steps(scene, period, timestep) if cell.when == "after" else 0
    motion, sampling = in_steps(scene, motion, timestep, held)
    pace = mean_pace((motion.first, motion.last, growth), allowed, d)
    return replace(motion, pace=pace), sampling, choices
