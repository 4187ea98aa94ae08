"""results.h5, curve.csv, JSON: round trips, MDAnalysis, damage, atomic writing."""

import csv
import json
import math
from dataclasses import replace

import h5py
import numpy as np
import pytest
from measure_systems import hexagonal, straight, system_of

from cgfibre import store
from cgfibre.errors import StoreError
from cgfibre.record import CURVE_COLUMNS, Curve, Frames

ANGSTROM = 1e4  # in a um
PS = 1e6  # in a us


def results(system=None, n_frames=4, n_samples=6):
    rng = np.random.default_rng(5)
    system = system or straight(hexagonal(1), n=5)
    steps = np.arange(n_frames) * 700
    curve = Curve(
        {name: rng.normal(size=n_samples) for name in CURVE_COLUMNS},
        np.array([0, 0, 0, 1, 2, 2]),
        rng.uniform(20, 30, n_samples),
    )
    curve.columns["step"] = np.arange(n_samples) * 10.0
    frames = Frames(steps, rng.uniform(0, 9, n_frames), rng.normal(0, 300, (n_frames, system.n_beads, 3)), 1.0 + steps)
    return store.Results(
        system=system,
        curve=curve,
        frames=frames,
        timestep=7.3e-4,
        distribution={"sd": (rng.normal(size=(n_frames, 2)), "1"), "width": (rng.normal(size=n_frames), "um")},
        scene='name = "ü µm"\n',
        plan='{"level": "chain"}',
        summary={"trusted": True, "speed_error": None, "warnings": ["ä"]},
    )


def assert_same(a, b):
    for name in ("positions", "filament_start", "closed", "tow", "filament_type", "box", "periodic", "prestrain"):
        x, y = getattr(a.system, name), getattr(b.system, name)
        assert np.array_equal(x, y) and x.dtype == y.dtype, name
    assert a.system.types == b.system.types and a.system.provenance == b.system.provenance
    for name in CURVE_COLUMNS:
        assert np.array_equal(a.curve[name], b.curve[name]), name
    assert np.array_equal(a.curve.phase, b.curve.phase) and np.array_equal(a.curve.width_um, b.curve.width_um)
    assert np.array_equal(a.frames.step, b.frames.step)
    assert np.array_equal(a.frames.displacement_um, b.frames.displacement_um)
    assert np.array_equal(a.frames.factor, b.frames.factor)
    assert a.frames.positions == pytest.approx(b.frames.positions, rel=1e-15, abs=0)  # through nm and back
    assert a.timestep == pytest.approx(b.timestep, rel=1e-14)
    assert a.distribution.keys() == b.distribution.keys()
    for name, (values, units) in a.distribution.items():
        assert np.array_equal(values, b.distribution[name][0]) and units == b.distribution[name][1]
    assert (a.scene, a.plan, dict(a.summary)) == (b.scene, b.plan, dict(b.summary))


def test_everything_comes_back(tmp_path):
    r = results()
    r = replace(
        r,
        system=replace(
            r.system,
            tow=np.array([0, 0, 0, 1, 1, 2, 2]),
            prestrain=np.linspace(0, 1e-3, 7),
            provenance={"builder": "bundle", "seed": 3, "spec": {"pitch": 8.0}},
        ),
    )
    store.write_results(tmp_path / "r.h5", r)
    assert_same(store.read_results(tmp_path / "r.h5"), r)


def test_a_periodic_system_and_one_without_frames_come_back(tmp_path):
    x = np.arange(10) * 7.0
    chains = [np.stack([x, np.full(10, y), np.zeros(10)], axis=1) for y in (0.0, 8.0)]
    box = [[0, 70], [-50, 50], [-60, 60]]
    periodic = results(system_of(chains, closed=True, box=box, periodic=(True, False, False)))
    store.write_results(tmp_path / "p.h5", periodic)
    assert_same(store.read_results(tmp_path / "p.h5"), periodic)
    empty = replace(
        results(), frames=Frames(np.empty(0, dtype=np.int64), np.empty(0), np.empty((0, 35, 3))), timestep=0.0
    )
    store.write_results(tmp_path / "e.h5", empty)
    back = store.read_results(tmp_path / "e.h5")
    assert len(back.frames) == 0 and back.frames.positions.shape == (0, 35, 3)
    assert_same(back, empty)
    with pytest.raises(StoreError, match="no frames"):
        store.open_universe(tmp_path / "e.h5")


