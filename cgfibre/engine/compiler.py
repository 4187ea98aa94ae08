"""Compile C++ sources into one shared library: which compiler, which flags, and what went wrong in one line.

Knows nothing of LAMMPS; needs the standard library alone, for the build hook of the wheel uses it too.
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

from cgfibre.errors import EngineError

NAMES = ("g++", "c++", "clang++")
#: no -march: a wheel runs elsewhere. Never -ffast-math: it would take the checks for NaN away.
OPTIMISED = ("-O3", "-fno-math-errno", "-fno-trapping-math")
SANITIZED = ("-O1", "-g", "-fno-omit-frame-pointer", "-fsanitize=address,undefined", "-fno-sanitize-recover=undefined")
COMMON = ("-std=c++17", "-fPIC", "-Wall", "-Wextra")
TIMEOUT = 900  # s a source
INSTALL = (
    "install one (Debian: apt install g++) or name it with the environment variable CXX, then cgfibre plugin build; "
    "without the plugin everything works with beads"
)


class NoCompilerError(EngineError):
    """There is no C++ compiler here."""


@dataclass(frozen=True)
class Compiler:
    """A C++ compiler: its command and what it calls itself."""

    command: tuple[str, ...]
    version: str


@dataclass(frozen=True)
class Compilation:
    """Sources to compile, with the folders of other people's headers (their warnings are not ours), and macros."""

    sources: tuple[Path, ...]
    include: tuple[Path, ...]
    macros: Mapping[str, str] = field(default_factory=dict)
    sanitize: bool = False

    @property
    def flags(self) -> tuple[str, ...]:
        """Flags of the compiler that do not depend on the machine."""
        return (*COMMON, *(SANITIZED if self.sanitize else OPTIMISED))

    @property
    def arguments(self) -> list[str]:
        """All that the compiler is told beside the source."""
        headers = [word for folder in self.include for word in ("-isystem", str(folder))]
        return [*self.flags, *headers, *(f"-D{name}={value}" for name, value in self.macros.items())]


def find_compiler() -> Compiler:
    """The C++ compiler that CXX names, else the first of g++, c++, clang++ on the PATH.

    Raises NoCompilerError when there is none, or when CXX names no program that runs.
    """
    named = shlex.split(os.environ.get("CXX", ""))
    program = shutil.which(named[0]) if named else next(filter(None, map(shutil.which, NAMES)), None)
    if program is None:
        what = f"CXX = {named[0]!r} is no program" if named else f"no C++ compiler ({', '.join(NAMES)}) is on the PATH"
        raise NoCompilerError(what, INSTALL)
    command = (program, *named[1:])
    try:
        said = subprocess.run([*command, "--version"], capture_output=True, text=True, timeout=60, check=True).stdout
    except (OSError, subprocess.SubprocessError) as error:
        raise NoCompilerError(f"the C++ compiler {program} does not run: {error}", INSTALL) from error
    return Compiler(command, said.splitlines()[0].strip() if said else program)


def macros(compiler: Compiler, text: str, include: Sequence[Path]) -> dict[str, str]:
    """All macros defined after ``text`` (a few lines of C++), by name; EngineError when it does not compile."""
    headers = [word for folder in include for word in ("-isystem", str(folder))]
    done = subprocess.run(
        [*compiler.command, *COMMON, *headers, "-dM", "-E", "-x", "c++", "-"],
        input=text,
        capture_output=True,
        text=True,
        timeout=TIMEOUT,
        check=False,
    )
    if done.returncode != 0:
        raise EngineError(*_diagnose(done.stderr, "the headers of LAMMPS"))
    lines = (line.split(maxsplit=2) for line in done.stdout.splitlines())
    return {words[1]: words[2] if len(words) > 2 else "" for words in lines}


def compile_library(
    compiler: Compiler, what: Compilation, library: Path, note: Callable[[str], None] | None = None
) -> str:
    """Compile and link ``library``, two sources at a time; returns the compiler's warnings (empty: none).

    Raises EngineError with the first error and a remedy.
    """
    with tempfile.TemporaryDirectory(dir=library.parent, prefix=".objects-") as name:
        objects = [Path(name) / f"{source.stem}.o" for source in what.sources]

        def one(source: Path, target: Path) -> str:
            said = _run([*compiler.command, *what.arguments, "-c", str(source), "-o", str(target)], source.name)
            if note is not None:
                note(f"compiled {source.name}")
            return said

        with ThreadPoolExecutor(min(2, os.cpu_count() or 1)) as pool:
            warnings = list(pool.map(one, what.sources, objects))
        words = [*compiler.command, *what.flags, "-shared", *map(str, objects), "-o", str(library)]
        warnings.append(_run(words, "the library"))
    return "".join(warnings)


def _run(command: Sequence[str], what: str) -> str:
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT, check=False)
    except (OSError, subprocess.SubprocessError) as error:
        raise EngineError(f"the compiler stopped at {what}: {error}", "free memory or disk, then once more") from error
    if done.returncode != 0:
        raise EngineError(*_diagnose(done.stderr, what))
    return done.stderr


def _diagnose(text: str, what: str) -> tuple[str, str]:
    lines = text.strip().splitlines() or ["no message"]
    first = next((line for line in lines if re.search(r"\berror\b", line)), lines[0]).strip()
    missing = re.search(r"error: '?([\w./]+\.h)'?( file not found|: No such file)", first)
    if missing and missing[1] == "mpi.h":
        remedy = "name the folder of mpi.h of the MPI that LAMMPS was built with: --mpi-include DIR"
    elif missing:
        remedy = "give the headers of a whole LAMMPS: its src or its install's include folder (--headers DIR)"
    elif re.search(r"No space left", text):
        remedy = "free space, then once more"
    else:
        remedy = "use headers of LAMMPS 22 Jul 2025 or newer and g++ 9 or clang 10 or newer (CXX)"
    return f"cannot compile {what}: {first}", remedy


def sanitizer_environment(compiler: Compiler) -> dict[str, str]:
    """Environment in which an engine that was not built with sanitizers loads a library that was.

    Leaks are not looked for: Python, MPI and LAMMPS have their own. Raises EngineError when the compiler has no ASan.
    """
    found = subprocess.run(
        [*compiler.command, "-print-file-name=libasan.so"], capture_output=True, text=True, timeout=60, check=False
    ).stdout.strip()
    if not Path(found).is_absolute():
        raise EngineError(f"{compiler.command[0]} has no libasan.so", "use g++ with its sanitizers (CXX=g++)")
    return {
        "LD_PRELOAD": str(Path(found).resolve()),
        "ASAN_OPTIONS": "detect_leaks=0",
        "UBSAN_OPTIONS": "print_stacktrace=1",
    }
