"""Fabrics measured against closed forms on analytic plain weaves."""

from dataclasses import replace

import numpy as np
import pytest
from weave_systems import S, plain

from cgfibre.errors import InputError
from cgfibre.measure import fabric as fb
from cgfibre.measure import fabric_section as fs
from cgfibre.measure.crossing_forces import crossing_loads, touches
from cgfibre.measure.crossings import crossings_of, filament_crossings, through_each_other, tow_crossings
from cgfibre.measure.segments import minimum_axis_distance, segment_contacts
from cgfibre.mechanics.contact import crossing_prefactor
from cgfibre.record import Frames

SEVEN = ((0.0, 0.0), *((8 * np.cos(a), 8 * np.sin(a)) for a in np.arange(6) * np.pi / 3))


def frames_of(*states) -> Frames:
    return Frames(np.arange(len(states)), np.arange(len(states)) * 1.0, np.array(states))


def wrapped(system):
    """The system moved by a third of a cell, every bead put back into the box on its own."""
    size = system.box[:, 1] - system.box[:, 0]
    moved = system.positions + np.array([size[0] / 3, size[1] / 3, 0.0])
    moved[:, :2] = np.mod(moved[:, :2], size[:2])
    return replace(system, positions=moved)


# --- centre lines ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("periodic", [True, False])
@pytest.mark.parametrize("amplitude", [2.0, 10.0, 25.0])
def test_crimp_and_angles_of_a_cosine(periodic, amplitude):
    system = plain(2, amplitude, per_spacing=24, periodic=periodic)
    lines = fb.tow_lines(fb.fabric_of(system), system.positions)
    assert [line.axis for line in lines] == [0, 0, 1, 1]
    for line in lines:
        assert line.crimp() == pytest.approx(fb.bare_crimp(amplitude, S), rel=2e-4)
        assert line.angles() == pytest.approx([np.arctan(np.pi * amplitude / S)] * 2, rel=1e-3)
    # a shallow line: (pi A/s)^2/4
    assert fb.bare_crimp(1e-3 * S, S) == pytest.approx((np.pi * 1e-3) ** 2 / 4, rel=1e-5)


def test_a_tow_s_line_is_the_mean_of_its_filaments_across_the_boundary():
    single, many = plain(2, 10.0), plain(2, 10.0, diameter=5.0, offsets=SEVEN)
    moved = wrapped(many)
    for system in (many, moved):
        lines = fb.tow_lines(fb.fabric_of(system), system.positions)
        assert len(lines) == 4 and lines[0].filaments.shape[0] == 7
        for line in lines:
            assert line.crimp() == pytest.approx(fb.bare_crimp(10.0, S), rel=1e-3)
    ours = fb.tow_lines(fb.fabric_of(many), many.positions)[0].points
    bare = fb.tow_lines(fb.fabric_of(single), single.positions)[0].points
    assert np.allclose(ours, bare, atol=1e-9)


def test_passages_of_a_float_are_those_of_its_two_sides():
    """A twill's line: flat floats between passages of 20 degrees; the mean over the inflections is theirs."""
    u = np.linspace(0, 4 * S, 129)[:-1]
    slope = np.tan(np.radians(20))
    half = 0.5 * S * slope / np.pi * 2  # cosine passages S/1 long
    phase = np.clip(np.mod(u / S, 4), 0, 4)
    z = np.select(
        [phase < 1, phase < 2, phase < 3],
        [half * np.ones_like(u), half * np.cos(np.pi * (phase - 1)), -half * np.ones_like(u)],
        -half * np.cos(np.pi * (phase - 3)),
    )
    points = np.column_stack([np.append(u, 4 * S), np.zeros(129), np.append(z, z[0])])
    line = fb.TowLine(0, 0, True, points, points[None])
    largest, inflection = line.angles()
    assert inflection == pytest.approx(np.radians(20), rel=5e-3) and largest == pytest.approx(inflection, rel=5e-3)


def test_mass_and_volume_fraction():
    system = plain(2, 10.0, per_spacing=40)
    fabric = fb.fabric_of(system)
    length = 4 * 2 * S * (1 + fb.bare_crimp(10.0, S))
    assert fb.areal_density(fabric, system.positions) == pytest.approx(3.0 * length / (2 * S) ** 2, rel=1e-4)
    solid = np.pi * 100 * length / ((2 * S) ** 2 * 40)
    assert fb.volume_fraction(fabric, system.positions, 40.0) == pytest.approx(solid, rel=1e-4)
    half = fb.volume_fraction(fabric, system.positions, 40.0, fibre_area=50 * np.pi)
    assert half == pytest.approx(solid / 2, rel=1e-4)
    patch = plain(2, periodic=False)
    with pytest.raises(InputError, match="patch"):
        fb.areal_density(fb.fabric_of(patch), patch.positions)


