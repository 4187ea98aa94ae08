r"""Ends and supports of a filament: pre-tensioned beams as springs, exact and as a bead chain carries them.

Units: um, us, nN, pg; stiffness nN/um, torsional nN um/rad. Every function raises :class:`cgfibre.errors.InputError`
for a value out of its range.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from cgfibre.errors import InputError
from cgfibre.mechanics._checks import FloatArray, non_negative, positive
from cgfibre.mechanics.rod import platen_compliance, scaled_bending, scaled_cosh, scaled_sinh

FarEnd = Literal["simply supported", "clamped"]


# --- springs of a section (disc) -------------------------------------------------------------------------------------


def mid_span_stiffness(length: npt.ArrayLike, EI: npt.ArrayLike, tension: npt.ArrayLike = 0.0) -> FloatArray:
    """Exact mid-span stiffness of a simply supported beam under tension P, nN/um; broadcasts.

    1/(L/(4 P) - tanh(lambda L/2)/(2 P lambda)), lambda = sqrt(P/EI); 48 EI/L^3 without tension, evaluated without
    cancellation. T700, 345 mm, 0.04 cN: 4.645 nN/um.
    """
    return 1 / platen_compliance(length, EI, tension=tension)


def thesis_mid_span_stiffness(length: npt.ArrayLike, EI: npt.ArrayLike, tension: npt.ArrayLike = 0.0) -> FloatArray:
    """Thesis' Eq 7-1: 48 EI/L^3 (1 + P/Pcr), Pcr = pi^2 EI/L^2 (the printed L^3 is wrong), nN/um; broadcasts.

    48/pi^2 = 4.86 against the exact 4 P/L of a long string: 21 % too stiff at 345 mm and 0.04 cN (5.63 nN/um).
    """
    L, stiff = positive("length", length), positive("EI", EI)
    return 48 * stiff / L**3 * (1 + non_negative("tension", tension) * L**2 / (np.pi**2 * stiff))


def thesis_torsional_stiffness(length: npt.ArrayLike, GJ: npt.ArrayLike) -> FloatArray:
    """Thesis' Eq 7-2: GJ/L, nN um/rad; one end held, the other turned by the moment."""
    return positive("GJ", GJ) / positive("length", length)


def mid_span_torsional_stiffness(length: npt.ArrayLike, GJ: npt.ArrayLike) -> FloatArray:
    """Torsional stiffness at mid-span with both ends held: two halves of 2 GJ/L, 4 GJ/L, nN um/rad."""
    return 4 * positive("GJ", GJ) / positive("length", length)


def support_frequency(stiffness: npt.ArrayLike, inertia: npt.ArrayLike) -> FloatArray:
    """Natural angular frequency sqrt(k/m) of a disc on its spring, rad/us; (k_theta, I) for the torsional one."""
    return np.sqrt(positive("stiffness", stiffness) / positive("inertia", inertia))


# --- far field -------------------------------------------------------------------------------------------------------


def far_field_stiffness(
    length: npt.ArrayLike,
    EI: npt.ArrayLike,
    tension: npt.ArrayLike = 0.0,
    far_end: FarEnd = "simply supported",
) -> FloatArray:
    r"""Exact stiffness of the near end of a beam of length a under tension P: (force, moment) = K (w, theta).

    theta = dw/dx with x from the near end outward; phi = a sqrt(P/EI). Simply supported far end, D = phi cosh phi -
    sinh phi:

    K_ww = EI/a^3 phi^3 cosh(phi)/D, K_wt = EI/a^2 phi^2 sinh(phi)/D, K_tt = EI/a phi^2 sinh(phi)/D;

    clamped, h = phi/2 and D = h cosh h - sinh h:

    K_ww = EI/a^3 4 h^3 cosh(h)/D, K_wt = EI/a^2 2 h^2 sinh(h)/D, K_tt = EI/a h (phi cosh phi - sinh phi)/(2 sinh(h) D).

    Evaluated in scaled functions: no cancellation at phi -> 0 (3, 3, 3 and 12, 6, 4), no overflow at any phi.

    Parameters: ``length`` um, ``EI`` nN um2, ``tension`` nN >= 0; they broadcast to shape (...).
    Returns: (..., 2, 2), nN/um, nN, nN um.
    """
    a, stiff, P = np.broadcast_arrays(positive("length", length), positive("EI", EI), non_negative("tension", tension))
    phi = a * np.sqrt(P / stiff)
    K = np.empty((*a.shape, 2, 2))
    if far_end == "simply supported":
        bend, turn = scaled_bending(phi), scaled_sinh(phi)
        factors = 3 * scaled_cosh(phi) / bend, 3 * turn / bend, 3 * turn / bend
    elif far_end == "clamped":
        half = phi / 2
        bend, turn = scaled_bending(half), scaled_sinh(half)
        factors = 12 * scaled_cosh(half) / bend, 6 * turn / bend, 4 * scaled_bending(phi) / (turn * bend)
    else:
        raise InputError("far_end", far_end, "'simply supported' or 'clamped'")
    K[..., 0, 0] = stiff / a**3 * factors[0]
    K[..., 0, 1] = K[..., 1, 0] = stiff / a**2 * factors[1]
    K[..., 1, 1] = stiff / a * factors[2]
    return K


