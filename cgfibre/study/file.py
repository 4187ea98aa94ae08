"""The file of a study: which scenes, which specimens, what is compared; validated, and made into cases.

    title = "Friction between filaments"
    scene = "carbon-127-section"             # a shipped scene or a file beside the study
    set = ['assembly.length="345 mm"']       # or a table; what all cases have in common
    starts = 3                               # specimens a case: seeds of the jitter

    [[vary]]                                 # one or more: all combinations
    key = "contact.friction"
    values = [0.2, 0.3]

    [[case]]                                 # or cases one by one (with [[vary]]: each of them in each)
    label = "racetrack"
    set = { "assembly.arrangement" = "racetrack" }

    [compare]
    loads = ["0.1 N/mm", "1 N/mm"]           # forces per width, pressures or forces

Whatever is wrong becomes one :class:`cgfibre.errors.InputError` that names the key, the value and what was expected.
"""

from __future__ import annotations

import itertools
import json
import os
import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal

import tomli_w
from pydantic import Field, model_validator
from pydantic_core import CoreSchema, core_schema

from cgfibre import units
from cgfibre.errors import InputError
from cgfibre.scene import Table
from cgfibre.scene_messages import meant
from cgfibre.scene_reading import joined_overrides, read_toml, shipped_scenes, validated
from cgfibre.scene_values import NOT_GIVEN, Abridged, Value, refusal

#: kind of load -> (engine unit, unit of tables and plots, engine units in one of these)
LOADS: dict[str, tuple[str, str, float]] = {
    "line_force": ("nN/um", "N/mm", 1e6),
    "pressure": ("kPa", "MPa", 1e3),
    "force": ("nN", "N", 1e9),
}
MOST_CASES = 200


def toml_text(value: object) -> str:
    """A value as TOML writes it on one line."""
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{json.dumps(str(k))} = {toml_text(v)}" for k, v in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(toml_text(v) for v in value) + "]"
    return json.dumps(value, ensure_ascii=False) if isinstance(value, str | bool) else repr(value)


class _Plain:
    """Annotation of a value that ``read`` takes from TOML and that is written as it was read."""

    def __get_pydantic_core_schema__(self, source: object, handler: object) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(self.read)

    def read(self, value: object) -> object:
        """The value; an error that pydantic carries if it is not one."""
        raise NotImplementedError


class SetText(_Plain):
    """Overrides: a list of "table.key=value", or a table of dotted keys or of tables."""

    expected = "a list such as ['platens.friction=0.2'] or a table such as { \"platens.friction\" = 0.2 }"

    def read(self, value: object) -> tuple[str, ...]:
        """The overrides as texts."""
        if isinstance(value, Mapping):
            return tuple(self._flat(value, ""))
        if not isinstance(value, list | tuple) or not all(isinstance(v, str) for v in value):
            raise refusal("", value, self.expected)
        try:
            return joined_overrides([str(v) for v in value])
        except InputError as error:
            raise refusal("", error.value, error.expected) from None

    def _flat(self, table: Mapping[str, Any], prefix: str) -> list[str]:
        found = []
        for key, value in table.items():
            inner = isinstance(value, Mapping)
            found += self._flat(value, f"{prefix}{key}.") if inner else [f"{prefix}{key}={toml_text(value)}"]
        return found


class Values(_Plain):
    """Values of a key: a list of at least one number, text or truth value."""

    expected = 'a list of values, such as [0.2, 0.3] or ["345 mm", "690 mm"]'

    def read(self, value: object) -> tuple[Any, ...]:
        """The values, each once."""
        if not isinstance(value, list | tuple) or not value:
            raise refusal("", value, self.expected)
        texts = [toml_text(v) for v in value]
        if len(set(texts)) < len(texts):
            raise refusal("", value, self.expected + ", each once")
        return tuple(value)


@dataclass(frozen=True)
class Quantities(_Plain):
    """A list of quantities of one of ``kinds`` of unit (all of the first kind that fits), as texts."""

    kinds: tuple[str, ...]

    @property
    def expected(self) -> str:
        """What is wanted, for a message."""
        return "a list, each " + " or ".join(units.describe(k) for k in self.kinds) + ", above zero"

    def read(self, value: object) -> tuple[str, ...]:
        """The texts."""
        if not isinstance(value, list | tuple):
            raise refusal("", value, self.expected)
        if not value or any(all(self._of(v, kinds=(k,)) is not None for v in value) for k in self.kinds):
            return tuple(str(v) for v in value)
        wrong = next((v for v in value if self._of(v, self.kinds) is None), value)
        raise refusal("", wrong, self.expected + ", all of one kind")

    @staticmethod
    def _of(text: object, kinds: tuple[str, ...]) -> float | None:
        for kind in kinds:
            try:
                number = units.parse(text, kind, "")
            except InputError:
                continue
            if number > 0:
                return number
        return None


