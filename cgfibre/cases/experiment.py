"""Small assemblies through the engine's own decks, with commands of an experiment's own."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from cgfibre.build.system import FilamentSystem, FloatArray
from cgfibre.engine.assemble import assemble
from cgfibre.engine.datafile import write_data
from cgfibre.engine.deck import write_deck
from cgfibre.engine.dump import RawRecord, read_record
from cgfibre.engine.job import write_tables
from cgfibre.engine.lammps import EngineTime, find_engine, run_deck
from cgfibre.engine.plugin import copy_plugin, needs_plugin, plugin_variables
from cgfibre.plan.make import make_plan
from cgfibre.plan.model import Plan
from cgfibre.plan.system import build_system
from cgfibre.scene import Scene
from cgfibre.scene_reading import scene_from_dict

#: one 0.7 mm carbon filament
SCENE = {
    "filament": {"material": "T700 carbon"},
    "assembly": {"count": 1, "length": "0.7 mm"},
    "platens": {"stop": {"displacement": "1 um"}, "friction": 0.0},
    "contact": {"shape": "beads"},
}
#: what a level's name ends with where filaments touch along their segments
CAPSULES = ", capsules"


def deck_level(level: str) -> str:
    """Level of the deck: "chain" of "chain, capsules"."""
    return level.removesuffix(CAPSULES)


def scene(changes: Mapping[str, object]) -> Scene:
    """SCENE with dotted keys set; the level "chain, capsules" is a chain with contact.shape = "capsule"."""
    data: dict[str, Any] = copy.deepcopy(SCENE)
    for key, value in changes.items():
        *parents, last = key.split(".")
        table = data
        for parent in parents:
            table = table.setdefault(parent, {})
        table[last] = value
    model = data.setdefault("model", {})
    level = str(model.get("level", ""))
    if level.endswith(CAPSULES):
        model["level"] = deck_level(level)
        data["contact"]["shape"] = "capsule"
    if model.get("level") != "section":  # commands of experiments speak of both ends
        model.setdefault("symmetry", "none")
        if "spacing" not in model:
            model["spacing"] = f"{scene_from_dict(data).filament.diameter} um"
    return scene_from_dict(data)


def planned(changes: Mapping[str, object]) -> tuple[Plan, FilamentSystem]:
    """Plan and assembly of SCENE with dotted keys set."""
    s = scene(changes)
    plan = make_plan(s)
    return plan, build_system(s, plan)


def pressed_at(plan: Plan, lo: float, hi: float) -> Plan:
    """The top platen over lo <= x <= hi alone."""
    return replace(plan, platens=replace(plan.platens, top_span=(lo, hi)))


def moved(plan: Plan, speed: float, load: int, hold: int = 0, sample: int = 1000) -> Plan:
    """Even platen speed, steps of loading and holding, the rows of the record."""
    motion = replace(plan.motion.first_loading(), first=speed, last=speed, growth=1.0, load_steps=load, hold_steps=hold)
    whole = load + hold
    sampling = replace(
        plan.sampling, sample=sample, every=max(1, sample // 20), frame=whole, checkpoint=whole, block=sample
    )
    return replace(plan, motion=motion, sampling=sampling)


@dataclass(frozen=True)
class Outcome:
    """What a deck left: its record, the engine's time, and the rows of files that the experiment's commands wrote."""

    folder: Path
    record: RawRecord
    time: EngineTime

    def rows(self, name: str) -> FloatArray:
        """Rows of a table of numbers in the folder."""
        return np.loadtxt(self.folder / name, ndmin=2)


def run(
    folder: Path, system: FilamentSystem, plan: Plan, commands: Sequence[str] = (), **variables: float | str
) -> Outcome:
    """Write the deck of the plan's level and run it; ``commands`` go before its phases, as a user may add them.

    ``variables`` go to the deck as ``-var``; they may be where the method fails (the deck's checks are off, unless
    ``unsafe`` is 0). Raises EngineError when the engine stops.
    """
    return run_on(1, folder, system, plan, commands, variables)


def run_on(
    ranks: int,
    folder: Path,
    system: FilamentSystem,
    plan: Plan,
    commands: Sequence[str] = (),
    variables: Mapping[str, float | str] = MappingProxyType({}),
) -> Outcome:
    """:func:`run` on a number of MPI ranks."""
    deck = assemble(system, plan)
    write_deck(folder, deck.name, deck.parameters, "cgfibre experiment")
    write_data(folder / "system.data", deck.data)
    write_tables(folder, deck)
    text = (folder / deck.name).read_text()
    last = "include         phases.inc"
    if text.count(last) != 1:
        raise ValueError(f"{deck.name} has no line of its own for the phases")
    (folder / deck.name).write_text(text.replace(last, "\n".join([*commands, last])))
    engine = find_engine()
    if needs_plugin(folder):
        copy_plugin(folder, engine)
    given = {"unsafe": "1"} | plugin_variables(folder, engine) | {k: str(v) for k, v in variables.items()}
    spent = run_deck(engine, folder, deck.name, ranks, given)
    return Outcome(folder, read_record(folder), spent)


@dataclass(frozen=True)
class Measured:
    """One number of an experiment beside its closed form.

    ``case`` what was tried; ``level`` of the model; ``spacing`` s/D (0 for a section); ``quantity`` and ``unit`` of
    ``value`` and ``exact``; ``cpu`` processor seconds of the engine; ``stated`` relative error that theory gives for
    the method itself at this spacing (0: none known).
    """

    case: str
    level: str
    spacing: float
    quantity: str
    unit: str
    value: float
    exact: float
    cpu: float
    stated: float = 0.0

    @property
    def error(self) -> float:
        """Relative error value/exact - 1; where the closed form is 0, the value itself."""
        return self.value / self.exact - 1 if self.exact else self.value
