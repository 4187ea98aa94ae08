"""Weaves whose tows or filaments are rods."""

import math

import numpy as np
import pytest
from quitting import quit_when
from test_weave_scene import changed
from weave_bench import WeaveBench, thickness

from cgfibre import workflow
from cgfibre.build.weave import TowShape, WeaveSpec, tow_system
from cgfibre.cases.experiment import moved, run
from cgfibre.cases.rods import AWAY, D, filament
from cgfibre.engine.assemble import assemble
from cgfibre.engine.dump import read_record
from cgfibre.engine.lammps import find_engine, run_deck
from cgfibre.engine.natural import axis_and_angle, natural_shape, straight_shape
from cgfibre.engine.plugin import find_plugin
from cgfibre.errors import InputError
from cgfibre.mechanics import rod
from cgfibre.mechanics.woven_tow import WovenTow, arch, shallow_arch
from cgfibre.plan.make import make_plan
from cgfibre.plan.system import build_system
from cgfibre.scene_reading import scene_from_dict

with_plugin = pytest.mark.skipif(find_plugin(find_engine()) is None, reason="weaves need the plugin")
ROD = {"model.level": "rod"}
FAST = {"output.frames": 4, "output.samples": 40, "model.accuracy": 0.2}


@pytest.fixture
def weave(tmp_path):
    """Runs the small nylon weave of rods with changes, in a folder of its own a call."""
    return WeaveBench(tmp_path, lambda changes: changed(FAST | ROD | changes))


def planned(changes):
    scene = scene_from_dict(changed(ROD | changes))
    plan = make_plan(scene)
    return plan, build_system(scene, plan)


# --- plans -----------------------------------------------------------------------------------------------------------


def test_a_rigidity_that_chains_have_none_of_makes_rods():
    """A plan of chains says what it leaves out; GJ comes from the filaments, a solid or the scene."""
    chain = make_plan(scene_from_dict(changed({})))
    assert chain.level == "chain" and any("rolling of tows" in o.what for o in chain.omissions)
    given = make_plan(scene_from_dict(changed({"assembly.tow.GJ": "20 N*mm**2"})))
    assert given.level == "rod" and "GJ is given" in given.choices[1].reason
    assert not any("twist and rolling" in o.what for o in given.omissions)
    said = {c.what: c for c in given.choices}
    assert said["torsion"].value == "GJ 20 N mm2" and said["rest shape"].value == "as built"
    assert "slide past each other" in {c.what: c for c in planned({})[0].choices}["torsion"].reason
    two = {c.what: c.reason for c in planned({"assembly.weft": {"modulus": "1 GPa"}})[0].choices}
    assert "slide past each other" in two["torsion of warp"] and "solid" in two["torsion of weft"]


FLAT = {"section": "lenticular", "width": "4.5 mm", "thickness": "0.5 mm", "filaments": 30}


@pytest.mark.parametrize(
    ("changes", "key", "expected"),
    [
        ({"assembly.tow": FLAT}, "model.level", "wider than 1.5"),
        ({"model.resolve": "filament", "contact.shape": "beads"}, "contact.shape", "rods of a weave"),
    ],
)  # fmt: skip
def test_what_no_rod_can_be_is_refused(changes, key, expected):
    with pytest.raises(InputError, match=expected) as caught:
        planned(changes)
    assert caught.value.key == key


def test_both_kinds_of_tows_reach_the_deck():
    plan, system = planned({"assembly.weft": {"filaments": 20, "thickness": "1 mm"}})
    deck = assemble(system, plan)
    warp, weft = system.types
    assert deck.parameters["rod_GJ"] == warp.GJ != weft.GJ == deck.parameters["rod_GJ_2"]
    assert (deck.parameters["rod_diameter"], deck.parameters["rod_diameter_2"]) == (1200.0, 1000.0)
    assert set(deck.tables["bond_kinds.txt"]) == {1.0, 2.0}
    assert set(deck.data.atom_columns[0]) == {1, 2}
    assert np.allclose(deck.data.start, 0, atol=1e-9)


