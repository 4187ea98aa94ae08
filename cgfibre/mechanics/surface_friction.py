"""Friction and adhesion of fibre surfaces: Amontons, Howell, and the pull-off force of an asperity.

Forces in nN, lengths in um. Arrays broadcast. Functions raise :class:`cgfibre.errors.InputError` for values out of
their range. The belt equation has a module of its own.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cgfibre.errors import InputError
from cgfibre.mechanics._checks import FloatArray, non_negative, positive


def howell_friction(normal_force: npt.ArrayLike, a: npt.ArrayLike, n: npt.ArrayLike) -> FloatArray:
    """Friction force F = a N^n of Howell (thesis Eq 2-7), 2/3 <= n <= 1, nN; ``a`` in nN^(1 - n).

    n = 2/3 is a Hertzian contact of constant shear strength (F follows the contact area), n = 1 Amontons' law F = mu N
    (Eq 2-6), a = mu. Fit a and n to measurements with :func:`cgfibre.measure.compaction.fit_power_law`, a power law of
    any two quantities. Errors: n outside 2/3 to 1.
    """
    exponent = np.asarray(n, dtype=np.float64)
    if np.any(~((exponent >= 2 / 3 - 1e-12) & (exponent <= 1))):
        raise InputError("n", float(np.asarray(exponent).flat[0]), "Howell's exponent, 2/3 to 1")
    return np.asarray(positive("a", a) * non_negative("normal_force", normal_force) ** exponent)


def howell_coefficient(normal_force: npt.ArrayLike, a: npt.ArrayLike, n: npt.ArrayLike) -> FloatArray:
    """Apparent coefficient of friction F/N = a N^(n - 1), which falls with the load below n = 1."""
    load = positive("normal_force", normal_force)
    return np.asarray(howell_friction(load, a, n) / load)


def adhesion_force(radius: npt.ArrayLike, surface_energy: npt.ArrayLike) -> FloatArray:
    """Pull-off force Z = 3 pi R gamma (thesis Eq 2-9, Roselman and Tabor), nN.

    ``radius`` um of the asperity in contact (not of the fibre), ``surface_energy`` of one surface in mJ/m2 (1 mJ/m2 = 1
    nN/um), so that the work of adhesion is 2 gamma: Johnson, Kendall and Roberts' 3/2 pi R W. Carbon: R 0.2 um and 80
    mJ/m2 give 151 nN, the weight of 0.2 m of the filament: small beside the contact forces of a compaction.
    """
    return np.asarray(3 * np.pi * positive("radius", radius) * positive("surface_energy", surface_energy))
