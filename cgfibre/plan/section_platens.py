"""Where platens that are curved across a section first touch it."""

from __future__ import annotations

import numpy as np

from cgfibre.build.system import FloatArray
from cgfibre.plan.model import Platens


def first_touch(platens: Platens, centres: FloatArray, radius: FloatArray | float, curved: bool, sign: float) -> float:
    """z of a platen's surface at the middle, um, where it first touches discs at ``centres`` (n, 2) of y, z.

    ``sign`` 1: the top platen, -1: the bottom one; ``curved`` about the axis y = crimp_centre. A disc of radius r at
    (y, z) touches a convex cylinder of radius R where the axis stands at z + sqrt((R + r)^2 - y^2), a concave one where
    it stands at z - sqrt((R - r)^2 - y^2); the surface is R nearer. nan where a disc lies beside the cylinder.
    """
    y, z = centres[:, 0] - platens.crimp_centre, sign * centres[:, 1]
    if not curved:
        return float(sign * np.max(z + radius))
    R = platens.crimp_radius
    with np.errstate(invalid="ignore"):
        if platens.convex:
            height = z + np.sqrt((R + radius) ** 2 - y**2) - R
        else:
            height = z - np.sqrt(np.where(R > radius, (R - radius) ** 2, np.nan) - y**2) + R
    return float(sign * np.max(height))


def middle_gap(platens: Platens, centres: FloatArray, radius: FloatArray | float) -> float:
    """Gap between the platens at the middle when both first touch, um; nan where a disc lies beside a cylinder."""
    top = first_touch(platens, centres, radius, True, 1.0)
    return top - first_touch(platens, centres, radius, platens.bottom_crimped, -1.0)
