"""Fabrics measured in sheared cells: closed forms of a trellis, and the same fabric seen through another cell."""

from dataclasses import replace

import numpy as np
import pytest
from weave_systems import S, plain

from cgfibre import plot_weave
from cgfibre.build.system import FilamentSystem, whole_periods
from cgfibre.engine.dump import frame_boxes
from cgfibre.measure import fabric as fb
from cgfibre.measure import fabric_section as fs
from cgfibre.measure.crossing_forces import crossing_loads, touches
from cgfibre.measure.crossings import filament_crossings, through_each_other, tow_crossings
from cgfibre.measure.segments import minimum_axis_distance
from cgfibre.mechanics.trellis import area_factor, bearing_angle, locking_angle, turning_friction
from cgfibre.plan.model import Contact
from cgfibre.record import Frames
from cgfibre.review_fabric import fabric_statistics, planes_of, upright

PAIR = ((-8.0, 0.0), (8.0, 0.0))


def sheared(system: FilamentSystem, angle: float) -> FilamentSystem:
    """The weft turned by ``angle``, lengths along it kept, every bead moved with the cell."""
    corner, size = system.box[:2, 0], np.ptp(system.box[:2], axis=1)
    away = system.positions[:, :2] - corner
    moved = system.positions.copy()
    moved[:, 0] = corner[0] + away[:, 0] + away[:, 1] * np.sin(angle)
    moved[:, 1] = corner[1] + away[:, 1] * np.cos(angle)
    box = system.box.copy()
    box[1, 1] = box[1, 0] + size[1] * np.cos(angle)
    return replace(system, positions=moved, box=box, tilt=float(size[1] * np.sin(angle)))


def fabric_in(system: FilamentSystem, built: FilamentSystem) -> fb.Fabric:
    return replace(fb.fabric_of(built), system=system)


def statistics_of(built, *states):
    frames = frames_of(*states)
    faces = np.tile([-20.0, 20.0], (len(frames), 1))
    return {k: v for k, (v, _) in fabric_statistics(built, frames, faces, lambda d: 100.0 * d, None).items()}


def frames_of(*states):
    n = np.arange(len(states))
    boxes, tilts = np.array([s.box for s in states]), np.array([s.tilt for s in states])
    return Frames(n, n * 1.0, np.array([s.positions for s in states]), box=boxes, tilt=tilts)


def test_images_of_a_tilted_cell_are_its_nearest():
    """Against a search over images."""
    rng = np.random.default_rng(2)
    period, tilt = np.array([10.0, 6.0, 0.0]), 4.0
    away = rng.uniform(-40, 40, (400, 3)) * np.array([1.0, 1.0, 0.02])
    steps = np.array([(i, j) for i in range(-9, 10) for j in range(-9, 10)])
    images = away[:, None] + np.column_stack([steps @ [10.0, tilt], steps @ [0.0, 6.0], np.zeros(len(steps))])
    least = np.linalg.norm(images, axis=2).min(axis=1)
    near = least < 2.5  # half of the cell's least height: there the nearest is found for sure
    found = np.linalg.norm(away - whole_periods(away, period, tilt), axis=1)
    assert near.sum() > 50 and np.allclose(found[near], least[near])
    assert np.array_equal(whole_periods(away[:, :2], period[:2], tilt), whole_periods(away, period, tilt)[:, :2])


@pytest.mark.parametrize("offsets", [((0.0, 0.0),), PAIR])
def test_no_shear_and_a_whole_period_of_tilt_give_the_square_cell_s_numbers(offsets):
    """Tilted by one period along x the lattice is the same: all of the code of tilted cells, the same fabric."""
    built = plain(4, 9.5, diameter=20.0 if len(offsets) == 1 else 6.0, per_spacing=12, offsets=offsets)
    square, again = statistics_of(built, built), statistics_of(built, replace(built, tilt=0.0))
    period = float(np.ptp(built.box[0]))
    other = statistics_of(built, replace(built, tilt=period))
    assert square.keys() == other.keys()
    in_planes = [k for k in square if k.startswith(("void", "hydraulic", "largest"))]
    for name, values in square.items():
        assert np.array_equal(values, again[name]), name
        # planes that turn with the weft by 45 degrees are others: a tow is cut wider, the rest is the same
        if name == "open_area":  # pixels of another picture
            assert other[name] == pytest.approx(values, rel=0.06)
        elif name not in in_planes and name != "crossing_place":
            assert other[name] == pytest.approx(values, rel=1e-9, abs=1e-9), name
    n = built.n_filaments
    orders = [
        filament_crossings(fabric_in(s, built), s.positions).order(n, n) for s in (built, replace(built, tilt=period))
    ]
    assert np.array_equal(*orders)


