"""Messages that are sent again under a new stamp, or for ever."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from gtsam_nav.audit.findings import Finding
from gtsam_nav.audit.lagged_products import Signal
from gtsam_nav.audit.significance import FALSE_ALARM
from gtsam_nav.frames import Array
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.preprocess.repeats import measured_columns, repeats_of
from gtsam_nav.series import ImuSeries

RESOLVED_STEPS = 10
"""A column whose usual change is fewer steps of its resolution repeats by itself."""
FEWEST_EQUAL = 20
"""So many samples that measure anything at all are not equal to the last digit."""
ARITHMETIC = 1e-3
"""What the arithmetic of units adds to a change, as a share of their root mean square, at most."""
LONG_S, CLEAR_TURN_DEG = 10.0, 10.0
"""A heading that is held for so long, while the vehicle swings by so much, is no measurement."""
FEW_HELD = 0.1
"""A smaller share of held readings of an IMU costs no more than the gaps that they would leave."""


def stuck_findings(mission: Mission) -> Iterator[Finding]:
    """Sensors whose samples are all the same."""
    for sensor in mission.sensors.values():
        again = None if sensor.type == "reference" else repeats_of(sensor.series)
        if again is not None and len(again) >= FEWEST_EQUAL and np.all(again[1:]):
            message = f"all {len(again)} samples are equal to the last digit: it measures nothing"
            yield Finding("stuck", sensor.name, "warning", message)


def frozen_findings(compass: Sensor, turns: Mapping[str, Signal]) -> Iterator[Finding]:
    """Whether a compass repeats one heading for long while others see the vehicle turn.

    Parameters
    ----------
    compass : Sensor
    turns : mapping of str to Signal
        The yaw by others, but for a constant and a drift, rad.
    """
    again = repeats_of(compass.series)
    if again is None or not np.any(again):
        return
    # where each run of equal samples begins and ends
    edges = np.flatnonzero(np.diff(np.concatenate([[False], again, [False]]).astype(int)))
    first, last = edges[::2] - 1, edges[1::2] - 1
    k = int(np.argmax(last - first))
    begin_s, end_s = compass.series.t[[first[k], last[k]]].tolist()
    if end_s - begin_s < LONG_S or last[k] - first[k] < FEWEST_EQUAL:
        return
    for name, yaw in turns.items():
        turned = np.degrees(_turned_within(yaw, begin_s, end_s))
        if turned > CLEAR_TURN_DEG:
            message = (
                f"equal to the last digit from {begin_s:.1f} to {end_s:.1f} s, while by {name} the "
                f"vehicle turns to and fro by {turned:.0f} deg: it is frozen"
            )
            yield Finding("stuck", compass.name, "warning", message, "drop_repeats: true")
            return


def _turned_within(yaw: Signal, begin_s: float, end_s: float) -> float:
    """Range of a yaw over a time, rad, apart from a steady turn: that may be a drift."""
    inside = (yaw.t >= begin_s) & (yaw.t <= end_s)
    if np.count_nonzero(inside) < 3:
        return 0.0
    t, values = yaw.t[inside] - begin_s, yaw.values[inside]
    return float(np.ptp(values - np.polyval(np.polyfit(t, values, 1), t)))


def repeat_findings(sensor: Sensor) -> Iterator[Finding]:
    """Whether a sensor's samples equal the one before more often than its resolution explains.

    A run of them counts once: at rest a filter may well hold its output.
    """
    again = repeats_of(sensor.series)
    if again is None or len(again) < 2:
        return
    share = _explained_share(measured_columns(sensor.series))
    if share is None:
        return
    n, runs = len(again) - 1, int(np.sum(again[1:] & ~again[:-1]))
    if not runs or not _exceeds(runs, n, share):
        return
    message = (
        f"{int(np.sum(again))} of {n + 1} samples, in {runs} places, repeat the one before to the "
        f"last digit, where the resolution explains {share * n:.0f} places: old messages under new "
        f"stamps"
    )
    if isinstance(sensor.series, ImuSeries) and np.mean(again) < FEW_HELD:
        kept = f"{message}; few enough to keep, for a rate that is integrated must not pause"
        yield Finding("stale messages", sensor.name, "ok", kept)
        return
    yield Finding("stale messages", sensor.name, "warning", message, "drop_repeats: true")


def _exceeds(count: int, n: int, share: float) -> bool:
    """Whether a share explains a count out of n only in `FALSE_ALARM` of cases."""
    from scipy.stats import binom

    return bool(binom.sf(count - 1, n, share) < FALSE_ALARM)


def _explained_share(columns: list[Array]) -> float | None:
    """Probability that two samples are equal by chance, by the column that resolves best.

    No change is likelier than the commonest one: with a resolution that is much finer than the
    noise, the smallest changes are as frequent as none. None where no column resolves its own
    changes, and so nothing can be told.
    """
    shares = []
    for column in columns:
        change = np.diff(column)
        moved = change[change != 0]
        if not len(moved):
            continue
        steps = np.round(moved / (ARITHMETIC * np.sqrt(np.mean(moved**2))))
        values, counts = np.unique(steps[steps != 0], return_counts=True)
        if len(values) and np.min(np.abs(values)) * RESOLVED_STEPS * ARITHMETIC < 1.0:
            # one more than was seen: a share of zero would make any repeat significant
            shares.append((int(np.max(counts)) + 1) / len(change))
    return min(shares) if shares else None
