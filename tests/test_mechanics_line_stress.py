"""Stresses and compliance of line contacts, transversely isotropic filaments, crossings, Howell, adhesion."""

import numpy as np
import pytest
from scipy.integrate import dblquad, quad

from cgfibre.errors import InputError
from cgfibre.mechanics import contact, line_stress, surface_friction
from cgfibre.mechanics.contact import LineContact
from cgfibre.mechanics.line_stress import crossing_ellipse, indentation_moduli, plane_strain_poisson, subsurface_stress

R, E1, E2, NU12, NU23, G12 = 3.5, 230e6, 10e6, 0.256, 0.3, 27.3e6


# --- the thesis' case (6-8, App D): F = 2 N, l = 1 mm, r = 3.5 um, E = 10 GPa, nu = 0.3 -------------------------------


def test_the_thesis_case():
    pair = LineContact.between(R, R, 10e6, 0.3, 10e6, 0.3)
    f = 2e6
    assert pair.half_width(f) == pytest.approx(0.90, abs=0.003)  # printed 5.25: an erratum
    assert pair.peak_pressure(f) == pytest.approx(1.414e6, rel=1e-3)  # kPa
    assert pair.pressure(0.0, f) == pytest.approx(pair.peak_pressure(f))
    load, _ = quad(lambda y: float(pair.pressure(y, f)), -1, 1, points=[-0.9, 0.9])
    assert load == pytest.approx(f, rel=1e-6)


# --- stresses inside --------------------------------------------------------------------------------------------------


def test_on_the_axis():
    """Johnson 4.46: across -p0 ((1 + 2 z^2)/sqrt(1 + z^2) - 2 z), normal -p0/sqrt(1 + z^2), in half widths."""
    z = np.array([1e-6, 0.3, 0.7862, 2.0, 5.0])
    s = subsurface_stress(0.0, z * 1.7, 1.7, 900.0)
    assert s.across == pytest.approx(-900 * ((1 + 2 * z**2) / np.sqrt(1 + z**2) - 2 * z), rel=1e-6)
    assert s.normal == pytest.approx(-900 / np.sqrt(1 + z**2), rel=1e-6)
    assert np.abs(s.shear).max() < 1e-9
    fine = np.linspace(0.5, 1.1, 6001)
    shear = subsurface_stress(0.0, fine, 1.0, 1.0).greatest_shear
    assert fine[np.argmax(shear)] == pytest.approx(line_stress.SHEAR_DEPTH, abs=2e-4)
    assert shear.max() == pytest.approx(line_stress.SHEAR_PEAK, abs=1e-4)


def test_on_the_surface():
    y = np.array([-2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 3.0])
    s = subsurface_stress(y, 0.0, 1.0, 10.0)
    assert s.normal == pytest.approx(-10 * np.sqrt(np.maximum(1 - y**2, 0)), abs=1e-9)
    assert s.across == pytest.approx(s.normal, abs=1e-9)
    assert s.shear == pytest.approx(np.zeros(7), abs=1e-9)


def test_stresses_are_in_equilibrium():
    """d(across)/dy + d(shear)/dz = 0 and d(shear)/dy + d(normal)/dz = 0 everywhere inside."""
    h = 1e-5
    for y, z in ((0.3, 0.2), (-0.8, 0.5), (1.4, 0.7), (-2.0, 1.5)):
        east, west = (subsurface_stress(y + d, z, 1.0, 1.0) for d in (h, -h))
        down, up = (subsurface_stress(y, z + d, 1.0, 1.0) for d in (h, -h))
        assert (east.across - west.across) + (down.shear - up.shear) == pytest.approx(0, abs=1e-8)
        assert (east.shear - west.shear) + (down.normal - up.normal) == pytest.approx(0, abs=1e-8)


@pytest.mark.parametrize("depth", [0.1, 1.0, 4.0])
def test_every_depth_carries_the_load(depth):
    load, _ = quad(lambda y: float(subsurface_stress(y, depth, 1.0, 1.0).normal), -400, 400, limit=400, points=[-1, 1])
    assert load == pytest.approx(-np.pi / 2, rel=2e-3)  # p0 b pi/2 = f


# --- sliding along ----------------------------------------------------------------------------------------------------


