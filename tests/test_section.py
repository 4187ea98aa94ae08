"""Sections: springs of any law, staged contacts, balances, plans of every count."""

from dataclasses import replace

import numpy as np
import pytest

from cgfibre import review
from cgfibre.cases.pressing import pressed_deep
from cgfibre.engine.collect import read_run
from cgfibre.engine.dump import read_states
from cgfibre.engine.job import run_job, write_job
from cgfibre.engine.lammps import find_engine
from cgfibre.errors import InputError
from cgfibre.measure import guards
from cgfibre.plan.contact import OVERLAP_LIMIT
from cgfibre.plan.make import make_plan
from cgfibre.plan.system import build_system
from cgfibre.record import Balance, Curve
from cgfibre.scene_reading import load_scene, scene_from_dict


def scene(count=19, length="0.7 mm", stop="8 um", **model):
    return scene_from_dict(
        {
            "filament": {"material": "T700 carbon"},
            "assembly": {"count": count, "length": length, "jitter": "0.01 um", "seed": 1},
            "platens": {"width": "0.5 mm", "stop": {"displacement": stop}},
            "model": {"level": "section", **model},
            "output": {"samples": 100, "frames": 5},
        }
    )


def pressed(folder, s, ranks=1, change=lambda plan: plan):
    plan = change(make_plan(s))
    system = build_system(s, plan)
    write_job(folder, system, plan, "test")
    run_job(find_engine(), folder, plan, ranks, False)
    return plan, system, *read_run(folder, system, plan)


@pytest.mark.parametrize(
    ("level", "spacing"), [("section", 0.0), pytest.param("chain, capsules", 4.0, marks=pytest.mark.validate)]
)
def test_deep_deflection_is_the_elastica(tmp_path, level, spacing):
    # 0.44 of the free span, where linear springs are 30 % soft; inertia and the dent at the edges take the rest
    for measured in pressed_deep(tmp_path, level, spacing, 45.0):
        assert measured.error == pytest.approx(0, abs=0.015)


@pytest.mark.parametrize("count", [37, 127, 169, 331, 547, 11719])
def test_every_count_has_a_plan(count):
    plan = make_plan(load_scene("carbon-12k-section", [f"assembly.count={count}", "platens.stop={thickness='36 um'}"]))
    assert plan.disc_fixes == "plugin" and plan.n_filaments == count and plan.stiffen > 1
    assert plan.predicted_seconds < 600


@pytest.mark.parametrize("arrangement", ["hexagonal", "rectangular", "elliptic", "racetrack"])
def test_any_count_in_other_arrangements(arrangement):
    changes = ["assembly.count=130", f'assembly.arrangement="{arrangement}"', "platens.stop.displacement='8 um'"]
    assert make_plan(load_scene("carbon-127-section", changes)).n_filaments == 130


def test_springs_by_the_deflection():
    assert make_plan(scene(stop="8 um")).spring_law is None  # less than a tenth of the free span
    law = make_plan(scene(count=37, stop="27 um")).spring_law
    assert law is not None and law.deflection[-1] >= 27
    assert make_plan(scene(count=37, stop="27 um", spring="exact")).spring_law is None
    bare = scene(spring="elastica").model_dump(exclude_none=True)
    bare["contact"]["shape"] = "beads"  # what the workflow says without a plugin
    with pytest.raises(InputError, match="plugin"):
        make_plan(scene_from_dict(bare))


def test_contacts_become_real_in_the_jam(tmp_path):
    s = scene(count=37, length="345 mm", stop="42 um")
    plan, system, curve, frames, extremes = pressed(tmp_path, s)
    balance = extremes.balance
    assert balance.factor[-1] > 5 and np.all(np.diff(balance.factor) >= 0)
    assert curve["displacement_um"][-1] == pytest.approx(42, rel=0.01)
    deepest = np.max((1 - extremes.closest / 7.0) * (1 - balance.factor[1:] / plan.contact.softening))
    assert 0.005 < deepest < OVERLAP_LIMIT
    found = {g.name: g for g in review.review_run(s, plan, system, curve, frames, extremes).guards}
    for name in ("force balance", "energy balance", "overlap of filaments", "lost beads", "motion as planned"):
        assert found[name].ok, found[name].message
    assert np.isfinite(found["force balance"].value)


