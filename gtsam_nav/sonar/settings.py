"""Settings of the sonar's processing."""

from __future__ import annotations

from pydantic import Field, model_validator

from gtsam_nav.settings import Settings


class SegmentationSettings(Settings):
    """From an echo profile to echoes.

    Attributes
    ----------
    min_range_m, max_range_m : float
        Ranges that are looked at; nearer ones hold the ring-down of the head.
    threshold_sigmas : float
        An echo stands this many noise deviations above the noise floor of its range.
    min_intensity, max_threshold : int
        Nothing weaker than the first is an echo; the threshold never rises above the second, so
        that a mission spent along one wall cannot raise its own floor to the wall's echo.
    min_separation_m : float
        Of two peaks closer together the weaker is dropped.
    max_echoes : int
        Strongest echoes kept a beam.
    """

    min_range_m: float = Field(default=2.0, ge=0)
    max_range_m: float = Field(default=60.0, gt=0)
    threshold_sigmas: float = Field(default=6.0, gt=0)
    min_intensity: int = Field(default=40, ge=1, le=255)
    max_threshold: int = Field(default=150, ge=1, le=255)
    min_separation_m: float = Field(default=2.0, gt=0)
    max_echoes: int = Field(default=2, ge=1)

    @model_validator(mode="after")
    def _limits_are_ordered(self) -> SegmentationSettings:
        if not self.min_range_m < self.max_range_m:
            raise ValueError("min_range_m must be smaller than max_range_m")
        if self.min_intensity > self.max_threshold:
            raise ValueError("min_intensity must not exceed max_threshold")
        return self


class ScanSettings(Settings):
    """From beams to scans.

    Attributes
    ----------
    min_points : int
        A scan with fewer points is not registered, and no submap with fewer.
    max_gap_s : float
        A longer silence of the sonar ends a scan.
    min_interval_s : float
        Scans closer together than this are thinned out.
    min_move_m, min_turn_deg : float
        For the graph, those of a scanner that takes them at once are thinned by motion instead: one
        is kept where the vehicle has moved or turned so far since the last.
    """

    min_points: int = Field(default=20, ge=3)
    max_gap_s: float = Field(default=3.0, gt=0)
    min_interval_s: float = Field(default=2.0, ge=0)
    min_move_m: float = Field(default=0.5, ge=0)
    min_turn_deg: float = Field(default=15.0, ge=0)


class SonarSettings(Settings):
    """Everything about the scanning sonar."""

    use: bool = True
    segmentation: SegmentationSettings = SegmentationSettings()
    scans: ScanSettings = ScanSettings()
