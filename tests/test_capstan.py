"""Capstan model: against the belt law and its polygon, what filaments share, identification, LAMMPS, the verb."""

import json
import math
import time
import tomllib
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner
from friction_signals import LAW, T1, WRAP, stick_slip_signal

from cgfibre.capstan import identify as idn
from cgfibre.capstan.column import Column, pull
from cgfibre.capstan.features import changed, features, rigid_ratio, sensitivities
from cgfibre.capstan.scene import CapstanScene, load_capstan
from cgfibre.cli import main
from cgfibre.engine.capstan import Rig, run_belt
from cgfibre.engine.capstan_dynamic import Pull, run_dynamic
from cgfibre.engine.lammps import find_engine
from cgfibre.errors import EngineError, InputError
from cgfibre.measure.signal import TestRig
from cgfibre.mechanics.belt import polygon_ratio, tension_ratio
from cgfibre.scene_reading import load_scene, scene_description, validated

EA = 230e6 * math.pi * 49 / 4
BUNDLE = Column(1, 30, 10 * EA, 4e5, 19_000.0, 1.435, 1e4, 1.6e-4, LAW, LAW)
COULOMB = replace(LAW, mu_s0=0.22, mu_s=0.22, mu_k=0.22)
#: model (ii) with Table 4-2's coefficients
COLUMN = replace(
    BUNDLE,
    filaments=10,
    EA=EA,
    pulley=replace(LAW, mu_s0=0.24, mu_s=0.16, mu_k=0.15),
    between=replace(LAW, mu_s0=0.23, mu_s=0.17, mu_k=0.16),
)
#: filament on filament without the 20 um of critical slip: nearly rigid until it slips
RIGID = {"critical_slip": 1e-3}


def ratio(column, duration, step=2e3, **options):
    r = pull(column, duration, step, **options)
    return r, r.total / column.load


# --- quasi-static model ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("nodes", [4, 8, 15, 30])
@pytest.mark.parametrize("filaments", [1, 4])
def test_coulomb_friction_gives_the_polygons_belt_law(nodes, filaments):
    column = replace(BUNDLE, pulley=COULOMB, nodes=nodes, filaments=filaments, EA=10 * EA / filaments)
    r, y = ratio(column, 1.6e5, 8e3)
    assert y[-1] == pytest.approx(float(polygon_ratio(0.22, 1.435, nodes)), rel=1e-9)
    if nodes == 30:
        assert y[-1] == pytest.approx(float(tension_ratio(0.22, 1.435)), rel=1e-4)  # the bar: 0.01 %
    assert r.tension[-1].sum(axis=0)[0] == pytest.approx(4e5)


def test_a_bundle_is_the_rigid_belt_within_its_stretch():
    r, y = ratio(BUNDLE, 6e5)
    rigid = rigid_ratio(LAW, 1.435, r.time)
    # stretch 1e-2 um of 20 um, on a fall of 0.06 over 5 um
    assert np.abs(y - rigid).max() < 1.5e-3
    assert r.iterations < 3
    assert y.max() == pytest.approx(float(tension_ratio(0.22, 1.435)), rel=3e-3)
    late = y[r.time > 3e5]
    assert late.max() == pytest.approx(float(tension_ratio(0.18, 1.435)), rel=1e-3)
    assert late.min() == pytest.approx(float(tension_ratio(0.16, 1.435)), rel=1e-3)
    assert r.total[0] == pytest.approx(4e5)


def test_first_stiffness_is_that_of_filament_and_contact_in_series():
    """Contacts made rigid: EA/L of the free length, 0.885 N/mm a filament (Fig 4-5)."""
    stiff = replace(COULOMB, critical_slip=1e-4)
    column = replace(BUNDLE, EA=EA, pulley=stiff)
    r = pull(column, 30.0, 1.0)
    slope = (r.total[2] - r.total[1]) / (r.time[2] - r.time[1]) / column.speed  # nN/um = 1e-6 N/mm
    assert slope * 1e-6 == pytest.approx(0.885, rel=0.02)


