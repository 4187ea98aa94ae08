import json
from pathlib import Path

import numpy as np
import pytest
import tomli_w
from quitting import quit_when
from test_weave_scene import changed
from weave_bench import WeaveBench, thickness

from cgfibre import workflow
from cgfibre.engine.collect import read_run
from cgfibre.engine.dump import read_record
from cgfibre.engine.job import run_job, write_job
from cgfibre.engine.lammps import find_engine, run_deck
from cgfibre.engine.plugin import find_plugin
from cgfibre.errors import InputError
from cgfibre.measure.compaction import thickness_at_pressure
from cgfibre.measure.fabric import fabric_of, tow_lines
from cgfibre.plan.make import make_plan
from cgfibre.plan.system import build_system
from cgfibre.scene_reading import load_scene
from cgfibre.store import read_results

pytestmark = pytest.mark.skipif(find_plugin(find_engine()) is None, reason="weaves need the plugin")
FAST = {"output.frames": 4, "output.samples": 40, "model.accuracy": 0.1}


@pytest.fixture
def weave(tmp_path):
    """Runs the small nylon weave with changes, in a folder of its own a call."""
    return WeaveBench(tmp_path, lambda changes: changed(FAST | changes))


def test_a_periodic_cell_a_patch_and_finer_beads_agree(weave):
    """And both platens carry the same, tows stay where they were woven, nothing is bent at the start."""
    cell = weave("cell", {})
    assert cell.trusted, cell.summary["warnings"]
    c = cell.curve
    assert c["pressure_MPa"][-2] < 0.2 * 1.001 < c["pressure_MPa"][-1] < 0.23  # one row in forty beyond it
    assert c["force_top_N"][-1] == pytest.approx(0.2 * 100 * c["pressure_MPa"][-1] / 0.2, rel=1e-6)  # over 1 cm2
    heavy = c["pressure_MPa"] > 0.05
    assert np.allclose(c["force_top_N"][heavy], c["force_bottom_N"][heavy], rtol=0.02)
    assert c["kinetic_J"][1] < 1e-6 * c["work_J"][-1] and abs(c["stored_J"][1]) < 1e-6 * c["work_J"][-1]
    names = {g.name for g in cell.review.guards}
    assert "tows through each other" in names
    statistics = {name: values for name, (values, _) in cell.review.statistics.items()}
    assert statistics["crimp_warp"][-1] < statistics["crimp_warp"][0]
    patch = weave("patch", {"assembly.cell": "patch", "assembly.tows": 4})
    assert np.allclose(thickness(patch), thickness(cell), rtol=2e-3)  # 0.06 % when slower
    finer = weave("finer", {"model.spacing": "225 um"})
    assert finer.summary["n_beads"] > 1.8 * cell.summary["n_beads"]
    assert np.allclose(thickness(finer), thickness(cell), rtol=2e-3)


def test_without_platens_a_weave_at_rest_stays_and_one_woven_in_springs(weave):
    moved = {}
    for rest in ("stress-free", "woven-in"):
        folder = workflow.build_scene(weave.scene({"assembly.rest": rest}), weave.folder / rest)
        far = {"platen_top_um": "1e4", "platen_bottom_um": "-1e4", "load_steps": "1000", "stop_pressure_kPa": "1e300"}
        run_deck(find_engine(), folder, "in.chain", 1, far)
        moved[rest] = float(np.max(read_record(folder).mean["kinetic"]))
    assert moved["stress-free"] < 1e-9 * moved["woven-in"]


def test_a_resumed_weave_repeats_the_unbroken_one_step_by_step(weave):
    """Rest forces, the strained cell and tabulated contacts come back from a checkpoint."""
    rows = "overlap (um),force_per_length (N/mm),unloading (N/mm)\n0,0,0\n40,3,1\n80,9,5\n200,40,40\n"
    changes = {"contact.law": "table", "contact.table": rows, "cell.strain": {"x": 0.002}, "platens.unload": True}
    unbroken = weave("unbroken", changes)
    out = weave.folder / "quit"
    folder = workflow.build_scene(weave.scene(changes), out)
    stop = unbroken.summary["n_steps"] // 3
    states = quit_when(folder, "in.chain", f"$(step) >= {stop}")
    assert stop <= states[0].step < 0.7 * unbroken.summary["n_steps"]
    resumed = weave("quit", changes, resume=True)
    assert (out / "curve.csv").read_text() == (weave.folder / "unbroken" / "curve.csv").read_text()
    assert np.array_equal(resumed.curve["force_top_N"], unbroken.curve["force_top_N"])
    # a law with another way back dissipates
    assert resumed.summary["fits"]["hysteresis"]["fraction"] > 0.2


#: statistics of single contacts and pixels, which a hair's breadth moves by more than 0.3 %
PLACED = ("crossing", "turning", "contact", "displacement", "open", "void", "hydraulic", "largest")


