"""A filament as a rod: section constants, element coefficients, limiting frequencies, static closed forms.

Units: um, us, pg, nN, kPa; EA and kGA in nN, EI and GJ in nN um2, stiffness in nN/um, mass in pg. Arrays broadcast;
scalars in give a numpy scalar. Every function raises :class:`cgfibre.errors.InputError` for a value out of its range.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import factorial

import numpy as np
import numpy.typing as npt
from numpy.polynomial.polynomial import polyval

from cgfibre.errors import InputError
from cgfibre.mechanics._checks import FloatArray, finite, non_negative, poisson, positive

#: limiting omega^2 = CONTACT_BOUND kn / m of a bead in six contacts with kt = 0.8 kn and no spin (see
#: contact_stiffness_bound)
CONTACT_BOUND = 14.0

#: moment of inertia of a bead over m D^2: the engine's spheres, 0.4 m R^2, whatever their mass
SPHERE_INERTIA = 0.1


# --- section ---------------------------------------------------------------------------------------------------------


def circle_area(diameter: npt.ArrayLike) -> FloatArray:
    """Area pi D^2 / 4 of a solid circle, um2."""
    return np.pi * positive("diameter", diameter) ** 2 / 4


def circle_second_moment(diameter: npt.ArrayLike) -> FloatArray:
    """Second moment of area I = pi D^4 / 64 of a solid circle, um4.

    The thesis (Table 4-1) prints this number, 1.18e-10 mm4, as "EI" in N mm2: wrong; EI = 2.711e-5 N mm2 for T700.
    """
    return np.pi * positive("diameter", diameter) ** 4 / 64


def circle_polar_moment(diameter: npt.ArrayLike) -> FloatArray:
    """Torsion constant J = pi D^4 / 32 of a solid circle, um4."""
    return np.pi * positive("diameter", diameter) ** 4 / 32


def circle_shear_coefficient(nu: npt.ArrayLike) -> FloatArray:
    """Shear coefficient kappa = 6 (1 + nu) / (7 + 6 nu) of a solid circle (Cowper 1966)."""
    v = poisson("nu", nu)
    return 6 * (1 + v) / (7 + 6 * v)


# --- element coefficients --------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class ChainCoefficients:
    """What the engine's ``bond harmonic`` K (r - r0)^2 and ``angle cosine`` K (1 + cos theta) take.

    ``bond`` (..., n_bonds) nN/um, half the spring constant; ``angle`` (..., n_angles) nN um, the hinge stiffness
    itself.
    """

    bond: FloatArray
    angle: FloatArray


@dataclass(frozen=True)
class RodCoefficients:
    """``bond bpm/rotational`` in the engine's order: kr, ks (nN/um), kt, kb (nN um); each (..., n_bonds)."""

    kr: FloatArray
    ks: FloatArray
    kt: FloatArray
    kb: FloatArray


def _bond_lengths(lengths: npt.ArrayLike, closed: bool) -> FloatArray:
    s = positive("lengths", lengths)
    least = 3 if closed else 1
    if s.ndim == 0 or s.shape[-1] < least:
        raise InputError("lengths", s.tolist(), f"an array of at least {least} bond length(s)")
    return s


def _angle_sides(s: FloatArray, closed: bool) -> tuple[FloatArray, FloatArray]:
    """Bond before and after each angle; a closed chain has one angle a bead, that of bead 0 first."""
    return (np.roll(s, 1, axis=-1), s) if closed else (s[..., :-1], s[..., 1:])


