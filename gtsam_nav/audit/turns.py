"""Turns as every sensor saw them: units and signs of gyro, compass and odometry.

Gyro, compass, odometry and the course of GNSS velocities measure the same turns. Each two are
compared; what one of them has in another unit or direction than all the others is its fault.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from gtsam_nav.audit import fixes
from gtsam_nav.audit.agreement import Agreement, agreement
from gtsam_nav.audit.blame import Pair, suspects
from gtsam_nav.audit.findings import Finding
from gtsam_nav.audit.inertial import z_is_up
from gtsam_nav.audit.lagged_products import Signal, integrated
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.sensors.noise import GnssNoise
from gtsam_nav.series import GnssSeries, HeadingSeries, ImuSeries, OdometrySeries

DEG = float(np.degrees(1.0))
FULL_TURN_READ_AS_DEG = float(np.radians(2 * np.pi))
CLEAR_COURSE_SIGMAS = 5.0
"""Speed, in sigmas of a GNSS velocity, from which its direction is a course."""
SOURCES = ("imu", "heading", "odometry", "gnss")
"""Types of sensor that see turns, the least noisy first."""


@dataclass(frozen=True)
class Turns:
    """The yaw, rad, but for a constant and a drift, by one sensor."""

    sensor: Sensor
    signal: Signal


@dataclass(frozen=True)
class TurnPair:
    """Two sensors' turns, the second one's being those that the first's are compared with."""

    y: str
    x: str
    agreement: Agreement

    @property
    def pair(self) -> Pair:
        """Their names."""
        return self.y, self.x

    @property
    def unit(self) -> float:
        """The ratio of the units that the gain is nearest to: 1, or 180 / pi to either side."""
        return unit_ratio(self.agreement.gain)

    @property
    def opposed(self) -> bool:
        """Whether the two count the other way round."""
        return self.agreement.gain < 0


def unit_ratio(gain: float) -> float:
    """1, 180 / pi or pi / 180, whatever is nearest."""
    return min((1.0, DEG, 1 / DEG), key=lambda unit: abs(np.log(max(abs(gain), 1e-12) / unit)))


def turns_of(mission: Mission) -> dict[str, Turns]:
    """What saw turns, by name, the least noisy first."""
    found: dict[str, Turns] = {}
    for kind in SOURCES:
        for sensor in mission.of_type(kind):
            signal = _yaw(sensor)
            if signal is not None and len(signal.t) > 1:
                found[sensor.name] = Turns(sensor, signal)
    return found


def turn_pairs(turns: dict[str, Turns]) -> tuple[TurnPair, ...]:
    """Each two sensors that have anything in common."""
    compared = (
        (y, x, agreement(turns[y].signal, turns[x].signal)) for x, y in combinations(turns, 2)
    )
    return tuple(TurnPair(y, x, found) for y, x, found in compared if found is not None)


def _yaw(sensor: Sensor) -> Signal | None:
    series = sensor.series
    if isinstance(series, ImuSeries):
        return integrated(series.t, series.gyro_i @ sensor.R_bs[2])
    if isinstance(series, HeadingSeries):
        wrapped = np.degrees(series.heading) if in_radians(series) else series.heading
        return Signal(series.t, np.unwrap(wrapped))
    if isinstance(series, OdometrySeries):
        return integrated(series.t, series.yaw_rate)
    if isinstance(series, GnssSeries) and series.v_n is not None:
        noise = GnssNoise.model_validate(sensor.noise)
        fast = np.hypot(*series.v_n[:, :2].T) > CLEAR_COURSE_SIGMAS * noise.sigma_velocity_m_s
        course = np.unwrap(np.arctan2(series.v_n[fast, 1], series.v_n[fast, 0]))
        return Signal(series.t[fast] - noise.velocity_lag_s, course)
    return None


def in_radians(series: HeadingSeries) -> bool:
    """Whether headings that were read as degrees wrap as radians do: by 6.28 "degrees"."""
    return is_narrow(series) and bool(
        np.max(np.abs(np.diff(series.heading)), initial=0.0) > 0.5 * FULL_TURN_READ_AS_DEG
    )


def is_narrow(series: HeadingSeries) -> bool:
    """Whether no heading, read as degrees, exceeds a full turn in radians."""
    return bool(np.max(np.abs(series.heading), initial=0.0) <= FULL_TURN_READ_AS_DEG)


def wrong_signs(
    pairs: tuple[TurnPair, ...], mirrored: Collection[Pair], alike: Collection[Pair]
) -> tuple[str, ...]:
    """Who counts the other way round than all others.

    Parameters
    ----------
    pairs : tuple of TurnPair
    mirrored, alike : collection of (str, str)
        What else is known to count the other way, or the same way: a compass and fixes.
    """
    return suspects(
        [*(p.pair for p in pairs if p.opposed), *mirrored],
        [*(p.pair for p in pairs if not p.opposed), *alike],
    )


