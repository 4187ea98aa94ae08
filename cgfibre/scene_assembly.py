"""``[assembly]`` of a scene: a bundle of filaments side by side, or a weave of tows."""

from __future__ import annotations

import math
import re
from contextlib import suppress
from typing import Annotated, Any, Literal

from pydantic import model_validator
from pydantic_core import PydanticCustomError

from cgfibre.errors import InputError
from cgfibre.scene_values import (
    NOT_GIVEN,
    Abridged,
    Angle,
    CentresText,
    Length,
    LengthOrZero,
    Modulus,
    Table,
    Twist,
    Value,
    refusal,
)
from cgfibre.subbundle_law import find_law

#: void fraction of touching filaments in hexagonal order, 1 - pi / (2 sqrt 3)
LEAST_VOID_FRACTION = 1.0 - math.pi / (2.0 * math.sqrt(3.0))


def full_rings(count: int) -> int:
    """Number of full rings that ``count`` filaments fill."""
    return (math.isqrt(12 * count - 3) - 3) // 6


class Migration(Table):
    """``[assembly.migration]``: filaments that wander in radius along their length (thesis Eqs 2-1, 2-2).

    ``period`` is the length of one wander out and back; ``minimum_radius`` the least radius over the bundle's;
    ``epsilon`` and ``beta`` the parameters of the packing probability p(R), Eq 2-1.
    """

    period: Length
    minimum_radius: Annotated[float, Value(least=0.0, below=1.0)] = 0.0
    epsilon: Annotated[float, Value(least=0.0, most=0.5)] = 0.05
    beta: Annotated[float, Value(least=0.0, most=100.0)] = 0.3


class Subbundle(Table):
    """``[assembly.subbundle]`` of level "subbundle".

    How many ``filaments`` one disc stands for (about: as many discs as the arrangement takes), by which ``law`` (a
    shipped one's name, or a file that ``cgfibre homogenise`` wrote) and ``mapping`` they touch, and the ``spread`` of
    their stiffness, evenly over +- that part, dealt out with the seed.
    """

    filaments: Annotated[int, Value(whole=True, least=2, most=100_000)] = 127
    law: str = "carbon-127"
    mapping: Literal["contact", "lattice"] = "contact"
    spread: Annotated[float, Value(least=0.0, most=0.5)] = 0.1

    @model_validator(mode="after")
    def _readable(self) -> Subbundle:
        try:
            find_law(self.law)
        except InputError as error:
            raise refusal("law", Abridged(repr(self.law[:40])), f"a sub-bundle law: {error}") from None
        return self


