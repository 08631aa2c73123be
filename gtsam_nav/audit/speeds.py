"""How fast DVL and odometry say the vehicle goes: other units than m/s, and wrong scales."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from gtsam_nav.audit import fixes
from gtsam_nav.audit.blame import Pair, suspects
from gtsam_nav.audit.courses import BOW, Baselines, Velocity
from gtsam_nav.audit.directions import TRACK, clear_means
from gtsam_nav.audit.findings import Finding
from gtsam_nav.audit.significance import limit
from gtsam_nav.frames import Array
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.sensors.noise import DvlNoise, OdometryNoise
from gtsam_nav.series import GnssSeries

TOLERATED = float(np.log(1.25))
"""A smaller error of scale is one of calibration, which the estimators' own states take up."""
UNITS = {"knots": 1852 / 3600, "km/h": 1 / 3.6, "ft/s": 0.3048, "cm/s": 1e-2, "mm/s": 1e-3}
"""In m/s."""
UNIT_WITHIN = float(np.log(1.05))
FEWEST = 5
TOP_SPEED_OVER_S = 10.0
"""Fixes so far apart in time tell a speed, whatever their noise."""
COLUMNS = {"dvl": "vx vy vz", "odometry": "vx vy"}


@dataclass(frozen=True)
class SpeedPair:
    """Logarithms of the speed by one source over that by another, stretch by stretch.

    ``stated`` is the spread of a constant ratio, as a logarithm, that the cards allow.
    """

    a: str
    b: str
    log_ratios: Array
    stated: float

    @property
    def pair(self) -> Pair:
        """Their names."""
        return self.a, self.b

    @property
    def log_ratio(self) -> float:
        """Median."""
        return float(np.median(self.log_ratios))

    @property
    def limit(self) -> float:
        """The largest logarithm that noise and the cards explain."""
        n = len(self.log_ratios)
        spread = 1.4826 * float(np.median(np.abs(self.log_ratios - self.log_ratio)))
        return limit(1.2533 * spread / np.sqrt(n), n - 1, self.stated)

    @property
    def apart(self) -> bool:
        """Whether the two differ by more."""
        return abs(self.log_ratio) > max(self.limit, TOLERATED)


def stated_scales(mission: Mission) -> dict[str, float]:
    """Spread of each source's scale by its card; wheels also slip."""
    stated = {TRACK: 0.0}
    for dvl in mission.of_type("dvl"):
        stated[dvl.name] = DvlNoise.model_validate(dvl.noise).scale_sigma
    for odometry in mission.of_type("odometry"):
        noise = OdometryNoise.model_validate(odometry.noise)
        stated[odometry.name] = float(np.hypot(noise.scale_sigma, noise.slip_sigma))
    return stated


def speed_pairs(
    sources: Sequence[Velocity], ways: Baselines | None, stated: dict[str, float]
) -> tuple[SpeedPair, ...]:
    """Each two sensors of velocity block by block, and each with the fixes between two of them.

    Parameters
    ----------
    sources : sequence of Velocity
    ways : Baselines or None
    stated : dict
        Spread of each source's scale, `TRACK` among them.
    """
    sensors = [s for s in sources if s.name != BOW]
    found = []
    for a, b in combinations(sensors, 2):
        mean_a, mean_b = clear_means(a, b)
        found.append((a.name, b.name, _log_ratios(mean_a, mean_b)))
    if ways is not None:
        heading = np.unwrap(ways.compass.heading)
        seen = ways.seen(heading)
        for source in sensors:
            covered = ways.covered(source)
            reckoned = ways.reckoned(heading, source)
            found.append((source.name, TRACK, _log_ratios(reckoned[covered], seen[covered])))
    return tuple(
        SpeedPair(a, b, ratios, float(np.hypot(stated[a], stated[b])))
        for a, b, ratios in found
        if len(ratios) >= FEWEST
    )


def _log_ratios(a: Array, b: Array) -> Array:
    length_a, length_b = (np.hypot(*v.T) for v in (a, b))
    known = (length_a > 0) & (length_b > 0)
    return np.asarray(np.log(length_a[known] / length_b[known]))


