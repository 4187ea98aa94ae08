"""What the package writes for the engine, and how it reads what the engine wrote."""

import re
import tomllib

import numpy as np
import pytest
from conftest import ROOT
from measure_systems import CARBON, straight

from cgfibre import workflow
from cgfibre.engine import collect, deck, dump
from cgfibre.engine.assemble import assemble
from cgfibre.engine.datafile import DataFile, Topology, group_types, write_data
from cgfibre.engine.lammps import find_engine, run_deck
from cgfibre.plan.system import build_system
from cgfibre.scene_reading import load_scene, scene_from_dict

DECKS = ("in.chain", "in.rod", "in.section", "in.subbundle")
OTHERS = ("in.capstan", "in.capstan_dynamic")
DECLARED = re.compile(r"^variable\s+(\w+)", re.M)
USED = re.compile(r"\$\{(\w+)\}|\bv_(\w+)")


# --- data file ------------------------------------------------------------------------------------------------------


def sections(path):
    """Header lines and the rows of every section of a data file: an independent reading."""
    parts = re.split(r"\n\n", path.read_text().rstrip("\n"))
    titles = re.compile(r"^(Masses|PairIJ Coeffs|Bond Coeffs|Angle Coeffs|Dihedral Coeffs|Atoms|Bonds|Angles|Start)\b")
    found, header = {}, []
    for k, part in enumerate(parts):
        if titles.match(part):
            found[titles.match(part)[1]] = [row.split() for row in parts[k + 1].splitlines()]
        elif k == 0 or not titles.match(parts[k - 1]):
            header += part.splitlines()
    return header, found


def data_of(system, **changes):
    rng = np.random.default_rng(3)
    n = system.n_beads
    values = {
        "title": "test",
        "atom_style": "hybrid",
        "atom_columns": [np.ones(n, dtype=int), *(rng.normal(0, 1e3, (3, n)) * 10.0 ** rng.integers(-9, 9, (3, n)))],
        "atom_format": ["%d", "%.17g", "%.17g", "%.17g"],
        "n_types": 2,
        "box": np.array([[-1 / 3, 2 / 3], [-1e-7, np.pi], [-1e3, 1e3]]),
        "pair_style": "granular",
        "pair_rows": [(0, 1, "hooke 1 2")],
        "topologies": [
            Topology("Bond", system.bonds(), np.zeros(len(system.bonds()), dtype=int), [(1 / 3, 7.0)], "harmonic")
        ],
    }
    return DataFile(**(values | changes))


def test_a_data_file_gives_back_every_bit(tmp_path):
    system = straight([(0, 0), (8, 0)], n=5)
    data = data_of(system, start=np.random.default_rng(0).normal(0, 1e-9, (10, 3)))
    write_data(tmp_path / "d", data)
    header, found = sections(tmp_path / "d")
    assert {"10 atoms", "2 atom types", "8 bonds", "1 bond types"} <= set(header)
    box = [line.split()[:2] for line in header if line.endswith("hi")]
    assert np.array_equal(np.array(box, dtype=float), data.box)
    atoms = np.array(found["Atoms"], dtype=float)
    assert np.array_equal(atoms[:, 0], np.arange(1, 11))
    assert np.array_equal(atoms[:, 2:], np.column_stack(data.atom_columns[1:]))
    assert np.array_equal(np.array(found["Start"], dtype=float)[:, 1:], data.start)
    bonds = np.array(found["Bonds"], dtype=int)
    assert np.array_equal(bonds[:, 2:] - 1, system.bonds()) and set(bonds[:, 1]) == {1}
    assert float(found["Bond Coeffs"][0][1]) == 1 / 3
    assert found["PairIJ Coeffs"] == [["1", "2", "hooke", "1", "2"]]
    assert len(found["Masses"]) == 2


def test_rows_beyond_one_chunk_are_all_written(tmp_path, monkeypatch):
    monkeypatch.setattr("cgfibre.engine.datafile.CHUNK", 7)
    system = straight([(0, 0), (8, 0)], n=10)
    write_data(tmp_path / "d", data_of(system))
    _, found = sections(tmp_path / "d")
    assert [int(row[0]) for row in found["Atoms"]] == list(range(1, 21))
    assert [int(row[0]) for row in found["Bonds"]] == list(range(1, 19))


