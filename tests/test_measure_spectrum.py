"""Spectra against naive sums, scipy and known lines; false alarms counted."""

import numpy as np
import pytest
from friction_signals import FREQUENCY, stick_slip_signal
from scipy.signal import lombscargle

from cgfibre.errors import InputError
from cgfibre.measure import spectrum as sp


@pytest.fixture(scope="module")
def uneven():
    rng = np.random.default_rng(3)
    t = 17.0 + np.sort(rng.uniform(0, 20, 150))
    return t, 2.0 + 0.5 * np.sin(2 * np.pi * 3.1 * t + 1.0) + rng.normal(0, 0.2, 150)


def test_the_common_grid_is_eq_3_4():
    # N = 1293 over 180 s: dt = 0.1393 s, 0 to about 7.2 Hz
    t = np.linspace(0, 180, 1293)
    f = sp.common_grid(t).frequencies
    assert len(f) == 1293 and 180 / 1292 == pytest.approx(0.1393, abs=1e-4)
    assert f[1] == pytest.approx(1 / (1293 * 180 / 1292)) and f[-1] == pytest.approx(1292 / (1293 * 180 / 1292))
    assert sp.common_grid(t, 5).frequencies[::5] == pytest.approx(f)
    assert sp.common_grid(t, 1, highest=3.0).frequencies[-1] == pytest.approx(3.0, abs=0.006)


def test_the_fast_transform_is_the_naive_sum(uneven):
    t, y = uneven
    grid = sp.common_grid(t, 3)
    f = grid.frequencies
    naive = 2 / len(t) * np.abs([np.sum((y - y.mean()) * np.exp(-2j * np.pi * g * t)) for g in f])  # Eq 3-2
    naive[0] = 0
    assert sp.nonuniform_dft(t, y, grid) == pytest.approx(naive, abs=1e-10)


def test_the_expansion_is_the_trapezoidal_rule(uneven):
    t, y = uneven
    grid = sp.common_grid(t, 2)
    span = t[-1] - t[0]
    swing = y - np.trapezoid(y, t) / span
    a, b = (
        np.array([2 / span * np.trapezoid(swing * wave(2 * np.pi * f * t), t) for f in grid.frequencies])
        for wave in (np.cos, np.sin)
    )
    naive = np.hypot(a, b)  # Eq 3-3, App A.3
    naive[0] = 0
    assert sp.fourier_expansion(t, y, grid) == pytest.approx(naive, abs=1e-10)


def test_lomb_scargle_is_the_least_squares_sinusoid(uneven):
    t, y = uneven
    grid = sp.common_grid(t, 4)
    power = sp.lomb_scargle(t, y, grid)
    scipys = lombscargle(t, y, 2 * np.pi * grid.frequencies[1:], floating_mean=True, normalize=True)
    assert power[1:] == pytest.approx(scipys, abs=1e-9)
    f = grid.frequencies[77]
    columns = np.column_stack([np.ones_like(t), np.cos(2 * np.pi * f * t), np.sin(2 * np.pi * f * t)])
    left = np.sum((y - columns @ np.linalg.lstsq(columns, y, rcond=None)[0]) ** 2)
    assert power[77] == pytest.approx(1 - left / np.sum((y - y.mean()) ** 2))
    assert sp.lomb_scargle(t, np.full_like(t, 3.0), grid).max() == 0.0


def test_a_unit_sinusoid_has_unit_amplitude_in_all():
    t = np.linspace(0, 50, 2000)
    y = np.cos(2 * np.pi * 4.0 * t)
    s = sp.all_spectra(t, y, oversampling=40)
    k = int(np.argmin(np.abs(s.frequency - 4.0)))
    assert s.lomb_scargle[k] == pytest.approx(1.0, abs=2e-3)
    assert [s.dft[k], s.expansion[k]] == pytest.approx([1.0, 1.0], abs=2e-3)


