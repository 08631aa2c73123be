"""Whether the map that a scanning sonar draws is one: the sign of the head angle, and its zero.

Sweeps are laid over each other as the vehicle moved in between. A turn in between shows whether the
head's angle has the right sign; a way in between shows where its zero is, since sweeps that are all
turned about the vehicle are drawn out along its way.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from gtsam_nav.audit import fixes
from gtsam_nav.audit.courses import Velocity, way
from gtsam_nav.audit.findings import Finding
from gtsam_nav.audit.motion import turned
from gtsam_nav.audit.significance import prefers
from gtsam_nav.frames import Array, rotation_from_rpy, wrap_angle
from gtsam_nav.mission import Sensor
from gtsam_nav.series import BeamSeries, HeadingSeries, IntArray
from gtsam_nav.sonar.echoes import beam_bearings

RING_DOWN_M = 2.0
CELL_M = 1.0
TURNED_RAD, MOVED_M = np.radians(15.0), 3.0
"""Least turn or way between two sweeps that are compared."""
APART = (1, 2, 3)
"""How many sweeps they are apart."""
MOST_PAIRS, FEWEST_PAIRS = 100, 8
STEP_RAD = np.radians(10.0)
NEIGHBOURS = np.array([(north, east) for north in (-1, 0, 1) for east in (-1, 0, 1)])
OFFSETS = STEP_RAD * np.arange(36)

Reading = tuple[float, float]
"""Sign of the head's angle and turn of its zero, rad; (1, 0) is the stated reading."""


class Drawn(Protocol):
    """Pictures of the surroundings, (k, 2) pairs of which the vehicle's motion parts."""

    @property
    def pairs(self) -> IntArray: ...

    def likeness(self, reading: Reading) -> Array:
        """Share of echoes of each pair that fall upon those of the other picture, shape (k,)."""
        ...


@dataclass(frozen=True)
class Sweeps:
    """What successive sweeps saw: strongest echoes, and where the head was, beam by beam.

    Attributes
    ----------
    angle, range_m, yaw : ndarray, shape (s, b)
    head_n : ndarray, shape (s, b, 2)
        Way of the sonar's head.
    heard : ndarray of bool, shape (s, b)
    pairs : ndarray of int, shape (k, 2)
        Sweeps between which the vehicle moved.
    """

    sonar: Sensor
    angle: Array
    range_m: Array
    yaw: Array
    head_n: Array
    heard: Array
    pairs: IntArray

    def likeness(self, reading: Reading) -> Array:
        """Share of echoes of each pair that fall upon those of the other sweep, shape (k,)."""
        sign, offset = reading
        bearing = self.yaw + beam_bearings(self.sonar, sign * self.angle) + offset
        points_n = self.head_n + self.range_m[..., None] * np.stack(
            [np.cos(bearing), np.sin(bearing)], axis=-1
        )
        cells = np.floor(points_n / CELL_M).astype(np.int64)
        seen = [own[heard] for own, heard in zip(cells, self.heard, strict=True)]
        return np.array([overlap(seen[a], seen[b]) for a, b in self.pairs])


def overlap(one: IntArray, other: IntArray) -> float:
    """Of the cells (k, 2) of two pictures, the share of either one's next to the other's."""
    if not (len(one) and len(other)):
        return 0.0
    return 0.5 * (_share(one, other) + _share(other, one))


def _share(cells: IntArray, of: IntArray) -> float:
    """Of cells (k, 2), those that are others or next to them."""
    known = np.sort(_number(of))
    wanted = _number(cells)[:, None] + _number(NEIGHBOURS)
    at = np.minimum(np.searchsorted(known, wanted), len(known) - 1)
    return float(np.mean(np.any(known[at] == wanted, axis=1)))


def _number(cells: IntArray) -> IntArray:
    """One whole number for each cell."""
    return np.asarray(cells[:, 0] * 2**32 + cells[:, 1])


@dataclass(frozen=True)
class MapLikeness:
    """How well pictures agree as stated, mirrored, and in the best reading of the head's angle.

    ``better`` says that the best reading is significantly better than the stated one, ``settled``
    that the stated one is than the mirrored.
    """

    stated: float
    mirrored: float
    best: float
    reading: Reading
    better: bool
    settled: bool
    n_pairs: int

    def read(self, pictures: str) -> str:
        """How well they agree, in words."""
        return (
            f"{pictures} between which the vehicle moved agree by {self.stated:.2f}, mirrored by "
            f"{self.mirrored:.2f} ({self.n_pairs} pairs)"
        )


def unless(suspected: Sequence[str]) -> str:
    """Who else pictures' disagreement may be due to, in words."""
    return f", unless {' or '.join(suspected)} is wrong" if suspected else ""