@pytest.mark.parametrize("where", ["made", "real"])
def test_every_dataset_states_its_units(tmp_path, where, request):
    path = tmp_path / "r.h5"
    if where == "made":
        store.write_results(path, results())
    else:
        path = request.getfixturevalue("finished").out / "results.h5"
    without, seen = [], {}

    def visit(name, item):
        if isinstance(item, h5py.Dataset):
            units = item.attrs.get("units")
            seen[name] = units
            if not (isinstance(units, str) and units):
                without.append(name)

    with h5py.File(path) as f:
        f.visititems(visit)
    assert without == []
    assert (
        seen["record/force_top_N"] == "N" and seen["system/positions"] == "um" and seen["system/types/EI"] == "nN um2"
    )
    assert len(seen) > 30


def test_a_periodic_box_states_its_units_too(tmp_path):
    x = np.arange(10) * 7.0
    system = system_of(
        [np.stack([x, 0 * x, 0 * x], axis=1)],
        closed=True,
        box=[[0, 70], [-9, 9], [-9, 9]],
        periodic=(True, False, False),
    )
    store.write_results(tmp_path / "r.h5", results(system))
    with h5py.File(tmp_path / "r.h5") as f:
        bare = []
        f.visititems(lambda n, o: bare.append(n) if isinstance(o, h5py.Dataset) and "units" not in o.attrs else None)
    assert bare == []


# --- MDAnalysis -----------------------------------------------------------------------------------------------------