def test_frames_have_the_forces_of_stiffened_contacts(tmp_path):
    """At rest in the jam: their energy is the one that the engine counted in its contacts."""
    data = scene(count=19, length="345 mm", stop="27 um").model_dump(exclude_none=True)
    data["platens"]["hold"] = "2000 us"
    s = scene_from_dict(data)
    plan, system, _, frames, extremes = pressed(tmp_path, s)
    factor, positions = float(frames.factor[-1]), frames.positions[-1]
    assert factor > 5 and factor == pytest.approx(extremes.balance.factor[-1])
    between = review.contacts_under_platen(plan, system, positions, factor)
    energy = 0.5 * np.sum(between.force * between.overlap)
    for gap in review.platen_gaps(plan, system, float(frames.displacement_um[-1])):
        energy += 0.5 * factor * plan.platens.kn * np.sum(np.maximum(3.5 - gap(positions), 0) ** 2)
    assert energy * 1e-15 == pytest.approx(extremes.balance.contact[-1], rel=1e-4)
    statistics = review.frame_statistics(s, plan, system, frames)
    assert statistics["contact_force_mean"][0][-1] == pytest.approx(np.mean(between.force))


def test_a_resumed_jam_repeats_the_unbroken_one(tmp_path):
    """From the last checkpoint but one: springs' places, turns, factor and pace come back, to the last digit."""
    plan, system, curve, _, whole = pressed(tmp_path, scene(count=19, length="345 mm", stop="27 um"))
    assert whole.balance.factor[-1] > 1
    newest, older = read_states(tmp_path)
    assert 0 < older.step < newest.step
    (tmp_path / newest.file).unlink()
    run_job(find_engine(), tmp_path, plan, 1, True)
    again, _, resumed = read_run(tmp_path, system, plan)
    for name in ("step", "force_top_N", "stored_J", "kinetic_J"):
        assert np.array_equal(again[name], curve[name])
    assert np.array_equal(resumed.balance.factor, whole.balance.factor)


def test_energy_without_friction(tmp_path):
    """Springs alone: what the platen does is in them, but for damping."""
    data = scene(count=1, stop="3 um").model_dump(exclude_none=True)
    data["contact"]["friction"] = data["platens"]["friction"] = 0.0
    _, _, curve, _, extremes = pressed(
        tmp_path,
        scene_from_dict(data),
        change=lambda p: replace(p, stiffen=1.0),
    )
    assert guards.section_energy(curve, extremes.balance).value < 0.02
    assert (curve["stored_J"] + curve["kinetic_J"])[-1] == pytest.approx(curve["work_J"][-1], rel=0.03)


def test_two_ranks_share_the_discs(tmp_path):
    one, two = (pressed(tmp_path / str(n), scene(), ranks=n) for n in (1, 2))
    assert two[2]["force_top_N"][-30:].mean() == pytest.approx(one[2]["force_top_N"][-30:].mean(), rel=0.03)
    assert two[4].balance.springs[-1] == pytest.approx(one[4].balance.springs[-1], rel=0.05)


def curve_of(time, **columns):
    zero = np.zeros(len(time))
    names = ("step", "displacement_um", "thickness_um", "force_top_N", "force_bottom_N", "pressure_MPa")
    names += ("fibre_volume_fraction", "kinetic_J", "stored_J", "work_J")
    values = {name: zero for name in names} | {"time_us": time} | columns
    return Curve(values, np.zeros(len(time), dtype=int), zero + 1)


def test_balances_of_a_known_motion():
    """A body of 2 kg (N us2/um) pushed so that x = t^3: springs 5 x, work F dx, contacts that double on the way."""
    t = np.linspace(0, 1, 2001)
    x, v, a = t**3, 3 * t**2, 6 * t
    springs, momentum = -5 * -x, 2 * -v  # it goes down, springs push it up
    top = 2 * a + 5 * x
    factor, contact = 1 + t, 0 * t
    ok = Balance(springs, 0 * t, momentum, contact, factor)
    work = np.concatenate([[0], np.cumsum(0.5 * (top[1:] + top[:-1]) * np.diff(x))])
    energy = {"stored_J": 2.5 * x**2, "kinetic_J": v**2, "work_J": work}
    curve = curve_of(t, force_top_N=top, **energy)
    assert guards.section_balance(curve, ok).value < 1e-3
    assert guards.section_inertia(curve, ok, 0.05).value == pytest.approx((2 * a).sum() / top.sum(), rel=0.05)
    assert not guards.section_balance(curve, replace(ok, springs=0.7 * springs)).ok
    even = replace(ok, factor=np.ones_like(t))
    assert guards.section_energy(curve, even).value < 1e-3
    assert not guards.section_energy(curve_of(t, force_top_N=top, **energy | {"work_J": 0.9 * work}), even).ok
    # energy that stiffening put in is no excess: contacts of energy 1 that double at once
    stiff = replace(even, factor=np.where(t < 0.5, 1.0, 2.0), contact=np.where(t < 0.5, 1.0, 2.0))
    still = curve_of(t, force_top_N=0 * t, stored_J=stiff.contact, work_J=0 * t + 1)
    assert guards.section_energy(still, stiff).value == pytest.approx(0, abs=1e-6)