def test_what_is_no_fabric_is_refused():
    system = plain(2)
    warp_alone = replace(system, tow=np.zeros(4, dtype=np.int64))
    with pytest.raises(InputError, match="same axis"):
        fb.fabric_of(warp_alone)
    with pytest.raises(InputError, match="without gaps"):
        fb.fabric_of(replace(system, tow=np.array([0, 1, 3, 4])))


# --- crossings -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("periodic", [True, False])
@pytest.mark.parametrize("per_spacing", [2, 7, 16])
def test_every_crossing_is_found_once_also_where_beads_coincide_in_plan(periodic, per_spacing):
    system = plain(4, 10.0, per_spacing=per_spacing, periodic=periodic)
    for state in (system, wrapped(system)) if periodic else (system,):
        fabric = fb.fabric_of(state)
        lines = fb.tow_lines(fabric, state.positions)
        found = tow_crossings(fabric, lines)
        assert len(found) == 16
        order = found.order(8, 8)[:4, 4:]
        assert np.array_equal(order * order[0, 0], np.fromfunction(lambda i, j: (-1.0) ** (i + j), (4, 4)))
        if per_spacing % 2 == 0 and per_spacing > 2:  # beads on the crests
            assert np.abs(found.gap) == pytest.approx(20.0, abs=1e-4)


def test_distance_of_lines_that_climb_is_below_their_gap():
    """Two straight filaments that cross at right angles in plan, one climbing by 45 degrees: gap cos 45 deg."""
    first = fb.Lines(np.array([[-10.0, 0, -10], [10, 0, 10]]), np.array([0, 2]), np.array([False]), np.array([0]))
    second = fb.Lines(np.array([[3.0, -9, -2], [3, 9, -2]]), np.array([0, 2]), np.array([False]), np.array([0]))
    found = crossings_of(first, second, np.zeros(3))
    assert found.gap[0] == pytest.approx(5.0, rel=1e-5) and found.turn[0] == 1
    assert found.distance[0] == pytest.approx(5.0 / np.sqrt(2), rel=1e-5)
    assert found.along[0] == pytest.approx([13 * np.sqrt(2), 9.0], rel=1e-5)


@pytest.mark.parametrize("periodic", [True, False])
def test_the_order_of_crossing_is_topological(periodic):
    """Filaments shoved about keep it, also where they slide over each other in plan; one pulled through breaks it."""
    rng = np.random.default_rng(1)
    system = plain(2, 10.0, diameter=5.0, per_spacing=16, periodic=periodic, offsets=SEVEN)
    fabric = fb.fabric_of(system)
    n = system.n_filaments
    before = filament_crossings(fabric, system.positions).order(n, n)
    assert np.count_nonzero(before) == 14 * 14
    shoved = system.positions.copy()
    bead = np.arange(system.n_beads)
    # a wave in the plane that makes filaments of one crossing pass sideways over each other
    shoved[:, 0] += 3 * np.sin(2 * np.pi * shoved[:, 1] / (2 * S)) + rng.normal(0, 0.3, len(bead))
    shoved[:, 1] += 3 * np.sin(2 * np.pi * system.positions[:, 0] / (2 * S)) + rng.normal(0, 0.3, len(bead))
    assert through_each_other(fabric, frames_of(system.positions, shoved)).ok
    # warp filament 0 bends down through the first weft tow alone
    through = system.positions.copy()
    own = slice(system.filament_start[0], system.filament_start[1])
    u = through[own, 0]
    through[own, 2] -= 60 * np.exp(-(((u - S / 2) / 15) ** 2)) * np.sign(through[own, 2][np.argmin(abs(u - S / 2))])
    guard = through_each_other(fabric, frames_of(system.positions, system.positions, through))
    assert not guard.ok and guard.value >= 7 and "displacement of 2 um" in guard.message
    after = filament_crossings(fabric, through).order(n, n)
    assert np.argwhere(after != before)[:, 0].tolist() == [0] * 7


def test_a_bay_adds_two_crossings_that_cancel():
    """A filament that folds back over another crosses it three times in plan; its order stays 1."""
    u = np.linspace(-50, 50, 41)
    fold = np.column_stack([u - 40 * np.sin(np.pi * np.clip(u / 20, -1, 1)), 0.2 * u, np.full(41, 5.0)])
    first = fb.Lines(fold, np.array([0, 41]), np.array([False]), np.array([0]))
    across = np.column_stack([np.full(11, 2.0), np.linspace(-60, 60, 11), np.zeros(11)])
    second = fb.Lines(across, np.array([0, 11]), np.array([False]), np.array([0]))
    found = crossings_of(first, second, np.zeros(3))
    assert len(found) == 3 and found.order(1, 1)[0, 0] == 1


