"""Stations along x: anchors hit, sizes and ratios bounded, symmetric, and few of them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cgfibre.build.spacing import SpacingSpec, stations
from cgfibre.errors import InputError


def ratios(x):
    d = np.diff(x)
    return np.maximum(d[1:] / d[:-1], d[:-1] / d[1:])


def test_uniform():
    x = stations(SpacingSpec(700.0, 7.0))
    np.testing.assert_allclose(x, np.linspace(0, 700, 101), atol=1e-9)
    assert len(stations(SpacingSpec(700.0, 6.999))) == 102  # never above the asked spacing


def test_full_length_filament_costs_little_more_than_its_zone():
    """345 mm, 1 mm zone at 7 um, 17 mm beyond: two geometric runs of ln(17000/7)/ln 1.3 = 30 and six coarse each."""
    half = 172500.0
    x = stations(SpacingSpec(345e3, 7.0, (half - 500, half + 500), 17e3, 1.3, (half - 250, half + 250)))
    zone = np.abs(x - half) <= 500 + 1e-6
    assert zone.sum() >= 1000 / 7
    assert (~zone).sum() <= 76
    assert ratios(x).max() <= 1.3 + 1e-9
    assert 10e3 < np.diff(x).max() <= 17e3
    anvil = np.diff(x[np.abs(x - half) <= 250 + 1e-6])
    np.testing.assert_allclose(anvil, anvil[0], rtol=1e-6)
    for place in (0.0, half - 500, half - 250, half + 250, half + 500, 345e3):
        assert place in x
    np.testing.assert_allclose(x + x[::-1], 345e3, atol=1e-6)


@st.composite
def specs(draw):
    length = draw(st.floats(50.0, 1e5))
    fine = draw(st.floats(0.5, 40.0))
    a = draw(st.floats(0.0, 0.9)) * length
    zone = (a, min(a + draw(st.floats(0.1, 200.0)) * fine, length))
    coarse = draw(st.one_of(st.none(), st.floats(1.0, 1e4).map(lambda f: f * fine)))
    places = st.one_of(
        st.floats(0.0, 1.0).map(lambda u: u * length),
        st.sampled_from([0.01, 0.5, 1.7]).map(lambda k: min(zone[0] + k * fine, length)),
    )
    anchors = tuple(draw(st.lists(places, max_size=5)))
    return SpacingSpec(length, fine, zone, coarse, draw(st.floats(1.05, 3.0)), anchors)


@settings(max_examples=200, deadline=None)
@given(specs())
def test_invariants(spec):
    x = stations(spec)
    d = np.diff(x)
    assert x[0] == 0.0 and x[-1] == spec.length
    assert np.all(d > 0.0)
    for place in (*spec.zone, *spec.anchors):
        assert np.abs(x - place).min() <= 1e-6 * spec.fine
    inside = (x[:-1] >= spec.zone[0] - 1e-6 * spec.fine) & (x[1:] <= spec.zone[1] + 1e-6 * spec.fine)
    assert d[inside].max() <= spec.fine * (1 + 1e-6)
    if spec.coarse is not None:
        assert d.max() <= spec.coarse * (1 + 1e-6)
    if len(x) > 2:
        assert ratios(x).max() <= spec.growth * (1 + 1e-6)


@settings(max_examples=50, deadline=None)
@given(specs(), st.floats(0.05, 0.95))
def test_mirrored_input_gives_mirrored_stations(spec, share):
    length = spec.length
    half = share * min(0.5 * length, 100 * spec.fine)
    middle = 0.5 * length
    same = SpacingSpec(
        length,
        spec.fine,
        (middle - half, middle + half),
        spec.coarse,
        spec.growth,
        (middle - half / 2, middle + half / 2),
    )
    x = stations(same)
    np.testing.assert_allclose(x + x[::-1], length, atol=1e-8 * length)


def test_zone_at_an_end():
    x = stations(SpacingSpec(1000.0, 7.0, (0.0, 100.0), 50.0))
    assert np.diff(x)[:14].max() <= 7.0 and np.diff(x)[-1] > 40.0


def test_anchor_beside_another_is_graded_to():
    x = stations(SpacingSpec(700.0, 7.0, (100.0, 600.0), 30.0, 1.3, (100.5,)))
    assert 100.5 in x and ratios(x).max() <= 1.3 + 1e-9


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ({"length": 0.0}, "spacing.length"),
        ({"length": float("inf")}, "spacing.length"),
        ({"fine": -1.0}, "spacing.fine"),
        ({"fine": 800.0}, "spacing.fine"),
        ({"coarse": 6.0}, "spacing.coarse"),
        ({"growth": 1.0}, "spacing.growth"),
        ({"zone": (300.0, 200.0)}, "spacing.zone"),
        ({"zone": (300.0, 701.0)}, "spacing.zone"),
        ({"anchors": (-1.0,)}, "spacing.anchors"),
        ({"anchors": (float("nan"),)}, "spacing.anchors"),
    ],
)
def test_bad_specs_name_the_key(change, key):
    given_ = {"length": 700.0, "fine": 7.0} | change
    with pytest.raises(InputError) as error:
        SpacingSpec(**given_)
    assert error.value.key == key
