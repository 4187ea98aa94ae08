"""Loading to earlier stops, unloading and loading again (platens.cycles): the decks, the curve, what is measured."""

import csv
import math
import shutil

import numpy as np
import pytest
from quitting import quit_when

from cgfibre import plot, review, store, workflow
from cgfibre.engine.dump import read_record
from cgfibre.errors import InputError
from cgfibre.plan.make import make_plan
from cgfibre.plan.model import film_time
from cgfibre.record import Curve
from cgfibre.scene_reading import load_scene, scene_from_dict

TWICE = 'platens.cycles=[{displacement="2 um"}, {line_force="0.1 N/mm"}]'
SHORT = ("platens.stop.displacement=3 um", "output.samples=120")


@pytest.mark.parametrize(
    ("level", "shape"), [("chain", "capsule"), ("chain", "beads"), ("rod", "capsule"), ("section", "auto")]
)
def test_resumed_within_the_second_loading_and_unloading_the_same_bytes(bench, level, shape):
    """The engine quits right after a checkpoint of the second loading, again of the second unloading."""
    overrides = [f"model.level={level}", f"contact.shape={shape}", TWICE, *SHORT, "platens.unload=true"]
    unbroken = bench.run("unbroken", *overrides)
    out = bench.folder / "quit"
    folder = workflow.build_scene(bench.scene, out, overrides)
    variables: dict[str, str] = {}
    for phase in (0, 2):
        stop = f"${{leg}} == 2 && ${{phase}} == {phase} && ${{place}} > 0.5"
        state = quit_when(folder, f"in.{level}", stop, variables)[0]
        assert state.phase == phase
        variables = {"resume": "1", "state": state.file}
    resumed = workflow.run_scene(bench.scene, workflow.RunOptions(out, resume=True), overrides)
    assert resumed.curve.cycles == 3
    assert (out / "curve.csv").read_bytes() == (unbroken.out / "curve.csv").read_bytes()
    a, b = (store.read_results(folder / "results.h5").frames for folder in (unbroken.out, out))
    assert np.array_equal(a.step, b.step) and np.array_equal(a.positions, b.positions)
    assert np.array_equal(a.displacement_um, b.displacement_um)


def test_each_leg_ends_at_its_own_stop_and_begins_where_contact_was_lost(bench):
    cycles = 'platens.cycles=[{displacement="1 um", times=2}, {line_force="0.1 N/mm"}, {thickness="18.5 um"}]'
    run = bench.run("run", cycles, "platens.stop.force=0.012 N", "output.samples=300")
    raw, curve = read_record(run.out / "deck"), run.curve
    place, leg, phase = raw.state["displacement"], raw.mean["leg"], raw.mean["phase"]
    ends = [place[(leg == k) & (phase == 0)][-1] for k in (1, 2, 3, 4, 5)]
    height = curve["thickness_um"][0]
    assert ends[:2] == pytest.approx([1, 1], rel=1e-9)
    assert ends[3] == pytest.approx(height - 18.5, abs=0.02), "thickness counts from the height without jitter"
    force = raw.mean["top_force"]
    for k, limit in ((3, 1e5 * 70), (5, 1.2e7)):  # 0.1 N/mm on 70 um
        loading = force[(leg == k) & (phase == 0)]
        assert loading[-1] >= limit > loading[:-1].max()
    for k in (1, 2, 3, 4):  # unloaded to nothing, or as far as it came
        back, again = ((leg == k) & (phase == 2)), ((leg == k + 1) & (phase == 0))
        peak = force[(leg == k) & (phase == 0)][-1]
        assert force[back][-1] < 1e-3 * peak or place[back][-1] == pytest.approx(0, abs=1e-9)
        # the next loading begins there, at the speed of a first touch
        window = place[again][0] - place[back][-1]
        assert 0 < window < 1.0 * run.curve["time_us"][1] * 1.001
    assert {g["name"]: g["ok"] for g in run.summary["guards"]}["stop met"]
    assert np.all(np.diff(curve["time_us"]) > 0)
    assert curve.cycle.tolist() == [1, *leg.astype(int).tolist()]


