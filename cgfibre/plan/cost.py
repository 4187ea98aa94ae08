"""How long a plan takes: engine seconds on one core, from constants measured on the machine named below."""

from __future__ import annotations

from dataclasses import dataclass

from cgfibre.plan.model import Motion, Sampling


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
START = 0.3  # seconds to start the engine and read the assembly


def predicted_seconds(level: str, n_beads: int, motion: Motion, sampling: Sampling) -> float:
    """Engine seconds on one core; a stop by force or pressure comes earlier."""
    cost = COSTS[level]
    return START + (cost.step + cost.bead * n_beads + cost.block / sampling.block) * motion.planned_steps
