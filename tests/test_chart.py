"""Accuracy against speed: the front, errors against a reference, runs that are found again, what a chart leaves."""

import csv
import json
import os
import shutil
import signal
import subprocess

import h5py
import numpy as np
import pytest
from conftest import cgfibre_command, cgfibre_environment
from test_certify import curve_of, engines_of, wait_for_none
from test_workflow import wait_for

from cgfibre import chart, plot, plot_chart, store, sweep, workflow
from cgfibre.cases.experiment import Measured
from cgfibre.cases.pressing import pressed_alone
from cgfibre.chart import ChartOptions, Yardstick, chart_scene, pareto_front
from cgfibre.engine.lammps import find_engine
from cgfibre.engine.plugin import find_plugin
from cgfibre.errors import EngineError, InputError
from cgfibre.plan.make import make_plan
from cgfibre.scene_reading import load_scene

#: cheap: the early part of the tiny scene, few rows; beads: with or without the plugin
SHALLOW = ("platens.speed=auto", "platens.stop.displacement=3 um", "output.samples=60", "contact.shape=beads")


# --- the front --------------------------------------------------------------------------------------------------------


def test_the_front_keeps_what_nothing_betters_in_both():
    cost = np.array([1.0, 2.0, 2.0, 3.0, 4.0, 5.0, np.nan])
    error = np.array([9.0, 5.0, 6.0, 5.0, 1.0, np.nan, 0.1])
    assert pareto_front(cost, error).tolist() == [True, True, False, False, True, False, False]


def test_equal_points_are_both_on_the_front():
    assert pareto_front(np.array([1.0, 1.0]), np.array([2.0, 2.0])).tolist() == [True, True]


# --- errors -----------------------------------------------------------------------------------------------------------


def test_errors_are_those_of_known_curves():
    """F = k d against (1 + e) k d: the force errs by e everywhere, the thickness at F by d e/(1 + e) (thicker)."""
    yard = Yardstick.of(curve_of(lambda d: 1e-3 * d), 7.0)
    assert yard.start == 2.0
    assert yard.displacements == pytest.approx((1, 4, 10)) and yard.forces == pytest.approx((1e-3, 4e-3, 1e-2))
    mean, force, thickness = yard.errors(curve_of(lambda d: 1.25e-3 * d))
    assert mean == pytest.approx(0.25) and force == pytest.approx([0.25] * 3)
    assert thickness == pytest.approx([0.2, 0.8, 2.0])
    mean, force, thickness = yard.errors(curve_of(lambda d: 0.8e-3 * d, depth=5.0))
    assert mean == pytest.approx(0.2) and force[:2] == pytest.approx([-0.2] * 2)
    assert np.isnan(force[2]) and np.isnan(thickness[2]), "never as deep"


def test_another_start_is_compared_with_its_own_reference():
    """A specimen that is 10 % stiffer throughout is not 10 % wrong."""
    yard = Yardstick.of(curve_of(lambda d: 1e-3 * d), 7.0)
    first, other = curve_of(lambda d: 1.01e-3 * d), curve_of(lambda d: 1.1 * 1.01e-3 * d)
    carried = yard.for_start(other, first)
    assert carried.curve["force_top_N"][1:] == pytest.approx(1.1e-3 * carried.curve["displacement_um"][1:])
    mean, force, _ = carried.errors(curve_of(lambda d: 1.1 * 0.95e-3 * d))
    assert mean == pytest.approx(0.05) and force == pytest.approx([-0.05] * 3)


def test_a_reference_without_force_is_refused():
    with pytest.raises(InputError, match="press further"):
        Yardstick.of(curve_of(lambda d: 0 * d), 7.0)


# --- the ladder -------------------------------------------------------------------------------------------------------


def test_the_ladder_of_a_straight_bundle_ends_in_fine_slow_capsules_with_beads_beside_them():
    steps, reference = chart.ladder(load_scene("carbon-7"))
    names = [v.name for v in steps]
    assert names == [
        "section-0.05",
        "chain-4D-0.2",
        "chain-4D-0.1",
        "chain-4D-0.05",
        "chain-4D-0.025",
        "chain-8D-0.05",
        "chain-2D-0.05",
        "chain-D-0.05",
        "rod-4D-0.05",
        "chain-beads-D-0.05",
        "chain-beads-D2-0.05",
    ]
    assert (reference.name, reference.shape, reference.spacing) == ("chain-D-0.0125", "capsule", 1.0)
    for v in (*steps, reference):
        assert v.shape == ("" if v.level == "section" else "beads" if "beads" in v.name else "capsule")
        plan = make_plan(load_scene("carbon-7", v.overrides))
        assert (plan.level, plan.contact.shape == "capsule") == (v.level, v.shape == "capsule"), v.name
        assert v.shape == "" or plan.spacing == pytest.approx(7 * v.spacing, rel=0.3), v.name


