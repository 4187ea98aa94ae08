"""The command line: exit codes, one-line errors, verbs; the wheel outside the checkout."""

import json
import os
import subprocess
import sys
import tomllib

import pytest
from click.testing import CliRunner
from conftest import ROOT, cgfibre_environment

from cgfibre.cli import main
from cgfibre.scene_reading import load_scene, shipped_scenes


@pytest.fixture
def call(tmp_path, monkeypatch):
    """A verb in this process, in an empty folder."""
    monkeypatch.chdir(tmp_path)
    runner = CliRunner()
    return lambda *arguments: runner.invoke(main, [str(a) for a in arguments])


BAD = [
    ("carbon-7", "filament.diameter=7", "filament.diameter"),
    ("carbon-7", "filament.diameter=7 kg", "filament.diameter"),
    ("carbon-7", "filament.diametr=7 um", "filament.diametr"),
    ("carbon-7", "assembly.count=8", "assembly.count"),
    ("carbon-7", "platens.friction=-0.1", "platens.friction"),
    ("carbon-7", "platens.stop.displacement=90 um", "platens.stop.displacement"),
    ("carbon-7", "model.timestep=1 us", "model.timestep"),
    ("carbon-7", "model.level=capsule", "model.level"),
    ("carbon-7", "model.torsion=dihedral", "model.torsion"),
    ("carbon-7", "ends.tension=10 N", "ends.tension"),
    ("carbon-7", "nonsense", "nonsense"),
    ("carbon-8", "assembly.seed=1", "carbon-8"),
]


@pytest.mark.parametrize(
    ("verb", "scene", "override", "named"),
    [
        # straight filaments are known only once they are built, so a plan of dihedrals can be made
        (verb, *bad)
        for bad in BAD
        for verb in ("run", "build", "plan")
        if not (verb == "plan" and "dihedral" in bad[1])
    ],
)
def test_a_bad_scene_is_one_line_exit_2_and_nothing_written(call, tmp_path, verb, scene, override, named):
    out = [] if verb == "plan" else ["--out", "results/x"]
    done = call(verb, scene, *out, "--set", override)
    assert done.exit_code == 2, done.output
    lines = done.stderr.strip().splitlines()
    assert len(lines) == 1 and named in lines[0] and "expected" in lines[0] and lines[0].startswith("cgfibre: ")
    assert done.stdout == ""
    assert list(tmp_path.rglob("*")) == []


@pytest.mark.parametrize(
    "arguments",
    [
        ["squeeze"],
        ["run"],
        ["run", "carbon-7", "--rank", "2"],
        ["plan", "carbon-7", "x"],
        ["run", "carbon-7", "--ranks", "two"],
        ["build", "carbon-7"],
    ],
)
def test_a_wrong_word_is_exit_2(call, arguments, tmp_path):
    done = call(*arguments)
    assert done.exit_code == 2 and "Traceback" not in done.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["run", "carbon-7", "--ranks", "0"], "--ranks"),
        (["run", "carbon-7", "--engine", "/nowhere/lmp"], "--engine"),
        (["run", "carbon-7", "--resume", "--out", "x"], "--resume"),
        (["run", "carbon-7", "--certify", "--set", "model.spacing=0.5 um"], "model.spacing"),
        (["chart", "carbon-7", "--jobs", "999"], "--jobs"),
        (["chart", "carbon-7", "--only", "chain-9D"], "--only"),
        (["chart", "carbon-7", "--reference-accuracy", "0.7"], "model.accuracy"),
        (["chart", "carbon-7", "--compare", "A=nowhere"], "--compare"),
        (["measure", "x"], "DIR"),
        (["scenes", "carbon-8"], "carbon-8"),
        (["run", "carbon-7", "--level", "capsule"], "model.level"),
        (["doctor", "--engine", "/nowhere/lmp"], "--engine"),
    ],
)
def test_a_wrong_option_is_one_line_exit_2_and_nothing_written(call, arguments, named, tmp_path):
    done = call(*arguments)
    if arguments[0] == "doctor":
        assert done.exit_code == 3 and "FAIL engine" in done.output and "Traceback" not in done.output
        return
    assert done.exit_code == 2, done.output
    assert len(done.stderr.strip().splitlines()) == 1 and named in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_scenes_are_listed_and_printed_as_toml_that_can_be_run(call, tmp_path):
    listed = call("scenes")
    assert listed.exit_code == 0
    assert [line.split()[0] for line in listed.output.splitlines()] == list(shipped_scenes())
    for name in ("carbon-37", "carbon-12k-section"):
        text = call("scenes", name).stdout
        tomllib.loads(text)
        (tmp_path / f"{name}.toml").write_text(text)
        assert load_scene(tmp_path / f"{name}.toml") == load_scene(name)


