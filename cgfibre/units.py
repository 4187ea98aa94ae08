"""Quantities at the door: text with a unit in, a float in engine units out, and back again.

Engine units (LAMMPS ``micro``): um, us, pg, nN; so kPa = nN/um^2 for stress, um/us for speed. Angles are in rad, twist
in turn/um. Everything beyond :mod:`cgfibre.scene` is a plain float in these units.

The registry holds only what fibre mechanics needs, and an angle is a dimension of its own: with pint's own registry
"10 %" is an angle, "0.26 1/cm" a twist that is wrong by 2 pi, and "1,5 um" fifteen. All of these are refused here.
"""

from __future__ import annotations

import math
import re
from decimal import Decimal, InvalidOperation
from functools import cache, lru_cache
from typing import TYPE_CHECKING

from cgfibre.errors import InputError

if TYPE_CHECKING:
    import pint

_PI = "3.14159265358979323846264338327950288"

_DEFINITIONS = f"""
pico- = 1e-12 = p-
nano- = 1e-9 = n-
micro- = 1e-6 = u- = µ- = μ-
milli- = 1e-3 = m-
centi- = 1e-2 = c-
deci- = 1e-1 = d-
kilo- = 1e3 = k-
mega- = 1e6 = M-
giga- = 1e9 = G-
tera- = 1e12 = T-
meter = [length] = m = metre
gram = [mass] = g
second = [time] = s = sec
radian = [angle] = rad
degree = {_PI} / 180 * radian = deg = °
turn = 2 * {_PI} * radian = _ = revolution = rev
micron = 1e-6 * meter
inch = 0.0254 * meter = in
mil = 0.001 * inch
minute = 60 * second = min
hour = 3600 * second = h
hertz = 1 / second = Hz
newton = kilogram * meter / second ** 2 = N
dyne = 1e-5 * newton = dyn
gram_force = 9.80665e-3 * newton = gf
kilogram_force = 9.80665 * newton = kgf
pound_force = 4.4482216152605 * newton = lbf
pascal = newton / meter ** 2 = Pa
bar = 1e5 * pascal
pound_force_per_square_inch = pound_force / inch ** 2 = psi
kip_per_square_inch = 1000 * pound_force_per_square_inch = ksi
"""

#: what a value in each engine unit is called in a message, and an example
KINDS: dict[str, tuple[str, str]] = {
    "um": ("a length", "7 um"),
    "nN": ("a force", "0.04 cN"),
    "kPa": ("a stress", "230 GPa"),
    "us": ("a time", "50 us"),
    "um/us": ("a speed", "0.1 m/s"),
    "pg/um**3": ("a density", "1800 kg/m**3"),
    "rad": ("an angle", "90 deg"),
    "turn/um": ("a twist", "0.26 turn/cm"),
    "nN/um": ("a force per length", "1 N/mm"),
    "MHz": ("a frequency", "4 Hz"),
    "nN*um**2": ("a rigidity", "0.2 N*mm**2"),
}

#: units that people write a value in, best first
_WRITTEN: dict[str, tuple[str, ...]] = {
    "um": ("um", "mm", "m"),
    "nN": ("N", "cN", "nN"),
    "kPa": ("GPa", "MPa", "kPa"),
    "us": ("us", "ms", "s"),
    "um/us": ("m/s", "mm/s", "um/us"),
    "pg/um**3": ("kg/m**3",),
    "rad": ("deg", "rad"),
    "turn/um": ("turn/cm", "turn/mm", "turn/um"),
    "nN/um": ("N/mm", "nN/um"),
    "MHz": ("Hz", "MHz"),
    "nN*um**2": ("N*mm**2", "nN*um**2"),
}

_NUMBER = re.compile(r"\s*([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)\s*(.*?)\s*", re.DOTALL)
_FACTOR = r"(?:[^\W\d]+|°)(?:(?:\*\*|\^)?-?[1-9])?"
_UNIT = re.compile(rf"{_FACTOR}(?:(?:\s*[*/·]\s*|\s+){_FACTOR})*")
#: m3, m^3, m-3 are powers like m**3
_POWER = re.compile(r"([^\W\d]|°)(?:\^)?(-?[1-9])")
#: powers of ten beyond which no float reaches
_DIGITS = 400