def test_the_total_force_does_not_know_what_filaments_do_to_each_other():
    totals = []
    for mu_s0, mu_s, mu_k in ((0.23, 0.17, 0.16), (0.15, 0.12, 0.11), (0.45, 0.38, 0.36)):
        between = replace(LAW, mu_s0=mu_s0, mu_s=mu_s, mu_k=mu_k)
        totals.append(ratio(replace(COLUMN, filaments=4, nodes=12, EA=2.5 * EA, between=between), 2.5e5, 5e3)[1])
    assert totals[1] == pytest.approx(totals[0], rel=2e-3) and totals[2] == pytest.approx(totals[0], rel=2e-3)


def test_the_lowest_filament_carries_the_friction_where_contacts_give_way(column_pull):
    """Fig 4-11: with 20 um of critical slip nothing passes between filaments that all move with the crosshead."""
    r, _ = column_pull
    share = r.force[-1] * 10 / COLUMN.load
    assert share[0] > 3 and share[1] == pytest.approx(1.03, abs=0.01) and np.all(np.abs(share[2:] - 1) < 2e-3)
    assert np.all(np.diff(share) < 1e-9)


def test_all_filaments_have_one_belt_law_where_contacts_are_rigid():
    """Fig 4-13: ln(T2/T1) is one line for all, if filaments hold on to each other (mu between above the pulley's)."""
    strong = replace(LAW, mu_s0=0.45, mu_s=0.38, mu_k=0.36, **RIGID)
    r, _ = ratio(replace(COLUMN, between=replace(strong, critical_slip=1e-4)), 1.2e5, 4e3)
    logs = np.log(r.tension[-1][:, -1] / r.tension[-1][:, 0])
    assert logs == pytest.approx(0.24 * 1.435 * 0.96, rel=0.03)
    assert np.ptp(logs) < 0.01


@pytest.mark.parametrize("mu_s0, slips", [(0.23, True), (0.20, True), (0.26, False)])
def test_filaments_slip_on_each_other_below_the_pulleys_coefficient(mu_s0, slips):
    """The thesis finds slip at 0.20 and none at 0.23 beside a pulley of 0.24; rigid contacts part at 0.24 itself."""
    between = replace(LAW, mu_s0=mu_s0, mu_s=0.16, mu_k=0.14, **RIGID)
    r, _ = ratio(replace(COLUMN, filaments=5, EA=2 * EA, between=between), 1.24e5, 4e3)
    assert (np.abs(r.slip[-1][1]).max() > 2e-3) == slips


@pytest.fixture(scope="module")
def column_pull():
    return ratio(COLUMN, 4e5)


def test_ten_filaments_keep_step_with_the_law(column_pull):
    r, y = column_pull
    rigid = rigid_ratio(COLUMN.pulley, 1.435, r.time)
    assert np.sqrt(np.mean((y - rigid) ** 2)) < 5e-3  # the lowest filament stretches by 0.3 um at most
    assert y.max() == pytest.approx(float(tension_ratio(0.24, 1.435)), rel=4e-3)


def test_steps_do_not_matter():
    coarse, fine = (ratio(replace(BUNDLE, nodes=10), 2.4e5, step) for step in (8e3, 1e3))
    assert coarse[1] == pytest.approx(fine[1][::8], abs=1e-7)  # a node converges to 1e-9 of its load


def test_no_equilibrium_is_said_so():
    brittle = replace(COLUMN.between, critical_slip=1e-3, drop_slip=2.5e-4)  # falls faster than a filament gives way
    with pytest.raises(EngineError, match="no equilibrium"):
        pull(replace(COLUMN, between=brittle), 1.3e5, 4e3)
    for bad in ({"nodes": 2}, {"filaments": 0}, {"load": 0.0}):
        with pytest.raises(InputError):
            replace(BUNDLE, **bad)
    with pytest.raises(InputError):
        pull(BUNDLE, 1e3, 2e3)


@pytest.mark.validate
def test_two_seconds_of_ten_filaments_take_less_than_ten():
    begin = time.process_time()
    r, y = ratio(COLUMN, 2e6)
    assert time.process_time() - begin < 10
    assert y[r.time > 3e5].max() == pytest.approx(float(tension_ratio(0.16, 1.435)), rel=1e-3)


# --- features and sensitivities --------------------------------------------------------------------------------------