class Shares(_Plain):
    """A list of numbers between 0 and 1, not included."""

    expected = "a list of numbers between 0 and 1, such as [0.3, 0.5]"

    def read(self, value: object) -> tuple[float, ...]:
        """The numbers."""
        numbers = isinstance(value, list | tuple) and all(type(v) in (int, float) and 0 < v < 1 for v in value)
        if not numbers:
            raise refusal("", value, self.expected)
        return tuple(float(v) for v in value)  # type: ignore[attr-defined]


class Vary(Table):
    """``[[vary]]``: a key of the scene with the values that it takes; ``label`` of a case, {value} in it; ``name`` of
    the axis."""

    key: str
    values: Annotated[tuple[Any, ...], Values()]
    label: str = ""
    name: str = ""


class Case(Table):
    """``[[case]]``: a scene of its own or the study's with overrides; ``optional``: run where --only names it."""

    label: str
    scene: str = ""
    set: Annotated[tuple[str, ...], SetText()] = ()
    starts: Annotated[int | None, Value(whole=True, least=1, most=1000)] = None
    optional: bool = False


class Compare(Table):
    """``[compare]``: ``loads`` at which thicknesses are compared; ``displacements`` and ``reductions`` (of the initial
    thickness, as shares) at which loads are. The loads' unit says what a load is: N/mm, MPa or N."""

    loads: Annotated[tuple[str, ...], Quantities(("nN/um", "kPa", "nN"))]
    displacements: Annotated[tuple[str, ...], Quantities(("um",))] = ()
    reductions: Annotated[tuple[float, ...], Shares()] = ()

    @model_validator(mode="after")
    def _some(self) -> Compare:
        if not self.loads:
            raise refusal("loads", Abridged("[]"), "at least one load, such as ['1 N/mm']")
        return self

    @property
    def kind(self) -> str:
        """What a load is: a key of :data:`LOADS`."""
        return next(k for k, (unit, _, _) in LOADS.items() if Quantities._of(self.loads[0], (unit,)) is not None)

    @property
    def values(self) -> tuple[float, ...]:
        """The loads in the unit of tables: N/mm, MPa or N, in rising order."""
        unit, _, factor = LOADS[self.kind]
        return tuple(sorted(units.parse(text, unit, "compare.loads") / factor for text in self.loads))


class Plot(Table):
    """``[plot]``: load against ``x``; ``normalised``: over the initial thickness; ``unloading`` drawn too."""

    x: Literal["thickness", "displacement"] = "thickness"
    normalised: bool = False
    log: bool = True
    unloading: bool = False


class Fit(Table):
    """``[fit]``: a law fitted to the thickness at the loads, over all cases; the study varies one key, a number.

    "friction-power": t = c P^(a mu - b); "power": t = c P^-b, whatever the key is; ``beside``: the thesis' constants.
    """

    law: Literal["friction-power", "power"]
    beside: Literal["none", "thesis-dry", "thesis-wet"] = "none"


class Study(Table):
    """A study as its file says; ``folder`` is where its scenes are looked for."""

    name: str = ""
    title: str = ""
    statement: str = ""
    finding: str = ""
    scene: str = ""
    set: Annotated[tuple[str, ...], SetText()] = ()
    starts: Annotated[int, Value(whole=True, least=1, most=1000)] = 3
    jitter: Annotated[float | Literal["auto"], Value("um", words=("auto",), least=0.0, most=1e4)] = "auto"
    vary: list[Vary] = Field(default_factory=list)
    case: list[Case] = Field(default_factory=list)
    compare: Compare
    plot: Plot = Plot()
    fit: Fit | None = None

    @model_validator(mode="after")
    def _consistent(self) -> Study:
        if not self.scene and not (self.case and all(c.scene for c in self.case)):
            raise refusal("scene", NOT_GIVEN, "the scene of the cases that name none: a shipped one or a file")
        if self.fit is not None:
            numbers = len(self.vary) == 1 and all(type(v) in (int, float) for v in self.vary[0].values)
            if not numbers or len(self.case) > 1 or self.compare.kind != "line_force":
                raise refusal("fit", self.fit.law, "one [[vary]] of numbers, one case at most, loads in N/mm")
        if len({v.key for v in self.vary}) < len(self.vary):
            raise refusal("vary", self.vary[-1].key, "each key once")
        return self

    def to_toml(self) -> str:
        """The study resolved, every key written out."""
        return tomli_w.dumps(_without_empty(self.model_dump(exclude_none=True)), multiline_strings=True)


@dataclass(frozen=True)
class Cell:
    """One case as it is run: ``label`` and folder ``slug``, its scene and overrides, the values of the keys varied."""

    label: str
    slug: str
    scene: str
    overrides: tuple[str, ...]
    values: Mapping[str, Any]
    starts: int
    optional: bool = False


