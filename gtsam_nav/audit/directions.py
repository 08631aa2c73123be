"""Which way DVL and odometry say the vehicle goes: exchanged axes, wrong signs, misalignment.

A DVL, odometry, the bow and the track that compass and fixes draw are compared two by two; whoever
contradicts all others is at fault. The bow only bears witness: a vehicle may drift, but then its
other sensors agree.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, permutations, product

import numpy as np

from gtsam_nav.audit import fixes
from gtsam_nav.audit.blame import Pair, suspects
from gtsam_nav.audit.courses import BOW, Baselines, Velocity
from gtsam_nav.audit.findings import Finding
from gtsam_nav.audit.heading import circular_median_and_spread
from gtsam_nav.audit.significance import decided, limit, losses, tied
from gtsam_nav.frames import Array, wrap_angle
from gtsam_nav.series import BoolArray

TRACK = "compass and fixes"
BLOCK_S = 10.0
MOVING_SIGMAS = 5.0
"""Mean velocity over a block, in its own sigmas, from which its direction counts."""
QUARTERS = 0.5 * np.pi * np.arange(4)


def _axes() -> Iterator[tuple[str, str, Array]]:
    """Ways to read the first two columns: what is odd, what mends it, and the matrix (3, 3)."""
    for order in permutations((0, 1)):
        for signs in product((1.0, -1.0), repeat=2):
            wrong = [f"v{'xy'[k]} reversed" for k in (0, 1) if signs[k] < 0]
            lines = [fixes.columns({"vx": "vy", "vy": "vx"})] if order == (1, 0) else []
            exchanged = ["vx and vy exchanged"] * len(lines)
            if wrong:
                reversed_ = " ".join(f"v{'xy'[k]}" for k in (0, 1) if signs[k] < 0)
                lines.append(fixes.scale(reversed_, -1))
            matrix = np.eye(3)
            matrix[:2, :2] = np.diag(signs) @ np.eye(2)[list(order)]
            yield " and ".join([*exchanged, *wrong]), ", ".join(lines), matrix


AXES = tuple(_axes())
"""The stated reading first."""


@dataclass(frozen=True)
class DirectionPair:
    """Direction of one source less that of another, rad, block by block.

    ``stated_deg`` is the spread of a constant difference that the cards allow.
    """

    a: str
    b: str
    errors: Array
    stated_deg: float

    @property
    def pair(self) -> Pair:
        """Their names."""
        return self.a, self.b

    @property
    def quarter(self) -> int | None:
        """How many quarter turns they are apart; None where the data do not tell."""
        return decided(losses(wrap_angle(self.errors[None, :] - QUARTERS[:, None])))

    @property
    def offset_deg(self) -> float:
        """Median."""
        return float(np.degrees(circular_median_and_spread(self.errors)[0]))

    @property
    def limit_deg(self) -> float:
        """The largest offset that noise and the cards explain."""
        spread_deg = float(np.degrees(circular_median_and_spread(self.errors)[1]))
        noise_deg = 1.2533 * spread_deg / np.sqrt(len(self.errors))
        return limit(noise_deg, len(self.errors) - 1, self.stated_deg)


def direction_pairs(
    sources: Sequence[Velocity], ways: Baselines | None, stated_deg: dict[str, float]
) -> tuple[DirectionPair, ...]:
    """Each two sources of velocity, and each with the track.

    Parameters
    ----------
    sources : sequence of Velocity
    ways : Baselines or None
    stated_deg : dict
        Spread of each source's constant error by its card, `TRACK` among them.
    """
    found = []
    for a, b in combinations(sources, 2):
        errors = _differences(a, b)
        found.append((a.name, b.name, errors))
    if ways is not None:
        heading = np.unwrap(ways.compass.heading)
        for source in sources:
            errors = ways.direction_errors(heading, source)[ways.covered(source)]
            found.append((source.name, TRACK, errors))
    return tuple(
        DirectionPair(a, b, errors, float(np.hypot(stated_deg[a], stated_deg[b])))
        for a, b, errors in found
        if len(errors) > 2
    )


def _differences(a: Velocity, b: Velocity) -> Array:
    """Direction of a less that of b in each block in which both are clear."""
    angle_a, angle_b = (np.arctan2(mean[:, 1], mean[:, 0]) for mean in clear_means(a, b))
    return wrap_angle(angle_a - angle_b)


def clear_means(a: Velocity, b: Velocity) -> tuple[Array, Array]:
    """Mean velocities (k, 2) of both over the blocks in which both stand out of their noise."""
    begin, end = max(a.t[0], b.t[0]), min(a.t[-1], b.t[-1])
    edges = np.arange(begin, end, BLOCK_S)
    if len(edges) < 2:
        return np.empty((0, 2)), np.empty((0, 2))
    (mean_a, clear_a), (mean_b, clear_b) = (_block_means(v, edges) for v in (a, b))
    clear = clear_a & clear_b
    return mean_a[clear], mean_b[clear]


def _block_means(velocity: Velocity, edges: Array) -> tuple[Array, BoolArray]:
    """Mean velocity (k, 2) of each block, and whether it stands out of its noise."""
    n_blocks = len(edges) - 1
    if velocity.name == BOW:
        return np.tile([1.0, 0.0], (n_blocks, 1)), np.ones(n_blocks, dtype=bool)
    block = np.searchsorted(edges, velocity.t, side="right") - 1
    inside = (block >= 0) & (block < n_blocks)
    block, v_b = block[inside], velocity.v_b()[inside]
    count = np.maximum(np.bincount(block, minlength=n_blocks), 1)[:, None]

    def mean(values: Array) -> Array:
        sums = [np.bincount(block, column, n_blocks) for column in values.T]
        return np.asarray(np.stack(sums, axis=1) / count)

    average = mean(v_b)
    sigma = np.sqrt(np.sum(mean((v_b - average[block]) ** 2) / count, axis=1))
    clear = (np.hypot(*average.T) > MOVING_SIGMAS * sigma) & (count[:, 0] > 2)
    return average, np.asarray(clear)


@dataclass(frozen=True)
class DirectionBlame:
    """Who goes the wrong way, by quarter turns and by less; None who are not suspected."""

    quarters: tuple[str, ...]
    offsets: tuple[str, ...]


def direction_blame(pairs: Sequence[DirectionPair]) -> DirectionBlame:
    """Who contradicts all others, in what quarter they go and by how many degrees."""
    told = [(p.pair, p.quarter) for p in pairs]
    turned = [pair for pair, quarter in told if quarter]
    quarters = _blamed(turned, [pair for pair, quarter in told if quarter == 0])
    off = [p.pair for p in pairs if abs(p.offset_deg) > p.limit_deg]
    right = [p.pair for p in pairs if abs(p.offset_deg) <= p.limit_deg]
    return DirectionBlame(quarters, () if quarters else _blamed(off, right))


def _blamed(discordant: list[Pair], concordant: list[Pair]) -> tuple[str, ...]:
    """Nobody where all that contradict the bow have no other witness: the vehicle may drift."""
    if all(BOW in pair for pair in discordant):
        return ()
    return suspects(discordant, concordant)


def direction_findings(
    sources: Sequence[Velocity],
    ways: Baselines | None,
    pairs: Sequence[DirectionPair],
    blame: DirectionBlame,
    heave: Mapping[str, str],
    untold: Collection[str],
) -> Iterator[Finding]:
    """Judge axes and alignment of each source of velocity but the bow.

    Parameters
    ----------
    sources : sequence of Velocity
    ways : Baselines or None
    pairs : sequence of DirectionPair
    blame : DirectionBlame
    heave : mapping of str to str
        Who goes up where others go down, and how that was read.
    untold : collection of str
        Whose z nothing tells.
    """
    for source in sources:
        own = [p for p in pairs if source.name in p.pair and BOW not in p.pair] or [
            p for p in pairs if source.name in p.pair
        ]
        if source.name == BOW or not own:
            continue
        pair = next((p for p in own if p.b == TRACK), own[0])
        other = pair.b if pair.a == source.name else pair.a
        sign = 1.0 if pair.a == source.name else -1.0
        read = f"goes {sign * pair.offset_deg:+.1f} deg clockwise of {other}"
        or_else = _or_else(source.name, blame.quarters)
        if source.name in heave:
            read = f"{read}, and {heave[source.name]}"
            yield _upside_down(source, ways, pair, read, source.name in blame.quarters, or_else)
        elif source.name in blame.quarters:
            z_is_told = source.name not in untold
            yield _wrong_axes(source, ways, pair, read, or_else, z_is_told=z_is_told)
        elif source.name in blame.offsets and abs(pair.offset_deg) > pair.limit_deg:
            explained = f"noise and the stated spreads explain {pair.limit_deg:.1f} deg"
            message = f"{read}; {explained}{_or_else(source.name, blame.offsets)}"
            fix = fixes.turned_mounting(-np.radians(sign * pair.offset_deg), source.R_bs)
            yield Finding("velocity alignment", source.name, "warning", message, fix)
        else:
            yield Finding("velocity alignment", source.name, "ok", read)


def _or_else(name: str, suspected: tuple[str, ...]) -> str:
    others = [other for other in suspected if other not in (name, BOW)]
    return f", unless {' or '.join(others)} are wrong" if others else ""


def _wrong_axes(
    source: Velocity,
    ways: Baselines | None,
    pair: DirectionPair,
    read: str,
    or_else: str,
    *,
    z_is_told: bool,
) -> Finding:
    """What the columns of a sensor that goes in the wrong quarter may be."""
    choices = [k for k in _likely_axes(source, ways, pair) if k]
    told = [AXES[k][:2] for k in choices]
    if not z_is_told:
        told += [_on_its_back(source, k) for k in choices if _is_reflection(k)]
    return _axes_finding(source, read, told, or_else)


def _upside_down(
    source: Velocity,
    ways: Baselines | None,
    pair: DirectionPair,
    read: str,
    wrong_quarter: bool,
    or_else: str,
) -> Finding:
    """Of a sensor whose z is reversed: one turn of the instrument, or columns by themselves.

    A reflection of the horizontal axes makes of a reversed z an instrument that lies on its back.
    """
    choices = [k for k in _likely_axes(source, ways, pair) if k or not wrong_quarter]
    told = [_on_its_back(source, k) for k in choices if _is_reflection(k)]
    if not (wrong_quarter and told):
        told = [_columns(k) for k in choices if not _is_reflection(k)] + told
    return _axes_finding(source, read, told, or_else)


def _axes_finding(
    source: Velocity, read: str, told: Sequence[tuple[str, str]], or_else: str
) -> Finding:
    """With several things that may be odd, and what mends each."""
    # one that agrees on the whole, and turns away for a while, has no wrong columns
    names = ", or ".join(dict.fromkeys(name for name, _ in told)) or "now and then"
    mends = ", or ".join(line for _, line in told)
    return Finding("velocity axes", source.name, "warning", f"{read}: {names}{or_else}", mends)


def _is_reflection(k: int) -> bool:
    return bool(np.linalg.det(AXES[k][2]) < 0)


def _on_its_back(source: Velocity, k: int) -> tuple[str, str]:
    """What is odd, and what mends it, where z is reversed with a reflection of the other two."""
    R_bs = source.R_bs @ AXES[k][2] @ np.diag([1.0, 1.0, -1.0])
    return "mounted upside down", fixes.mounting(R_bs)


def _columns(k: int) -> tuple[str, str]:
    """What is odd, and what mends it, where z is reversed beside a reading of the others."""
    name, line, _ = AXES[k]
    return " and ".join(filter(None, (name, "vz reversed"))), ", ".join(
        filter(None, (line, fixes.scale("vz", -1)))
    )


def _likely_axes(source: Velocity, ways: Baselines | None, pair: DirectionPair) -> list[int]:
    """The readings of the axes that the data cannot tell from the best one."""
    if ways is not None and pair.b == TRACK:
        heading = np.unwrap(ways.compass.heading)
        covered = ways.covered(source)
        errors = np.array(
            [ways.direction_errors(heading, source, axes)[covered] for *_, axes in AXES]
        )
    else:
        mean_s = np.mean(source.v_s, axis=0)
        read_as = np.array([(source.R_bs @ axes @ mean_s)[:2] for *_, axes in AXES])
        turn = np.arctan2(read_as[:, 1], read_as[:, 0])
        sign = 1.0 if pair.a == source.name else -1.0
        errors = wrap_angle(sign * pair.errors + (turn - turn[0])[:, None])
    loss = losses(errors)
    return tied(loss, int(np.argmin(loss.mean(axis=1))))
