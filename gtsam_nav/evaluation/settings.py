"""Settings of the evaluation."""

from __future__ import annotations

from gtsam_nav.settings import Settings


class EvaluationSettings(Settings):
    """What is scored.

    Attributes
    ----------
    window_s : (float, float) or None
        Half-open mission-time window to score; None scores the reference's whole span.
    """

    window_s: tuple[float, float] | None = None
