"""Platen motion of a weave: as fast as the fabric, a mass on the stiffness that it has at each load, lets it be."""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np

from cgfibre.build.system import FloatArray
from cgfibre.plan.model import Choice, Motion, Sampling
from cgfibre.plan.motion import BLOCK, CHECKPOINTS, READINGS, SPEED_RATIO, film_time
from cgfibre.scene import Scene

#: part of the load at the stop from which on the accuracy asked for shall hold
REFERENCE_LOAD = 0.1
#: the accuracy over which the platen's bound is taken, over that asked for
GAIN = 1.0


class Estimate(Protocol):
    """What a fabric is expected to do between platens; forces nN on the whole cell, displacements um."""

    def displacement(self, force: float) -> float:
        """Of the platen at a force."""

    def force(self, displacement: float) -> float:
        """At a displacement of the platen."""

    def stiffness(self, force: float) -> float:
        """Tangent nN/um at a force."""


def plan_pressing(
    scene: Scene, estimate: Estimate, mass: float, timestep: float, depth: float, load: float
) -> tuple[Motion, Sampling, list[Choice]]:
    """Speeds, phases and sampling: v <= eps F/sqrt(k m) of the whole fabric on its own stiffness, growing with F."""
    eps = GAIN * scene.model.accuracy
    reference = estimate.displacement(REFERENCE_LOAD * load)
    d = np.linspace(min(reference, depth / 2), depth, 60)
    force = np.array([estimate.force(float(x)) for x in d])
    stiffness = np.array([estimate.stiffness(f) for f in force])
    bound = eps * force / np.sqrt(stiffness * mass)
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
    unload = scene.platens.unload
    phases = 2 if unload else 1
    total = film_time(first, last, growth, depth) / timestep
    every = max(1, round(total * phases / scene.output.samples / READINGS))
    sample = every * READINGS
    load_steps = max(sample, math.ceil(total / sample) * sample)
    first, last = first * total / load_steps, last * total / load_steps
    hold = math.ceil(scene.platens.hold / timestep / sample) * sample
    planned = load_steps * phases + hold
    frame = max(1, round(planned / scene.output.frames / sample)) * sample
    checkpoint = max(1, round(planned / CHECKPOINTS / frame)) * frame
    stop = scene.platens.stop
    motion = Motion(
        first=first,
        last=last,
        growth=growth,
        load_steps=load_steps,
        hold_steps=hold,
        unload=unload,
        stop_force=stop.force if stop.force is not None else math.inf,
        stop_pressure=stop.pressure if stop.pressure is not None else math.inf,
        planned_displacement=depth,
        quasi_static_impedance=impedance,
        eps=eps,
        fastest=math.inf,
        pace=_pace((first, last, growth), allowed, d),
    )
    block = math.ceil(BLOCK / sample) * sample
    return motion, Sampling(sample, every, frame, checkpoint, block), choices


def _pace(speeds: tuple[float, float, float], allowed: tuple[float, float, float], d: FloatArray) -> float:
    """Mean over displacements of one (first, last, growth) over another."""

    def speed(of: tuple[float, float, float]) -> FloatArray:
        return np.minimum(of[0] * (1 + d / of[2]), of[1])

    return float(np.mean(speed(speeds) / speed(allowed)))
