"""Copy the template decks and the values they take into a folder that runs without Python."""

from __future__ import annotations

import re
import shutil
from collections.abc import Mapping
from pathlib import Path

DECLARATION = re.compile(r"^variable\s+(\w+)\s+index\s+(\S+)\s*(?:#\s*(.*))?$", re.M)
INCLUDE = re.compile(r"^\s*include\s+(\S+)", re.M)


def template_folder() -> Path:
    """Where the template decks lie: inside an installed package, or beside it in a checkout."""
    package = Path(__file__).resolve().parent.parent
    for folder in (package / "templates", package.parent / "templates"):
        if (folder / "defaults.inc").exists():
            return folder
    raise FileNotFoundError("the LAMMPS templates are not where the package expects them; install cgfibre again")


def deck_files(deck: str, values: Mapping[str, str]) -> list[str]:
    """Files that ``deck`` needs, by its includes; ``${name}`` in a file name takes the value it will have."""
    folder = template_folder()
    declared = declared_variables(deck)
    todo, files = [deck], []
    while todo:
        name = todo.pop()
        if name in files or name == "parameters.inc":
            continue
        text = (folder / name).read_text()
        files.append(name)
        for target in INCLUDE.findall(text):
            todo.append(re.sub(r"\$\{(\w+)\}", lambda m: str(values.get(m[1], declared.get(m[1], m[0]))), target))
    return files


def declared_variables(deck: str) -> dict[str, str]:
    """Tunables that a deck declares, with their defaults."""
    text = (template_folder() / deck).read_text() + (template_folder() / "defaults.inc").read_text()
    return {name: value for name, value, _ in DECLARATION.findall(text)}


def _number(value: float | int | str) -> str:
    if isinstance(value, str):
        return f'"{value}"' if " " in value else value  # one value of the variable, not several
    return f"{value:.17g}" if isinstance(value, float) else str(value)


def write_deck(folder: Path, deck: str, parameters: Mapping[str, float | int | str], about: str) -> None:
    """Write the deck, its includes, parameters.inc and a README into ``folder``.

    Raises ValueError on a parameter the deck does not declare: the engine itself would take it in silence.
    """
    folder.mkdir(parents=True, exist_ok=True)
    values = {name: _number(value) for name, value in parameters.items()}
    declared = declared_variables(deck)
    unknown = sorted(set(values) - set(declared))
    if unknown:
        raise ValueError(f"{deck} declares no variable {', '.join(unknown)}")
    files = deck_files(deck, values)
    for name in files:
        shutil.copyfile(template_folder() / name, folder / name)
    lines = ["# The scene's values; -var on the command line wins over them.\n"]
    lines += [f"variable {name} index {value}\n" for name, value in values.items()]
    (folder / "parameters.inc").write_text("".join(lines))
    text = DECK_README + (PLUGIN_README if "plugin.inc" in files else "")
    (folder / "README").write_text(text.format(deck=deck, about=about))


DECK_README = """{about}

This folder is a complete LAMMPS deck; it needs LAMMPS with the packages MOLECULE, GRANULAR and BPM
(for twist of curved filaments and of flat tows EXTRA-MOLECULE), and no Python.

    lmp -in {deck}
    mpiexec -n 2 lmp -in {deck}

{deck}            the deck; its includes are the *.inc files beside it
parameters.inc    the values of the scene; every one can be overridden: -var name value
system.data       the assembly

It writes
record.txt            means over sampling windows: displacement (um), force on the top and the bottom platen (nN),
                      kinetic and stored energy (nN um), width under the platen (um), pressure (kPa), path of the
                      loaded ends (um)
extremes.txt          extents, closest pair (um) and largest turn (rad) at the end of each window
balance.txt           of a section: force of the springs and of the drag (nN), momentum (nN us), energy of the contacts
                      (nN um), how many times stiffer contacts have become, largest way of a disc from its place (um)
cell.txt              of a weave that is loaded in its plane: tension on all warp and all weft tows (nN), couple against
                      a change of their angle (nN um), edges along them (um), turn of the weft (rad)
trajectory.lammpstrj  frames (um) that OVITO, VMD and MDAnalysis read
checkpoint.0, .1      restarts, written by turns; state.0, state.1 say what they hold
log.lammps            the engine's own log

To go on after a stop, take the state file with the larger step_at that ends in "# complete":

    lmp -in {deck} -var resume 1 -var state state.0

`cgfibre measure` on the folder above derives curve, statistics and pictures from these files.
"""

PLUGIN_README = """
This deck loads the cgfibre plugin: cgfibre_plugin.so, compiled for the LAMMPS that cgfibre_plugin.json names (version,
MPI, integer sizes). Any other refuses it; compile the sources in plugin/ for yours, then name the result:

    make -C plugin LAMMPS=/path/to/lammps/src
    lmp -in {deck} -var plugin plugin/cgfibre_plugin.so
"""
