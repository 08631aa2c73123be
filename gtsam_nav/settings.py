"""The base of every settings model: unknown keys are errors, values are frozen."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict


class Settings(BaseModel):
    """Settings of one algorithm; subclasses stand beside the algorithm and name units."""

    model_config = ConfigDict(extra="forbid", frozen=True, validate_default=True)