def test_sensitivities_as_the_figures_have_them():
    """Figs 4-7 to 4-9, base (0.22, 0.18, 0.16): printed +5 % sticking time, +8 % and +5 % relative amplitude."""
    s = sensitivities(LAW, 1.435)
    assert s["mu_s0", "slip"]["stick_time"] == 0.0  # Eqs 4-3: stiffness follows mu_s0, the slip does not
    assert s["mu_s0", "stiffness"]["stick_time"] == pytest.approx(0.01 / 0.22)  # the printed 5 %
    assert s["mu_s0", "slip"]["friction_amplitude"] == pytest.approx(0.0, abs=1e-12)
    base, up = features(LAW, 1.435), features(changed(LAW, "mu_s", 0.01), 1.435)
    # points of the friction force's relative amplitude: 14.2 to 21.5 %; the printed 8 %
    assert up.friction_amplitude - base.friction_amplitude == pytest.approx(0.073, abs=2e-3)
    less = features(changed(LAW, "mu_k", 0.01), 1.435)
    assert less.friction_amplitude < base.friction_amplitude  # the thesis prints a rise
    assert s["mu_k", "slip"]["frequency"] > 0.5 > 0 > s["mu_s", "slip"]["frequency"]


# --- identification --------------------------------------------------------------------------------------------------

RIG = TestRig(T1, WRAP)
TRUE = {"mu_s0": 0.22, "mu_s": 0.18, "mu_k": 0.16}


def two_seconds(seed, law=LAW, begin=0.0, noise=0.02):
    t = np.arange(1, 1001) * 2e-3
    f = T1 * np.exp(WRAP * law.coefficient(160 * t)) * (1 + noise * np.random.default_rng(seed).normal(size=1000))
    return t[t > begin] * 1e6, f[t > begin]


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("true", [(0.22, 0.18, 0.16), (0.22, 0.16, 0.15), (0.45, 0.38, 0.36)])
def test_coefficients_are_found_within_the_bar(seed, true):
    """2 % noise: identifiable coefficients within 0.005."""
    law = replace(LAW, mu_s0=true[0], mu_s=true[1], mu_k=true[2])
    found = idn.identify(*two_seconds(seed, law), RIG, LAW)
    for e, value in zip(found.estimates, true, strict=True):
        assert e.identifiable and e.value == pytest.approx(value, abs=0.005)
        assert abs(e.value - value) < 4.5 * e.error


@pytest.mark.parametrize("seed", range(2))
def test_what_the_data_do_not_tell_is_reported_so(seed):
    """No first peak; or 7 samples a second, none on it: mu_s0 follows from the period alone, and not well enough."""
    t, f = stick_slip_signal(seed)
    for signal in ((t * 1e6, f), two_seconds(seed, begin=0.4)):
        found = idn.identify(*signal, RIG, LAW)
        assert not found["mu_s0"].identifiable and "mu_s0" in found.verdict.weakest_text
        assert abs(found["mu_s0"].value - 0.22) < 4 * found["mu_s0"].error
        for name in ("mu_s", "mu_k"):
            assert found[name].identifiable and found[name].value == pytest.approx(TRUE[name], abs=0.005)


@pytest.mark.validate
def test_errors_are_as_large_as_they_say():
    off = []
    for seed in range(20):
        t, f = two_seconds(seed)
        found = idn.identify(t[::2], f[::2], RIG, LAW)
        off.append([(e.value - TRUE[e.name]) / e.error for e in found.estimates])
    assert np.all(np.std(off, axis=0) < 1.8) and np.all(np.std(off, axis=0) > 0.5)


def test_the_start_of_the_pull_can_be_fitted():
    t, f = two_seconds(1)
    found = idn.identify(t + 3e4, f, RIG, LAW, ("start",))
    assert found.start == pytest.approx(3e4, abs=1500) and found["mu_s0"].value == pytest.approx(0.22, abs=0.006)
    with pytest.raises(InputError, match="critical_slip"):
        idn.identify(t, f, RIG, LAW, ("speed",))
    with pytest.raises(InputError, match="pulled against the load"):
        idn.identify(t, T1**2 / f, RIG, LAW)


