"""One line in plain words for what pydantic finds wrong with a scenario."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, TypeAlias, get_args

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from planner.errors import ScenarioError
from planner.quantities import OTHER, WORD

_BARE = re.compile(r"[A-Za-z0-9_-]+")
Address: TypeAlias = tuple[str | int, ...]
_AT = "at:"  # an error found in a whole table names the key at fault in its type

# What pydantic calls the error: the problem, with its context filled in, and what would be valid.
_WORDS = {
    "missing": ("is missing", "add it"),
    "finite_number": ("must be a finite number", "give a number"),
    "int_type": ("must be a whole number", "give a whole number"),
    "int_parsing_size": ("is too large", "give a smaller whole number"),
    "string_type": ("must be text", "give text in quotes"),
    "string_too_short": ("is empty", "give a name"),
    "tuple_type": ("must be a list", "give a list in square brackets"),
    "dict_type": ("must be a table", "give a table of keys and values"),
    "model_type": ("must be a table", "give a table of keys and values"),
    "model_attributes_type": ("must be a table", "give a table of keys and values"),
    "greater_than": ("is too small", "give a number greater than {gt:.7g}"),
    "greater_than_equal": ("is too small", "give a number of at least {ge:.7g}"),
    "less_than_equal": ("is too large", "give a number of at most {le:.7g}"),
    "too_long": ("has too many entries", "give {max_length} entries"),
    "too_short": ("is empty", "give at least one entry, or leave the key out"),
}


def scenario_error(
    model: type[BaseModel], error: ValidationError, source: Path | None
) -> ScenarioError:
    """Turns the first thing that pydantic found wrong into one line, and counts the others.

    Args:
        model: The model of the whole file.
        error: What its validation raised.
        source: The file.
    """
    # An unknown key first: a misspelt key also leaves the right one missing.
    details = sorted(error.errors(include_url=False), key=lambda e: e["type"] != "extra_forbidden")
    found = {_address(entry): entry for entry in reversed(details)}
    first = details[0]
    key = _address(first)
    problem, value, remedy = _words(model, key, first)
    if len(found) > 1:
        remedy = "; ".join(filter(None, (remedy, f"and {len(found) - 1} more")))
    return ScenarioError(
        problem, source=source, key=dotted(key) or None, value=value, remedy=remedy
    )


def dotted(key: Address) -> str:
    """A key as TOML writes it, entries of a list in brackets: `left.posture[1]`."""
    text = ""
    for part in key:
        if isinstance(part, int):
            text += f"[{part}]"
        else:
            text += ("." if text else "") + (part if _BARE.fullmatch(part) else repr(part))
    return text


def _address(entry: ErrorDetails) -> Address:
    loc = tuple(part for part in entry["loc"] if part not in (WORD, OTHER))
    if entry["type"] == "missing" and loc and isinstance(loc[-1], int):
        return loc[:-1]  # a list that is too short: the fault of the list
    if entry["type"].startswith(_AT):
        return (*loc, entry["type"].removeprefix(_AT))
    return loc


def _words(
    model: type[BaseModel], key: Address, entry: ErrorDetails
) -> tuple[str, Any, str | None]:
    """The problem, the value to show and the remedy."""
    kind, value, context = entry["type"], entry["input"], entry.get("ctx", {})
    if isinstance(value, int) and value.bit_length() > 1000:
        value = None  # Python refuses to print it
    described = _description(model, key)
    if kind == "extra_forbidden":
        return "unknown key", None, _nearest_key(model, key)
    if kind == "missing" and isinstance(entry["loc"][-1], int):
        return "has too few entries", value, f"give {described or '3 entries'}"  # all are vectors
    if kind == "literal_error":
        words = re.findall(r"'([^']*)'", context["expected"])
        near = difflib.get_close_matches(str(value), words, n=1)
        hint = f"did you mean {near[0]!r}? " if near else ""
        return "is not known here", value, f"{hint}give {described or _listed(words)}"
    if kind not in _WORDS:  # one of this package's own checks
        return entry["msg"], None if isinstance(value, dict) else value, context.get("remedy")
    problem, remedy = _WORDS[kind]
    if described and not problem.startswith("is too"):
        remedy = f"give {described}"
    return (
        problem.format(**context),
        None if kind == "missing" else value,
        remedy.format(**context),
    )


def _nearest_key(model: type[BaseModel], key: Address) -> str:
    *parents, name = (str(part) for part in key)
    table = model
    for part in parents:
        table = _table(table, part) or table
    near = difflib.get_close_matches(name.lower(), table.model_fields, n=1)
    if near:
        return f"did you mean {dotted((*parents, near[0]))!r}?"
    # Perhaps a right key in the wrong table.
    elsewhere = [path for path in _keys(model) if path[-1] == name]
    if elsewhere:
        return f"did you mean {' or '.join(repr(dotted(path)) for path in elsewhere[:3])}?"
    return f"valid here: {', '.join(table.model_fields)}"


def _description(model: type[BaseModel], key: Address) -> str | None:
    table: type[BaseModel] | None = model
    description = None
    for part in key:
        if isinstance(part, int) or table is None or part not in table.model_fields:
            break
        description = table.model_fields[part].description
        table = _table(table, part)
    return description


def _table(model: type[BaseModel], name: str) -> type[BaseModel] | None:
    """The class of the table that a key holds, if it holds one."""
    field = model.model_fields.get(name)
    kinds = (field.annotation, *get_args(field.annotation)) if field else ()
    return next((k for k in kinds if isinstance(k, type) and issubclass(k, BaseModel)), None)


def _keys(model: type[BaseModel], parents: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    for name in model.model_fields:
        yield (*parents, name)
        table = _table(model, name)
        if table is not None:
            yield from _keys(table, (*parents, name))


def _listed(words: list[str]) -> str:
    return " or ".join(filter(None, (", ".join(words[:-1]), words[-1])))
