"""Studies: what files may say, which cases they make, a tiny real one, going on after a kill."""

import csv
import json
import shutil
import subprocess
import tomllib

import numpy as np
import pytest
from conftest import cgfibre_command, cgfibre_environment
from test_certify import wait_for_none
from test_workflow import wait_for

from cgfibre import store, sweep
from cgfibre.errors import EngineError, InputError
from cgfibre.measure.ensemble import student
from cgfibre.plan.make import make_plan
from cgfibre.record import CURVE_COLUMNS, Curve
from cgfibre.scene_reading import joined_overrides, load_scene
from cgfibre.study import file as files
from cgfibre.study.outcome import branches_of, find_case
from cgfibre.study.run import JITTER, StudyOptions, lay_out, run_study, table_of

STUDY = """\
title = "Seven filaments, two frictions"
statement = "more friction, more force"
scene = "carbon-7"
starts = 2
[set]
model.level = "section"
assembly.length = "0.14 mm"
output.samples = 40
[set.platens]
width = "70 um"
speed = "1 m/s"
unload = true
stop.displacement = "7 um"
[[vary]]
key = "contact.friction"
values = [0.1, 0.4]
label = "friction {value}"
[compare]
loads = ["0.05 N/mm", "0.2 N/mm"]
displacements = ["5 um"]
reductions = [0.2]
[fit]
law = "friction-power"
beside = "thesis-dry"
"""


@pytest.fixture
def study_file(tmp_path):
    def write(text=STUDY, name="seven.toml"):
        path = tmp_path / name
        path.write_text(text)
        return path

    return write


# --- the file ---------------------------------------------------------------------------------------------------------


def test_cases_are_the_product_of_what_varies_with_later_overrides_on_top(study_file):
    text = STUDY.replace("[[vary]]", '[[vary]]\nkey = "ends.tension"\nvalues = ["0.02 cN", "0.04 cN"]\n[[vary]]', 1)
    text = text.replace('[fit]\nlaw = "friction-power"\nbeside = "thesis-dry"\n', "")
    found = files.cells(files.load_study(study_file(text), ["platens.stop.force=1 N", "model.level=chain"]))
    assert [c.label for c in found] == [
        f"tension {t}, friction {mu}" for t in ("0.02 cN", "0.04 cN") for mu in ("0.1", "0.4")
    ]
    assert found[0].slug == "tension-0.02-cn-friction-0.1" and found[0].starts == 2
    scenes = [load_scene(c.scene, c.overrides) for c in found]
    assert [s.contact.friction for s in scenes] == [0.1, 0.4, 0.1, 0.4]
    assert [s.ends.tension for s in scenes] == [2e5, 2e5, 4e5, 4e5]
    assert scenes[0].platens.stop.kind == "force" and scenes[0].model.level == "chain", "--set over the file's"


def test_overrides_as_texts_and_as_tables_are_the_same(study_file):
    as_texts = STUDY.partition("[set]")[0] + (
        "set = ['model.level=\"section\"', 'assembly.length=\"0.14 mm\"', 'output.samples=40', "
        "'platens.width=\"70 um\"', 'platens.speed=\"1 m/s\"', 'platens.unload=true', "
        "'platens.stop.displacement=\"7 um\"']\n[[vary]]" + STUDY.partition("[[vary]]")[2]
    )
    one, other = (files.load_study(study_file(text)) for text in (STUDY, as_texts))
    assert one.set == other.set
    again = files.load_study(study_file(one.to_toml(), "resolved.toml"))
    assert files.cells(again) == files.cells(one)


def test_later_overrides_drop_the_alternatives_that_they_replace():
    earlier = ["platens.stop.displacement=1 um", "contact.friction=0.2"]
    assert joined_overrides(earlier, ["platens.stop.force=1 N"]) == ("contact.friction=0.2", "platens.stop.force=1 N")


def test_rows_of_tables_survive_as_overrides():
    value = [{"force": "1 N", "times": 2}, {"thickness": "20 um"}]
    assert tomllib.loads(f"v = {files.toml_text(value)}")["v"] == value


def test_a_scene_is_a_study_of_one_case(tiny, tmp_path):
    for source in ("carbon-127-section", tiny):
        study = files.load_study(source, ["contact.friction=0.1"], 10)
        (cell,) = files.cells(study)
        assert cell.starts == 10 and load_scene(cell.scene, cell.overrides).contact.friction == 0.1
    runs = lay_out(files.cells(files.load_study("carbon-127-section", (), 3))[0], study, tmp_path)
    assert [r.scene.assembly.seed for r in runs] == [1, 2, 3]
    assert [r.scene.assembly.jitter for r in runs] == pytest.approx([7 * JITTER] * 3), "0.01 um: the same specimen"


