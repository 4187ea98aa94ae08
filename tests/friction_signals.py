"""Synthetic capstan signals whose coefficients and lines are known."""

import numpy as np

from cgfibre.mechanics.stick_slip import StickSlipLaw

#: the thesis' law in um and us: 2 % of a 1 mm element, 3.97 Hz, 0.16 mm/s
LAW = StickSlipLaw(0.22, 0.18, 0.16, 20.0, 5.0, 3.97e-6, 1.6e-4)
FREQUENCY = LAW.cycle_frequency * 1e6  # Hz
T1, WRAP = 0.52, 2.87


def stick_slip_signal(seed, n=1293, span=180.0, noise=0.02, gaps=True, wrap=WRAP, law=LAW):
    """(time s, tension N): uneven samples with gaps, and noise relative to the tension."""
    rng = np.random.default_rng(seed)
    t = np.sort(rng.uniform(0.0, span, 2 * n))
    if gaps:
        t = t[~(((t > 0.22 * span) & (t < 0.26 * span)) | ((t > 0.55 * span) & (t < 0.57 * span)))]
    t = np.sort(rng.choice(t, n, replace=False))
    mu = law.coefficient(law.speed * 1e6 * t)
    return t, T1 * np.exp(mu * wrap) * (1 + noise * rng.normal(size=n))
