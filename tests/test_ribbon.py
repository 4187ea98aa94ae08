"""Flat tows as ribbons of joined chains: geometry, gradients, plans, woven ones (bending and twist: test_cases.py)."""

from dataclasses import replace

import numpy as np
import pytest
from measure_systems import straight
from quitting import quit_when
from test_weave_scene import changed
from weave_bench import WeaveBench

from cgfibre import workflow
from cgfibre.build.ribbon import between, rungs, turns, twists
from cgfibre.build.weave import TowShape
from cgfibre.cases import capsule_ranks, ribbon
from cgfibre.engine.assemble import assemble
from cgfibre.engine.dump import read_record
from cgfibre.engine.lammps import find_engine, run_deck
from cgfibre.engine.plugin import find_plugin
from cgfibre.errors import InputError
from cgfibre.mechanics.ribbon import chord_loss, torsion_constant, twisting_moment
from cgfibre.plan.make import make_plan
from cgfibre.plan.ribbons import ribbon_bound, ribbon_elements
from cgfibre.plan.system import build_system
from cgfibre.plan.tows import second_moments, tow_models
from cgfibre.scene_reading import scene_from_dict

needs_plugin = pytest.mark.skipif(find_plugin(find_engine()) is None, reason="weaves need the plugin")

#: a flat tow in the small nylon weave: three chains, with more stiffness in its plane than out of it
FLAT = {"section": "racetrack", "width": "3 mm", "thickness": "0.6 mm", "filaments": 30, "ribbons": 3}
STIFF = FLAT | {"EI_in_plane": "2000 N*mm**2"}
FAST = {"output.frames": 4, "output.samples": 40, "model.accuracy": 0.1, "platens.stop": {"displacement": "30 um"}}


def flat(changes=None):
    return changed({"assembly.tow": STIFF} | (changes or {}))


def row(n_chains=4, n=9, closed=False, spacing=10.0, apart=25.0):
    """A straight ribbon of chains along x."""
    system = straight([(k * apart, 0) for k in range(n_chains)], n=n, spacing=spacing)
    box = np.array([[0.0, n * spacing], [-200.0, 200.0], [-200.0, 200.0]])
    return replace(
        system,
        tow=np.zeros(n_chains, dtype=np.int64),
        closed=np.full(n_chains, closed),
        box=box,
        periodic=np.array([closed, False, False]),
    )


# --- geometry and closed forms ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("closed", [False, True])
def test_joints_share_the_tow_among_them(closed):
    """Rungs and turns of a station stand for as much of the tow; every chain has an equal part of the turns."""
    system = row(closed=closed)
    across = rungs(system)
    length = 90.0 if closed else 80.0
    assert len(across.beads) == 3 * 9 and np.allclose(across.length, 25.0)
    assert np.sum(across.share) == pytest.approx(3 * length)
    for reach in (1, 2):
        found = turns(system, across, (reach,))
        inside = length if closed else length - (2 * reach - 1) * 10.0
        assert np.sum(found.share) == pytest.approx(inside)
        part = np.bincount(system.filament_of_bead[found.beads[:, 1]], found.share)
        assert np.allclose(part, inside / 4) and np.allclose(found.span, reach * 10.0)
        assert np.allclose(found.turn, 0) and np.all(system.filament_of_bead[found.beads[:, 0]] < 4)
    assert not len(turns(system, across, (0,)).beads)
    twist = twists(system, across)
    assert len(twist.beads) == 3 * (9 if closed else 8) and np.allclose(twist.twist, 0) and np.allclose(twist.arm, 25.0)
    axis = system.filament_of_bead[twist.beads[:, 1]]
    assert set(axis) == {1, 2}  # about the chains in the middle
    with pytest.raises(InputError, match="a quarter"):
        turns(row(closed=True), rungs(row(closed=True)), (3,))


def test_joints_as_built_know_the_shape():
    """An arc of radius R in the ribbon's plane turns by chords' span over R, a helicoid by tau s about its middle."""
    system = row(3)
    x, y = system.positions[:, 0], system.positions[:, 1] - 25.0
    R = 500.0
    arc = np.column_stack([(R - y) * np.sin(x / R), R - (R - y) * np.cos(x / R), np.zeros_like(x)])
    bent = replace(system, positions=arc)
    found = turns(bent, rungs(bent), (2,))
    middle = system.filament_of_bead[found.beads[:, 1]] == 1
    assert np.allclose(np.abs(found.turn[middle]), 2 * np.sin(10.0 / R), rtol=1e-6)  # of two chords of 20 um
    tau = 1e-3
    turned = np.column_stack([x, y * np.cos(tau * x), y * np.sin(tau * x)])
    assert np.allclose(np.abs(twists(replace(system, positions=turned), rungs(system)).twist), tau * 10.0, rtol=1e-4)


