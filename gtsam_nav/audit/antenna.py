"""Where the antenna stands and how late its fixes are, by what turns do to them.

Within a window the way is reckoned from compass, gyro and velocities; what a fix is off by is then
the antenna's lever arm turning with the vehicle, and the way made during the clock's offset.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gtsam_nav.audit import fixes
from gtsam_nav.audit.agreement import LONGEST_LAG_S, Lag, agreement
from gtsam_nav.audit.courses import Velocity, way
from gtsam_nav.audit.findings import Finding
from gtsam_nav.audit.lagged_products import Signal
from gtsam_nav.audit.motion import turned
from gtsam_nav.audit.significance import quantile
from gtsam_nav.frames import Array
from gtsam_nav.mission import Sensor
from gtsam_nav.series import GnssSeries

WINDOWS_S = (40.0, 60.0)
"""Turns in short windows tell the clock, those in longer ones the lever arm."""
SMOOTHED_S = 60.0
FEWEST_WINDOWS, FEWEST_FIXES = 6, 12
OUTLIER_SIGMAS = 5.0
LONGEST_GAP_S = 10.0
REFINEMENTS = 4


@dataclass(frozen=True)
class AntennaFit:
    """What the fixes say of their antenna and clock.

    Attributes
    ----------
    velocity : str
        The sensor that the way is reckoned by.
    lever_b, sigma_lever : ndarray, shape (2,)
        Forward and to starboard of the body's origin, m.
    lag : Lag
        The fixes (y) against the reckoned way (x).
    n_windows : int
    formal : ndarray, shape (3,)
        Sigmas of lever arm and lag, were all errors white. They tell which of several fits is the
        best: the scatter between windows is itself too uncertain for that.
    """

    velocity: str
    lever_b: Array
    sigma_lever: Array
    lag: Lag
    n_windows: int
    formal: Array


def antenna_fit(gnss: Sensor, yaw: Signal, velocities: Sequence[Velocity]) -> AntennaFit | None:
    """Estimate lever arm and clock offset of a receiver.

    In each window place, scale and direction of the way are free; lever arm and offset are common
    to all. Their sigmas are those of the jackknife over
    windows, or those that white errors would have, whichever are larger.

    Parameters
    ----------
    gnss : Sensor
    yaw : Signal
        Heading of the body, unwrapped, as precise as may be from one moment to the next.
    velocities : sequence of Velocity
        Of which the best serves.

    Returns
    -------
    AntennaFit or None
        None with too few windows that hold enough fixes and velocities.
    """
    series = gnss.series
    assert isinstance(series, GnssSeries)
    found = []
    for velocity in velocities:
        path = _path(yaw, velocity)
        start_s = _coarse_lag_s(series, velocity.t, path[:, :2])
        fits = [_fit(series, velocity, path, start_s, window_s) for window_s in WINDOWS_S]
        found += [fit for fit in fits if fit is not None]
    if not found:
        return None
    lever = min(found, key=lambda fit: _limit(fit) * float(np.max(fit.formal[:2])))
    clock = min(found, key=lambda fit: _limit(fit) * float(fit.formal[2]))
    return replace(lever, velocity=clock.velocity, lag=clock.lag)


def _limit(fit: AntennaFit) -> float:
    return quantile(fit.n_windows - 1)


def _path(yaw: Signal, velocity: Velocity) -> Array:
    """Way and velocity along north and east, and heading, at the velocity's times, shape (n, 5)."""
    heading = np.interp(velocity.t, yaw.t, yaw.values)
    v_n = turned(velocity.v_b(), heading)
    return np.column_stack([way(velocity.t, v_n), v_n, heading])


def _fit(
    series: GnssSeries, velocity: Velocity, path: Array, start_s: float, window_s: float
) -> AntennaFit | None:
    """With windows of a length; the clock's offset is linearised anew where it was found."""
    lag_s, n_windows = start_s, 0
    for _ in range(REFINEMENTS):
        parts = list(_windows(series.shift(lag_s), velocity.t, path, window_s))
        n_windows = len(parts)
        if n_windows < FEWEST_WINDOWS:
            return None
        solved, sigma, formal = _jackknifed(_without_outliers(parts))
        change_s = float(np.clip(solved[2], -LONGEST_LAG_S, LONGEST_LAG_S))
        lag_s = float(np.clip(lag_s + change_s, start_s - LONGEST_LAG_S, start_s + LONGEST_LAG_S))
    step_s = float(np.median(np.diff(velocity.t)))
    # a few windows may agree by chance
    sigma = np.maximum(sigma, formal)
    lag = Lag(lag_s, float(sigma[2]), step_s, n_windows)
    return AntennaFit(velocity.name, solved[:2], sigma[:2], lag, n_windows, formal)


def _coarse_lag_s(series: GnssSeries, t: Array, way_n: Array) -> float:
    """What to add to the fixes' stamps by the way north and east; zero where it does not tell."""
    fixes_n = series.p_n[:, :2]
    told = [agreement(Signal(series.t, fixes_n[:, k]), Signal(t, way_n[:, k])) for k in range(2)]
    known = [a for a in told if a is not None]
    return min(known, key=lambda a: a.lag_sigma_s).lag_s if known else 0.0


def _windows(
    series: GnssSeries, t: Array, path: Array, window_s: float
) -> Iterator[tuple[Array, Array]]:
    """Equations of each window that holds enough fixes, and velocities without a gap."""
    for start in np.arange(t[0], t[-1] - window_s, window_s):
        fixes_in = series.crop(start, start + window_s)
        inside = t[(t >= start) & (t < start + window_s)]
        gaps_s = np.diff(inside, prepend=start, append=start + window_s)
        if len(fixes_in) >= FEWEST_FIXES and np.max(gaps_s) < LONGEST_GAP_S:
            at = np.stack([np.interp(fixes_in.t, t, column) for column in path.T], axis=1)
            yield _window(fixes_in, at[:, :2], at[:, 2:4], at[:, 4])


