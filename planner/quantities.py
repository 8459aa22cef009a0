"""Numbers as the scenario takes them: finite, never text, and of a plausible size for their unit.

A size no user can mean is taken for another unit (degrees, millimetres, grams), since such a
mistake otherwise ends in a long solve of a meaningless problem.
"""

from __future__ import annotations

import math
import numbers
from typing import Annotated, Any, TypeAlias, TypeVar

from pydantic import (
    AfterValidator,
    AllowInfNan,
    BeforeValidator,
    Discriminator,
    Field,
    StringConstraints,
    Tag,
)
from pydantic_core import PydanticCustomError

WORD, OTHER = "<word>", "<other>"  # tags in the address of an error, no keys of the file
LARGEST_COUNT = 1_000_000
_GIVE_NUMBER = {"remedy": "give a number"}


def _number(value: Any) -> Any:
    # An integer of hundreds of digits is a TOML value, but no number that a float can hold.
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        raise PydanticCustomError("number", "must be a number", _GIVE_NUMBER)
    try:
        return float(value)
    except OverflowError:
        raise PydanticCustomError("number", "must be a finite number", _GIVE_NUMBER) from None


def _plausible(limit: float, unit: str, other: str) -> AfterValidator:
    def check(value: float) -> float:
        if abs(value) > limit:
            raise PydanticCustomError(
                "unit",
                "looks like {other}",
                {"other": other, "remedy": f"give {unit}, at most {limit:.6g}"},
            )
        return value

    return AfterValidator(check)


Real = Annotated[float, BeforeValidator(_number), AllowInfNan(False)]
Positive = Annotated[Real, Field(gt=0)]
Cost = Annotated[Real, Field(ge=0)]
Share = Annotated[Real, Field(ge=0, le=1)]
Angle = Annotated[Real, _plausible(4 * math.pi, "radians", "degrees")]
Length = Annotated[Real, _plausible(100, "metres", "millimetres")]
Speed = Annotated[Real, _plausible(100, "m/s", "mm/s")]
Acceleration = Annotated[Real, _plausible(100, "m/s^2", "mm/s^2")]
Mass = Annotated[Real, Field(ge=0), _plausible(1e5, "kilograms", "grams")]
Duration = Annotated[Real, Field(gt=0), _plausible(1000, "seconds", "milliseconds")]
Count = Annotated[int, Field(strict=True, le=LARGEST_COUNT)]
Text = Annotated[str, StringConstraints(strict=True, min_length=1)]

Real3: TypeAlias = tuple[Real, Real, Real]
Angle3: TypeAlias = tuple[Angle, Angle, Angle]
Length3: TypeAlias = tuple[Length, Length, Length]
Speed3: TypeAlias = tuple[Speed, Speed, Speed]
Acceleration3: TypeAlias = tuple[Acceleration, Acceleration, Acceleration]
Weights: TypeAlias = Annotated[tuple[Positive, ...], Field(min_length=1)]
Numbers: TypeAlias = Annotated[tuple[Real, ...], Field(min_length=1)]


def _tag(value: Any) -> str:
    return WORD if isinstance(value, str) else OTHER


_W = TypeVar("_W")
_V = TypeVar("_V")

# One of some words, or a value: an error then speaks of the one that was meant, not of both.
WordOr: TypeAlias = Annotated[
    Annotated[_W, Tag(WORD)] | Annotated[_V, Tag(OTHER)], Discriminator(_tag)
]