def test_a_grown_speed_starts_anew_with_every_loading(bench):
    """v = first (1 + e/growth), e counted from where contact was lost; unloading goes back along the same law."""
    run = bench.run("run", 'platens.cycles=[{displacement="3 um"}]', "platens.speed=auto", "output.samples=100")
    _, plan = workflow.plan_scene(run.out / "scene.toml")
    m, raw = plan.motion, read_record(run.out / "deck")
    assert m.last > 1.5 * m.first
    place, leg, phase, time = raw.state["displacement"], raw.mean["leg"], raw.mean["phase"], raw.state["time"]
    turn, lost = (np.flatnonzero((leg == 1) & (phase == p))[-1] for p in (0, 2))

    def law(depth):
        return film_time(m.first, m.last, m.growth, depth)

    def after(begin, which):
        """Rows at the ends of blocks (within one the speed is even) but the last: it may be slower."""
        rows = np.flatnonzero(which)
        return rows[(raw.step[rows] - raw.step[begin]) % plan.sampling.block == 0][:-1]

    rows = after(turn, (leg == 1) & (phase == 2))
    back = [law(place[turn]) - law(place[i]) for i in rows]
    assert time[rows] - time[turn] == pytest.approx(back, rel=1e-9) and len(rows) > 2
    rows = after(lost, (leg == 2) & (phase == 0))
    again = [law(place[i] - place[lost]) for i in rows]
    assert time[rows] - time[lost] == pytest.approx(again, rel=1e-9) and len(rows) > 2


def loop(run, cycle):
    found = run.summary["fits"]["cycles"][cycle - 1]
    return found["loss_fraction"], found


SLOW = ("platens.speed=0.02 m/s", "contact.friction=0", "platens.friction=0")
ONE = ("assembly.count=1", "platens.stop.displacement=0.4 um", "output.samples=60", "platens.unload=true")


@pytest.mark.parametrize("level", ["chain", "section"])
def test_an_elastic_cycle_closes(bench, level):
    """One filament without friction is a spring: every cycle gives its work back."""
    cycle = 'platens.cycles=[{displacement="0.3 um"}]'
    run = bench.run("spring", f"model.level={level}", *SLOW, *ONE, cycle)
    for k in (1, 2):
        fraction, found = loop(run, k)
        assert abs(fraction) < 0.02, (k, found)
        assert found["set_um"] < 0.02


@pytest.mark.parametrize(("mu", "least", "most"), [(0.0, -0.002, 0.01), (0.3, 0.32, 0.38)])
def test_seven_discs_lose_energy_in_every_cycle_by_friction_alone(bench, mu, least, most):
    """0.346 at either speed, 0.356 with real contacts; contacts ten times as soft lose 0.201, for they stick longer."""
    friction = (f"contact.friction={mu}", f"platens.friction={mu}", "platens.speed=0.1 m/s", "platens.unload=true")
    run = bench.run("run", "model.level=section", 'platens.cycles=[{displacement="4 um"}]', *friction)
    (first, a), (second, b) = loop(run, 1), loop(run, 2)
    assert least < first < most and least < second < most
    assert a["peak_force_N"] == pytest.approx(b["peak_force_N"], rel=0.02), "their springs bring them back"


def test_the_columns_of_cycles_are_there_only_where_there_are_cycles(bench, finished):
    with (finished.out / "curve.csv").open() as f:
        assert next(csv.reader(f))[-1] == "work_J"
    run = bench.run("run", TWICE, *SHORT)
    with (run.out / "curve.csv").open() as f:
        assert next(csv.reader(f))[-3:] == ["work_J", "cycle", "phase"]
    for again in (store.read_curve(run.out / "curve.csv"), store.read_results(run.out / "results.h5").curve):
        assert np.array_equal(again.cycle, run.curve.cycle) and np.array_equal(again.phase, run.curve.phase)
    one = store.read_results(finished.out / "results.h5").curve
    assert one.cycles == 1 and np.array_equal(one.of(1)["step"], one["step"])


