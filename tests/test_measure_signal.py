"""Friction coefficients from synthetic signals with known ones."""

import math

import numpy as np
import pytest
from friction_signals import FREQUENCY, LAW, T1, WRAP, stick_slip_signal

from cgfibre.errors import InputError
from cgfibre.measure import signal as sig
from cgfibre.measure.signal import TestRig

RIG = TestRig(T1, WRAP)


@pytest.mark.parametrize("seed", [0, 1])
def test_coefficients_of_a_noisy_signal(seed):
    f = sig.trial_friction(*stick_slip_signal(seed), RIG)
    mean = np.mean(LAW.coefficient(np.linspace(25, 25 + 50 * LAW.cycle_length, 100_001)))
    assert f.mu == pytest.approx(mean, abs=1e-3)
    assert (f.mu_s, f.mu_k) == pytest.approx((0.18, 0.16), abs=2.5e-3)
    assert f.frequency == pytest.approx(FREQUENCY, abs=1e-3) and f.coherent and f.direction == 1
    swing = math.exp(0.18 * WRAP) - math.exp(0.16 * WRAP)
    assert f.amplitude == pytest.approx(swing / math.exp(mean * WRAP), rel=0.15)
    assert 1 < f.window[0] < 20 and f.window[1] > 170


def test_the_first_peak_is_the_initial_static_friction():
    t = np.arange(0, 20, 0.0025)
    force = T1 * np.exp(LAW.coefficient(160 * t) * WRAP)
    f = sig.trial_friction(t, force, RIG)
    assert f.mu_s0 == pytest.approx(0.22, abs=2e-3)
    assert (f.mu_s, f.mu_k) == pytest.approx((0.18, 0.16), abs=1.5e-3)
    late = sig.trial_friction(t[4000:], force[4000:], RIG)
    assert math.isnan(late.mu_s0)
    # let down, the load pulls: T1/T2, and the lowest tension is the static one
    down = sig.trial_friction(t, T1**2 / force, RIG)
    assert down.direction == -1
    assert (down.mu_s0, down.mu_s, down.mu_k) == pytest.approx((f.mu_s0, f.mu_s, f.mu_k), abs=1e-6)


def test_stick_slip_that_does_not_repeat_is_read_off_its_turning_points():
    rng = np.random.default_rng(4)
    cycle = rng.uniform(0.15, 0.6, 400)
    edges = np.concatenate([[0], np.cumsum(cycle)])
    t = np.sort(rng.uniform(0, edges[-1], 12_000))
    k = np.searchsorted(edges, t, side="right") - 1
    mu = 0.16 + 0.02 * (t - edges[k]) / cycle[np.minimum(k, 399)]
    f = sig.trial_friction(t, T1 * np.exp(WRAP * mu), RIG)
    assert not f.coherent
    assert (f.mu_s, f.mu_k) == pytest.approx((0.18, 0.16), abs=1.5e-3)


def test_the_window_leaves_out_what_is_not_steady():
    t = np.linspace(0, 100, 4000)
    force = np.where(t < 30, 0.5 + 0.02 * t, 1.1) + 0.3 * np.exp(-((t - 92) ** 2))
    lo, hi = sig.steady_window(t, force)
    assert 24 <= lo <= 32 and 86 <= hi <= 92
    given = sig.trial_friction(t, force, RIG, (40.0, 80.0))
    assert given.mu == pytest.approx(math.log(1.1 / T1) / WRAP) and given.window == pytest.approx((40, 80), abs=0.05)
    with pytest.raises(InputError, match="--window"):
        sig.steady_window(t, 0.5 + t)
    with pytest.raises(InputError, match="16 samples or more"):
        sig.trial_friction(t, force, RIG, (200.0, 300.0))
    with pytest.raises(InputError, match="positive tensions"):
        sig.trial_friction(t, force - 1.0, RIG, (10.0, 90.0))


def test_branches_of_the_travel():
    up, down = np.linspace(0, 30, 500), np.linspace(30, 4, 400)
    wobble = 0.5 * np.sin(np.arange(900))
    branches = sig.travel_branches(np.concatenate([up, down]) + wobble)
    assert [b.direction for b in branches] == [1, -1]
    assert branches[0].start == 0 and branches[1].stop == 900 and abs(branches[0].stop - 500) < 15
    assert [b.direction for b in sig.travel_branches(-up)] == [-1]
    assert len(sig.travel_branches(np.concatenate([up, down, up]))) == 3
    with pytest.raises(InputError):
        sig.travel_branches(np.ones(50))


def test_means_over_trials_have_the_thesis_interval():
    x = [0.221, 0.225, 0.231, 0.228, 0.235, 0.229, 0.222, 0.226, 0.233, 0.230]
    m = sig.mean_interval(x)
    assert (m.mean, m.n) == (pytest.approx(0.228), 10)
    assert m.interval == pytest.approx(1.96 * np.std(x, ddof=1) / math.sqrt(10))
    assert math.isnan(sig.mean_interval([0.2]).interval)
    assert sig.mean_interval([0.2, math.nan, 0.4]).n == 2
    assert sig.mean_interval([math.nan]).n == 0


def test_regression_over_wraps():
    wrap = np.array([2.87, 3.57, 4.92])
    r = sig.wrap_regression(wrap, 0.23 * wrap)
    assert r.mu == pytest.approx(0.23) and r.interval == pytest.approx(0, abs=1e-12) and r.r_squared == pytest.approx(1)
    rng = np.random.default_rng(0)
    inside = 0
    for _ in range(300):
        theta = np.repeat(wrap, 4)
        r = sig.wrap_regression(theta, 0.23 * theta + rng.normal(0, 0.03, 12))
        inside += abs(r.mu - 0.23) < r.interval
    assert 0.91 < inside / 300 < 0.985
    shifted = sig.wrap_regression(np.repeat(wrap, 4), 0.1 + 0.2 * np.repeat(wrap, 4) + rng.normal(0, 1e-3, 12))
    assert not shifted.belt_law_holds and shifted.slope == pytest.approx(0.2, abs=2e-3)
    with pytest.raises(InputError, match="two wraps"):
        sig.wrap_regression([2.0, 2.0], [0.4, 0.5])


def test_a_rig_that_cannot_be_is_refused():
    for bad in ((0.0, 1.0), (1.0, -1.0), (math.nan, 1.0)):
        with pytest.raises(InputError):
            TestRig(*bad)
