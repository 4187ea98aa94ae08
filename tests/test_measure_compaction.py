import numpy as np
import pytest

from cgfibre.errors import InputError
from cgfibre.measure import compaction as cp


def test_pressure_is_kpa_from_nn_and_um2():
    # 12 N on 7 mm x 0.5 mm: 3.4286 MPa
    assert cp.pressure(12e9, 7000.0 * 500.0) == pytest.approx(3428.5714, rel=1e-7)


def test_pressure_refuses_no_area():
    with pytest.raises(InputError, match="area"):
        cp.pressure([1.0, 1.0], [1.0, 0.0])


def test_volume_fraction_of_square_packing():
    # n x n touching discs fill pi/4 of their square
    assert cp.fibre_volume_fraction(25, 7.0, 35.0, [35.0, 70.0]) == pytest.approx([np.pi / 4, np.pi / 8])


def test_strain():
    assert cp.compressive_strain([0.0, 10.0], 40.0) == pytest.approx([0.0, 0.25])
    with pytest.raises(InputError, match="initial_thickness"):
        cp.compressive_strain([1.0], 0.0)


def test_power_law_recovered_from_the_thesis_exponent():
    p = np.geomspace(0.1, 50, 40)
    law = cp.fit_power_law(p, 0.31 * p**0.23)
    assert (law.a, law.b) == pytest.approx((0.31, 0.23), rel=1e-12)
    assert law.a_error < 1e-9 and law.b_error < 1e-9
    assert law.window == pytest.approx((0.1, 50)) and law.n_points == 40
    assert law.r_squared == pytest.approx(1)


def test_power_law_errors_cover_the_truth():
    """Standard errors: over many noisy records the truth lies within one of them in 68 % of cases."""
    rng = np.random.default_rng(5)
    p = np.geomspace(0.1, 50, 30)
    hits = []
    for _ in range(400):
        law = cp.fit_power_law(p, 0.3 * p**0.2 * np.exp(rng.normal(0, 0.05, 30)))
        hits.append((abs(law.a - 0.3) < law.a_error, abs(law.b - 0.2) < law.b_error))
    # binomial s.d. is 2.3 %, three of them
    assert np.mean(hits, axis=0) == pytest.approx([0.68, 0.68], abs=0.07)


def test_power_law_window_leaves_out_the_rest():
    p = np.geomspace(0.01, 50, 60)
    strain = np.where(p < 1, 0.9 * p**0.7, 0.3 * p**0.2)
    law = cp.fit_power_law(p, strain, window=(1.0, 40.0))
    assert (law.a, law.b) == pytest.approx((0.3, 0.2))
    assert law.window[0] >= 1 and law.window[1] <= 40 and law.n_points < 60


def test_power_law_needs_positive_samples():
    with pytest.raises(InputError, match="window"):
        cp.fit_power_law([0.0, -1.0, 1.0, 2.0], [0.1, 0.2, 0.3, 0.4])


def test_power_law_modulus_is_the_slope_of_its_inverse():
    law = cp.fit_power_law(np.geomspace(0.1, 50, 40), 0.31 * np.geomspace(0.1, 50, 40) ** 0.23)
    eps = np.linspace(0.2, 0.7, 6)
    assert law.strain(law.pressure(eps)) == pytest.approx(eps)
    h = 1e-6
    assert law.modulus(eps) == pytest.approx((law.pressure(eps + h) - law.pressure(eps - h)) / (2 * h), rel=1e-6)


def test_numerical_modulus_converges_on_the_closed_form():
    law = cp.fit_power_law(np.geomspace(0.1, 50, 40), 0.31 * np.geomspace(0.1, 50, 40) ** 0.23)
    errors = []
    for n in (101, 201, 401):
        eps = np.linspace(0.3, 0.6, n)
        slope = cp.tangent_modulus(eps, law.pressure(eps))
        errors.append(np.max(np.abs(slope / law.modulus(eps) - 1)[3:-3]))
    # second order in the spacing
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.1)
    assert errors[1] / errors[2] == pytest.approx(4, rel=0.1)


def test_numerical_modulus_of_a_line_is_exact_to_the_ends():
    eps = np.sort(np.random.default_rng(1).random(20))
    assert cp.tangent_modulus(eps, 3 * eps + 1, window=7) == pytest.approx(np.full(20, 3.0))
    assert np.isnan(cp.tangent_modulus(np.ones(5), np.arange(5.0), window=3)).all()


@pytest.mark.parametrize("window", [1, 4, 21])
def test_numerical_modulus_refuses_a_window(window):
    with pytest.raises(InputError, match="window"):
        cp.tangent_modulus(np.arange(20.0), np.arange(20.0), window=window)


def test_lengths_must_agree():
    with pytest.raises(InputError, match="strain"):
        cp.fit_power_law(np.ones(4), np.ones(5))


def test_poisson_ratio_of_an_incompressible_section():
    thickness = np.array([70.0, 69.0, 60.0])
    width = 700.0 * 70.0 / thickness
    nu = cp.poisson_ratio(width, thickness)
    assert np.isnan(nu[0])
    # w t constant: nu = t0/t
    assert nu[1:] == pytest.approx(70 / thickness[1:])


def test_hysteresis_of_a_triangle():
    # up along F = 2u to (3, 6), down along F = 4u - 6 to (1.5, 0): the triangle has area 4.5
    u, f = [0, 1, 3, 3, 1.5], [0, 2, 6, 6, 0]
    loop = cp.hysteresis(u, f, np.array([0, 0, 0, 1, 2]))
    assert (loop.loading, loop.unloading) == pytest.approx((9, 4.5))
    assert (loop.loss, loop.fraction) == pytest.approx((4.5, 0.5))


def test_hysteresis_of_an_ellipse():
    t = np.linspace(np.pi, -np.pi, 2001)
    loop = cp.hysteresis(5 + 3 * np.cos(t), 7 + 2 * np.sin(t), np.where(t >= 0, 0, 2))
    assert loop.loss == pytest.approx(np.pi * 3 * 2, rel=1e-5)


def test_hysteresis_without_unloading_and_with_disorder():
    loop = cp.hysteresis([0, 1], [0, 2], np.array([0, 0]))
    assert (loop.loading, loop.unloading) == (1, 0)
    assert np.isnan(cp.hysteresis([0, 0], [0, 2], np.array([0, 0])).fraction)
    with pytest.raises(InputError, match="phase"):
        cp.hysteresis([0, 1, 2], [0, 1, 2], np.array([0, 2, 0]))


def test_thickness_at_pressure():
    thickness = np.array([50.0, 40, 30, 25, 20])
    pressure = np.array([1.0, 3, 2, 4, 8])  # falls once, as where a column buckles
    got = cp.thickness_at_pressure(thickness, pressure, [0.5, 1, 2, 3, 3.5, 8, 9])
    assert got == pytest.approx([np.nan, 50, 45, 40, 26.25, 20, np.nan], nan_ok=True)
    assert cp.thickness_at_pressure(thickness, pressure, 2.0).shape == ()