def cells(study: Study) -> list[Cell]:
    """The cases of a study: each [[case]] in each combination of the [[vary]] values; InputError for equal labels."""
    found = []
    for case in study.case or [Case(label="")]:
        for values in itertools.product(*(v.values for v in study.vary)):
            varied = {v.key: value for v, value in zip(study.vary, values, strict=True)}
            labels = [case.label, *(_label(v, varied[v.key]) for v in study.vary)]
            label = ", ".join(text for text in labels if text) or study.name or "scene"
            own = joined_overrides(study.set, case.set, [f"{k}={toml_text(v)}" for k, v in varied.items()])
            starts = case.starts or study.starts
            found.append(Cell(label, slug(label), case.scene or study.scene, own, varied, starts, case.optional))
    if len(found) > MOST_CASES:
        raise InputError("vary", len(found), f"at most {MOST_CASES} cases in all")
    taken: dict[str, str] = {}
    for cell in found:
        if cell.slug in taken or not cell.slug:
            raise InputError("case.label", cell.label, "labels of letters and numbers, each another")
        taken[cell.slug] = cell.label
    return found


def _label(vary: Vary, value: object) -> str:
    text = value if isinstance(value, str) else toml_text(value)
    return vary.label.replace("{value}", text) if vary.label else f"{vary.key.rpartition('.')[2]} {text}"


def slug(label: str) -> str:
    """A label as the name of a folder."""
    return re.sub(r"[^a-z0-9.]+", "-", label.lower()).strip("-.")


def shipped_studies() -> list[str]:
    """Names of the studies that come with the package."""
    files = resources.files("cgfibre").joinpath("studies").iterdir()
    return sorted(f.name.removesuffix(".toml") for f in files if f.name.endswith(".toml"))


def load_study(source: str | Path, overrides: Sequence[str] = (), starts: int | None = None) -> Study:
    """The study of a TOML file, of a shipped name, or of one scene (a file or a shipped one): a case of its own.

    ``overrides`` of the scene hold in every case, before those of the cases; ``starts`` in place of the file's, for
    all cases. Scenes that the file names are looked for beside it. Raises InputError for whatever is wrong.
    """
    name, folder, text = _found(source)
    data = read_toml(text, "study", str(source)) if text is not None else {}
    if text is None or "filament" in data:
        data = _of_scene(str(source), name)
        folder = Path()
    data.setdefault("name", name)
    study = validated(Study, data)
    changes: dict[str, Any] = {"set": joined_overrides(study.set, overrides)}
    if starts is not None:
        changes["starts"] = starts
        changes["case"] = [c.model_copy(update={"starts": None}) for c in study.case]
    beside = [c.model_copy(update={"scene": _beside(c.scene, folder)}) for c in changes.get("case", study.case)]
    return study.model_copy(update={**changes, "case": beside, "scene": _beside(study.scene, folder)})


#: what an ensemble of one scene is compared at
ONE_SCENE = ("0.001 N/mm", "0.01 N/mm", "0.1 N/mm", "1 N/mm", "10 N/mm")


def _of_scene(scene: str, name: str) -> dict[str, Any]:
    return {
        "title": f"{name}: specimens",
        "scene": scene,
        "case": [{"label": name}],
        "compare": {"loads": list(ONE_SCENE), "reductions": [0.1, 0.2, 0.3, 0.4, 0.5]},
        "plot": {"x": "displacement", "log": False, "unloading": True},
    }


def _found(source: str | Path) -> tuple[str, Path, str | None]:
    """(name, folder, text) of a study; no text for a shipped scene."""
    if isinstance(source, str):
        if source in shipped_studies():
            path = resources.files("cgfibre").joinpath("studies", f"{source}.toml")
            return source, Path(), path.read_text(encoding="utf-8")
        if source in shipped_scenes():
            return source, Path(), None
    path = Path(source)
    try:
        return path.stem, path.parent, path.read_text(encoding="utf-8-sig")
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else "not a text file"
    expected = f"a TOML file that can be read ({reason.lower()})"
    if isinstance(source, str) and path.suffix != ".toml" and os.sep not in source:
        names = [*shipped_studies(), *shipped_scenes()]
        expected = f"a TOML file, a shipped study or scene{meant(source, names) or ' (cgfibre study --list)'}"
    raise InputError("study", str(source), expected)


def _beside(scene: str, folder: Path) -> str:
    return scene if not scene or scene in shipped_scenes() else str((folder / scene).resolve())


def _without_empty(data: Mapping[str, Any]) -> dict[str, Any]:
    return {k: v for k, v in data.items() if v not in ("", (), [])}


def describe_study(name: str) -> str:
    """What a shipped study is about."""
    text = resources.files("cgfibre").joinpath("studies", f"{name}.toml").read_text(encoding="utf-8")
    return str(tomllib.loads(text).get("title", ""))
