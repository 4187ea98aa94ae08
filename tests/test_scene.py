import copy
import math
import tomllib

import pytest
import tomli_w
from hypothesis import given, settings
from hypothesis import strategies as st
from scene_tables import ABSENT, with_changes

from cgfibre import scene as module
from cgfibre import scene_messages
from cgfibre.errors import InputError
from cgfibre.materials import MATERIALS
from cgfibre.scene import Scene
from cgfibre.scene_reading import load_scene, scene_from_dict, scene_text, shipped_scenes

BASE = {
    "filament": {"material": "T700 carbon"},
    "assembly": {"count": 37, "length": "0.7 mm"},
    "platens": {"width": "0.5 mm", "stop": {"displacement": "30 um"}},
}
OWN = {"diameter": "7 um", "E1": "230 GPa", "E2": "10 GPa", "nu23": 0.3, "G12": "27.3 GPa", "density": "1800 kg/m3"}
SHIPPED = [
    "carbon-2",
    "carbon-7",
    "carbon-19",
    "carbon-37",
    "carbon-37-column",
    "carbon-37-full-length",
    "carbon-37-section",
    "carbon-127",
    "carbon-127-section",
    "carbon-127-twisted",
    "carbon-547-section",
    "carbon-12k-3d",
    "carbon-12k-section",
    "carbon-12k-tow",
]
#: see test_weave_scene.py
WEAVES = ["carbon-satin", "carbon-weave", "glass-twill", "glass-weave", "nylon-weave", "nylon-weave-filaments"]
CENTRES = "y_um,z_um\n0.1,0.2\n7.5,0.0\n-3.0,7.25\n"
FILE = {"assembly.arrangement": "file", "assembly.centres": CENTRES, "assembly.count": ABSENT,
        "platens.stop": {"displacement": "5 um"}}  # fmt: skip


def changed(changes):
    """BASE with dotted keys set, or taken out."""
    return with_changes(BASE, changes)


# --- what comes out --------------------------------------------------------------------------------------------------


def test_a_short_scene_is_filled_with_defaults_in_engine_units():
    s = scene_from_dict(BASE)
    assert (s.filament.diameter, s.filament.E1, s.filament.density) == (7.0, 230e6, 1.8)
    assert s.filament.nu12 == 0.256 and s.filament.G23 == 3.85e6
    assert (s.assembly.kind, s.assembly.arrangement, s.assembly.void_fraction) == ("bundle", "circular", 0.31)
    assert (s.assembly.length, s.assembly.twist, s.assembly.first_angle, s.assembly.jitter) == (700.0, 0.0, 0.0, 0.0)
    assert (s.ends.support, s.ends.tension) == ("simply-supported", 4e5)
    assert (s.platens.width, s.platens.bottom_width, s.platens.friction) == (500.0, None, 0.3)
    assert (s.platens.stop.kind, s.platens.stop.value) == ("displacement", 30.0)
    assert (s.contact.friction, s.contact.line_load, s.contact.law) == (0.2, 1e6, "auto")
    assert (s.model.level, s.model.spacing, s.model.accuracy) == ("auto", "auto", 0.05)
    assert (s.output.frames, s.output.samples, s.output.dump) == (60, 300, False)
    assert s.assembly.straight and s.name == ""
    assert s.filament.EA == pytest.approx(8.851e9, rel=1e-4)  # thesis Table 4-1


def test_own_constants_need_no_material_and_derive_what_follows():
    s = scene_from_dict(BASE | {"filament": OWN})
    assert s.filament.material is None and s.filament.nu12 == 0.3
    assert s.filament.G23 == pytest.approx(10e6 / 2.6, rel=1e-15)
    assert scene_from_dict(BASE | {"filament": OWN | {"G23": "4 GPa"}}).filament.G23 == 4e6


def test_a_named_material_gives_way_to_what_is_stated():
    s = scene_from_dict(changed({"filament.E2": "15 GPa"}))
    assert s.filament.E2 == 15e6 and s.filament.E1 == 230e6
    assert s.filament.G23 == pytest.approx(15e6 / 2.6, rel=1e-15)  # not the library's for another E2
    assert scene_from_dict(changed({"filament.E1": "100 GPa"})).filament.G23 == 3.85e6


@pytest.mark.parametrize("name", list(MATERIALS))
def test_every_material_makes_a_filament(name):
    data = changed({"filament.material": name, "assembly.length": "345 mm", "platens.width": "full"})
    data["ends"], data["platens"]["stop"] = {"tension": "0 cN"}, {"pressure": "1 MPa"}
    filament = scene_from_dict(data).filament
    for key in ("diameter", "E1", "E2", "nu12", "nu23", "G12", "G23", "density"):
        assert getattr(filament, key) == getattr(MATERIALS[name], key)