@pytest.mark.parametrize("degrees", [20.0, -35.0, 50.0])
@pytest.mark.parametrize("periodic", [True, False])
def test_a_trellis_keeps_crimp_and_crossings_and_loses_area(degrees, periodic):
    angle = np.radians(degrees)
    built = plain(4, 10.0, diameter=6.0, per_spacing=16, periodic=periodic, offsets=PAIR)
    one = plain(4, 10.0, diameter=20.0, per_spacing=16, periodic=periodic)
    turned = sheared(built, angle)
    fabric = fabric_in(turned, built)
    lines = fb.tow_lines(fabric, turned.positions)
    assert [line.axis for line in lines] == [0] * 4 + [1] * 4
    for line in lines:
        assert line.crimp() == pytest.approx(fb.bare_crimp(10.0, S), rel=3e-4)
        assert line.angles()[1] == pytest.approx(np.arctan(np.pi * 10 / S), rel=2e-3)
    crossings = tow_crossings(fabric, lines)
    assert len(crossings) == 16
    assert np.array_equal(
        crossings.turn, tow_crossings(fb.fabric_of(built), fb.tow_lines(fb.fabric_of(built), built.positions)).turn
    )
    # the area: mass and fibres over it
    if periodic:
        square = fb.fabric_of(built)
        assert fabric.area() == pytest.approx(square.area() * area_factor(angle))
        density = fb.areal_density(fabric, turned.positions) / fb.areal_density(square, built.positions)
        fraction = fb.volume_fraction(fabric, turned.positions, 40.0) / fb.volume_fraction(
            square, built.positions, 40.0
        )
        assert [density, fraction] == pytest.approx([1 / np.cos(angle)] * 2, rel=1e-9)
    else:
        density = [statistics_of(built, s)["areal_density"][0] for s in (built, turned)]
        assert density[1] / density[0] == pytest.approx(1 / np.cos(angle), rel=1e-6)
    # filaments side by side come nearer: 16 um across become 16 cos
    sections = fs.tow_sections(fabric, lines, crossings)
    middle = sections.width[sections.at_crossing]
    assert middle == pytest.approx(16 * np.cos(angle) + 6, rel=2e-3)
    # what covers the plane: strips of 20 um, S cos apart
    state = sheared(one, angle)
    opened = fs.open_area(fabric_in(state, one), state.positions, 0.5)
    assert opened == pytest.approx((1 - 20 / (S * np.cos(angle))) ** 2, rel=0.04 if periodic else 0.06)


@pytest.mark.parametrize("periodic", [True, False])
def test_planes_turn_with_the_weft(periodic):
    """Through a weft: its strip as wide as the tow is thick; half-way: the warp alone, cut under shear and slope."""
    angle = np.radians(30.0)
    built = plain(4, 20.0, diameter=20.0, per_spacing=32, periodic=periodic)
    turned = sheared(built, angle)
    fabric = fabric_in(turned, built)
    through, between = planes_of(fabric, turned.positions)
    assert between - through == pytest.approx(S / 2 * np.cos(angle), rel=1e-9)
    cut = fs.cut_fabric(fabric, turned.positions, 0, through)
    assert len(cut.bands) == 1 and cut.bands[0].half_width == pytest.approx(10.0)
    low, high = cut.window
    assert high - low == pytest.approx(4 * S + (0 if periodic else 20.0), rel=1e-9)
    assert cut.bands[0].line[:, 0].min() <= low + 11 and cut.bands[0].line[:, 0].max() >= high - 11
    place = cut.ellipses.centres[np.argsort(cut.ellipses.centres[:, 0])]
    assert np.diff(place[:, 0]) == pytest.approx([S] * 3, rel=1e-9)  # lengths along the weft stay
    assert cut.ellipses.major == pytest.approx([10 / np.cos(angle)] * 4, rel=2e-3)  # at crests the warp is level
    other = fs.cut_fabric(fabric, turned.positions, 0, between + 1e-6)
    slope = np.pi * 20 / S
    assert len(other.ellipses) == 4 and not other.bands
    assert other.ellipses.major == pytest.approx([10 * np.hypot(1, slope) / np.cos(angle)] * 4, rel=5e-3)
    # the room of these two cuts: strip and ellipses, of a plane as high as the tows go
    faces, size = np.array([-30.0, 30.0]), 4 * S
    window = fs.plane_window(turned, turned.positions, 0, between)
    image = fs.tow_image(fabric, turned.positions, (0, between), np.array([window, faces]), 0.5)
    void = 1 - 4 * np.pi * 100 * np.hypot(1, slope) / np.cos(angle) / (size * 60)
    assert fs.room_between(image, 0.5).fraction == pytest.approx(void, rel=3e-3)
    # along the warp: planes y = const, whose image one cell on is moved by the tilt
    at = turned.box[1, 0] + (0.5 * S) * np.cos(angle) if periodic else 0.5 * S * np.cos(angle)
    y = turned.positions[turned.tow[turned.filament_of_bead] == 0, 1].mean()
    assert abs(at - y) < 11
    for plane in (y, y - np.ptp(turned.box[1])) if periodic else (y,):
        cut = fs.cut_fabric(fabric, turned.positions, 1, float(plane))
        assert len(cut.bands) == 1 and len(cut.ellipses) == 4
        assert cut.ellipses.major == pytest.approx([10 / np.cos(angle)] * 4, rel=2e-3)
    moved = cut.from_edge(0.0)
    assert moved.window == pytest.approx((0.0, cut.window[1] - cut.window[0]))
    assert moved.ellipses.centres[:, 0] == pytest.approx(cut.ellipses.centres[:, 0] - cut.window[0])