def test_the_plan_as_json_is_json_and_as_text_says_why(call):
    done = call("plan", "carbon-7", "--json", "--set", "platens.friction=0.1")
    plan = json.loads(done.stdout, parse_constant=lambda word: pytest.fail(f"{word} is no JSON"))
    assert done.exit_code == 0 and plan["level"] == "chain" and plan["platens"]["friction"] == 0.1
    assert all(c["reason"] for c in plan["choices"]) and all(o["error"] for o in plan["omissions"])
    text = call("plan", "carbon-7")
    assert text.exit_code == 0 and "time step" in text.stdout and "left out" in text.stdout


def test_help_names_every_verb(call):
    done = call("--help")
    assert done.exit_code == 0
    verbs = {"run", "build", "plan", "measure", "chart", "signal", "capstan", "scenes", "doctor", "plugin"}
    assert verbs <= set(done.stdout.split())


def test_doctor_finds_this_installation_well_and_a_broken_engine_not(cgfibre, tmp_path):
    well = cgfibre("doctor")
    assert well.returncode == 0, well.stdout + well.stderr
    assert "FAIL" not in well.stdout and "two ranks" in well.stdout and "write access" in well.stdout
    lmp = tmp_path / "lmp"
    lmp.write_text("#!/bin/sh\necho 'libmpi.so.12: cannot open shared object file' >&2\nexit 127\n")
    lmp.chmod(0o755)
    broken = cgfibre("doctor", "--engine", lmp)
    assert broken.returncode == 3 and "FAIL engine" in broken.stdout and "do: " in broken.stdout
    assert "libmpi.so.12" in broken.stdout and "Traceback" not in broken.stderr


def test_a_run_prints_where_things_lie(cgfibre, tiny, tmp_path):
    done = cgfibre("run", tiny)
    assert done.returncode == 0, done.stdout + done.stderr
    out = tmp_path / "results" / "tiny"
    for name in ("curve.png", "curve.csv", "results.h5"):
        assert (out / name).exists() and f"results/tiny/{name}" in done.stdout
    assert "peak force" in done.stdout and "77 beads" in done.stdout and "WARNING" not in done.stdout
    again = cgfibre("run", tiny)
    assert again.returncode == 2 and len(again.stderr.strip().splitlines()) == 1 and "--force" in again.stderr
    resumed = cgfibre("run", tiny, "--resume", "--quiet")
    assert resumed.returncode == 0, resumed.stderr


# --- the wheel ------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """The package as the wheel installs it, in a folder of its own."""
    pytest.importorskip("build", reason="the wheel is built where the package 'build' is")
    pytest.importorskip("hatchling")
    folder = tmp_path_factory.mktemp("wheel")
    quiet = {"capture_output": True, "text": True, "check": True, "timeout": 120}
    subprocess.run([sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", folder, ROOT], **quiet)
    [wheel] = folder.glob("*.whl")
    target = folder / "site"
    subprocess.run(
        [sys.executable, "-m", "pip", "install", "--no-deps", "--no-index", "--quiet", "--target", target, wheel],
        **quiet,
    )
    return target


def test_the_wheel_works_outside_the_checkout(installed, tmp_path):
    environment = {**os.environ, "PYTHONPATH": str(installed)}

    def call(*arguments):
        done = subprocess.run(
            [sys.executable, *arguments],
            cwd=tmp_path,
            env=environment,
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    where = call("-c", "import cgfibre.engine.deck as d; print(d.__file__, d.template_folder())").split()
    assert all(w.startswith(str(installed)) for w in where), where
    assert len(call("-m", "cgfibre", "scenes").splitlines()) == len(shipped_scenes())
    assert json.loads(call("-m", "cgfibre", "plan", "carbon-7", "--json"))["level"] == "chain"
    call("-m", "cgfibre", "build", "carbon-7", "--out", "x")
    for name in ("in.chain", "defaults.inc", "phases.inc", "system.data", "parameters.inc"):
        assert (tmp_path / "x" / "deck" / name).stat().st_size > 100
    templates = {p.name for p in (installed / "cgfibre" / "templates").iterdir()}
    assert templates == {p.name for p in (ROOT / "templates").iterdir()}
    assert (installed / "bin" / "cgfibre").exists()


def test_this_checkout_is_what_the_tests_test():
    where = subprocess.run(
        [sys.executable, "-c", "import cgfibre; print(cgfibre.__file__)"],
        env=cgfibre_environment(),
        cwd="/",
        capture_output=True,
        text=True,
        check=True,
    ).stdout.strip()
    assert where == str(ROOT / "cgfibre" / "__init__.py")