@pytest.mark.parametrize(
    "changes",
    [
        {"assembly.pitch": "7 um"},
        {"assembly.void_fraction": 0.0932},
        {"assembly.arrangement": "random", "assembly.fibre_volume_fraction": 0.6, "assembly.count": 20},
        {"assembly.arrangement": "elliptic", "assembly.aspect": 3, "assembly.count": 130},
        {"assembly.arrangement": "hexagonal", "assembly.count": 40},
        {"assembly.first_angle": "-30 deg"},
        {"assembly.twist": "0.55 turn/cm", "assembly.twist_direction": "S", "assembly.twist_state": "tensioned"},
        {"assembly.migration": {"period": "0.2 mm", "minimum_radius": 0.2, "epsilon": 0.1, "beta": 0.5}},
        {"ends.support": "clamped", "ends.tension": "0 N"},
        {"platens.shape": "crimped", "platens.crimp_angle": "4.4 deg", "platens.curvature": "concave"},
        {"platens.width": "full", "platens.bottom_width": "0.2 mm"},
        {"platens.stop": {"thickness": "30 um"}, "platens.hold": "20 us", "platens.unload": True},
        {"platens.stop": {"force": "1 mN"}, "platens.speed": "0.05 m/s"},
        {"platens.stop": {"pressure": "5 MPa"}},
        {"model.level": "section", "model.depth": "1 mm", "model.spring": "thesis"},
        {"model.level": "rod", "model.spacing": "3.5 um", "model.axial_softening": 10, "model.timestep": "1e-4 us"},
        {"model.level": "chain", "model.far_field": "condensed"},
        {"assembly.twist": "2 turn/cm", "model.level": "chain", "model.torsion": "dihedral"},
        FILE,
        FILE | {"assembly.count": 3, "assembly.centres": "# found\nz (mm);y (mm)\n0,1;0,2\n0,3;0,4\n0,1;0,3\n"},
        {"contact.softening": 10, "contact.law": "hertz", "model.speed_check": True, "output.dump": True},
    ],
)
def test_good_scenes_survive_a_round_trip_through_toml(changes):
    first = scene_from_dict(changed(changes))
    text = first.to_toml()
    second = scene_from_dict(tomllib.loads(text))
    assert second == first and second.to_toml() == text and hash(second) == hash(first)


lengths = st.floats(min_value=30.0, max_value=1e6)


@settings(deadline=None)  # the machine may be shared, the first unit loads pint
@given(
    lengths,
    st.floats(min_value=0.0, max_value=1e8),
    st.floats(min_value=-6.28, max_value=6.28),
    st.floats(min_value=0.0932, max_value=0.95),
    st.floats(min_value=1e-9, max_value=1e-5),
)
def test_resolved_scenes_keep_every_bit(length, tension, angle, void, twist):
    first = scene_from_dict(
        changed(
            {
                "assembly.length": f"{length!r} um",
                "assembly.first_angle": f"{angle!r} rad",
                "assembly.void_fraction": void,
                "ends.tension": f"{tension!r} nN",
                "platens.width": "full",
                "platens.stop": {"force": "1 mN"},
            }
        )
    )
    assert (first.assembly.length, first.ends.tension, first.assembly.first_angle) == (length, tension, angle)
    assert scene_from_dict(tomllib.loads(first.to_toml())) == first
    try:
        twisted = scene_from_dict(changed({"assembly.twist": f"{twist!r} turn/um"}))
    except InputError as error:
        assert error.key == "assembly.twist"
    else:
        assert twisted.assembly.twist == twist


def test_the_written_scene_is_for_people():
    text = scene_from_dict(BASE).to_toml()
    for line in ('tension = "0.04 cN"', 'E1 = "230 GPa"', 'diameter = "7 um"', 'line_load = "1 N/mm"'):
        assert line in text
    assert "pitch" not in text  # not given: not written


def test_a_scene_is_frozen():
    s = scene_from_dict(BASE)
    with pytest.raises(Exception, match="frozen"):
        s.assembly.count = 19


# --- shipped scenes --------------------------------------------------------------------------------------------------


