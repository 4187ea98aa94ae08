import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from measure_systems import PITCH, D, hexagonal, pressed, rings
from scipy.spatial import cKDTree

from cgfibre.errors import InputError
from cgfibre.measure import distribution as ds
from cgfibre.measure import voids


def square(n=8, pitch=PITCH, jitter=0.0):
    c = np.stack(np.meshgrid(*[np.arange(float(n)) * pitch] * 2), -1).reshape(-1, 2)
    return c + np.random.default_rng(0).normal(0, jitter, c.shape) if jitter else c


def triangles_area(c, v):
    a, b, d = (c[v.corners[:, k]] for k in range(3))
    return np.bincount(v.void, np.abs(np.cross(np.pad(b - a, ((0, 0), (0, 1))), np.pad(d - a, ((0, 0), (0, 1))))[:, 2]))


def test_hexagonal_lattice_in_closed_form():
    c = hexagonal(6)
    v = voids.find_voids(c, D)
    assert len(v) == 6 * 6**2
    assert v.area == pytest.approx(np.sqrt(3) / 4 * PITCH**2 - np.pi * D**2 / 8, rel=1e-12)
    assert v.radius == pytest.approx(PITCH / np.sqrt(3) - D / 2, rel=1e-12)
    assert v.wetted == pytest.approx(np.pi * D / 2, rel=1e-12)
    assert v.throat == pytest.approx(PITCH - D, rel=1e-11)
    assert len(v.throat) == (3 * 216 - 36) / 2  # every side but those of the outline
    fraction = np.pi * D**2 / (2 * np.sqrt(3) * PITCH**2)
    assert v.hydraulic_radius == pytest.approx((1 - fraction) * D / (4 * fraction), rel=1e-12)


@pytest.mark.parametrize("jitter", [0.0, 1e-12, 0.1])
def test_square_lattice_keeps_its_voids_when_a_little_out_of_order(jitter):
    v = voids.find_voids(square(jitter=jitter), D)
    assert len(v) == 7**2
    assert np.mean(v.area) == pytest.approx(PITCH**2 - np.pi * D**2 / 4, rel=1e-9 + jitter / 10)
    assert v.wetted == pytest.approx(np.pi * D, rel=1e-9 + jitter)
    assert v.radius == pytest.approx(PITCH / np.sqrt(2) - D / 2, abs=1e-9 + 4 * jitter)
    middles = (np.stack(np.meshgrid(*[np.arange(7) + 0.5] * 2), -1) * PITCH).reshape(-1, 2)
    assert cKDTree(middles).query(v.centre)[0].max() < 1e-9 + 4 * jitter


def test_a_missing_filament_is_one_void():
    c = hexagonal(5)
    c = c[np.linalg.norm(c, axis=1) > 1]
    v = voids.find_voids(c, D)
    hole = np.argmax(v.area)
    # six triangles of the lattice and the sectors of six discs, 120 degrees each
    assert v.area[hole] == pytest.approx(6 * np.sqrt(3) / 4 * PITCH**2 - 2 * np.pi * D**2 / 4, rel=1e-12)
    assert v.radius[hole] == pytest.approx(PITCH - D / 2) and v.centre[hole] == pytest.approx([0, 0], abs=1e-9)
    assert len(v) == 6 * 5**2 - 6 + 1


def test_bays_and_open_sides_are_outside():
    c = hexagonal(5)
    bay = c[~((np.abs(c[:, 0]) < PITCH) & (c[:, 1] > 0))]
    v = voids.find_voids(bay, D)
    assert v.radius.max() == pytest.approx(PITCH / np.sqrt(3) - D / 2)
    # a probe too large to enter leaves the bay among the voids
    assert voids.find_voids(bay, D, probe=20 * D).radius.max() > 2 * v.radius.max()