class Bundle(Table):
    """``[assembly]`` of kind "bundle": filaments side by side.

    Regular arrangements take their centre distance from ``pitch`` or from ``void_fraction`` (hexagonal relation, 0.31
    if neither is given), the random one takes ``fibre_volume_fraction``. ``aspect`` is width over height. The
    arrangement "file" takes ``centres``, such as those found in a micrograph; ``count`` is then theirs.
    """

    kind: Literal["bundle"] = "bundle"
    count: Annotated[int, Value(whole=True, least=1, most=10_000_000)]
    arrangement: Literal[
        "circular", "hexagonal", "rectangular", "elliptic", "racetrack", "virtual", "random", "file"
    ] = "circular"
    centres: Annotated[tuple[tuple[float, float], ...] | None, CentresText()] = None
    pitch: Annotated[float | None, Value("um", above=0.0, most=1e7)] = None
    void_fraction: Annotated[float | None, Value(least=LEAST_VOID_FRACTION, most=0.95)] = None
    fibre_volume_fraction: Annotated[float | None, Value(least=0.05, most=0.80)] = None
    first_angle: Angle = 0.0
    aspect: Annotated[float | None, Value(least=1e-3, most=1e3)] = None
    length: Length
    twist: Twist = 0.0
    twist_direction: Literal["Z", "S"] = "Z"
    twist_state: Literal["stress-free", "tensioned"] = "stress-free"
    migration: Migration | None = None
    jitter: LengthOrZero = 0.0
    seed: Annotated[int, Value(whole=True, least=0, most=2**31 - 1)] = 0
    subbundle: Subbundle | None = None

    @model_validator(mode="before")
    @classmethod
    def _fill(cls, data: Any) -> Any:
        packing = ("pitch", "void_fraction", "fibre_volume_fraction")
        if isinstance(data, dict) and data.get("arrangement") == "file":
            if "count" in data or "centres" not in data:
                return {"count": 1, **data}  # centres that are not there are named by a check of their own
            with suppress(PydanticCustomError):  # named by its own field
                return {**data, "count": len(CentresText().read(data["centres"]))}
            return {"count": 1, **data}
        if isinstance(data, dict) and data.get("arrangement") != "random" and not any(key in data for key in packing):
            return {**data, "void_fraction": 0.31}
        return data

    @model_validator(mode="after")
    def _consistent(self) -> Bundle:
        if self.arrangement == "file":
            self._check_file()
        elif self.centres is not None:
            expected = f"no such key: {self.arrangement} packing places the filaments itself (or arrangement = 'file')"
            raise refusal("centres", Abridged("(given)"), expected)
        elif self.arrangement == "random":
            for key in ("pitch", "void_fraction"):
                if getattr(self, key) is not None:
                    raise refusal(key, self._shown(key), "no such key: random packing takes fibre_volume_fraction")
            if self.fibre_volume_fraction is None:
                raise refusal("fibre_volume_fraction", NOT_GIVEN, "a number, at least 0.05 and at most 0.8")
        elif self.fibre_volume_fraction is not None:
            expected = f"no such key: {self.arrangement} packing takes pitch or void_fraction"
            raise refusal("fibre_volume_fraction", self.fibre_volume_fraction, expected)
        elif self.pitch is not None and self.void_fraction is not None:
            raise refusal("pitch", self._shown("pitch"), "either pitch or void_fraction, not both")
        if self.arrangement == "circular":
            self._checkfull_rings()
        elif self.first_angle != 0.0:
            expected = f"no such key: it turns the rings of a circular arrangement, this one is {self.arrangement}"
            raise refusal("first_angle", self._shown("first_angle"), expected)
        if self.aspect is not None and self.arrangement in ("circular", "hexagonal", "virtual", "random", "file"):
            expected = f"no such key: it shapes rectangular, elliptic and racetrack, this one is {self.arrangement}"
            raise refusal("aspect", self.aspect, expected)
        return self

    def _check_file(self) -> None:
        if self.centres is None:
            raise refusal("centres", NOT_GIVEN, CentresText.expected)
        for key in ("pitch", "void_fraction", "fibre_volume_fraction"):
            if getattr(self, key) is not None:
                raise refusal(key, self._shown(key), "no such key: the centres are those of assembly.centres")
        if self.count != len(self.centres):
            raise refusal("count", self.count, f"{len(self.centres)}, the number of centres (or no count)")

    def _checkfull_rings(self) -> None:
        n = full_rings(self.count)
        fewer, more = (1 + 3 * k * (k + 1) for k in (n, n + 1))
        if self.count != fewer:
            expected = f"full rings, 1 + 3 n (n + 1) filaments: {fewer} or {more} (or another arrangement)"
            raise refusal("count", self.count, expected)

    @property
    def straight(self) -> bool:
        """Whether filaments run straight along x."""
        return self.twist == 0.0 and self.migration is None


PATTERNS = "'plain', 'basket-2', 'twill-2/2' (over 2, under 2), 'satin-5', or rows such as ['10', '01'] (1: warp above)"
_TWILL = re.compile(r"twill-([1-9])/([1-9])")
_SATIN = re.compile(r"satin-([1-9][0-9]?)")
_BASKET = re.compile(r"basket-([1-9])")