def test_filaments_of_one_tow_that_change_places_by_passing_are_seen():
    system = plain(2, 10.0, diameter=5.0, per_spacing=16, offsets=((-4.0, 0.0), (4.0, 0.0)))
    fabric = fb.fabric_of(system)
    states = []
    for k in range(9):
        moved = system.positions.copy()
        # filament 1 winds once about filament 0 over its period: it must have passed through it
        own = slice(system.filament_start[1], system.filament_start[2])
        other = system.positions[system.filament_start[0] : system.filament_start[1]]
        if k == 8:
            angle = 2 * np.pi * moved[own, 0] / (2 * S)
            moved[own, 1], moved[own, 2] = other[:, 1] + 8 * np.cos(angle), other[:, 2] + 8 * np.sin(angle)
        states.append(moved)
    guard = through_each_other(fabric, frames_of(*states))
    assert not guard.ok and guard.value >= 1


# --- sections --------------------------------------------------------------------------------------------------------


def test_cut_ellipses_and_strips():
    system = plain(2, 20.0, diameter=20.0, per_spacing=32)
    fabric = fb.fabric_of(system)
    # half-way between wefts the warp climbs: the plane x = s cuts it under the angle of its slope
    cut = fs.cut_fabric(fabric, system.positions, 0, S + 1e-9)
    assert len(cut.ellipses) == 2 and not cut.bands
    slope = np.pi * 20 / S
    assert cut.ellipses.major / cut.ellipses.minor == pytest.approx([np.hypot(1, slope)] * 2, rel=5e-3)
    assert cut.ellipses.centres == pytest.approx(np.array([[S / 2, 0], [3 * S / 2, 0]]), abs=1e-6)
    # through the middle of a weft: its strip is as wide as the weft is thick and runs over the whole cell
    cut = fs.cut_fabric(fabric, system.positions, 0, S / 2)
    assert len(cut.bands) == 1 and cut.bands[0].half_width == pytest.approx(10.0)
    assert np.ptp(cut.bands[0].line[:, 0]) >= 2 * S - 1
    # 6 um beside its axis the strip is 8 um to either side; an image of the plane is the plane
    for at in (S / 2 + 6, S / 2 + 6 - 2 * S):
        cut = fs.cut_fabric(fabric, system.positions, 0, at)
        assert cut.bands[0].half_width == pytest.approx(8.0)
    moved = wrapped(system)
    cut = fs.cut_fabric(fb.fabric_of(moved), moved.positions, 0, S / 2 + 2 * S / 3)
    assert len(cut.bands) == 1 and len(cut.ellipses) == 2 and cut.bands[0].half_width == pytest.approx(10.0)
    # a window three cells wide holds three times as many
    wide = fs.cut_fabric(fabric, system.positions, 0, S, (-2 * S, 4 * S))
    assert len(wide.ellipses) == 6


@pytest.mark.parametrize("periodic", [True, False])
def test_width_and_thickness_of_tows(periodic):
    offsets = ((-8.0, 0.0), (0.0, 0.0), (8.0, 0.0), (0.0, 5.0), (0.0, -5.0))
    system = plain(2, 10.0, diameter=4.0, per_spacing=24, periodic=periodic, offsets=offsets)
    fabric = fb.fabric_of(system)
    lines = fb.tow_lines(fabric, system.positions)
    sections = fs.tow_sections(fabric, lines, tow_crossings(fabric, lines))
    assert sections.width == pytest.approx(20.0, abs=1e-6)
    assert sections.at_crossing.sum() == 8
    assert sections.thickness[sections.at_crossing] == pytest.approx(14.0, rel=1e-3)
    # between crossings the normal plane stands at the crimp angle: filaments 5 um up are 5 cos(angle) away
    cosine = np.cos(np.arctan(np.pi * 10 / S))
    assert sections.thickness[~sections.at_crossing] == pytest.approx(10 * cosine + 4, rel=2e-3)
    assert len(sections.tow) == (16 if periodic else 12)