def test_axial_stiffness_from_the_potential_of_a_disc():
    """The patch against the mean of the section: Neumann's function -(1/pi) ln|x - x'| + r^2/(4 pi), integrated."""
    b = 0.05

    # mean over the contact of the potential of the load t/(pi sqrt(b^2 - y^2)): -(1/pi) ln(b/2)
    def potential(at):
        value, _ = quad(lambda a: -np.log(abs(at - b * np.sin(a)) + 1e-300) / np.pi**2, -np.pi / 2, np.pi / 2,
                        points=[np.arcsin(at / b)], limit=200)  # fmt: skip
        return value

    patch = potential(0.3 * b) + 1 / (4 * np.pi)
    mean, _ = dblquad(
        lambda t, r: r / np.pi * (-np.log(np.sqrt(1 + r * r - 2 * r * np.cos(t))) / np.pi + r * r / (4 * np.pi)),
        0, 1, -np.pi, np.pi,
    )  # fmt: skip
    one = 2 * line_stress.axial_stiffness(1.0, 1.0, 1.0, 1.0, b)
    assert 1 / one == pytest.approx(patch - mean, rel=2e-3)


def test_axial_stiffness_of_carbon():
    pair = LineContact.between(R, R, E2, 0.0534, E2, 0.0534)
    b = pair.half_width(1e6)
    assert line_stress.axial_stiffness(R, R, G12, G12, b) == pytest.approx(17.3e6, rel=5e-3)
    assert line_stress.axial_stiffness(R, R, G12, G12, b) / pair.secant_stiffness(1e6) == pytest.approx(5.6, abs=0.1)
    # unlike filaments are springs in series
    soft = line_stress.axial_stiffness(R, 5.0, G12, 1e6, 0.2)
    one, two = (line_stress.axial_stiffness(r, r, g, g, 0.2) * 2 for r, g in ((R, G12), (5.0, 1e6)))
    assert soft == pytest.approx(1 / (1 / one + 1 / two))


# --- transversely isotropic filaments ---------------------------------------------------------------------------------


def test_plane_strain_of_a_fibre():
    """From the compliances: sigma_1 that keeps eps_1 = 0 leaves (1 - nu12 nu21)/E2 across."""
    S = np.array([[1 / E1, -NU12 / E1, -NU12 / E1], [-NU12 / E1, 1 / E2, -NU23 / E2], [-NU12 / E1, -NU23 / E2, 1 / E2]])
    compliance = S[1, 1] - S[0, 1] ** 2 / S[0, 0]
    nu = plane_strain_poisson(E1, E2, NU12)
    assert nu == pytest.approx(0.0534, abs=1e-4)
    assert contact.contact_modulus(E2, nu, E2, nu) == pytest.approx(1 / (2 * compliance))
    assert contact.contact_modulus(E2, nu, E2, nu) == pytest.approx(5.014e6, rel=1e-3)
    assert plane_strain_poisson(E2, E2, NU23) == pytest.approx(NU23)  # isotropic


def test_approach_of_transversely_isotropic_filaments():
    """McEwen's stresses on the axis with the fibre's own compliances: the stress across the load drops out."""
    nu = float(plane_strain_poisson(E1, E2, NU12))
    pair = LineContact.between(R, R, E2, nu, E2, nu)
    f = 1e4  # b/R = 2 %
    b, p0 = float(pair.half_width(f)), float(pair.peak_pressure(f))
    along, across = (1 - nu**2) / E2, (NU23 + nu**2) / E2

    def strain(z):
        s = subsurface_stress(0.0, z, b, p0)
        normal = float(s.normal) - 2 * f / np.pi * (1 / (2 * R - z) - 1 / (2 * R))
        return -(along * normal - across * (float(s.across) + f / (np.pi * R)))

    one, _ = quad(strain, 0, R, limit=400, points=[b])
    assert pair.approach(f) == pytest.approx(2 * one, rel=2e-3)


def test_indentation_moduli():
    iso = indentation_moduli(E2, E2, 0.3, 0.3, E2 / 2.6)
    assert (iso.along, iso.across) == pytest.approx((E2 / 0.91, E2 / 0.91))
    carbon = indentation_moduli(E1, E2, NU12, NU23, G12)
    assert carbon.across == pytest.approx(15.66e6, rel=1e-3) and carbon.along == pytest.approx(112.1e6, rel=1e-3)
    with pytest.raises(InputError) as caught:
        indentation_moduli(1e6, 100e6, 0.45, 0.45, 1e6)
    assert caught.value.key == "nu12, nu23"


