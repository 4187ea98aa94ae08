"""One deck of a plan in a folder of its own: written, run to its end, or gone on with after a kill."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from cgfibre.build.system import FilamentSystem
from cgfibre.engine.assemble import Deck, assemble
from cgfibre.engine.datafile import write_data
from cgfibre.engine.deck import write_deck
from cgfibre.engine.dump import last_row, mend_tables, read_states
from cgfibre.engine.lammps import Engine, EngineTime, find_engine, run_deck
from cgfibre.engine.plugin import copy_plugin, needs_plugin, plugin_variables
from cgfibre.plan.model import Plan

#: progress: (done steps, planned steps, displacement um, force N)
Progress = Callable[[int, int, float, float], None]
#: a line for the user
Note = Callable[[str], None]


@dataclass(frozen=True)
class Watch:
    """Who is told about a run and who may stop it; all optional."""

    progress: Progress | None = None
    note: Note | None = None
    cancelled: Callable[[], bool] | None = None


def is_written(folder: Path) -> bool:
    """Whether the deck in the folder is whole: its last file is there."""
    return (folder / "system.data").exists()


def is_finished(folder: Path) -> bool:
    """Whether the deck in the folder ran to its end."""
    states = read_states(folder) if folder.is_dir() else []
    return bool(states) and states[0].phase >= 3


def write_job(folder: Path, system: FilamentSystem, plan: Plan, about: str, engine: Engine | None = None) -> Path:
    """Write the deck of a plan into ``folder``, with ``about`` in its README; returns the folder.

    A deck that needs the plugin gets its sources and the library that fits ``engine`` (None: the default one), if any.
    """
    deck: Deck = assemble(system, plan)
    write_deck(folder, deck.name, deck.parameters, about)
    if needs_plugin(folder):
        copy_plugin(folder, engine or find_engine())
    write_tables(folder, deck)
    # last and at once: where system.data is, the deck is whole
    write_data(folder / "system.data.part", deck.data)
    os.replace(folder / "system.data.part", folder / "system.data")
    return folder


def write_tables(folder: Path, deck: Deck) -> None:
    """Write the files that a deck reads beside its data file."""
    for name, column in deck.tables.items():
        (folder / name).write_text("".join(f"{x:.17g}\n" for x in column.tolist()))
    for name, text in deck.texts.items():
        (folder / name).write_text(text)


def run_job(
    engine: Engine, folder: Path, plan: Plan, ranks: int, resume: bool, watch: Watch | None = None
) -> EngineTime | None:
    """Run the deck in ``folder``, or go on with it; returns the time that the engine took, None when it had ended.

    Raises EngineError when the engine stops, or when ``watch.cancelled`` says so.
    """
    watch = watch or Watch()
    if resume and is_finished(folder):
        return None
    variables = plugin_variables(folder, engine)
    if resume:
        states = read_states(folder)
        if states:
            variables |= {"resume": "1", "state": states[0].file}
            mend_tables(folder)
            if watch.note:
                watch.note(f"going on from step {states[0].step} of about {plan.planned_steps}")
        else:
            for name in ("record.txt", "extremes.txt", "balance.txt", "cell.txt", "trajectory.lammpstrj"):
                (folder / name).unlink(missing_ok=True)

    def poll() -> None:
        row = last_row(folder / "record.txt")
        if watch.progress is not None and row is not None and len(row) > 2:
            watch.progress(int(row[0]), plan.planned_steps, row[1], row[2] * 1e-9)

    deck = next(folder.glob("in.*")).name
    return run_deck(engine, folder, deck, ranks, variables, poll, watch.cancelled)
