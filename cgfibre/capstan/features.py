"""What a capstan signal shows, from the law alone: the belt as rigid, so that every node slips by V t.

A filament stretches by 1e-4 of the critical slip of 20 um or less under the thesis' loads, so the tension ratio is that
of the belt with the coefficient of the moment, T2/T1 = exp(mu(V t) theta), whatever goes on between the filaments:
summed over all of them, what they do to each other cancels.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import numpy.typing as npt

from cgfibre.mechanics.belt import tension_ratio
from cgfibre.mechanics.stick_slip import StickSlipLaw

FloatArray = npt.NDArray[np.float64]

COEFFICIENTS = ("mu_s0", "mu_s", "mu_k")
#: change of a coefficient in the sensitivity studies of Figs 4-7 to 4-9
CHANGE = 0.01


def rigid_ratio(law: StickSlipLaw, wrap: float, time: npt.ArrayLike) -> FloatArray:
    """T2/T1 at times (any shape) since the pull began."""
    slip = law.speed * np.maximum(np.asarray(time, dtype=np.float64), 0.0)
    return np.asarray(np.exp(law.coefficient(slip) * wrap))


@dataclass(frozen=True)
class Features:
    """Numbers that a signal is judged by.

    ``stick_time`` of the first sticking (in the law's time unit); ``peak``, ``high``, ``low`` T2/T1 at mu_s0, mu_s,
    mu_k; ``amplitude`` (high - low)/their mean; ``friction_amplitude`` (high - low)/(low - 1), of the friction force
    T2 - T1 over its least; ``frequency`` of the stick-slip.
    """

    stick_time: float
    peak: float
    high: float
    low: float
    amplitude: float
    friction_amplitude: float
    frequency: float


def features(law: StickSlipLaw, wrap: float) -> Features:
    """Features of the rigid belt over ``wrap`` rad."""
    peak, high, low = (float(tension_ratio(getattr(law, name), wrap)) for name in COEFFICIENTS)
    return Features(
        law.critical_slip / law.speed,
        peak,
        high,
        low,
        2 * (high - low) / (high + low),
        (high - low) / (low - 1),
        law.cycle_frequency,
    )


def changed(law: StickSlipLaw, name: str, change: float, fixed: Literal["slip", "stiffness"] = "slip") -> StickSlipLaw:
    """The law with one coefficient changed.

    ``fixed``: what mu_s0 leaves as it is: the critical slip (as Eqs 4-3 have it, the stiffness grows), or the stiffness
    (a spring in series that is softer than the contact, as a test has it; the critical slip grows).
    """
    value = getattr(law, name) + change
    slip = law.critical_slip
    if name == "mu_s0" and fixed == "stiffness":
        slip *= value / law.mu_s0
    return replace(law, critical_slip=slip, **{name: value})


def sensitivities(law: StickSlipLaw, wrap: float) -> dict[tuple[str, str], Mapping[str, float]]:
    """Relative change of every feature on +0.01 in a coefficient (Figs 4-7 to 4-9): (coefficient, what mu_s0 leaves
    fixed) -> feature -> change. Coefficients that cannot rise by 0.01 are left out."""
    base = features(law, wrap)
    found: dict[tuple[str, str], Mapping[str, float]] = {}
    for name in COEFFICIENTS:
        for fixed in ("slip", "stiffness") if name == "mu_s0" else ("slip",):
            order = {c: getattr(law, c) + (CHANGE if c == name else 0.0) for c in COEFFICIENTS}
            if not order["mu_k"] <= order["mu_s"] <= order["mu_s0"]:
                continue
            other = features(changed(law, name, CHANGE, fixed), wrap)
            # over nothing, of a law without stick-slip, there is no relative change
            found[name, fixed] = {
                key: getattr(other, key) / value - 1 if value else np.nan for key, value in vars(base).items()
            }
    return found
