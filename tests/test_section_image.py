"""Filaments in rendered micrographs: found, placed, measured; and the way back into a run."""

import json
import os
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from rendered_sections import CASES, PLAIN, UM, Microscope, Specimen, bundle, draw, score

from cgfibre import micrograph
from cgfibre.build.bundle import jittered
from cgfibre.build.packing import hexagonal, min_distance
from cgfibre.errors import InputError
from cgfibre.measure import section_image
from cgfibre.scene_reading import load_scene
from cgfibre.workflow import RunOptions, measure_folder, plan_scene, run_scene


def specimen(seed, volume_fraction, microscope, **kwargs):
    return bundle(127, volume_fraction, microscope, np.random.default_rng(seed), **kwargs)


def found_in(s, diameter=None, polarity="auto"):
    d = section_image.find_filaments(s.picture, diameter, polarity)
    return d, score(s, d.filaments.centres, d.filaments.diameter)


# --- the bars: 98 % found, centres within 0.1 D, below 1 % false --------------------------------------------------


def check_bars(case, seed):
    volume_fraction, change, kwargs = CASES[case]
    m = replace(PLAIN, **change)
    detection, q = found_in(specimen(seed, volume_fraction, m, **kwargs), UM * m.pixels_per_um)
    assert q.found >= 0.98
    assert q.false < 0.01
    assert q.centre_error.max() < 0.1
    # measured 0.005 to 0.03: far better than asked
    assert np.sqrt(np.mean(q.centre_error**2)) < 0.035
    # blur closes the gaps between neighbours, so that diameters come out small
    assert -0.05 < q.diameter_error.mean() < 0.01
    assert q.diameter_error.std() < 0.025
    assert detection.polarity == ("dark" if m.dark else "bright")


@pytest.mark.parametrize("case", CASES)
def test_filaments_are_found(case):
    check_bars(case, list(CASES).index(case))


@pytest.mark.validate
@pytest.mark.parametrize("seed", range(10, 20))
@pytest.mark.parametrize("case", CASES)
def test_filaments_are_found_whatever_the_seed(case, seed):
    check_bars(case, seed)


@pytest.mark.parametrize("dark", [False, True])
def test_the_diameter_is_found_too(dark):
    m = replace(PLAIN, dark=dark)
    detection, q = found_in(specimen(1, 0.6, m))
    assert q.found >= 0.98 and q.false < 0.01 and q.centre_error.max() < 0.1
    assert detection.diameter / m.pixels_per_um == pytest.approx(UM, rel=0.04)


def test_centres_are_those_of_the_discs_without_noise():
    """One disc at a known place between pixels: what the edge fit leaves is below a tenth of a pixel."""
    m = Microscope(pixels_per_um=4.0, blur=1.0, noise=0.0, shade=1.0, scatter=0.0)
    c, d = np.array([[40.3, 37.8], [90.6, 80.2]]), np.array([28.0, 26.0])
    s = Specimen(draw(c, d, (120, 130), m, np.random.default_rng(0)), c, d)
    detection, q = found_in(s, 27.0, "bright")
    assert q.found == 1 and q.false == 0
    assert q.centre_error.max() * 28 < 0.1
    assert q.diameter_error * 27 == pytest.approx(-(1.0**2) / 14, abs=0.1)  # the blur's own sigma^2/r
    assert detection.area_fraction == pytest.approx(np.pi * (28**2 + 26**2) / 4 / (120 * 130), rel=0.02)


def test_empty_parts_stay_empty():
    """A small bundle in a wide empty picture: noise is not raised to filaments."""
    s = bundle(30, 0.6, PLAIN, np.random.default_rng(3), margin=12)
    _, q = found_in(s, UM * PLAIN.pixels_per_um)
    assert q.found == 1 and q.false == 0


def test_cut_filaments_are_marked():
    s = specimen(0, 0.6, PLAIN)
    view = s.picture[120:260, 110:270]
    detection = section_image.find_filaments(view, UM * PLAIN.pixels_per_um)
    f = detection.filaments
    r = f.diameter[:, None] / 2
    beyond = ((f.centres - r < -0.5) | (f.centres + r > np.array([160, 140]) - 0.5)).any(axis=1)
    assert np.array_equal(f.cut, beyond) and 5 < f.cut.sum() < len(f) - 5
    whole = Specimen(view, s.centres - [110, 120], s.diameters)
    inside = ((whole.centres >= 0) & (whole.centres <= [159, 139])).all(axis=1)
    q = score(Specimen(view, whole.centres[inside], s.diameters[inside]), f.centres, f.diameter)
    assert q.found > 0.95 and q.centre_error.max() < 0.1
    # the truth's own area fraction in this view
    y, x = np.mgrid[:140, :160]
    covered = np.zeros(view.shape, dtype=bool)
    for (cx, cy), d in zip(whole.centres, s.diameters, strict=True):
        covered |= (x - cx) ** 2 + (y - cy) ** 2 < d**2 / 4
    # slices of filaments whose middle is outside are not counted, and blur makes diameters small
    assert covered.mean() - 0.06 < detection.area_fraction < covered.mean()