def chain_coefficients(
    lengths: npt.ArrayLike,
    EA: npt.ArrayLike,
    EI: npt.ArrayLike,
    *,
    closed: bool = False,
    clamped: tuple[bool, bool] = (False, False),
) -> ChainCoefficients:
    r"""Bond and angle coefficients of a chain of beads of any spacing.

    K_bond = EA / (2 s). The turn angle at the bead between bonds s1 and s2 is the curvature weighted with the hat
    function of that bead, phi = int hat w'' dx, hence kappa (s1 + s2)/2 under an even curvature; energy EI kappa^2
    (s1 + s2)/4 makes K_angle = 2 EI / (s1 + s2), EI / s on an even chain. A clamp is two held beads; only the half
    bond beyond it bends, so its hinge has K_angle = 2 EI / s with s the free bond (with EI/s the tip of a cantilever
    errs by 15 % at s = 4 D).

    Parameters
    ----------
    lengths : (..., n_bonds) bond lengths, um
    EA : nN, broadcast against the bonds; EI : nN um2, broadcast against the angles
    closed : the last bond leads back to bead 0; there is an angle at every bead, bead 0 first
    clamped : the first / last two beads are held, so the first / last angle is a clamp hinge

    Returns
    -------
    ChainCoefficients; ``angle`` has n_bonds - 1 entries (closed: n_bonds)
    """
    s = _bond_lengths(lengths, closed)
    if closed and any(clamped):
        raise InputError("clamped", clamped, "(False, False) on a closed chain")
    before, after = _angle_sides(s, closed)
    tributary = (before + after) / 2
    if any(clamped) and s.shape[-1] < 2 + all(clamped):
        raise InputError("lengths", s.tolist(), "at least one free bond beside the held one of every clamp")
    if clamped[0]:
        tributary[..., 0] = s[..., 1] / 2
    if clamped[1]:
        tributary[..., -1] = s[..., -2] / 2
    return ChainCoefficients(bond=positive("EA", EA) / (2 * s), angle=positive("EI", EI) / tributary)


def rod_coefficients(
    lengths: npt.ArrayLike, EA: npt.ArrayLike, EI: npt.ArrayLike, GJ: npt.ArrayLike, kGA: npt.ArrayLike
) -> RodCoefficients:
    """Coefficients of a Timoshenko rod: kr = EA/s, 1/ks = s/kGA + s^3/(12 EI), kt = GJ/s, kb = EI/s.

    ``lengths`` (..., n_bonds) um or a scalar; ``kGA`` nN may be inf (no shear). The s^3/(12 EI) makes the deflection
    of a two-bead element exact (lammps-findings: static bending within 5e-5 of Timoshenko at every s).
    """
    s = positive("lengths", lengths)
    bending = positive("EI", EI)
    return RodCoefficients(
        kr=positive("EA", EA) / s,
        ks=1 / (s / positive("kGA", kGA, infinite=True) + s**3 / (12 * bending)),
        kt=positive("GJ", GJ) / s,
        kb=bending / s,
    )


def axial_strain(tension: npt.ArrayLike, EA: npt.ArrayLike) -> FloatArray:
    """Axial strain P / EA under tension P (nN), over the natural length."""
    return finite("tension", tension) / positive("EA", EA)


def rest_length(length: npt.ArrayLike, tension: npt.ArrayLike, EA: npt.ArrayLike) -> FloatArray:
    """Natural length s / (1 + P/EA) of a bond that carries tension P at length s, um.

    A chain that starts with it is pre-tensioned from the first step (lammps-findings: kinetic energy over work 0.006,
    against 0.4 for a tension switched on at once).
    """
    strain = axial_strain(tension, EA)
    if np.any(strain <= -1):
        raise InputError("tension", float(np.min(finite("tension", tension))), "more than -EA")
    return positive("length", length) / (1 + strain)


# --- limiting frequencies --------------------------------------------------------------------------------------------


def chain_frequency_squared(
    spacing: npt.ArrayLike,
    mass: npt.ArrayLike,
    EA: npt.ArrayLike,
    EI: npt.ArrayLike,
    *,
    tension: npt.ArrayLike = 0.0,
    kn: npt.ArrayLike = 0.0,
) -> FloatArray:
    """Highest omega^2 of an even, straight chain of beads, 1/us2.

    max(4 EA/(s m), 16 EI/(s^3 m) + 4 P/(s m), 14 kn/m): neighbouring beads move against each other along or across the
    chain (the two do not couple while it is straight), or in their contacts. A central-difference step is stable to
    2/omega (measured within 0.4 %; run at 0.6-0.7 of it). The contact term joins the maximum as in lammps-findings;
    to be safe beyond doubt add ``contact_stiffness_bound`` to ``chain_stiffness_bound`` instead.
    """
    s, m = positive("spacing", spacing), positive("mass", mass)
    axial = 4 * positive("EA", EA) / s
    transverse = 16 * positive("EI", EI) / s**3 + 4 * non_negative("tension", tension) / s
    contact = CONTACT_BOUND * non_negative("kn", kn)
    return np.maximum(np.maximum(axial, transverse), contact) / m


