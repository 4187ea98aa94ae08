import math

import numpy as np
import pytest
from test_weave_scene import changed

from cgfibre.build.weave import TowShape, initial_overlap
from cgfibre.engine.assemble import assemble
from cgfibre.engine.fabric import bending_forces, rest_forces
from cgfibre.plan.arches import arches
from cgfibre.plan.make import make_plan, other_levels
from cgfibre.plan.model import every_bead
from cgfibre.plan.system import build_system
from cgfibre.plan.tow_law import ChainLaw, TowLaw, chain_law, crossing_law, tow_law
from cgfibre.plan.tows import second_moments, tow_models
from cgfibre.plan.weave_filaments import FibreMat
from cgfibre.plan.weave_tows import fabric
from cgfibre.scene_reading import load_scene, scene_from_dict


def crossing_force(law, overlap, diameter):
    """int f(delta - s^2/(2 D)) ds over the lens."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, 4001)  # s = half sin(angle)
    half = math.sqrt(2 * diameter * overlap)
    return half * np.trapezoid(law(overlap * np.cos(angle) ** 2) * np.cos(angle), angle)


@pytest.mark.parametrize("power", [1.0, 1.5, 2.0])
def test_a_law_of_crossings_meets_the_force_that_it_was_made_for(power):
    """F = c delta^n: f = c n B(n, 1/2)/(pi sqrt(2 D)) y^(n - 1/2); n = 3/2 is the linear law."""
    d, c = 100.0, 3.0
    x = np.linspace(0, 10, 2001)
    y = np.linspace(0, 10, 101)
    f = crossing_law(x, c * x**power, d, y)
    beta = math.gamma(power) * math.gamma(0.5) / math.gamma(power + 0.5)
    exact = c * power * beta / (math.pi * math.sqrt(2 * d)) * y ** (power - 0.5)
    assert np.allclose(f, exact, rtol=2e-4, atol=1e-4 * exact[-1])
    for overlap in (2.0, 7.0):
        force = crossing_force(lambda z: np.interp(z, y, f), overlap, d)
        assert force == pytest.approx(c * overlap**power, rel=4e-3)


def test_ribbons_share_the_pressure_whatever_their_number():
    """n x n crossings carry p w^2, and a platen p w a length, at twice the overlap of a platen."""
    p = np.linspace(0, 50, 51) ** 1.3
    law = TowLaw(np.linspace(0, 50, 51), p, pressure=True)
    for n in (1, 3, 5):
        chain = chain_law(law, 70.0, 500.0, n)
        force = n * n * crossing_force(chain.force, 20.0, 70.0)
        assert force == pytest.approx(np.interp(20, law.overlap, p) * 500**2, rel=1e-2)
        assert n * chain.force(np.array(10.0), platen=True) == pytest.approx(
            np.interp(20, law.overlap, p) * 500, rel=5e-3
        )


def test_linear_and_exponential_laws_have_the_stiffness_asked_for():
    linear = tow_law(scene_from_dict(changed({"contact": {"law": "linear", "stiffness": 0.2}})), 1e6)
    assert linear.stiffness == 2e5 and np.allclose(np.diff(linear.load) / np.diff(linear.overlap), 2e5)
    soft = tow_law(
        scene_from_dict(changed({"contact": {"law": "exponential", "stiffness": 0.2, "rise": "100 um"}})), 1e6
    )
    slope = np.diff(soft.load) / np.diff(soft.overlap)
    assert np.all(np.diff(slope) > -1e-6 * 2e5) and slope[0] < 0.06 * 2e5 and slope[-1] == pytest.approx(2e5)
    assert np.all(soft.load <= linear.load + 1e-9)


def test_tows_have_the_rigidities_of_their_filaments_or_of_a_solid():
    scene = scene_from_dict(changed({}))
    warp, _ = tow_models(scene)
    E, d = 1.05e6, 300.0
    assert warp.whole.EA == pytest.approx(30 * E * math.pi * d**2 / 4)
    assert warp.whole.EI == pytest.approx(30 * E * math.pi * d**4 / 64)
    assert warp.modulus == pytest.approx(E) and warp.chains == 1
    flat = {"section": "rectangular", "width": "4 mm", "thickness": "0.5 mm", "modulus": "2 GPa"}
    warp, _ = tow_models(scene_from_dict(changed({"assembly.tow": flat, "assembly.spacing": "6 mm"})))
    assert warp.whole.EA == pytest.approx(2e6 * 4000 * 500) and warp.modulus == pytest.approx(2e6)
    assert warp.whole.EI == pytest.approx(2e6 * 4000 * 500**3 / 12, rel=1e-4)
    assert warp.chains > 1 and warp.chains * warp.chain.EI == pytest.approx(warp.whole.EI)
    out, across = second_moments(TowShape("circular", 10.0, 10.0))
    assert out == pytest.approx(math.pi * 10**4 / 64, rel=1e-5) and across == pytest.approx(out, rel=1e-5)


@pytest.mark.parametrize("name", ["nylon-weave", "carbon-weave", "glass-weave", "glass-twill", "carbon-satin"])
def test_no_shipped_weave_overlaps_as_built(name):
    scene = load_scene(name)
    system = build_system(scene, make_plan(scene))
    overlap = initial_overlap(system, between_tows=True)[0]
    assert overlap < 1e-3 * min(scene.weave.tow.thickness, scene.weave.weft.thickness)


def test_constant_forces_balance_the_bending_of_the_shape_as_built():
    """The forces are the gradient of K (1 + cos theta), act on no tow as a whole, and are what the data file holds."""
    scene = scene_from_dict(changed({}))
    plan = make_plan(scene)
    system = build_system(scene, plan)
    hinge = every_bead(system, plan.beads.hinge)
    force = bending_forces(system, hinge)
    assert np.allclose(rest_forces(system, plan), -force)
    for i in range(system.n_filaments):
        a, b = system.filament_start[i : i + 2]
        assert np.allclose(force[a:b].sum(axis=0), 0, atol=1e-9 * np.abs(force).max())

    def energy(positions):
        moved = type(system)(**{**vars(system), "positions": positions})
        angles, vectors, bonds = moved.angles(), moved.bond_vectors(), moved.bonds()
        at = np.zeros(system.n_beads, dtype=int)
        at[bonds[:, 0]] = np.arange(len(bonds))
        u, v = -vectors[at[angles[:, 0]]], vectors[at[angles[:, 1]]]
        cosine = np.sum(u * v, axis=1) / np.linalg.norm(u, axis=1) / np.linalg.norm(v, axis=1)
        return hinge[angles[:, 1]] * (1 + cosine)

    for bead, axis in ((3, 2), (10, 0), (40, 1)):
        h = 1e-2
        step = np.zeros_like(system.positions)
        step[bead, axis] = h
        slope = np.sum(energy(system.positions + step) - energy(system.positions - step)) / (2 * h)
        assert force[bead, axis] == pytest.approx(-slope, rel=1e-4, abs=1e-5 * np.abs(force).max())
    deck = assemble(system, plan)
    assert np.array_equal(deck.data.rest, -force) and deck.parameters["rest"] == "built"
    woven_in = scene_from_dict(changed({"assembly.rest": "woven-in"}))
    assert assemble(build_system(woven_in, make_plan(woven_in)), make_plan(woven_in)).data.rest is None


def test_static_estimate_is_hertz_like_for_the_linear_law():
    """One crossing of tows that are no arches: F = 4/3 k sqrt(2 D) delta^1.5."""
    scene = scene_from_dict(changed({"contact": {"law": "linear"}, "assembly.tow.EI": "1e-6 N*mm**2"}))
    system = build_system(scene, make_plan(scene))
    k = 1e5
    d = np.linspace(0, 600, 400)
    law = ChainLaw((d, k * d, None), (d / 2, k * d, None), k)
    estimate = fabric(scene, system, (law, law))
    assert estimate.crossings == 4
    assert estimate.pair(50.0) == pytest.approx(4 / 3 * k * math.sqrt(2 * 1200) * 50**1.5, rel=1e-3)
    apart = scene_from_dict(changed({"assembly.gap": "50 um", "assembly.tow.EI": "1e-6 N*mm**2"}))
    gap = fabric(apart, build_system(apart, make_plan(apart)), (law, law))
    assert gap.pair(50.0) < 1e-6 * estimate.pair(50.0) and gap.pair(100.0) == pytest.approx(
        estimate.pair(50.0), rel=1e-6
    )
    for f in (1e8, 1e9):
        assert estimate.force(estimate.displacement(f)) == pytest.approx(f, rel=1e-6)
        assert estimate.stiffness(f) > f / estimate.displacement(f)  # it stiffens


def test_flanks_of_held_tows_are_arches():
    """Two flanks a crest, of the cosine z = h cos(pi x/p): c = (pi h/(2 p))^2 and tan(slope) = pi h/p for small h/p."""
    scene = scene_from_dict(changed({"assembly.spacing": "20 mm", "model.spacing": "0.2 mm"}))
    system = build_system(scene, make_plan(scene))
    h, p, EA, EI = 600.0, 2e4, system.types[0].EA, system.types[0].EI
    a = 6.0
    thrust = EA * (math.pi * h / 2 / p) ** 2 * (1 - (1 - a / h) ** 2)
    expected = 2 * thrust * math.sin(math.atan(math.pi * (h - a) / p))
    bending = 48 * EI * a / p**3
    assert 0.01 * expected < bending and thrust < 4 * math.pi**2 * EI / p**2
    assert arches(scene, system, 1.0)(2 * a) == pytest.approx(expected + bending, rel=0.01)
    assert arches(scene, system, 10.0)(2 * a) == pytest.approx(expected / 10 + bending, rel=0.01)
    # a strut between clamped ends: further down the flank has its greatest thrust and leans less
    deep = 2 * 4 * math.pi**2 * EI / p**2 * math.sin(math.atan(math.pi * (h - 200) / p)) + 48 * EI * 200 / p**3
    assert arches(scene, system, 1.0)(400.0) == pytest.approx(deep, rel=0.01)
    half = scene_from_dict(
        changed({"assembly.spacing": "20 mm", "model.spacing": "0.2 mm", "cell.tension.warp": "1 N"})
    )
    assert arches(half, system, 1.0)(2 * a) == pytest.approx(expected / 2 + bending, rel=0.01)


def test_fibre_mat_inverts_itself():
    mat = FibreMat(1e6, 0.4, 2000.0, 1e8)
    for d in (10.0, 200.0, 600.0):
        f = mat.force(d)
        assert mat.displacement(f) == pytest.approx(d)
        h = 1e-3 * d
        assert mat.stiffness(f) == pytest.approx((mat.force(d + h) - mat.force(d - h)) / (2 * h), rel=1e-4)


def test_plans_say_what_the_other_resolution_would_be():
    flat = {"section": "lenticular", "width": "4.4 mm", "thickness": "1.2 mm", "filaments": 4}
    scene = scene_from_dict(changed({"assembly.tow": flat}))
    plan = make_plan(scene)
    other = other_levels(scene, plan)
    assert list(other) == ["rod", "filament"] and other["filament"].n_filaments == 16 > plan.n_filaments
    assert other["rod"].key == "model.level"  # too flat to roll
    solid = scene_from_dict(changed({"assembly.tow": {"thickness": "1.2 mm", "modulus": "1 GPa"}}))
    other = other_levels(solid, make_plan(solid))
    assert other["filament"].key == "assembly.tow.filaments" and other["rod"].level == "rod"
