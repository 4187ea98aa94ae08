"""The whole recipe on seven short filaments: what a run leaves, stops, resuming, failures, guards."""

import csv
import json
import os
import shutil
import signal
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest
from conftest import cgfibre_command, cgfibre_environment
from quitting import quit_when

from cgfibre import store, workflow
from cgfibre.engine import job
from cgfibre.engine.dump import read_record, read_states
from cgfibre.engine.lammps import find_engine, run_deck
from cgfibre.errors import EngineError, InputError
from cgfibre.plan.make import make_plan
from cgfibre.plan.system import build_system
from cgfibre.scene_reading import load_scene

COLUMNS = (
    "step,time_us,displacement_um,thickness_um,force_top_N,force_bottom_N,pressure_MPa,"
    "fibre_volume_fraction,kinetic_J,stored_J,work_J"
)
SUMMARY = {
    "scene",
    "level",
    "n_filaments",
    "n_beads",
    "n_steps",
    "timestep_us",
    "platen_speed_m_per_s",
    "wall_s",
    "engine_s",
    "engine_version",
    "peak_force_N",
    "final_thickness_um",
    "energy_ratio",
    "speed_error",
    "warnings",
}


def same_curve(a, b, **tolerance):
    for name in COLUMNS.split(","):
        assert a[name] == pytest.approx(b[name], **(tolerance or {"rel": 0, "abs": 0})), name


def files_and_times(folder):
    return {str(p.relative_to(folder)): (p.stat().st_size, p.stat().st_mtime_ns) for p in folder.rglob("*")}


# --- what a run leaves ----------------------------------------------------------------------------------------------


def test_a_run_leaves_what_the_interface_promises(finished):
    have = {p.name for p in finished.out.iterdir()}
    assert {"scene.toml", "plan.json", "deck", "log.lammps", "results.h5", "curve.csv", "summary.json"} <= have
    pictures = {"curve.png", "pressure.png", "energy.png", "sections.png", "bundle.png", "distribution.png"}
    assert pictures <= have
    for name in pictures:
        assert (finished.out / name).read_bytes().startswith(b"\x89PNG") and (finished.out / name).stat().st_size > 5000
    assert {"in.chain", "system.data", "README"} <= {p.name for p in (finished.out / "deck").iterdir()}
    with (finished.out / "curve.csv").open(newline="") as f:
        rows = list(csv.reader(f))
    assert ",".join(rows[0]) == COLUMNS
    table = np.array(rows[1:], dtype=float)
    assert len(table) >= 40 and np.isfinite(table).all()
    phase = finished.curve.phase
    assert list(np.unique(phase)) == [0, 2] and np.all(np.diff(phase) >= 0), "loading, then unloading"
    assert set(json.loads((finished.out / "summary.json").read_text())) >= SUMMARY
    plan = json.loads((finished.out / "plan.json").read_text())
    assert plan["level"] == "chain" and plan["choices"] and plan["omissions"]
    assert load_scene(finished.out / "scene.toml") == load_scene(finished.out / "scene.toml", [])


def test_the_numbers_hang_together(finished):
    """Quantities that two columns give: thickness, pressure, fibre volume fraction, time, work."""
    c, s = finished.curve, finished.summary
    assert c["thickness_um"] + c["displacement_um"] == pytest.approx(c["thickness_um"][0], rel=1e-12)
    assert c["time_us"] == pytest.approx(c["step"] * s["timestep_us"])
    assert c["pressure_MPa"] == pytest.approx(c["force_top_N"] / (70 * c.width_um) * 1e6, rel=1e-9)
    area = 7 * np.pi * 3.5**2
    assert c["fibre_volume_fraction"] == pytest.approx(area / (c.width_um * c["thickness_um"]), rel=1e-9)
    work = (
        np.concatenate(
            [[0], np.cumsum((c["force_top_N"][1:] + c["force_top_N"][:-1]) / 2 * np.diff(c["displacement_um"]))]
        )
        * 1e-6
    )
    assert c["work_J"] == pytest.approx(work, rel=1e-9, abs=1e-20)
    assert s["peak_force_N"] == c["force_top_N"].max() > 0.01
    assert s["n_steps"] == c["step"][-1] and s["n_filaments"] == 7 and s["speed_error"] is None
    # energy: what was stored is at most the work done, and what unloading gives back is less than loading took
    late = c.loading & (c["displacement_um"] > 1)
    assert np.all(c["stored_J"][late] < 1.02 * c["work_J"][late])
    assert np.all(c["stored_J"][late] > 0.5 * c["work_J"][late])
    assert 0 < c["work_J"][-1] < c["work_J"].max()
    assert finished.trusted and s["trusted"] is True and s["warnings"] == []