def test_finding_is_the_same_twice():
    s = specimen(5, 0.65, PLAIN)
    one, two = (section_image.find_filaments(s.picture, 17.5).filaments for _ in range(2))
    assert np.array_equal(one.centres, two.centres) and np.array_equal(one.diameter, two.diameter)


@pytest.mark.validate
def test_twelve_thousand_filaments():
    """4000 x 4000 pixels in a minute or so (13 s measured on two busy cores) and about 1 GB."""
    rng = np.random.default_rng(0)
    d = 30.0
    c = jittered(hexagonal(12_000, 1.08 * d), 0.04 * d, d, rng) + 2000
    m = Microscope(pixels_per_um=d / UM, blur=1.2, noise=0.1)
    size = d * np.clip(1 + 0.03 * rng.standard_normal(len(c)), 0.9, 1.05)
    _, q = found_in(Specimen(draw(c, size, (4000, 4000), m, rng), c, size), d)
    assert q.found >= 0.98 and q.false < 0.01 and q.centre_error.max() < 0.1


# --- refusals ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("call", "key"),
    [
        (lambda: section_image.find_filaments(np.zeros((5, 50))), "picture"),
        (lambda: section_image.find_filaments(np.zeros((50, 50))), "picture"),
        (lambda: section_image.find_filaments(np.full((50, 50, 3), 1.0)), "picture"),
        (lambda: section_image.find_filaments(np.where(np.eye(50) > 0, np.nan, 1.0)), "picture"),
        (lambda: section_image.find_filaments(np.eye(50), diameter=3.0), "diameter"),
        (lambda: section_image.find_filaments(np.eye(50), diameter=40.0), "diameter"),
        (lambda: section_image.find_filaments(np.eye(50), polarity="grey"), "polarity"),
        (lambda: section_image.find_filaments(np.random.default_rng(0).normal(size=(200, 200)), 20.0), "picture"),
        (lambda: section_image.find_filaments(np.random.default_rng(0).normal(size=(200, 200))), "picture"),
        (lambda: section_image.find_scale_bar(np.random.default_rng(0).random((60, 60))), "--scale-bar"),
    ],
)
def test_bad_pictures_are_named(call, key):
    with pytest.raises(InputError) as caught:
        call()
    assert caught.value.key == key
    assert "\n" not in str(caught.value)


# --- scale -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("grey", [255, 0])
def test_scale_bar(grey):
    s = specimen(1, 0.6, PLAIN)
    picture = s.picture.astype(float)
    picture[-20:-14, 30:155] = grey
    picture[-24:-10, 30:32] = picture[-24:-10, 153:155] = grey  # ticks
    bar = section_image.find_scale_bar(picture)
    assert bar.length == 125
    finds = section_image.find_filaments(bar.without, 17.5).filaments
    q = score(s, finds.centres, finds.diameter)
    assert q.found >= 0.98 and q.false == 0
    picture[5:11, 200:320] = grey
    with pytest.raises(InputError, match="one bar"):
        section_image.find_scale_bar(picture)


# --- files -------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def photographed(tmp_path_factory):
    """A picture of 37 filaments, some of which overlap by what the picture's errors are."""
    folder = tmp_path_factory.mktemp("micrograph")
    s = bundle(37, 0.65, PLAIN, np.random.default_rng(2))
    Image.fromarray(s.picture).save(folder / "tow.png")
    return s, folder / "tow.png"


def options(out, **change):
    return replace(micrograph.MicrographOptions(out, pixels_per_um=2.5, diameter=7.0), **change)


def test_micrograph_to_run(photographed, tmp_path, monkeypatch):
    s, path = photographed
    found = micrograph.read_micrograph(path, options(tmp_path / "tow"))
    assert all((found.out / name).stat().st_size > 0 for name in micrograph.FILES)
    summary = json.loads((found.out / "summary.json").read_text())
    assert summary["n_filaments"] == 37 and summary["filaments_are"] == "bright"
    assert summary["fibre_volume_fraction_in_outline"] == pytest.approx(0.65, abs=0.08)
    # y to the right, z up, from the lower left corner
    truth = np.stack([s.centres[:, 0] + 0.5, s.picture.shape[0] - 0.5 - s.centres[:, 1]], axis=1) / 2.5
    far = np.linalg.norm(found.centres[:, None] - truth[None], axis=2)
    assert far.min(axis=1).max() < 0.1 * UM
    table = np.loadtxt(found.out / "centres.csv", delimiter=",", skiprows=1)
    assert table[:, :2] == pytest.approx(found.centres, rel=1e-8)

    # the scene that was written runs; the run's own scene needs no other file
    scene, plan = plan_scene(found.out / "scene.toml")
    assert scene.assembly.count == 37 and plan.level == "section"
    placed = next(c for c in plan.choices if c.what == "centres")
    assert f"{summary['to_start_a_run']['n_moved']} moved" in placed.reason
    monkeypatch.setattr("cgfibre.workflow.draw_all", lambda *a, **k: [])
    result = run_scene(
        found.out / "scene.toml",
        RunOptions(tmp_path / "run"),
        ["platens.stop.displacement=3 um", "platens.speed=2 m/s"],
    )
    start = _positions(result.out)
    assert min_distance(start) >= UM
    shift = start - (found.centres - found.centres.mean(axis=0))
    rms = np.sqrt(np.mean(np.sum(shift**2, axis=1)))
    assert rms == pytest.approx(summary["to_start_a_run"]["rms_shift_um"], rel=1e-3)
    assert rms < 0.03 * UM
    (found.out / "centres.csv").unlink()
    assert load_scene(result.out / "scene.toml").assembly.centres == scene.assembly.centres
    measure_folder(result.out)