@cache
def _registry() -> pint.UnitRegistry:
    # imported late: the command line must answer at once where no quantity is read
    import pint

    registry: pint.UnitRegistry = pint.UnitRegistry(None, non_int_type=Decimal)
    registry.load_definitions(_DEFINITIONS.strip().splitlines())
    return registry


@lru_cache(maxsize=256)
def _factor(unit: str, target: str) -> Decimal | None:
    """Size of ``unit`` in ``target``; ``None`` where the dimensions differ. Raises KeyError for an unknown unit."""
    import pint

    registry = _registry()
    try:
        parsed = registry.parse_units(_POWER.sub(r"\1**\2", unit.replace("·", "*")))
    except (pint.errors.PintError, ValueError) as error:  # "NaN" is a number to pint, a ValueError
        raise KeyError(unit) from error
    try:
        return Decimal(registry.Quantity(Decimal(1), parsed).to(target).magnitude)
    except pint.errors.DimensionalityError:
        return None


def describe(unit: str) -> str:
    """What text a quantity of the engine unit ``unit`` wants, for a message: "a length such as '7 um'"."""
    if unit not in KINDS:
        return f"a quantity with a unit like {unit}"
    kind, example = KINDS[unit]
    return f"{kind} such as {example!r}"


def parse(text: object, unit: str, key: str) -> float:
    """Text such as "7 um" or "0.04 cN" as a float in the engine unit ``unit``.

    A number, then a unit of any prefix: products with ``*`` or a space, quotients with ``/``, powers as ``m**3``,
    ``m^3`` or ``m3``. The conversion is done in decimals and rounded once, so "0.04 cN" is 400000.0 nN exactly.

    Raises :class:`InputError` naming ``key`` for a bare number, an unknown unit, a unit of another dimension, a value
    that is not finite, or what is not a quantity at all.
    """
    wanted = describe(unit)
    if isinstance(text, bool) or not isinstance(text, str | int | float):
        raise InputError(key, text, wanted)
    if not isinstance(text, str):
        raise InputError(key, text, f"{wanted}: a bare number has no unit")
    match = _NUMBER.fullmatch(text)
    if match is None or "," in text:
        raise InputError(key, text, f"{wanted}: a number (with a decimal point), then a unit")
    number, symbol = match.groups()
    if not symbol:
        raise InputError(key, text, f"{wanted}: a bare number has no unit")
    if _UNIT.fullmatch(symbol) is None:
        raise InputError(key, text, f"{wanted}: {symbol!r} is not a unit")
    try:
        factor = _factor(symbol, unit)
    except KeyError:
        raise InputError(key, text, f"{wanted}: {symbol!r} is not a known unit") from None
    if factor is None:
        raise InputError(key, text, f"{wanted}: {symbol!r} does not measure {KINDS.get(unit, (unit,))[0]}")
    value = _scaled(number, factor)
    if value is None:
        raise InputError(key, text, f"{wanted}: a finite value")
    return value


def _scaled(number: str, factor: Decimal) -> float | None:
    """Number times factor, rounded once; ``None`` where no float holds it."""
    try:
        amount = Decimal(number)
    except InvalidOperation:  # an exponent beyond what Decimal holds
        return None
    if amount and abs(amount.adjusted()) > _DIGITS:
        return None
    value = float(amount * factor)
    return value if math.isfinite(value) and (value or not amount) else None


def format(value: float, unit: str) -> str:
    """A float in the engine unit ``unit`` as text that :func:`parse` gives back exactly.

    The unit is the one that writes it shortest among those in use: 400000.0 nN is "0.04 cN". Raises
    :class:`InputError` for a value that is not finite (there is no text for it).
    """
    if not math.isfinite(value):
        raise InputError("value", value, f"a finite value in {unit}")
    written = _WRITTEN.get(unit, (unit,))
    if value == 0.0:
        return f"0 {written[0]}"
    # the engine unit is exact; three digits more are worth one that people use, and four no exponent
    best, cost = f"{_plain(value)} {unit}", _digits(_plain(value)) + (0 if unit in written else 3)
    for other in reversed(written):
        factor = _factor(other, unit)
        if factor is None:
            continue
        number = _plain(float(Decimal(repr(float(value))) / factor))
        if _digits(number) <= cost and _scaled(number, factor) == value:
            best, cost = f"{number} {other}", _digits(number)
    return best


def _digits(number: str) -> int:
    return len(number) + (4 if "e" in number else 0)


def _plain(number: float) -> str:
    return repr(float(number)).removesuffix(".0")