def rod_frequency_squared(
    spacing: npt.ArrayLike,
    mass: npt.ArrayLike,
    diameter: npt.ArrayLike,
    coefficients: RodCoefficients,
    *,
    kn: npt.ArrayLike = 0.0,
) -> FloatArray:
    """Highest omega^2 of an even, straight rod of spheres, I = 0.1 m D^2, 1/us2.

    max(4 kr/m, 4 kt/I, bending, 14 kn/m). Bending couples deflection and rotation: with S = sin^2(q/2), a = 4 ks/m,
    b = ks s^2/I, d = 4 kb/I its branches obey w^2 - w (a S + b (1 - S) + d S) + a d S^2 = 0. The ends S = 0, 1 give
    max(a, b, d), the form in lammps-findings; it is no bound where the three are alike: inside, at S* = w (a + d -
    b)/(2 a d) < 1, w = 4 a b d / (4 a d - (a + d - b)^2), up to 4/3 of the maximum. This function takes that into
    account.
    """
    s, m = positive("spacing", spacing), positive("mass", mass)
    inertia = SPHERE_INERTIA * m * positive("diameter", diameter) ** 2
    a, b, d = 4 * coefficients.ks / m, coefficients.ks * s**2 / inertia, 4 * coefficients.kb / inertia
    slope = a + d - b
    gap = 4 * a * d - slope**2
    safe = np.where(gap > 0, gap, 1.0)
    inside = 4 * a * b * d / safe
    valid = (gap > 0) & (slope > 0) & (inside * slope < 2 * a * d)
    bending = np.maximum(np.maximum(a, d), np.maximum(b, np.where(valid, inside, 0.0)))
    other = np.maximum(4 * coefficients.kr / m, 4 * coefficients.kt / inertia)
    return np.maximum(np.maximum(bending, other), CONTACT_BOUND * non_negative("kn", kn) / m)


def _to_beads(first: FloatArray, second: FloatArray, closed: bool) -> FloatArray:
    """Sum over bonds of what each adds to its first and to its second bead: (..., n_bonds) to (..., n_beads)."""
    if closed:
        return first + np.roll(second, 1, axis=-1)
    pad = [(0, 0)] * (first.ndim - 1)
    return np.pad(first, [*pad, (0, 1)]) + np.pad(second, [*pad, (1, 0)])


def chain_stiffness_bound(
    lengths: npt.ArrayLike,
    coefficients: ChainCoefficients,
    tension: npt.ArrayLike = 0.0,
    *,
    closed: bool = False,
    bent: bool = False,
) -> FloatArray:
    r"""Stiffness k_i of every bead so that omega^2 <= max_i k_i / m_i, whatever the masses.

    k_i is the absolute row sum of the stiffness matrix (Gershgorin on M^-1 K), straight chain:

    axial k_i = sum over its bonds of 2 EA/s,
    transverse k_i = sum over its bonds of 2 P/s + sum over its angles of 2 K (1/s1 + 1/s2) |c_i|, where c = 1/s1,
    -(1/s1 + 1/s2), 1/s2 are the coefficients of the turn angle in the beads' deflections.

    The two do not couple, so k_i = max(axial, transverse): 4 EA/s or 16 EI/s^3 + 4 P/s inside an even chain. Beads
    alternate in sign in both matrices, so masses in proportion to either k_i meet its bound exactly (the alternating
    mode is an eigenvector): no tighter one exists. In a curved chain the directions mix: the maximum may then be short
    by 1 % (worst of 400 random crooked graded chains; even arcs and zigzags stay below it), while axial + transverse
    (``bent``) is a bound for any shape.

    Used both ways: :func:`limiting_time_step` for given masses, :func:`mass_for_time_step` for a given step. Contacts
    add :func:`contact_stiffness_bound`. Holding beads still only lowers the frequencies.

    Parameters
    ----------
    lengths : (..., n_bonds) um; coefficients : as the deck has them, see :func:`chain_coefficients`
    tension : nN, broadcast against the bonds, >= 0 (compression lowers the frequencies; give 0)

    Returns
    -------
    (..., n_beads) nN/um; n_beads = n_bonds + 1, closed: n_bonds
    """
    s = _bond_lengths(lengths, closed)
    bond = np.broadcast_to(4 * coefficients.bond, s.shape)
    axial = _to_beads(bond, bond, closed)
    string = np.broadcast_to(2 * non_negative("tension", tension) / s, s.shape)
    transverse = _to_beads(string, string, closed)
    before, after = _angle_sides(s, closed)
    if before.shape[-1]:
        turn = 1 / before + 1 / after
        force = 2 * coefficients.angle * turn
        outer_first, middle, outer_last = force / before, force * turn, force / after
        if closed:
            transverse = transverse + np.roll(outer_first, -1, axis=-1) + middle + np.roll(outer_last, 1, axis=-1)
        else:
            transverse[..., :-2] += outer_first
            transverse[..., 1:-1] += middle
            transverse[..., 2:] += outer_last
    return axial + transverse if bent else np.maximum(axial, transverse)


