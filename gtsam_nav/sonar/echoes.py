"""Beam segmentation: from echo profiles to echoes.

An echo is a local maximum of the profile that stands out of the noise floor of its range. The floor
is the mission's own (median and spread over the beams at each bin), so that no absolute threshold
has to transfer between sonars. After Mallios et al. 2014, section 4.1.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gtsam_nav.frames import Array, wrap_angle
from gtsam_nav.mission import Sensor
from gtsam_nav.sensors.noise import SonarNoise
from gtsam_nav.series import BeamSeries, BoolArray, IntArray, ScanSeries
from gtsam_nav.sonar._peaks import strongest_peaks
from gtsam_nav.sonar.settings import SegmentationSettings

FLOOR_BEAMS = 4000
"""Beams that the noise floor is estimated from, spread over the mission."""


@dataclass(frozen=True)
class Echoes:
    """Echoes of a scanning sonar in body coordinates, in the order of their beams.

    Attributes
    ----------
    t : ndarray, shape (k,)
        Time of each echo's own beam, s.
    beam : ndarray of int, shape (k,)
        Index of the beam in the mission's series (of the scan, for scans extracted elsewhere).
    xy_b : ndarray, shape (k, 2)
        Position in body axes at that time, m; the sonar's beam has no vertical resolution. The body
        is taken to be level: of one that lies upside down the echoes are `mirrored`.
    cov_b : ndarray, shape (k, 2, 2)
        From range and bearing noise, m^2.
    strength : ndarray, shape (k,)
        Intensity, 0 to 255.
    """

    t: Array
    beam: IntArray
    xy_b: Array
    cov_b: Array
    strength: Array

    def __len__(self) -> int:
        return len(self.t)

    def shift(self, by_s: float) -> Echoes:
        """The echoes at times moved by a constant."""
        return replace(self, t=self.t + by_s)

    def mirrored(self, which: BoolArray) -> Echoes:
        """The echoes, those that a mask picks with port for starboard."""
        side = np.where(which[:, None], [1.0, -1.0], 1.0)
        cov_b = side[:, :, None] * self.cov_b * side[:, None, :]
        return replace(self, xy_b=side * self.xy_b, cov_b=cov_b)

    def select(self, which: BoolArray) -> Echoes:
        """The echoes that a mask picks."""
        return Echoes(
            t=self.t[which],
            beam=self.beam[which],
            xy_b=self.xy_b[which],
            cov_b=self.cov_b[which],
            strength=self.strength[which],
        )


def segment(sonar: Sensor, settings: SegmentationSettings) -> Echoes:
    """Echoes of all beams.

    Parameters
    ----------
    sonar : Sensor
        With a `BeamSeries`.
    settings : SegmentationSettings
    """
    beams = sonar.series
    assert isinstance(beams, BeamSeries)
    first_bin, last_bin = (
        int(np.clip(round(r / beams.resolution_m), 0, beams.intensity.shape[1]))
        for r in (settings.min_range_m, settings.max_range_m)
    )
    threshold = _thresholds(beams.intensity, settings)
    beam, bin_centre, strength = strongest_peaks(
        beams.intensity,
        threshold,
        first_bin,
        last_bin,
        max(1, round(settings.min_separation_m / beams.resolution_m)),
        settings.max_echoes,
    )
    range_m = (bin_centre + 0.5) * beams.resolution_m
    bearing = beam_bearings(sonar, beams.angle[beam])
    ray = np.stack([np.cos(bearing), np.sin(bearing)], axis=1)
    noise = SonarNoise.model_validate(sonar.noise)
    return Echoes(
        t=beams.t[beam],
        beam=beam,
        xy_b=sonar.xyz_b[:2] + range_m[:, None] * ray,
        cov_b=_polar_covariance(range_m, ray, noise),
        strength=strength,
    )


def beam_bearings(sonar: Sensor, angle: Array) -> Array:
    """Bearings of beams from the bow, rad clockwise, from their head angles."""
    mounting_yaw = np.arctan2(sonar.R_bs[1, 0], sonar.R_bs[0, 0])
    # a sonar mounted upside down turns the other way
    direction = np.sign(sonar.R_bs[2, 2]) or 1.0
    return np.asarray(wrap_angle(mounting_yaw + direction * angle))


def echoes_of_scans(sensor: Sensor) -> Echoes:
    """The points of scans that were extracted elsewhere, as echoes of one time a scan."""
    scans = sensor.series
    assert isinstance(scans, ScanSeries)
    beam = np.repeat(np.arange(len(scans)), np.diff(scans.first))
    xy_b = scans.points_b[:, :2]
    ray_b = xy_b - sensor.xyz_b[:2]
    range_m = np.maximum(np.linalg.norm(ray_b, axis=1), 1e-6)
    noise = SonarNoise.model_validate(sensor.noise)
    return Echoes(
        t=scans.t[beam],
        beam=beam,
        xy_b=xy_b,
        cov_b=_polar_covariance(range_m, ray_b / range_m[:, None], noise),
        strength=np.full(len(beam), 255.0),
    )


def _thresholds(intensity: NDArray[np.uint8], settings: SegmentationSettings) -> Array:
    """Least intensity of an echo at each bin."""
    sample = intensity[:: max(1, len(intensity) // FLOOR_BEAMS)]
    floor, upper = np.percentile(sample, [50.0, 84.1], axis=0)
    raised = floor + settings.threshold_sigmas * np.maximum(upper - floor, 1.0)
    return np.asarray(np.clip(raised, settings.min_intensity, settings.max_threshold))


def _polar_covariance(range_m: Array, ray: Array, noise: SonarNoise) -> Array:
    """Covariance of points at a range along unit rays, shape (k, 2, 2)."""
    along = np.einsum("ki,kj->kij", ray, ray) * noise.sigma_range_m**2
    across = np.stack([-ray[:, 1], ray[:, 0]], axis=1)
    sigma_across = range_m * np.radians(noise.sigma_bearing_deg)
    return np.asarray(along + np.einsum("ki,kj,k->kij", across, across, sigma_across**2))