# --- the natural shape -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("cell", ["periodic", "patch"])
def test_rods_woven_in_are_straight_by_nature(cell):
    """Laid out along x or y in one cell that holds them, as long as built; turned, each segment lies along the mean of
    its beads' axes but for what the turn changes from bead to bead."""
    _, system = planned({"assembly.rest": "woven-in", "assembly.cell": cell, "assembly.tows": 4})
    shape = straight_shape(system)
    bonds, lengths = system.bonds(), system.bond_lengths()
    segments = shape.segments[bonds[:, 0]]
    assert np.allclose(np.linalg.norm(segments, axis=1), lengths)
    gaps = shape.positions[bonds[:, 1]] - shape.positions[bonds[:, 0]]
    if cell == "periodic":
        size = np.ptp(shape.box, axis=1)
        gaps[:, :2] -= size[:2] * np.round(gaps[:, :2] / size[:2])
        assert np.all(size[:2] > np.ptp(system.box, axis=1)[:2])
        assert np.all(shape.positions[:, :2] >= shape.box[:2, 0]) and np.all(shape.positions[:, :2] < shape.box[:2, 1])
    assert np.allclose(gaps, segments, atol=1e-6)
    axis_angle = axis_and_angle(shape.turn)
    assert np.allclose(np.linalg.norm(axis_angle[:, :3], axis=1), 1) and axis_angle[:, 3].max() > 15
    # Rodrigues: axes turned, their mean over a segment along it
    axis, angle = axis_angle[:, :3], np.radians(axis_angle[:, 3:])
    unit = np.where(np.arange(3) == np.argmax(np.abs(shape.segments), axis=1)[:, None], 1.0, 0.0)
    if cell == "patch":
        unit[system.last_beads] = unit[system.first_beads]
    turned = unit * np.cos(angle) + np.cross(axis, unit) * np.sin(angle)
    mean = turned[bonds[:, 0]] + turned[bonds[:, 1]]
    off = np.cross(mean / np.linalg.norm(mean, axis=1)[:, None], system.bond_vectors() / lengths[:, None])
    assert np.max(np.linalg.norm(off, axis=1)) < 0.02


def test_tows_of_unequal_length_cannot_be_straight_in_one_cell():
    shape = TowShape("circular", 1200.0, 1200.0)
    _, system = planned({})
    spec = WeaveSpec(np.ones((1, 2), dtype=bool), shape, shape, 5000.0, 5000.0)
    flat = tow_system(spec, system.types, 400.0)
    lengths = flat.positions.copy()
    start = flat.filament_start
    lengths[start[1] : start[2], 2] += 50 * np.sin(np.linspace(0, 2 * np.pi, start[2] - start[1], endpoint=False))
    crooked = type(flat)(**{**vars(flat), "positions": lengths})
    straight_shape(flat)
    with pytest.raises(InputError, match="no periodic cell holds all of them"):
        straight_shape(crooked)
    built = natural_shape(crooked, np.zeros(len(crooked.bonds())))
    assert np.allclose(built.positions, crooked.positions) and built.turn is None


def test_an_arch_meets_a_beam_of_two_half_spans_and_the_stretch_of_its_own_shape():
    tow = WovenTow(5000.0, 5.0, EA=1e9, EI=1e9 * 900, kGA=2e8)
    assert arch(tow, 1.0)[0] == pytest.approx(shallow_arch(tow, 1.0), rel=1e-4)
    stiff = WovenTow(5000.0, 1e-3, EA=1e9, EI=1e12)
    assert shallow_arch(stiff, 1.0) == pytest.approx(5000.0**3 / 48 / 1e12, rel=1e-6)
    deflection, thrust = arch(tow, 1.0)
    # the first term of the shape alone is stretched: A k^2 a/2
    first = deflection - 2 / 5000 * (np.pi**4 / 96 - 1) / (tow.EI * tow.wave**4) - 5000 / 4 / tow.kGA * 8 / np.pi**2
    assert thrust == pytest.approx(tow.EA * tow.amplitude * tow.wave**2 * first / 2, rel=0.02)
    # constant forces are as good as a natural shape, to the strain of the tow
    limp = WovenTow(5000.0, 600.0, EA=1e9, EI=1e9 * 300)
    assert arch(limp, 1e5, dead=True)[0] == pytest.approx(arch(limp, 1e5)[0], rel=1e-3)