def rod_stiffness_bound(
    lengths: npt.ArrayLike,
    diameter: npt.ArrayLike,
    coefficients: RodCoefficients,
    tension: npt.ArrayLike = 0.0,
    *,
    closed: bool = False,
) -> FloatArray:
    """Stiffness k_i of every bead of a straight rod so that omega^2 <= max_i k_i / m_i, whatever the masses.

    The beads are spheres, I_i = 0.1 m_i D^2 = m_i rho^2. With v = rho theta and g = s/(2 rho) a bond's shear energy
    is bounded by (w_j - w_i - g (v_i + v_j))^2 <= 2 (w_i + g v_i)^2 + 2 (w_j - g v_j)^2, its other energies likewise,
    so k_i is the larger eigenvalue of the bead's own 2 x 2 matrix [[sum 2 (ks + P/s), +-sum 2 ks g], [., sum 2 (ks
    g^2 + kb/rho^2)]], or its axial sum 2 kr or its torsional sum 2 kt/rho^2. An even rod: max(4 kr, 4 ks, ks
    s^2/rho^2 + 4 kb/rho^2, 4 kt/rho^2).

    Shapes as in :func:`chain_stiffness_bound`; ``diameter`` scalar or (..., 1).
    """
    s = _bond_lengths(lengths, closed)
    rho2 = SPHERE_INERTIA * positive("diameter", diameter) ** 2
    c = coefficients
    arm = s / (2 * np.sqrt(rho2))

    def both(value: FloatArray) -> FloatArray:
        value = np.broadcast_to(2 * value, s.shape)
        return _to_beads(value, value, closed)

    coupling = np.broadcast_to(2 * c.ks * arm, s.shape)
    move = both(c.ks + non_negative("tension", tension) / s)
    turn = both(c.ks * arm**2 + c.kb / rho2)
    mixed = _to_beads(coupling, -coupling, closed)
    bending = (move + turn) / 2 + np.hypot((move - turn) / 2, mixed)
    return np.maximum(bending, np.maximum(both(c.kr), both(c.kt / rho2)))


def contact_stiffness_bound(
    kn: npt.ArrayLike, *, kt_ratio: npt.ArrayLike = 0.8, inertia: npt.ArrayLike = np.inf, neighbours: int = 6
) -> FloatArray:
    """What contacts in a section add to a bead's stiffness bound, nN/um.

    Beads in n = ``neighbours`` evenly spread contacts, all sticking, r = kt/kn. A bead alone feels n kn (1 + r)/2 in
    the section and n r kn out of it; neighbours moving against it double that: n (1 + r) kn or 2 n r kn. Beads that
    may spin, of ``inertia`` = I/(m D^2) (sphere 0.1, disc 0.125, no spin inf), add the mode in which all turn the same
    way: n r kn/(2 I/(m D^2)). Six contacts and r = 0.8: 10.8 kn without spin (lammps-findings
    uses 14), but 19.2 kn for discs and 24 kn for spheres: there spin sets the step.
    """
    k, r = non_negative("kn", kn), non_negative("kt_ratio", kt_ratio)
    if neighbours < 3:
        raise InputError("neighbours", neighbours, "at least 3")
    spin = neighbours * r / (2 * positive("inertia", inertia, infinite=True))
    return k * np.maximum(np.maximum(neighbours * (1 + r), 2 * neighbours * r), spin)


