"""What pydantic found wrong with a scene, in our words: one :class:`cgfibre.errors.InputError` for a key."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Sequence

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from cgfibre.errors import InputError
from cgfibre.materials import MATERIALS
from cgfibre.scene_values import NOT_GIVEN, Abridged, Value


def field_value(model: type[BaseModel], key: str) -> Value:
    """What a key of a table takes."""
    return next(m for m in model.model_fields[key].metadata if isinstance(m, Value))


def translated(error: ValidationError, root: type[BaseModel]) -> InputError:
    """The first error, but a misspelt key before the one that is missed for it."""
    found = error.errors(include_url=False)
    return _input_error(min(found, key=lambda e: e["type"] != "extra_forbidden"), root)


def _input_error(error: ErrorDetails, root: type[BaseModel]) -> InputError:
    loc = [str(part) for part in error["loc"]]
    context = error.get("ctx", {})
    # a quoted TOML key can hold anything
    key, value = ".".join(part if re.fullmatch(r"[\w-]+", part) else repr(part) for part in loc), error["input"]
    if error["type"] == "refused":
        inner = context["key"]
        return InputError(".".join(p for p in (key, inner) if p), shown_value(context["value"]), context["expected"])
    if error["type"] == "extra_forbidden":
        return InputError(key, shown_value(value), "a known key" + _meant_key(loc, root))
    if error["type"] == "missing":
        value = NOT_GIVEN
        if loc[0] == "filament" and len(loc) == 2:
            return InputError(key, value, f"{_expected(loc, root)} (or filament.material = {one_of(MATERIALS)})")
    return InputError(key, shown_value(value), _expected(loc, root))


def _expected(loc: Sequence[str], root: type[BaseModel]) -> str:
    """What a key takes, from its field."""
    field = _field(loc, root)
    if field is None:
        return "a table of keys"
    for metadata in field.metadata:
        expected = getattr(metadata, "expected", None)
        if isinstance(expected, str):
            return expected
    if _models(field):
        return f"a table [{'.'.join(loc)}]"
    choices = getattr(field.annotation, "__args__", ())
    if field.annotation is bool:
        return "true or false"
    if choices and all(isinstance(c, str) for c in choices):
        return one_of(choices)
    return "text in quotes"


def _field(loc: Sequence[str], root: type[BaseModel]) -> FieldInfo | None:
    models: list[type[BaseModel]] = [root]
    field = None
    for key in loc:
        if key.isdigit():  # a place in a list of tables
            continue
        field = next((m.model_fields[key] for m in models if key in m.model_fields), None)
        if field is None:
            return None
        models = _models(field)
    return field


def _models(field: FieldInfo) -> list[type[BaseModel]]:
    """The tables that a field may hold."""
    kinds = (field.annotation, *getattr(field.annotation, "__args__", ()))
    return [kind for kind in kinds if isinstance(kind, type) and issubclass(kind, BaseModel)]


def _meant_key(loc: Sequence[str], root: type[BaseModel]) -> str:
    """The key of that name in another table, or the one of the same table that looks most alike."""
    *parents, last = loc
    parent = _field(parents, root) if parents else None
    models = _models(parent) if parent is not None else [] if parents else [root]
    meant = [key for key in _all_keys(root) if key.rpartition(".")[2] == last]
    if not meant:
        near = difflib.get_close_matches(last, [key for m in models for key in m.model_fields], n=1)
        meant = [".".join([*parents, key]) for key in near]
    return f" (did you mean {' or '.join(meant)}?)" if meant else ""


def _all_keys(model: type[BaseModel], prefix: str = "") -> list[str]:
    keys = []
    for key, field in model.model_fields.items():
        keys.append(prefix + key)
        for inner in _models(field):
            keys += _all_keys(inner, f"{prefix}{key}.")
    return keys


def meant(name: str, names: Iterable[str]) -> str:
    """ " (did you mean ...?)", or nothing where no name looks alike."""
    near = difflib.get_close_matches(name, list(names), n=3)
    return f" (did you mean {' or '.join(near)}?)" if near else ""


def one_of(words: Iterable[str]) -> str:
    """'a', 'b' or 'c'."""
    quoted = [repr(w) for w in words]
    return quoted[0] if len(quoted) == 1 else f"{', '.join(quoted[:-1])} or {quoted[-1]}"


def shown_value(value: object) -> object:
    """The value, abridged where its text would fill the line."""
    text = repr(value)
    return value if len(text) <= 60 else Abridged(text[:56] + " ...")
