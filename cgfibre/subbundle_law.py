"""How a sub-bundle answers when it is squeezed, in numbers without dimension, as a TOML file holds it.

Filaments that touch with a stiffness k' a length answer alike whatever k' and their diameter D are: stresses are P =
p/k', and a disc in the place of n filaments, D_s = sqrt(n) D wide so that the fibre area stays, has overlaps x = d/D_s
and forces a length phi = f/(k' D_s). So one law, of one coefficient of friction, serves every round filament.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from importlib import resources
from typing import Any

import numpy as np
import tomli_w

from cgfibre.build.system import FloatArray
from cgfibre.errors import InputError

#: volume fraction of equal discs that touch in hexagonal order, pi/(2 sqrt 3)
HEXAGONAL = math.pi / (2 * math.sqrt(3))
FORM = "cgfibre sub-bundle law 1"


@dataclass(frozen=True)
class Table:
    """Force against overlap, without dimension: ``overlap`` x and ``load`` phi, both (n,) rising from 0; ``unload``
    (n,) on the way back from the last overlap, or None; ``size``: the disc's diameter over sqrt(n) D."""

    overlap: FloatArray
    load: FloatArray
    unload: FloatArray | None = None
    size: float = 1.0

    @property
    def steepest(self) -> float:
        """Largest slope between two rows, d phi/d x."""
        return float(np.max(np.diff(self.load) / np.diff(self.overlap)))


@dataclass(frozen=True)
class State:
    """Mean pressure P = p/k' against the volume fraction of filaments: (n,) ``fraction`` rising, ``load``, ``unload``,
    and ``spread``, the standard deviation of ``load`` over the runs."""

    fraction: FloatArray
    load: FloatArray
    unload: FloatArray
    spread: FloatArray


@dataclass(frozen=True)
class SubbundleLaw:
    """A homogenised sub-bundle: the ``state`` curve, what follows from it for discs, and where it comes from.

    ``contact``: of discs that rearrange as filaments do (calibrated so that many of them answer as the state curve).
    ``lattice``: of elements that keep their neighbours (hexagonal cells, closed form of the state curve, with
    unloading). ``lateral``: stress across over stress down where nothing widens; ``filaments`` of the runs, their
    ``friction``, and ``provenance``.
    """

    name: str
    filaments: int
    friction: float
    state: State
    contact: Table
    lattice: Table
    lateral: float
    provenance: dict[str, Any]

    @property
    def poisson_ratio(self) -> float:
        """Equivalent Poisson's ratio of plane strain, K0/(1 + K0), of the lateral stress ratio K0."""
        return self.lateral / (1 + self.lateral)

    @property
    def jam(self) -> float:
        """Volume fraction from which on the law carries."""
        return float(self.state.fraction[0])

    def table(self, mapping: str) -> Table:
        """The table of a mapping: "contact" or "lattice"."""
        return {"contact": self.contact, "lattice": self.lattice}[mapping]

    def to_toml(self) -> str:
        """The text of a law file; :func:`parse_law` of it is an equal law."""
        s = self.state
        return tomli_w.dumps(
            {
                "form": FORM,
                "name": self.name,
                "filaments": self.filaments,
                "friction": self.friction,
                "lateral": self.lateral,
                "state": {k: _rounded(v) for k, v in vars(s).items()},
                "contact": _written(self.contact),
                "lattice": _written(self.lattice),
                "provenance": self.provenance,
            }
        )


def _rounded(values: FloatArray) -> list[float]:
    return [float(f"{v:.6g}") for v in values.tolist()]


def _written(table: Table) -> dict[str, Any]:
    out: dict[str, Any] = {"size": table.size, "overlap": _rounded(table.overlap), "load": _rounded(table.load)}
    return out if table.unload is None else out | {"unload": _rounded(table.unload)}


def _array(table: Mapping[str, Any], key: str, where: str, least: float | None = None) -> FloatArray:
    values = table.get(key)
    good = isinstance(values, list) and len(values) >= 2 and all(isinstance(v, int | float) for v in values)
    array = np.array(values, dtype=float) if good else np.empty(0)
    if not good or not np.all(np.isfinite(array)) or (least is not None and float(array.min()) < least):
        raise InputError(
            f"{where}.{key}", values, "two or more finite numbers" + (", none below 0" if least == 0 else "")
        )
    return array


def _table(data: Mapping[str, Any], where: str) -> Table:
    part = data.get(where)
    if not isinstance(part, Mapping):
        raise InputError(where, part, "a table of overlap and load")
    overlap, load = _array(part, "overlap", where, 0.0), _array(part, "load", where, 0.0)
    unload = _array(part, "unload", where, 0.0) if "unload" in part else None
    for key, values in (("load", load), ("unload", unload)):
        if values is not None and (len(values) != len(overlap) or np.any(np.diff(values) < 0)):
            raise InputError(f"{where}.{key}", len(values), f"{len(overlap)} numbers that do not fall")
    if np.any(np.diff(overlap) <= 0) or overlap[0] != 0 or load[0] != 0 or load[-1] <= 0:
        raise InputError(f"{where}.overlap", float(overlap[0]), "rising from 0, where the load is 0")
    size = part.get("size", 1.0)
    if not isinstance(size, int | float) or not 0.5 <= size <= 2.0:
        raise InputError(f"{where}.size", size, "a number from 0.5 to 2")
    return Table(overlap, load, unload, float(size))


def parse_law(text: str) -> SubbundleLaw:
    """The law that a file's text holds; InputError names what is wrong with it."""
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError("law", text[:20], f"a sub-bundle law in TOML ({error})") from None
    if data.get("form") != FORM:
        raise InputError("law.form", data.get("form"), f"{FORM!r}, as cgfibre homogenise writes it")
    numbers = {}
    for key, low, high in (("filaments", 1, 1e7), ("friction", 0.0, 2.0), ("lateral", 0.0, 1.0)):
        value = data.get(key)
        if not isinstance(value, int | float) or not low <= value <= high:
            raise InputError(f"law.{key}", value, f"a number from {low:g} to {high:g}")
        numbers[key] = value
    part = data.get("state")
    if not isinstance(part, Mapping):
        raise InputError("law.state", part, "a table of fraction, load, unload and spread")
    state = State(*(_array(part, key, "law.state", 0.0) for key in ("fraction", "load", "unload", "spread")))
    if len({len(v) for v in vars(state).values()}) > 1 or np.any(np.diff(state.fraction) <= 0):
        raise InputError("law.state.fraction", len(state.fraction), "rising numbers, as many as of the other columns")
    return SubbundleLaw(
        name=str(data.get("name", "")),
        filaments=int(numbers["filaments"]),
        friction=float(numbers["friction"]),
        state=state,
        contact=_table(data, "contact"),
        lattice=_table(data, "lattice"),
        lateral=float(numbers["lateral"]),
        provenance=dict(data.get("provenance", {})),
    )


def shipped_laws() -> list[str]:
    """Names of the laws that come with the package."""
    files = resources.files("cgfibre").joinpath("laws").iterdir()
    return sorted(f.name.removesuffix(".toml") for f in files if f.name.endswith(".toml"))


@lru_cache(maxsize=16)
def find_law(law: str) -> SubbundleLaw:
    """The law of a shipped name, or that which a law file's text holds."""
    if "\n" in law:
        return parse_law(law)
    if law not in shipped_laws():
        raise InputError("law", law, f"a law file or one of {', '.join(shipped_laws())}")
    return parse_law(resources.files("cgfibre").joinpath("laws", f"{law}.toml").read_text(encoding="utf-8"))