def limiting_time_step(stiffness: npt.ArrayLike, mass: npt.ArrayLike, damping: npt.ArrayLike = 0.0) -> np.float64:
    """Longest stable step of beads with bounds k_i, masses m_i and damping bounds c_i (nN us/um), us: the least of
    :func:`damped_time_step`, 2 sqrt(m/k) without damping."""
    k, m = positive("stiffness", stiffness), positive("mass", mass)
    return np.float64(np.min(damped_time_step(k / m, non_negative("damping", damping) / m)))


def damped_time_step(frequency_squared: npt.ArrayLike, damping_rate: npt.ArrayLike) -> FloatArray:
    r"""Longest stable step of x'' + c x' + omega^2 x = 0, us; ``frequency_squared`` omega^2 > 0, ``damping_rate`` c.

    The engine's velocity-Verlet evaluates a force at the new position and the velocity of half a step before, so z^2 -
    (2 - c h - omega^2 h^2) z + 1 - c h = 0: |z| <= 1 while omega^2 h^2 + 2 c h <= 4,

    h = 4/(c + sqrt(c^2 + 4 omega^2)) = (2/omega) (sqrt(1 + zeta^2) - zeta), zeta = c/(2 omega).

    Damping shortens the step: 0.74 of 2/omega at zeta = 0.3, 0.41 at 1.
    """
    w2, c = positive("frequency_squared", frequency_squared), non_negative("damping_rate", damping_rate)
    return 4 / (c + np.sqrt(c**2 + 4 * w2))


def packed_time_step(
    kn: npt.ArrayLike,
    gamma: npt.ArrayLike,
    mass: npt.ArrayLike,
    *,
    kt_ratio: npt.ArrayLike = 0.8,
    damping_ratio: npt.ArrayLike = 1.0,
    inertia: npt.ArrayLike = np.inf,
    own: npt.ArrayLike = 0.0,
) -> FloatArray:
    """Longest stable step of an endless hexagonal packing of discs whose damped contacts all stick, us.

    r = kt/kn, x = ``damping_ratio`` the tangential over the normal damping ``gamma`` nN us/um, J = ``inertia`` =
    I/(m D^2) (disc 0.125, sphere 0.1, no spin inf); ``own`` omega^2 of what else holds a disc, 1/us2. The least of
    :func:`damped_time_step` over: neighbours a third of a turn out of step in the section, omega^2 = 9/2 (1 + r) kn/m,
    c = 9/2 (1 + x) gamma/m; the same along the filaments, 9 r kn/m, 9 x gamma/m; all spinning alike, 3 r kn/(J m),
    3 x gamma/(J m). Measured within 1.5 % (docs/stability.md).
    """
    k, g, m = non_negative("kn", kn), non_negative("gamma", gamma), positive("mass", mass)
    r, J = positive("kt_ratio", kt_ratio), positive("inertia", inertia, infinite=True)
    x, rest = non_negative("damping_ratio", damping_ratio), non_negative("own", own)
    across = damped_time_step(4.5 * (1 + r) * k / m + rest, 4.5 * (1 + x) * g / m)
    along = damped_time_step(9 * r * k / m + rest, 9 * x * g / m)
    if np.all(np.isinf(J)):
        return np.minimum(across, along)
    return np.minimum(np.minimum(across, along), damped_time_step(3 * r / J * k / m + rest, 3 * x / J * g / m))


def mass_for_time_step(stiffness: npt.ArrayLike, timestep: npt.ArrayLike, *, fraction: float = 1.0) -> FloatArray:
    """Least bead masses that make ``timestep`` ``fraction`` of the limit: m_i = k_i (dt / (2 fraction))^2, pg.

    Mass is a numerical parameter of a quasi-static run; coarse far-field beads may be 1e6 times lighter than rho A s.
    """
    if not 0 < fraction <= 1:
        raise InputError("fraction", fraction, "between 0 and 1")
    return positive("stiffness", stiffness) * (positive("timestep", timestep) / (2 * fraction)) ** 2


# --- functions of a tensioned beam, scaled and without cancellation --------------------------------------------------


def scaled_sinh(x: FloatArray) -> FloatArray:
    """sinh(x) exp(-x) / x, 1 at x = 0; finite to any x >= 0."""
    safe = np.where(x > 0, x, 1.0)
    return np.where(x > 0, -np.expm1(-2 * safe) / (2 * safe), 1.0)


