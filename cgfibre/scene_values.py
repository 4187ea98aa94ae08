"""Values of a scene: how text and numbers of a key are read, checked, described in a message, and written back.

Annotations for pydantic models; quantities are text with a unit outside and floats in engine units inside.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from cgfibre import readers, units
from cgfibre.errors import InputError


class _NotGiven:
    """Stands for a value that is not there."""

    def __repr__(self) -> str:
        return "(not given)"


class Abridged:
    """Stands for a value too long for one line."""

    def __init__(self, text: str) -> None:
        self.text = text

    def __repr__(self) -> str:
        return self.text


NOT_GIVEN = _NotGiven()


class Table(BaseModel):
    """A table of a scene: no other keys than its fields, never changed once made."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    def _shown(self, key: str) -> object:
        """The value of a field as the scene writes it."""
        return self.model_dump(include={key})[key]


def refusal(key: str, value: object, expected: str) -> PydanticCustomError:
    """An error of our own for pydantic to carry; ``key`` is relative to the table that raises it."""
    return PydanticCustomError("refused", "{expected}", {"key": key, "value": value, "expected": expected})


@dataclass(frozen=True)
class Value:
    """Annotation of a number or a quantity: how it is read, checked, described and written.

    Attributes: ``unit`` engine unit of a quantity, empty for a plain number; ``words`` accepted in its place;
    ``whole`` for whole numbers; bounds in engine units: ``above`` and ``below`` are excluded, ``least`` and ``most``
    are not.
    """

    unit: str = ""
    words: tuple[str, ...] = ()
    whole: bool = False
    above: float | None = None
    least: float | None = None
    below: float | None = None
    most: float | None = None

    def __get_pydantic_core_schema__(self, source: object, handler: object) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(
            self.read, serialization=core_schema.plain_serializer_function_ser_schema(self.write)
        )

    @property
    def expected(self) -> str:
        """What is wanted, for a message."""
        kind = units.describe(self.unit) if self.unit else "a whole number" if self.whole else "a number"
        low, high = self._bounds()
        return self._or_words(kind) + (f", {' and '.join(b for b in (low, high) if b)}" if low or high else "")

    def read(self, value: object) -> float | int | str:
        """Engine value of what stands in the scene; an error that pydantic carries if it is not that."""
        if isinstance(value, str) and value in self.words:
            return value
        if self.unit:
            try:
                number: float = units.parse(value, self.unit, "")
            except InputError as error:
                raise refusal("", value, self._or_words(error.expected)) from None
        elif isinstance(value, bool) or not isinstance(value, int if self.whole else (int, float)):
            raise refusal("", value, self.expected)
        else:
            number = value if self.whole else float(value)
        if not self._within(number):
            raise refusal("", value, self.expected)
        return number

    def write(self, value: float | int | str | None) -> float | int | str | None:
        """The text or number that :meth:`read` takes back to ``value``."""
        return units.format(value, self.unit) if self.unit and isinstance(value, float | int) else value

    def _or_words(self, kind: str) -> str:
        return " or ".join([*(repr(w) for w in self.words), kind])

    def _within(self, number: float) -> bool:
        return (
            math.isfinite(number)
            and (self.above is None or number > self.above)
            and (self.least is None or number >= self.least)
            and (self.below is None or number < self.below)
            and (self.most is None or number <= self.most)
        )

    def _bounds(self) -> tuple[str, str]:
        def written(bound: float) -> str:
            return (
                units.format(bound, self.unit)
                if self.unit and bound
                else f"{bound:.10g}"
                if self.whole
                else f"{bound:g}"
            )

        low = f"above {written(self.above)}" if self.above is not None else ""
        low = f"at least {written(self.least)}" if self.least is not None else low
        high = f"below {written(self.below)}" if self.below is not None else ""
        high = f"at most {written(self.most)}" if self.most is not None else high
        return low, high


#: the upper bounds catch a wrong prefix, no more
Length = Annotated[float, Value("um", above=0.0, most=1e7)]
Modulus = Annotated[float, Value("kPa", least=1.0, most=1e10)]
Density = Annotated[float, Value("pg/um**3", least=0.01, most=30.0)]
LineForce = Annotated[float, Value("nN/um", above=0.0)]
#: signed
Angle = Annotated[float, Value("rad", least=-2.0 * math.pi, most=2.0 * math.pi)]
#: turns per length; the direction is a key of its own
Twist = Annotated[float, Value("turn/um", least=0.0, most=1.0)]
#: zero allowed
LengthOrZero = Annotated[float, Value("um", least=0.0, most=1e7)]
ForceOrZero = Annotated[float, Value("nN", least=0.0)]
TimeOrZero = Annotated[float, Value("us", least=0.0)]
#: or a word
AutoLength = Annotated[float | Literal["auto"], Value("um", words=("auto",), above=0.0, most=1e7)]
FullLength = Annotated[float | Literal["full"], Value("um", words=("full",), above=0.0, most=1e7)]
AutoSpeed = Annotated[float | Literal["auto"], Value("um/us", words=("auto",), above=0.0, most=1e3)]
AutoTime = Annotated[float | Literal["auto"], Value("us", words=("auto",), above=0.0)]
AutoSteps = Annotated[int | Literal["auto"], Value(words=("auto",), whole=True, least=1000, most=10**9)]
AutoFactor = Annotated[float | Literal["auto"], Value(words=("auto",), least=1.0, most=1e6)]


