"""How long a plan takes: engine seconds on one core, from constants measured on the machine named below."""

from __future__ import annotations

from dataclasses import dataclass

from cgfibre.plan.model import Motion, Ribbon, Sampling, Woven


@dataclass(frozen=True)
class Cost:
    """Seconds of a level: ``step`` a step however few the beads, ``bead`` a bead and step, ``block`` a block."""

    step: float
    bead: float
    block: float


#: fitted to the runs of analysis/planner_scenes.py on one core of an AMD EPYC (2 cores, 2026), wheel 2025.7.22.4
COSTS = {
    "chain": Cost(step=7e-6, bead=6.2e-8, block=1e-4),
    "rod": Cost(step=7e-6, bead=2.8e-7, block=1e-4),
    "chain, capsules": Cost(step=7e-6, bead=1.1e-7, block=1e-4),
    "rod, capsules": Cost(step=7e-6, bead=5e-7, block=1e-4),
    "section": Cost(step=3.5e-6, bead=9e-8, block=1e-4),
    "subbundle": Cost(step=6e-6, bead=3e-7, block=1e-4),
}
PLANE = 5e-5  # seconds a step while a weave is loaded in its plane: variables of the deck
#: more a bead and step of chains in weaves: forces of rest, contacts seen from both sides, neighbours on all sides;
#: within 1.5 of the time of seven weaves of 400 to 12 500 beads
WOVEN = {"chain": 3.5e-8, "chain, capsules": 1e-7}
START = 0.3  # seconds to start the engine and read the assembly


#: more a bead and step where chains are joined by rungs and twist, and where they have turns in their plane too
RUNGS, TURNS = 3e-8, 4e-8


def joint_cost(ribbon: Ribbon | None) -> float:
    """Seconds a bead and step of what joins the chains of flat tows."""
    return 0.0 if ribbon is None else RUNGS + (TURNS if any(ribbon.reach) else 0.0)


def predicted_seconds(
    level: str, n_beads: int, motion: Motion, sampling: Sampling, joints: float = 0.0, woven: Woven | None = None
) -> float:
    """Engine seconds on one core, with those that the platens wait; a stop by force or pressure comes earlier.

    ``joints``: see :func:`joint_cost`.
    """
    cost = COSTS[level]
    steps, before = motion.planned_steps, woven.steps_before if woven else 0
    bead = cost.bead + joints + (WOVEN.get(level, 0.0) if woven is not None else 0.0)
    each = cost.step + bead * n_beads + cost.block / sampling.block
    found = START + each * (steps + before)
    if woven is not None and woven.moved:
        stays = woven.when == "before" and woven.tension == (None, None)
        found += PLANE * (before if stays else steps + before)
    return found