def test_errors_from_a_jacobian():
    rng = np.random.default_rng(0)
    a = rng.normal(size=(200, 3))
    v = idn.identifiability(("a", "b", "c"), a, 0.1)
    assert v.errors == pytest.approx(0.1 * np.sqrt(np.diag(np.linalg.inv(a.T @ a))))
    same = idn.identifiability(("a", "b", "c"), np.column_stack([a[:, :2], a[:, 1]]), 0.1)
    assert np.isinf(same.errors).tolist() == [False, True, True]
    assert same.weakest_text in ("0.71 b - 0.71 c", "0.71 c - 0.71 b", "- 0.71 b + 0.71 c", "- 0.71 c + 0.71 b")
    none = idn.identifiability(("a", "b"), np.column_stack([a[:, 0], 0 * a[:, 0]]), 0.1)
    assert np.isinf(none.errors).tolist() == [False, True]


def test_no_total_force_tells_the_friction_between_filaments():
    column = replace(COLUMN, filaments=3, nodes=8, EA=EA * 10 / 3)
    v = idn.column_identifiability(column, 5e3, 4e5, 0.02, 1e-3)
    tells = dict(zip(v.total.names, 1.96 * v.total.errors < idn.TOLERANCE, strict=True))
    assert [tells[f"pulley {n}"] for n in idn.COEFFICIENTS] == [True] * 3
    assert [tells[f"between {n}"] for n in idn.COEFFICIENTS] == [False] * 3


# --- LAMMPS ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("filaments, between", [(1, 0.22), (4, 0.15)])
def test_the_belt_law_in_lammps(tmp_path, filaments, between):
    """The bar: below 0.01 % at 30 nodes; and of it the polygon's 0.0065 % are known."""
    rig = Rig(filaments, 7.0, EA, 1.8 * math.pi * 49 / 4, 30, 19_000.0, 1.435, 4e4 * filaments)
    r = run_belt(find_engine(), tmp_path / "belt", rig, 0.22, between)
    assert r.ratio == pytest.approx(float(tension_ratio(0.22, 1.435)), rel=1e-4)
    assert r.ratio == pytest.approx(float(polygon_ratio(0.22, 1.435, 30)), rel=1e-5)
    assert r.tension[:, -1] * filaments == pytest.approx(rig.load, rel=1e-6)
    if filaments > 1:
        each = r.tension[:, 0] / r.tension[:, -1]
        assert each[0] > 1.5 > each[-1] > 1.1  # what one filament holds another is between them


def test_the_law_in_lammps_by_fix_external(tmp_path):
    """Masses x 1e7: the first peak within 1.5 % of the quasi-static model."""
    column = replace(COLUMN, filaments=2, nodes=10, EA=5 * EA)
    rig = Rig(2, 7.0, 5 * EA, 5 * 1.8 * math.pi * 49 / 4, 10, 19_000.0, 1.435, 4e5)
    run = run_dynamic(tmp_path / "dynamic", rig, Pull(1.6e-4, 2e5, 1e7, column.pulley, column.between))
    quasi, y = ratio(replace(column, free_length=float(rig.spacings.mean())), 2e5, 1e3)
    total = run.force.sum(axis=1) / 4e5
    assert total.max() == pytest.approx(y.max(), rel=0.015)
    assert total[0] == pytest.approx(1.0, abs=0.02)
    assert np.sqrt(np.mean((total - np.interp(run.time, quasi.time, y)) ** 2)) < 0.02


def test_a_child_that_fails_says_why(tmp_path, monkeypatch):
    from cgfibre.engine import capstan_dynamic

    rig = Rig(1, 7.0, EA, 1.8 * math.pi * 49 / 4, 5, 19_000.0, 1.435, 4e5)
    monkeypatch.setattr(capstan_dynamic, "asdict", lambda what: {})
    with pytest.raises(EngineError, match="fix external stopped"):
        run_dynamic(tmp_path / "dynamic", rig, Pull(1.6e-4, 2e5, 1e7, LAW, LAW))


# --- scene and verb --------------------------------------------------------------------------------------------------


def test_the_shipped_scene_is_table_4_2():
    s = load_capstan("capstan-column")
    assert s.name == "capstan-column" and s.description == scene_description("capstan-column")
    assert s.column() == replace(COLUMN, EA=s.filament.EA)
    assert validated(CapstanScene, tomllib.loads(s.to_toml())) == s
    one = load_capstan("capstan-column", ["capstan.model=bundle"]).column()
    assert (one.filaments, one.EA) == (1, pytest.approx(10 * EA))