def test_the_ladder_of_beads_ends_in_fine_slow_ones(tiny):
    steps, reference = chart.ladder(load_scene(tiny, ["contact.shape=beads"]))
    names = [v.name for v in steps]
    assert names == [
        "section-0.05",
        "chain-beads-D-0.2",
        "chain-beads-D-0.1",
        "chain-beads-D-0.05",
        "chain-beads-D-0.025",
        "chain-beads-D2-0.05",
        "rod-beads-D-0.05",
    ]
    assert reference.name == "chain-beads-D2-0.0125" and reference.spacing == 0.5
    one = ["assembly.count=1", "platens.stop.displacement=1 um", "contact.shape=beads"]
    alone, _ = chart.ladder(load_scene("carbon-7", one))
    assert {v.spacing for v in alone} == {0.0, 0.5, 1.0, 2.0, 4.0}


@pytest.mark.parametrize(
    ("shape", "reference", "planner"),
    [("beads", "rod-beads-D2-0.0125", "rod-beads-D-0.05"), ("capsule", "rod-D-0.0125", "planner")],
)
def test_twisted_filaments_are_compared_with_rods_and_a_section_of_them_is_refused_with_its_reason(
    tiny, tmp_path, shape, reference, planner
):
    """Twist and a section do not go together: left out, not run, with the scene's own reason."""
    twisted = ("assembly.twist=5 turn/cm", "assembly.void_fraction=0.5", "platens.speed=auto", f"contact.shape={shape}")
    work = chart._lay_out(tiny, twisted, ChartOptions(tmp_path / "x"))
    assert (work.reference, work.planner) == (reference, planner)
    own = work.runs[work.planner][0].variant
    assert (own.level, own.shape) == ("rod", shape) and own.spacing <= 4, "curved: shorter chords"
    left_out = dict(work.left_out)
    assert "assembly.twist" in left_out.pop("section-0.05")
    # 8 D is more than a quarter of these short filaments
    assert list(left_out) == (["chain-8D-0.05"] if shape == "capsule" else [])
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("shape", "name"), [("beads", "chain-beads-D"), ("capsule", "chain-4D")])
def test_accuracy_sets_the_speed_of_every_step_even_where_the_scene_asks_for_one(tiny, tmp_path, shape, name):
    asked = (f"contact.shape={shape}",)
    work = chart._lay_out(tiny, asked, ChartOptions(tmp_path / "x", seeds=1))
    first = {name: runs[0].plan.motion.first for name, runs in work.runs.items()}
    for fine, coarse in ((0.1, 0.2), (0.025, 0.1)):
        assert first[f"{name}-{fine}"] / first[f"{name}-{coarse}"] == pytest.approx(fine / coarse, rel=0.05)
    assert work.planner == "planner", "the scene asks for a speed of its own"
    assert all(not r.plan.motion.unload for r in work)


def test_the_planner_is_the_step_of_the_ladder_that_it_would_take(tiny, tmp_path):
    planned = chart._lay_out(tiny, ("platens.speed=auto", "contact.shape=beads"), ChartOptions(tmp_path / "x", seeds=1))
    assert planned.planner == "chain-beads-D-0.05" and "planner" not in planned.runs
    long = ("platens.stop.displacement=14 um", "contact.shape=capsule")
    planned = chart._lay_out("carbon-37", long, ChartOptions(tmp_path / "x", seeds=1))
    assert planned.planner == "chain-4D-0.05" and "planner" not in planned.runs


def test_starts_are_other_specimens_of_the_same_scene(tiny, tmp_path):
    work = chart._lay_out(tiny, ("assembly.jitter=0 um", "contact.shape=beads"), ChartOptions(tmp_path / "x", seeds=3))
    scenes = [r.scene.assembly for r in work.runs["chain-beads-D-0.1"]]
    assert [s.seed for s in scenes] == [1, 2, 3] and all(0 < s.jitter < 0.1 for s in scenes)
    assert len(work.runs[work.reference]) == 1
    assert all(len(runs) == 3 for name, runs in work.runs.items() if name != work.reference)


