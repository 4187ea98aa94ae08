r"""Belt friction: a flexible filament or tow wrapped round a pulley, and the laws of friction that go with it.

Tensions in any one unit of force, angles in rad. Every function broadcasts over arrays and raises
:class:`cgfibre.errors.InputError` for a value out of its range. Equation numbers are those of Chakladar 2014.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cgfibre.errors import InputError
from cgfibre.mechanics._checks import FloatArray, non_negative, positive


def tension_ratio(mu: npt.ArrayLike, wrap: npt.ArrayLike) -> FloatArray:
    """T2/T1 = exp(mu theta), Eq 2-8 (Euler and Eytelwein): belt without stiffness, Coulomb friction, slipping."""
    return np.exp(non_negative("friction", mu) * non_negative("wrap", wrap))


def polygon_ratio(mu: npt.ArrayLike, wrap: npt.ArrayLike, nodes: npt.ArrayLike) -> FloatArray:
    """T2/T1 of a chain that turns by a = theta/n at each of n nodes: ((1 + mu tan(a/2))/(1 - mu tan(a/2)))^n.

    Each node is pressed by (T + T') sin(a/2) and held back by mu times that: (T' - T) cos(a/2) = mu (T + T') sin(a/2).
    Tends to exp(mu theta) with an error of mu theta a^2 (1 + mu^2)/12.
    """
    n = positive("nodes", nodes)
    slip = non_negative("friction", mu) * np.tan(non_negative("wrap", wrap) / n / 2)
    if np.any(slip >= 1.0):
        raise InputError("nodes", nodes, "more nodes: the chain locks at a corner (mu tan(a/2) >= 1)")
    return np.asarray(((1 + slip) / (1 - slip)) ** n)


def friction_coefficient(ratio: npt.ArrayLike, wrap: npt.ArrayLike) -> FloatArray:
    """mu = ln(T2/T1)/theta, Eq 2-8 turned round (App A.1); negative where T2 < T1 (the belt runs the other way)."""
    return np.log(positive("tension ratio", ratio)) / positive("wrap", wrap)


def loop_friction(up: npt.ArrayLike, down: npt.ArrayLike, wrap: npt.ArrayLike) -> FloatArray:
    """mu = ln(T_up/T_down)/(2 theta) of a pull up and one down over the same pulley: the dead load drops out."""
    return np.log(positive("tension up", up) / positive("tension down", down)) / (2 * positive("wrap", wrap))


def normal_force(tension: npt.ArrayLike, radius: npt.ArrayLike) -> FloatArray:
    """Force of the pulley on the belt per length of contact, q = T/R."""
    return non_negative("tension", tension) / positive("radius", radius)


def howell_friction(normal: npt.ArrayLike, a: npt.ArrayLike, n: npt.ArrayLike) -> FloatArray:
    """Friction force F = a N^n of fibres, Eq 2-7 (Howell); 2/3 (elastic contact) <= n <= 1 (Amontons, a = mu)."""
    exponent = positive("n", n)
    bad = (exponent < 2 / 3 - 1e-12) | (exponent > 1)
    if np.any(bad):
        raise InputError("n", float(exponent[bad].flat[0]), "from 2/3 to 1")
    return np.asarray(positive("a", a) * non_negative("normal force", normal) ** exponent)


def pull_off_force(radius: npt.ArrayLike, surface_energy: npt.ArrayLike) -> FloatArray:
    """Adhesion of a filament's asperity, Z = 3 pi R gamma, Eq 2-9 (Johnson, Kendall and Roberts for two equal bodies).

    R 0.2 um and gamma 80 mJ/m2 (80 nN/um) give 151 nN.
    """
    return 3 * np.pi * positive("radius", radius) * non_negative("surface energy", surface_energy)
