"""Scenes from TOML: files and those shipped, overrides, tables, and files that a scene names."""

from __future__ import annotations

import os
import re
import tomllib
from collections.abc import Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from cgfibre.errors import InputError
from cgfibre.scene import Filament, Scene, Stop
from cgfibre.scene_messages import meant, one_of, shown_value, translated
from cgfibre.scene_values import CentresText, LawText
from cgfibre.subbundle_law import shipped_laws

T = TypeVar("T", bound=BaseModel)

_STOP = tuple(f"platens.stop.{key}" for key in Stop.model_fields)
_PACKING = ("assembly.pitch", "assembly.void_fraction", "assembly.fibre_volume_fraction")
#: an override of the first drops the others where they are not overridden too
_SUPERSEDES: dict[str, tuple[str, ...]] = {
    **{key: tuple(k for k in group if k != key) for group in (_STOP, _PACKING) for key in group},
    "assembly.centres": ("assembly.count", *_PACKING, "assembly.first_angle", "assembly.aspect"),
    "filament.material": tuple(f"filament.{key}" for key in Filament.model_fields if key != "material"),
}


def load_scene(source: str | Path, overrides: Sequence[str] = ()) -> Scene:
    """The scene of a TOML file or of a shipped name, with overrides.

    ``assembly.centres`` may name a CSV file beside the scene's (in an override: from here); its numbers become part of
    the scene.

    ``overrides`` are "table.key=value" (nested tables too: ``platens.stop.displacement="30 um"``), the value being TOML
    or else bare text. One of several alternatives (how to stop, how to pack, a material for its constants) takes the
    place of the one that the scene gives. A file without a name is named after itself.
    Raises :class:`InputError` for whatever is wrong with the file, the overrides or the scene.
    """
    data = read_tables(source, overrides)
    if "capstan" in data:
        raise InputError("scene", str(source), f"a compaction scene; this is a friction test: cgfibre capstan {source}")
    return scene_from_dict(data)


def read_tables(source: str | Path, overrides: Sequence[str] = ()) -> dict[str, Any]:
    """The tables of a TOML file or of a shipped scene, named and with overrides, not yet validated."""
    text, name = _source(source)
    data = read_toml(text, "scene", str(source))
    data.setdefault("name", name)
    _insert_files(data, Path(source).parent)
    _insert_law(data, Path(source).parent)
    _override(data, overrides)
    _insert_files(data, Path())
    _insert_law(data, Path())
    return data


def read_toml(text: str, key: str, source: str) -> dict[str, Any]:
    """Tables of TOML text; InputError with the line that is wrong, for ``key`` and the ``source`` of the text."""
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(key, source, _toml_expectation(text, error)) from None


def joined_overrides(*groups: Sequence[str]) -> tuple[str, ...]:
    """Overrides of several groups as one: a later group's take the place of the same keys, and of the alternatives that
    they replace, in earlier ones; InputError for a text that is no override."""
    joined: dict[str, str] = {}
    for group in groups:
        new = {_override_parts(text)[0]: text for text in group}
        for key in new:
            for other in (key, *_SUPERSEDES.get(key, ())):
                joined.pop(other, None)
        joined |= new
    return tuple(joined.values())


def scene_from_dict(data: Mapping[str, Any]) -> Scene:
    """The scene of nested tables, quantities as text with units; raises :class:`InputError` for the first thing wrong.

    Keys whose value is ``None`` count as not given.
    """
    return validated(Scene, data)


def validated(kind: type[T], data: Mapping[str, Any]) -> T:
    """A scene of the ``kind`` from nested tables; raises :class:`InputError` for the first thing wrong."""
    try:
        return kind.model_validate(_without_none(data))
    except ValidationError as error:
        raise translated(error, kind) from None


def shipped_scenes() -> list[str]:
    """Names of the scenes that come with the package, in natural order."""
    files = resources.files("cgfibre").joinpath("scenes").iterdir()
    names = [f.name.removesuffix(".toml") for f in files if f.name.endswith(".toml")]
    return sorted(names, key=_natural)


def scene_description(name: str) -> str:
    """What a shipped scene says of itself, whatever test it is of."""
    return str(tomllib.loads(scene_text(name)).get("description", ""))


def scene_text(name: str) -> str:
    """The TOML of a shipped scene, comments and all; raises :class:`InputError` for an unknown name."""
    if name not in shipped_scenes():
        raise InputError("scene", name, "the name of a shipped scene" + meant(name, shipped_scenes()))
    return resources.files("cgfibre").joinpath("scenes", f"{name}.toml").read_text(encoding="utf-8")


def _natural(name: str) -> list[tuple[int, str]]:
    """Numbers in a name by their value, 12k being 12000."""
    parts = re.findall(r"(\d+)(k?)|(\D+?(?=\d|$))", name)
    return [(int(number) * (1000 if thousand else 1) if number else 0, text) for number, thousand, text in parts]