def test_all_scenes_ship_in_natural_order():
    names = shipped_scenes()
    assert set(names) == {*SHIPPED, *WEAVES, "capstan-column"}
    assert names.index("capstan-column") == 0 and names.index("carbon-2") == 1 and names[-1] == "nylon-weave-filaments"
    assert names.index("carbon-19") < names.index("carbon-37") < names.index("carbon-127")


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_scenes_load_and_say_what_they_are(name):
    s = load_scene(name)
    assert s.name == name and 10 < len(s.description) < 120 and "\n" not in s.description
    assert s.filament.diameter == 7.0 and s.assembly.void_fraction == 0.31 and s.ends.tension == 4e5
    assert (s.platens.width, s.platens.friction, s.contact.friction) == (500.0, 0.3, 0.2)
    assert s.platens.unload == (
        name
        not in ("carbon-127-twisted", "carbon-37-full-length", "carbon-12k-section", "carbon-12k-3d", "carbon-12k-tow")
    )  # the costly ones
    assert 0.0 < s.assembly.jitter <= 0.1
    assert scene_from_dict(tomllib.loads(s.to_toml())) == s
    assert scene_text(name).startswith("# ") and max(map(len, scene_text(name).splitlines())) <= 120
    assert s.model.level == {"section": "section", "tow": "subbundle"}.get(name.rpartition("-")[2], "auto")
    count = {"12k": 11719}.get(name.split("-")[1]) or int(name.split("-")[1])
    assert s.assembly.count == count
    length = {name: 345_000.0 for name in ("carbon-37-full-length", "carbon-547-section", "carbon-12k-section")}
    length["carbon-12k-3d"] = 1100.0
    assert s.assembly.length == length.get(name, 700.0)


def test_shipped_scenes_are_pressed_to_about_half_their_height():
    for name in SHIPPED:
        s = load_scene(name)
        # a single contact; a stop by force; a locked column; filaments that slide under the anvil's edges
        shallow = ("carbon-2", "carbon-37-full-length", "carbon-37-column", "carbon-127", "carbon-127-twisted")
        if name not in (*shallow, "carbon-12k-3d", "carbon-12k-section", "carbon-12k-tow"):
            assert 0.45 < s.platens.stop.value / module._height(s) < 0.6, name


def test_the_twisted_scene_turns_visibly_and_the_column_scene_stands():
    twisted = load_scene("carbon-127-twisted").assembly
    assert twisted.twist * twisted.length == pytest.approx(0.25, abs=0.01)
    assert load_scene("carbon-37-column").assembly.first_angle == pytest.approx(1.5707963267948966)


@pytest.mark.parametrize("degrees, count", [(0, 37), (90, 37), (13, 19), (0, 127), (0, 1)])
def test_the_height_of_rings_is_that_of_their_filaments(degrees, count):
    s = scene_from_dict(
        changed(
            {
                "assembly.count": count,
                "assembly.first_angle": f"{degrees} deg",
                "platens.stop": {"force": "1 mN"},
            }
        )
    )
    p, top, placed, ring = module._pitch(s), 0.0, 1, 0
    while placed < count:
        ring += 1
        angles = [math.radians(degrees) + k * math.pi / (3 * ring) for k in range(6 * ring)]
        top = max(top, *(ring * p * math.sin(a) for a in angles))
        placed += 6 * ring
    assert module._height(s) == pytest.approx(2 * top + 7.0, rel=1e-12)
    assert p == pytest.approx(8.028, abs=4e-3)  # thesis 6.4, which rounds: 31 % is 8.025, 8.028 is 31.05 %


# --- overrides and sources -------------------------------------------------------------------------------------------


def test_overrides_take_toml_or_bare_text():
    s = load_scene(
        "carbon-37",
        [
            "filament.diameter=9 um",
            'platens.stop.displacement="25 um"',
            "assembly.count = 19",
            "platens.unload=false",
            "contact.friction=0.3",
            "name=mine",
            "model.level=rod",
        ],
    )
    assert (s.filament.diameter, s.platens.stop.displacement, s.assembly.count) == (9.0, 25.0, 19)
    assert (s.platens.unload, s.contact.friction, s.name, s.model.level) == (False, 0.3, "mine", "rod")


def test_the_last_of_two_overrides_counts():
    assert load_scene("carbon-37", ["assembly.seed=1", "assembly.seed=5"]).assembly.seed == 5


