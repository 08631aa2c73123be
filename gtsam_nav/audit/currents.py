"""Speeds through the water that are given as speeds over ground.

By compass and velocities the vehicle goes one way, by its fixes another. A sensor that reads the
water differs from the fixes by the same vector however the vehicle heads; a compass or a mounting
that is off, by the same angle; one with deviation, by an angle that goes with the heading. As many
figures describe a current and a deviation, so that the better fit decides.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from gtsam_nav.audit.courses import BOW, Baselines, Velocity
from gtsam_nav.audit.findings import Finding
from gtsam_nav.audit.significance import FALSE_ALARM, losses, prefers
from gtsam_nav.frames import Array
from gtsam_nav.mission import Mission
from gtsam_nav.series import IntArray

FEWEST = 8
BLOCK_S = 30.0
"""Baselines are joined to stretches of so long: over less the fixes' noise hides a current."""
TOLERATED_M_S = 0.1
"""A smaller vector does little harm ..."""
TOLERATED_SHARE = 0.1
"""... as does one that is small beside the speed."""
WRONG_CAUSE = 0.01
"""Probability that noise makes a current of a deviation; that one of both is there is surer."""
REWEIGHTINGS = 10


@dataclass(frozen=True)
class Current:
    """The constant vector by which a sensor's way differs from that of the fixes.

    Attributes
    ----------
    sensor, gnss : str
    v_n : ndarray, shape (2,)
        The fixes' less the sensor's, m/s.
    speed_m_s : float
        Of the vehicle by the fixes, median.
    n_stretches : int
    is_clear : bool
        Whether it is beyond what scatter explains, and explains more than a deviation.
    """

    sensor: str
    gnss: str
    v_n: Array
    speed_m_s: float
    n_stretches: int
    is_clear: bool

    @property
    def misleads(self) -> bool:
        """Whether the sensor cannot be taken for one that reads the ground."""
        least = max(TOLERATED_M_S, TOLERATED_SHARE * self.speed_m_s)
        return self.is_clear and float(np.hypot(*self.v_n)) > least


def currents(sources: Sequence[Velocity], ways: Baselines | None) -> tuple[Current, ...]:
    """Of each sensor that covers enough baselines.

    Parameters
    ----------
    sources : sequence of Velocity
    ways : Baselines or None
    """
    if ways is None:
        return ()
    found = (_current(source, ways) for source in sources if source.name != BOW)
    return tuple(current for current in found if current is not None)


def _current(velocity: Velocity, ways: Baselines) -> Current | None:
    from scipy.stats import f

    covered = ways.covered(velocity)
    t = ways.fixes.t
    duration_s = (t[ways.stop] - t[ways.start])[covered]
    block = _blocks(ways.start[covered], ways.stop[covered], duration_s)
    n = len(np.unique(block))
    if n < FEWEST:
        return None
    heading = np.unwrap(ways.compass.heading)
    lasts_s = np.bincount(block, duration_s)
    seen, reckoned = (
        np.column_stack([np.bincount(block, axis) / lasts_s for axis in way[covered].T])
        for way in (ways.seen(heading), ways.reckoned(heading, velocity))
    )
    across = np.stack([-reckoned[:, 1], reckoned[:, 0]], axis=1)
    course = np.arctan2(reckoned[:, 1], reckoned[:, 0])[:, None]
    turn_and_scale = np.stack([reckoned, across], axis=2)
    deviation = np.stack([across * np.cos(course), across * np.sin(course)], axis=2)
    still = np.broadcast_to(np.eye(2), (n, 2, 2))
    _, _, by_deviation = _fit(np.concatenate([turn_and_scale, deviation], axis=2), seen)
    solution, covariance, left = _fit(np.concatenate([turn_and_scale, still], axis=2), seen)
    turning, drifting = losses(np.array([by_deviation, left]))
    v_n = solution[2:]
    squared = float(v_n @ np.linalg.pinv(covariance[2:, 2:]) @ v_n) / 2.0
    is_beyond_scatter = bool(squared > f.isf(FALSE_ALARM, 2, 2 * n - 4))
    return Current(
        sensor=velocity.name,
        gnss=ways.gnss.name,
        v_n=v_n,
        speed_m_s=float(np.median(np.hypot(*seen.T))),
        n_stretches=n,
        is_clear=is_beyond_scatter and prefers(turning, drifting, false_alarm=WRONG_CAUSE),
    )


def _blocks(start: IntArray, stop: IntArray, duration_s: Array) -> IntArray:
    """Numbers of the stretches that baselines (n,) are joined to: of `BLOCK_S`, without a gap; of
    one baseline each where there would be too few."""
    numbers, number, lasts_s = np.zeros(len(start), dtype=np.int64), 0, 0.0
    for k in range(1, len(start)):
        lasts_s += duration_s[k - 1]
        if lasts_s >= BLOCK_S or start[k] != stop[k - 1]:
            number, lasts_s = number + 1, 0.0
        numbers[k] = number
    return numbers if number + 1 >= FEWEST else np.arange(len(start))


def _fit(A: Array, b: Array) -> tuple[Array, Array, Array]:
    """Least squares that outlying blocks do not bend: Cauchy's weights on the median's scale.

    Parameters
    ----------
    A : ndarray, shape (n, 2, m)
    b : ndarray, shape (n, 2)

    Returns
    -------
    solution : ndarray, shape (m,)
    covariance : ndarray, shape (m, m)
    left : ndarray, shape (n,)
        Length of each block's residual.
    """
    weight = np.ones(len(b))
    for _ in range(REWEIGHTINGS):
        normal = np.einsum("n,nij,nik->jk", weight, A, A)
        inverse = np.linalg.pinv(normal)
        solution = inverse @ np.einsum("n,nij,ni->j", weight, A, b)
        left = np.hypot(*(b - A @ solution).T)
        weight = 1.0 / (1.0 + (left / max(float(np.median(left)), 1e-9)) ** 2)
    variance = float(np.sum(weight * left**2)) / max(2 * len(b) - A.shape[2], 1)
    return solution, variance * inverse, left


def current_findings(mission: Mission, found: Sequence[Current]) -> Iterator[Finding]:
    """Judge the comparison."""
    for current in found:
        if not current.misleads:
            continue
        north, east = current.v_n
        towards_deg = float(np.degrees(np.arctan2(east, north))) % 360.0
        message = (
            f"by the fixes of {current.gnss} the vehicle also drifts {np.hypot(north, east):.2g} "
            f"m/s towards {towards_deg:.0f} deg, however it heads, over {current.n_stretches} "
            f"stretches: {current.sensor} reads the water and is taken to read the ground, so that "
            "the current becomes an error of the compass"
        )
        is_dvl = mission.sensors[current.sensor].type == "dvl"
        fix = "through_water: true" if is_dvl else "type: dvl, through_water: true"
        yield Finding("speed through water", current.sensor, "warning", message, fix)
