"""Filament centres: known counts and distances, no overlap anywhere, volume fractions, refusals."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cgfibre.build import packing
from cgfibre.build.packing import ArrangementSpec, Envelope, arrange, min_distance
from cgfibre.errors import InputError

D, P = 7.0, 8.028
REGULAR = ["circular", "hexagonal", "rectangular", "elliptic", "racetrack"]


def rng(seed=1):
    return np.random.default_rng(seed)


def outline_aspect(c, pitch=P):
    width, height = np.ptp(c, axis=0) + pitch
    return width / height


def test_thesis_pitch():
    # 8.028 um is 31 % rounded: 31.05 % to four figures
    assert packing.void_fraction_from_pitch(D, P) == pytest.approx(0.3105, abs=5e-5)
    assert packing.pitch_from_void_fraction(D, 0.31049) == pytest.approx(P, abs=5e-5)
    assert packing.pitch_from_void_fraction(D, 0.31) == pytest.approx(8.0251, abs=5e-5)


@given(st.floats(0.0932, 0.95), st.floats(0.1, 1000.0))
def test_pitch_and_void_fraction_are_inverse(void, diameter):
    pitch = packing.pitch_from_void_fraction(diameter, void)
    assert packing.void_fraction_from_pitch(diameter, pitch) == pytest.approx(void, abs=1e-12)


def test_touching_filaments_are_the_limit():
    assert packing.pitch_from_void_fraction(D, 1.0 - packing.HEXAGONAL_LIMIT) == pytest.approx(D, rel=1e-12)
    for void in (0.09, 1.0, -1.0, float("nan")):
        with pytest.raises(InputError, match="void_fraction"):
            packing.pitch_from_void_fraction(D, void)
    with pytest.raises(InputError, match="pitch"):
        packing.void_fraction_from_pitch(D, 6.9)


def test_ring_counts():
    assert packing.ring_counts(13).tolist() == [1, 7, 19, 37, 61, 91, 127, 169, 217, 271, 331, 397, 469, 547]
    assert packing.ring_counts(62)[-1] == 11719


@pytest.mark.parametrize("angle", [0.0, np.pi / 2, 0.3])
def test_circular_rings(angle):
    c = packing.circular(37, P, angle)
    radius = np.hypot(c[:, 0], c[:, 1])
    np.testing.assert_allclose(radius, P * np.repeat([0, 1, 2, 3], [1, 6, 12, 18]), atol=1e-12)
    for ring, first in ((1, 1), (2, 7), (3, 19)):
        np.testing.assert_allclose(c[first], ring * P * np.array([np.cos(angle), np.sin(angle)]), atol=1e-12)
        turn = np.arctan2(*c[first + 1, ::-1]) - np.arctan2(*c[first, ::-1])
        assert np.mod(turn, 2 * np.pi) == pytest.approx(2 * np.pi / (6 * ring))  # from +y towards +z
    # neighbours: exactly one pitch in ring 1, 2 l sin(pi / 6 l) pitches in ring l
    for ring, first in ((1, 1), (2, 7), (3, 19)):
        chord = np.linalg.norm(c[first + 1] - c[first])
        assert chord == pytest.approx(2 * ring * P * np.sin(np.pi / (6 * ring)), rel=1e-12)


def test_first_angle_decides_on_the_column():
    """Seven filaments on the z axis at pi/2 (the thesis' middle column), one at 0."""
    assert np.sum(np.abs(packing.circular(37, P, np.pi / 2)[:, 0]) < 1e-9) == 7
    assert np.sum(np.abs(packing.circular(37, P, 0.0)[:, 0]) < 1e-9) == 1 + 2  # ring 2 alone has one at 90 degrees
    assert np.sum(np.abs(packing.circular(37, P, 0.0)[:, 1]) < 1e-9) == 7


def test_hexagonal_lattice():
    c = packing.hexagonal(61, P)
    d = np.linalg.norm(c[:, None] - c[None], axis=2)
    assert np.sum(np.abs(d[np.argmin(np.hypot(*c.T))] - P) < 1e-9) == 6
    rows = np.unique(np.round(c[:, 1], 6))
    np.testing.assert_allclose(np.diff(rows), P * np.sqrt(3) / 2, rtol=1e-6)
    # 61 is a closed shell by distance: none outside is nearer
    full = packing.hexagonal(400, P)
    assert np.sum(np.hypot(*full.T) < np.hypot(*c.T).max() - 1e-6) < 61


def test_two_filaments_beside_or_above():
    above = packing.rectangular(2, P, 0.5)
    np.testing.assert_allclose(above, [[0.0, -P / 2], [0.0, P / 2]], atol=1e-12)
    beside = packing.rectangular(2, P, 2.0)
    np.testing.assert_allclose(beside, [[-P / 2, 0.0], [P / 2, 0.0]], atol=1e-12)


def test_rectangular_close_packed_layers():
    """15 x 5 as in thesis 7.5.3."""
    c = packing.rectangular(75, P, 15.5 / (1 + 4 * np.sqrt(3) / 2))
    rows, n = np.unique(np.round(c[:, 1], 6), return_counts=True)
    assert n.tolist() == [15] * 5
    np.testing.assert_allclose(np.diff(rows), P * np.sqrt(3) / 2, rtol=1e-6)
    first, second = c[:15, 0], c[15:30, 0]
    np.testing.assert_allclose(second - first, P / 2)


def test_elliptic_of_aspect_one_is_circular():
    np.testing.assert_allclose(packing.elliptic(37, P), packing.circular(37, P, np.pi / 2), atol=1e-12)


def test_thesis_ellipse_overlaps_when_flattened_by_b():
    """Why ``elliptic`` does not follow E.8 for other aspects: with b = a / 2 centres come to half a pitch."""

    def printed(a, b, rings):
        parts = []
        for ring in range(1, rings + 1):
            t = np.pi / 2 + 2 * np.pi * np.arange(6 * ring) / (6 * ring)
            parts.append(np.column_stack([a * (ring + 1) * np.cos(t), b * ring * np.sin(t)]))
        return np.concatenate(parts)

    assert min_distance(printed(P, P, 6)) == pytest.approx(P, rel=1e-9)
    assert outline_aspect(printed(P, P, 6)) == pytest.approx(1.15, abs=0.02)
    assert min_distance(printed(P, P / 2, 6)) == pytest.approx(P / 2, rel=1e-9)
    assert min_distance(packing.elliptic(126, P, 2.3)) >= P


@pytest.mark.parametrize("name", ["rectangular", "elliptic", "racetrack"])
@pytest.mark.parametrize("aspect", [1.5, 3.0, 1 / 3])
def test_aspect_of_the_outline(name, aspect):
    c = arrange(ArrangementSpec(name, 547, pitch=P, aspect=aspect), D, rng())
    assert outline_aspect(c) == pytest.approx(aspect, rel=0.08)  # one of the 14 filaments across more or less


def test_racetrack_has_straight_sides_and_round_ends():
    c = packing.racetrack(547, P, 3.0)
    height = np.ptp(c[:, 1])
    straight = 0.5 * (np.ptp(c[:, 0]) - height)
    beyond = np.hypot(np.maximum(np.abs(c[:, 0]) - straight, 0.0), c[:, 1])
    assert beyond.max() < 0.5 * height + 0.6 * P  # nothing in the corners of the bounding rectangle
    top = c[c[:, 1] > c[:, 1].max() - 1e-6]
    assert np.ptp(top[:, 0]) >= 2.0 * straight - P  # aspect 3: the sides are straight over two heights
    assert 2.0 * straight == pytest.approx(2.0 * (height + P), rel=0.06)


@settings(max_examples=60, deadline=None)
@given(
    st.sampled_from([*REGULAR, "virtual"]),
    st.integers(1, 300),
    st.floats(0.2, 5.0),
    st.sampled_from([D, P, 12.3]),
    st.floats(-4.0, 4.0),
)
def test_no_overlap_at_the_pitch(name, count, aspect, pitch, angle):
    spec = ArrangementSpec(name, count, pitch=pitch, aspect=aspect, first_angle=angle)
    c = arrange(spec, D, rng(count))
    assert c.shape == (count, 2)
    assert min_distance(c) >= pitch  # exactly, in floating point
    if name != "virtual":
        np.testing.assert_allclose(c.mean(axis=0), 0.0, atol=1e-9 * pitch * count)
    np.testing.assert_array_equal(c, arrange(spec, D, rng(count)))


def test_no_overlap_far_from_the_origin():
    assert min_distance(packing.circular(11719, D)) >= D
    assert min_distance(packing.hexagonal(11719, D)) >= D


@settings(max_examples=25, deadline=None)
@given(st.integers(20, 150), st.floats(0.05, 0.68), st.sampled_from([None, 0.5, 1.0, 3.0]), st.integers(0, 2**32))
def test_random_packing_keeps_fraction_and_distance(count, fraction, aspect, seed):
    c = packing.random_packing(count, D, fraction, rng(seed), aspect)
    envelope = Envelope.of(count, D, fraction, 1.0 if aspect is None else aspect, aspect is None)
    assert min_distance(c) >= D
    # filaments lie inside the envelope, whose area gives the fraction
    if aspect is None:
        assert np.hypot(*c.T).max() + D / 2 <= envelope.half[0] * (1 + 1e-12)
        area = np.pi * envelope.half[0] ** 2
    else:
        assert np.all(np.abs(c) + D / 2 <= np.array(envelope.half) * (1 + 1e-12))
        area = 4 * envelope.half[0] * envelope.half[1]
        assert envelope.half[0] / envelope.half[1] == pytest.approx(aspect)
    assert count * np.pi * D**2 / 4 / area == pytest.approx(fraction, abs=1e-9)


@pytest.mark.parametrize(("count", "fraction"), [(127, 0.78), (500, 0.80)])
def test_dense_random_packing(count, fraction):
    assert min_distance(packing.random_packing(count, D, fraction, rng())) >= D


def test_random_packing_is_the_seeds():
    a, b, c = (packing.random_packing(60, D, 0.6, rng(s)) for s in (3, 3, 4))
    np.testing.assert_array_equal(a, b)
    assert np.abs(a - c).max() > 0.1


@pytest.mark.parametrize(("count", "fraction"), [(2, 0.51), (3, 0.66), (127, 0.83), (20, 0.95), (20, 0.0), (20, -1)])
def test_random_packing_refuses_what_cannot_be(count, fraction):
    with pytest.raises(InputError, match="volume_fraction"):
        packing.random_packing(count, D, fraction, rng())


def test_two_filaments_in_a_circle_reach_their_limit():
    """Two discs fill half of their circle at best."""
    c = packing.random_packing(2, D, 0.4999, rng())
    assert D <= np.linalg.norm(c[0] - c[1]) < 1.001 * D


# --- centres from a file ----------------------------------------------------------------------------------------------


def test_a_pair_parts_by_half_its_overlap_each():
    c = np.array([[0.0, 0.0], [3.0, 4.0], [40.0, 0.0]])
    moved = packing.separated(c, 7.0)
    away = np.array([0.6, 0.8])
    assert moved == pytest.approx(np.array([-away, c[1] + away, c[2]]), abs=1e-5)


def test_a_triangle_opens_about_its_middle():
    """Three equal overlaps: the least shift is along the rays from the middle, to a circle of radius D/sqrt(3)."""
    t = np.pi / 2 + 2 * np.pi * np.arange(3) / 3
    c = 3.5 * np.column_stack([np.cos(t), np.sin(t)])
    assert packing.separated(c, D) == pytest.approx(c * (D / np.sqrt(3)) / 3.5, rel=1e-6)


def test_what_does_not_overlap_stays():
    c = packing.random_packing(60, D, 0.6, rng())
    assert np.array_equal(packing.separated(c, D), c)


@pytest.mark.parametrize(("count", "fraction", "error"), [(60, 0.6, 0.02), (127, 0.75, 0.02), (127, 0.65, 0.08)])
def test_overlaps_are_cleared_by_the_least_shift(count, fraction, error):
    truth = packing.random_packing(count, D, fraction, rng())
    c = truth + error * D * rng(1).standard_normal(truth.shape) / np.sqrt(2)
    moved = packing.separated(c, D)
    assert min_distance(moved) >= D
    shift = np.sum((moved - c) ** 2)
    # the true centres are one way of clearing them, and relaxing the overlap energy another
    assert shift <= np.sum((truth - c) ** 2)
    everywhere = packing.Envelope((1e9, 1e9), True)
    relaxed, energy = packing._relax(c, D * (1 + 1e-9), everywhere)
    assert energy == 0 and shift < np.sum((relaxed - c) ** 2)
    # no small change makes it smaller: pulled back by any part, filaments overlap again
    assert min_distance(moved - 1e-3 * (moved - c)) < D


def test_two_finds_of_one_filament_are_refused():
    with pytest.raises(InputError) as caught:
        packing.separated(np.array([[0.0, 0.0], [3.0, 0.0]]), D)
    assert caught.value.key == "centres"


def test_given_centres_are_taken_about_their_mean():
    spec = packing.ArrangementSpec("file", 3, centres=((0.0, 0.0), (10.0, 0.0), (2.0, 9.0)))
    c = packing.arrange(spec, D, rng())
    assert c == pytest.approx(np.array([[-4, -3], [6, -3], [-2, 6]]))
    for centres in (None, ((0.0, 0.0),)):
        with pytest.raises(InputError):
            packing.arrange(packing.ArrangementSpec("file", 3, centres=centres), D, rng())


def test_enclosing_area():
    assert packing.enclosing_area(np.zeros((1, 2)), D) == pytest.approx(np.pi * D**2 / 4)
    line = np.array([[0.0, 0.0], [10.0, 0.0], [25.0, 0.0]])
    assert packing.enclosing_area(line, D) == pytest.approx(25 * D + np.pi * D**2 / 4)
    square = np.array([[0.0, 0.0], [10.0, 0.0], [0.0, 10.0], [10.0, 10.0], [4.0, 6.0]])
    assert packing.enclosing_area(square, D) == pytest.approx(100 + 20 * D + np.pi * D**2 / 4)


def test_packing_probability():
    """Eq. 2-1 by hand: 1 - eps on the axis, eps at the rim, and one value in between."""
    r = np.array([0.0, 25.0, 50.0])
    p = packing.packing_probability(r, 50.0, 0.1, 0.7)
    half = 0.8 * ((np.e - np.sqrt(np.e)) / (np.e - 1)) ** 0.7 + 0.1
    np.testing.assert_allclose(p, [0.9, half, 0.1], rtol=1e-12)
    for eps, beta in ((-0.1, 1.0), (0.6, 1.0), (0.1, -1.0)):
        with pytest.raises(InputError):
            packing.packing_probability(r, 50.0, eps, beta)
    with pytest.raises(InputError, match="radius"):
        packing.packing_probability(r, 40.0, 0.1, 1.0)


def test_virtual_locations_thin_outwards():
    """Filled fraction of the rings follows the packing probability: over seeds, dense inside and thin outside."""
    spec = ArrangementSpec("virtual", 100, pitch=P, epsilon=0.05, beta=1.0)
    rings = np.concatenate([np.rint(np.hypot(*arrange(spec, D, rng(s)).T) / P) for s in range(40)])
    inner = np.sum(rings == 1) / (40 * 6)
    outer = np.sum(rings == rings.max()) / (40 * 6 * rings.max())
    assert inner > 2.5 * outer


@pytest.mark.parametrize(
    ("spec", "key"),
    [
        (ArrangementSpec("spiral", 7, pitch=P), "arrangement"),
        (ArrangementSpec("circular", 0, pitch=P), "count"),
        (ArrangementSpec("circular", 7, pitch=6.5), "pitch"),
        (ArrangementSpec("circular", 7, pitch=float("nan")), "pitch"),
        (ArrangementSpec("circular", 7), "volume_fraction"),
        (ArrangementSpec("random", 7, pitch=P), "volume_fraction"),
        (ArrangementSpec("elliptic", 7, pitch=P, aspect=0.0), "aspect"),
        (ArrangementSpec("racetrack", 7, pitch=P, aspect=-1.0), "aspect"),
        (ArrangementSpec("hexagonal", 7, volume_fraction=0.92), "void_fraction"),
    ],
)
def test_bad_arrangements_name_the_key(spec, key):
    with pytest.raises(InputError) as error:
        arrange(spec, D, rng())
    assert error.value.key == key


def test_pitch_from_volume_fraction():
    by_fraction = arrange(ArrangementSpec("circular", 19, volume_fraction=0.69), D, rng())
    assert min_distance(by_fraction) == pytest.approx(packing.pitch_from_void_fraction(D, 0.31), rel=1e-12)