def test_white_noise_passes_a_level_as_rarely_as_the_level_says():
    rng = np.random.default_rng(5)
    t = np.sort(rng.uniform(0, 60, 200))
    grid = sp.common_grid(t, 5)
    level = sp.significance_level(0.1, 200, float(t.std()), grid.frequencies[-1])
    passed = np.mean([sp.lomb_scargle(t, rng.normal(size=200), grid).max() > level for _ in range(200)])
    assert 0.03 < passed < 0.16  # a bound: at most 0.1, three standard errors above
    for p in (0.1, 1e-3, 1e-6):
        z = sp.significance_level(p, 200, float(t.std()), 3.0)
        assert sp.false_alarm_probability(z, 200, float(t.std()), 3.0) == pytest.approx(p, rel=1e-6)
    with pytest.raises(InputError):
        sp.significance_level(0.0, 200, 1.0, 3.0)


@pytest.mark.parametrize("seed", range(4))
def test_the_line_of_a_stick_slip_signal_is_found_by_all_three(seed):
    """The bar: 1293 uneven samples, 180 s, gaps, noise: within 0.005 Hz."""
    t, force = stick_slip_signal(seed)
    s = sp.all_spectra(t, force)
    for values in (s.lomb_scargle, s.dft, s.expansion):
        assert sp.peak_frequency(s.frequency, values, (1.0, 6.0)) == pytest.approx(FREQUENCY, abs=1e-3)
    lines = sp.dominant_lines(t, force, (0.1, 7.0))
    assert lines[0].frequency == pytest.approx(FREQUENCY, abs=5 * lines[0].error) and lines[0].error < 5e-4
    assert lines[1].harmonic_of == (0, 2)


def test_errors_of_lines_are_as_large_as_they_say():
    rng = np.random.default_rng(11)
    off = []
    for _ in range(60):
        t = np.sort(rng.uniform(0, 30, 200))
        y = np.sin(2 * np.pi * 2.345 * t) + rng.normal(0, 1.0, 200)
        line = sp.dominant_lines(t, y, (0.2, 5.0), most=1)[0]
        off.append((line.frequency - 2.345) / line.error)
    assert 0.75 < np.std(off) < 1.3


def test_noise_has_no_lines_and_close_lines_are_told_apart():
    rng = np.random.default_rng(2)
    t = np.sort(rng.uniform(0, 100, 800))
    assert sp.dominant_lines(t, rng.normal(size=800), (0.1, 7.0)) == []
    y = np.sin(2 * np.pi * 3.98 * t) + 0.6 * np.sin(2 * np.pi * 4.02 * t) + rng.normal(0, 0.3, 800)
    found = [line.frequency for line in sp.dominant_lines(t, y, (0.1, 7.0))]
    assert found == pytest.approx([3.98, 4.02], abs=2e-3)


def test_a_clock_mirrors_frequencies_and_is_noticed():
    t = np.arange(2000) / 20.0
    assert sp.highest_frequency(t) == pytest.approx(10.0, rel=1e-3)
    kept = np.sort(np.random.default_rng(0).choice(2000, 1500, replace=False))
    assert sp.highest_frequency(t[kept]) == pytest.approx(10.0, rel=1e-3)
    uneven = np.sort(np.random.default_rng(0).uniform(0, 100, 2000))
    assert sp.highest_frequency(uneven) == pytest.approx(20.0, rel=2e-3)


@pytest.mark.parametrize(
    "t, y",
    [
        (np.arange(10.0), np.arange(10.0)),
        (np.arange(20.0), np.arange(21.0)),
        (np.arange(20.0)[::-1], np.arange(20.0)),
        (np.zeros(20), np.arange(20.0)),
        (np.arange(20.0), np.full(20, np.nan)),
    ],
)
def test_what_is_no_signal_is_refused(t, y):
    with pytest.raises(InputError):
        sp.checked(t, y)