def sweeps_of(
    sonar: Sensor, compass: HeadingSeries, velocity: Velocity | None, beams_per_sweep: int
) -> Sweeps | None:
    """Cut a sonar's beams into sweeps; None where too few of them see the vehicle move."""
    series = sonar.series
    assert isinstance(series, BeamSeries)
    n = len(series) // beams_per_sweep
    if n < 2:
        return None
    yaw = np.interp(series.t, compass.t, np.unwrap(compass.heading))
    head_n = turned(np.tile(sonar.xyz_b[:2], (len(yaw), 1)), yaw)
    if velocity is not None:
        v_b = np.stack([np.interp(series.t, velocity.t, v) for v in velocity.v_b().T], axis=1)
        head_n = head_n + way(series.t, turned(v_b, yaw))
    blind = min(int(RING_DOWN_M / series.resolution_m), series.intensity.shape[1] - 1)
    strongest = blind + np.argmax(series.intensity[:, blind:], axis=1)
    heard = series.intensity[np.arange(len(series)), strongest] > 0

    def rows(values: Array) -> Array:
        return np.asarray(
            values[: n * beams_per_sweep].reshape(n, beams_per_sweep, *values.shape[1:])
        )

    yaws, heads_n = rows(yaw), rows(head_n)
    middle = beams_per_sweep // 2
    pairs = _pairs(yaws[:, middle], heads_n[:, middle])
    if len(pairs) < FEWEST_PAIRS:
        return None
    range_m = rows((strongest + 0.5) * series.resolution_m)
    return Sweeps(sonar, rows(series.angle), range_m, yaws, heads_n, rows(heard), pairs)


def _pairs(yaw: Array, head_n: Array) -> IntArray:
    """Sweeps a few apart between which the vehicle moved, no more of them than needed."""
    n = len(yaw)
    pairs = np.array([(k, k + a) for k in range(n) for a in APART if k + a < n]).reshape(-1, 2)
    first, last = pairs.T
    moved = np.hypot(*(head_n[last] - head_n[first]).T) > MOVED_M
    told = pairs[moved | (np.abs(wrap_angle(yaw[last] - yaw[first])) > TURNED_RAD)]
    return np.asarray(told[:: max(1, -(-len(told) // MOST_PAIRS))])


def map_likeness(drawn: Drawn, knows_way: bool) -> MapLikeness:
    """Compare readings of the angle; all of them only where the nearest do not settle it.

    Parameters
    ----------
    drawn : Drawn
    knows_way : bool
        Without the vehicle's way only the sign can be told, and its zero not.
    """
    stated, mirrored = drawn.likeness((1.0, 0.0)), drawn.likeness((-1.0, 0.0))
    found = {(1.0, 0.0): stated, (-1.0, 0.0): mirrored}
    if knows_way:
        near = [(1.0, float(OFFSETS[2])), (1.0, float(OFFSETS[-2]))]
        found |= {reading: drawn.likeness(reading) for reading in near}
        if not all(_settled(stated, found[reading]) for reading in (*near, (-1.0, 0.0))):
            readings = [(sign, float(o)) for sign in (1.0, -1.0) for o in OFFSETS]
            found |= {r: drawn.likeness(r) for r in readings if r not in found}
    winner = max(found, key=lambda r: float(np.mean(found[r])))
    unturned = (winner[0], 0.0)
    if not prefers(-found[unturned], -found[winner]):
        winner = unturned
    questions = 2 * len(OFFSETS) if knows_way else 1
    return MapLikeness(
        stated=float(np.mean(stated)),
        mirrored=float(np.mean(mirrored)),
        best=float(np.mean(found[winner])),
        reading=winner if winner == unturned else (winner[0], _refined(winner, found)),
        better=prefers(-stated, -found[winner], questions),
        settled=_settled(stated, mirrored),
        n_pairs=len(drawn.pairs),
    )


def _settled(stated: Array, other: Array) -> bool:
    return prefers(-other, -stated)


def _refined(reading: Reading, found: dict[Reading, Array]) -> float:
    """The offset of the best likeness, by a parabola through the neighbours."""
    sign, offset = reading
    k = int(np.argmin(np.abs(OFFSETS - offset)))
    around = [(sign, float(OFFSETS[(k + step) % len(OFFSETS)])) for step in (-1, 0, 1)]
    if not all(r in found for r in around):
        return offset
    before, here, after = (float(np.mean(found[r])) for r in around)
    bend = before - 2 * here + after
    return float(wrap_angle(offset + (STEP_RAD * 0.5 * (before - after) / bend if bend < 0 else 0)))


def map_findings(sonar: Sensor, like: MapLikeness, suspected: Sequence[str]) -> Iterator[Finding]:
    """Judge sign and zero of the head's angle.

    ``suspected`` names who else the sweeps' disagreement may be due to.
    """
    sign, offset = like.reading
    read = like.read("sweeps")
    if not like.better:
        if like.settled:
            yield Finding("sonar handedness", sonar.name, "ok", read)
        return
    turn = f"by {like.best:.2f} with the head's zero turned by {np.degrees(offset):+.0f} deg"
    R_bs = rotation_from_rpy([0.0, 0.0, offset]) @ sonar.R_bs
    or_else = unless(suspected)
    if sign < 0:
        fix = fixes.mounting(R_bs @ np.diag([1.0, -1.0, -1.0]))
        read += f", {turn}" if offset else ""
        message = f"{read}: the head angle counts counter-clockwise{or_else}"
        yield Finding("sonar handedness", sonar.name, "warning", message, fix)
    else:
        message = f"{read}, {turn}{or_else}"
        yield Finding("sonar head offset", sonar.name, "warning", message, fixes.mounting(R_bs))