def test_a_cycle_is_a_curve_of_its_own(bench):
    curve = bench.run("run", TWICE, *SHORT).curve
    work = curve["work_J"]
    for k in (2, 3):
        own = curve.of(k)
        assert own.loading[0] and own.cycles == 1
        assert np.all(np.diff(own["displacement_um"][own.loading]) >= 0)
        assert own["step"][0] == curve["step"][curve.cycle == k - 1][-1], (
            "it begins with the last row of the one before"
        )
    first, last = np.flatnonzero(curve.cycle == 2)[[0, -1]]
    assert curve.of(2)["work_J"][-1] - curve.of(2)["work_J"][0] == work[last] - work[first - 1]


def test_what_an_earlier_version_wrote_is_still_read(bench, finished, tmp_path):
    """Records without leg, phase and time: phases from the displacement."""
    folder = tmp_path / "deck"
    shutil.copytree(finished.out / "deck", folder)
    for name, keep in (("record.txt", 9), ("extremes.txt", 10)):
        rows = [line.split() for line in (folder / name).read_text().splitlines() if not line.startswith("#")]
        (folder / name).write_text("".join(" ".join(row[:keep]) + "\n" for row in rows))
    (tmp_path / "scene.toml").write_text((finished.out / "scene.toml").read_text())
    (tmp_path / "plan.json").write_text((finished.out / "plan.json").read_text())
    old = workflow.measure_folder(tmp_path).curve
    for name in ("force_top_N", "displacement_um", "work_J"):
        assert np.array_equal(old[name], finished.curve[name])
    assert old["time_us"] == pytest.approx(finished.curve["time_us"], rel=1e-12)
    assert np.array_equal(old.phase, finished.curve.phase) and old.cycles == 1


def test_cycles_in_a_scene_and_its_plan():
    scene = load_scene("carbon-37-section", ['platens.cycles=[{pressure="0.2 MPa", times=5}, {line_force="1 N/mm"}]'])
    assert scene_from_dict(scene.model_dump(exclude_none=True)) == scene
    plan = make_plan(scene)
    targets = plan.motion.targets
    assert len(targets) == 7 and [t.pressure for t in targets[:5]] == [200.0] * 5
    assert targets[5].force == pytest.approx(1e6 * plan.depth)
    assert math.isinf(targets[6].force) and targets[6].displacement == plan.motion.planned_displacement
    alone = make_plan(load_scene("carbon-37-section"))
    assert plan.planned_steps > 6 * alone.motion.load_steps
    assert any(c.what == "cycles" for c in plan.choices)


@pytest.mark.parametrize(
    ("override", "key", "expected"),
    [
        ('platens.cycles=[{force="1 mN", pressure="1 kPa"}]', "platens.cycles.0", "exactly one"),
        ('platens.cycles=[{force="1 mN"}, {}]', "platens.cycles.1", "exactly one"),
        ('platens.cycles=[{force="1 mN", times=0}]', "platens.cycles.0.times", "at least 1"),
        ('platens.cycles=[{thickness="90 um"}]', "platens.cycles.0.thickness", "below"),
        ('platens.cycles=[{line_force="1 N"}]', "platens.cycles.0.line_force", "N/mm"),
        ('platens.cycles=[{presure="1 kPa"}]', "platens.cycles.0.presure", "a known key"),
        ("platens.cycles=3", "platens.cycles", ""),
    ],
)
def test_cycles_that_cannot_be_are_refused_by_their_key(override, key, expected):
    with pytest.raises(InputError) as error:
        load_scene("carbon-7", [override])
    assert error.value.key == key and expected in str(error.value)


