"""What a check has to say."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Severity = Literal["ok", "warning"]


@dataclass(frozen=True)
class Finding:
    """The outcome of one check of the audit.

    ``check`` is a short stable name, ``sensor`` None where the whole mission is meant.
    """

    check: str
    sensor: str | None
    severity: Severity
    message: str