@with_plugin
def test_the_plugin_tells_what_rods_store(tmp_path):
    """Twisted by 0.05 rad a segment, stretched by 1e-3, sheared by 2e-3 without a turn of any bead."""
    plan, system = filament("rod, capsules", 1.0, 16.0)
    f, n, s, twist, stretch, shear = system.types[0], system.n_beads, D, 0.05, 1e-3, 2e-3
    commands = [
        f"variable turned atom {math.degrees(twist)}*(id-1)*(id<={n})",
        f"variable longer atom {1 + stretch}*x",
        f"variable higher atom {shear}*x*(id<={n})",
        "set group all quat 1 0 0 v_turned x v_longer z v_higher",
        'fix probe all ave/time 1 1 1 c_elastic c_elastic[*] file probe.txt format " %.17g"',
    ]
    out = run(tmp_path, system, moved(plan, 1e-9, 20, sample=20), commands, **AWAY)
    total, *parts, roll, most = out.rows("probe.txt")[0, 1:]
    c = rod.rod_coefficients(s, f.EA, f.EI, f.GJ, f.kGA)
    longer = np.hypot(1 + stretch, shear) - 1
    exact = np.array([c.kr * (longer * s) ** 2, c.ks * (s * (1 + longer) * np.arctan(shear)) ** 2, 0, c.kt * twist**2])
    np.testing.assert_allclose(parts, (n - 1) * exact / 2, rtol=2e-3, atol=2e-3 * exact[3])
    assert total == pytest.approx(sum(parts))
    assert roll == pytest.approx((n - 1) * twist, rel=1e-6) and most == pytest.approx(twist, rel=1e-4)


# --- runs ------------------------------------------------------------------------------------------------------------


@with_plugin
def test_rods_as_chains_do_where_nothing_twists(weave):
    """A plain weave of round tows: within 0.1 % of chains, nothing stored at the start, half the spacing and a patch
    alike; woven in, rods start with the bending energy of their shape."""
    slow = {"model.accuracy": 0.1}
    chain, rod = weave("chain", slow | {"model.level": "chain"}), weave("rod", slow)
    assert rod.trusted, rod.summary["warnings"]
    assert np.allclose(thickness(rod), thickness(chain), rtol=1e-3)
    c = rod.curve
    assert c["kinetic_J"][1] < 1e-6 * c["work_J"][-1] and abs(c["stored_J"][1]) < 1e-6 * c["work_J"][-1]
    at = 0.9 * min(c["displacement_um"][-1], chain.curve["displacement_um"][-1])
    stored = [np.interp(at, curve["displacement_um"], curve["stored_J"]) for curve in (c, chain.curve)]
    assert stored[0] == pytest.approx(stored[1], rel=0.05)
    roll = next(g for g in rod.review.guards if g.name == "roll of rods")
    assert roll.ok and 0 < roll.value < 0.02
    finer = weave("finer", slow | {"model.spacing": "225 um"})
    assert np.allclose(thickness(finer), thickness(rod), rtol=2e-3)
    patch = weave("patch", slow | {"assembly.cell": "patch", "assembly.tows": 4})
    assert patch.trusted and np.allclose(thickness(patch), thickness(rod), rtol=2e-3)


@with_plugin
@pytest.mark.parametrize("cell", ["periodic", "patch"])
def test_without_platens_rods_at_rest_stay_and_those_woven_in_spring(weave, cell):
    moved, stored = {}, {}
    changes = {"assembly.cell": cell}
    for rest in ("stress-free", "woven-in"):
        folder = workflow.build_scene(weave.scene(changes | {"assembly.rest": rest}), weave.folder / rest)
        far = {"platen_top_um": "1e4", "platen_bottom_um": "-1e4", "load_steps": "400", "stop_pressure_kPa": "1e300"}
        far |= {"speed_first": "1e-9", "speed_last": "1e-9"}  # a patch's ends follow the platens
        run_deck(find_engine(), folder, "in.rod", 1, far)
        record = read_record(folder)
        moved[rest], stored[rest] = float(np.max(record.mean["kinetic"])), record.start["stored"]
    assert moved["stress-free"] < 1e-9 * moved["woven-in"]
    _, system = planned(changes | {"assembly.rest": "woven-in"})
    angles, vectors, bonds = system.angles(), system.bond_vectors(), system.bonds()
    out = np.zeros(system.n_beads, dtype=int)
    out[bonds[:, 0]] = np.arange(len(bonds))
    before, behind = vectors[out[angles[:, 0]]], vectors[out[angles[:, 1]]]
    s = [np.linalg.norm(v, axis=1) for v in (before, behind)]
    turn = np.arccos(np.sum(before * behind, axis=1) / s[0] / s[1])
    bending = float(np.sum(0.5 * system.types[0].EI * turn**2 / (0.5 * (s[0] + s[1]))))
    assert stored["stress-free"] < 1e-12 * bending
    assert stored["woven-in"] == pytest.approx(bending, rel=0.06)


