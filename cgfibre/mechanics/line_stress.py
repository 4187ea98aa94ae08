"""Beyond the contact's pressure: stresses inside, compliance along it, contact of transversely isotropic filaments.

Units: um, nN, kPa; line loads nN/um. Arrays broadcast. Functions raise :class:`cgfibre.errors.InputError` for values
out of their range. Pressures and approach are in :mod:`cgfibre.mechanics.contact`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import elliprd

from cgfibre.errors import InputError
from cgfibre.mechanics import contact
from cgfibre.mechanics._checks import FloatArray, finite, non_negative, poisson, positive

#: depth of the largest shear stress under a line contact over the half width, and its size over the peak pressure
SHEAR_DEPTH, SHEAR_PEAK = 0.7862, 0.3003


@dataclass(frozen=True)
class Stresses:
    """Stresses under a contact, kPa, tension positive: ``across`` (along the surface), ``normal`` (along the load) and
    ``shear``; plane strain adds nu (across + normal) along the fibre."""

    across: FloatArray
    normal: FloatArray
    shear: FloatArray

    @property
    def greatest_shear(self) -> FloatArray:
        """Largest shear stress in the plane, half the difference of the principal stresses, kPa."""
        return np.asarray(np.hypot((self.across - self.normal) / 2, self.shear))


def subsurface_stress(
    y: npt.ArrayLike, depth: npt.ArrayLike, half_width: npt.ArrayLike, peak_pressure: npt.ArrayLike
) -> Stresses:
    r"""Stresses at ``y`` um from the middle and ``depth`` um below a line contact of Hertz (McEwen 1949).

    With s = b^2 - y^2 + z^2: m^2, n^2 = (sqrt(s^2 + 4 y^2 z^2) +- s)/2, n with the sign of y (Johnson, Contact
    Mechanics, 4.49):
    across = -(p0/b) (m (1 + (z^2 + n^2)/(m^2 + n^2)) - 2 z), normal = -(p0/b) m (1 - (z^2 + n^2)/(m^2 + n^2)),
    shear = -(p0/b) n (m^2 - z^2)/(m^2 + n^2). On the axis of symmetry the largest shear is 0.300 p0 at 0.786 b (the
    contour of thesis Fig 6-2). Of a half plane: good to a depth of a few half widths in a filament.
    """
    z, b = non_negative("depth", depth), positive("half_width", half_width)
    p0, x = positive("peak_pressure", peak_pressure), finite("y", y)
    s = b**2 - x**2 + z**2
    root = np.sqrt(s**2 + 4 * x**2 * z**2)
    m = np.sqrt(np.maximum(root + s, 0.0) / 2)
    n = np.copysign(np.sqrt(np.maximum(root - s, 0.0) / 2), x)
    total = m**2 + n**2
    safe = np.where(total > 0, total, 1.0)  # 0 at the very edge of the contact, where all stresses vanish
    share = np.where(total > 0, (z**2 + n**2) / safe, 0.0)
    return Stresses(
        across=np.asarray(-p0 / b * (m * (1 + share) - 2 * z)),
        normal=np.asarray(-p0 / b * m * (1 - share)),
        shear=np.asarray(-p0 / b * n * np.where(total > 0, (m**2 - z**2) / safe, 0.0)),
    )


def axial_stiffness(
    r1: npt.ArrayLike, r2: npt.ArrayLike, G1: npt.ArrayLike, G2: npt.ArrayLike, half_width: npt.ArrayLike
) -> FloatArray:
    """Stiffness per length of a line contact without slip, for sliding along the filaments, kPa.

    t/w, t the friction per length along the axis, w the shift of one section's mean against the other's. Antiplane
    shear of a disc that is loaded by t/(pi sqrt(b^2 - y^2)) over the contact and balanced by the rise of the filament's
    tension, even over the section: w_i = t/(pi G_i) (ln(2 R_i/b) + 1/8). (Derived here from the Neumann function of the
    disc, b << R.) ``G`` is G12, the shear modulus along the fibre: carbon at 1 N/mm has 17 GPa, five times the normal
    secant stiffness. Across the filaments, in the plane, the tangential compliance of like bodies is that of the normal
    direction (Johnson, Contact Mechanics, 7.2). Errors: b not below both radii.
    """
    b = positive("half_width", half_width)
    total = np.zeros(())
    for key, radius, modulus in (("r1", r1, G1), ("r2", r2, G2)):
        R = positive(key, radius)
        if np.any(b >= R):
            raise InputError("half_width", float(np.max(b)), f"below the radius, {float(np.min(R)):g} um")
        total = total + (np.log(2 * R / b) + 1 / 8) / positive("G" + key[1], modulus)
    return np.asarray(np.pi / total)


# --- transversely isotropic filaments --------------------------------------------------------------------------------


def plane_strain_poisson(E1: npt.ArrayLike, E2: npt.ArrayLike, nu12: npt.ArrayLike) -> FloatArray:
    """Poisson's ratio sqrt(nu12 nu21) = nu12 sqrt(E2/E1) that makes :func:`contact.contact_modulus` that of filaments.

    A long filament that is pressed across keeps its length: with the axis 1 along it, eps_1 = 0 gives the transverse
    compliance (1 - nu12 nu21)/E2, nu21 = nu12 E2/E1, in the place of (1 - nu^2)/E. The approach of parallel filaments
    (:class:`contact.LineContact`) then holds as it stands: the stress across the load integrates to zero between
    contact and axis, so that no other constant enters. Pass the result as ``nu`` beside ``E2`` as ``E``. Carbon: 0.053
    in the place of nu23 = 0.3, a contact modulus of 5.01 GPa in the place of 5.49, since the stiff axis takes up the
    axial strain.
    """
    return np.asarray(np.abs(poisson("nu12", nu12)) * np.sqrt(positive("E2", E2) / positive("E1", E1)))


@dataclass(frozen=True)
class IndentationModuli:
    """Moduli E* of half spaces pressed by a rigid punch, kPa: ``along`` the fibre (its end), ``across`` (its side)."""

    along: float
    across: float


def indentation_moduli(E1: float, E2: float, nu12: float, nu23: float, G12: float) -> IndentationModuli:
    r"""Indentation moduli of a transversely isotropic solid, for filaments that cross (contact on their sides).

    With the axis 3 of symmetry along the fibre, from the stiffnesses C: along = 2 sqrt((C11 C33 - C13^2)/C11 / (1/C44 +
    2/(sqrt(C11 C33) + C13))), exact; across = sqrt(sqrt(C11/C33) (C11^2 - C12^2)/C11 along), the approximation of
    Delafargue and Ulm (International Journal of Solids and Structures 41, 2004, 7351). Isotropic: both E/(1 - nu^2). Of
    a pair of like filaments E* is half of ``across``. Carbon: 15.7 GPa across, against 11.0 of an isotropic solid of E2
    and nu23. Errors: constants that no stable solid has.
    """
    for key, value in (("E1", E1), ("E2", E2), ("G12", G12)):
        positive(key, value)
    nu21 = float(poisson("nu12", nu12)) * E2 / E1
    poisson("nu23", nu23)
    # compliances: rows 1, 2 across, 3 along the fibre
    S = np.array([[1 / E2, -nu23 / E2, -nu12 / E1], [-nu23 / E2, 1 / E2, -nu12 / E1], [-nu12 / E1, -nu12 / E1, 1 / E1]])
    if not np.all(np.linalg.eigvalsh(S) > 0):
        raise InputError("nu12, nu23", (nu12, nu23), f"Poisson's ratios of a stable solid (nu21 = {nu21:.3g})")
    C = np.linalg.inv(S)
    c11, c12, c13, c33, c44 = C[0, 0], C[0, 1], C[0, 2], C[2, 2], G12
    along = 2 * np.sqrt((c11 * c33 - c13**2) / c11 / (1 / c44 + 2 / (np.sqrt(c11 * c33) + c13)))
    across = np.sqrt(np.sqrt(c11 / c33) * (c11**2 - c12**2) / c11 * along)
    return IndentationModuli(float(along), float(across))


# --- crossing filaments ----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class ContactEllipse:
    """Half axes ``major`` and ``minor`` um of the contact of two crossing filaments, and its ``peak_pressure`` kPa."""

    major: FloatArray
    minor: FloatArray
    peak_pressure: FloatArray


def crossing_ellipse(
    force: npt.ArrayLike, modulus: float, r1: float, r2: float, angle: float = np.pi / 2
) -> ContactEllipse:
    """Contact of two cylinders crossing at ``angle``, pressed by ``force`` nN: pmax = 3 F/(2 pi a b) (thesis Eq 6-3).

    a^3 = 3 F R_D(0, q^2, 1)/(2 pi E* 3 A), b = q a, with q and the smaller relative curvature A as in
    :func:`contact.crossing_prefactor` (Johnson, Contact Mechanics, 4.26). Equal radii at 90 degrees: a circle of
    a^3 = 3 F R/(4 E*).
    """
    F = non_negative("force", force)
    cross = float(positive("angle", angle))
    if cross > np.pi / 2:
        raise InputError("angle", cross, "between 0 and pi/2")
    mean = (1 / float(positive("r1", r1)) + 1 / float(positive("r2", r2))) / 4
    product = np.sin(cross) ** 2 / (4 * r1 * r2)
    large = mean + np.sqrt(max(mean**2 - product, 0.0))
    small = product / large
    q = contact._axis_ratio(large / small)
    major = np.cbrt(3 * F * elliprd(0.0, q**2, 1.0) / 3 / (2 * np.pi * float(positive("modulus", modulus)) * small))
    area = np.pi * q * major**2
    peak = np.divide(1.5 * F, area, out=np.zeros_like(area), where=area > 0)
    return ContactEllipse(np.asarray(major), np.asarray(q * major), np.asarray(peak))
