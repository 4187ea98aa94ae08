"""Ensembles against closed forms: Student's interval, Welch's, curves on a grid; the fit of thickness to friction."""

import numpy as np
import pytest
from scipy import stats

from cgfibre.errors import InputError
from cgfibre.measure.ensemble import (
    difference,
    ensemble,
    load_grid,
    load_on,
    mean_of,
    student,
    thickness_on,
)
from cgfibre.measure.friction_power import fit_friction_power, fit_specimens
from cgfibre.mechanics.compaction_laws import THESIS_DRY, THESIS_WET, FrictionPower


def test_mean_and_interval_of_three_numbers_are_those_of_the_tables():
    """1, 2, 3: mean 2, s = 1, t(0.975, 2) = 4.30265, half width 4.30265/sqrt(3)."""
    mean, ci, sd = mean_of([1.0, 2.0, 3.0])
    assert (mean, sd) == (2.0, 1.0)
    assert ci == pytest.approx(4.30265 / np.sqrt(3), rel=1e-5)
    assert student(10) == pytest.approx(2.26216, rel=1e-5)


def test_one_sample_has_no_scatter_and_none_has_no_mean():
    mean, ci, sd = mean_of([5.0])
    assert mean == 5.0 and np.isnan(ci) and np.isnan(sd)
    assert np.isnan(mean_of([])).all()


def test_the_interval_holds_the_true_mean_in_95_of_100_cases():
    rng = np.random.default_rng(0)
    hits = 0
    for _ in range(2000):
        e = ensemble([0.0], rng.normal(3.0, 2.0, (4, 1)))
        hits += abs(e.mean[0] - 3.0) < e.ci[0]
    assert hits / 2000 == pytest.approx(0.95, abs=0.015)  # three standard errors


def test_a_grid_point_that_one_sample_does_not_reach_has_no_mean():
    e = ensemble([1.0, 2.0], [[1.0, 2.0], [3.0, np.nan]])
    assert e.mean[0] == 2.0 and np.isnan(e.mean[1]) and np.isnan(e.ci[1])
    with pytest.raises(InputError, match="samples"):
        ensemble([1.0, 2.0], [[1.0]])


def test_differences_are_welchs():
    rng = np.random.default_rng(1)
    a, b = rng.normal(1.0, 0.1, 5), rng.normal(0.0, 1.0, 9)
    found = difference(a, b)
    theirs = stats.ttest_ind(a, b, equal_var=False).confidence_interval(0.95)
    assert found.value - found.ci == pytest.approx(theirs.low) and found.value + found.ci == pytest.approx(theirs.high)
    assert np.isnan(difference(a, [1.0]).ci) and not difference(a, [1.0]).significant
    assert difference([1.0, 1.0], [2.0, 2.0]).significant


def test_load_and_thickness_of_known_branches():
    """t = 100 - d, F = d^2 up and d^3/10 down: F(5) = 25 and 12.5, t(25) = 95, t(12.5) = 95."""
    d = np.linspace(0, 10, 2001)
    assert load_on(d, d**2, [5.0, 11.0])[0] == pytest.approx(25) and np.isnan(load_on(d, d**2, [11.0])[0])
    back = d[::-1]
    assert load_on(back, back**3 / 10, 5.0) == pytest.approx(12.5)
    assert thickness_on(100 - d, d**2, 25.0) == pytest.approx(95)
    assert thickness_on(100 - back, back**3 / 10, 12.5, unloading=True) == pytest.approx(95)
    assert np.isnan(thickness_on(100 - d, d**2, 101.0))


def test_a_grid_of_loads_is_even_in_the_logarithm():
    assert load_grid(0.1, 10.0, 3) == pytest.approx([0.1, 1.0, 10.0])
    with pytest.raises(InputError, match="lowest"):
        load_grid(1.0, 1.0)


def test_the_thesis_laws_at_its_loads():
    assert THESIS_DRY.thickness(1.0, 0.3) == pytest.approx(0.08)
    assert THESIS_DRY.thickness(10.0, 0.2) == pytest.approx(0.08 * 10 ** (0.024 - 0.21))
    assert THESIS_WET.thickness(10.0, 0.1) == pytest.approx(0.08 * 10**-0.22)


@pytest.mark.parametrize("law", [FrictionPower(0.03, 0.5, 0.3), FrictionPower(0.03, 0.0, 0.3)])
def test_the_fit_finds_the_law_that_made_the_points(law):
    p, mu = np.array([0.1, 1.0, 10.0]), np.array([0.2, 0.3, 0.48])
    t = law.thickness(p[None, :], mu[:, None])
    found, misfit = fit_friction_power(np.broadcast_to(p, t.shape), np.broadcast_to(mu[:, None], t.shape), t)
    assert (found.c, found.a, found.b) == pytest.approx((law.c, law.a, law.b), abs=1e-12) and misfit < 1e-12
    noisy = np.stack([t, t * 1.1])
    fit = fit_specimens(p, mu, noisy)
    assert fit.law.c == pytest.approx(law.c * np.sqrt(1.1)) and fit.a_ci == pytest.approx(0, abs=1e-9)
    assert fit.c_ci == pytest.approx(student(2) * law.c * 0.1 / np.sqrt(2) / np.sqrt(2))
    assert np.isnan(fit_specimens(p, mu, t[None]).c_ci)


def test_a_fit_of_one_friction_is_refused_and_of_one_law_without_friction_is_not():
    p, mu = np.array([0.1, 1.0]), np.array([0.2, 0.2])
    with pytest.raises(InputError, match="two frictions"):
        fit_friction_power(p, mu, [0.03, 0.02])
    assert fit_friction_power(p, mu, [0.03, 0.02], felt=False)[0].b == pytest.approx(np.log10(1.5))
