"""Laws of compaction of tows and fibre beds: the thesis' empirical law, and van Wyk's, Toll's and Gutowski's.

Pressures in MPa, strains and volume fractions as fractions, twist in turns/cm, pre-load in cN: the units in which the
thesis' constants are printed (``a0`` carries them). Arrays broadcast. Every function raises
:class:`cgfibre.errors.InputError` for a value out of its range.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cgfibre.errors import InputError
from cgfibre.mechanics._checks import FloatArray, finite, non_negative, positive


@dataclass(frozen=True)
class Conditions:
    """How a tow was tested: ``tow`` thousands of filaments, ``twist`` turns/cm, ``preload`` cN.

    Raises InputError for a tow not above 0, a twist outside 0 <= tau < 1 (the law's (1 - tau)) and a negative pre-load.
    """

    tow: float
    twist: float
    preload: float

    def __post_init__(self) -> None:
        positive("tow", self.tow)
        non_negative("preload", self.preload)
        if not 0 <= self.twist < 1:
            raise InputError("twist", self.twist, "turns/cm from 0 to below 1")


@dataclass(frozen=True)
class EmpiricalLaw:
    """Strain of a tow under pressure: eps = a0 (1 - tau)^a1 n^(-a2) (1 + l)^(-a3) p^b (thesis Eq 5-4).

    tau turns/cm, n thousands of filaments, l pre-load in cN, p MPa. The defaults are the thesis' constants for T700
    (deviation within 8 % as stated there). Signs follow the trends: more twist, more filaments and more pre-load all
    give less strain at a pressure.

    ERRATA. The print drops the signs of two exponents in places (they stand here as the trends ask). The constants do
    not reproduce the trends quoted beside them: twist 0.26 to 0.55 turns/cm raises the pressure at a strain 4.5 times
    (quoted: 3), 1.5k to 12k lowers the strain by 56 % (quoted: 40 %), pre-load times 5 (10 to 50 cN) by 6 % (quoted:
    12 %), the modulus of a 12k tow at 50 cN, 0.55 turns/cm and a strain of 0.6 is 3.5 GPa (quoted: 8 GPa); and a 1.5k
    tow (10 cN, 0.26 turns/cm) would be pressed to nothing at 20 MPa. :meth:`strain` does not hide it and may exceed 1.
    """

    a0: float = 0.8
    a1: float = 0.7
    a2: float = 0.4
    a3: float = 0.04
    b: float = 0.23

    def __post_init__(self) -> None:
        positive("a0", self.a0)
        positive("b", self.b)
        for key in ("a1", "a2", "a3"):
            finite(key, getattr(self, key))

    def coefficient(self, at: Conditions) -> float:
        """a of eps = a p^b (thesis Eq 5-1) under these conditions, MPa^-b."""
        return self.a0 * (1 - at.twist) ** self.a1 * at.tow ** (-self.a2) * (1 + at.preload) ** (-self.a3)

    def strain(self, pressure: npt.ArrayLike, at: Conditions) -> FloatArray:
        """Thickness strain at a pressure (MPa)."""
        return np.asarray(self.coefficient(at) * non_negative("pressure", pressure) ** self.b)

    def pressure(self, strain: npt.ArrayLike, at: Conditions) -> FloatArray:
        """Pressure at a strain, (eps/a)^(1/b), MPa."""
        return np.asarray((non_negative("strain", strain) / self.coefficient(at)) ** (1 / self.b))

    def modulus(self, strain: npt.ArrayLike, at: Conditions) -> FloatArray:
        """Tangent modulus dp/deps = (1/(a b)) (eps/a)^(1/b - 1), MPa (thesis Eq 5-2)."""
        a = self.coefficient(at)
        return np.asarray((non_negative("strain", strain) / a) ** (1 / self.b - 1) / (a * self.b))

    def thickness(self, initial: npt.ArrayLike, pressure: npt.ArrayLike, at: Conditions) -> FloatArray:
        """Compacted thickness t0 (1 - eps), in the unit of ``initial``.

        Errors: a pressure at which the law leaves nothing (eps >= 1): outside the range it was fitted in.
        """
        strain = self.strain(pressure, at)
        if np.any(strain >= 1):
            most = float(self.pressure(1.0, at))
            given = float(np.max(np.asarray(pressure)))
            raise InputError("pressure", given, f"below {most:.4g} MPa, where the law ends")
        return np.asarray(positive("initial", initial) * (1 - strain))

    def thickness_band(
        self, pressure: npt.ArrayLike, at: Conditions, deviation: float | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """(low, high) thickness over the initial one where the strain errs by ``deviation`` (None: the thesis' 8 %)."""
        strain = self.strain(pressure, at)
        share = DEVIATION if deviation is None else float(non_negative("deviation", deviation))
        return np.maximum(1 - strain * (1 + share), 0.0), np.maximum(1 - strain * (1 - share), 0.0)


#: the constants printed in the thesis, T700 carbon tows of 1.5k to 12k
THESIS_LAW = EmpiricalLaw()
#: largest deviation of the thesis' tests from its law, of the strain (5.4.5)
DEVIATION = 0.08
#: least and most of what was tested (5.3.2): thousands of filaments, turns/cm, cN
TESTED = (Conditions(1.5, 0.26, 10.0), Conditions(12.0, 0.55, 50.0))
#: the anvil along the tow, mm, and the force at which it turned back, N (5.3.1)
ANVIL_WIDTH, ANVIL_FORCE = 0.5, 12.0


def beyond_tests(at: Conditions) -> tuple[str, ...]:
    """What of these conditions lies outside the tests behind the thesis' law, each as a phrase; empty within them."""
    low, high = TESTED
    names = {"tow": "thousand filaments", "twist": "turns/cm", "preload": "cN"}
    return tuple(
        f"{key} {getattr(at, key):g} {unit} (tested {getattr(low, key):g} to {getattr(high, key):g})"
        for key, unit in names.items()
        if not getattr(low, key) <= getattr(at, key) <= getattr(high, key)
    )


def most_anvil_pressure(width: npt.ArrayLike) -> FloatArray:
    """Highest mean pressure that the thesis' tester can put on a tow ``width`` mm wide, MPa: 12 N/(0.5 mm x width).

    A 12k tow of 0.45 mm2 of fibre cannot be narrower than 0.77 mm (solid and round), so 31 MPa at most, and 3.7 MPa at
    the 6.5 mm of its flat section. ERRATUM: the 50, 100 and 200 MPa at which trends of 12k tows are quoted (5.4.4,
    5.4.5) are beyond either.
    """
    return ANVIL_FORCE / (ANVIL_WIDTH * positive("width", width))


@dataclass(frozen=True)
class FrictionPower:
    """Thickness of a section of filaments under a force per width: t = c P^(a mu - b) (thesis Eqs 7-6).

    t and c in mm, P in N/mm, mu the friction between filaments (a = 0: none felt). P = 1 N/mm gives c whatever mu is.
    """

    c: float
    a: float
    b: float

    def __post_init__(self) -> None:
        positive("c", self.c)
        finite("a", self.a)
        finite("b", self.b)

    def thickness(self, load: npt.ArrayLike, friction: npt.ArrayLike) -> FloatArray:
        """Thickness at a load (N/mm) and a friction coefficient, mm."""
        exponent = self.a * non_negative("friction", friction) - self.b
        return np.asarray(self.c * positive("load", load) ** exponent)


#: the thesis' fits for dry filaments (mu 0.20..0.48) and wet ones (0.02..0.18), 127 in a circle
THESIS_DRY, THESIS_WET = FrictionPower(0.08, 0.12, 0.21), FrictionPower(0.08, 0.0, 0.22)


@dataclass(frozen=True)
class FibreBed:
    """Pressure of a bed of fibres from its volume fraction: p = k (Vf^n - V0^n), MPa.

    With n = 3 it is van Wyk's law for fibres at random in space (Journal of the Textile Institute 37, 1946, T285): the
    number of contacts rises and the free lengths between them fall with Vf, k = K E, V0 where the pressure vanishes.
    Toll (Polymer Engineering and Science 38, 1998, 1337) derives the exponent from the arrangement: 3 in space, 5 for
    planar random mats, and finds 7 to 15 for aligned rovings and woven fabrics.
    """

    k: float
    n: float
    V0: float

    def __post_init__(self) -> None:
        for key in ("k", "n", "V0"):
            positive(key, getattr(self, key))

    def pressure(self, volume_fraction: npt.ArrayLike) -> FloatArray:
        """Pressure at a volume fraction, MPa; 0 below V0."""
        v = non_negative("volume_fraction", volume_fraction)
        return np.asarray(np.maximum(self.k * (v**self.n - self.V0**self.n), 0.0))

    def volume_fraction(self, pressure: npt.ArrayLike) -> FloatArray:
        """Volume fraction at a pressure, (V0^n + p/k)^(1/n)."""
        return np.asarray((self.V0**self.n + non_negative("pressure", pressure) / self.k) ** (1 / self.n))


@dataclass(frozen=True)
class AlignedBed:
    """Gutowski's law of aligned wavy fibres: p = A (sqrt(Vf/V0) - 1)/(sqrt(Va/Vf) - 1)^4, MPa.

    Fibres are beams bent between contacts whose distance over height stays the same; V0 is the volume fraction without
    load, Va the largest that can be reached, A = 3 pi E/beta^4 with beta the span over height of a wave (Gutowski,
    Morigaki and Cai, Journal of Composite Materials 21, 1987, 172).
    """

    A: float
    V0: float
    Va: float

    def __post_init__(self) -> None:
        for key in ("A", "V0", "Va"):
            positive(key, getattr(self, key))
        if not self.V0 < self.Va <= 1:
            raise InputError("Va", self.Va, f"above V0 = {self.V0:g}, at most 1")

    def pressure(self, volume_fraction: npt.ArrayLike) -> FloatArray:
        """Pressure at a volume fraction below Va, MPa; 0 below V0."""
        v = positive("volume_fraction", volume_fraction)
        if np.any(v >= self.Va):
            raise InputError("volume_fraction", float(np.max(v)), f"below Va = {self.Va:g}")
        rise = np.maximum(np.sqrt(v / self.V0) - 1, 0.0)
        return np.asarray(self.A * rise / (np.sqrt(self.Va / v) - 1) ** 4)

    def volume_fraction(self, pressure: npt.ArrayLike) -> FloatArray:
        """Volume fraction at a pressure: the root of the law between V0 and Va, by bisection to rounding."""
        p = non_negative("pressure", pressure)
        low, high = np.full(p.shape, self.V0), np.full(p.shape, self.Va)
        for _ in range(60):
            middle = 0.5 * (low + high)
            # written without the quotient, which overflows near Va
            below = self.A * (np.sqrt(middle / self.V0) - 1) < p * (np.sqrt(self.Va / middle) - 1) ** 4
            low, high = np.where(below, middle, low), np.where(below, high, middle)
        return np.asarray(0.5 * (low + high))