def test_results_hold_the_curve_the_frames_and_the_scene(finished):
    stored = store.read_results(finished.out / "results.h5")
    same_curve(stored.curve, finished.curve)
    assert len(stored.frames) >= 10 and stored.frames.step[0] == 0
    assert np.isfinite(stored.frames.positions).all()
    assert stored.scene == (finished.out / "scene.toml").read_text()
    assert json.loads(stored.plan)["level"] == "chain"
    # the frame of the turning point is there: the deepest frame is as deep as the deck went
    assert stored.frames.displacement_um.max() == pytest.approx(4.0, rel=0.01)
    # the tops of the contact beads are at the platen then
    k = int(np.argmax(stored.frames.displacement_um))
    under = np.abs(stored.frames.positions[k][:, 0] - 70) < 35.1
    top = stored.frames.positions[k][under, 2].max() + 3.5
    # its axis below the platen, its surface pressed in by at most a twentieth of the diameter
    assert 0 < top - (stored.curve["thickness_um"][0] / 2 - stored.frames.displacement_um[k]) < 0.35


def test_unloading_ends_near_zero_force(finished):
    c = finished.curve
    assert abs(c["force_top_N"][-1]) < 0.02 * c["force_top_N"].max()
    assert c["displacement_um"][-1] < 0.5


# --- measuring again ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "gone",
    [
        (),
        ("deck/trajectory.lammpstrj",),
        ("deck",),
        ("deck", "summary.json", "plan.json"),
        ("deck", "scene.toml", "summary.json", "curve.csv"),
    ],
)
def test_measuring_again_gives_the_same_numbers(finished, copied, gone, monkeypatch):
    monkeypatch.setattr(workflow, "draw_all", lambda *args, **kwargs: [])
    before = (copied / "curve.csv").read_bytes()
    for name in gone:
        path = copied / name
        shutil.rmtree(path) if path.is_dir() else path.unlink()
    again = workflow.measure_folder(copied)
    assert (copied / "curve.csv").read_bytes() == before
    same_curve(again.curve, finished.curve)
    old, new = finished.summary, json.loads((copied / "summary.json").read_text())
    for key in (
        "scene",
        "level",
        "n_filaments",
        "n_beads",
        "n_steps",
        "timestep_us",
        "peak_force_N",
        "final_thickness_um",
        "energy_ratio",
        "speed_error",
        "fits",
        "trusted",
    ):
        assert new[key] == store.plain(old[key]), key
    a, b = (store.read_results(p / "results.h5") for p in (finished.out, copied))
    assert a.frames.positions == pytest.approx(b.frames.positions, rel=1e-12, abs=1e-9)
    assert a.distribution.keys() == b.distribution.keys()
    for name, (values, _) in a.distribution.items():
        assert values == pytest.approx(b.distribution[name][0], rel=1e-9, abs=1e-9, nan_ok=True), name
    if "summary.json" not in gone:
        assert new["engine_s"] == old["engine_s"] and new["engine_version"] == old["engine_version"]


def test_measuring_nothing_is_refused(tmp_path):
    with pytest.raises(InputError, match="the folder of a run"):
        workflow.measure_folder(tmp_path)
    assert list(tmp_path.iterdir()) == []


#: the first micrometre of the tiny scene at its own speed: two ranks on a busy machine are slow
SHORT = ("platens.stop.displacement=1 um", "platens.unload=false", "output.samples=10")


def close_to(two, one):
    """Sums over ranks differ in the last bit, which contacts amplify: within 2 % of the largest force here."""
    f = one["force_top_N"]
    assert len(one) >= 10 and f.max() > 1e-3
    assert two["step"].tolist() == one["step"].tolist()
    assert two["force_top_N"] == pytest.approx(f, abs=0.02 * f.max())


# --- repeating ------------------------------------------------------------------------------------------------------


def test_the_same_seed_gives_the_same_bytes_and_another_seed_does_not(bench, finished):
    bench.run("again", "output.dump=true")
    assert (bench.folder / "again" / "curve.csv").read_bytes() == (finished.out / "curve.csv").read_bytes()
    bench.run("other", "assembly.seed=2")
    assert (bench.folder / "other" / "curve.csv").read_bytes() != (finished.out / "curve.csv").read_bytes()