def test_areas_of_overlapping_and_unequal_discs_against_counting():
    rng = np.random.default_rng(4)
    c = pressed(rings(4), 45.0) * 0.97  # contacts overlap
    d = D * (1 + 0.05 * rng.uniform(-1, 1, len(c)))
    v = voids.find_voids(c, d)
    box = np.stack([c.min(axis=0), c.max(axis=0)])
    p = box[0] + rng.random((400_000, 2)) * (box[1] - box[0])
    free = (
        np.linalg.norm(p[:, None] - c[cKDTree(c).query(p, k=6)[1]], axis=2) > d[cKDTree(c).query(p, k=6)[1]] / 2
    ).all(axis=1)
    a, b, e = (c[v.corners[:, k]] for k in range(3))
    counted = np.zeros(len(v))
    for k in range(len(v.corners)):
        m = np.linalg.solve(np.stack([b[k] - a[k], e[k] - a[k]], axis=1), (p[free] - a[k]).T)
        counted[v.void[k]] += np.sum((m >= 0).all(axis=0) & (m.sum(axis=0) <= 1))
    scale = np.prod(box[1] - box[0]) / len(p)
    # four s.d. of a count
    assert np.all(np.abs(counted * scale - v.area) < 4 * scale * np.sqrt(counted + 4))


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000), st.integers(20, 80))
def test_circles_touch_three_discs_and_hold_none(seed, n):
    rng = np.random.default_rng(seed)
    c, d = rng.random((n, 2)) * 8 * np.sqrt(n), 1.0
    v = voids.find_voids(c, d)
    distance = np.sort(np.linalg.norm(v.centre[:, None] - c, axis=2), axis=1) - d / 2
    assert distance[:, :3] == pytest.approx(np.repeat(v.radius[:, None], 3, axis=1), abs=1e-6)
    assert np.all(v.area > 0) and np.all(v.throat >= 0)
    assert np.all(triangles_area(c, v) / 2 >= v.area - 1e-9)


def test_circle_among_unequal_discs():
    c, d = np.array([[0, 0], [10, 0], [4, 8.0]]), np.array([6.0, 8.0, 5.0])
    v = voids.find_voids(c, d)
    assert np.linalg.norm(v.centre - c, axis=1) - d / 2 == pytest.approx(v.radius[0])


def test_sections_without_voids():
    for c in ([[0.0, 0.0]], [[0, 0], [D, 0]], [[0, 0], [D, 0], [3 * D, 0]]):
        v = voids.find_voids(np.array(c, dtype=float), D)
        assert len(v) == 0 and np.isnan(v.hydraulic_radius)
    with pytest.raises(InputError, match="probe"):
        voids.find_voids(hexagonal(1), D, probe=-1)


def test_disc_below_a_corner():
    t = (np.arange(2000) + 0.5) / 1000 - 1
    disc = t[:, None] ** 2 + t**2 < 1
    for x, y in np.random.default_rng(1).uniform(-1.2, 1.2, (40, 2)):
        counted = np.sum(disc[t <= x][:, t <= y]) * 1e-6
        assert voids.disc_below(x, y) == pytest.approx(counted, abs=2e-3)


def test_map_holds_the_area_of_the_discs():
    c = rings(6)
    m = voids.fraction_map(c, D, 1.7)
    cell = np.diff(m.y)[0] * np.diff(m.z)[0]
    assert m.fraction.sum() * cell == pytest.approx(len(c) * np.pi * D**2 / 4, rel=1e-12)
    assert m.fraction.shape == (len(m.z) - 1, len(m.y) - 1)
    # within a box that cuts discs: half of those on its edge
    lattice = square(5)
    m = voids.fraction_map(lattice, D, PITCH / 3, box=[[0, 4 * PITCH]] * 2)
    assert m.fraction.mean() == pytest.approx(np.pi * D**2 / 4 / PITCH**2, rel=1e-12)
    # windows of one lattice cell hold one filament each, wherever they lie
    m = voids.fraction_map(lattice, D, PITCH / 3, PITCH, box=[[0, 4 * PITCH]] * 2)
    assert m.void_fraction[2:-2, 2:-2] == pytest.approx(1 - np.pi * D**2 / 4 / PITCH**2, rel=1e-9)


def test_map_takes_unequal_discs_and_refuses_nonsense():
    c, d = np.array([[0, 0], [5, 1.0]]), np.array([2.0, 4.0])
    m = voids.fraction_map(c, d, 0.1)
    assert m.fraction.sum() * np.diff(m.y)[0] * np.diff(m.z)[0] == pytest.approx(5 * np.pi, rel=1e-12)
    for bad in ({"cell": 0}, {"cell": 1, "box": [[0, 0], [1, 2]]}, {"cell": 1, "window": -1}, {"cell": 1e-6}):
        with pytest.raises(InputError):
            voids.fraction_map(c, d, **bad)


def test_voids_and_cells_agree_inside_a_lattice():
    c = hexagonal(8)
    local = ds.local_volume_fraction(c, D)[np.linalg.norm(c, axis=1) < 3 * PITCH]
    v = voids.find_voids(c, D)
    solid = np.pi * D**2 / 8
    assert solid / (solid + v.area) == pytest.approx(local[0], rel=1e-12)
