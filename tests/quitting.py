"""Decks whose engine quits right behind a checkpoint, for the tests of what resumed runs repeat."""

import pytest

from cgfibre.engine.dump import read_states
from cgfibre.engine.lammps import find_engine, run_deck
from cgfibre.errors import EngineError

#: of phases.inc: what follows the state of a checkpoint
BEHIND = "variable        slot equal 1-${slot}\n"


def quit_when(folder, deck, condition, variables=None):
    """Run the deck until the ``condition`` (of LAMMPS' if) holds behind a checkpoint; the states it left, newest first.
    The deck's files are afterwards as they were."""
    phases = (folder / "phases.inc").read_text()
    assert phases.count(BEHIND) == 1
    (folder / "phases.inc").write_text(phases.replace(BEHIND, f'if "{condition}" then "quit 1"\n' + BEHIND))
    with pytest.raises(EngineError):
        run_deck(find_engine(), folder, deck, variables=variables or {})
    (folder / "phases.inc").write_text(phases)
    return read_states(folder)
