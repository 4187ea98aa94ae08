"""Measured friction of carbon tows against the angle between them and the tow size (Chakladar 2014, chapter 3).

T700SC-12000-50C on itself, capstan of 2.87 rad, 52 cN, 10 mm/min, ten trials a value. Angles in rad, 0: parallel.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from scipy.interpolate import PchipInterpolator

from cgfibre.errors import InputError

TRIALS = 10
#: of the 12k tow on the bare pulley (section 3.4.2)
PULLEY = 0.23

ANGLES_DEG = (0.0, 5.0, 10.0, 15.0, 25.0, 35.0, 45.0, 65.0, 75.0, 90.0)
#: filaments of a tow -> (mean, standard deviation) at each angle, Table 3-1
TABLE_3_1: dict[int, tuple[tuple[float, ...], tuple[float, ...]]] = {
    12000: (
        (0.429, 0.315, 0.285, 0.264, 0.24, 0.265, 0.198, 0.204, 0.21, 0.23),
        (0.008, 0.003, 0.002, 0.007, 0.01, 0.016, 0.004, 0.005, 0.004, 0.007),
    ),
    6000: (
        (0.438, 0.319, 0.287, 0.285, 0.235, 0.230, 0.203, 0.202, 0.195, 0.21),
        (0.014, 0.002, 0.003, 0.011, 0.008, 0.005, 0.005, 0.005, 0.004, 0.005),
    ),
    3000: (
        (0.442, 0.31, 0.274, 0.26, 0.216, 0.246, 0.198, 0.194, 0.195, 0.21),
        (0.013, 0.003, 0.004, 0.01, 0.005, 0.017, 0.004, 0.004, 0.004, 0.006),
    ),
    1500: (
        (0.457, 0.322, 0.286, 0.272, 0.240, 0.232, 0.203, 0.189, 0.19, 0.19),
        (0.021, 0.004, 0.002, 0.005, 0.014, 0.024, 0.008, 0.008, 0.003, 0.005),
    ),
}
#: of the 12k tow at each angle, Table 3-6: printed to two figures, without a deviation
TABLE_3_6 = (0.42, 0.32, 0.28, 0.27, 0.24, 0.26, 0.20, 0.21, 0.22, 0.23)
ROUNDING = 0.005


@dataclass(frozen=True)
class TowFriction:
    """Friction of tow on tow: ``mu``; ``deviation`` of a single trial; ``interval`` (95 %) of ``mu``.

    The interval joins, in quadrature, that of the mean of ten trials, 1.96 s/sqrt(10), and the difference between a
    shape-preserving cubic and a straight line where the value is interpolated.
    """

    mu: float
    deviation: float
    interval: float


def _folded(angle: float) -> float:
    """The angle between two lines in degrees, 0 to 90."""
    if not math.isfinite(angle):
        raise InputError("angle", angle, "a finite angle")
    degrees = abs(math.degrees(angle)) % 180.0
    return min(degrees, 180.0 - degrees)


def _at_angle(values: tuple[float, ...], degrees: float) -> tuple[float, float]:
    """Shape-preserving cubic through the table, and the straight line between its points."""
    cubic = float(PchipInterpolator(ANGLES_DEG, values)(degrees))
    return cubic, float(np.interp(degrees, ANGLES_DEG, values))


def tow_friction(angle: float, filaments: float = 12000, table: Literal["3-1", "3-6"] = "3-1") -> TowFriction:
    """Friction between tows that cross at ``angle`` (rad), each of ``filaments`` (1500 to 12 000).

    Monotone cubics in the angle (Fritsch and Carlson), straight lines in the logarithm of the tow size. Table 3-6 knows
    12k alone, to two figures: its deviation is that of Table 3-1 there. Raises InputError outside the tables.
    """
    sizes = sorted(TABLE_3_1)
    degrees = _folded(angle)
    if not sizes[0] <= filaments <= sizes[-1]:
        raise InputError("filaments", filaments, f"a tow of {sizes[0]} to {sizes[-1]} filaments: no other was tested")
    if table == "3-6":
        if filaments != sizes[-1]:
            raise InputError("filaments", filaments, f"{sizes[-1]}: Table 3-6 knows no other tow")
        cubic, line = _at_angle(TABLE_3_6, degrees)
        s = _at_angle(TABLE_3_1[sizes[-1]][1], degrees)[1]
        return TowFriction(cubic, s, math.hypot(1.96 * s / math.sqrt(TRIALS), ROUNDING, cubic - line))
    if table != "3-1":
        raise InputError("table", table, "'3-1' or '3-6'")
    logs = np.log2(sizes)
    cubics, lines = zip(*(_at_angle(TABLE_3_1[n][0], degrees) for n in sizes), strict=True)
    deviations = [_at_angle(TABLE_3_1[n][1], degrees)[1] for n in sizes]
    mu, line, s = (float(np.interp(math.log2(filaments), logs, v)) for v in (cubics, lines, deviations))
    return TowFriction(mu, s, math.hypot(1.96 * s / math.sqrt(TRIALS), mu - line))


def write_angle_table(path: Path, filaments: float = 12000, rows: int = 91) -> None:
    """A text table for a LAMMPS deck or another program: rows ``angle_deg mu interval`` from 0 to 90 degrees."""
    if rows < 2:
        raise InputError("rows", rows, "2 or more")
    lines = [f"# friction of {filaments:g}-filament carbon tows, Chakladar 2014, Table 3-1\n# angle_deg mu interval\n"]
    for degrees in np.linspace(0.0, 90.0, rows):
        f = tow_friction(math.radians(float(degrees)), filaments)
        lines.append(f"{degrees:.6g} {f.mu:.6g} {f.interval:.3g}\n")
    path.write_text("".join(lines))
