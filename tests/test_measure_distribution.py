import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from measure_systems import PITCH, D, hexagonal, system_of

from cgfibre.errors import InputError
from cgfibre.measure import distribution as ds


def test_hexagonal_lattice_has_the_exact_interior_values():
    c = hexagonal(6)
    interior = np.linalg.norm(c, axis=1) < 4 * PITCH
    vf = ds.local_volume_fraction(c, D)
    # 31 % voids of the thesis
    assert vf[interior] == pytest.approx(np.pi * D**2 / (2 * np.sqrt(3) * PITCH**2), rel=1e-12)
    assert 1 - vf[interior][0] == pytest.approx(0.31, abs=0.002)
    assert ds.coordination_number(c, D, PITCH - D + 1e-9)[interior].tolist() == [6] * interior.sum()
    assert ds.coordination_number(c, D, 0.5).max() == 0
    assert ds.nearest_neighbour_distance(c) == pytest.approx(PITCH)


def test_voronoi_cells_fill_the_outline():
    c = np.random.default_rng(3).random((60, 2)) * [80, 30]
    vf = ds.local_volume_fraction(c, 2.0)
    assert np.sum(np.pi / vf) == pytest.approx(ds.polygon_area(ds.outline(c, 2.0)), rel=1e-9)


def test_voronoi_against_counting_points():
    rng = np.random.default_rng(8)
    c = rng.random((25, 2)) * 40
    area = np.pi * 1.5**2 / ds.local_volume_fraction(c, 3.0)
    hull = ds.outline(c, 3.0)
    edge = np.roll(hull, -1, axis=0) - hull
    p = rng.random((40_000, 2)) * 44 - 2
    sides = [e[0] * (p[:, 1] - v[1]) - e[1] * (p[:, 0] - v[0]) for v, e in zip(hull, edge, strict=True)]
    inside = np.all(np.array(sides) >= 0, axis=0)
    owner = np.argmin(((p[inside, None] - c) ** 2).sum(2), axis=1)
    counted = np.bincount(owner, minlength=25) * 44**2 / len(p)
    # five s.d. of the counts
    assert np.all(np.abs(counted - area) < 5 * np.sqrt(counted * 44**2 / len(p)))


def test_voronoi_of_few_discs():
    # one disc fills its own outline; a touching row fills its stadium: end cells (D^2/2 + pi D^2/8), inner D^2
    assert ds.local_volume_fraction([[3.0, 4.0]], D) == pytest.approx([1.0], rel=1e-4)
    row = ds.local_volume_fraction([[0, 0], [D, 0], [2 * D, 0]], D)
    end = (np.pi / 4) / (0.5 + np.pi / 8)
    assert row == pytest.approx([end, np.pi / 4, end], rel=1e-4)


def test_voronoi_reach_limits_the_cell_beside_a_hole():
    c = hexagonal(5)
    hole = np.linalg.norm(c, axis=1) > 2.5 * PITCH
    free, limited = ds.local_volume_fraction(c[hole], D), ds.local_volume_fraction(c[hole], D, reach=PITCH)
    full = np.pi * D**2 / (2 * np.sqrt(3) * PITCH**2)
    assert free.min() < 0.6 * full
    assert limited.min() > free.min() and np.all(limited >= free - 1e-12)


def test_voronoi_refuses_coincident_centres():
    with pytest.raises(InputError, match="distinct"):
        ds.local_volume_fraction([[0, 0], [0, 0], [9, 0]], D)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**31), n=st.integers(2, 40), shift=st.floats(-1e4, 1e4))
def test_section_measures_do_not_depend_on_the_origin_and_neighbours_match_the_naive_count(seed, n, shift):
    c = np.random.default_rng(seed).random((n, 2)) * 30
    gap = np.linalg.norm(c[:, None] - c, axis=2)
    np.fill_diagonal(gap, np.inf)
    assert ds.nearest_neighbour_distance(c) == pytest.approx(gap.min(axis=1))
    assert ds.coordination_number(c, 4.0, 0.7).tolist() == (gap <= 4.7).sum(axis=1).tolist()
    assert ds.local_volume_fraction(c + shift, 4.0) == pytest.approx(ds.local_volume_fraction(c, 4.0), rel=1e-6)


def test_coordination_with_two_diameters():
    assert ds.coordination_number([[0, 0], [3, 0], [7, 0]], [2, 4, 2], 0.5).tolist() == [1, 1, 0]


def test_size_and_outline_of_a_bundle():
    c = hexagonal(3)
    assert ds.bundle_size(c, D) == pytest.approx((6 * PITCH + D, 6 * PITCH * np.sqrt(3) / 2 + D))
    # hull of a hexagon of side 3 p grown by D/2: area + perimeter D/2 + pi D^2/4
    side = 3 * PITCH
    exact = 1.5 * np.sqrt(3) * side**2 + 6 * side * D / 2 + np.pi * D**2 / 4
    got = ds.polygon_area(ds.outline(c, D))
    assert got < exact and got == pytest.approx(exact, rel=1e-4)


def test_area_of_the_outer_layer_and_area_strain():
    ring = hexagonal(1)[1:] if np.allclose(hexagonal(1)[0], 0) else hexagonal(1)
    ring = ring[np.linalg.norm(ring, axis=1) > 1]
    outer = np.argsort(np.arctan2(ring[:, 1], ring[:, 0]))
    area = ds.polygon_area(ring[outer])
    assert area == pytest.approx(1.5 * np.sqrt(3) * PITCH**2)
    assert ds.polygon_area(ring[outer][::-1] + 1e6) == pytest.approx(area, rel=1e-9)
    squeezed = ds.polygon_area(ring[outer] * [1.1, 0.5])
    assert ds.area_strain(squeezed, area) == pytest.approx(1.1 * 0.5 - 1)
    with pytest.raises(InputError, match="initial_area"):
        ds.area_strain(1.0, 0.0)


