"""A mechanically scanned imaging sonar: echo profiles of a world, beam by beam."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from gtsam_nav.frames import Array, rotation_from_rpy
from gtsam_nav.mission import Sensor
from gtsam_nav.series import BeamSeries, IntArray
from gtsam_nav.settings import Settings
from gtsam_nav.simulation.motion import Motion
from gtsam_nav.simulation.raycast import Hits, cast
from gtsam_nav.simulation.world import World

BEAMS_AT_ONCE = 200
"""A turn of the head: over it the vehicle moves little, so distant walls can be left out."""

_WIDTH_IN_SIGMAS = float(np.sqrt(8 * np.log(2)))
"""Width at half height of a Gaussian of unit sigma."""

WALL_SHARE = 0.65
"""Stated bearing sigma over the beam's. A wall's echo is the mean of all that the beam lights, half
as uncertain; but neighbouring beams overlap and share their errors, which are stated as if apart.
"""

_MOST_BEAMS = 3
"""That an echo from nothing fixed lasts."""


class SonarSimulation(Settings):
    """The sonar and its faults; levels are in counts of the 8-bit echo.

    Attributes
    ----------
    step_deg, beam_interval_s : float
        Head turn between beams, and the time between them.
    range_m, resolution_m : float
        Range of the last bin's end, and the length of a bin.
    beam_width_deg, rays : float, int
        Width at half power, and rays that sample the beam pattern.
    pulse_sigma_m : float
        Spread of a point's echo in range.
    echo_level : float
        A wall's echo head-on at no distance.
    half_range_m : float
        Distance over which an echo's level halves in spite of the receiver's gain.
    diffuse_share : float
        Level of a grazing echo relative to a head-on one.
    incidence_power : float
        How sharply the rest falls off with the cosine of incidence.
    corner_m : float
        Within this distance of a corner a wall sends all sound back.
    second_echo : float
        Level of a head-on wall's echo at twice the range, relative to the first.
    noise_near, noise_far : float
        Noise floor at no range and at full range.
    clutter_per_beam, clutter_level : float
        Rate of echoes from nothing fixed (fish, bubbles), and their mean level.
    ring_down_level, ring_down_m : float
        Level at the head after a ping, and the range over which it falls to 1/e.
    lost_share : float
        Share of pings that never reach the log, half of them in bursts.
    sigma_range_m : float
        Stated range noise of an echo, larger than its own (``benchmarks.registration``): neighbours
        share it.
    scale_sigma : float
        Stated error of the ways between matched scans: the sound speed is exact, but the walls'
        sampling holds matches back.
    match_floor_m, match_floor_deg : float
        Stated errors of a match beyond noise and motion: walls stand upright, but a grazed wall
        echoes from its nearer part.
    """

    step_deg: float = Field(default=1.8, gt=0)
    beam_interval_s: float = Field(default=0.07, gt=0)
    range_m: float = Field(default=50.0, gt=0)
    resolution_m: float = Field(default=0.1, gt=0)
    xyz_m: tuple[float, float, float] = (0.35, 0.0, -0.25)
    rpy_deg: tuple[float, float, float] = (0.0, 0.0, 180.0)
    beam_width_deg: float = Field(default=3.0, gt=0)
    rays: int = Field(default=21, ge=1)
    pulse_sigma_m: float = Field(default=0.15, gt=0)
    echo_level: float = Field(default=210.0, ge=0)
    half_range_m: float = Field(default=60.0, gt=0)
    diffuse_share: float = Field(default=0.3, ge=0, le=1)
    incidence_power: float = Field(default=2.0, ge=0)
    corner_m: float = Field(default=0.4, ge=0)
    second_echo: float = Field(default=0.3, ge=0)
    noise_near: float = Field(default=4.0, ge=0)
    noise_far: float = Field(default=16.0, ge=0)
    clutter_per_beam: float = Field(default=0.03, ge=0)
    clutter_level: float = Field(default=90.0, ge=0)
    ring_down_level: float = Field(default=160.0, ge=0)
    ring_down_m: float = Field(default=0.5, gt=0)
    lost_share: float = Field(default=0.005, ge=0, lt=1)
    sigma_range_m: float = Field(default=0.08, gt=0)
    scale_sigma: float = Field(default=0.003, ge=0)
    match_floor_m: float = Field(default=0.03, ge=0)
    match_floor_deg: float = Field(default=0.1, ge=0)

    @property
    def bins(self) -> int:
        """Number of bins of a profile."""
        return round(self.range_m / self.resolution_m)


def sonar(
    motion: Motion, world: World, duration_s: float, s: SonarSimulation, rng: np.random.Generator
) -> Sensor:
    """Beams along the true motion, each from the true pose at its own time."""
    t = np.arange(rng.uniform(0, s.beam_interval_s), duration_s, s.beam_interval_s)
    angle = np.radians(s.step_deg) * np.arange(len(t)) % (2 * np.pi)
    kept = ~_lost_pings(rng, len(t), s.lost_share)
    t, angle = t[kept], angle[kept]
    return Sensor(
        name="sonar",
        type="beams",
        series=BeamSeries(
            t=t,
            angle=angle,
            intensity=_profiles(motion, world, t, angle, s, rng),
            resolution_m=s.resolution_m,
        ),
        xyz_b=np.array(s.xyz_m),
        R_bs=rotation_from_rpy(np.radians(s.rpy_deg)),
        noise={
            "sigma_range_m": s.sigma_range_m,
            "sigma_bearing_deg": WALL_SHARE * s.beam_width_deg / _WIDTH_IN_SIGMAS,
            "scale_sigma": s.scale_sigma,
            "match_floor_m": s.match_floor_m,
            "match_floor_deg": s.match_floor_deg,
        },
        simulated=True,
    )


def _profiles(
    motion: Motion,
    world: World,
    t: Array,
    angle: Array,
    s: SonarSimulation,
    rng: np.random.Generator,
) -> NDArray[np.uint8]:
    """What the beams receive, shape (n, bins); of a long mission, only this is held whole."""
    # the jitter keeps the rays' spacing from showing as stripes on grazed walls
    jitter = rng.uniform(-0.5, 0.5, len(t))
    clutter = _drawn_clutter(len(t), s, rng)
    intensity = np.empty((len(t), s.bins), dtype=np.uint8)
    for first in range(0, len(t), BEAMS_AT_ONCE):
        turn = slice(first, min(first + BEAMS_AT_ONCE, len(t)))
        origin_n, azimuth = beam_axes(motion, t[turn], angle[turn], s)
        power = _echoes(world, origin_n, azimuth, jitter[turn], s)
        clutter.add_to(power, turn)
        intensity[turn] = _receive(power, s, rng)
    return intensity


def beam_axes(motion: Motion, t: Array, angle: Array, s: SonarSimulation) -> tuple[Array, Array]:
    """Where the head is and where its beams point, seen from above.

    Parameters
    ----------
    t, angle : ndarray, shape (n,)
        Times (s) and head angles (rad) of the beams.

    Returns
    -------
    origin_n : ndarray, shape (n, 2)
        North and east, m.
    azimuth : ndarray, shape (n,)
        Clockwise from north, rad.
    """
    truth = motion.at(t)
    R_nb = truth.R_nb
    origin_n = truth.p_n + R_nb @ np.array(s.xyz_m)
    axis_s = np.column_stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)])
    axis_b = axis_s @ rotation_from_rpy(np.radians(s.rpy_deg)).T
    axis_n = np.einsum("nij,nj->ni", R_nb, axis_b)
    return origin_n[:, :2], np.arctan2(axis_n[:, 1], axis_n[:, 0])


def _lost_pings(rng: np.random.Generator, n: int, share: float) -> NDArray[np.bool_]:
    """Which of n pings are lost: half of the share alone, half in bursts of ten."""
    alone = rng.uniform(size=n) < share / 2
    begins = rng.uniform(size=n) < share / 20
    return np.asarray(alone | (np.convolve(begins, np.ones(10))[:n] > 0))


def _echoes(
    world: World, origin_n: Array, azimuth: Array, jitter: Array, s: SonarSimulation
) -> NDArray[np.float32]:
    """Mean echo power of beams in each bin, shape (m, bins); jitter is in steps between rays."""
    sigma = np.radians(s.beam_width_deg) / _WIDTH_IN_SIGMAS
    step = 5 * sigma / s.rays
    fan = step * (np.arange(s.rays) - (s.rays - 1) / 2 + jitter[:, None])
    hits = cast(world, origin_n, azimuth[:, None] + fan, s.range_m)
    pattern = step / (np.sqrt(2 * np.pi) * sigma) * np.exp(-0.5 * (fan / sigma) ** 2)
    level = _reflected(hits, s)
    power = _spread(hits.range_m, pattern * level**2, s)
    second = s.second_echo * level * hits.cosine**4
    return power + _spread(2 * hits.range_m, pattern * second**2, s)


def _reflected(hits: Hits, s: SonarSimulation) -> Array:
    """Echo level of each ray's hit, in counts."""
    specular = np.where(hits.to_edge_m < s.corner_m, 1.0, hits.cosine**s.incidence_power)
    level = s.echo_level * (s.diffuse_share + (1 - s.diffuse_share) * specular)
    return np.asarray(level * 0.5 ** (hits.range_m / s.half_range_m))