def test_a_picture_tells_the_cycles_apart(bench):
    curve = bench.run("run", TWICE, *SHORT, "platens.unload=true").curve
    ax = plot.plot_curve(plot.new_axes(), curve, plot.CurveView(bottom=False))
    lines = [line for line in ax.lines if len(line.get_xdata()) > 2]
    assert len(lines) == 6
    assert [line.get_linestyle() == "--" for line in lines] == [False, True] * 3
    width, alpha = zip(*((line.get_linewidth(), line.get_alpha()) for line in lines[::2]), strict=True)
    assert width[0] == width[1] < width[2] and alpha[0] < alpha[1] < alpha[2]
    assert sum(len(line.get_xdata()) for line in lines) == len(curve) + 5
    labels = [t.get_text() for t in ax.get_legend().get_texts()]
    assert labels == ["top platen", "loadings 1 to 2", "unloading"]


def test_a_cycle_that_does_not_come_to_its_force_is_said(bench):
    """Nothing carries 1 N/mm in 0.5 um: the loading goes to the deepest place planned, and on from there."""
    cycles = 'platens.cycles=[{line_force="1 N/mm"}, {force="0.2 mN"}]'
    run = bench.run("run", "model.level=section", cycles, "platens.stop.displacement=0.5 um")
    guards = {g["name"]: g for g in run.summary["guards"]}
    assert not guards["stop of cycle 1"]["ok"] and not run.trusted
    assert "of 0.07 N at the deepest place planned, 0.5 um" in guards["stop of cycle 1"]["message"]
    assert guards["stop of cycle 2"]["ok"]
    assert run.curve.cycles == 3


def test_a_last_loading_that_does_not_come_to_its_force_is_said(bench):
    """Seven discs pressed to one layer meet no 1000 N/mm; a run that was cut short before is not judged."""
    run = bench.run("run", "model.level=section", "platens.stop.line_force=1000 N/mm", "output.samples=60")
    guard = next(g for g in run.summary["guards"] if g["name"] == "stop met")
    assert not guard["ok"] and not run.trusted and "filaments gave way" in guard["message"]
    scene, plan = workflow.plan_scene(run.out / "scene.toml")
    system = store.read_results(run.out / "results.h5").system
    frames = store.read_results(run.out / "results.h5").frames
    half = run.curve.columns, run.curve.phase, run.curve.width_um
    n = len(run.curve) // 2
    curve = Curve({k: v[:n] for k, v in half[0].items()}, half[1][:n], half[2][:n])
    cut = review.review_run(scene, plan, system, curve, frames, None)
    assert all(g.name != "stop met" for g in cut.guards)


def test_a_short_first_loading_does_not_condemn_the_run(bench):
    """What is not quasi-static in the first cycle is judged by the first one that gets there."""
    speed, cycles = "platens.speed=1 m/s", 'platens.cycles=[{displacement="0.3 um"}]'
    run = bench.run("run", "model.level=section", speed, cycles, "platens.stop.displacement=5 um")
    assert not any("quasi-static" in w for w in run.summary["warnings"])
    assert run.summary["quasi_static_from_um"] > 0.3


def test_loose_discs_stay_where_they_were_pressed_and_the_next_loading_begins_there(bench):
    """A periodic cell has no springs: what is pressed sideways stays, and the second loading is stiffer."""
    cell = ("model.level=section", "ends.support=symmetry", "platens.width=full", "platens.speed=0.1 m/s")
    run = bench.run("run", *cell, 'platens.cycles=[{displacement="5 um"}]', "platens.stop.displacement=6 um")
    first, second = run.summary["fits"]["cycles"]
    assert first["set_um"] > 3
    assert run.curve.of(2)["displacement_um"][1] > first["set_um"] - 0.2
    assert second["work_J"] > 0