@with_plugin
def test_resumed_rods_repeat_the_unbroken_ones_step_by_step(weave):
    """Their natural shape, how they are turned and tabulated contacts come back from a checkpoint: of rods woven in, in
    a cell under tension."""
    rows = "overlap (um),force_per_length (N/mm),unloading (N/mm)\n0,0,0\n40,3,1\n80,9,5\n200,40,40\n"
    changes = {"contact.law": "table", "contact.table": rows, "platens.unload": True, "assembly.rest": "woven-in"}
    changes |= {"cell.tension": {"warp": "1 N"}, "platens.stop": {"displacement": "60 um"}}
    unbroken = weave("unbroken", changes)
    out = weave.folder / "quit"
    folder = workflow.build_scene(weave.scene(changes), out)
    stop = unbroken.summary["n_steps"] // 3
    states = quit_when(folder, "in.rod", f"$(step) >= {stop}")
    assert stop <= states[0].step < 0.7 * unbroken.summary["n_steps"]
    resumed = weave("quit", changes, resume=True)
    assert (out / "curve.csv").read_text() == (weave.folder / "unbroken" / "curve.csv").read_text()
    assert np.array_equal(resumed.curve["stored_J"], unbroken.curve["stored_J"])


@with_plugin
def test_rods_in_a_cell_that_is_moved(weave):
    """Sheared by nothing it is the square one; tension thins it as it does chains; two ranks agree with one."""
    as_built, sheared = weave("built", {}), weave("sheared", {"cell.shear": "0.01 deg"})
    assert np.allclose(thickness(sheared), thickness(as_built), rtol=1e-3)
    pulled = {
        level: weave(f"pulled {level}", {"model.level": level, "cell.tension": "2 N"}) for level in ("rod", "chain")
    }
    assert np.allclose(thickness(pulled["rod"]), thickness(pulled["chain"]), rtol=1e-3)
    assert np.all(thickness(pulled["rod"]) < thickness(as_built) - 5)
    two = weave("two ranks", {}, ranks=2)
    assert np.allclose(thickness(two), thickness(as_built), rtol=1e-3)


@with_plugin
def test_rods_of_a_twill_roll_a_little(weave):
    """Neighbours on either side differ there; its patches end in floats, which slide but do not turn."""
    changes = {"assembly.pattern": "twill-2/2"}
    cell = weave("cell", changes)
    patch = weave("patch", changes | {"assembly.cell": "patch", "assembly.tows": 4})
    assert np.allclose(thickness(patch), thickness(cell), rtol=1e-3)
    for result in (cell, patch):
        roll = next(g for g in result.review.guards if g.name == "roll of rods")
        assert result.trusted, result.summary["warnings"]
        assert 0.005 < roll.value < 0.05


@with_plugin
def test_filaments_of_a_twisted_yarn_may_be_rods(weave):
    yarn = {"section": "circular", "thickness": "0.8 mm", "filaments": 3, "twist": "1 turn/cm"}
    changes = {"assembly.tow": yarn, "model.resolve": "filament", "platens.stop": {"displacement": "0.1 mm"}}
    changes["model.accuracy"] = 0.5
    rod = weave("rod", changes)
    assert rod.summary["level"] == "rod" and rod.summary["n_filaments"] == 12
    start = read_record(weave.folder / "rod/deck").start["stored"]
    assert start * 1e-15 < 1e-9 * rod.curve["work_J"][-1]  # helices are their natural shape
    found = {g.name: g for g in rod.review.guards}
    assert found["filaments through each other"].ok and 0.001 < found["roll of rods"].value < 0.5