def test_normalisation_is_the_thesis_one():
    c = hexagonal(4) + np.array([100, -20])
    n = ds.normalisation(c, D)
    assert n.centre == pytest.approx([100, -20]) and n.half_size[0] == pytest.approx(4 * PITCH + D / 2)
    e6 = ds.normalisation(c, 0.0)
    assert np.abs(ds.fit_distribution(c, e6).coordinates).max() == pytest.approx(1)
    with pytest.raises(InputError, match="diameter"):
        ds.normalisation([[0, 0], [9, 0]], 0.0)


def test_gaussian_centres_are_fitted():
    rng = np.random.default_rng(11)
    reference = ds.Normalisation(centre=np.array([5.0, 1.0]), half_size=np.array([20.0, 10.0]))
    c = rng.normal([7, 0], [10, 2], (4000, 2))
    fit = ds.fit_distribution(c, reference)
    # standard error of the mean is sd/63
    assert fit.mean == pytest.approx([0.1, -0.1], abs=0.03)
    assert fit.sd == pytest.approx([0.5, 0.2], rel=0.05)
    assert np.all(fit.ks_distance < 1.63 / np.sqrt(4000)) and np.all(fit.r_squared > 0.998)
    assert fit.density(0, fit.mean[0]) == pytest.approx(1 / (fit.sd[0] * np.sqrt(2 * np.pi)))
    two_heaps = np.concatenate([c, c + np.array([60, 0])])
    assert ds.fit_distribution(two_heaps, reference).ks_distance[0] > 0.15


def test_a_round_bundle_has_sd_one_half_and_mean_zero():
    # uniform over a disc of radius R: variance R^2/4 along each axis
    fit = ds.fit_distribution(hexagonal(30), ds.normalisation(hexagonal(30), D))
    assert fit.mean == pytest.approx([0, 0], abs=1e-9)
    # a hexagon of circumradius R: variance 5 R^2/24 along y; z is normalised by its apothem R sqrt(3)/2
    assert fit.sd == pytest.approx([np.sqrt(5 / 24), np.sqrt(5 / 24) * 2 / np.sqrt(3)], rel=0.02)


def test_a_row_has_no_spread_in_z():
    row = np.stack([np.arange(9) * D, np.zeros(9)], axis=1)
    fit = ds.fit_distribution(row, ds.normalisation(row, D))
    assert fit.sd[1] == 0 and fit.ks_distance[1] == 1 and np.isnan(fit.r_squared[1])


@pytest.mark.parametrize("bad", [np.zeros((0, 2)), np.zeros((4, 3)), np.array([[0, np.nan], [1, 1]])])
def test_centres_are_checked(bad):
    with pytest.raises(InputError, match="centres"):
        ds.bundle_size(bad, D)


@pytest.mark.parametrize("diameter", [0.0, -1.0, [1.0, 2.0, 3.0]])
def test_diameters_are_checked(diameter):
    with pytest.raises(InputError, match="diameter"):
        ds.outline([[0, 0], [9, 0]], diameter)


def test_section_at_interpolates_and_says_nan_beyond_the_ends():
    a = np.array([[0, 0, 0], [10, 2, 4], [30, 2, 8.0]])
    b = a[::-1] + np.array([5, 20, 0])
    s = system_of([a, b])
    assert ds.section_at(s, s.positions, 5.0) == pytest.approx(np.array([[1, 2], [20, 0.0]]))
    assert ds.section_at(s, s.positions, 20.0) == pytest.approx(np.array([[2, 6], [22, 5.0]]))
    got = ds.section_at(s, s.positions, 32.0)
    assert np.isnan(got[0]).all() and got[1] == pytest.approx([22, 7.4])


def test_section_at_a_bead_and_of_moved_positions():
    a = np.array([[0, 0, 0], [10, 2, 4], [30, 2, 8.0]])
    s = system_of([a])
    assert ds.section_at(s, s.positions, 10.0)[0] == pytest.approx([2, 4])
    assert ds.section_at(s, s.positions + np.array([0, 1, -1]), 10.0)[0] == pytest.approx([3, 3])
    with pytest.raises(InputError, match="positions"):
        ds.section_at(s, s.positions[:-1], 0.0)


@pytest.mark.parametrize("image", [-1000.0, 0.0, 300.0])
def test_section_at_sees_periodic_images_and_the_closing_bond(image):
    x = np.array([0.0, 25, 50, 75])
    a = np.stack([x + image, np.array([0.0, 1, 2, 1]), x * 0], axis=1)
    s = system_of([a], closed=True, box=[[0, 100], [-50, 50], [-50, 50]], periodic=(True, False, False))
    # the closing bond runs from (75, 1) to (100, 0)
    assert ds.section_at(s, s.positions, 87.5)[0] == pytest.approx([0.5, 0])
    assert ds.section_at(s, s.positions, 12.5)[0] == pytest.approx([0.5, 0])


def test_section_at_against_a_loop_over_filaments():
    rng = np.random.default_rng(4)
    x = np.sort(rng.random((20, 12)) * 100, axis=1)
    chains = [np.stack([xi, rng.random(12), rng.random(12)], axis=1) for xi in x]
    s = system_of(chains)
    naive = [[np.interp(50, c[:, 0], c[:, k]) for k in (1, 2)] for c in chains]
    assert ds.section_at(s, s.positions, 50.0) == pytest.approx(np.array(naive))


def test_section_of_discs_is_where_they_are():
    c = hexagonal(2)
    s = system_of([np.array([[0.0, *p]]) for p in c])
    assert ds.section_at(s, s.positions, 123.0) == pytest.approx(c)
