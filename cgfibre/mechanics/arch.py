"""Crimped tows as arches: what a tow whose ends are held does to a platen that presses its crests.

Units: um, nN, kPa. Every function raises :class:`cgfibre.errors.InputError` for a value out of its range.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cgfibre.mechanics._checks import FloatArray, non_negative, positive


def arch_force(
    drop: npt.ArrayLike,
    amplitude: npt.ArrayLike,
    crimp: npt.ArrayLike,
    slope: npt.ArrayLike,
    EA: npt.ArrayLike,
    EI: npt.ArrayLike,
    flank: npt.ArrayLike,
) -> FloatArray:
    """Force (nN) by which each flank of a crest resists the crest's ``drop`` a um; broadcasts.

    A tow that goes up and down by h = ``amplitude`` um is c = ``crimp`` longer than its way in the plane (L/l - 1),
    nearly as h^2, and ``slope`` (rad) steep at the most. Pressed to h - a between ends that cannot move it is shortened
    by c (1 - (1 - a/h)^2), and its thrust T pushes up along the flank,

        F = T sin(alpha) + 24 EI a/l^3,   T = min(EA c (1 - (1 - a/h)^2), 4 pi^2 EI/l^2),
        tan(alpha) = (1 - a/h) tan(slope) ,

    until the flank (``flank`` l um from crest to trough), whose ends lie flat between platen and the tow crossed,
    buckles as a strut with clamped ends: tows of loose filaments are no arches. The second term is the bending of that
    flank, 12 EI/l^3 times the 2 a by which crest and trough come nearer. ``EA`` nN (0: its ends give) and ``EI`` nN um2
    are the tow's.
    """
    h, a = positive("amplitude", amplitude), non_negative("drop", drop)
    left = np.maximum(1 - a / h, 0.0)
    lost = non_negative("crimp", crimp) * (1 - left**2)
    stiff, long = non_negative("EI", EI), positive("flank", flank)
    strut = 4 * np.pi**2 * stiff / long**2
    thrust = np.minimum(non_negative("EA", EA) * lost, strut)
    leaning = np.arctan(left * np.tan(non_negative("slope", slope)))
    return np.asarray(thrust * np.sin(leaning) + 24 * stiff * a / long**3)