def test_crossings_at_an_angle_press_over_longer_lenses():
    """Two rods that cross under 90 - shear: lens and force over those at 90 degrees are 1/cos(shear)."""
    depth, r, k, angle = 0.02, 100.0, 3.0e4, np.radians(40.0)
    built = plain(2, r - depth / 2, diameter=2 * r, per_spacing=64, spacing=2e5)
    turned = sheared(built, angle)
    fabric = fabric_in(turned, built)
    found = tow_crossings(fabric, fb.tow_lines(fabric, turned.positions))
    loads = crossing_loads(fabric, found, touches(fabric, turned.positions, lambda overlap: k * overlap))
    expected = 4 / 3 * k * depth * np.sqrt(4 * r * depth) / np.cos(angle)
    assert loads.through == pytest.approx(expected, rel=0.02)
    assert loads.area == pytest.approx(2 * np.pi * r * depth / np.cos(angle), rel=0.02)
    assert minimum_axis_distance(turned, turned.positions, 2 * r) == pytest.approx(2 * r - depth, rel=1e-6)


def test_a_cell_put_upright_again_is_the_one_as_built():
    built = plain(2, 10.0, diameter=6.0, per_spacing=16, offsets=PAIR)
    states = [built, *(sheared(built, a) for a in (0.3, 0.6))]
    frames = frames_of(*states)
    assert upright(built, frames).positions == pytest.approx(np.array([built.positions] * 3))
    assert through_each_other(fb.fabric_of(built), upright(built, frames)).ok
    now = frames.system_at(built, 2)
    assert (
        now.tilt == pytest.approx(2 * S * np.sin(0.6)) and now.bond_lengths().max() < 1.2 * built.bond_lengths().max()
    )


def test_a_sheared_cell_is_drawn_as_it_lies():
    built = plain(2, 10.0, per_spacing=8)
    turned = sheared(built, np.radians(60.0))
    assert np.array_equal(plot_weave.along_x(turned), plot_weave.along_x(built))
    cells = plot_weave.repeated(turned)
    assert cells.n_filaments == 16 and np.array_equal(plot_weave.along_x(cells), np.tile(plot_weave.along_x(built), 4))
    # two cells each way, on a parallelogram
    assert np.ptp(cells.positions[:, 1]) == pytest.approx(4 * S * np.cos(np.radians(60)), rel=1e-9)
    assert np.ptp(cells.positions[:, 0]) == pytest.approx(S * (4 + 3 * np.sin(np.radians(60))), rel=1e-3)  # of the warp


def test_boxes_of_a_dump_are_those_of_its_corners(tmp_path):
    """The engine writes the bounds around a tilted box."""
    head = "ITEM: TIMESTEP\n{}\nITEM: NUMBER OF ATOMS\n0\nITEM: BOX BOUNDS {}\n{}ITEM: ATOMS id\n"
    square = head.format(0, "pp pp ff", "0 10\n1 6\n-1 1\n")
    tilted = head.format(5, "xy xz yz pp pp ff", "0 14 4\n1 6 0\n-1 1 0\n")
    back = head.format(7, "xy xz yz pp pp ff", "-3 10 -3\n1 6 0\n-1 1 0\n")
    (tmp_path / "t").write_text(square + tilted + back)
    boxes = frame_boxes(tmp_path / "t")
    for step, tilt in ((0, 0.0), (5, 4.0), (7, -3.0)):
        assert boxes[step][0].tolist() == [[0, 10], [1, 6], [-1, 1]] and boxes[step][1] == tilt