def test_two_ranks_agree_within_scatter(bench):
    two = bench.run("two", *SHORT, ranks=2)
    assert two.summary["ranks"] == 2
    close_to(two.curve, bench.run("one", *SHORT).curve)


def test_an_earlier_run_is_not_overwritten_without_force(bench, copied):
    before = files_and_times(copied)
    for folder in (copied, copied / "deck" / "in.chain"):
        with pytest.raises(InputError, match="--out"):
            workflow.run_scene(bench.scene, workflow.RunOptions(folder))
    with pytest.raises(InputError, match="--force overwrites"):
        workflow.build_scene(bench.scene, copied)
    assert files_and_times(copied) == before
    r = workflow.run_scene(bench.scene, workflow.RunOptions(copied, force=True), ["platens.stop.displacement=1 um"])
    assert r.curve["displacement_um"].max() < 1.01
    assert json.loads((copied / "summary.json").read_text())["n_steps"] == r.curve["step"][-1]


def test_force_leaves_nothing_of_the_earlier_run(bench, copied):
    workflow.run_scene(
        bench.scene, workflow.RunOptions(copied, force=True), ["platens.stop.displacement=1 um", "model.level=section"]
    )
    for p in [*copied.glob("*"), *(copied / "deck").glob("*")]:
        assert p.name not in ("in.chain", "bundle.png"), "of the earlier run"


def test_a_wrong_scene_leaves_nothing(bench):
    for overrides in (["filament.diameter=7"], ["platens.stop.displacement=40 um"], ["model.level=subbundle"]):
        with pytest.raises(InputError):
            bench.run("wrong", *overrides)
    with pytest.raises(InputError, match="--ranks"):
        bench.run("wrong", ranks=0)
    with pytest.raises(InputError, match="--engine"):
        bench.run("wrong", engine="/nowhere/lmp")
    assert not (bench.folder / "wrong").exists()


# --- scenes ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("stop", "reached"),
    [
        ("force=0.01 N", lambda c: c["force_top_N"][c.loading].max() >= 0.01 > c["force_top_N"][c.loading][:-1].max()),
        ("pressure=3 MPa", lambda c: c["pressure_MPa"][c.loading].max() >= 3 > c["pressure_MPa"][c.loading][:-1].max()),
        ("thickness=17.5 um", lambda c: c["thickness_um"].min() == pytest.approx(17.5, abs=0.15)),
        ("displacement=2 um", lambda c: c["displacement_um"].max() == pytest.approx(2.0, abs=0.15)),
    ],
)
def test_loading_stops_where_asked_and_unloads(tiny, bench, stop, reached):
    text = tiny.read_text().replace('displacement = "4 um"', "")
    name, value = stop.split("=")
    text = text.replace("[platens.stop]", f'[platens.stop]\n{name} = "{value}"')
    path = bench.folder / "s.toml"
    path.write_text(text)
    r = workflow.run_scene(path, workflow.RunOptions(bench.folder / "out"))
    assert reached(r.curve)
    assert r.curve.unloading.any() and abs(r.curve["force_top_N"][-1]) < 0.15 * r.summary["peak_force_N"]


def test_holding_keeps_the_platen_still(bench):
    r = bench.run("hold", "platens.hold=1 us", "platens.stop.displacement=2 um")
    c = r.curve
    held = c.phase == 1
    assert held.sum() >= 3 and list(np.unique(c.phase)) == [0, 1, 2]
    assert np.ptp(c["displacement_um"][held]) < 1e-9
    assert np.ptp(c["time_us"][held]) >= 0.7


CHEAP = ("platens.stop.displacement=2 um", "output.samples=20")
#: long enough for a signal to find it running, on a busy machine too
SLOW = "platens.speed=0.2 m/s"


def half_balanced(r):
    """Bottom platen and supports share what the top one gives; no force where there is no contact."""
    c = r.curve
    assert np.isfinite(np.column_stack(list(c.columns.values()))).all()
    assert r.summary["peak_force_N"] > 0
    assert c["force_top_N"][0] == 0
    return c