@pytest.mark.parametrize(("shape", "dear"), [("beads", "rod-beads-D-0.05"), ("capsule", "rod-4D-0.05")])
def test_what_costs_nearly_as_much_as_the_reference_has_one_start_as_well(tmp_path, shape, dear):
    pressed = ("platens.stop.displacement=14 um", f"contact.shape={shape}")
    work = chart._lay_out("carbon-37", pressed, ChartOptions(tmp_path / "x"))
    cost = {name: runs[0].plan.predicted_seconds for name, runs in work.runs.items()}
    for name, runs in work.runs.items():
        assert len(runs) == (1 if cost[name] > max(20, cost[work.reference] / 4) else 3), name
    assert len(work.runs[work.reference]) == 1 and dear in work.runs
    assert {len(runs) for runs in work.runs.values()} == {1, 3}
    # the planner may take half of a symmetric assembly, the reference is all of it
    assert work.runs[work.planner][0].plan.beads.support == "symmetric"
    assert work.runs[work.reference][0].plan.beads.support == "simple"


# --- one filament alone -----------------------------------------------------------------------------------------------


def test_a_slower_platen_errs_less_on_one_filament_alone(tmp_path):
    """Against the pre-tensioned beam: the error falls with the speed, to what the spacing leaves (measured: 1.9 and
    0.7 % at s = D; large deflection, (3.4/100)^2 = 0.1 %, and spacing are the rest)."""
    fast, slow = (pressed_alone(tmp_path / str(a), "chain", 1.0, a)[0] for a in (0.2, 0.1))
    assert fast.error < 0.2 and slow.error < fast.error / 2 and slow.error < 0.01
    assert slow.cpu > fast.cpu > 0


# --- whole charts -----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def charted(tiny, tmp_path_factory):
    out = tmp_path_factory.mktemp("chart") / "tiny"
    options = ChartOptions(out, seeds=2, reference_accuracy=0.1, only=("section-0.05", "chain-beads-D-0.2"))
    seen = []
    found = chart_scene(tiny, options, SHALLOW, lambda *state: seen.append(state))
    return found, options, seen


def test_a_chart_leaves_tables_a_picture_and_its_runs(charted):
    found, options, seen = charted
    assert [r.name for r in found.rows] == ["section-0.05", "chain-beads-D-0.2", "chain-beads-D2-0.1", "planner"]
    with (options.out / "chart.csv").open(newline="") as f:
        rows = list(csv.DictReader(f))
    columns = chart.table_of(found)
    assert list(rows[0]) == list(columns) and len(rows) == len(found.rows)
    assert sum(c.startswith("force_error_at_") for c in columns) == 3
    with h5py.File(options.out / "chart.h5") as f:
        for name, (values, units) in columns.items():
            assert f["chart"][name].attrs["units"] == units
            stored = f["chart"][name][()]
            if units == "text":
                assert [s.decode() for s in stored] == values
            else:
                assert stored == pytest.approx(np.array(values, dtype=float), nan_ok=True)
    for row, r in zip(rows, found.rows, strict=True):
        assert float(row["cpu_s"]) == pytest.approx(r.cpu, rel=1e-4) and r.cpu_range[0] <= r.cpu <= r.cpu_range[1]
        assert row["error"] == "" if r.reference else float(row["error"]) == pytest.approx(r.error, rel=1e-4)
    assert [row["contact"] for row in rows] == ["", "beads", "beads", "beads"]
    assert json.loads((options.out / "chart.json").read_text())["left_out"] == []
    assert (options.out / "chart.png").read_bytes().startswith(b"\x89PNG")
    assert not list((options.out / "runs").glob("*/*.png"))
    assert seen[-1][0] == pytest.approx(seen[-1][1])


@pytest.mark.skipif(find_plugin(find_engine()) is None, reason="no plugin: filaments touch by beads alone")
def test_capsules_are_charted_beside_beads(tiny, tmp_path):
    only = ("chain-4D-0.2", "chain-beads-D-0.05")
    options = ChartOptions(tmp_path / "x", seeds=1, reference_accuracy=0.1, only=only)
    found = chart_scene(tiny, options, (*SHALLOW[:-1], "model.accuracy=0.2"))
    assert [(r.name, r.shape) for r in found.rows] == [
        ("chain-4D-0.2", "capsule"),
        ("chain-beads-D-0.05", "beads"),
        ("chain-D-0.1", "capsule"),
        ("planner", "capsule"),
    ]
    assert all(0 < r.error < 0.5 for r in found.rows if not r.reference)
    assert [p.level for p in chart.points_of(found)] == ["chain, capsule", "chain, beads", "chain, capsule"]


