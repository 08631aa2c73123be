"""Segmentation: against a readable oracle, and on beams with known echoes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from gtsam_nav.frames import Array, rotation_from_rpy, wrap_angle
from gtsam_nav.mission import Sensor
from gtsam_nav.series import BeamSeries, ScanSeries
from gtsam_nav.sonar._peaks import strongest_peaks
from gtsam_nav.sonar.defects import sonar_defect
from gtsam_nav.sonar.echoes import Echoes, _thresholds, beam_bearings, echoes_of_scans, segment
from gtsam_nav.sonar.settings import SegmentationSettings

BINS, RESOLUTION_M = 300, 0.1
PULSE = np.array([60, 160, 220, 160, 60])


def beams(n: int = 200, noise: float = 8.0, seed: int = 0) -> NDArray[np.uint8]:
    rng = np.random.default_rng(seed)
    return np.clip(rng.rayleigh(noise, size=(n, BINS)), 0, 255).astype(np.uint8)


def with_echo(
    intensity: NDArray[np.uint8], range_m: float, strength: float = 1.0
) -> NDArray[np.uint8]:
    """A pulse centred on the bin that holds a range."""
    k = int(range_m / RESOLUTION_M)
    intensity[:, k - 2 : k + 3] = np.maximum(intensity[:, k - 2 : k + 3], strength * PULSE)
    return intensity


def sonar_of(intensity: NDArray[np.uint8], **mounting: Array) -> Sensor:
    n = len(intensity)
    angle = np.radians(1.8) * np.arange(n) % (2 * np.pi)
    series = BeamSeries(
        t=0.07 * np.arange(n), angle=angle, intensity=intensity, resolution_m=RESOLUTION_M
    )
    noise = {"sigma_range_m": 0.1, "sigma_bearing_deg": 1.8}
    return Sensor(name="sonar", type="beams", series=series, noise=noise, **mounting)


def readable_peaks(
    profile: NDArray[np.uint8], threshold: Array, first: int, last: int, separation: int, most: int
) -> list[tuple[float, float]]:
    """Strongest peaks of one profile, written down plainly."""
    padded = np.pad(profile.astype(float), 1, mode="edge")
    smooth = ((padded[:-2] + padded[1:-1] + padded[2:]) / 3)[first:last]
    left = np.concatenate([[-1.0], smooth[:-1]])
    right = np.concatenate([smooth[1:], [-1.0]])
    is_peak = (smooth >= left) & (smooth >= right) & (smooth >= threshold[first:last])
    found: list[tuple[float, float]] = []
    for k in sorted(np.flatnonzero(is_peak & (smooth > 0)), key=lambda k: (-smooth[k], k)):
        if len(found) == most:
            break
        if any(abs(k + first - centre) < separation for centre, _ in found):
            continue
        near = np.arange(max(k - separation // 2, 0), min(k + separation // 2 + 1, len(smooth)))
        high = smooth[near] >= 0.5 * smooth[k]
        low = near[~high]
        begin = low[low < k].max(initial=-1) + 1
        end = low[low > k].min(initial=len(smooth))
        run = near[(near >= begin) & (near < end)]
        centre = float(np.average(run, weights=smooth[run])) + first
        found.append((centre, float(smooth[k])))
    return found


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("separation", [1, 7, 20])
@pytest.mark.parametrize(("first", "last"), [(5, 110), (0, 120)])
def test_compiled_peaks_equal_readable_ones(
    seed: int, separation: int, first: int, last: int
) -> None:
    rng = np.random.default_rng(seed)
    intensity = rng.integers(0, 256, size=(20, 120), dtype=np.uint8)
    threshold = rng.uniform(60, 160, size=120)
    beam, centre, strength = strongest_peaks(intensity, threshold, first, last, separation, 3)
    assert len(beam) > 20
    for i, profile in enumerate(intensity):
        wanted = readable_peaks(profile, threshold, first, last, separation, 3)
        got = list(zip(centre[beam == i], strength[beam == i], strict=True))
        assert len(got) == len(wanted)
        np.testing.assert_allclose(got, wanted, atol=1e-9)


def test_an_echo_lies_at_the_centre_of_its_bin() -> None:
    intensity = np.zeros((3, BINS), np.uint8)
    intensity[:, 98:103] = PULSE
    echoes = segment(sonar_of(intensity), SegmentationSettings(min_intensity=1))
    np.testing.assert_allclose(np.linalg.norm(echoes.xy_b, axis=1), 100.5 * RESOLUTION_M)


def test_the_threshold_is_sigmas_above_the_median_of_its_range() -> None:
    """Its values rise evenly from 0 to 100: the spread is that of the hundredths 50 to 84.1."""
    intensity = np.zeros((1001, BINS), np.uint8)
    intensity[:, 150] = np.arange(1001) // 10
    settings = SegmentationSettings(threshold_sigmas=2.0)
    (floor,) = _thresholds(intensity, settings)[150:151]
    assert floor == 50.0 + 2.0 * (84.0 - 50.0)
    # where nothing varies the spread is that of the last digit, and the limits hold
    low, high = (_thresholds(np.full((9, 1), level, np.uint8), settings)[0] for level in (7, 200))
    assert (low, high) == (settings.min_intensity, settings.max_threshold)
    assert _thresholds(np.full((9, 1), 60, np.uint8), settings)[0] == 62.0


def test_silent_sonar_has_no_echo() -> None:
    echoes = segment(sonar_of(np.zeros((50, BINS), np.uint8)), SegmentationSettings())
    assert len(echoes) == 0
    assert echoes.xy_b.shape == (0, 2)
    assert echoes.cov_b.shape == (0, 2, 2)


def test_noise_alone_has_hardly_any_echo() -> None:
    echoes = segment(sonar_of(beams()), SegmentationSettings())
    assert len(echoes) <= 2


def test_saturated_sonar_keeps_finite_echoes() -> None:
    settings = SegmentationSettings()
    echoes = segment(sonar_of(np.full((50, BINS), 255, np.uint8)), settings)
    assert len(echoes) <= 50 * settings.max_echoes
    assert np.all(np.isfinite(echoes.xy_b))
    ranges = np.linalg.norm(echoes.xy_b, axis=1)
    assert np.all((ranges >= settings.min_range_m) & (ranges <= BINS * RESOLUTION_M))


def test_ring_down_is_ignored() -> None:
    intensity = with_echo(beams(), 12.0)
    intensity[:, :15] = 255
    echoes = segment(sonar_of(intensity), SegmentationSettings(min_range_m=2.0))
    ranges = np.linalg.norm(echoes.xy_b, axis=1)
    assert ranges.min() > 10.0
    assert len(np.unique(echoes.beam)) == len(intensity)


def test_of_two_close_echoes_the_stronger_stays() -> None:
    intensity = with_echo(with_echo(beams(), 12.0, 0.7), 13.0)
    echoes = segment(sonar_of(intensity), SegmentationSettings(min_separation_m=2.0))
    ranges = np.linalg.norm(echoes.xy_b, axis=1)
    assert len(echoes) == len(intensity)
    np.testing.assert_allclose(ranges, 13.05, atol=0.1)


def test_two_separate_echoes_both_stay_and_no_third() -> None:
    intensity = with_echo(with_echo(with_echo(beams(), 8.0), 16.0, 0.95), 24.0, 0.9)
    echoes = segment(sonar_of(intensity), SegmentationSettings(max_echoes=2))
    ranges = np.linalg.norm(echoes.xy_b, axis=1).reshape(-1, 2)
    np.testing.assert_allclose(np.sort(ranges, axis=1), np.tile([8.05, 16.05], (200, 1)), atol=0.1)


def test_wall_along_the_whole_mission_does_not_raise_its_own_threshold() -> None:
    """The floor is a median over beams: an echo at one range in every beam lifts it there."""
    echoes = segment(sonar_of(with_echo(beams(), 12.0)), SegmentationSettings())
    assert len(np.unique(echoes.beam)) == 200


@pytest.mark.parametrize(("roll_deg", "direction"), [(0.0, 1.0), (180.0, -1.0)])
def test_bearing_by_mounting(roll_deg: float, direction: float) -> None:
    """Upside down, the head turns counterclockwise as seen from above."""
    mounting_yaw = np.radians(30.0)
    sonar = sonar_of(
        with_echo(beams(50), 12.0),
        xyz_b=np.array([0.5, -0.2, 0.1]),
        R_bs=rotation_from_rpy([np.radians(roll_deg), 0.0, mounting_yaw]),
    )
    echoes = segment(sonar, SegmentationSettings())
    offset = echoes.xy_b - [0.5, -0.2]
    bearing = np.arctan2(offset[:, 1], offset[:, 0])
    assert isinstance(sonar.series, BeamSeries)
    angle = sonar.series.angle[echoes.beam]
    np.testing.assert_allclose(
        wrap_angle(bearing - mounting_yaw - direction * angle), 0.0, atol=1e-12
    )
    # and as the rotation matrix itself has it
    ray_b = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1) @ sonar.R_bs.T
    np.testing.assert_allclose(wrap_angle(bearing - np.arctan2(*ray_b.T[1::-1])), 0, atol=1e-12)


@pytest.mark.parametrize(
    ("roll_deg", "direction"), [(30.0, 1.0), (-30.0, 1.0), (100.0, -1.0), (-100.0, -1.0)]
)
def test_a_head_that_leans_turns_as_its_axis_points(roll_deg: float, direction: float) -> None:
    sonar = sonar_of(beams(3), R_bs=rotation_from_rpy([np.radians(roll_deg), 0.0, 0.4]))
    found = beam_bearings(sonar, np.array([0.0, 0.2]))
    np.testing.assert_allclose(np.diff(found), 0.2 * direction)


def test_a_head_on_its_side_is_not_upside_down() -> None:
    sonar = sonar_of(beams(3), R_bs=np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]]))
    np.testing.assert_allclose(beam_bearings(sonar, np.array([0.0, 0.2])), [0.0, 0.2])


def test_a_separation_is_that_of_the_nearest_whole_bin() -> None:
    """2 m are 6.7 bins of 0.3 m: six bins apart is too near."""
    profile = np.zeros(BINS, np.uint8)
    profile[49:52], profile[55:58] = 240, 200
    series = sonar_of(np.tile(profile, (3, 1))).series
    assert isinstance(series, BeamSeries)
    coarse = Sensor(name="sonar", type="beams", series=replace(series, resolution_m=0.3))
    for separation_m, echoes in ((2.0, 3), (1.8, 6)):
        settings = SegmentationSettings(min_intensity=1, min_separation_m=separation_m)
        assert len(segment(coarse, settings)) == echoes


def test_covariance_is_range_along_the_ray_and_bearing_across() -> None:
    echoes = segment(sonar_of(with_echo(beams(), 20.0)), SegmentationSettings())
    variances = np.linalg.eigvalsh(echoes.cov_b)
    ranges = np.linalg.norm(echoes.xy_b, axis=1)
    np.testing.assert_allclose(variances[:, 0], 0.1**2, rtol=1e-9)
    np.testing.assert_allclose(variances[:, 1], (ranges * np.radians(1.8)) ** 2, rtol=1e-9)
    along = echoes.xy_b / ranges[:, None]
    np.testing.assert_allclose(
        np.einsum("ki,kij,kj->k", along, echoes.cov_b, along), 0.1**2, rtol=1e-9
    )


def test_scans_extracted_elsewhere_become_echoes() -> None:
    points = np.array([[3.0, 4.0, 9.0], [0.0, 0.0, 0.0], [6.0, -8.0, 1.0]])
    series = ScanSeries(t=np.array([1.0, 2.0, 3.0]), first=np.array([0, 2, 2, 3]), points_b=points)
    echoes = echoes_of_scans(Sensor(name="scans", type="scans", series=series))
    np.testing.assert_array_equal(echoes.t, [1.0, 1.0, 3.0])
    np.testing.assert_array_equal(echoes.beam, [0, 0, 2])
    np.testing.assert_array_equal(echoes.xy_b, points[:, :2])
    assert np.all(np.isfinite(echoes.cov_b))
    later = echoes.shift(0.25)
    np.testing.assert_array_equal(later.t, [1.25, 1.25, 3.25])
    np.testing.assert_array_equal(later.xy_b, echoes.xy_b)


def test_points_of_a_scanner_spread_about_where_it_is() -> None:
    """5 m abeam of the scanner: a bearing's error lies along the vehicle."""
    series = ScanSeries(t=np.array([0.0]), first=np.array([0, 1]), points_b=np.array([[3.0, 6.0]]))
    noise = {"sigma_range_m": 0.1, "sigma_bearing_deg": 2.0}
    scanner = Sensor("s", "scans", series, xyz_b=np.array([3.0, 1.0, 0.0]), noise=noise)
    (cov,) = echoes_of_scans(scanner).cov_b
    np.testing.assert_allclose(cov, np.diag([(5.0 * np.radians(2.0)) ** 2, 0.1**2]), atol=1e-12)