def test_in_the_plane(weave):
    """A cell sheared by nothing is the square one; tension thins it, strain along x pushes weft out."""
    as_built = weave("built", {})
    sheared = weave("sheared", {"cell.shear": "0.01 deg"})
    assert "triclinic" in (weave.folder / "sheared/deck/log.lammps").read_text()
    assert np.allclose(thickness(sheared), thickness(as_built), rtol=1e-3)
    pulled = weave("pulled", {"cell.tension": "2 N"})
    assert np.all(thickness(pulled) < thickness(as_built) - 5)
    strained = weave("strained", {"cell.strain": {"x": 0.01}})
    assert strained.curve["force_top_N"][1] > 10 * as_built.curve["force_top_N"][1]
    assert sheared.summary["warnings"] == pulled.summary["warnings"] == strained.summary["warnings"] == []
    for name, (values, _) in as_built.review.statistics.items():
        if not name.startswith(PLACED):
            assert sheared.review.statistics[name][0] == pytest.approx(values, rel=3e-3), name
    # the weft moves apart with the cell, which its warp follows: crimp (as built 3.5 %) goes, tows stay whole
    results = read_results(weave.folder / "strained/results.h5")
    fabric = strained.review.statistics
    x = np.ptp(results.frames.box[0], axis=1)[0], np.ptp(results.system.box, axis=1)[0]
    assert x[0] == pytest.approx(1.01 * x[1], rel=1e-6)
    place = fabric["crossing_place"][0][0]
    assert np.ptp(place[:, 0]) == pytest.approx(x[0] / 2, rel=1e-3)
    built = as_built.review.statistics
    assert 0.006 < built["crimp_warp"][0][0] - fabric["crimp_warp"][0][0] < 0.01
    assert 1 < 1.01 * fabric["areal_density"][0][0] / built["areal_density"][0][0] < 1.003


def test_warp_and_weft_that_are_built_alike_stay_alike(tmp_path):
    """Yarns that hardly resist bending: contacts as long as segments, whichever tow has the lower number."""
    scene, plan = workflow.plan_scene("glass-weave", ("output.frames=4", "model.accuracy=0.1"))
    system = build_system(scene, plan)
    write_job(tmp_path / "deck", system, plan, "")
    run_job(find_engine(), tmp_path / "deck", plan, 1, False)
    curve, frames, _ = read_run(tmp_path / "deck", system, plan)
    assert curve["pressure_MPa"].max() == pytest.approx(1.0, rel=0.1)
    fabric, height = fabric_of(system), []
    for positions in frames.positions:
        lines = [line for axis in (0, 1) for line in tow_lines(fabric, positions) if line.axis == axis]
        height.append([np.ptp(line.points[:, 2]) for line in lines])
    assert np.max(height[-1]) < 0.95 * np.max(height[0])
    # with contacts seen from the warp alone the weft is 3 % higher
    assert np.ptp(height[-1]) < 0.005 * np.mean(height[-1])


def test_a_textile_of_texgen_is_pressed_as_the_same_weave_of_ours(weave):
    """And one that is not what the scene says is refused."""
    changes = {
        "filament": {"material": "nylon", "diameter": "40 um"},
        "assembly.spacing": "1 mm",
        "assembly.tow": {"section": "elliptic", "width": "0.4 mm", "thickness": "0.2 mm", "filaments": 10},
        "assembly.pattern": ["01", "10"],
        "platens.stop": {"pressure": "0.5 MPa"},
    }
    file = {"assembly.texgen": str(Path(__file__).parent / "data/plain.tg3")}
    ours, theirs = weave("ours", changes), weave("theirs", changes | file)
    assert ours.trusted and theirs.trusted
    at = np.array([0.05, 0.1, 0.3, 0.45])
    one, two = (thickness_at_pressure(r.curve["thickness_um"], r.curve["pressure_MPa"], at) for r in (ours, theirs))
    assert np.allclose(one, two, rtol=0.02), (one, two)
    with pytest.raises(InputError) as caught:
        make_plan(load_scene(weave.scene(changes | file | {"assembly.spacing": "1.1 mm"})))
    assert caught.value.key == "assembly.spacing.weft"


def test_filaments_of_a_small_weave_are_pressed_and_stay_in_order(weave):
    yarn = {"section": "circular", "thickness": "0.8 mm", "filaments": 4}
    changes = {
        "assembly.tow": yarn,
        "assembly.spacing": "2.5 mm",
        "model.resolve": "filament",
        "platens.stop": {"displacement": "0.2 mm"},
    }
    result = weave("filaments", changes)
    assert result.trusted, result.summary["warnings"]
    assert result.summary["n_filaments"] == 16
    order = next(g for g in result.review.guards if g.name == "filaments through each other")
    assert order.ok and "64 that cross" in order.message
    c = result.curve
    assert c["force_top_N"][-1] > 0.1 and c["force_bottom_N"][-1] == pytest.approx(c["force_top_N"][-1], rel=0.05)


def test_a_weave_is_built_measured_and_drawn(tmp_path, cgfibre):
    scene = tmp_path / "weave.toml"
    scene.write_text(tomli_w.dumps(changed(FAST | {"platens.stop": {"displacement": "30 um"}})))
    done = cgfibre("run", scene, "--out", tmp_path / "out", "--quiet")
    assert done.returncode == 0, done.stderr
    for name in ("curve.png", "weave.png", "sections.png", "crimp.png", "crossings.png", "results.h5"):
        assert (tmp_path / "out" / name).stat().st_size > 1000
    before = json.loads((tmp_path / "out/summary.json").read_text())
    assert cgfibre("measure", tmp_path / "out").returncode == 0
    after = json.loads((tmp_path / "out/summary.json").read_text())
    assert after["peak_force_N"] == before["peak_force_N"] and after["warnings"] == []