def test_jitter_leaves_filaments_apart_and_random_packing_alone(tmp_path):
    study = files.load_study("carbon-7")
    for text, jitter in (
        ("assembly.pitch=7.2 um", 0.45 * 0.2),
        ("assembly.pitch=7 um", 0.07),
        ("assembly.jitter=0.02 um", 0.02),
    ):
        (cell,) = files.cells(files.load_study("carbon-7", [text]))
        assert lay_out(cell, study, tmp_path)[0].scene.assembly.jitter == pytest.approx(jitter)
    random = ["assembly.arrangement=random", "assembly.fibre_volume_fraction=0.5", "assembly.jitter=0 um"]
    (cell,) = files.cells(files.load_study("carbon-7", random))
    assert lay_out(cell, study, tmp_path)[0].scene.assembly.jitter == 0


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ('scene = "carbon-7"', "", "scene = \\(not given\\)"),
        ('scene = "carbon-7"', 'scene = "carbon-8"', "carbon-8"),
        ("starts = 2", "starts = 0", "starts = 0: expected a whole number, at least 1"),
        ("starts = 2", "startz = 2", "startz.*did you mean starts"),
        ("values = [0.1, 0.4]", "values = []", "vary.0.values = \\[\\]: expected a list of values"),
        ("values = [0.1, 0.4]", "values = [0.1, 0.1]", "each once"),
        ("values = [0.1, 0.4]", "", "vary.0.values = \\(not given\\): expected a list of values"),
        ("values = [0.1, 0.4]", "values = [0.1, 9.0]", "friction 9.0.*contact.friction = 9.0"),
        ('key = "contact.friction"', 'key = "contact.frict"', "did you mean"),
        ('label = "friction {value}"', 'label = "x"', "labels of letters and numbers, each another"),
        ('loads = ["0.05 N/mm", "0.2 N/mm"]', "loads = []", "at least one load"),
        ('loads = ["0.05 N/mm", "0.2 N/mm"]', 'loads = ["1 N/mm", "1 MPa"]', "all of one kind"),
        ('loads = ["0.05 N/mm", "0.2 N/mm"]', 'loads = ["1 um"]', "compare.loads = '1 um'"),
        ('loads = ["0.05 N/mm", "0.2 N/mm"]', 'loads = ["1 MPa", "2 MPa"]', "loads in N/mm"),
        ("reductions = [0.2]", "reductions = [20]", "between 0 and 1"),
        ('law = "friction-power"', 'law = "cubic"', "'friction-power' or 'power'"),
        ("[compare]", "[compared]", "compared.*did you mean compare"),
        ("[compare]", "[compare", "valid TOML, line"),
        ("model.level = ", "model..level = ", "valid TOML"),
    ],
)
def test_whatever_is_wrong_is_named_before_anything_is_written(study_file, tmp_path, old, new, named):
    assert old in STUDY
    out = tmp_path / "out"
    with pytest.raises(InputError, match=named):
        run_study(study_file(STUDY.replace(old, new)), StudyOptions(out))
    assert not out.exists()


@pytest.mark.parametrize(
    ("options", "named"), [({"jobs": 0}, "--jobs"), ({"starts": 0}, "--starts"), ({"only": ("x",)}, "--only")]
)
def test_wrong_options_are_refused(study_file, tmp_path, options, named):
    with pytest.raises(InputError, match=named):
        run_study(study_file(), StudyOptions(tmp_path / "out", **options))


def test_optional_cases_run_where_they_are_named_alone(study_file, tmp_path):
    text = 'scene="carbon-7"\n[[case]]\nlabel="a"\n[[case]]\nlabel="Big B"\noptional=true\n[compare]\nloads=["1 N"]\n'
    from cgfibre.study.run import _chosen

    found = files.cells(files.load_study(study_file(text)))
    assert [c.slug for c in _chosen(found, ())] == ["a"] and [c.slug for c in _chosen(found, ["Big B"])] == ["big-b"]


def test_every_shipped_study_has_scenes_and_plans():
    """All cases are scenes; one of each study is planned, which takes seconds where sections are packed."""
    assert files.shipped_studies()
    for name in files.shipped_studies():
        study = files.load_study(name, starts=1)
        assert study.title and study.statement, name
        asked = [cell for cell in files.cells(study) if not cell.optional]
        scenes = [load_scene(cell.scene, cell.overrides) for cell in asked]
        assert make_plan(scenes[-1]).level in ("section", "chain", "rod"), name