def turn_findings(
    turns: dict[str, Turns],
    pairs: tuple[TurnPair, ...],
    wrong_sign: tuple[str, ...],
    radians: Mapping[str, str],
) -> Iterator[Finding]:
    """Judge units and signs of gyros, compasses and odometry.

    Parameters
    ----------
    turns : dict of str to Turns
    pairs : tuple of TurnPair
    wrong_sign : tuple of str
    radians : mapping of str to str
        Compasses in radians, and what tells it.
    """
    wrong_unit = wrong_units(pairs)
    compass_is_to_blame = bool(radians.keys() & wrong_unit)
    for name, turned in turns.items():
        own = [p for p in pairs if name in p.pair]
        unit = name in wrong_unit and not compass_is_to_blame
        if turned.sensor.type == "imu":
            yield from _gyro(turned.sensor, own, unit, wrong_sign)
        elif turned.sensor.type == "heading":
            yield from _compass(turned.sensor, own, radians.get(name), wrong_sign)
        elif turned.sensor.type == "odometry":
            yield from _odometry(name, own, unit, wrong_sign)


def wrong_units(pairs: tuple[TurnPair, ...]) -> set[str]:
    """Who turns in another unit than all others."""
    alike = [p.pair for p in pairs if p.unit == 1.0]
    return {*suspects([p.pair for p in pairs if p.unit != 1.0], alike)}


def _told_best(name: str, own: list[TurnPair]) -> tuple[Agreement, float, str]:
    """The most precise agreement, how many times more the other turns, and who that is."""
    pair = min(own, key=lambda p: p.agreement.gain_sigma / abs(p.agreement.gain))
    gain = pair.agreement.gain
    return pair.agreement, *((gain, pair.y) if pair.x == name else (1 / gain, pair.x))


def _others(name: str, own: list[TurnPair], *, opposed: bool) -> str:
    """Whom it turns the same way as, or the other way than; empty for nobody."""
    met = [p for p in own if p.opposed == opposed]
    return " and ".join(p.x if p.y == name else p.y for p in met)


def _or_else(name: str, wrong_sign: tuple[str, ...]) -> str:
    return "".join(f", or that of {other} is" for other in wrong_sign if other != name)


def _odometry(
    name: str, own: list[TurnPair], unit: bool, wrong_sign: tuple[str, ...]
) -> Iterator[Finding]:
    if unit:
        _, gain, other = _told_best(name, own)
        read = f"{other} turns {gain:.3g} times what its yaw rate integrates to"
        if unit_ratio(gain) < 1.0:
            message, factor = f"{read}: it reads in deg/s, not in rad/s", 1 / DEG
        else:
            message, factor = f"{read}: it was turned into rad/s twice", DEG
        yield Finding("gyro unit", name, "warning", message, fixes.scale("wz", factor))
    elif name in wrong_sign and (others := _others(name, own, opposed=True)):
        or_else = _or_else(name, wrong_sign)
        message = f"turns the other way than {others}: the sign of its yaw rate is wrong{or_else}"
        yield Finding("yaw rate sign", name, "warning", message, fixes.scale("wz", -1))


def _gyro(
    imu: Sensor, own: list[TurnPair], unit: bool, wrong_sign: tuple[str, ...]
) -> Iterator[Finding]:
    is_wrong = unit or imu.name in wrong_sign
    telling = own if is_wrong else [p for p in own if not p.opposed]
    if not telling:
        return
    seen, gain, other = _told_best(imu.name, telling)
    read = f"{other} turns {gain:.3g} times what the gyro's z integrates to"
    if unit and unit_ratio(gain) < 1.0:
        message = f"{read}: it reads in deg/s, not in rad/s"
        yield Finding("gyro unit", imu.name, "warning", message, "gyro_unit: deg/s")
    elif unit:
        message = f"{read}: it was turned into rad/s twice"
        fix = fixes.scale("gx gy gz", DEG)
        yield Finding("gyro unit", imu.name, "warning", message, fix)
    elif is_wrong:
        or_else = _or_else(imu.name, wrong_sign)
        message = f"{read}, in the other direction: the sign of body z is wrong{or_else}"
        yield Finding("gyro sign", imu.name, "warning", message, _sign_fix(imu))
    else:
        message = f"{read}, correlation {abs(seen.correlation):.2f}"
        yield Finding("gyro unit", imu.name, "ok", message)


def _sign_fix(imu: Sensor) -> str:
    """All axes are turned where gravity says so too; else it is the gyro alone."""
    if z_is_up(imu):
        return fixes.mounting(np.diag([1.0, -1.0, -1.0]) @ imu.R_bs)
    return fixes.scale(("gx", "gy", "gz")[int(np.argmax(np.abs(imu.R_bs[2])))], -1)


def _compass(
    compass: Sensor, own: list[TurnPair], radians: str | None, wrong_sign: tuple[str, ...]
) -> Iterator[Finding]:
    name = compass.name
    alike, opposed = (_others(name, own, opposed=flag) for flag in (False, True))
    if radians is not None:
        message = f"the headings are in radians, not in degrees: {radians}"
        fix = fixes.scale("heading_deg", DEG)
        yield Finding("heading unit", name, "warning", message, fix)
    elif name in wrong_sign and opposed:
        or_else = _or_else(name, wrong_sign)
        message = f"turns the other way than {opposed}: the sign of the headings is wrong{or_else}"
        fix = f"{fixes.scale('heading_deg', -1)}, and rpy_deg: [0, 0, -90] if they count from east"
        yield Finding("heading sign", name, "warning", message, fix)
    elif alike and name not in wrong_sign:
        yield Finding("heading sign", name, "ok", f"turns the same way as {alike}")