def test_angles_at_which_a_trellis_ends():
    """Tows of their own width apart; round ones against a search over two cosines."""
    assert locking_angle(1.0, 2.0) == pytest.approx(np.radians(60)) and locking_angle(2.0, 2.0) == 0.0
    h, p = 600.0, 5000.0
    predicted = bearing_angle(2 * h, (h, h), (p, p))
    assert np.degrees(predicted) == pytest.approx(45.7, abs=0.05)
    assert bearing_angle(2 * h, (h, h), (2000.0, 2000.0)) == 0.0
    u = np.linspace(-200.0, 200.0, 401)

    def clearance(angle):
        """Least distance of the two axes less their diameter, on places near a crossing."""
        xi, eta = np.meshgrid(u, u)
        away = np.hypot(xi - eta * np.sin(angle), eta * np.cos(angle))
        height = h * np.cos(np.pi * xi / p) + h * np.cos(np.pi * eta / p)
        return float(np.min(np.hypot(away, height)) - 2 * h)

    assert clearance(predicted - 0.03) > -1e-9 > clearance(predicted + 0.03)


@pytest.mark.parametrize("degrees", [90.0, 60.0, 25.0])
def test_friction_of_tows_that_turn_on_each_other(degrees):
    """Against the integral of mu p r over the overlap of two parabolic cylinders; 8/15 mu N a at a right angle."""
    angle, radius, deep, stiff, mu = np.radians(degrees), 600.0, 20.0, 3.0, 0.3
    half = np.sqrt(2 * 2 * radius * deep) / np.sin(angle / 2)
    x, y = np.meshgrid(*2 * [np.linspace(-half, half, 1501)])
    # distances from either axis, at half the angle to x
    c, s = np.cos(angle / 2), np.sin(angle / 2)
    pressure = stiff * np.maximum(deep - ((s * x - c * y) ** 2 + (s * x + c * y) ** 2) / (2 * radius), 0.0)
    cell = (x[0, 1] - x[0, 0]) ** 2
    normal, area = pressure.sum() * cell, np.count_nonzero(pressure) * cell
    couple = mu * (pressure * np.hypot(x, y)).sum() * cell
    found = turning_friction(*(np.array([v]) for v in (normal, area, angle, mu)))[0]
    assert found == pytest.approx(couple, rel=2e-3)
    if degrees == 90.0:
        assert found == pytest.approx(8 / 15 * mu * normal * np.sqrt(area / np.pi), rel=2e-3)


@pytest.mark.parametrize("angle", [0.0, 30.0])
def test_the_couple_of_turning_tows_is_told_over_the_cell(angle):
    """Four crossings by the closed form, with mu of the angle at which they cross."""
    built = plain(amplitude=9.0)
    state, turn = sheared(built, np.radians(angle)), np.radians(angle)
    faces = np.array([[-20.0, 20.0]])
    asked = []

    def friction(angles):
        asked.extend(angles)
        return 0.2 + 0.1 * angles

    found = fabric_statistics(built, frames_of(state), faces, lambda d: 100.0 * d, None, friction=friction)
    assert asked == pytest.approx([np.pi / 2 - turn] * 4, rel=1e-3)
    fabric = fabric_in(state, built)
    crossings = tow_crossings(fabric, fb.tow_lines(fabric, state.positions))
    loads = crossing_loads(fabric, crossings, touches(fabric, state.positions, lambda d: 100.0 * d))
    cross = np.full(4, np.pi / 2 - turn)
    each = turning_friction(loads.normal, loads.area, cross, 0.2 + 0.1 * cross)
    value, units = found["turning_couple"]
    assert units == "N/m" and value[0] > 0
    assert value[0] == pytest.approx(1e-3 * each.sum() / (4 * S * S * np.cos(turn)), rel=1e-3)
    pair = plain(amplitude=9.0, offsets=PAIR)
    more = fabric_statistics(pair, frames_of(pair), faces, lambda d: 100.0 * d, None, friction=friction)
    assert "turning_couple" not in more  # sides of tows of several chains are in the engine's forces


def test_friction_of_what_slips_at_an_angle():
    contact = Contact("hooke", 1.0, 1.0, 0.0, 0.2, 1.0, 1.0)
    at = np.radians([0.0, 45.0, 90.0])
    assert contact.sliding_friction(at) == pytest.approx([0.2, 0.2, 0.2])
    turned = replace(contact, by_angle=((0.0, 0.1), (np.pi / 2, 0.3)), kinetic=0.1)
    assert turned.sliding_friction(at) == pytest.approx([0.05, 0.1, 0.15])