# --- curves -----------------------------------------------------------------------------------------------------------


def curve_of(displacement, force, phase, cycle=None):
    columns = {name: np.zeros(len(phase)) for name in CURVE_COLUMNS}
    columns |= {"displacement_um": np.array(displacement), "thickness_um": 20 - np.array(displacement)}
    columns["force_top_N"] = np.array(force)
    more = {} if cycle is None else {"cycle": np.array(cycle)}
    return Curve(columns, np.array(phase), np.full(len(phase), np.nan), **more)


def test_branches_begin_where_the_one_before_ended_and_are_numbered():
    d, f = [0.0, 1, 2, 2, 1, 0, 1, 2, 3], [0.0, 1, 4, 3, 1, 0, 2, 5, 9]
    curve = curve_of(d, f, [0, 0, 0, 1, 2, 2, 0, 0, 0], [1] * 6 + [2] * 3)
    found = branches_of(curve, curve["force_top_N"])
    assert list(found) == ["loading", "unloading", "loading 2"]
    assert found["unloading"].load.tolist() == [3, 1, 0] and found["unloading"].unloading
    assert found["loading 2"].load.tolist() == [0, 2, 5, 9]


# --- a tiny real one --------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def studied(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study")
    path = folder / "seven.toml"
    path.write_text(STUDY)
    seen = []
    options = StudyOptions(folder / "out")
    return path, run_study(path, options, (), lambda *state: seen.append(state)), options, seen


def test_a_study_leaves_table_curves_summary_and_plots(studied):
    _, found, options, seen = studied
    out = options.out
    assert [(c.cell.label, len(c.specimens)) for c in found.cases] == [("friction 0.1", 2), ("friction 0.4", 2)]
    with (out / "table.csv").open(newline="") as f:
        rows = list(csv.DictReader(f))
    assert list(rows[0]) == list(table_of(found)) and [r["contact.friction"] for r in rows] == ["0.1", "0.4"]
    t = "thickness_um_at_0.05_N_per_mm"
    for row, case in zip(rows, found.cases, strict=True):
        values = case.metrics[t].values
        assert len(set(values)) == 2, "two specimens"
        assert float(row[t]) == pytest.approx(np.mean(values), rel=1e-5)
        spread = student(2) * abs(values[0] - values[1]) / 2
        assert float(row[t + "_ci95"]) == pytest.approx(spread, rel=1e-3) and row["samples"] == "mean"
        assert float(row["unloading_" + t]) < float(row[t]) + 0.1
        assert row[t + "_n"] == "2"
    summary = json.loads((out / "summary.json").read_text())
    assert summary["statement"] == "more friction, more force" and summary["load"] == "N/mm"
    change = summary["differences_from_first"]["friction-0.4"]["load_N_per_mm_at_5_um"]
    means = [np.mean(c.metrics["load_N_per_mm_at_5_um"].values) for c in found.cases]
    assert change["value"] == pytest.approx(means[1] - means[0]) and means[1] > means[0]
    assert summary["fit"]["law"].startswith("t = c") and np.isfinite(summary["fit"]["a"])
    for name in ("study.png", "values.png"):
        assert (out / name).read_bytes().startswith(b"\x89PNG")
    assert seen[-1][0] == pytest.approx(seen[-1][1])