def test_thickness_of_single_chains_is_their_diameter_less_what_they_give():
    system = plain(2, 9.0, diameter=20.0, per_spacing=32)  # 18 um between axes: 2 um of overlap
    fabric = fb.fabric_of(system)
    lines = fb.tow_lines(fabric, system.positions)
    sections = fs.tow_sections(fabric, lines, tow_crossings(fabric, lines), platens=(-18.5, 18.5))
    assert sections.width == pytest.approx(20.0)
    # half of 2 um to the other tow, 0.5 um to the platen
    assert sections.thickness[sections.at_crossing] == pytest.approx(18.5, abs=0.02)
    assert sections.thickness[~sections.at_crossing] == pytest.approx(20.0, rel=1e-6)


def test_room_between_fibres_of_a_square_array():
    """Parallel filaments at a pitch p: void 1 - pi D^2/(4 p^2), hydraulic radius (p^2 - pi D^2/4)/(pi D)."""
    pitch, d = 25.0, 20.0
    offsets = tuple(((k - 1.5) * pitch, (m - 1.5) * pitch) for k in range(4) for m in range(4))
    system = plain(1, 0.0, diameter=d, per_spacing=8, offsets=offsets)
    lifted = system.positions.copy()
    weft = np.repeat(system.tow, np.diff(system.filament_start)) == 1
    lifted[weft, 2] += 1000.0
    fabric = fb.fabric_of(system)
    image = fs.tow_image(fabric, lifted, (0, 30.0), np.array([[0, S], [-S / 2, S / 2]]), 0.25)
    assert set(np.unique(image)) == {-1, 0}
    room = fs.room_between(image, 0.25)
    assert room.fraction == pytest.approx(1 - np.pi * d**2 / (4 * pitch**2), rel=0.01)
    assert room.hydraulic_radius == pytest.approx((pitch**2 - np.pi * d**2 / 4) / (np.pi * d), rel=0.02)
    assert room.largest == pytest.approx(pitch / np.sqrt(2) - d / 2, abs=0.3)


def test_open_area_of_a_weave():
    system = plain(2, 10.0, diameter=20.0)
    for state in (system, wrapped(system)):
        opened = fs.open_area(fb.fabric_of(state), state.positions, 1.0)
        assert opened == pytest.approx((1 - 20 / S) ** 2, rel=0.02)


# --- forces at crossings ---------------------------------------------------------------------------------------------


def test_force_and_area_at_crossings_against_the_lens():
    """Crests that overlap by d: 4/3 k d w with w = sqrt(4 R d), area 2 pi R d (far apart: nearly straight there)."""
    depth, r, k = 0.02, 100.0, 3.0e4
    system = plain(2, r - depth / 2, diameter=2 * r, per_spacing=64, spacing=2e5)
    expected = 4 / 3 * k * depth * np.sqrt(4 * r * depth)
    for state in (system, wrapped(system)):
        fabric = fb.fabric_of(state)
        found = tow_crossings(fabric, fb.tow_lines(fabric, state.positions))
        touch = touches(fabric, state.positions, lambda overlap: k * overlap)
        loads = crossing_loads(fabric, found, touch)
        assert loads.through == pytest.approx(expected, rel=0.02)
        assert loads.normal == pytest.approx(loads.through, rel=1e-3)
        assert loads.area == pytest.approx(2 * np.pi * r * depth, rel=0.02)
        assert np.all(loads.warp_above == (found.gap > 0))
        # both sums agree with the contacts that the review counts
        total = segment_contacts(state, state.positions, lambda overlap: k * overlap).force.sum()
        assert loads.normal.sum() == pytest.approx(total, rel=1e-12)
        # what the upper tows take, the lower ones give: warp as a whole is pressed from neither side
        assert np.sum(np.where(loads.warp_above, 1, -1) * loads.through) == pytest.approx(0, abs=1e-6 * total)


def test_short_lenses_take_hertz_force():
    depth, r, modulus = 0.02, 100.0, 5e6
    system = plain(2, r - depth / 2, diameter=2 * r, per_spacing=64, spacing=2e5)
    fabric = fb.fabric_of(system)
    found = tow_crossings(fabric, fb.tow_lines(fabric, system.positions))
    touch = touches(fabric, system.positions, lambda overlap: 1e30 * overlap, modulus=modulus)
    loads = crossing_loads(fabric, found, touch)
    hertz = float(crossing_prefactor(modulus, r, r)) * depth**1.5
    assert loads.through == pytest.approx(hertz, rel=0.01)


def test_axis_distance_sees_periodic_images():
    system = plain(1, 0.0, diameter=20.0, offsets=((45.0, 0.0), (-45.0, 0.0)))
    lifted = system.positions.copy()
    lifted[np.repeat(system.tow, np.diff(system.filament_start)) == 1, 2] += 500
    assert minimum_axis_distance(system, lifted, 20.0) == pytest.approx(10.0)