def test_equal_rows_share_a_type_and_round_off_makes_no_new_one():
    a = np.array([7.0, 3.0, 7.0, 7.0 * (1 + 1e-14), 3.0])
    kind, first = group_types(a, np.array([1.0, 2.0, 1.0, 1.0, 5.0]))
    assert len(first) == 3 and kind[0] == kind[2] == kind[3]
    assert len({kind[0], kind[1], kind[4]}) == 3
    assert np.array_equal(kind[first], np.arange(3))
    assert len(group_types(np.array([1.0, 1.0 + 1e-6]))[1]) == 2
    assert len(group_types(np.array([0.0, 0.0, 1.0]))[1]) == 2
    assert [len(x) for x in group_types()] == [0, 0]


def test_mdanalysis_reads_the_data_file_of_a_scene(tiny, tmp_path):
    import MDAnalysis as mda

    scene, plan = workflow.plan_scene(tiny, ["model.symmetry=none"])
    system = build_system(scene, plan)
    write_data(tmp_path / "system.data", assemble(system, plan).data)
    u = mda.Universe(
        str(tmp_path / "system.data"),
        topology_format="DATA",
        format="DATA",
        atom_style="id type x y z diameter density resid",
    )
    assert u.atoms.positions == pytest.approx(system.positions, rel=1e-6, abs=1e-5)
    assert np.array_equal(u.bonds.indices, system.bonds())
    assert np.array_equal(u.angles.indices, system.angles())
    assert np.array_equal(u.atoms.resids - 1, system.filament_of_bead)


def test_a_rod_starts_where_the_scene_says(tiny, tmp_path):
    """Natural positions plus Start are the beads as built; natural is shorter by the end load's strain."""
    scene, plan = workflow.plan_scene(tiny, ["model.level=rod"])
    system = build_system(scene, plan)
    write_data(tmp_path / "d", assemble(system, plan).data)
    header, found = sections(tmp_path / "d")
    natural = np.array([row[2:5] for row in found["Atoms"]], dtype=float)
    start = np.array(found["Start"], dtype=float)[:, 1:]
    n, grips = system.n_beads, 2 * system.n_filaments
    assert f"{n + grips} atoms" in header and len(start) == n + grips
    assert (natural + start)[:n] == pytest.approx(system.positions, abs=1e-9)
    strain = scene.ends.tension / CARBON.EA
    lengths = np.diff(natural[: plan.beads.stations.size, 0])
    assert np.diff(plan.beads.stations) / lengths - 1 == pytest.approx(strain, rel=1e-3)


def test_grips_of_a_graded_rod_lie_in_the_box(tiny, tmp_path):
    scene, plan = workflow.plan_scene(tiny, ["model.level=rod", "model.far_field=graded", "assembly.length=2 mm"])
    made = assemble(build_system(scene, plan), plan)
    x = made.data.atom_columns[1]
    assert x.min() < -50  # a coarse segment beyond the end
    assert made.data.box[0, 0] < x.min() and x.max() < made.data.box[0, 1]
    assert made.parameters["box_x_lo"] == made.data.box[0, 0]


# --- decks ----------------------------------------------------------------------------------------------------------


def all_lines(
    name, shapes=("flat", "crimped", "section", "section_crimped"), supports=("simple", "condensed", "periodic")
):
    """Text of a deck with every include it could take."""
    files = set()
    for shape in shapes:
        for support in supports:
            for discs in ("engine", "plugin"):
                values = {"platen_shape": shape, "support": support, "discs": discs}
                if name == "in.section":
                    values["contact_shape"] = "discs"
                if name == "in.subbundle":
                    values |= {"contact_shape": "subbundle", "platen_shape": "subbundle"}
                files |= set(deck.deck_files(name, values))
    return "\n".join((deck.template_folder() / f).read_text() for f in sorted(files))


def uncommented(text):
    return "\n".join(line.split("#")[0] for line in text.splitlines())


@pytest.mark.parametrize("name", DECKS)
def test_every_variable_that_a_deck_uses_is_declared(name):
    text = uncommented(all_lines(name))
    used = {a or b for a, b in USED.findall(text)}
    from_state = {"leg_at", "phase_at", "slot_at", "step_at", "place_at", "origin_at", "clock_at"}
    from_state |= {"hold_until_at", "unload_force_at", "checkpoint"}
    declared = set(DECLARED.findall(text.replace('"variable ', "\nvariable "))) | from_state
    assert used - declared == set()
    assert from_state <= set(DECLARED.findall((ROOT / "templates" / "phases.inc").read_text().replace('"""', "\n")))