def test_the_errors_of_a_chart_are_those_of_its_curves(charted):
    found, options, _ = charted
    row = next(r for r in found.rows if r.name == "chain-beads-D-0.2")
    curve, reference = (
        store.read_results(options.out / "runs" / name / "results.h5").curve
        for name in ("chain-beads-D-0.2-1", "chain-beads-D2-0.1-1")
    )
    at = found.displacements[1]
    ratio = np.interp(at, *chart.loading_of(curve)[::2]) / np.interp(at, *chart.loading_of(reference)[::2])
    ours = Yardstick.of(reference, 7.0).errors(curve)
    assert ours[1][1] == pytest.approx(ratio - 1)
    assert row.error_range[0] <= ours[0] * (1 + 1e-9) and row.error_range[1] >= ours[0] * (1 - 1e-9)
    assert found.planner is not None and found.planner.level == "chain"
    assert any(r.front for r in found.rows) and not any(r.front for r in found.rows if r.reference)


def test_going_on_runs_nothing_again_and_finishes_what_was_cut_short(charted, tiny, tmp_path, monkeypatch):
    found, options, _ = charted
    out = shutil.copytree(options.out, tmp_path / "copy")
    ran = []
    run_scene = sweep.run_scene

    def counted(source, own, *arguments, **more):
        ran.append(own.out.name)
        return run_scene(source, own, *arguments, **more)

    monkeypatch.setattr(sweep, "run_scene", counted)
    again = chart_scene(tiny, ChartOptions(**{**vars(options), "out": out}), SHALLOW)
    assert ran == [] and str(again.rows) == str(found.rows)  # nan is not itself
    # a run without its summary was cut short; one of another plan is of another version
    (out / "runs" / "section-0.05-2" / "summary.json").unlink()
    plan = out / "runs" / "chain-beads-D-0.2-1" / "plan.json"
    plan.write_text(plan.read_text().replace('"level": "chain"', '"level": "fibre"'))
    chart_scene(tiny, ChartOptions(**{**vars(options), "out": out}), SHALLOW)
    assert sorted(ran) == ["chain-beads-D-0.2-1", "section-0.05-2"]


def test_another_scene_or_a_run_in_the_folder_is_refused(charted, tiny, tmp_path):
    _, options, _ = charted
    with pytest.raises(InputError, match="chart of the same scene"):
        chart_scene(tiny, options, ("contact.friction=0.1", *SHALLOW))
    (tmp_path / "summary.json").write_text("{}")
    with pytest.raises(InputError, match="holds a run"):
        chart_scene(tiny, ChartOptions(tmp_path), SHALLOW)


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"jobs": 10_000}, "--jobs"),
        ({"seeds": 0}, "--seeds"),
        ({"only": ("chain-3D",)}, "--only"),
        ({"compare": ("nowhere",)}, "--compare"),
    ],
)
def test_wrong_options_are_refused_before_anything_is_written(tiny, tmp_path, change, named):
    with pytest.raises(InputError, match=named):
        chart_scene(tiny, ChartOptions(tmp_path / "x", **change))
    assert list(tmp_path.iterdir()) == []


def test_results_made_elsewhere_are_drawn_beside_it(charted, tiny, tmp_path, finished):
    """A run that went deeper and back counts to the chart's end alone, and an old one by its engine's wall time."""
    found, options, _ = charted
    old = shutil.copytree(finished.out, tmp_path / "old")
    summary = json.loads((old / "summary.json").read_text())
    summary |= {"engine_cpu_s": None, "engine_s": 100.0}
    (old / "summary.json").write_text(json.dumps(summary))
    points = tmp_path / "points.csv"
    points.write_text("label,cpu_s,error\nFE,3600,0.02\n")
    compare = (f"first={old}", str(points))
    more = chart_scene(tiny, ChartOptions(**{**vars(options), "compare": compare}), SHALLOW)
    first, fe = more.rows[-2:]
    assert (first.name, fe.name, fe.cpu, fe.error) == ("first", "FE", 3600.0, 0.02)
    c = finished.curve
    end = np.interp(3.0, c["displacement_um"][c.loading], c["step"][c.loading]) / c["step"][-1]
    assert first.cpu == pytest.approx(100 * end, rel=0.02) and 0.2 < end < 0.5
    assert 0 < first.error < 1
    assert not first.front and not fe.front
    assert [r.front for r in more.rows[:-2]] == [r.front for r in found.rows]


