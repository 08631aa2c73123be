"""What a check has to say."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Severity = Literal["ok", "warning"]


@dataclass(frozen=True)
class Finding:
    """The outcome of one check of the audit.

    Attributes
    ----------
    check : str
        A short stable name.
    sensor : str or None
        None where the whole mission is meant.
    severity : {"ok", "warning"}
    message : str
        What was found, with its figures.
    fix : str
        The sensor's line in the card that mends it; empty where there is nothing to mend.
    """

    check: str
    sensor: str | None
    severity: Severity
    message: str
    fix: str = ""

    @property
    def text(self) -> str:
        """The message, and what mends it."""
        return f"{self.message}; in the card: {self.fix}" if self.fix else self.message