def _window(fixes_in: GnssSeries, way_n: Array, v_n: Array, heading: Array) -> tuple[Array, Array]:
    """Design (2 k, 3) of lever arm and offset, and the fixes (2 k,), less what is free."""
    moved_n = way_n - way_n[0]
    across_n = moved_n[:, [1, 0]] * [-1.0, 1.0]
    one = np.ones(len(way_n))
    free = np.stack(
        [np.column_stack([one, 0 * one]), np.column_stack([0 * one, one]), moved_n, across_n],
        axis=-1,
    )
    c, s = np.cos(heading), np.sin(heading)
    wanted = np.stack([np.column_stack([c, s]), np.column_stack([-s, c]), v_n], axis=-1)
    weight = np.repeat(1.0 / max(float(np.median(fixes_in.sigma[:, :2])), 1e-6), 2 * len(way_n))
    flat_free, flat = (a.reshape(2 * len(way_n), -1) for a in (free, wanted))
    fix = fixes_in.p_n[:, :2].reshape(-1)
    basis = np.linalg.qr(flat_free / np.maximum(np.linalg.norm(flat_free, axis=0), 1e-9))[0]

    def rest(columns: Array) -> Array:
        return np.asarray(columns - basis @ (basis.T @ columns))

    residual = rest(np.column_stack([flat, fix])) * weight[:, None]
    return residual[:, :-1], residual[:, -1]


def _without_outliers(parts: list[tuple[Array, Array]]) -> list[tuple[Array, Array]]:
    """The equations but those that a first solution leaves far off."""
    solved, *_ = _jackknifed(parts)
    left = [np.abs(b - A @ solved) for A, b in parts]
    limit = OUTLIER_SIGMAS * 1.4826 * float(np.median(np.concatenate(left)))
    return [(A[r <= limit], b[r <= limit]) for (A, b), r in zip(parts, left, strict=True)]


def _jackknifed(parts: list[tuple[Array, Array]]) -> tuple[Array, Array, Array]:
    """Least squares over all windows, its sigmas by leaving out one window at a time, and formal
    ones, were all errors white.

    What a few windows with turns decide is scattered by as much as these differ.
    """
    normal = np.array([A.T @ A for A, _ in parts])
    right = np.array([A.T @ b for A, b in parts])
    floor = 1e-12 * np.eye(right.shape[1]) * max(float(np.max(normal)), 1e-12)
    total, summed = normal.sum(axis=0) + floor, right.sum(axis=0)
    solved = np.linalg.solve(total, summed)
    without = np.linalg.solve(total - normal, (summed - right)[..., None])[..., 0]
    n = len(parts)
    sigma = np.sqrt((n - 1) / n * np.sum((without - without.mean(axis=0)) ** 2, axis=0))
    variance = np.mean(np.concatenate([b - A @ solved for A, b in parts]) ** 2)
    return solved, sigma, np.sqrt(variance * np.diag(np.linalg.inv(total)))


def lever_findings(gnss: Sensor, fit: AntennaFit) -> Iterator[Finding]:
    """Whether the fixes turn about the body as if a sign of the stated lever arm were wrong.

    A sign is wrong where the estimate rules out the stated arm and not the reversed one.
    """
    stated = gnss.xyz_b[:2]
    limit = quantile(fit.n_windows - 1) * fit.sigma_lever
    reversed_ = (np.abs(fit.lever_b - stated) > limit) & (np.abs(fit.lever_b + stated) < limit)
    reversed_ &= fit.lever_b * stated < 0
    read = (
        f"the fixes turn about the vehicle as if the antenna were {fit.lever_b[0]:+.2f} m ahead "
        f"and {fit.lever_b[1]:+.2f} m to starboard (sigma {fit.sigma_lever[0]:.2f} and "
        f"{fit.sigma_lever[1]:.2f} m); stated are {stated[0]:+.2f} and {stated[1]:+.2f} m"
    )
    if np.any(reversed_):
        axes = " and ".join(np.array(["x", "y"])[reversed_])
        mended = gnss.xyz_b * np.append(np.where(reversed_, -1.0, 1.0), 1.0)
        message = f"{read}: the sign of {axes} is wrong"
        yield Finding("lever arm", gnss.name, "warning", message, fixes.position(mended))
    else:
        yield Finding("lever arm", gnss.name, "ok", read)


def steady_yaw(compass: Signal, gyro: Signal | None) -> Signal:
    """The compass's heading from window to window, the gyro's turns within: unwrapped, rad.

    A complementary filter without delay: the compass less the gyro, smoothed over `SMOOTHED_S`,
    added to the gyro.
    """
    if gyro is None:
        return compass
    difference = compass.values - np.interp(compass.t, gyro.t, gyro.values)
    half = max(int(0.5 * SMOOTHED_S / max(float(np.median(np.diff(compass.t))), 1e-3)), 1)
    # means over a window that is cut short at the ends, about its own line
    total = np.concatenate([[0.0], np.cumsum(difference)])
    k = np.arange(len(difference))
    reach = np.minimum(half, np.minimum(k, len(k) - 1 - k))
    smooth = (total[k + reach + 1] - total[k - reach]) / (2 * reach + 1)
    return replace(compass, values=smooth + np.interp(compass.t, gyro.t, gyro.values))