def test_bands_in_curves_csv_are_those_of_the_runs(studied):
    _, _, options, _ = studied
    with (options.out / "curves.csv").open(newline="") as f:
        rows = [r for r in csv.DictReader(f) if (r["case"], r["branch"]) == ("friction 0.1", "loading")]
    by_load = [r for r in rows if r["y_is"] == "thickness_um" and r["mean"]]
    curves = [
        store.read_results(options.out / "runs" / "friction-0.1" / f"seed-{k}" / "results.h5").curve for k in (1, 2)
    ]
    for row in (by_load[0], by_load[len(by_load) // 2]):
        each = []
        for c in curves:
            f, t = c["force_top_N"][c.loading] / 0.07, c["thickness_um"][c.loading]
            k = int(np.argmax(f >= float(row["x"])))
            each.append(t[k - 1] + (float(row["x"]) - f[k - 1]) / (f[k] - f[k - 1]) * (t[k] - t[k - 1]))
        assert float(row["mean"]) == pytest.approx(np.mean(each), rel=1e-6)
        assert float(row["sd"]) == pytest.approx(np.std(each, ddof=1), rel=1e-6)


def test_runs_are_small_and_found_again(studied, monkeypatch, tmp_path):
    path, found, options, _ = studied
    out = shutil.copytree(options.out, tmp_path / "copy")
    assert not list(out.glob("runs/*/*/deck")) and not list(out.glob("runs/*/*/*.png"))
    ran = []
    run_scene = sweep.run_scene

    def counted(source, own, *arguments, **more):
        ran.append(f"{own.out.parent.name}/{own.out.name}")
        return run_scene(source, own, *arguments, **more)

    monkeypatch.setattr(sweep, "run_scene", counted)
    again = run_study(path, StudyOptions(out))
    assert ran == [] and str(again.cases) == str(found.cases)
    (out / "runs" / "friction-0.4" / "seed-2" / "summary.json").unlink()
    more = run_study(path, StudyOptions(out, starts=3, only=("friction 0.4",)))
    assert sorted(ran) == ["friction-0.4/seed-2", "friction-0.4/seed-3"] and len(more.cases[0].specimens) == 3


def test_a_run_that_fails_is_reported_and_the_others_count(studied, monkeypatch, tmp_path):
    path, _, options, _ = studied
    out = shutil.copytree(options.out, tmp_path / "copy")
    run_scene = sweep.run_scene

    def fails(source, own, *arguments, **more):
        if own.out.parent.name == "friction-0.4":
            raise EngineError("Lost atoms", "halve the time step")
        return run_scene(source, own, *arguments, **more)

    monkeypatch.setattr(sweep, "run_scene", fails)
    for seed in (1, 2):
        shutil.rmtree(out / "runs" / "friction-0.4" / f"seed-{seed}")
        found = run_study(path, StudyOptions(out))
        assert found.failed == [("friction 0.4", "Lost atoms")] * seed
        assert [len(c.specimens) for c in found.cases] == [2, 2 - seed]
        monkeypatch.setattr(sweep, "run_scene", fails)
    labels = [c.label for c in found.cases]
    assert labels[0] == "friction 0.1 (2 samples)"
    with (out / "table.csv").open(newline="") as f:
        assert [r["failed"] for r in csv.DictReader(f)] == ["0", "2"]


def test_one_start_is_called_one_sample(studied):
    _, found, _, _ = studied
    case = found.cases[0]
    one = find_case(case.cell, case.specimens[:1], (), found.study.compare)
    assert one.label == "friction 0.1 (one sample)"
    assert np.isnan(one.thickness["loading"].ci).all() and np.isfinite(one.thickness["loading"].mean).any()


def test_another_study_or_a_run_in_the_folder_is_refused(studied, study_file, finished):
    _, _, options, _ = studied
    with pytest.raises(InputError, match="it holds seven"):
        run_study(study_file(name="other.toml"), StudyOptions(options.out))
    with pytest.raises(InputError, match="--out"):
        run_study(study_file(), StudyOptions(finished.out))


def test_a_killed_study_leaves_no_engine_and_goes_on_where_it_stopped(study_file, tmp_path):
    out = tmp_path / "out"
    path = study_file(STUDY.replace("[0.1, 0.4]", "[0.1]").replace('speed = "1 m/s"', 'speed = "0.2 m/s"'))
    text = path.read_text().partition("[fit]")[0]
    path.write_text(text)
    arguments = ["study", path, "--out", out]
    process = subprocess.Popen(cgfibre_command(*arguments), env=cgfibre_environment(), stderr=subprocess.DEVNULL)
    second = out / "runs" / "friction-0.1" / "seed-2"
    try:
        wait_for(lambda: (second / "deck" / "record.txt").exists(), process)
    finally:
        process.kill()
        process.wait()
    wait_for_none(out)
    first = (out / "runs" / "friction-0.1" / "seed-1" / "results.h5").stat().st_mtime_ns
    done = subprocess.run(
        cgfibre_command(*arguments), env=cgfibre_environment(), capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode in (0, 4), done.stderr
    assert (out / "runs" / "friction-0.1" / "seed-1" / "results.h5").stat().st_mtime_ns == first
    assert "Seven filaments" in done.stdout and (out / "study.png").exists()


def test_the_command_line_lists_studies_and_names_what_is_wrong(cgfibre, study_file):
    listed = cgfibre("study", "--list")
    assert listed.returncode == 0 and "friction-dry" in listed.stdout
    cases = cgfibre("study", study_file(), "--list")
    assert cases.stdout.split() == ["friction-0.1", "2", "starts", "friction-0.4", "2", "starts"]
    wrong = cgfibre("study", "friction-dri")
    assert wrong.returncode == 2 and "did you mean friction-dry" in wrong.stderr and len(wrong.stderr.splitlines()) == 1
    assert cgfibre("study").returncode == 2