@pytest.mark.parametrize("name", OTHERS)
def test_another_deck_declares_what_it_uses_and_uses_what_it_declares(name):
    text = uncommented((ROOT / "templates" / name).read_text())
    used = {a or b for a, b in USED.findall(text)}
    own = set(re.findall(r"^variable\s+(\w+)\s+index", text, re.M))
    assert used <= set(DECLARED.findall(text)) and own <= used


def test_every_tunable_is_used_somewhere():
    texts = {f.name: f.read_text() for f in (ROOT / "templates").iterdir()}
    everything = uncommented("\n".join(texts.values()))
    used = {a or b for a, b in USED.findall(everything)}
    for name in DECKS:
        mine = {a or b for a, b in USED.findall(uncommented(all_lines(name)))}
        own = set(re.findall(r"^variable\s+(\w+)\s+index", texts[name], re.M))
        assert own - mine == set(), name
    assert set(re.findall(r"^variable\s+(\w+)\s+index", texts["defaults.inc"], re.M)) - used == set()


def test_every_tunable_says_its_default_once_and_parses():
    for name in DECKS:
        text = (ROOT / "templates" / name).read_text() + (ROOT / "templates" / "defaults.inc").read_text()
        names = re.findall(r"^variable\s+(\w+)\s+index", text, re.M)
        assert len(names) == len(set(names))
        assert set(names) == set(deck.declared_variables(name)), "a declaration that the parser does not see"


def test_a_parameter_that_no_deck_declares_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"in\.chain declares no variable platen_frction"):
        deck.write_deck(tmp_path / "deck", "in.chain", {"platen_frction": 0.3}, "")


@pytest.mark.parametrize("level", ["chain", "rod", "section"])
def test_a_deck_folder_holds_the_includes_it_needs_and_no_others(tiny, tmp_path, level):
    folder = workflow.build_scene(tiny, tmp_path / "out", [f"model.level={level}"])
    have = {p.name for p in folder.iterdir()}
    text = "\n".join((folder / f).read_text() for f in have if f.endswith(".inc") or f.startswith("in."))
    values = dict(re.findall(r"^variable\s+(\w+)\s+index\s+(\S+)", text, re.M))
    values |= dict(re.findall(r"^variable\s+(\w+)\s+index\s+(\S+)", (folder / "parameters.inc").read_text(), re.M))
    needed = {re.sub(r"\$\{(\w+)\}", lambda m: values[m[1]], f) for f in re.findall(r"^\s*include\s+(\S+)", text, re.M)}
    assert needed <= have
    assert {f for f in have if f.endswith(".inc")} == needed
    assert {"README", "system.data", f"in.{level}"} <= have
    assert f"lmp -in in.{level}" in (folder / "README").read_text()


def test_parameters_win_over_defaults_and_var_over_both(tiny, tmp_path):
    from cgfibre.engine.lammps import find_engine, run_deck

    deck.write_deck(tmp_path, "in.chain", {"platen_friction": 0.25, "drag": 3.5}, "")
    wanted = " ".join(f"{k}=${{{k}}}" for k in ("platen_friction", "drag", "hold_steps"))
    (tmp_path / "in.show").write_text(f'include parameters.inc\ninclude defaults.inc\nprint "{wanted}" file shown\n')
    run_deck(find_engine(), tmp_path, "in.show")
    assert (tmp_path / "shown").read_text().split() == ["platen_friction=0.25", "drag=3.5", "hold_steps=0"]
    run_deck(find_engine(), tmp_path, "in.show", variables={"platen_friction": "0.125"})
    assert (tmp_path / "shown").read_text().split()[0] == "platen_friction=0.125"


# --- what the engine wrote ------------------------------------------------------------------------------------------


def record_lines(steps, value=1.0):
    return "".join(f"{s} " + " ".join([f"{value * s:g}"] * (len(dump.RECORD_COLUMNS) - 1)) + "\n" for s in steps)


def extreme_lines(steps, value=1.0):
    return "".join(f"{s} " + " ".join([f"{value * s:g}"] * (len(dump.EXTREME_COLUMNS) - 1)) + "\n" for s in steps)