def scaled_cosh(x: FloatArray) -> FloatArray:
    """cosh(x) exp(-x), 1 at x = 0."""
    return (1 + np.exp(-2 * x)) / 2


_SERIES = range(1, 11)


def _cubic(x: FloatArray, series: list[float], whole: FloatArray) -> FloatArray:
    """``series`` in x^2 times exp(-x) below x = 1, where ``whole`` (already scaled) would cancel."""
    return np.where(x < 1, polyval(np.minimum(x, 1.0) ** 2, series) * np.exp(-x), whole)


def scaled_sinh_excess(x: FloatArray) -> FloatArray:
    """6 (sinh x - x) exp(-x) / x^3, 1 at x = 0."""
    big = np.maximum(x, 1.0)
    whole = 6 * (scaled_sinh(big) - np.exp(-big)) / big**2
    return _cubic(x, [6 / factorial(2 * k + 1) for k in _SERIES], whole)


def scaled_bending(x: FloatArray) -> FloatArray:
    """3 (x cosh x - sinh x) exp(-x) / x^3, 1 at x = 0."""
    big = np.maximum(x, 1.0)
    whole = 3 * (scaled_cosh(big) - scaled_sinh(big)) / big**2
    return _cubic(x, [3 * 2 * k / factorial(2 * k + 1) for k in _SERIES], whole)


# --- static closed forms ---------------------------------------------------------------------------------------------


def axial_elongation(force: npt.ArrayLike, length: npt.ArrayLike, EA: npt.ArrayLike) -> FloatArray:
    """Elongation F L / EA, um."""
    return finite("force", force) * positive("length", length) / positive("EA", EA)


def twist_angle(torque: npt.ArrayLike, length: npt.ArrayLike, GJ: npt.ArrayLike) -> FloatArray:
    """Angle of twist T L / GJ, rad."""
    return finite("torque", torque) * positive("length", length) / positive("GJ", GJ)


def cantilever_deflection(
    force: npt.ArrayLike, length: npt.ArrayLike, EI: npt.ArrayLike, *, kGA: npt.ArrayLike = np.inf
) -> FloatArray:
    """Tip deflection F L^3/(3 EI) + F L/kGA of a clamped rod under a tip force (Timoshenko), um."""
    F, L = finite("force", force), positive("length", length)
    return F * (L**3 / (3 * positive("EI", EI)) + L / positive("kGA", kGA, infinite=True))


def platen_compliance(
    length: npt.ArrayLike,
    EI: npt.ArrayLike,
    *,
    width: npt.ArrayLike = 0.0,
    tension: npt.ArrayLike = 0.0,
    kGA: npt.ArrayLike = np.inf,
) -> FloatArray:
    r"""Displacement of a flat rigid platen per its force on a simply supported, pre-tensioned beam, um/nN.

    The beam sags away from the platen between its edges, so it touches at x = a = (L - w)/2 and L - a only, with half
    the force at each. With h = L/2, b = w/2, lambda^2 = P/EI:

    d/F = a/(2 P) - sinh(lambda a) cosh(lambda b) / (2 P lambda cosh(lambda h)),

    exact; evaluated in a form without cancellation, so P = 0 gives a^2 (h + b)/(4 EI) - a^3/(12 EI). w = 0 is
    three-point bending, L/(4P) - tanh(lambda L/2)/(2 P lambda). Shear (Timoshenko with tension, Engesser's form):
    with c = 1/kGA the same expression with EI (1 + P c) for EI, plus c a/2, all over 1 + P c.

    Errors: ``width`` must be less than ``length``, ``tension`` not negative.
    """
    L, w, P = positive("length", length), non_negative("width", width), non_negative("tension", tension)
    if np.any(w >= L):
        raise InputError("width", float(np.max(w)), "less than the span")
    c = 1 / positive("kGA", kGA, infinite=True)
    stiff = positive("EI", EI) * (1 + P * c)
    lam = np.sqrt(P / stiff)
    a, b, h = (L - w) / 2, w / 2, L / 2
    pull = a**2 * (h + b) / 2 * scaled_sinh(lam * (h + b) / 2) * scaled_sinh(lam * a / 2)
    back = a**3 / 6 * scaled_sinh_excess(lam * a) * scaled_cosh(lam * b)
    bending = (pull - back) / (2 * stiff * scaled_cosh(lam * h))
    return (bending + c * a / 2) / (1 + P * c)