@pytest.mark.parametrize(
    "overrides",
    [
        ("platens.curvature=convex",),
        ("platens.curvature=concave",),
        ("platens.crimp_side=top",),
    ],
    ids=["convex", "concave", "top only"],
)
def test_crimped_platens(bench, overrides):
    crimped = bench.run("crimped", *CHEAP, "platens.shape=crimped", "platens.crimp_angle=4.4 deg", *overrides)
    c = half_balanced(crimped)
    flat = bench.run("flat", *CHEAP)
    f = flat.curve["force_top_N"]
    # the platen touches at mid-span or at its edges alone, so the force differs from that of the flat one
    assert abs(c["force_top_N"].max() / f.max() - 1) > 0.001
    assert 0.1 < c["force_top_N"].max() / f.max() < 3
    assert c["displacement_um"].max() > 1.8 and 0 < np.abs(c["work_J"]).max() < 1e-7


def test_a_full_width_platen_presses_harder_than_a_narrow_one(bench):
    full, narrow = bench.run("full", *CHEAP, "platens.width=full"), bench.run("narrow", *CHEAP)
    half_balanced(full)
    assert full.summary["peak_force_N"] > 2 * narrow.summary["peak_force_N"]


def test_clamped_ends_are_stiffer_than_pinned_ones(bench):
    """A beam with clamped ends is four times as stiff under a point load; under a wide anvil more."""
    clamped, pinned = (bench.run(name, *CHEAP, f"ends.support={name}") for name in ("clamped", "simply-supported"))
    half_balanced(clamped)
    assert 2 < clamped.summary["peak_force_N"] / pinned.summary["peak_force_N"] < 12


def test_symmetry_ends_balance_top_and_bottom(bench):
    """Nothing but the platens holds a periodic cell, so they carry the same force."""
    r = bench.run(
        "cell",
        "ends.support=symmetry",
        "platens.width=full",
        "assembly.length=42 um",
        "platens.speed=0.3 m/s",
        "platens.stop.displacement=9 um",
        "platens.unload=false",
    )
    guard = next(g for g in r.review.guards if g.name == "top against bottom force")
    assert guard.ok and 0 < guard.value < 0.05
    c = r.curve
    assert c["force_bottom_N"][-1] == pytest.approx(c["force_top_N"][-1], rel=0.1) and c["force_top_N"][-1] > 0.01


def test_levels_agree_while_bending_carries_the_load(bench, finished):
    rod = bench.run("rod", "model.level=rod", "platens.stop.displacement=2 um")
    section = bench.run("section", "model.level=section", "platens.stop.displacement=2 um")
    assert (rod.summary["level"], section.summary["level"]) == ("rod", "section")
    c = finished.curve
    for other, tolerance in ((rod, 0.1), (section, 0.5)):
        d = other.curve["displacement_um"][other.curve.loading]
        late = d > 1.2
        chain = np.interp(d[late], c["displacement_um"][c.loading], c["force_top_N"][c.loading])
        assert other.curve["force_top_N"][other.curve.loading][late] == pytest.approx(chain, rel=tolerance)
    assert section.summary["n_beads"] == 7 and np.all(
        store.read_results(section.out / "results.h5").frames.positions[..., 0] == 0
    )


def test_the_speed_check_says_how_much_half_the_speed_changes(bench):
    r = bench.run("check", *CHEAP, "model.speed_check=true")
    assert 0 < r.summary["speed_error"] < 0.5
    assert r.summary["speed_error"] <= r.summary["speed_error_worst"]
    again = workflow.measure_folder(r.out)
    assert again.summary["speed_error"] == r.summary["speed_error"]


def test_condensed_and_graded_far_fields_agree(bench):
    far = (
        "assembly.length=2 mm",
        "platens.stop.displacement=2 um",
        "platens.unload=false",
        "output.samples=20",
        "platens.speed=0.5 m/s",
        "model.symmetry=none",
    )
    condensed = bench.run("condensed", *far, "model.far_field=condensed")
    graded = bench.run("graded", *far, "model.far_field=graded")
    assert condensed.summary["n_beads"] < graded.summary["n_beads"] < 7 * 2000 / 7
    a, b = condensed.curve["force_top_N"], graded.curve["force_top_N"]
    assert a.max() > 0 and np.isfinite(a).all() and np.isfinite(b).all()
    # at this speed inertia, not the far field, makes most of the force; the agreement is measured in the validation
    assert np.trapezoid(a, condensed.curve["displacement_um"]) == pytest.approx(
        np.trapezoid(b, graded.curve["displacement_um"]), rel=0.3
    )


def test_a_graded_rod_runs(bench):
    r = bench.run(
        "rod",
        "assembly.length=1 mm",
        "model.level=rod",
        "model.far_field=graded",
        "platens.unload=false",
        "platens.stop.displacement=0.3 um",
        "output.samples=10",
    )
    assert r.summary["level"] == "rod" and np.isfinite(r.curve["force_top_N"]).all()