def test_a_record_cut_short_keeps_its_whole_rows(tmp_path):
    (tmp_path / "record.txt").write_text("# head\n" + record_lines([10, 20, 30])[:-9])
    (tmp_path / "extremes.txt").write_text("# head\n" + extreme_lines([0, 10, 20, 30]))
    raw = dump.read_record(tmp_path)
    assert raw.step.tolist() == [10, 20] and raw.mean["displacement"].tolist() == [10.0, 20.0]
    assert raw.start["y_lo"] == 0.0


def test_of_repeated_rows_the_last_one_counts(tmp_path):
    """A resumed run computes rows again that the killed one had written."""
    (tmp_path / "record.txt").write_text(
        record_lines([10, 20, 30], 1.0) + "# again\n" + record_lines([20, 30, 40], 2.0)
    )
    (tmp_path / "extremes.txt").write_text(extreme_lines([0, 10, 20, 30, 40]))
    raw = dump.read_record(tmp_path)
    assert raw.step.tolist() == [10, 20, 30, 40]
    assert raw.mean["top_force"].tolist() == [10.0, 40.0, 60.0, 80.0]


def test_a_row_cut_in_the_middle_does_not_swallow_the_resumed_one(tmp_path):
    """Killed while writing a row: the engine appends to it, and the joined line is of neither run."""
    (tmp_path / "record.txt").write_text(record_lines([10, 20])[:-12] + record_lines([20, 30]))
    (tmp_path / "extremes.txt").write_text(extreme_lines([0, 10, 20, 30]))
    raw = dump.read_record(tmp_path)
    assert raw.step.tolist()[0] == 10 and raw.step.tolist()[-1] == 30
    assert np.all(np.isfinite(raw.mean["top_force"]))
    assert all(raw.mean["top_force"] == raw.step)


@pytest.mark.parametrize("text", ["", "# only a head\n", "12 3 4"])
def test_an_empty_record_is_empty(tmp_path, text):
    (tmp_path / "record.txt").write_text(text)
    raw = dump.read_record(tmp_path)
    assert len(raw.step) == 0 and raw.start == {}
    assert dump.last_row(tmp_path / "record.txt") is None
    assert dump.last_row(tmp_path / "absent.txt") is None


def test_the_last_row_is_whole_even_in_a_long_file(tmp_path):
    (tmp_path / "record.txt").write_text(record_lines(range(0, 5000, 5)) + "5000 1 2")
    assert dump.last_row(tmp_path / "record.txt")[0] == 4995


def frame(step, n=3, value=None):
    rows = "".join(f"{i + 1} 1 1 {value if value is not None else step} {i} 0 3.5\n" for i in range(n))
    return (
        f"ITEM: TIMESTEP\n{step}\nITEM: NUMBER OF ATOMS\n{n}\nITEM: BOX BOUNDS ff ff ff\n0 1\n0 1\n0 1\n"
        f"ITEM: ATOMS id mol type xu yu zu radius\n{rows}"
    )


def test_frames_cut_short_are_left_out_wherever_the_cut_is(tmp_path):
    whole = frame(0) + frame(10)
    for cut in range(1, len(frame(20))):
        (tmp_path / "t").write_text(whole + frame(20)[:-cut])
        assert [s for s, _ in dump.iterate_frames(tmp_path / "t", 3)] == [0, 10], cut
    (tmp_path / "t").write_text(whole + frame(20))
    steps, positions = zip(*dump.iterate_frames(tmp_path / "t", 3), strict=True)
    assert steps == (0, 10, 20) and positions[2].tolist() == [[20, 0, 0], [20, 1, 0], [20, 2, 0]]


def test_frames_after_a_cut_one_are_found_again(tmp_path):
    """Killed while writing a frame, then resumed: the frames of the resumed run follow the cut one."""
    for cut in (1, 5, 20, 60, 100, 120):
        (tmp_path / "t").write_text(frame(0) + frame(10)[:-cut] + frame(10) + frame(20))
        found = dict(dump.iterate_frames(tmp_path / "t", 3))
        assert sorted(found) == [0, 10, 20], cut
        assert found[10][:, 0].tolist() == [10, 10, 10]


def test_beads_beyond_the_system_are_dropped_and_missing_ones_are_nan(tmp_path):
    (tmp_path / "t").write_text(frame(0, n=5))
    [(_, positions)] = dump.iterate_frames(tmp_path / "t", 3)
    assert positions.shape == (3, 3)
    (tmp_path / "t").write_text(frame(0, n=2))
    [(_, positions)] = dump.iterate_frames(tmp_path / "t", 3)
    assert np.isnan(positions[2]).all() and np.isfinite(positions[:2]).all()
    assert list(dump.iterate_frames(tmp_path / "absent", 3)) == []
    (tmp_path / "t").write_text("")
    assert list(dump.iterate_frames(tmp_path / "t", 3)) == []


