"""Input checks shared by the closed forms."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cgfibre.errors import InputError

FloatArray = npt.NDArray[np.float64]


def _checked(key: str, value: npt.ArrayLike, bad: npt.NDArray[np.bool_], expected: str) -> None:
    if np.any(bad):
        raise InputError(key, float(np.asarray(value, dtype=np.float64)[bad].flat[0]), expected)


def finite(key: str, value: npt.ArrayLike) -> FloatArray:
    """``value`` as a float array; InputError unless every entry is finite."""
    array = np.asarray(value, dtype=np.float64)
    _checked(key, array, ~np.isfinite(array), "a finite number")
    return array


def positive(key: str, value: npt.ArrayLike, *, infinite: bool = False) -> FloatArray:
    """``value`` as a float array; InputError unless every entry is positive (``infinite``: inf is allowed)."""
    array = np.asarray(value, dtype=np.float64)
    good = array > 0 if infinite else (array > 0) & np.isfinite(array)
    _checked(key, array, ~good, "a positive number")
    return array


def non_negative(key: str, value: npt.ArrayLike) -> FloatArray:
    """``value`` as a float array; InputError unless every entry is finite and not negative."""
    array = np.asarray(value, dtype=np.float64)
    _checked(key, array, ~((array >= 0) & np.isfinite(array)), "zero or a positive number")
    return array


def poisson(key: str, value: npt.ArrayLike) -> FloatArray:
    """``value`` as a float array; InputError unless -1 < nu <= 0.5."""
    array = np.asarray(value, dtype=np.float64)
    _checked(key, array, ~((array > -1) & (array <= 0.5)), "a Poisson's ratio, -1 < nu <= 0.5")
    return array
