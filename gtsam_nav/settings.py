"""The base of every settings model: unknown keys are errors, values are frozen.

What pydantic finds wrong with a value is said in the words of who wrote it, choices included.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from pydantic import BaseModel, ConfigDict, ValidationError

if TYPE_CHECKING:
    from pydantic_core import ErrorDetails

LONGEST_SHOWN = 60
"""Characters of a wrong value that are repeated."""
_WANTED = {
    "int": "a whole number",
    "int_from_float": "a whole number",
    "float": "a number",
    "finite_number": "a finite number",
    "bool": "true or false",
    "string": "a text",
    "path": "a path",
    "tuple": "a list",
    "list": "a list",
    "dict": "a map of keys",
    "model": "a map of keys",
}
"""What belongs where pydantic found another type, or what it could not parse as one."""
_BOUNDS = {
    "greater_than": "above {gt:g}",
    "greater_than_equal": "at least {ge:g}",
    "less_than": "below {lt:g}",
    "less_than_equal": "at most {le:g}",
}
_LENGTHS = {
    "too_short": "at least {min_length}",
    "too_long": "at most {max_length}",
}


class Settings(BaseModel):
    """Settings of one algorithm; subclasses stand beside the algorithm and name units."""

    model_config = ConfigDict(extra="forbid", frozen=True, validate_default=True)


def first_fault(error: ValidationError) -> str:
    """The first thing that pydantic found wrong, in one line: its key, and what is wrong."""
    first = error.errors()[0]
    key = ".".join(str(part) for part in first["loc"])
    what = in_words(first)
    return f"{key}: {what}" if key else what


def in_words(fault: ErrorDetails) -> str:
    """What is wrong with a value, and what belongs in its place."""
    kind, context = fault["type"], fault.get("ctx", {})
    given = _shown(fault["input"])
    if kind == "missing":
        return "is missing"
    if kind == "literal_error":
        return f"{given} is unknown; the choices are: {context['expected']}"
    if kind in _BOUNDS:
        return f"{given} must be {_BOUNDS[kind].format(**context)}"
    if kind in _LENGTHS:
        return f"{given} must hold {_LENGTHS[kind].format(**context)}"
    wanted = _WANTED.get(kind.removesuffix("_type").removesuffix("_parsing"))
    if wanted is not None:
        return f"{given} stands where {wanted} belongs"
    return fault["msg"].removeprefix("Value error, ")


def _shown(value: Any) -> str:
    """A value as YAML has it, cut short."""
    try:
        text = json.dumps(value, default=str, ensure_ascii=False)
    except TypeError:  # a date may be a key in YAML
        text = str(value)
    return text if len(text) <= LONGEST_SHOWN else f"{text[: LONGEST_SHOWN - 3]}..."