def _source(source: str | Path) -> tuple[str, str]:
    """Text of a scene and the name that it goes by."""
    if isinstance(source, str) and source in shipped_scenes():
        return scene_text(source), source
    path = Path(source)
    try:
        return path.read_text(encoding="utf-8-sig"), path.stem
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else "not a text file"
    expected = f"a TOML file that can be read ({reason.lower()})"
    if isinstance(source, str) and path.suffix != ".toml" and os.sep not in source:
        expected = f"a TOML file or a shipped scene{meant(source, shipped_scenes()) or ' (cgfibre scenes lists them)'}"
    raise InputError("scene", str(source), expected)


#: keys whose text may stand in a file beside the scene's, and what is expected of it
_FILES = {
    ("assembly", "centres"): CentresText.expected,
    ("assembly", "texgen"): "a .tg3 file of TexGen",
    ("contact", "table"): LawText.expected,
}


def _insert_files(data: dict[str, Any], folder: Path) -> None:
    """Put the text of the files that keys name in their place."""
    for (name, key), expected in _FILES.items():
        table = data.get(name)
        if not isinstance(table, dict):
            continue
        named = table.get(key)
        if not isinstance(named, str) or "\n" in named or not named:
            continue
        try:
            text = (folder / named).read_text(encoding="utf-8-sig")
        except (OSError, ValueError) as error:
            reason = error.strerror if isinstance(error, OSError) and error.strerror else "not a text file"
            raise InputError(f"{name}.{key}", named, f"{expected} ({reason.lower()})") from None
        data[name] = {**table, key: text.strip() + "\n"}


def _insert_law(data: dict[str, Any], folder: Path) -> None:
    """Put the text of the file that assembly.subbundle.law names in its place."""
    assembly = data.get("assembly")
    table = assembly.get("subbundle") if isinstance(assembly, dict) else None
    named = table.get("law") if isinstance(table, dict) else None
    if not isinstance(table, dict) or not isinstance(named, str) or "\n" in named or named in shipped_laws():
        return
    try:
        table["law"] = (folder / named).read_text(encoding="utf-8-sig")
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else "not a text file"
        expected = f"a sub-bundle law: a file that can be read ({reason.lower()}) or {one_of(shipped_laws())}"
        raise InputError("assembly.subbundle.law", named, expected) from None


def _toml_expectation(text: str, error: tomllib.TOMLDecodeError) -> str:
    """What is wrong with the TOML, with the line it is on."""
    message = str(error)
    at = re.search(r"at line (\d+)", message)
    lines = text.splitlines()
    line = int(at[1]) if at else len(lines)
    shown = f", line {line}: {lines[line - 1].strip()[:60]!r}" if 0 < line <= len(lines) else ""
    reason = message[:1].lower() + re.sub(r" \(at [^()]*\)$", "", message)[1:]
    return " ".join(f"valid TOML{shown}: {reason} (text and quantities stand in quotes)".split())


def _override(data: dict[str, Any], overrides: Sequence[str]) -> None:
    given = {}
    for text in overrides:
        key, value = _override_parts(text)
        given[key] = _toml_value(value)
    for key, value in given.items():
        for other in _SUPERSEDES.get(key, ()):
            if other not in given:
                _table(data, other)[0].pop(other.rpartition(".")[2], None)
        table, last = _table(data, key, make=True)
        table[last] = value


def _override_parts(text: str) -> tuple[str, str]:
    """Key and value of an override."""
    key, equals, value = (part.strip() for part in text.partition("="))
    if not equals or not re.fullmatch(r"\w+(\.\w+)*", key):
        raise InputError("--set", text, 'table.key=value, such as filament.diameter="9 um"')
    return key, value


def _toml_value(text: str) -> Any:
    try:
        parsed = tomllib.loads(f"value = {text}")
    except tomllib.TOMLDecodeError:
        return text
    return parsed["value"] if len(parsed) == 1 else text


def _table(data: dict[str, Any], key: str, make: bool = False) -> tuple[dict[str, Any], str]:
    """The table that holds a dotted key, and the key's last part; an empty table where there is none."""
    *parents, last = key.split(".")
    for i, parent in enumerate(parents):
        data = data.setdefault(parent, {}) if make else data.get(parent, {})
        if not isinstance(data, dict):
            where = ".".join(parents[: i + 1])
            raise InputError(key, shown_value(data), f"a known key: {where} is not a table")
    return data, last


def _without_none(data: Mapping[str, Any]) -> dict[str, Any]:
    return {k: _without_none(v) if isinstance(v, Mapping) else v for k, v in data.items() if v is not None}