def _spread(range_m: Array, power: Array, s: SonarSimulation) -> NDArray[np.float32]:
    """Sum point echoes of shape (m, rays) into profiles of shape (m, bins), as long as the pulse.

    A single echo of power 1 peaks at 1 in its bin.
    """
    from scipy.ndimage import gaussian_filter1d

    m = len(range_m)
    inside = range_m < s.range_m
    beam = np.nonzero(inside)[0]
    # bin centres are at (k + 1/2) * resolution: share each echo between its two neighbours
    place = range_m[inside] / s.resolution_m + 0.5
    low = place.astype(int)
    upper = place - low
    padded = s.bins + 2
    flat = np.bincount(beam * padded + low, power[inside] * (1 - upper), m * padded)
    flat += np.bincount(beam * padded + low + 1, power[inside] * upper, m * padded)
    width = s.pulse_sigma_m / s.resolution_m
    profile = flat.reshape(m, padded)[:, 1:-1].astype(np.float32)
    return np.asarray(
        gaussian_filter1d(profile, width, axis=1, mode="constant") * (np.sqrt(2 * np.pi) * width),
        dtype=np.float32,
    )


@dataclass(frozen=True)
class _Clutter:
    """Short-lived echoes from nothing fixed, shape (k,) each.

    ``beam`` and ``bin`` say where each begins, ``width`` how many beams it lasts.
    """

    beam: IntArray
    bin: IntArray
    width: IntArray
    power: Array

    def add_to(self, power: NDArray[np.float32], beams: slice) -> None:
        """Add the echoes to some beams' profiles (m, bins) in place."""
        m, bins = power.shape
        near = (self.beam < beams.stop) & (self.beam + self.width > beams.start)
        beam, centre, width = (x[near] for x in (self.beam, self.bin, self.width))
        for shift in range(_MOST_BEAMS):
            row = beam + shift - beams.start
            for offset, share in ((-1, 0.5), (0, 1.0), (1, 0.5)):
                column = centre + offset
                inside = (row >= 0) & (row < m) & (column >= 0) & (column < bins)
                fits = (shift < width) & inside
                np.add.at(power, (row[fits], column[fits]), share * self.power[near][fits])


def _drawn_clutter(n: int, s: SonarSimulation, rng: np.random.Generator) -> _Clutter:
    """Clutter of n beams."""
    count = rng.poisson(s.clutter_per_beam * n)
    beam, centre = rng.integers(0, max(n, 1), count), rng.integers(0, s.bins, count)
    width, level = rng.integers(1, _MOST_BEAMS + 1, count), rng.exponential(s.clutter_level, count)
    return _Clutter(beam, centre, width, level**2)


def _receive(
    power: NDArray[np.float32], s: SonarSimulation, rng: np.random.Generator
) -> NDArray[np.uint8]:
    """Echoes with noise floor, ring-down and Rayleigh speckle, as 8-bit levels."""
    range_m = (np.arange(s.bins) + 0.5) * s.resolution_m
    floor = s.noise_near * (s.noise_far / s.noise_near) ** (range_m / s.range_m)
    ring_down = s.ring_down_level * np.exp(-range_m / s.ring_down_m)
    mean_power = power + (floor**2 + ring_down**2).astype(np.float32)
    speckle = rng.standard_exponential(power.shape, dtype=np.float32)
    return np.asarray(np.minimum(np.sqrt(mean_power * speckle), 255.0), dtype=np.uint8)