@dataclass(frozen=True)
class CentresText:
    """Annotation of filament centres: text of a table with the columns y and z (with units), to pairs in um, and back.

    In a file the key may name a CSV file in place of the text: :func:`load_scene` reads it.
    """

    expected: ClassVar[str] = "a CSV file of filament centres, with columns y and z such as 'y_um,z_um'"

    def __get_pydantic_core_schema__(self, source: object, handler: object) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(
            self.read, serialization=core_schema.plain_serializer_function_ser_schema(self.write)
        )

    def read(self, value: object) -> tuple[tuple[float, float], ...]:
        """((y, z), ...) um; an error that pydantic carries if it is no such table."""
        if not isinstance(value, str) or "\n" not in value:
            raise refusal("", value, self.expected)
        try:
            table = readers.parse_table(value.strip().splitlines(), "centres")
            y, z = (table.quantity(table.index(name, "column"), "um", "") for name in ("y", "z"))
        except InputError as error:
            raise refusal("", Abridged(f"{value.strip()[:20]!r} ..."), f"{self.expected}: {error}") from None
        return tuple(zip(y.tolist(), z.tolist(), strict=True))

    def write(self, value: tuple[tuple[float, float], ...] | None) -> str | None:
        """The text that :meth:`read` takes back to ``value``."""
        return None if value is None else "y_um,z_um\n" + "".join(f"{y!r},{z!r}\n" for y, z in value)


#: (overlap um, force per length nN/um or pressure kPa, the same on the way back or None) of every row
LawRow = tuple[float, float, float | None]


@dataclass(frozen=True)
class LawRows:
    """A tabulated law: ``of`` "force_per_length" (nN/um) or "pressure" (kPa); rows of rising overlap, um."""

    of: str
    rows: tuple[LawRow, ...]


@dataclass(frozen=True)
class LawText:
    """Annotation of a law: text of a table with the columns overlap and force_per_length (or pressure) with units, a
    third, "unloading", giving the way back, to :class:`LawRows` and back. In a file the key may name a CSV file."""

    expected: ClassVar[str] = (
        "a CSV file with the columns 'overlap (um)' and 'force_per_length (N/mm)' or 'pressure (MPa)'"
    )

    def __get_pydantic_core_schema__(self, source: object, handler: object) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(
            self.read, serialization=core_schema.plain_serializer_function_ser_schema(self.write)
        )

    def read(self, value: object) -> LawRows | None:
        """The law, none of an empty text; an error that pydantic carries if it is no such table."""
        if value == "":
            return None
        if not isinstance(value, str) or "\n" not in value:
            raise refusal("", value, self.expected)
        try:
            table = readers.parse_table(value.strip().splitlines(), "law")
            d = table.quantity(table.index("overlap", "column"), "um", "")
            of = "pressure" if table.find(("pressure",)) is not None else "force_per_length"
            unit = "kPa" if of == "pressure" else "nN/um"
            load = table.quantity(table.index(of, "column"), unit, "")
            back = table.find(("unloading",))
            unload = None if back is None else table.quantity(back, unit, "")
        except InputError as error:
            raise refusal("", Abridged(f"{value.strip()[:20]!r} ..."), f"{self.expected}: {error}") from None
        if (
            len(d) < 2
            or d[0] < 0
            or load[0] < 0
            or load[-1] <= 0
            or (np.diff(d) <= 0).any()
            or (np.diff(load) < 0).any()
        ):
            expected = f"{self.expected}: rising overlaps from 0 on, forces that never fall"
            raise refusal("", Abridged(f"{value.strip()[:20]!r} ..."), expected)
        ways = [None] * len(d) if unload is None else unload.tolist()
        return LawRows(of, tuple(zip(d.tolist(), load.tolist(), ways, strict=True)))

    def write(self, value: LawRows | None) -> str | None:
        """The text that :meth:`read` takes back to ``value``."""
        if value is None:
            return None
        unit = "kPa" if value.of == "pressure" else "nN/um"
        back = value.rows[0][2] is not None
        head = f"overlap (um),{value.of} ({unit})" + (f",unloading ({unit})" if back else "")
        rows = (",".join(repr(x) for x in row if x is not None) for row in value.rows)
        return "\n".join([head, *rows]) + "\n"


class AngleTable:
    """Annotation of friction against the crossing angle: [["0 deg", 0.42], ["90 deg", 0.23]] to pairs (rad, mu)."""

    expected: ClassVar[str] = 'rows of a rising angle and a coefficient, such as [["0 deg", 0.42], ["90 deg", 0.23]]'

    def __get_pydantic_core_schema__(self, source: object, handler: object) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(
            self.read, serialization=core_schema.plain_serializer_function_ser_schema(self.write)
        )

    def read(self, value: object) -> tuple[tuple[float, float], ...]:
        """((angle rad, mu), ...); an error that pydantic carries if it is no such table."""
        if not isinstance(value, list | tuple) or len(value) < 2:
            raise refusal("", value, self.expected)
        rows = []
        for row in value:
            try:
                angle, mu = row
                rows.append((units.parse(angle, "rad", ""), Value(least=0.0, most=2.0).read(mu)))
            except (TypeError, ValueError, InputError, PydanticCustomError):
                raise refusal("", row, self.expected) from None
        angles = [angle for angle, _ in rows]
        if angles != sorted(set(angles)) or angles[0] < 0 or angles[-1] > math.pi / 2 * (1 + 1e-12):
            raise refusal("", value, self.expected + ", between 0 and 90 deg")
        return tuple((float(angle), float(mu)) for angle, mu in rows)

    def write(self, value: tuple[tuple[float, float], ...] | None) -> list[list[object]] | None:
        """The rows that :meth:`read` takes back to ``value``."""
        return None if value is None else [[units.format(angle, "rad"), mu] for angle, mu in value]


PoissonRatio = Annotated[float, Value(least=0.0, most=0.5)]
Friction = Annotated[float, Value(least=0.0, most=2.0)]