@pytest.mark.parametrize(
    "overrides",
    [
        ["assembly.arrangement=random", "assembly.fibre_volume_fraction=0.5", "assembly.count=20"],
        [
            'assembly.migration={period="800 um", minimum_radius=0.1}',
            "assembly.length=0.4 mm",
            "assembly.void_fraction=0.6",
        ],
        ["assembly.twist=5 turn/cm", "assembly.void_fraction=0.5"],
        ["assembly.arrangement=rectangular", "assembly.count=12", "assembly.aspect=2.0"],
    ],
    ids=["random", "migrating", "twisted", "rectangular"],
)
def test_other_assemblies_build_decks(tiny, tmp_path, overrides):
    folder = workflow.build_scene(tiny, tmp_path / "out", [*overrides, "model.symmetry=none"])
    scene = load_scene(tmp_path / "out" / "scene.toml")
    plan = make_plan(scene)
    system = build_system(scene, plan)
    assert f"{len(system.bonds())} bonds" in (folder / "system.data").read_text() or plan.level == "rod"
    assert plan.n_beads == system.n_beads
    run = find_engine()
    (folder / "in.short").write_text(
        next(folder.glob("in.*")).read_text().replace("include         phases.inc", "run 20")
    )
    run_deck(run, folder, "in.short")


# --- the deck by hand -----------------------------------------------------------------------------------------------


def test_a_deck_run_by_hand_gives_the_same_record(tiny, tmp_path, finished):
    folder = workflow.build_scene(tiny, tmp_path / "out", ["output.dump=true"])
    engine = find_engine()
    environment = {k: v for k, v in engine.environment.items() if not k.startswith("PYTHON")}
    subprocess.run(
        [engine.executable, "-in", "in.chain", "-screen", "none"], cwd=folder, env=environment, check=True, timeout=60
    )
    for name in ("record.txt", "extremes.txt", "trajectory.lammpstrj"):
        assert (folder / name).read_bytes() == (finished.out / "deck" / name).read_bytes(), name


def test_a_deck_runs_by_hand_on_two_ranks_and_is_measured(bench, tiny, tmp_path):
    folder = workflow.build_scene(tiny, tmp_path / "out", SHORT)
    engine = find_engine()
    subprocess.run(
        [*engine.launcher, "-n", "2", engine.executable, "-in", "in.chain", "-screen", "none"],
        cwd=folder,
        env=dict(engine.environment),
        check=True,
        timeout=60,
        stdin=subprocess.DEVNULL,
    )
    r = workflow.measure_folder(tmp_path / "out")
    close_to(r.curve, bench.run("one", *SHORT).curve)


def wrapper(path, before="", after=""):
    """A script that runs the wheel's engine, as a user's own build would look to cgfibre."""
    engine = find_engine()
    path.write_text(
        f"#!/bin/sh\nexport LD_LIBRARY_PATH={engine.environment['LD_LIBRARY_PATH']}\n{before}\n"
        f'{"" if after else "exec "}{engine.executable} "$@"\n{after}\n'
    )
    path.chmod(0o755)
    return path


def test_another_engine_runs_the_same_deck(bench, finished, monkeypatch):
    monkeypatch.delenv("LD_LIBRARY_PATH", raising=False)
    lmp = wrapper(bench.folder / "lmp")
    r = bench.run("own", "output.dump=true", engine=str(lmp))
    same_curve(r.curve, finished.curve)
    assert r.summary["engine_version"] == finished.summary["engine_version"]
    monkeypatch.setenv("CGFIBRE_LMP", str(lmp))
    assert find_engine().executable == str(lmp)


# --- killed and resumed ---------------------------------------------------------------------------------------------


def start(scene, out, *arguments, text=None):
    return subprocess.Popen(
        cgfibre_command("run", scene, "--out", out, "--quiet", *arguments),
        env=cgfibre_environment(),
        stdout=subprocess.DEVNULL,
        stderr=text or subprocess.DEVNULL,
        start_new_session=True,
        # a test run in the background of a shell inherits that Ctrl-C is ignored
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )


def wait_for(what, process, seconds=30.0):
    end = time.monotonic() + seconds
    while not what():
        assert process.poll() is None
        assert time.monotonic() < end
        time.sleep(0.002)


