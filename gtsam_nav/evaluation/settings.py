"""Settings of the evaluation."""

from __future__ import annotations

from pydantic import model_validator

from gtsam_nav.settings import Settings


class EvaluationSettings(Settings):
    """What is scored.

    Attributes
    ----------
    window_s : (float, float) or None
        Half-open mission-time window to score; None scores the reference's whole span.
    """

    window_s: tuple[float, float] | None = None

    @model_validator(mode="after")
    def _window_is_ordered(self) -> EvaluationSettings:
        if self.window_s is not None and not self.window_s[0] < self.window_s[1]:
            start, stop = self.window_s
            raise ValueError(f"the window [{start}, {stop}] is empty; start must be before stop")
        return self