def test_mdanalysis_opens_the_run_with_bonds_in_its_own_units(finished):
    system, frames = (s := store.read_results(finished.out / "results.h5")).system, s.frames
    u = store.open_universe(finished.out / "results.h5")
    assert (u.atoms.n_atoms, u.residues.n_residues, len(u.trajectory)) == (system.n_beads, 7, len(frames))
    assert np.array_equal(u.bonds.indices, system.bonds())
    assert u.atoms.radii == pytest.approx(np.full(system.n_beads, 3.5 * ANGSTROM))
    for k in (0, len(frames) // 2, len(frames) - 1):
        ts = u.trajectory[k]
        float32 = float(np.finfo(np.float32).eps)
        assert ts.positions == pytest.approx(frames.positions[k] * ANGSTROM, rel=2 * float32, abs=0.02)
        assert ts.time == pytest.approx(frames.step[k] * s.timestep * PS, rel=1e-6)
    assert np.array_equal(u.residues[3].atoms.indices, np.arange(*system.filament_start[3:5]))


def test_the_file_is_a_plain_h5md_trajectory(finished):
    """Any topology with as many atoms will do."""
    import MDAnalysis as mda

    frames = store.read_results(finished.out / "results.h5").frames
    u = mda.Universe.empty(frames.positions.shape[1], trajectory=True)
    u.load_new(str(finished.out / "results.h5"), format="H5MD")
    assert len(u.trajectory) == len(frames)
    assert u.trajectory[-1].positions == pytest.approx(frames.positions[-1] * ANGSTROM, rel=3e-7, abs=0.02)


def test_mdanalysis_opens_a_periodic_run(tmp_path):
    x = np.arange(10) * 7.0
    system = system_of(
        [np.stack([x, 0 * x, 0 * x], axis=1)],
        closed=True,
        box=[[0, 70], [-9, 9], [-9, 9]],
        periodic=(True, False, False),
    )
    r = results(system)
    store.write_results(tmp_path / "r.h5", r)
    u = store.open_universe(tmp_path / "r.h5")
    assert len(u.bonds) == 10
    assert u.trajectory[2].positions == pytest.approx(r.frames.positions[2] * ANGSTROM, rel=3e-7, abs=0.02)
    assert u.dimensions[0] == pytest.approx(70 * ANGSTROM)


# --- damage ---------------------------------------------------------------------------------------------------------


def one_line(info):
    text = str(info.value)
    assert "\n" not in text and "r.h5" in text
    return text


def test_a_missing_file_is_one_line(tmp_path):
    with pytest.raises(StoreError) as info:
        store.read_results(tmp_path / "r.h5")
    assert "no such file" in one_line(info)
    with pytest.raises(StoreError) as info:
        store.open_universe(tmp_path / "r.h5")
    one_line(info)


@pytest.mark.parametrize("schema", [0, 2, 99])
def test_another_schema_is_refused(tmp_path, schema):
    store.write_results(tmp_path / "r.h5", results())
    with h5py.File(tmp_path / "r.h5", "a") as f:
        f.attrs["cgfibre_schema"] = schema
    for read in (store.read_results, store.open_universe):
        with pytest.raises(StoreError) as info:
            read(tmp_path / "r.h5")
        assert f"schema version {schema}" in one_line(info)


def test_hdf5_of_others_is_refused(tmp_path):
    with h5py.File(tmp_path / "r.h5", "w") as f:
        f["x"] = 1
    for read in (store.read_results, store.open_universe):
        with pytest.raises(StoreError) as info:
            read(tmp_path / "r.h5")
        assert "schema" in one_line(info)


@pytest.mark.parametrize("share", [0.0, 0.01, 0.3, 0.7, 0.99])
def test_a_file_cut_short_is_refused(tmp_path, share):
    store.write_results(tmp_path / "r.h5", results())
    whole = (tmp_path / "r.h5").read_bytes()
    (tmp_path / "r.h5").write_bytes(whole[: int(len(whole) * share)])
    for read in (store.read_results, store.open_universe):
        with pytest.raises(StoreError) as info:
            read(tmp_path / "r.h5")
        one_line(info)


@pytest.mark.parametrize("missing", ["system/box", "record/step", "particles", "plan", "connectivity"])
def test_a_file_that_lacks_a_part_is_refused(tmp_path, missing):
    store.write_results(tmp_path / "r.h5", results())
    with h5py.File(tmp_path / "r.h5", "a") as f:
        del f[missing]
    if missing == "connectivity":  # derived from the system
        store.read_results(tmp_path / "r.h5")
        return
    with pytest.raises(StoreError) as info:
        store.read_results(tmp_path / "r.h5")
    one_line(info)


def test_a_file_that_contradicts_itself_is_refused(tmp_path):
    store.write_results(tmp_path / "r.h5", results())
    with h5py.File(tmp_path / "r.h5", "a") as f:
        del f["system/tow"]
        f["system/tow"] = np.zeros(3, dtype=int)
    with pytest.raises(StoreError) as info:
        store.read_results(tmp_path / "r.h5")
    one_line(info)


# --- writing --------------------------------------------------------------------------------------------------------


def test_a_failed_write_leaves_the_old_file_whole(tmp_path, monkeypatch):
    old, new = results(), replace(results(), scene="other")
    store.write_results(tmp_path / "r.h5", old)

    def full(*args, **kwargs):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as m:
        m.setattr(store, "_write_system", full)
        with pytest.raises(OSError, match="No space"):
            store.write_results(tmp_path / "r.h5", new)
    assert [p.name for p in tmp_path.iterdir()] == ["r.h5"]
    assert_same(store.read_results(tmp_path / "r.h5"), old)

    store.write_json(tmp_path / "s.json", {"a": 1})
    with pytest.raises(TypeError):
        store.write_json(tmp_path / "s.json", {"a": object()})
    assert json.loads((tmp_path / "s.json").read_text()) == {"a": 1}

    store.write_curve(tmp_path / "c.csv", old.curve)
    before = (tmp_path / "c.csv").read_bytes()
    broken = replace(old.curve, columns=old.curve.columns | {"work_J": np.zeros(2)})
    with pytest.raises(ValueError):
        store.write_curve(tmp_path / "c.csv", broken)
    assert (tmp_path / "c.csv").read_bytes() == before
    assert sorted(p.name for p in tmp_path.iterdir()) == ["c.csv", "r.h5", "s.json"]


def test_the_csv_holds_the_columns_of_the_interface_to_ten_digits(tmp_path):
    r = results()
    store.write_curve(tmp_path / "c.csv", r.curve)
    with (tmp_path / "c.csv").open(newline="") as f:
        rows = list(csv.reader(f))
    assert ",".join(rows[0]) == (
        "step,time_us,displacement_um,thickness_um,force_top_N,force_bottom_N,pressure_MPa,"
        "fibre_volume_fraction,kinetic_J,stored_J,work_J"
    )
    for k, name in enumerate(rows[0]):
        assert [float(row[k]) for row in rows[1:]] == pytest.approx(r.curve[name], rel=1e-9, abs=0)
    assert [row[0] for row in rows[1:]] == ["0", "10", "20", "30", "40", "50"]


def test_json_knows_no_numpy_and_no_nan(tmp_path):
    values = {
        "a": np.float64(0.1),
        "b": np.arange(3),
        "c": [math.nan, np.inf, -1.5],
        "d": {"e": np.bool_(True), 1: None},
        "f": (np.int64(3), "x"),
    }
    store.write_json(tmp_path / "j", values)
    assert json.loads((tmp_path / "j").read_text()) == {
        "a": 0.1,
        "b": [0, 1, 2],
        "c": [None, None, -1.5],
        "d": {"e": True, "1": None},
        "f": [3, "x"],
    }
