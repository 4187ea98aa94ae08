"""A flat tow as a ribbon of parallel chains: torsion constant, what chains alone give to twist, error of long chords.

Units: um, nN; EA in nN, EI and GJ in nN um2, twist in rad/um.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cgfibre.mechanics._checks import FloatArray, finite, non_negative, positive


def torsion_constant(out: npt.ArrayLike, across: npt.ArrayLike) -> FloatArray:
    """J = 4 I1 I2/(I1 + I2) um4 of a solid section from its second moments of area um4.

    Exact for ellipses (pi a^3 b^3/(a^2 + b^2)) and for flat sections of any outline, where I1 << I2 (J = 4 I1, w t^3/3
    of a rectangle). Too high by 18 % for a square, by 10 % for a rectangle of 1 : 5. The polar moment I1 + I2 is right
    for circles alone: of a rectangle of 1 : 7 it is 14 times too high.
    """
    one, two = positive("out", out), positive("across", across)
    return 4 * one * two / (one + two)


def twisting_moment(
    twist: npt.ArrayLike,
    GJ: npt.ArrayLike,
    offsets: npt.ArrayLike,
    EA: npt.ArrayLike,
    EI: npt.ArrayLike,
    tension: npt.ArrayLike = 0.0,
) -> FloatArray:
    """Moment nN um of a ribbon under an even ``twist`` (rad/um) whose chains keep the distance of their ends.

    A chain at y from the middle becomes a helix: it stretches by y^2 tau^2/2 and bends by y tau^2 in the plane of the
    ribbon, so with the sums over the chains

        M = (GJ + sum P y^2) tau + (sum EA y^4 / 2 + 2 sum EI y^2) tau^3 .

    The term of tension P and that of EA are Wagner's (Verdrehung und Knickung von offenen Profilen, 1929). Chains
    thus give no stiffness to small twists unless they are under tension; ends that are free to slide give none by EA.
    ``offsets`` (n,) um; ``EA`` nN, ``EI`` nN um2 (in the ribbon's plane), ``tension`` nN of each chain, (n,) or one
    for all; leading axes of ``twist`` stay. Good to (y tau)^2 of itself.
    """
    y, tau = finite("offsets", offsets), finite("twist", twist)[..., None]
    line = non_negative("GJ", GJ) * tau[..., 0] + np.sum(finite("tension", tension) * y**2 * tau, axis=-1)
    stretch, bend = 0.5 * non_negative("EA", EA) * y**4, 2 * non_negative("EI", EI) * y**2
    return np.asarray(line + np.sum((stretch + bend) * tau**3, axis=-1))


def chord_loss(span: npt.ArrayLike, wavelength: npt.ArrayLike) -> FloatArray:
    """Part of the bending stiffness that is lost to a bend of this wavelength when turns are taken over chords.

    w = A cos kx has turns A cos kx (2 - 2 cos kh)/h over chords of span h, so that energies are (sin(kh/2)/(kh/2))^4 of
    the beam's: a loss of (k h)^2/6 at first, k = 2 pi/wavelength. Lengths um.
    """
    x = np.pi * positive("span", span) / positive("wavelength", wavelength)
    return np.asarray(1 - np.sinc(x / np.pi) ** 4)