def engines_of(folder):
    """Process ids of engines that run in ``folder``."""
    found = []
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            if os.readlink(entry / "cwd") == str(folder / "deck") and "lmp" in os.readlink(entry / "exe"):
                found.append(int(entry.name))
        except OSError:
            continue
    return found


def rows_written(out):
    path = out / "deck" / "record.txt"
    return path.read_bytes().count(b"\n") if path.exists() else 0


LEVELS = pytest.mark.parametrize(
    ("level", "shape"),
    [("chain", "capsule"), ("chain", "beads"), ("rod", "capsule"), ("rod", "beads"), ("section", "auto")],
)


@LEVELS
def test_a_killed_run_goes_on_to_the_same_curve(bench, level, shape):
    """SIGKILL of the process group at several moments, with --resume in between: the same bytes on one rank."""
    overrides = [f"model.level={level}", f"contact.shape={shape}"]
    if level == "section":  # long enough for several checkpoints
        overrides.append("platens.speed=0.2 m/s")
    unbroken = bench.run("unbroken", *overrides)
    rng = np.random.default_rng({"chain": 1, "rod": 2, "section": 3}[level])
    out = bench.folder / "killed"
    asked = [word for override in overrides for word in ("--set", override)]
    arguments = asked
    for share in np.sort(rng.uniform(0.1, 0.8, 2 if level == "chain" else 1)):
        process = start(bench.scene, out, *arguments)
        wanted = 2 + int(share * (len(unbroken.curve) - 4))
        wait_for(lambda n=wanted: rows_written(out) > n, process)
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        time.sleep(0.05)
        assert engines_of(out) == []
        assert not (out / "results.h5").exists()
        arguments = [*asked, "--resume"]
    assert read_states(out / "deck"), "killed before the first checkpoint: not what this test is about"
    resumed = workflow.run_scene(bench.scene, workflow.RunOptions(out, resume=True), overrides)
    same_curve(resumed.curve, unbroken.curve)
    assert (out / "curve.csv").read_bytes() == (bench.folder / "unbroken" / "curve.csv").read_bytes()
    a, b = (store.read_results(bench.folder / name / "results.h5").frames for name in ("unbroken", "killed"))
    assert np.array_equal(a.step, b.step) and np.array_equal(a.positions, b.positions)


@LEVELS
def test_stopped_at_any_checkpoint_the_engine_goes_on_bit_by_bit(bench, level, shape):
    """The engine quits right after a checkpoint, a third of the way; resumed as one would by hand."""
    overrides = [f"model.level={level}", f"contact.shape={shape}"]
    overrides += ["platens.stop.displacement=3 um", "output.samples=20"]
    unbroken = bench.run("unbroken", *overrides)
    out = bench.folder / "quit"
    folder = workflow.build_scene(bench.scene, out, overrides)
    stop = unbroken.summary["n_steps"] // 3
    states = quit_when(folder, f"in.{level}", f"$(step) >= {stop}")
    state = states[0]
    assert stop <= state.step < 0.6 * unbroken.summary["n_steps"]
    resumed = workflow.run_scene(bench.scene, workflow.RunOptions(out, resume=True), overrides)
    log = (folder / "log.lammps").read_text()
    if shape != "capsule":  # which finds its neighbours itself
        assert "master list distance cutoff = 8\n" in log, "LAMMPS forgot how far contacts reach"
    same_curve(resumed.curve, unbroken.curve)


def test_killed_before_the_first_checkpoint(bench, finished):
    out = bench.folder / "early"
    process = start(bench.scene, out)
    wait_for(lambda: (out / "deck" / "system.data").exists() and engines_of(out), process)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    if read_states(out / "deck"):
        pytest.skip("the engine was quicker than the kill")
    resumed = workflow.run_scene(bench.scene, workflow.RunOptions(out, resume=True))
    same_curve(resumed.curve, finished.curve)


@pytest.mark.parametrize("left", [(), ("scene.toml",), ("scene.toml", "plan.json", "deck/in.chain")])
def test_killed_while_the_deck_was_written(bench, finished, left):
    """Whatever part of the folder is there, resuming gives the whole run, or says that there is nothing to resume."""
    whole, out = bench.folder / "whole", bench.folder / "part"
    workflow.build_scene(bench.scene, whole)
    out.mkdir()
    for name in left:
        (out / name).parent.mkdir(exist_ok=True)
        shutil.copyfile(whole / name, out / name)
    if not left:
        with pytest.raises(InputError, match=r"scene\.toml"):
            workflow.run_scene(bench.scene, workflow.RunOptions(out, resume=True))
        return
    resumed = workflow.run_scene(bench.scene, workflow.RunOptions(out, resume=True))
    same_curve(resumed.curve, finished.curve)