STATE = """variable checkpoint index checkpoint.{0}
variable phase_at index 1
variable slot_at index {0}
variable step_at index {1}
variable unload_force_at index 0
# complete
"""


def test_only_complete_states_with_their_checkpoint_count_newest_first(tmp_path):
    for slot, step in ((0, 500), (1, 400)):
        (tmp_path / f"state.{slot}").write_text(STATE.format(slot, step))
        (tmp_path / f"checkpoint.{slot}").write_bytes(b"x" + dump.END_OF_RESTART + b"\0")
    assert [(s.file, s.step) for s in dump.read_states(tmp_path)] == [("state.0", 500), ("state.1", 400)]
    (tmp_path / "state.0").write_text(STATE.format(0, 500)[:-4])
    assert [s.file for s in dump.read_states(tmp_path)] == ["state.1"]
    (tmp_path / "checkpoint.1").write_bytes(b"x")  # half of a checkpoint
    assert dump.read_states(tmp_path) == []


def test_the_displacement_of_a_frame_is_the_decks_own(finished):
    """displacement_at repeats motion.inc in Python: both must agree wherever the engine printed it."""
    _, plan = workflow.plan_scene(finished.out / "scene.toml")
    raw = dump.read_record(finished.out / "deck")
    assert raw.mean["displacement"].max() > 3.5
    loading = raw.mean["phase"] == 0
    mine = collect.displacement_at(plan, raw.step[loading])
    assert mine == pytest.approx(raw.state["displacement"][loading], rel=1e-9, abs=1e-9)


def test_the_templates_are_found_in_the_checkout():
    assert deck.template_folder() == ROOT / "templates"
    assert {p.name for p in deck.template_folder().glob("in.*")} == {*DECKS, *OTHERS, "in.cell"}


def test_mending_cuts_the_unfinished_row_alone(tmp_path):
    (tmp_path / "record.txt").write_text("# head\n" + record_lines([10, 20]) + "30 1")
    (tmp_path / "extremes.txt").write_text(extreme_lines([0, 10]))
    dump.mend_tables(tmp_path)
    assert (tmp_path / "record.txt").read_text() == "# head\n" + record_lines([10, 20])
    assert (tmp_path / "extremes.txt").read_text() == extreme_lines([0, 10])
    (tmp_path / "record.txt").write_text("12 3")
    dump.mend_tables(tmp_path)
    assert (tmp_path / "record.txt").read_text() == ""


# --- smooth filaments -------------------------------------------------------------------------------------------------


SHORT = {"load_steps": "40", "unload": "0", "sample_steps": "20", "sample_every": "10", "block_steps": "20"}


def test_friction_of_capsules_goes_to_the_deck_in_the_words_of_the_plugin(tmp_path):
    """Static and kinetic; against the crossing angle, in a table of its own. The deck takes them as one word."""
    scene = load_scene("carbon-7", ["contact.kinetic_friction=0.15"])
    folder = workflow.build_scene("carbon-7", tmp_path / "kinetic", ["contact.kinetic_friction=0.15"])
    words = 'variable contact_friction index "0.20000000000000001 kinetic 0.14999999999999999"\n'
    assert words in (folder / "parameters.inc").read_text()
    assert scene_from_dict(tomllib.loads(scene.to_toml())) == scene

    rows = 'contact.friction_by_angle=[["0 deg", 0.42], ["45 deg", 0.2], ["90 deg", 0.23]]'
    scene = load_scene("carbon-7", [rows])
    assert scene_from_dict(tomllib.loads(scene.to_toml())) == scene
    folder = workflow.build_scene("carbon-7", tmp_path / "angle", [rows])
    table = [line.split() for line in (folder / "friction.txt").read_text().splitlines()[3:]]
    assert [[float(x) for x in row] for row in table] == [
        [1, 0, 0.42],
        [2, pytest.approx(45), 0.2],
        [3, pytest.approx(90), 0.23],
    ]
    # and the engine takes them: parallel filaments slip at the coefficient of 0 degrees
    run_deck(find_engine(), folder, "in.chain", variables=SHORT)
    log = (folder / "log.lammps").read_text()
    assert "friction angle friction.txt FRICTION ratio 1" in log