def test_an_override_takes_the_place_of_its_alternatives():
    stop = load_scene("carbon-37", ["platens.stop.pressure=5 MPa"]).platens.stop
    assert (stop.kind, stop.value) == ("pressure", 5e3)
    stop = load_scene("carbon-37", ['platens.stop={force = "1 mN"}']).platens.stop
    assert (stop.kind, stop.value) == ("force", 1e6)
    bundle = load_scene("carbon-37", ["assembly.pitch=9 um"]).assembly
    assert (bundle.pitch, bundle.void_fraction) == (9.0, None)
    bundle = load_scene("carbon-37", ["assembly.arrangement=random", "assembly.fibre_volume_fraction=0.6"]).assembly
    assert (bundle.fibre_volume_fraction, bundle.void_fraction) == (0.6, None)
    with pytest.raises(InputError, match=r"platens.stop.*exactly one"):
        load_scene("carbon-37", ["platens.stop.pressure=5 MPa", "platens.stop.force=1 mN"])


def test_another_material_replaces_the_constants_of_a_resolved_scene(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(load_scene("carbon-37").to_toml(), encoding="utf-8")
    filament = load_scene(path, ["filament.material=E-glass", "filament.diameter=7 um"]).filament
    assert (filament.E1, filament.diameter) == (MATERIALS["E-glass"].E1, 7.0)


def test_a_file_is_read_and_named_after_itself(tmp_path):
    path = tmp_path / "my-tow.toml"
    text = scene_from_dict(BASE).to_toml()
    path.write_bytes(b"\xef\xbb\xbf" + text.replace("\n", "\r\n").replace('name = ""', "").encode())  # from Windows
    assert load_scene(path).name == "my-tow"
    assert load_scene(str(path)).assembly == scene_from_dict(BASE).assembly


def test_centres_come_from_a_file_beside_the_scene(tmp_path, monkeypatch):
    folder = tmp_path / "elsewhere"
    folder.mkdir()
    (folder / "found.csv").write_text(CENTRES)
    data = changed(FILE | {"assembly.centres": "found.csv"})
    (folder / "mine.toml").write_text(tomli_w.dumps(data))
    scene = load_scene(folder / "mine.toml")
    assert scene.assembly.centres == ((0.1, 0.2), (7.5, 0.0), (-3.0, 7.25)) and scene.assembly.count == 3
    # resolved, it needs no file
    (folder / "found.csv").unlink()
    (tmp_path / "resolved.toml").write_text(scene.to_toml())
    assert load_scene(tmp_path / "resolved.toml").assembly == scene.assembly
    with pytest.raises(InputError, match="no such file") as info:
        load_scene(folder / "mine.toml")
    assert info.value.key == "assembly.centres"
    # an override names a file from where one stands, and takes the place of count and pitch
    monkeypatch.chdir(tmp_path)
    (tmp_path / "here.csv").write_text(CENTRES)
    over = ["assembly.arrangement=file", "assembly.centres=here.csv", "platens.stop.displacement=5 um"]
    assert load_scene("carbon-37", over).assembly.centres == scene.assembly.centres


def test_a_shipped_name_wins_over_a_folder_of_results(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "carbon-37").mkdir()
    assert load_scene("carbon-37").assembly.count == 37


# --- what is refused -------------------------------------------------------------------------------------------------

TWIST = {"assembly.twist": "2 turn/cm"}
SECTION = {"model.level": "section"}
CRIMPED = {"platens.shape": "crimped", "platens.crimp_angle": "4.4 deg"}

BAD = [
    # tables and keys
    ({"filament": ABSENT}, "filament", "(not given): expected a table [filament]"),
    ({"assembly": ABSENT}, "assembly", "expected a table [assembly]"),
    ({"platens": ABSENT}, "platens", "expected a table [platens]"),
    ({"filament": 3}, "filament", "a table [filament]"),
    ({"assembly": "bundle"}, "assembly", "a table [assembly]"),
    ({"contact": [1, 2]}, "contact", "a table [contact]"),
    ({"assembly.migration": 3}, "assembly.migration", "a table [assembly.migration]"),
    ({"platen": {}}, "platen", "did you mean platens?"),
    ({"count": 37}, "count", "did you mean assembly.count?"),
    ({"assembly.cuont": 37}, "assembly.cuont", "did you mean assembly.count?"),
    ({"platens.tension": "1 cN"}, "platens.tension", "did you mean ends.tension or cell.tension?"),
    ({"platens.stop.presure": "1 MPa"}, "platens.stop.presure", "did you mean platens.stop.pressure?"),
    ({"filament": OWN | {"diametre": "7 um"}}, "filament.diametre", "did you mean filament.diameter?"),
    ({"zzz": 1}, "zzz", "a known key"),
    ({"a\nb": 1}, r"'a\nb'", "a known key"),
    ({"name": 37}, "name", "text in quotes"),
    # filament
    ({"filament": {}}, "filament.diameter", "filament.material = 'T700 carbon'"),
    ({"filament": {k: v for k, v in OWN.items() if k != "nu23"}}, "filament.nu23", "(not given)"),
    ({"filament": {k: v for k, v in OWN.items() if k != "E2"}}, "filament.E2", "(not given): expected a stress"),
    ({"filament": OWN | {"E2": 10}}, "filament.E2", "a bare number has no unit"),
    ({"filament.material": "T700 carbn"}, "filament.material", "did you mean 'T700 carbon'?"),
    ({"filament.material": 700}, "filament.material", "one of 'T700 carbon'"),
    ({"filament.diameter": 7}, "filament.diameter", "a bare number has no unit"),
    ({"filament.diameter": "7 kg"}, "filament.diameter", "'kg' does not measure a length"),
    ({"filament.diameter": "7 microns per"}, "filament.diameter", "not a known unit"),
    ({"filament.diameter": "-7 um"}, "filament.diameter", "at least 0.01 um"),
    ({"filament.diameter": "7 m"}, "filament.diameter", "at most 10 mm"),
    ({"filament.diameter": "nan um"}, "filament.diameter", "a length such as '7 um'"),
    ({"filament.diameter": {"value": 7}}, "filament.diameter", "a length such as '7 um'"),
    ({"filament.E1": "0 GPa"}, "filament.E1", "at least 1 kPa"),
    ({"filament.nu12": 0.7}, "filament.nu12", "at most 0.5"),
    ({"filament.nu12": "0.3"}, "filament.nu12", "a number, at least 0 and at most 0.5"),
    ({"filament.nu12": True}, "filament.nu12", "a number"),
    ({"filament.density": "1800"}, "filament.density", "a density such as '1800 kg/m**3'"),
    ({"filament.density": "1800 g/cm3"}, "filament.density", "at most"),
    # assembly
    ({"assembly.kind": "weave"}, "assembly.count", "a known key"),
    ({"assembly.kind": "braid"}, "assembly.kind", "expected 'bundle'"),
    ({"assembly.count": ABSENT}, "assembly.count", "(not given): expected a whole number"),
    ({"assembly.count": 0}, "assembly.count", "at least 1"),
    ({"assembly.count": 37.0}, "assembly.count", "a whole number"),
    ({"assembly.count": 40}, "assembly.count", "37 or 61"),
    ({"assembly.count": 12000}, "assembly.count", "11719 or 12097"),
    ({"assembly.arrangement": "square"}, "assembly.arrangement", "'circular', 'hexagonal'"),
    ({"assembly.pitch": "6.9 um"}, "assembly.pitch", "at least the diameter, 7 um"),
    ({"assembly.pitch": "8 um", "assembly.void_fraction": 0.3}, "assembly.pitch", "not both"),
    ({"assembly.void_fraction": 0.05}, "assembly.void_fraction", "at least 0.0931"),
    ({"assembly.void_fraction": "31 %"}, "assembly.void_fraction", "a number"),
    ({"assembly.fibre_volume_fraction": 0.6}, "assembly.fibre_volume_fraction", "pitch or void_fraction"),
    ({"assembly.arrangement": "random"}, "assembly.fibre_volume_fraction", "(not given)"),
    (
        {"assembly.arrangement": "random", "assembly.fibre_volume_fraction": 0.9},
        "assembly.fibre_volume_fraction",
        "at most 0.8",
    ),
    (
        {"assembly.arrangement": "random", "assembly.fibre_volume_fraction": 0.6, "assembly.pitch": "8 um"},
        "assembly.pitch",
        "random packing takes fibre_volume_fraction",
    ),
    ({"assembly.aspect": 2.0}, "assembly.aspect", "this one is circular"),
    ({"assembly.arrangement": "racetrack", "assembly.aspect": 0}, "assembly.aspect", "at least 0.001"),
    ({"assembly.arrangement": "hexagonal", "assembly.first_angle": "90 deg"}, "assembly.first_angle", "hexagonal"),
    ({"assembly.first_angle": 90}, "assembly.first_angle", "an angle such as '90 deg'"),
    ({"assembly.length": "20 um", "platens.width": "full"}, "assembly.length", "more than four diameters, 28 um"),
    ({"assembly.twist": "0.26 1/cm"}, "assembly.twist", "0.26 turn/cm"),
    ({"assembly.twist": "-1 turn/cm"}, "assembly.twist", "at least 0"),
    ({"assembly.twist": "100 turn/cm"}, "assembly.twist", "overlap as built"),
    (TWIST | {"assembly.twist_direction": "z"}, "assembly.twist_direction", "'Z' or 'S'"),
    ({"assembly.migration": {}}, "assembly.migration.period", "(not given): expected a length"),
    ({"assembly.migration": {"period": "5 um"}}, "assembly.migration.period", "four diameters"),
    ({"assembly.migration": {"period": "1 mm", "epsilon": 0.7}}, "assembly.migration.epsilon", "at most 0.5"),
    ({"assembly.jitter": "1 um"}, "assembly.jitter", "at most 0.5126 um"),
    ({"assembly.seed": -1}, "assembly.seed", "at least 0"),
    # ends
    ({"ends.support": "simply supported"}, "ends.support", "'simply-supported'"),
    ({"ends.tension": "4 g"}, "ends.tension", "does not measure a force"),
    ({"ends.tension": "-1 cN"}, "ends.tension", "at least 0"),
    ({"ends.tension": "4 N"}, "ends.tension", "a strain of 5 %"),
    # platens
    ({"platens.stop": ABSENT}, "platens.stop", "a table [platens.stop]"),
    ({"platens.stop": {}}, "platens.stop", "exactly one of displacement, thickness, pressure, force or line_force"),
    ({"platens.stop.force": "1 mN"}, "platens.stop", "{displacement, force}: expected exactly one"),
    ({"platens.stop.displacement": "50 um"}, "platens.stop.displacement", "at most 47.42 um"),
    ({"platens.stop": {"thickness": "5 um"}}, "platens.stop.thickness", "from 7 um"),
    ({"platens.stop": {"thickness": "60 um"}}, "platens.stop.thickness", "below the 54.42 um built"),
    ({"platens.stop": {"pressure": "5 N"}}, "platens.stop.pressure", "does not measure a stress"),
    ({"platens.width": "0.7 mm"}, "platens.width", "below assembly.length"),
    ({"platens.width": "ful"}, "platens.width", "'full' or a length"),
    ({"platens.bottom_width": "1 mm"}, "platens.bottom_width", "'full' or a length"),
    ({"platens.shape": "crimped"}, "platens.crimp_angle", "(not given): expected an angle"),
    (CRIMPED | {"platens.crimp_angle": "45 deg"}, "platens.crimp_angle", "below 45 deg"),
    (CRIMPED | {"platens.width": "full"}, "platens.width", "the arc of a crimped platen"),
    (CRIMPED | {"platens.bottom_width": "full"}, "platens.bottom_width", "crimp_side = 'top'"),
    ({"platens.crimp_angle": "4.4 deg"}, "platens.crimp_angle", "shape = 'flat'"),
    ({"platens.curvature": "concave"}, "platens.curvature", "shape = 'flat'"),
    ({"platens.friction": 2.5}, "platens.friction", "at most 2"),
    ({"platens.speed": "0 m/s"}, "platens.speed", "above 0"),
    ({"platens.speed": "fast"}, "platens.speed", "'auto' or a speed"),
    ({"platens.hold": "-1 us"}, "platens.hold", "a time such as"),
    ({"platens.unload": 1}, "platens.unload", "true or false"),
    ({"platens.unload": "yes"}, "platens.unload", "true or false"),
    # contact
    ({"contact.law": "hook"}, "contact.law", "'auto', 'hooke', 'hertz', 'line', 'linear', 'exponential' or 'table'"),
    ({"contact.law": "hertz", "contact.shape": "capsule"}, "contact.law", "hertz is for beads"),
    ({"contact.kinetic_friction": 0.3}, "contact.kinetic_friction", "at most contact.friction, 0.2"),
    ({"contact.kinetic_friction": 0.1, "contact.shape": "beads"}, "contact.kinetic_friction", "contact.shape"),
    ({"contact.friction_by_angle": [["0 deg", 0.4]]}, "contact.friction_by_angle", "rows of a rising angle"),
    ({"contact.friction_by_angle": [["0 deg", 0.4], [90, 0.2]]}, "contact.friction_by_angle", "rows of a rising angle"),
    (
        {"contact.friction_by_angle": [["50 deg", 0.4], ["20 deg", 0.2]]},
        "contact.friction_by_angle",
        "between 0 and 90 deg",
    ),
    ({"contact.law": "line", "contact.shape": "beads"}, "contact.law", "the line law is for capsules"),
    ({"contact.shape": "capsule", "model.level": "section"}, "contact.shape", "it is made of discs"),
    ({"contact.line_load": "1 N"}, "contact.line_load", "a force per length such as '1 N/mm'"),
    ({"contact.softening": 0.5}, "contact.softening", "'auto' or a number, at least 1"),
    ({"contact.damping_ratio": 0}, "contact.damping_ratio", "above 0 and at most 1"),
    ({"contact.friction": float("nan")}, "contact.friction", "a number"),
    # model
    ({"model.level": "beam"}, "model.level", "'auto', 'chain', 'rod', 'section' or 'subbundle'"),
    ({"model.level": 3}, "model.level", "'auto', 'chain'"),
    (
        {"model.spacing": "10 um", "contact.shape": "beads"},
        "model.spacing",
        "beads further apart miss each other",
    ),
    ({"model.spacing": "0.1 um"}, "model.spacing", "from 0.35 um"),
    ({"model.accuracy": 0.9}, "model.accuracy", "at most 0.5"),
    ({"model.axial_softening": 0.1}, "model.axial_softening", "at least 1"),
    ({"model.torsion": "dihedral", "model.level": "chain"}, "model.torsion", "use level = 'rod'"),
    (TWIST | {"model.torsion": "dihedral", "model.level": "rod"}, "model.torsion", "belong to level = 'chain'"),
    ({"model.far_field": "graded", "platens.width": "full"}, "model.far_field", "nothing beyond the platen"),
    ({"model.far_field": "condensed", "model.level": "rod"}, "model.far_field", "belongs to level = 'chain'"),
    ({"model.far_field": "condensed", "ends.support": "symmetry"}, "model.far_field", "holds none"),
    (TWIST | {"model.far_field": "condensed"}, "model.far_field", "a straight filament"),
    ({"model.depth": "1 mm"}, "model.depth", "belongs to level = 'section'"),
    ({"model.spring": "thesis", "model.level": "rod"}, "model.spring", "belongs to level = 'section'"),
    ({"model.timestep": "0.001"}, "model.timestep", "'auto' or a time"),
    # things along the length have no meaning in a section
    (SECTION | TWIST, "assembly.twist", "no length along the filaments"),
    (SECTION | {"assembly.migration": {"period": "1 mm"}}, "assembly.migration", "no length along"),
    (CRIMPED | {"platens.crimp_width": "50 um"}, "platens.crimp_width", "with level = 'section'"),
    ({"platens.crimp_width": "50 um"}, "platens.crimp_width", "shape = 'flat'"),
    (SECTION | {"model.spacing": "7 um"}, "model.spacing", "a section has no filament length"),
    (SECTION | {"model.torsion": "dihedral"}, "model.torsion", "a section has no filament length"),
    (SECTION | {"model.far_field": "graded"}, "model.far_field", "no length along the filaments"),
    (SECTION | {"ends.support": "clamped"}, "ends.support", "simply-supported"),
    (SECTION | {"contact.law": "hertz"}, "contact.law", "touch along lines"),
    # centres from a file
    (FILE | {"assembly.centres": ABSENT}, "assembly.centres", "columns y and z"),
    (FILE | {"assembly.centres": "y,z\n1,2\n3,4\n"}, "assembly.centres", "unit"),
    (FILE | {"assembly.centres": "y_um,x_um\n1,2\n3,4\n"}, "assembly.centres", "columns y and z"),
    (FILE | {"assembly.centres": "y_um,z_um\n1,2\n3,nan\n"}, "assembly.centres", "finite"),
    (FILE | {"assembly.centres": 3}, "assembly.centres", "columns y and z"),
    (FILE | {"assembly.count": 4}, "assembly.count", "3, the number of centres"),
    (FILE | {"assembly.void_fraction": 0.3}, "assembly.void_fraction", "no such key"),
    (FILE | {"assembly.pitch": "9 um"}, "assembly.pitch", "no such key"),
    (FILE | {"assembly.aspect": 2}, "assembly.aspect", "no such key"),
    (FILE | {"assembly.first_angle": "3 deg"}, "assembly.first_angle", "no such key"),
    (FILE | {"assembly.jitter": "1 um"}, "assembly.jitter", "overlap"),
    (FILE | {"platens.stop": {"thickness": "90 um"}}, "platens.stop.thickness", "from 7 um"),
    ({"assembly.centres": CENTRES}, "assembly.centres", "arrangement = 'file'"),
    # output
    ({"output.frames": 1}, "output.frames", "at least 2 and at most 5000"),
    ({"output.samples": "300"}, "output.samples", "a whole number"),
    ({"output.dump": "false"}, "output.dump", "true or false"),
]


def assert_refused(error, key, part):
    text = str(error)
    assert error.exit_code == 2 and error.key == key and text.startswith(f"{key} = ")
    assert part in text
    assert "\n" not in text and len(text) < 300
    for jargon in ("pydantic", "http", "Input should", "validation", "Field required", "Literal"):
        assert jargon not in text


@pytest.mark.parametrize("changes, key, part", BAD)
def test_a_bad_scene_gives_one_line_that_names_the_key(changes, key, part):
    with pytest.raises(InputError) as info:
        scene_from_dict(changed(changes))
    assert_refused(info.value, key, part)


BAD_TEXT = [
    ("[filament]\ndiameter = 7 um\n", "line 2: 'diameter = 7 um'"),
    ("[filament\n", "line 1"),
    ("a = 1\na = 2\n", "cannot overwrite"),
    ('a = """\n', "valid TOML"),
]


@pytest.mark.parametrize("text, part", BAD_TEXT)
def test_bad_toml_names_the_file_and_the_line(tmp_path, text, part):
    path = tmp_path / "bad.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as info:
        load_scene(path)
    assert info.value.key == "scene" and info.value.value == str(path)
    assert part in info.value.expected and "\n" not in str(info.value)


def test_what_is_no_file_is_refused(tmp_path):
    binary = tmp_path / "binary.toml"
    binary.write_bytes(b"\xff\xfe\x00")
    for source, part in [
        (tmp_path / "none.toml", "no such file"),
        (tmp_path, "a TOML file that can be read"),
        (binary, "not a text file"),
        ("carbon-38", "did you mean carbon-37"),
        ("no-such-thing", "cgfibre scenes lists them"),
        ("", "a TOML file or a shipped scene"),
        ("bad\0name", "a TOML file"),
    ]:
        with pytest.raises(InputError) as info:
            load_scene(source)
        assert_refused(info.value, "scene", part)
    with pytest.raises(InputError, match="did you mean carbon-37"):
        scene_text("carbon_37")


BAD_OVERRIDES = [
    ("filament.diameter", "--set", "table.key=value"),
    ("=3", "--set", "table.key=value"),
    ("a b=3", "--set", "table.key=value"),
    ("assembly..count=3", "--set", "table.key=value"),
    ("filament.diameter=9", "filament.diameter", "a bare number has no unit"),
    ("filament.diameter=", "filament.diameter", "a length"),
    ("assembly.count=thirty", "assembly.count", "a whole number"),
    ("assembly.cuont=7", "assembly.cuont", "did you mean assembly.count?"),
    ("assembly.length.x=3", "assembly.length.x", "assembly.length is not a table"),
    ("platens.stop=30 um", "platens.stop", "a table [platens.stop]"),
    ("assembly.count=7\nseed=3", "assembly.count", "a whole number"),
]


@pytest.mark.parametrize("text, key, part", BAD_OVERRIDES)
def test_a_bad_override_names_its_key(text, key, part):
    with pytest.raises(InputError) as info:
        load_scene("carbon-37", [text])
    assert_refused(info.value, key, part)


keys = st.sampled_from(sorted(scene_messages._all_keys(Scene)))
values = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.floats(),
    st.text(max_size=80),
    st.sampled_from(["7 um", "1 mN", "0.1 m/s", "auto", "full", "random", "section", "crimped", "4 deg", "1 MPa"]),
    st.lists(st.integers(), max_size=3),
    st.dictionaries(st.text(max_size=5), st.integers(), max_size=2),
)


@settings(deadline=None)  # the machine may be shared, the first unit loads pint
@given(st.dictionaries(keys, values, min_size=1, max_size=3))
def test_any_scene_is_good_or_refused_in_one_line(changes):
    try:
        made = scene_from_dict(changed_where_possible(changes))
    except InputError as error:
        assert "\n" not in str(error) and len(str(error)) < 400
        assert not error.key.startswith(".") and not error.key.endswith(".")
    else:
        assert scene_from_dict(tomllib.loads(made.to_toml())) == made


def changed_where_possible(changes):
    data = copy.deepcopy(BASE)
    for key, value in sorted(changes.items()):
        *parents, last = key.split(".")
        table = data
        for parent in parents:
            table = table.setdefault(parent, {}) if isinstance(table, dict) else None
        if isinstance(table, dict):
            table[last] = value
    return data