# --- crossings --------------------------------------------------------------------------------------------------------


def test_a_right_angle_is_a_circle():
    F, modulus = 1e3, 5e6
    e = crossing_ellipse(F, modulus, R, R)
    a = np.cbrt(3 * F * R / (4 * modulus))
    assert (e.major, e.minor) == pytest.approx((a, a))
    assert e.peak_pressure == pytest.approx(3 * F / (2 * np.pi * a**2))  # Eq 6-3 with a = b
    assert crossing_ellipse(0.0, modulus, R, R).peak_pressure == 0


@pytest.mark.parametrize(("r2", "angle"), [(R, 0.05), (R, 0.6), (9.0, 1.2)])
def test_ellipse_and_stiffness_agree(r2, angle):
    """F = C delta^1.5 with delta = 3 F K(m)/(2 pi E* a) (Johnson 4.26c)."""
    from scipy.special import ellipkm1

    F, modulus = 500.0, 5e6
    e = crossing_ellipse(F, modulus, R, r2, angle)
    q = e.minor / e.major
    delta = 3 * F * ellipkm1(q**2) / (2 * np.pi * modulus * e.major)
    assert contact.crossing_prefactor(modulus, R, r2, angle) * delta**1.5 == pytest.approx(F, rel=1e-9)
    assert e.peak_pressure == pytest.approx(3 * F / (2 * np.pi * e.major * e.minor))


# --- surfaces ---------------------------------------------------------------------------------------------------------


def test_howell_and_adhesion():
    N = np.geomspace(1, 1e6, 7)
    assert surface_friction.howell_friction(N, 0.2, 1.0) == pytest.approx(0.2 * N)  # Amontons, Eq 2-6
    F = surface_friction.howell_friction(N, 3.0, 0.8)
    assert F[3] == pytest.approx(3.0 * 1000**0.8)
    assert surface_friction.howell_coefficient(N, 3.0, 0.8) == pytest.approx(F / N)
    assert np.all(np.diff(F / N) < 0)
    # a Hertz contact of constant shear strength: F = tau pi a^2 follows N^(2/3)
    area = np.pi * np.cbrt(3 * N * R / (4 * 5e6)) ** 2
    assert surface_friction.howell_friction(N, area[0] / N[0] ** (2 / 3), 2 / 3) == pytest.approx(area)
    # 0.2 um and 80 mJ/m2, thesis 2.5
    assert surface_friction.adhesion_force(0.2, 80.0) == pytest.approx(150.8, abs=0.1)
    # read back from measurements
    from cgfibre.measure.compaction import fit_power_law

    fit = fit_power_law(N, F)
    assert (fit.a, fit.b) == pytest.approx((3.0, 0.8))


@pytest.mark.parametrize(
    ("call", "key"),
    [
        (lambda: surface_friction.howell_friction(1.0, 0.2, 0.5), "n"),
        (lambda: surface_friction.howell_friction(1.0, 0.2, np.nan), "n"),
        (lambda: surface_friction.howell_friction(-1.0, 0.2, 1.0), "normal_force"),
        (lambda: surface_friction.howell_coefficient(0.0, 0.2, 1.0), "normal_force"),
        (lambda: surface_friction.adhesion_force(0.0, 80.0), "radius"),
        (lambda: subsurface_stress(0.0, -1.0, 1.0, 1.0), "depth"),
        (lambda: subsurface_stress(0.0, 1.0, 0.0, 1.0), "half_width"),
        (lambda: line_stress.axial_stiffness(R, R, G12, G12, R), "half_width"),
        (lambda: plane_strain_poisson(0.0, E2, 0.3), "E1"),
        (lambda: crossing_ellipse(1.0, 1e6, R, R, 0.0), "angle"),
        (lambda: crossing_ellipse(1.0, 1e6, R, R, 2.0), "angle"),
    ],
)
def test_bad_input_names_the_key(call, key):
    with pytest.raises(InputError) as caught:
        call()
    assert caught.value.key == key