def interlacing(pattern: str | tuple[str, ...]) -> tuple[tuple[bool, ...], ...]:
    """One repeat of a weave, rows weft, columns warp, true where the warp lies above.

    twill-a/b: a over, b under, one tow further in every row. satin-n: one crossing in n, moved by the step nearest to
    n/2 below it that has no common divisor with n (satin-5: 2, satin-8: 3). basket-n: plain with n tows as one.
    Raises ValueError for no such weave.
    """
    if not isinstance(pattern, str):
        rows = tuple(tuple(c == "1" for c in row) for row in pattern)
        if not rows or not rows[0] or any(len(r) != len(rows[0]) for r in rows) or set("".join(pattern)) - set("01"):
            raise ValueError(pattern)
        return rows
    if pattern == "plain":
        return ((True, False), (False, True))
    if m := _BASKET.fullmatch(pattern):
        n = int(m[1])
        return tuple(tuple((i // n + j // n) % 2 == 0 for j in range(2 * n)) for i in range(2 * n))
    if m := _TWILL.fullmatch(pattern):
        over, under = int(m[1]), int(m[2])
        n = over + under
        return tuple(tuple((j - i) % n < over for j in range(n)) for i in range(n))
    if m := _SATIN.fullmatch(pattern):
        n = int(m[1])
        steps = [k for k in range(2, n // 2 + 1) if math.gcd(k, n) == 1]
        if not steps:
            raise ValueError(pattern)
        # the warp shows but once in n: a weft-faced satin seen from above
        return tuple(tuple(j == i * steps[-1] % n for j in range(n)) for i in range(n))
    raise ValueError(pattern)


class Tow(Table):
    """``[assembly.tow]``: section and constants of the tows; ``[assembly.weft]`` overrides it for the weft.

    ``filaments`` of the scene's ``[filament]`` give the tow its EA, EI and GJ as so many that slide past each other.
    ``modulus`` makes it a solid of the section instead (EA = E A, EI = E I about both axes, GJ = G J); ``EA``, ``EI``,
    ``EI_in_plane``, ``GJ`` override each. ``EI_in_plane``, of a flat tow in its plane, is EI where that is given or
    the tow is one of loose filaments; it is used where it is given, or the cell is moved in its plane. ``ribbons``:
    chains side by side that stand for a flat tow. ``twist`` and ``packing`` are those of filaments that are modelled.
    """

    section: Literal["circular", "elliptic", "lenticular", "rectangular", "racetrack"] = "circular"
    width: Length
    thickness: Length
    filaments: Annotated[int | None, Value(whole=True, least=1, most=1_000_000)] = None
    modulus: Modulus | None = None
    EA: Annotated[float | None, Value("nN", above=0.0)] = None
    EI: Annotated[float | None, Value("nN*um**2", above=0.0)] = None
    EI_in_plane: Annotated[float | None, Value("nN*um**2", above=0.0)] = None
    GJ: Annotated[float | None, Value("nN*um**2", above=0.0)] = None
    ribbons: Annotated[int | Literal["auto"], Value(words=("auto",), whole=True, least=1, most=1000)] = "auto"
    twist: Twist = 0.0
    twist_direction: Literal["Z", "S"] = "Z"
    packing: Literal["random", "hexagonal"] = "random"

    @model_validator(mode="before")
    @classmethod
    def _fill(cls, data: Any) -> Any:
        if isinstance(data, dict) and data.get("section", "circular") == "circular":
            if "width" not in data and "thickness" in data:
                return {**data, "width": data["thickness"]}
            if "thickness" not in data and "width" in data:
                return {**data, "thickness": data["width"]}
        return data

    @model_validator(mode="after")
    def _consistent(self) -> Tow:
        if self.width < self.thickness * (1 - 1e-9):
            raise refusal("width", self._shown("width"), f"at least the thickness, {self.thickness:.4g} um")
        if self.section == "circular" and self.width > self.thickness * (1 + 1e-9):
            expected = f"the thickness, {self.thickness:.4g} um, with section = 'circular'"
            raise refusal("width", self._shown("width"), expected)
        if self.filaments is None and self.modulus is None and self.EA is None:
            raise refusal("filaments", NOT_GIVEN, "a number of filaments (or a modulus, or EA and EI)")
        if self.filaments is None and self.modulus is None and self.EI is None:
            raise refusal("EI", NOT_GIVEN, "the tow's bending rigidity, such as '0.2 N*mm**2', beside its EA")
        return self


class Spacing(Table):
    """Distance from tow to tow: ``warp`` between warp tows (along y), ``weft`` between weft tows (along x)."""

    warp: Length
    weft: Length


class Counts(Table):
    """Number of tows: ``warp`` (along x) and ``weft`` (along y)."""

    warp: Annotated[int, Value(whole=True, least=1, most=1000)]
    weft: Annotated[int, Value(whole=True, least=1, most=1000)]


class Weave(Table):
    """``[assembly]`` of kind "weave": warp tows along x and weft tows along y, crossing as the pattern says.

    ``cell`` "periodic": the fabric goes on for ever; "patch": so many tows, cut half-way between crossings. ``rest``:
    tows are free of stress as built, or "woven-in" straight ones that want to be straight again. ``gap`` leaves a
    distance at crossings. ``texgen`` names a .tg3 file (or holds its text) whose textile gives the tows' centre lines;
    tows, spacing and sizes of sections are checked against it.
    """

    kind: Literal["weave"] = "weave"
    pattern: str | tuple[str, ...] = "plain"
    cell: Literal["periodic", "patch"] = "periodic"
    tows: Counts
    spacing: Spacing
    tow: Tow
    weft: Tow
    rest: Literal["stress-free", "woven-in"] = "stress-free"
    gap: LengthOrZero = 0.0
    texgen: str | None = None
    seed: Annotated[int, Value(whole=True, least=0, most=2**31 - 1)] = 0

    @model_validator(mode="before")
    @classmethod
    def _fill(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        given = dict(data)
        if isinstance(given.get("pattern"), list):
            given["pattern"] = tuple(given["pattern"])
        for key in ("spacing", "tows"):
            if key in given and not isinstance(given[key], dict):
                given[key] = {"warp": given[key], "weft": given[key]}
        try:
            rows = interlacing(given.get("pattern", "plain"))
        except (ValueError, TypeError):
            raise refusal("pattern", given["pattern"], PATTERNS) from None
        given.setdefault("tows", {"warp": len(rows[0]), "weft": len(rows)})
        tow = given.get("tow")
        if isinstance(tow, dict):
            given["weft"] = tow | given["weft"] if isinstance(given.get("weft"), dict) else given.get("weft", tow)
        return given

    @model_validator(mode="after")
    def _consistent(self) -> Weave:
        rows = self.interlacing
        if self.cell == "periodic":
            for key, repeat in (("warp", len(rows[0])), ("weft", len(rows))):
                count = getattr(self.tows, key)
                if count % repeat:
                    expected = f"a multiple of {repeat}, the pattern's repeat (or cell = 'patch')"
                    raise refusal(f"tows.{key}", count, expected)
        for spacing, tow, name in ((self.spacing.warp, self.tow, "warp"), (self.spacing.weft, self.weft, "weft")):
            if tow.width > spacing:
                expected = f"at least {tow.width:.4g} um, the width of a {name} tow"
                raise refusal(f"spacing.{name}", f"{spacing:.4g} um", expected)
        return self

    @property
    def interlacing(self) -> tuple[tuple[bool, ...], ...]:
        """One repeat: rows weft, columns warp, true where the warp lies above."""
        return interlacing(self.pattern)

    @property
    def size(self) -> tuple[float, float]:
        """(x, y) of the cell or patch, um."""
        return self.tows.weft * self.spacing.weft, self.tows.warp * self.spacing.warp


class PerTow(Table):
    """A force on every warp and on every weft tow."""

    warp: Annotated[float, Value("nN", least=0.0)] = 0.0
    weft: Annotated[float, Value("nN", least=0.0)] = 0.0


class PlaneStrain(Table):
    """Strain of the cell along x (warp) and y (weft)."""

    x: Annotated[float, Value(above=-0.5, most=0.5)] = 0.0
    y: Annotated[float, Value(above=-0.5, most=0.5)] = 0.0


class Cell(Table):
    """``[cell]``: what happens to a weave in its plane: strain, trellis shear (the weft turns, lengths along it stay),
    tension a tow along warp and weft. A patch takes the same at the ends of its tows.

    ``when``: "before" the platen moves, "during" its first loading, in proportion to its way until it has gone ``over``
    so much ("auto": the way to that loading's stop, or a third of the way planned where it stops by load), or "after"
    the last loading, the platens held. Then it stays, to the end.
    Edges are "held" (the fabric cannot spread), or "free" where no strain is given: without stress, or under tension.
    """

    strain: PlaneStrain = PlaneStrain()
    tension: PerTow = PerTow()
    edges: Literal["held", "free"] = "held"
    shear: Annotated[float, Value("rad", above=-1.05, below=1.05)] = 0.0
    when: Literal["before", "during", "after"] = "before"
    over: Annotated[float | Literal["auto"], Value("um", words=("auto",), above=0.0, most=1e7)] = "auto"

    @property
    def at_rest(self) -> bool:
        """Whether nothing happens in the plane."""
        return self.strain == PlaneStrain() and self.tension == PerTow() and self.edges == "held" and self.shear == 0.0

    @model_validator(mode="before")
    @classmethod
    def _both(cls, data: Any) -> Any:
        if isinstance(data, dict) and "tension" in data and not isinstance(data["tension"], dict):
            return {**data, "tension": {"warp": data["tension"], "weft": data["tension"]}}
        return data