def _positions(out):
    from cgfibre.store import read_results

    return read_results(out / "results.h5").system.positions[:, 1:]


def test_found_sections_run_at_every_level(photographed, tmp_path):
    _, path = photographed
    found = micrograph.read_micrograph(path, options(tmp_path / "tow"))
    for level in ("section", "chain", "rod"):
        _, plan = plan_scene(found.out / "scene.toml", [f"model.level={level}"])
        assert plan.n_filaments == 37
    _, plan = plan_scene(found.out / "scene.toml", ["model.level=rod", "assembly.twist=0.26 turn/cm"])
    assert plan.level == "rod"


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ({"pixels_per_um": None}, "--pixels-per-um, --scale-bar"),
        ({"scale_bar": "50 um"}, "--pixels-per-um, --scale-bar"),
        ({"pixels_per_um": -1.0}, "--pixels-per-um"),
        ({"pixels_per_um": None, "scale_bar": "50 N"}, "--scale-bar"),
        ({"pixels_per_um": None, "scale_bar": "50 um:many"}, "--scale-bar"),
        ({"pixels_per_um": None, "scale_bar": "50 um"}, "--scale-bar"),  # there is none
        ({"crop": (0, 0, 5000, 10)}, "--crop"),
        ({"diameter": 0.5}, "diameter"),
    ],
)
def test_bad_options_write_nothing(photographed, tmp_path, change, key):
    with pytest.raises(InputError) as caught:
        micrograph.read_micrograph(photographed[1], options(tmp_path / "out", **change))
    assert caught.value.key == key and "\n" not in str(caught.value)
    assert not (tmp_path / "out").exists()


def test_files_that_are_no_pictures(tmp_path):
    (tmp_path / "a.png").write_text("not a picture")
    (tmp_path / "empty.tif").write_bytes(b"")
    whole = tmp_path / "whole.png"
    Image.fromarray(np.random.default_rng(0).integers(0, 255, (200, 200), dtype=np.uint8)).save(whole)
    (tmp_path / "cut.png").write_bytes(whole.read_bytes()[:4000])
    for name in ("a.png", "empty.tif", "cut.png", "none.png", "."):
        with pytest.raises(InputError) as caught:
            micrograph.read_picture(tmp_path / name)
        assert caught.value.key == "IMAGE" and "\n" not in str(caught.value)


def test_sixteen_bit_and_colour_pictures_read_alike(photographed, tmp_path):
    s, path = photographed
    deep = (s.picture.astype(np.uint16) * 200).astype(np.uint16)
    Image.fromarray(deep).save(tmp_path / "deep.tif")
    Image.open(path).convert("RGBA").save(tmp_path / "colour.png")
    plain = micrograph.read_picture(path)
    assert np.array_equal(micrograph.read_picture(tmp_path / "deep.tif"), 200 * plain)
    assert np.abs(micrograph.read_picture(tmp_path / "colour.png") - plain).max() <= 1


def test_the_verb(cgfibre, photographed, tmp_path):
    done = cgfibre("section", photographed[1], "--scale-bar", "10 um:25", "--diameter", "7 um", "--out", tmp_path / "s")
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("37 bright filaments") and os.path.exists(tmp_path / "s" / "overlay.png")
    again = cgfibre("section", photographed[1], "--pixels-per-um", "2.5", "--out", tmp_path / "s")
    assert again.returncode == 2 and "--force" in again.stderr and len(again.stderr.splitlines()) == 1


def test_text_of_the_command_line(tmp_path):
    read = micrograph.options_from_text(tmp_path, 2.5, None, "7 um", "dark", "0, 1,200,100", True)
    assert read == micrograph.MicrographOptions(tmp_path, 2.5, None, 7.0, "dark", (0, 1, 200, 100), True)
    for crop, diameter, key in (("a,b", None, "--crop"), (None, "7", "--diameter")):
        with pytest.raises(InputError) as caught:
            micrograph.options_from_text(tmp_path, 2.5, None, diameter, "auto", crop, False)
        assert caught.value.key == key
