"""Belt law, Howell, adhesion: values computed by hand, limits, and the table of tow friction."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cgfibre import tow_friction as tows
from cgfibre.errors import InputError
from cgfibre.mechanics import belt


def test_belt_law_and_its_inverse():
    assert belt.tension_ratio(0.22, 1.435) == pytest.approx(1.371219, rel=1e-6)
    assert belt.friction_coefficient(belt.tension_ratio(0.23, 2.87), 2.87) == pytest.approx(0.23, rel=1e-14)
    # App A.1: 32.439 gf hung on, 2.87 rad
    assert belt.friction_coefficient(62.768 / 32.439, 2.87) == pytest.approx(0.23, abs=1e-5)
    assert belt.friction_coefficient(0.5, 1.0) == pytest.approx(-math.log(2))


def test_a_polygon_tends_to_the_belt_with_the_stated_error():
    mu, wrap = 0.22, 1.435
    exact = belt.tension_ratio(mu, wrap)
    errors = belt.polygon_ratio(mu, wrap, np.array([4, 8, 15, 30, 60])) / exact - 1
    # lammps-findings measured 0.36, 0.09, 0.026, 0.0066, 0.0018 %
    assert errors[:4] == pytest.approx([3.6e-3, 9e-4, 2.6e-4, 6.6e-5], rel=0.05) and errors[4] < 1.8e-5
    a = wrap / 60
    assert errors[-1] == pytest.approx(mu * wrap * a**2 * (1 + mu**2) / 12, rel=1e-2)
    # corner by corner
    turn, tension = wrap / 7, 1.0
    for _ in range(7):
        tension *= (math.cos(turn / 2) + mu * math.sin(turn / 2)) / (math.cos(turn / 2) - mu * math.sin(turn / 2))
    assert belt.polygon_ratio(mu, wrap, 7) == pytest.approx(tension, rel=1e-13)
    with pytest.raises(InputError, match="more nodes"):
        belt.polygon_ratio(1.0, 3.0, 1)


def test_up_and_down_give_mu_without_the_dead_load():
    up, down = 0.5 * belt.tension_ratio(0.21, 2.87), 0.5 / belt.tension_ratio(0.21, 2.87)
    assert belt.loop_friction(up, down, 2.87) == pytest.approx(0.21)
    assert belt.normal_force(4e5, 19_000.0) == pytest.approx(21.05, rel=1e-3)


def test_howell_and_adhesion():
    assert belt.howell_friction(8.0, 0.2, 1.0) == pytest.approx(1.6)
    assert belt.howell_friction(8.0, 0.2, 2 / 3) == pytest.approx(0.8)
    for n in (0.6, 1.1):
        with pytest.raises(InputError, match="from 2/3 to 1"):
            belt.howell_friction(1.0, 0.2, n)
    assert belt.pull_off_force(0.2, 80.0) == pytest.approx(150.8, rel=1e-3)  # nN: R 0.2 um, gamma 80 mJ/m2


@pytest.mark.parametrize(
    "bad",
    [
        lambda: belt.tension_ratio(-0.1, 1.0),
        lambda: belt.tension_ratio(0.2, float("nan")),
        lambda: belt.friction_coefficient(0.0, 1.0),
        lambda: belt.friction_coefficient(1.0, 0.0),
    ],
)
def test_values_out_of_range_are_named(bad):
    with pytest.raises(InputError):
        bad()


# --- tables ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("filaments", sorted(tows.TABLE_3_1))
def test_the_interpolator_goes_through_the_table(filaments):
    mean, deviation = tows.TABLE_3_1[filaments]
    for degrees, mu, s in zip(tows.ANGLES_DEG, mean, deviation, strict=True):
        f = tows.tow_friction(math.radians(degrees), filaments)
        assert (f.mu, f.deviation) == pytest.approx((mu, s))
        assert f.interval == pytest.approx(1.96 * s / math.sqrt(10))


def test_printed_values_and_folding():
    assert tows.tow_friction(0.0).mu == 0.429 and tows.tow_friction(math.pi / 2).mu == pytest.approx(0.23)
    assert tows.tow_friction(0.0, table="3-6").mu == 0.42
    assert tows.tow_friction(math.radians(80), table="3-6").interval >= tows.ROUNDING
    for angle in (0.3, -0.3, math.pi - 0.3, math.pi + 0.3):
        assert tows.tow_friction(angle).mu == pytest.approx(tows.tow_friction(0.3).mu)


@given(st.floats(0, math.pi / 2), st.floats(1500, 12000))
def test_between_the_points_it_stays_within_them_and_says_how_sure(angle, filaments):
    f = tows.tow_friction(angle, filaments)
    k = min(int(np.searchsorted(tows.ANGLES_DEG, math.degrees(angle), side="right")), len(tows.ANGLES_DEG) - 1)
    near = [m[i] for m, _ in tows.TABLE_3_1.values() for i in (k - 1, k)]
    assert min(near) - 1e-9 <= f.mu <= max(near) + 1e-9
    assert 0 < f.interval < 0.05 and 0.002 <= f.deviation <= 0.024


def test_no_value_outside_the_tests(tmp_path):
    for call in (
        lambda: tows.tow_friction(0.1, 1000),
        lambda: tows.tow_friction(0.1, 24000),
        lambda: tows.tow_friction(0.1, 6000, "3-6"),
        lambda: tows.tow_friction(float("nan")),
        lambda: tows.tow_friction(0.1, 6000, "3-7"),
        lambda: tows.write_angle_table(tmp_path / "t", rows=1),
    ):
        with pytest.raises(InputError):
            call()


def test_the_table_for_a_deck_reads_back(tmp_path):
    tows.write_angle_table(tmp_path / "friction.txt", 6000, rows=19)
    rows = np.loadtxt(tmp_path / "friction.txt")
    assert rows.shape == (19, 3) and rows[0, 1] == 0.438 and rows[-1, :2].tolist() == [90, 0.21]
    assert rows[3, 1] == pytest.approx(tows.tow_friction(math.radians(15), 6000).mu)