@pytest.mark.parametrize(
    "override, key",
    [
        ("capstan.wrp=1 rad", "capstan.wrp"),
        ("capstan.wrap=1", "capstan.wrap"),
        ("capstan.pulley.mu_s=0.3", "capstan.pulley.mu_s"),
        ("capstan.between.mu_k=0.2", "capstan.between.mu_k"),
        ("capstan.pulley.mu_k=0", "capstan.pulley.mu_k"),
        ("capstan.nodes=2", "capstan.nodes"),
        ("capstan.step=3 s", "capstan.step"),
        ("capstan.tension=100 N", "capstan.tension"),
        ("capstan.model=tow", "capstan.model"),
        ("filament.material=wool", "filament.material"),
        ("platens.friction=0.3", "platens"),
        ("capstan.mu_s=0.1", "capstan.mu_s"),
        ("capstan.pulley.frequency=4 s", "capstan.pulley.frequency"),
    ],
)
def test_a_bad_capstan_scene_is_one_line_exit_2_and_nothing_written(tmp_path, monkeypatch, override, key):
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(main, ["capstan", "capstan-column", "--set", override])
    assert done.exit_code == 2, done.output
    lines = done.stderr.strip().splitlines()
    assert len(lines) == 1 and key in lines[0] and "expected" in lines[0]
    assert list(tmp_path.iterdir()) == []


def test_each_verb_sends_the_other_tests_scene_away(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for verb in ("run", "plan"):
        done = CliRunner().invoke(main, [verb, "capstan-column"])
        assert done.exit_code == 2 and "cgfibre capstan capstan-column" in done.stderr
    done = CliRunner().invoke(main, ["capstan", "carbon-7"])
    assert done.exit_code == 2 and "[capstan]" in done.stderr
    with pytest.raises(InputError, match="cgfibre capstan"):
        load_scene("capstan-column")
    assert list(tmp_path.iterdir()) == []
    assert "capstan-column" in CliRunner().invoke(main, ["scenes"]).stdout


def test_the_verb_leaves_what_it_says(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    t, f = two_seconds(0)
    np.savetxt("test.csv", np.column_stack([t * 1e-6, f]), delimiter=",", header="Time (s),Load (N)", comments="")
    small = ["capstan.filaments=3", "capstan.nodes=8", "capstan.duration=0.6 s", "capstan.step=4 ms"]
    call = ["capstan", "capstan-column", "--fit", "test.csv", "--input-tension", "0.52 N", "--wrap", "2.87 rad"]
    call += [x for s in small for x in ("--set", s)]
    done = CliRunner().invoke(main, call)
    assert done.exit_code == 0, done.output
    out = tmp_path / "results" / "capstan-column"
    summary = json.loads((out / "summary.json").read_text(), parse_constant=pytest.fail)
    assert summary["trusted"] and abs(summary["belt"]["error"]) < 1e-3 and "error" in done.stdout
    estimates = {e["name"]: e for e in summary["identified"]["estimates"]}
    assert estimates["mu_s0"]["value"] == pytest.approx(0.22, abs=0.005) and estimates["mu_s0"]["identifiable"]
    assert "not identifiable" in summary["identified"]["between"]
    assert summary["identifiability"]["total_force"]["errors"]["pulley mu_s"] < 0.003
    rows = np.genfromtxt(out / "capstan.csv", delimiter=",", names=True)
    assert rows["ratio"].max() == pytest.approx(summary["seen"]["peak"]) and len(rows) == 151
    assert rows["force_N"] == pytest.approx(sum(rows[f"force_{j}_N"] for j in (1, 2, 3)))
    wrap = np.genfromtxt(out / "wrap.csv", delimiter=",", names=True)
    assert wrap["angle_rad"][-1] == pytest.approx(1.435)
    for name in ("signal.png", "filaments.png", "wrap.png", "sensitivity.png", "fit.png", "capstan.h5", "scene.toml"):
        assert (out / name).exists(), name
    assert load_capstan(out / "scene.toml").capstan.filaments == 3
    again = CliRunner().invoke(main, call)
    assert again.exit_code == 2 and "--force" in again.stderr
    missing = CliRunner().invoke(main, [*call[:4], "--force"])
    assert missing.exit_code == 2 and "--input-tension" in missing.stderr