def chain_bending_error(
    spacing: npt.ArrayLike, length: npt.ArrayLike, *, width: npt.ArrayLike = 0.0, clamped: bool = False
) -> FloatArray:
    """Relative error of :func:`platen_compliance` in a chain of beads ``spacing`` apart: s^2/(2 a^2 + 3 a w).

    A chain's hinges sum the bending energy by the trapezoidal rule, which errs by s^2/12 times the jumps of the slope
    of M^2, with M rising over a = (L - w)/2 and even between the platen's edges. w = 0: 2 (s/L)^2. Clamped ends: four
    times that (exact at w = 0, measured). Without tension; tension shortens the arm to sqrt(EI/P).
    """
    s, L, w = positive("spacing", spacing), positive("length", length), non_negative("width", width)
    if np.any(w >= L):
        raise InputError("width", float(np.max(w)), "less than the span")
    a = (L - w) / 2
    return (4 if clamped else 1) * s**2 / (2 * a**2 + 3 * a * w)


def three_point_deflection(
    force: npt.ArrayLike,
    length: npt.ArrayLike,
    EI: npt.ArrayLike,
    *,
    tension: npt.ArrayLike = 0.0,
    kGA: npt.ArrayLike = np.inf,
) -> FloatArray:
    """Mid-span deflection of a simply supported beam under a mid-span force, um.

    F L^3/(48 EI) + F L/(4 kGA) without tension; with tension exact, see :func:`platen_compliance`.
    """
    return finite("force", force) * platen_compliance(length, EI, tension=tension, kGA=kGA)


def platen_force(
    displacement: npt.ArrayLike,
    length: npt.ArrayLike,
    EI: npt.ArrayLike,
    *,
    width: npt.ArrayLike = 0.0,
    tension: npt.ArrayLike = 0.0,
    kGA: npt.ArrayLike = np.inf,
) -> FloatArray:
    """Force that pushes a flat rigid platen by ``displacement`` into one filament, nN (small deflection)."""
    return finite("displacement", displacement) / platen_compliance(length, EI, width=width, tension=tension, kGA=kGA)


def bending_frequency(
    length: npt.ArrayLike,
    EI: npt.ArrayLike,
    mass_per_length: npt.ArrayLike,
    *,
    tension: npt.ArrayLike = 0.0,
    mode: int = 1,
) -> FloatArray:
    """Angular frequency of a simply supported beam under tension, rad/us: omega^2 = (q^4 EI + q^2 P)/m', q = mode pi/L.

    Errors: compression beyond buckling (omega^2 < 0), ``mode`` below 1.
    """
    if mode < 1:
        raise InputError("mode", mode, "at least 1")
    q, P = mode * np.pi / positive("length", length), finite("tension", tension)
    square = (q**4 * positive("EI", EI) + q**2 * P) / positive("mass_per_length", mass_per_length)
    if np.any(square < 0):
        raise InputError("tension", float(np.min(P)), "above minus the buckling load")
    return np.sqrt(square)


def euler_buckling_load(
    length: npt.ArrayLike, EI: npt.ArrayLike, *, effective_length: npt.ArrayLike = 1.0
) -> FloatArray:
    """Euler load pi^2 EI / (K L)^2, nN; K = ``effective_length``: 1 pinned, 0.5 clamped, 2 cantilever.

    The thesis prints L^3 (Eq 7-1): wrong.
    """
    KL = positive("length", length) * positive("effective_length", effective_length)
    return np.pi**2 * positive("EI", EI) / KL**2


def timoshenko_buckling_load(
    length: npt.ArrayLike, EI: npt.ArrayLike, kGA: npt.ArrayLike, *, effective_length: npt.ArrayLike = 1.0
) -> FloatArray:
    """Buckling load with shear, P_E / (1 + P_E/kGA), nN (Engesser; Timoshenko and Gere 2.17)."""
    euler = euler_buckling_load(length, EI, effective_length=effective_length)
    return euler / (1 + euler / positive("kGA", kGA, infinite=True))