def test_torsion_constants_and_moments():
    """Ellipse exact, thin rectangle w t^3/3; a ribbon's moment is the slope of its energy."""
    a, b = 250.0, 35.0
    ellipse = torsion_constant(np.pi * a * b**3 / 4, np.pi * a**3 * b / 4)
    assert ellipse == pytest.approx(np.pi * a**3 * b**3 / (a**2 + b**2))
    assert torsion_constant(*second_moments(TowShape("rectangular", 500.0, 5.0))) == pytest.approx(
        500 * 5**3 / 3, rel=2e-4
    )
    y, EA, EI, P = np.array([-3.0, -1.0, 2.0]), np.array([5.0, 6.0, 7.0]), 0.2, np.array([0.1, 0.0, 0.3])

    def energy(tau):
        strain, bend = np.sqrt(1 + (y * tau) ** 2) - 1, y * tau**2 / (1 + (y * tau) ** 2)
        return 2.0 * tau**2 / 2 + np.sum(EA * strain**2 / 2 + P * strain + EI * bend**2 / 2)

    for tau in (1e-3, 2e-2):
        slope = (energy(tau * 1.001) - energy(tau * 0.999)) / (0.002 * tau)
        assert twisting_moment(tau, 2.0, y, EA, EI, P) == pytest.approx(slope, rel=2e-3)
    assert chord_loss(10.0, 1000.0) == pytest.approx((2 * np.pi / 100) ** 2 / 6, rel=1e-3)


# --- the styles' forces ----------------------------------------------------------------------------------------------


def energy_of(system, elements):
    """Of rungs, turns and twists, by formulas of their own."""
    across, turn, twist = elements
    r = np.linalg.norm(between(system, *across.beads.T), axis=1)
    found = np.sum(across.stiffness * (r - across.rest) ** 2) / 2
    one, two, e = (between(system, turn.beads[:, i], turn.beads[:, j]) for i, j in ((0, 1), (1, 2), (1, 3)))
    unit = [v / np.linalg.norm(v, axis=1)[:, None] for v in (one, two, e)]
    q = np.sum((unit[1] - unit[0]) * unit[2], axis=1)
    found += np.sum(turn.stiffness * (q - turn.rest) ** 2) / 2
    b, a, a2, b2 = (system.positions[twist.beads[:, k]] for k in range(4))
    axis = (a2 - a) / np.linalg.norm(a2 - a, axis=1)[:, None]
    u, v = (w - np.sum(w * axis, axis=1)[:, None] * axis for w in (b - a, b2 - a2))
    phi = np.arctan2(np.sum(np.cross(u, v) * axis, axis=1), np.sum(u * v, axis=1))
    return found + np.sum(twist.stiffness * (1 - np.cos(phi - twist.rest)))


def crooked(tmp_path, ranks=1, size=1.0, shape=None):
    """Positions, forces and virial of a ribbon's joints alone, all beads displaced; turns over three segments."""
    plan, system, _ = ribbon.ribbon(2.0, ribbon.LENGTH, 3)
    if shape is not None:
        system = replace(system, positions=shape(system.positions))
    plan, system = ribbon.joints_alone(plan, system)
    return system, plan, *ribbon.crooked(tmp_path / f"ranks-{ranks}", plan, system, size, ranks)


@needs_plugin
def test_forces_of_joints_are_the_gradient_of_their_energy_and_leave_nothing_over(tmp_path):
    system, plan, x, force, virial = crooked(tmp_path)
    assert np.ptp(x - system.positions) > 1.5
    elements = ribbon_elements(system, plan.ribbon)
    moved_system = replace(system, positions=x)
    largest = np.max(np.abs(force))
    assert np.allclose(np.sum(force, axis=0), 0, atol=1e-12 * largest)
    assert np.allclose(np.sum(np.cross(x - x.mean(axis=0), force), axis=0), 0, atol=1e-12 * largest * np.ptp(x))
    moment = x.T @ force
    stress = np.append(np.diag(moment), moment[(0, 0, 1), (1, 2, 2)])
    assert np.allclose(virial, stress, rtol=0, atol=1e-10 * np.max(np.abs(stress)))
    h = 1e-4
    for bead, axis in ((0, 0), (25, 1), (30, 2), (45, 0), (62, 1), (7, 2)):
        step = np.zeros_like(x)
        step[bead, axis] = h
        up, down = (energy_of(replace(moved_system, positions=x + s * step), elements) for s in (1, -1))
        assert force[bead, axis] == pytest.approx(-(up - down) / (2 * h), rel=1e-5, abs=1e-7 * largest)
    # and two ranks find them too
    _, _, same, others, _ = crooked(tmp_path, ranks=2)
    assert np.array_equal(same, x) and np.allclose(others, force, rtol=0, atol=1e-11 * largest)