def speed_blame(pairs: Sequence[SpeedPair]) -> tuple[str, ...]:
    """Who contradicts all others; the fixes, which know what a metre is, only bear witness."""
    return suspects([p.pair for p in pairs if p.apart], [p.pair for p in pairs if not p.apart])


def speed_findings(
    mission: Mission, pairs: Sequence[SpeedPair], blamed: Sequence[str]
) -> Iterator[Finding]:
    """Judge unit and scale of each source that is to blame."""
    for name in blamed:
        own = [p for p in pairs if name in p.pair and p.apart]
        if name == TRACK or not own:
            continue
        pair = min(own, key=lambda p: p.limit)
        other = pair.b if pair.a == name else pair.a
        log_ratio = pair.log_ratio if pair.a == name else -pair.log_ratio
        rivals = [rival for rival in blamed if rival not in (name, TRACK)]
        or_else = f", unless {' or '.join(rivals)} are wrong" if rivals else ""
        read = (
            f"goes {np.exp(log_ratio):.3g} times as fast as {other}, "
            f"over {len(pair.log_ratios)} stretches"
        )
        yield _wrong_scale(mission.sensors[name], log_ratio, read, or_else)


def _wrong_scale(sensor: Sensor, log_ratio: float, read: str, or_else: str) -> Finding:
    columns = COLUMNS[sensor.type]
    unit = min(UNITS, key=lambda u: abs(log_ratio + np.log(UNITS[u])))
    if abs(log_ratio + np.log(UNITS[unit])) < UNIT_WITHIN:
        message = f"{read}: it reads in {unit}, not in m/s{or_else}"
        fix = fixes.scale(columns, UNITS[unit])
        return Finding("velocity unit", sensor.name, "warning", message, fix)
    message = f"{read}: its scale is wrong{or_else}"
    fix = fixes.scale(columns, float(f"{np.exp(-log_ratio):.2g}"))
    return Finding("velocity scale", sensor.name, "warning", message, fix)


def implausible_findings(mission: Mission, dvl: Sensor) -> Iterator[Finding]:
    """A DVL most of whose samples no vehicle is fast enough for."""
    dropped = mission.dropped.get((dvl.name, "implausible speed"), 0)
    if dropped > len(dvl.series):
        share = dropped / (dropped + len(dvl.series))
        most_m_s = DvlNoise.model_validate(dvl.noise).max_speed_m_s
        by_fixes_m_s = _top_speed(mission)
        if by_fixes_m_s > most_m_s:
            message = (
                f"{share:.0%} of its speeds are above the {most_m_s:g} m/s of its card, as "
                f"are those of the fixes ({by_fixes_m_s:.1f} m/s)"
            )
            fix = f"noise: {{max_speed_m_s: {np.ceil(2.0 * by_fixes_m_s):g}}}"
            yield Finding("velocity unit", dvl.name, "warning", message, fix)
            return
        message = (
            f"{share:.0%} of its speeds are implausible: it does not read in m/s, or they mark "
            "what is missing"
        )
        fix = f"{fixes.scale(COLUMNS['dvl'], UNITS['cm/s'])} (if cm/s, 0.001 if mm/s)"
        yield Finding("velocity unit", dvl.name, "warning", message, fix)


def _top_speed(mission: Mission) -> float:
    """Speed that the first receiver's fixes go at, at a twentieth of the time at least, m/s."""
    gnss = mission.first("gnss")
    if gnss is None:
        return 0.0
    fixes = gnss.series
    assert isinstance(fixes, GnssSeries)
    later = np.searchsorted(fixes.t, fixes.t + TOP_SPEED_OVER_S)
    a = np.flatnonzero(later < len(fixes))
    moved_m = np.hypot(*(fixes.p_n[later[a], :2] - fixes.p_n[a, :2]).T)
    return float(np.percentile(moved_m / (fixes.t[later[a]] - fixes.t[a]), 95)) if len(a) else 0.0