def test_killed_while_the_data_file_was_written(bench, finished, monkeypatch):
    """What is there must not be taken for the whole."""
    write = job.write_data

    def half(path, data):
        write(path, data)
        os.truncate(path, path.stat().st_size // 2)
        raise KeyboardInterrupt

    with monkeypatch.context() as m:
        m.setattr(job, "write_data", half)
        with pytest.raises(KeyboardInterrupt):
            bench.run("cut")
    resumed = workflow.run_scene(bench.scene, workflow.RunOptions(bench.folder / "cut", resume=True))
    same_curve(resumed.curve, finished.curve)


def test_resuming_another_scene_is_refused_and_a_finished_run_is_measured_again(bench, copied):
    before = files_and_times(copied)
    with pytest.raises(InputError, match="the scene that was begun there"):
        workflow.run_scene(bench.scene, workflow.RunOptions(copied, resume=True), ["contact.friction=0.1"])
    assert files_and_times(copied) == before
    csv_before = (copied / "curve.csv").read_bytes()
    workflow.run_scene(bench.scene, workflow.RunOptions(copied, resume=True), ["output.dump=true"])
    assert (copied / "curve.csv").read_bytes() == csv_before


def test_a_killed_run_can_be_measured(bench, cgfibre):
    out = bench.folder / "killed"
    process = start(bench.scene, out, "--set", SLOW)
    wait_for(lambda: rows_written(out) > 20, process)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    done = cgfibre("measure", out)
    assert done.returncode == 4, done.stderr
    summary = json.loads((out / "summary.json").read_text())
    assert summary["trusted"] is False
    assert any("stopped before its end" in w and "--resume" in w for w in summary["warnings"]), summary["warnings"]
    stored = store.read_results(out / "results.h5")
    assert 15 < len(stored.curve) < 60 and (out / "curve.png").exists()
    # measuring in between takes nothing away from what resuming needs
    n_frames = len(stored.frames)
    resumed = workflow.run_scene(bench.scene, workflow.RunOptions(out, resume=True), [SLOW])
    assert resumed.trusted and resumed.summary["warnings"] == []
    steps = store.read_results(out / "results.h5").frames.step
    assert len(steps) > n_frames and steps[0] == 0 and np.all(np.diff(steps) <= 1.01 * np.diff(steps)[0])


def test_interrupting_leaves_a_resumable_folder_and_no_engine(bench):
    out = bench.folder / "stopped"
    with (bench.folder / "text").open("wb") as text:
        process = start(bench.scene, out, "--set", SLOW, text=text)
        wait_for(lambda: rows_written(out) > 10, process)
        os.kill(process.pid, signal.SIGINT)
        process.wait(timeout=20)
    assert process.returncode not in (0, 4) and "Traceback" not in (bench.folder / "text").read_text()
    assert engines_of(out) == []
    unbroken = bench.run("unbroken", SLOW)
    resumed = workflow.run_scene(bench.scene, workflow.RunOptions(out, resume=True), [SLOW])
    same_curve(resumed.curve, unbroken.curve)


# --- failures of the engine -----------------------------------------------------------------------------------------


def test_an_unstable_run_says_why_and_what_to_do(tiny, tmp_path):
    folder = workflow.build_scene(tiny, tmp_path / "out")
    with pytest.raises(EngineError) as info:
        run_deck(find_engine(), folder, "in.chain", variables={"timestep_us": "0.005", "unsafe": "1"})
    assert info.value.exit_code == 3
    assert "time step" in info.value.remedy or "unstable" in info.value.reason, str(info.value)


def test_an_engine_that_dies_half_way_leaves_its_results_readable(bench, cgfibre):
    enough = 'while [ "$(cat record.txt 2>/dev/null | wc -l)" -lt 18 ]; do sleep 0.01; done'
    kills = f'case "$*" in *-in*) {enough}; kill -9 $PID;; esac'
    lmp = wrapper(bench.folder / "lmp")
    text = lmp.read_text().replace("exec ", "").replace('"$@"', '"$@" & PID=$!') + kills + "\nwait $PID\nexit $?\n"
    lmp.write_text(text)
    out = bench.folder / "dies"
    done = cgfibre("run", bench.scene, "--out", out, "--quiet", "--engine", lmp, "--set", "platens.speed=0.5 m/s")
    assert done.returncode == 3, done.stdout + done.stderr
    assert "killed" in done.stderr and "remedy: " in done.stderr and "--resume" in done.stderr
    assert "Traceback" not in done.stderr
    stored = store.read_results(out / "results.h5")
    assert len(stored.curve) > 10 and stored.curve["force_top_N"].max() > 0
    summary = json.loads((out / "summary.json").read_text())
    assert "stopped" in summary and summary["warnings"] and summary["trusted"] is False
    assert (out / "log.lammps").exists()


def test_an_engine_that_never_starts_is_exit_3(bench, cgfibre):
    lmp = bench.folder / "lmp"
    lmp.write_text("#!/bin/sh\necho 'error while loading shared libraries: libmpi.so.12' >&2\nexit 127\n")
    lmp.chmod(0o755)
    done = cgfibre("run", bench.scene, "--out", bench.folder / "never", "--quiet", "--engine", lmp)
    assert done.returncode == 3
    assert "libmpi.so.12" in done.stderr and "remedy" in done.stderr and "Traceback" not in done.stderr


@pytest.mark.parametrize(
    "size", ["168k", "220k", "320k"], ids=["in a checkpoint", "in the trajectory", "in the results"]
)
def test_a_full_disk_is_exit_3_and_what_was_computed_is_kept(bench, size):
    """A small disk of its own for the run; once there is room again it is measured, and goes on to the same curve.

    Filaments of beads: the plugin of capsules alone would fill the disk.
    """
    shape = "contact.shape=beads"
    disk, out = bench.folder / "disk", bench.folder / "out"
    disk.mkdir()
    mount = ["unshare", "-rm", "sh", "-c"]
    if subprocess.run(
        [*mount, f"mount -t tmpfs -o size={size} tmpfs {disk}"], capture_output=True, check=False
    ).returncode:
        pytest.skip("no right to mount a small disk here")
    command = " ".join(cgfibre_command("run", bench.scene, "--out", disk / "r", "--quiet", "--set", shape))
    done = subprocess.run(
        [
            *mount,
            f"mount -t tmpfs -o size={size} tmpfs {disk} || exit 99; {command}; code=$?; "
            f"cp -r {disk}/r {out}; exit $code",
        ],
        env=cgfibre_environment(),
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 3, done.stdout + done.stderr
    assert "Traceback" not in done.stderr
    assert "the disk is full" in done.stderr and "remedy: free space" in done.stderr
    assert len(read_record(out / "deck").step) > 1
    partial = workflow.measure_folder(out)
    ended = size == "320k"  # the engine's own files fitted
    assert len(partial.curve) > 2 and partial.trusted == ended
    resumed = workflow.run_scene(bench.scene, workflow.RunOptions(out, resume=True), [shape])
    same_curve(resumed.curve, bench.run("whole", shape).curve)


# --- guards ---------------------------------------------------------------------------------------------------------


def failed(summary):
    return {g["name"] for g in summary["guards"] if not g["ok"]}


def test_a_run_not_to_be_trusted_is_marked_and_exits_4(bench, cgfibre):
    out = bench.folder / "bad"
    done = cgfibre(
        "run",
        bench.scene,
        "--out",
        out,
        "--quiet",
        "--set",
        "platens.speed=100 m/s",
        "--set",
        "platens.stop.displacement=10 um",
    )
    assert done.returncode == 4, done.stdout + done.stderr
    summary = json.loads((out / "summary.json").read_text())
    assert "quasi-static" in failed(summary) and summary["trusted"] is False
    assert len(summary["warnings"]) == len(failed(summary))
    assert all(w in done.stdout for w in summary["warnings"])
    assert len(store.read_results(out / "results.h5").curve) > 5


@pytest.mark.parametrize(("softening", "guard"), [("1e4", "platen passed"), ("300", "overlap of filaments")])
def test_contacts_too_soft_are_caught_and_stay_so_when_only_the_results_are_left(bench, softening, guard):
    r = bench.run("soft", f"contact.softening={softening}", "platens.stop.displacement=12 um", "platens.unload=false")
    assert not r.trusted and guard in failed(r.summary) and r.summary["trusted"] is False
    shutil.rmtree(r.out / "deck")
    (r.out / "summary.json").unlink()
    again = workflow.measure_folder(r.out)
    assert not again.trusted and guard in failed(again.summary)