@needs_plugin
def test_a_ribbon_of_any_shape_is_at_rest_as_built(tmp_path):
    """Bent in its plane and out of it, and twisted."""

    def shape(p):
        x, y = p[:, 0], p[:, 1]
        a = 2e-3 * x
        return np.column_stack([x, 1e-3 * x**2 + y * np.cos(a), 2e-3 * x**2 + y * np.sin(a)])

    system, _, _, rest, _ = crooked(tmp_path / "rest", size=0.0, shape=shape)
    _, _, _, off, _ = crooked(tmp_path / "off", size=1e-2, shape=shape)
    assert np.max(np.abs(rest)) < 1e-5 * np.max(np.abs(off))  # types agree in ten digits
    assert np.ptp(turns(system, rungs(system), (3,)).turn) > 0.05 and np.max(twists(system, rungs(system)).twist) > 0.02


def test_the_bound_of_the_time_step_holds_and_is_near():
    """Largest eigenvalue of the joints' stiffness matrix (second differences of their energy), on a curved ribbon."""
    plan, system, _ = ribbon.ribbon(2.0, 8.0, 2)
    x = system.positions
    system = replace(system, positions=np.column_stack([x[:, 0], x[:, 1], 2e-3 * x[:, 0] ** 2]))
    elements = ribbon_elements(system, plan.ribbon)
    n, h = 3 * system.n_beads, 1e-2

    def energy(*steps):
        moved_by = np.zeros(n)
        for i, step in steps:
            moved_by[i] += step
        return energy_of(replace(system, positions=system.positions + moved_by.reshape(-1, 3)), elements)

    matrix = np.zeros((n, n))
    for i in range(n):
        for j in range(i, n):
            signs = [(a, b) for a in (1, -1) for b in (1, -1)]
            matrix[i, j] = matrix[j, i] = sum(a * b * energy((i, a * h), (j, b * h)) for a, b in signs) / (4 * h * h)
    top, bound = np.max(np.linalg.eigvalsh(matrix)), np.max(np.sum(ribbon_bound(system, plan.ribbon), axis=0))
    assert 0.4 * bound < top < bound  # joints of three kinds are added, though they act in directions of their own


# --- planning --------------------------------------------------------------------------------------------------------


def test_what_flat_tows_are_given():
    """Loose filaments bend alike both ways, solids by their section; the key is refused where it has no meaning."""
    loose = scene_from_dict(flat({"assembly.tow": FLAT}))
    (warp, weft), plan = tow_models(loose), make_plan(loose)
    assert warp == weft and warp.EI_in_plane == warp.whole.EI
    assert plan.ribbon.bending == (0.0, 0.0) and plan.ribbon.reach == (0, 0) and plan.ribbon.twist[0] == warp.whole.GJ
    solid = scene_from_dict(flat({"assembly.tow": FLAT | {"modulus": "1 GPa"}}))
    warp = tow_models(solid)[0]
    out, across = second_moments(warp.shape)
    assert warp.EI_in_plane / warp.whole.EI == pytest.approx(across / out) and across > 20 * out
    assert make_plan(solid).ribbon.reach == (0, 0)  # platens bend no tow in its plane
    moved_cell = scene_from_dict(flat({"assembly.tow": FLAT | {"modulus": "1 GPa"}, "cell.shear": "5 deg"}))
    assert make_plan(moved_cell).ribbon.reach[0] >= 1
    given_EI = scene_from_dict(flat({"assembly.tow": FLAT | {"modulus": "1 GPa", "EI": "20 N*mm**2"}}))
    assert tow_models(given_EI)[0].EI_in_plane == pytest.approx(20e15)
    for tow, expected in (
        (FLAT | {"EI_in_plane": "1 N*mm**2"}, "at least EI"),
        ({"thickness": "1.2 mm", "filaments": 30, "EI_in_plane": "2000 N*mm**2"}, "one chain"),
    ):
        with pytest.raises(InputError, match=expected) as caught:
            make_plan(scene_from_dict(flat({"assembly.tow": tow})))
        assert caught.value.key == "assembly.tow.EI_in_plane"


