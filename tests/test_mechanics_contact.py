"""Contact closed forms against the thesis' checked numbers, lammps-findings, limits and direct integration."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import ellipe, ellipk

from cgfibre.errors import InputError
from cgfibre.mechanics import contact
from cgfibre.mechanics.contact import LineContact

R, E, NU = 3.5, 1e7, 0.3
N_PER_MM = 1e6  # nN/um

CARBON = LineContact.between(R, R, E, NU, E, NU)
PLATEN = LineContact.on_rigid_plane(R, E, NU)


def test_thesis_case() -> None:
    # F = 2 N on l = 1 mm: b = 0.90 um and pmax = 1414 MPa (App D); the printed b = 5.25e-3 mm is wrong
    f = 2 * N_PER_MM
    assert CARBON.half_width(f) == pytest.approx(0.90, abs=5e-3)
    assert CARBON.peak_pressure(f) == pytest.approx(1414e3, rel=5e-4)
    assert CARBON.peak_pressure(f) == pytest.approx(2 * f / (np.pi * CARBON.half_width(f)))
    assert CARBON.half_width(f) < R < 5.25


def test_pressure_carries_the_load() -> None:
    f = 2 * N_PER_MM
    b = float(CARBON.half_width(f))
    carried, _ = quad(lambda y: float(CARBON.pressure(y, f)), -b, b)
    assert carried == pytest.approx(f, rel=1e-6)
    assert CARBON.pressure([0.0, 0.6 * b, b, 2 * b], f) / CARBON.peak_pressure(f) == pytest.approx([1, 0.8, 0, 0])


def test_modulus_and_secant_of_carbon() -> None:
    # lammps-findings: E* = 5.49 GPa; k' = 1.8, 2.3, 3.3 GPa at 0.01, 0.1, 1 N/mm. For 10 N/mm they print 5.7: the
    # formula they state gives b = 2.015 um and pi E*/(2 ln(14/2.015) - 1) = 6.00 GPa
    assert CARBON.modulus == pytest.approx(5.49e6, rel=1e-3)
    k = CARBON.secant_stiffness(np.array([0.01, 0.1, 1, 10]) * N_PER_MM)
    assert k == pytest.approx([1.8e6, 2.3e6, 3.3e6, 6.0e6], rel=0.021)
    assert CARBON.half_width(10 * N_PER_MM) / R == pytest.approx(0.58, abs=5e-3)


def test_approach_is_the_compression_of_both_half_cylinders() -> None:
    """Strain under a Hertz pressure, integrated from the contact to the axis (McEwen's stresses, plane strain)."""
    f = 1.0 * N_PER_MM
    b, p0 = float(CARBON.half_width(f)), float(CARBON.peak_pressure(f))

    def strain(z: float) -> float:
        root = np.sqrt(1 + (z / b) ** 2)
        along = -p0 / root
        across = -p0 * ((1 + 2 * (z / b) ** 2) / root - 2 * z / b)
        # the far load of the opposite contact adds 2 f/pi (1/(2 R - z) - 1/(2 R)) and 1/(2 R) of even tension
        along += -2 * f / np.pi * (1 / (2 * R - z) - 1 / (2 * R))
        across += f / (np.pi * R)
        return -((1 - NU**2) * along - NU * (1 + NU) * across) / E

    one, _ = quad(strain, 0, R, limit=200)
    # Johnson's expansion drops terms of (b/R)^2 = 3 %
    assert CARBON.approach(f) == pytest.approx(2 * one, rel=0.01)


def test_approach_of_equal_cylinders_is_the_stated_formula() -> None:
    f = np.geomspace(1e-6, 10, 20) * N_PER_MM
    b = np.sqrt(4 * f * (R / 2) / (np.pi * CARBON.modulus))
    want = f / (np.pi * CARBON.modulus) * (2 * np.log(4 * R / b) - 1)
    assert CARBON.approach(f) == pytest.approx(want, rel=1e-12)
    assert CARBON.approach(0.0) == 0


def test_platen_is_half_of_a_pair() -> None:
    f = np.geomspace(1e-3, 10, 8) * N_PER_MM
    assert PLATEN.approach(f) == pytest.approx(CARBON.approach(f) / 2, rel=1e-12)
    assert PLATEN.half_width(f) == pytest.approx(CARBON.half_width(f), rel=1e-12)


def test_unlike_cylinders() -> None:
    f = 1.0 * N_PER_MM
    E2, nu2, r2 = 7e7, 0.2, 8.0
    pair = LineContact.between(R, r2, E, NU, E2, nu2)
    b = float(pair.half_width(f))
    c = (1 - NU**2) / E, (1 - nu2**2) / E2
    want = sum(ci * f / np.pi * (2 * np.log(4 * r / b) - 1) for ci, r in zip(c, (R, r2), strict=True))
    assert pair.approach(f) == pytest.approx(want, rel=1e-12)
    assert LineContact.between(r2, R, E2, nu2, E, NU).approach(f) == pytest.approx(want, rel=1e-12)
    # a steel-hard partner is the rigid plane once it is flat
    hard = LineContact.between(R, 1e9, E, NU, 1e18, 0.3)
    assert hard.approach(f) == pytest.approx(PLATEN.approach(f), rel=1e-6)


@pytest.mark.parametrize("pair", [CARBON, PLATEN])
def test_inverse(pair: LineContact) -> None:
    # at the very top of delta(f) the load is only known to the square root of the rounding
    delta = np.concatenate([[0.0], np.geomspace(1e-12, pair.greatest_approach * (1 - 1e-6), 60)])
    f = pair.line_load(delta)
    assert np.all(np.diff(f) > 0)
    assert f[0] == 0
    assert pair.approach(f) == pytest.approx(delta, rel=1e-10, abs=0)
    top = pair.half_width(pair.line_load(pair.greatest_approach))
    assert top == pytest.approx(4 * pair.log_radius / np.e, rel=1e-5)
    load = np.geomspace(1e-6, 10, 12) * N_PER_MM
    assert pair.line_load(pair.approach(load)) == pytest.approx(load, rel=1e-9)
    assert pair.line_load(pair.approach(load).reshape(3, 4)).shape == (3, 4)


def test_tangent_is_the_derivative() -> None:
    f = 0.5 * N_PER_MM
    slope = 2 * 1e-3 * f / (CARBON.approach(f * 1.001) - CARBON.approach(f * 0.999))
    assert CARBON.tangent_stiffness(f) == pytest.approx(slope, rel=1e-6)
    assert CARBON.tangent_stiffness(f) > CARBON.secant_stiffness(f)


def test_roark() -> None:
    f = 1.0 * N_PER_MM
    full = 2 * CARBON.half_width(f)
    # Roark writes b = 1.60 sqrt(p K_D C_E) for the full width, K_D = D1 D2/(D1 + D2), C_E = 1/E*
    assert full == pytest.approx(1.60 * np.sqrt(f * 2 * R * 2 * R / (4 * R) / CARBON.modulus), rel=3e-3)
    want = 2 * f * (1 - NU**2) / (np.pi * E) * (2 / 3 + 2 * np.log(2 * 2 * R / full))
    assert CARBON.roark_approach(f) == pytest.approx(want, rel=1e-12)
    assert CARBON.roark_approach(f) / CARBON.approach(f) == pytest.approx(1.054, abs=1e-3)


# --- crossing


def test_crossed_cylinders_are_a_sphere_on_a_plane() -> None:
    assert contact.crossing_prefactor(CARBON.modulus, R, R) == pytest.approx(4 / 3 * CARBON.modulus * np.sqrt(R))


@pytest.mark.parametrize(("r2", "angle"), [(R, 0.02), (R, 0.4), (R, 1.2), (9.0, np.pi / 2), (9.0, 0.7)])
def test_crossing_at_an_angle(r2: float, angle: float) -> None:
    """Every contact ellipse obeys Johnson's 4.26 with its own gap; solved here from the ellipse to the angle."""
    C = contact.crossing_prefactor(1.0, R, r2, angle)
    # undeformed gap A x^2 + B y^2 as the eigenvalues of the summed curvatures
    H = np.diag([0, 1 / (2 * R)]).astype(float)
    c, s = np.cos(angle), np.sin(angle)
    H += np.array([[s * s, -s * c], [-s * c, c * c]]) / (2 * r2)
    A, B = np.linalg.eigvalsh(H)
    q = np.exp(np.linspace(np.log(1e-4), np.log(1 - 1e-9), 400_001))
    m = 1 - q**2
    K, El = ellipk(m), ellipe(m)
    q0 = np.interp(-B / A, -(El / q**2 - K) / (K - El), q)
    m0 = 1 - q0**2
    a3_per_force = 3 * (ellipk(m0) - ellipe(m0)) / (2 * np.pi * m0 * A)
    delta = 3 / (2 * np.pi) * ellipk(m0) / np.cbrt(a3_per_force)
    assert C == pytest.approx(delta**-1.5, rel=1e-6)


def test_crossing_stiffens_towards_parallel() -> None:
    C = contact.crossing_prefactor(1.0, R, R, np.array([0.01, 0.1, 0.5, 1.0, np.pi / 2]))
    assert np.all(np.diff(C) < 0)


def test_engine_s_hertz_gives_the_crossing_force() -> None:
    C = contact.crossing_prefactor(CARBON.modulus, R, R)
    k = contact.hertz_coefficient(C, R, R)
    assert k == pytest.approx(np.sqrt(2) * 4 / 3 * CARBON.modulus)
    # hertz/material: k_n = 4/3 E_eff with 1/E_eff = 2 (1 - nu^2)/E
    stated = contact.hertz_material_modulus(k, NU)
    assert stated == pytest.approx(np.sqrt(2) * E)
    assert 4 / 3 * contact.contact_modulus(stated, NU, stated, NU) == pytest.approx(k)


def test_mindlin() -> None:
    G = E / (2 * (1 + NU))
    g = contact.mindlin_modulus(G, NU, G, NU)
    ratio = contact.tangential_ratio(CARBON.modulus, g)
    assert ratio == pytest.approx(2 * (1 - NU) / (2 - NU))
    assert ratio == pytest.approx(0.8, abs=0.03)
    assert contact.mindlin_stiffness(g, 0.5) == pytest.approx(4 * g)
    # spheres: k_n = 4/3 E* has the coefficient 8 G*
    assert contact.mindlin_coefficient(4 / 3 * CARBON.modulus, ratio) == pytest.approx(8 * g)
    # tangential over tangent normal stiffness of a crossing, both as the engine computes them
    delta, r_eff = 0.01, R / 2
    k = contact.hertz_coefficient(contact.crossing_prefactor(CARBON.modulus, R, R), R, R)
    kt = contact.mindlin_coefficient(k, ratio) * np.sqrt(r_eff * delta)
    assert kt == pytest.approx(contact.mindlin_stiffness(g, np.sqrt(R * delta)))


def test_rigid_partner() -> None:
    assert contact.contact_modulus(E, NU, np.inf, 0.0) == pytest.approx(E / (1 - NU**2))
    assert contact.relative_radius(R, np.inf) == pytest.approx(R)


# --- damping, overlap, bumps


def test_damping_ratio_is_that_of_the_pair() -> None:
    k, m1, m2, zeta = 3e5, 100.0, 300.0, 0.3
    gamma = contact.damping_coefficient(zeta, k, m1, m2)
    # relative motion of two free beads: eigenvalues -omega (zeta +- i sqrt(1 - zeta^2))
    mass = np.diag([m1, m2])
    couple = np.array([[1.0, -1.0], [-1.0, 1.0]])
    spring, dashpot = np.linalg.solve(mass, k * couple), np.linalg.solve(mass, gamma * couple)
    first = np.block([[np.zeros((2, 2)), np.eye(2)], [-spring, -dashpot]])
    fast = max(np.linalg.eigvals(first), key=abs)
    assert -fast.real / abs(fast) == pytest.approx(zeta)
    assert contact.damping_coefficient(1.0, k, m1) == pytest.approx(2 * np.sqrt(k * m1))


def test_overlap() -> None:
    f = 1.0 * N_PER_MM
    kn = CARBON.secant_stiffness(f) * 7.0
    assert contact.relative_overlap(f * 7.0, kn, 7.0) == pytest.approx(CARBON.approach(f) / 7)


def test_bumps() -> None:
    D, mu = 7.0, 0.2
    assert contact.nested_distance(D, D) == pytest.approx(np.sqrt(3) / 2 * D)
    assert contact.nested_distance(1e-6, D) == pytest.approx(D)
    peak = contact.bump_friction(mu, D / np.array([1, 2, 4, 8]), D)
    # measured with the engine (lammps-findings): 0.81, 0.46, 0.32, 0.25
    assert peak == pytest.approx([0.81, 0.46, 0.32, 0.25], rel=0.09)
    assert np.all(peak > [0.81, 0.46, 0.32, 0.25])
    assert contact.bump_friction(mu, 1e-9, D) == pytest.approx(mu)
    # balance on the flank: pull and load resolved along and normal to the slope
    slope = np.arcsin(0.25)
    along, normal = peak[1] * np.cos(slope) - np.sin(slope), peak[1] * np.sin(slope) + np.cos(slope)
    assert along == pytest.approx(mu * normal)


@pytest.mark.parametrize(
    ("call", "key"),
    [
        (lambda: LineContact.between(R, R, -E, NU, E, NU), "E1"),
        (lambda: LineContact.between(R, R, E, NU, np.inf, NU), "E2"),
        (lambda: LineContact.between(R, np.inf, E, NU, E, NU), "r2"),
        (lambda: LineContact.on_rigid_plane(0.0, E, NU), "radius"),
        (lambda: CARBON.approach(-1.0), "line_load"),
        (lambda: CARBON.approach(1e12), "line_load"),
        (lambda: CARBON.secant_stiffness(0.0), "line_load"),
        (lambda: CARBON.tangent_stiffness(1e12), "line_load"),
        (lambda: CARBON.line_load(1.01 * CARBON.greatest_approach), "approach"),
        (lambda: CARBON.line_load(-1e-9), "approach"),
        (lambda: contact.crossing_prefactor(E, R, R, 0.0), "angle"),
        (lambda: contact.crossing_prefactor(E, R, R, 2.0), "angle"),
        (lambda: contact.nested_distance(14.0, 7.0), "spacing"),
        (lambda: contact.bump_friction(0.6, 13.0, 7.0), "spacing"),
        (lambda: contact.damping_coefficient(-0.1, 1.0, 1.0), "ratio"),
    ],
)
def test_bad_input_names_the_key(call: object, key: str) -> None:
    with pytest.raises(InputError) as caught:
        call()  # type: ignore[operator]
    assert caught.value.key == key