def test_mirrored_echoes_exchange_port_and_starboard() -> None:
    points, cov = np.array([[3.0, 4.0], [6.0, -8.0]]), np.array([[4.0, 1.0], [1.0, 2.0]])
    echoes = Echoes(np.zeros(2), np.arange(2), points, np.tile(cov, (2, 1, 1)), np.ones(2))
    mirrored = echoes.mirrored(np.array([False, True]))
    np.testing.assert_array_equal(mirrored.xy_b, [[3.0, 4.0], [6.0, 8.0]])
    np.testing.assert_array_equal(mirrored.cov_b, [cov, [[4.0, -1.0], [-1.0, 2.0]]])


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"intensity": np.zeros((50, BINS), np.uint8)}, "all echo intensities are zero"),
        ({"angle": np.full(50, 0.3)}, "the head angle never changes"),
    ],
)
def test_defects(change: dict[str, Array], reason: str) -> None:
    series = sonar_of(beams(50)).series
    assert isinstance(series, BeamSeries)
    columns = {"t": series.t, "angle": series.angle, "intensity": series.intensity, **change}
    assert sonar_defect(Sensor(name="s", type="beams", series=BeamSeries(**columns))) == reason
    assert sonar_defect(Sensor(name="s", type="beams", series=series)) == ""


def test_too_few_beams_and_empty_scans_are_defects() -> None:
    series = sonar_of(beams(50)).series
    two = Sensor(name="s", type="beams", series=series.select(slice(2)))
    assert sonar_defect(two) == "fewer than three beams"
    three = Sensor(name="s", type="beams", series=series.select(slice(3)))
    assert sonar_defect(three) == ""
    empty = ScanSeries(t=np.arange(3.0), first=np.zeros(4, int), points_b=np.empty((0, 2)))
    assert sonar_defect(Sensor(name="s", type="scans", series=empty)) == "the scans hold no points"