def axial_end_stiffness(length: npt.ArrayLike, EA: npt.ArrayLike, *, load_controlled: bool = False) -> FloatArray:
    """Axial stiffness EA/a of a far field held at its far end, nN/um; 0 if its far end carries a constant load."""
    k = positive("EA", EA) / positive("length", length)
    return np.zeros_like(k) if load_controlled else k


def chain_end_stiffness(stiffness: FloatArray, segment: float, EI: float) -> FloatArray:
    r"""Far-field stiffness as the last segment of a bead chain sees it: (w, theta) to (w, psi), (2, 2).

    psi is the slope of the last segment (length s), theta the beam's slope at its end bead. Between them lies the
    bending of the half segment that no interior hinge of the chain has, theta - psi = M s/(2 EI) (int x/s w'' dx over
    the segment): a hinge h = 2 EI/s in series with the moment of K. With T = h + K_tt: K_ww - K_wt^2/T, h K_wt/T, h
    K_tt/T.
    """
    K = np.asarray(stiffness, dtype=np.float64)
    if K.shape != (2, 2):
        raise InputError("stiffness", K.shape, "a 2 x 2 matrix")
    h = float(2 * positive("EI", EI) / positive("segment", segment))
    total = h + K[1, 1]
    mixed = h * K[0, 1] / total
    return np.array([[K[0, 0] - K[0, 1] ** 2 / total, mixed], [mixed, h * K[1, 1] / total]])


@dataclass(frozen=True)
class ChainEnd:
    """One bead X that stands for all of a far field beyond the chain's last bead Z.

    X lies ``distance`` (um) outward of Z, free along the filament, where it carries the constant pull ``tension``
    (nN; or axially held, with the bond Z-X of stiffness :func:`axial_end_stiffness` and pre-tensioned).
    ``spring`` (nN/um) holds X to its place across the filament, inf: held rigidly there (``rigid``).
    ``hinge`` (nN um) is the K of the ``angle cosine`` at Z between the last segment and Z-X.
    ``ground`` (nN/um) holds Z itself across the filament: 0 for a simply supported far end.
    """

    distance: float
    spring: float
    hinge: float
    ground: float
    tension: float

    @property
    def rigid(self) -> bool:
        """X is held rigidly across the filament."""
        return bool(np.isinf(self.spring))

    def stiffness(self) -> FloatArray:
        """(2, 2) stiffness in (w_Z, slope of the last segment) with X condensed out; see :func:`chain_end`."""
        e, k, string = self.distance, self.hinge, self.tension * self.distance
        # 1/(spring e^2), so that a rigid X needs no case of its own
        soft = 1 / (self.spring * e**2)
        total = 1 + (k + string) * soft
        ww, wt, tt = (k + string) / total, k / total, k * (1 + string * soft) / total
        return np.array([[ww / e**2 + self.ground, wt / e], [wt / e, tt]])