def test_a_variant_that_the_engine_gives_up_is_left_out_and_the_chart_is_drawn(tiny, tmp_path, monkeypatch):
    run_scene = sweep.run_scene

    def fails(source, own, *arguments, **more):
        if own.out.name.startswith("section"):
            raise EngineError("Lost atoms", "halve the time step")
        return run_scene(source, own, *arguments, **more)

    monkeypatch.setattr(sweep, "run_scene", fails)
    options = ChartOptions(tmp_path / "x", seeds=1, reference_accuracy=0.2, only=("section-0.05", "chain-beads-D-0.2"))
    found = chart_scene(tiny, options, SHALLOW)
    assert found.left_out == (("section-0.05-1", "the engine stopped: Lost atoms"),)
    assert "section" not in {r.level for r in found.rows} and (options.out / "chart.png").exists()


def test_a_killed_chart_leaves_no_engine_and_goes_on(tiny, tmp_path):
    out = tmp_path / "chart"
    arguments = ["chart", tiny, "--out", out, "--seeds", "1"]
    arguments += ["--only", "chain-beads-D-0.2", "--reference-accuracy", "0.1"]
    for override in (*SHALLOW, "platens.stop.displacement=4 um"):
        arguments += ["--set", override]
    command = cgfibre_command(*arguments)
    process = subprocess.Popen(
        command, env=cgfibre_environment(), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
    )
    wait_for(lambda: engines_of(out) and (out / "runs" / "chain-beads-D-0.2-1" / "summary.json").exists(), process)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    wait_for_none(out)
    first = (out / "runs" / "chain-beads-D-0.2-1" / "summary.json").stat().st_mtime_ns
    done = subprocess.run(command, env=cgfibre_environment(), capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "chain-beads-D-0.2" in done.stdout and "reference" in done.stdout and "planner" in done.stdout
    assert (out / "runs" / "chain-beads-D-0.2-1" / "summary.json").stat().st_mtime_ns == first, "ran again"


# --- drawing ----------------------------------------------------------------------------------------------------------


def point(name, cpu, error, **more):
    return plot_chart.ChartPoint(name, "chain", cpu, error, (cpu, cpu), (error, error), **more)


def test_the_picture_marks_front_choice_and_goal_on_logarithmic_axes():
    points = [point("a", 1, 0.2, front=True), point("b", 10, 0.02, front=True, chosen=True, trusted=False)]
    ax = plot_chart.plot_chart(plot.new_axes(), [*points, point("zero", 5, 0.0)], 0.05)
    assert ax.get_xscale() == ax.get_yscale() == "log"
    labels = ax.get_legend_handles_labels()[1]
    assert {"chain", "Pareto front", "planner's choice", "5 %", "distrusted by a guard"} <= set(labels)
    assert [t.get_text() for t in ax.texts] == ["a", "b"]
    front = next(line for line in ax.lines if line.get_label() == "Pareto front")
    assert front.get_xdata().tolist() == [1, 10] and front.get_ydata().tolist() == [20, 2]
    with pytest.raises(InputError, match="points"):
        plot_chart.plot_chart(plot.new_axes(), [])


def test_trials_have_a_line_a_level_and_a_line_a_spacing_where_it_repeats():
    def trial(level, spacing, cpu, error):
        return Measured("case", level, spacing, "force", "nN", error, 0.0, cpu)

    rods = [trial("rod", s, s, -0.01 * s) for s in (1.0, 2.0)]
    chains = [trial("chain", s, 1.0 + k, 0.1 * s / (k + 1)) for s in (1.0, 4.0) for k in range(2)]
    ax = plot_chart.plot_trials(plot.new_axes(), [*rods, *chains, trial("rod", 4.0, 0.0, 1.0)])
    assert ax.get_legend_handles_labels()[1] == ["rod", "chain, s = 1 D", "chain, s = 4 D"]
    assert ax.lines[0].get_ydata() == pytest.approx([1.0, 2.0]), "per cent, without sign"
    with pytest.raises(InputError, match="trials"):
        plot_chart.plot_trials(plot.new_axes(), [])


def test_a_curve_survives_its_csv(finished):
    again = store.read_curve(finished.out / "curve.csv")
    assert again["force_top_N"] == pytest.approx(finished.curve["force_top_N"], rel=1e-9, abs=1e-15)
    assert again.phase.tolist() == finished.curve.phase.tolist()


def test_a_cancelled_run_stops_its_engine(tiny, tmp_path):
    with pytest.raises(EngineError, match="given up"):
        workflow.run_scene(
            tiny, workflow.RunOptions(tmp_path / "x"), ["platens.speed=0.05 m/s"], cancelled=lambda: True
        )
    assert engines_of(tmp_path) == []
