"""The base of every settings model: unknown keys are errors, values are frozen."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, ValidationError


class Settings(BaseModel):
    """Settings of one algorithm; subclasses stand beside the algorithm and name units."""

    model_config = ConfigDict(extra="forbid", frozen=True, validate_default=True)


def first_fault(error: ValidationError) -> str:
    """The first thing that pydantic found wrong, in one line: its key, and what is wrong."""
    first = error.errors()[0]
    key = ".".join(str(part) for part in first["loc"])
    what = first["msg"].removeprefix("Value error, ")
    return f"{key}: {what}" if key else what