def test_turns_and_rungs_are_planned_so_that_they_keep_the_time_step():
    """Stiffer in the plane: longer chords; a law stiffer than the filaments: softer rungs, and the plan says so."""
    plans = [
        make_plan(scene_from_dict(flat({"assembly.tow": FLAT | {"EI_in_plane": f"{x} N*mm**2"}}))) for x in (2e3, 4e4)
    ]
    alone = make_plan(scene_from_dict(flat({"assembly.tow": FLAT})))
    assert 1 <= plans[0].ribbon.reach[0] < plans[1].ribbon.reach[0]
    assert all(0.93 * alone.timestep < p.timestep <= alone.timestep for p in plans)
    said = {c.what: c for c in plans[1].choices}
    assert f"chords of {plans[1].ribbon.reach[0]} segments" in said["bending in the ribbons' plane"].reason
    hard = make_plan(scene_from_dict(flat({"contact": {"law": "linear", "stiffness": 10.0}})))
    assert "times softer" in {c.what: c.reason for c in hard.choices}["across the ribbons"]
    assert alone.predicted_seconds / alone.planned_steps < plans[0].predicted_seconds / plans[0].planned_steps


def test_what_the_deck_is_given():
    scene = scene_from_dict(flat())
    plan = make_plan(scene)
    system = build_system(scene, plan)
    deck = assemble(system, plan)
    by_name = {t.name: t for t in deck.data.topologies}
    across, turn, twist = ribbon_elements(system, plan.ribbon)
    assert len(by_name["Bond"].members) == len(system.bonds()) + len(across.beads)
    assert len(by_name["Improper"].members) == len(turn.beads) and len(by_name["Dihedral"].members) == len(twist.beads)
    assert (deck.parameters["in_plane"], deck.parameters["torsion"]) == ("ribbon", "ribbon")
    reach = np.max(np.linalg.norm(between(system, turn.beads[:, 1], turn.beads[:, 2]), axis=1))
    assert deck.parameters["ghost_cutoff_um"] > max(reach, np.max(across.rest))
    apart = assemble(system, replace(plan, ribbon=None))
    assert {t.name for t in apart.data.topologies} == {"Bond", "Angle"} and "torsion" in apart.parameters


# --- woven -----------------------------------------------------------------------------------------------------------


@pytest.fixture
def weave(tmp_path):
    """Runs the small weave of flat tows with changes, in a folder of its own a call."""
    return WeaveBench(tmp_path, lambda changes: flat(FAST | changes))


@needs_plugin
def test_rungs_are_no_segments(tmp_path):
    """Contacts of a weave squeezed together are those of the same weave without rungs, closed and open."""
    for cell in ("periodic", "patch"):
        scene = scene_from_dict(flat({"assembly.cell": cell}))
        plan = make_plan(scene)
        system = build_system(scene, plan)
        low = replace(system, positions=system.positions * np.array([1.0, 1.0, 0.8]))
        found = [
            capsule_ranks.forces(tmp_path / f"{cell}-{p.ribbon is None}", low, p, 1)[1]
            for p in (plan, replace(plan, ribbon=None))
        ]
        assert len(found[0]) > 40 and np.allclose(found[0], found[1], rtol=1e-12, atol=1e-12)


@needs_plugin
def test_a_joined_weave_keeps_its_width(weave):
    """Also on two ranks, to the same curve."""
    one = weave("one", {})
    force = one.curve["force_top_N"]
    assert one.trusted, one.summary["warnings"]
    statistics = {name: values for name, (values, _) in one.review.statistics.items()}
    assert np.allclose(statistics["width_warp_between"], 3000.0, rtol=1e-3)
    two = weave("two", {}, ranks=2).curve["force_top_N"]
    assert np.allclose(two[:6], force[:6], rtol=1e-9)
    assert np.allclose(two, force, rtol=5e-3, atol=5e-3 * force.max())  # later slips amplify rounding


@needs_plugin
def test_a_resumed_joined_weave_repeats_the_unbroken_one_step_by_step(weave):
    """Rungs, turns and twist come back from a checkpoint."""
    changes = {"platens.stop": {"displacement": "15 um"}}
    weave("unbroken", changes)
    out = weave.folder / "quit"
    folder = workflow.build_scene(weave.scene(changes), out)
    states = quit_when(folder, "in.chain", "$(step) >= 1")
    assert 0 < states[0].step
    weave("quit", changes, resume=True)
    assert (out / "curve.csv").read_text() == (weave.folder / "unbroken" / "curve.csv").read_text()


@needs_plugin
def test_without_platens_a_joined_weave_stays(weave):
    folder = workflow.build_scene(weave.scene({}), weave.folder / "rest")
    far = {"platen_top_um": "1e4", "platen_bottom_um": "-1e4", "load_steps": "1000"}
    run_deck(find_engine(), folder, "in.chain", 1, far)
    load = 1e9  # nN um, less than 1e-3 of what pressing it by 60 um takes
    assert np.max(read_record(folder).mean["kinetic"]) < 1e-15 * load
