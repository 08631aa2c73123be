"""Limits of the sonar's settings: the last value that is taken, and the first that is not."""

from __future__ import annotations

from typing import Any

import pytest
from pydantic import ValidationError

from gtsam_nav.sonar.settings import ScanSettings, SegmentationSettings, SonarSettings


@pytest.mark.parametrize(
    ("settings", "taken", "refused"),
    [
        (SegmentationSettings, {"min_range_m": 0.0}, {"min_range_m": -0.1}),
        (SegmentationSettings, {"max_range_m": 0.1, "min_range_m": 0.0}, {"max_range_m": 0.0}),
        (SegmentationSettings, {"min_range_m": 59.9}, {"min_range_m": 60.0}),
        (SegmentationSettings, {"min_range_m": 59.9}, {"min_range_m": 61.0}),
        (SegmentationSettings, {"threshold_sigmas": 0.1}, {"threshold_sigmas": 0.0}),
        (SegmentationSettings, {"min_intensity": 1}, {"min_intensity": 0}),
        (
            SegmentationSettings,
            {"min_intensity": 255, "max_threshold": 255},
            {"max_threshold": 256},
        ),
        (SegmentationSettings, {"min_intensity": 150}, {"min_intensity": 151}),
        (SegmentationSettings, {"min_intensity": 1, "max_threshold": 1}, {"max_threshold": 39}),
        (SegmentationSettings, {"min_separation_m": 0.1}, {"min_separation_m": 0.0}),
        (SegmentationSettings, {"max_echoes": 1}, {"max_echoes": 0}),
        (ScanSettings, {"min_points": 3}, {"min_points": 2}),
        (ScanSettings, {"max_gap_s": 0.1}, {"max_gap_s": 0.0}),
        (ScanSettings, {"min_interval_s": 0.0}, {"min_interval_s": -0.1}),
        (ScanSettings, {"min_move_m": 0.0}, {"min_move_m": -0.1}),
        (ScanSettings, {"min_turn_deg": 0.0}, {"min_turn_deg": -0.1}),
    ],
)
def test_limits(settings: Any, taken: dict[str, float], refused: dict[str, float]) -> None:
    assert settings(**taken).model_dump().items() >= taken.items()
    with pytest.raises(ValidationError):
        settings(**refused)


def test_defaults_are_within_their_own_limits() -> None:
    defaults = SonarSettings()
    assert SonarSettings.model_validate(defaults.model_dump()) == defaults
    assert defaults.use
