"""Reading TOML, and setting values over what was read, before anything is validated."""

from __future__ import annotations

import copy
import difflib
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeAlias

from planner.errors import ScenarioError
from planner.wording import dotted

Key: TypeAlias = tuple[str, ...]
Overrides: TypeAlias = Mapping[str, Any] | Mapping[Key, Any]

# At either end the torques are given in one of two ways, and setting one drops the other.
_PRELOAD = ("internal_force", "internal_moment")


def read_toml(path: Path) -> dict[str, Any]:
    """The tables of a TOML file.

    Raises:
        ScenarioError: There is no such file, or it is not valid TOML.
    """
    try:
        text = path.read_bytes().decode("utf-8-sig")  # editors on Windows add the mark
    except FileNotFoundError:
        siblings = [str(entry) for entry in path.parent.glob("*.toml")]
        near = difflib.get_close_matches(str(path), siblings, n=1)
        hint = f"did you mean {near[0]}?" if near else "name a scenario's TOML file"
        raise ScenarioError("no such file", source=path, remedy=hint) from None
    except IsADirectoryError:
        names = sorted(entry.name for entry in path.glob("*.toml"))
        hint = f"name the TOML file in it: {', '.join(names)}" if names else "name a TOML file"
        raise ScenarioError("is a folder", source=path, remedy=hint) from None
    except UnicodeDecodeError as error:
        raise ScenarioError(
            f"is not UTF-8 text (byte {error.start})", source=path, remedy="save it as UTF-8"
        ) from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise ScenarioError(
            f"cannot be read: {reason}", source=path, remedy="name a readable TOML file"
        ) from None
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # ValueError: also integers of 5000 digits
        reason = "nested too deeply" if isinstance(error, RecursionError) else str(error)
        raise ScenarioError(
            f"is not valid TOML: {reason}", source=path, remedy="correct that line"
        ) from None


def parse_override(text: str) -> tuple[Key, Any]:
    """Splits e.g. "boundary.goal.torque=free" into its key and its value.

    Args:
        text: A dotted key, an equals sign and a TOML value; a value that is none, such as a bare
            word or a path, is a string.

    Returns:
        The parts of the key, and the value.

    Raises:
        ScenarioError: There is no key or no value, or a bracket or a quote is not closed.
    """
    name, equals, value = text.partition("=")
    value = value.strip()
    if not equals or not value:
        raise ScenarioError(
            "is no setting", key=text.strip() or None, remedy="write KEY=VALUE, e.g. object.mass=8"
        )
    key = parse_key(name)
    try:
        table = tomllib.loads(f"value = {value}")
    except (ValueError, RecursionError):
        table = {}
    if len(table) != 1:  # more than one: a line break, and keys after it
        if value[0] in "[{\"'" or "\n" in value:
            raise ScenarioError(
                "is not a TOML value",
                key=dotted(key),
                value=value,
                remedy="write a number, a word, or a list such as [0.1, 0.4, 0.0]",
            )
        return key, value
    return key, table["value"]


def parse_key(text: str) -> Key:
    """The parts of a dotted key, any of which may be quoted as in TOML.

    Raises:
        ScenarioError: The text is no dotted key.
    """
    try:
        table: Any = tomllib.loads(f"{text.strip()} = 0")
    except ValueError:
        table = None
    parts = []
    while isinstance(table, dict) and len(table) == 1:
        [(part, table)] = table.items()
        parts.append(part)
    if table != 0 or not parts:
        raise ScenarioError(
            "is no dotted key", key=" ".join(text.split()) or "''", remedy="e.g. object.mass"
        )
    return tuple(parts)


def apply_overrides(tree: dict[str, Any], values: Overrides, source: Path | None) -> dict[str, Any]:
    """Sets values over a tree of tables.

    Args:
        tree: Tables as read; left as they are.
        values: New value per key, dotted or split; None removes the key.
        source: The file the tables came from, named in errors.

    Returns:
        The new tables.

    Raises:
        ScenarioError: A key leads through a value that is no table, or the torques at one end are
            set in both ways at once.
    """
    changes = {
        parse_key(key) if isinstance(key, str) else tuple(key): without_none(_plain(value))
        for key, value in values.items()
    }
    tree = without_none(copy.deepcopy(tree))
    given = {key for key, value in changes.items() if value is not None}
    for key in (key for key in changes if key in given):
        end, last = key[:-1], key[-1]
        if key[0] != "boundary" or len(key) != 3:
            continue
        rivals = {*_PRELOAD} if last == "torque" else {"torque"} if last in _PRELOAD else set()
        for rival in rivals:
            if (*end, rival) in given:
                raise ScenarioError(
                    f"is set together with {rival}",
                    source=source,
                    key=dotted(key),
                    remedy="a preload sets the torques: set one of the two",
                )
            _remove(tree, (*end, rival))
    for key, value in changes.items():
        if value is None:
            _remove(tree, key)
        else:
            _insert(tree, key, value, source)
    return tree


def _insert(tree: dict[str, Any], key: Key, value: Any, source: Path | None) -> None:
    table: Any = tree
    for depth, part in enumerate(key[:-1], start=1):
        table = table.setdefault(part, {})
        if not isinstance(table, dict):
            raise ScenarioError(
                f"there is nothing below {dotted(key[:depth])}, which is no table",
                source=source,
                key=dotted(key),
                remedy=f"set {dotted(key[:depth])} itself",
            )
    table[key[-1]] = value


def _remove(tree: dict[str, Any], key: Key) -> None:
    table: Any = tree
    for part in key[:-1]:
        table = table.get(part) if isinstance(table, dict) else None
    if isinstance(table, dict):
        table.pop(key[-1], None)


def without_none(value: Any) -> Any:
    """The same tables without the keys whose value is None, which stands for a default."""
    if isinstance(value, Mapping):
        return {k: without_none(v) for k, v in value.items() if v is not None}
    return value


def _plain(value: Any) -> Any:
    # NumPy's arrays and scalars, without importing NumPy.
    return value.tolist() if hasattr(value, "tolist") else value