def chain_end(
    stiffness: FloatArray, segment: float, EI: float, tension: float, *, distance: float | None = None
) -> ChainEnd:
    r"""Realise a far field's stiffness in a bead chain by one bead X, exactly (statics, small deflection).

    With w = w_Z, psi = slope of the last segment and g = slope of Z-X the end stores
    k_x (w + e g)^2/2 + k_a (g - psi)^2/2 + P e g^2/2. Condensing g gives, S = k_x e^2 + k_a + P e,

    A = k_x (k_a + P e)/S, B = k_a k_x e/S, C = k_a (k_x e^2 + P e)/S, so A C - B^2 = P B whatever e.

    (A, B, C) of :func:`chain_end_stiffness` obeys the same identity for a simply supported far end (moments about the
    support), so three constants have only two equations and e is free; a clamped far end leaves A - B (B + P)/C > 0,
    a spring ``ground`` at Z. The family, 0 <= q < 1:

    k_x = B (B + P)/(q C), e = C/B (1 - q P/(B + P)), k_a = e B/(1 - q).

    q = 0 puts a rigidly held X at e = C/B (simply supported: at the support itself, e = a, k_a = C). The shortest arm,
    e > C/(B + P), is near sqrt(EI/P) for a long far field. Default: twice that (k_a = P e), or q = 1/2 where tension
    matters little (P < 2 B); short, and k_x, k_a, e stay finite at P = 0.

    Parameters
    ----------
    stiffness : (2, 2) of :func:`far_field_stiffness`; segment : length of the chain's last segment, um; EI : nN um2
    of the chain
    tension : nN, as in ``stiffness``; distance : e wished for, um, C/(B + P) < e <= C/B

    Errors: ``distance`` out of its range (the message states it), or given without tension (it is then fixed).
    """
    P = float(non_negative("tension", tension))
    (A, B), (_, C) = chain_end_stiffness(stiffness, segment, EI).tolist()
    if distance is None:
        q = max(0.5, 1 - B / P) if P > 0 else 0.5
        e = C / B * (1 - q * P / (B + P))
    else:
        e = float(positive("distance", distance))
        shortest, longest = C / (B + P), C / B
        if P == 0:
            raise InputError("distance", distance, "None without tension (it is then fixed)")
        if not shortest < e <= longest * (1 + 1e-12):
            raise InputError("distance", distance, f"more than {shortest:.6g} and at most {longest:.6g} um")
        e = min(e, longest)
        q = (1 - e / longest) * (B + P) / P
    spring = B * (B + P) / (q * C) if q > 0 else np.inf
    ground = A - B * (B + P) / C
    # a simply supported far end leaves rounding, which would be a spring of no meaning
    return ChainEnd(e, spring, e * B / (1 - q), ground if ground > 1e-9 * A else 0.0, P)


# --- estimates -------------------------------------------------------------------------------------------------------


def bundle_bending_force(
    displacement: npt.ArrayLike,
    depths: npt.ArrayLike,
    stiffness: float,
    *,
    diameter: float,
    pitch: float,
) -> FloatArray:
    """Platen force of a bundle that bends between its end supports, nN: F = k sum_i max(0, d - h_i (1 - D/p)).

    The filament at depth h_i below the top one is reached when the voids above it are closed. An estimate to choose the
    platen's speed by, not a result: no friction, no contact stiffness, columns closing one filament after another.

    Parameters: ``displacement`` d um (...); ``depths`` h_i um (n,); ``stiffness`` k nN/um of one filament under the
    platen (1 / :func:`cgfibre.mechanics.rod.platen_compliance`); ``diameter`` D <= ``pitch`` p um.
    """
    D, p = float(positive("diameter", diameter)), float(positive("pitch", pitch))
    if p < D:
        raise InputError("pitch", pitch, f"at least the diameter, {D:g} um")
    gaps = np.sort(np.ravel(non_negative("depths", depths))) * (1 - D / p)
    sums = np.concatenate([[0.0], np.cumsum(gaps)])
    d = np.asarray(displacement, dtype=np.float64)
    reached = np.searchsorted(gaps, d)
    return float(positive("stiffness", stiffness)) * (reached * d - sums[reached])


def quasi_static_speed(
    accuracy: npt.ArrayLike, force: npt.ArrayLike, kn: npt.ArrayLike, mass: npt.ArrayLike
) -> FloatArray:
    """Platen speed eps F/sqrt(kn m), um/us: a bead of mass m hit by the platen feels at most eps F."""
    impact = np.sqrt(positive("kn", kn) * positive("mass", mass))
    return positive("accuracy", accuracy) * positive("force", force) / impact
