"""Whose clock is off against the others'."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from gtsam_nav.audit import fixes
from gtsam_nav.audit.agreement import Lag
from gtsam_nav.audit.blame import Pair, suspects
from gtsam_nav.audit.findings import Finding
from gtsam_nav.audit.significance import limit

VAGUE_S = 1.0
"""Clocks that could be further apart unseen are not said to agree."""


@dataclass(frozen=True)
class ClockPair:
    """Two sensors, the first of which lags the second; ``by`` names what they both saw.

    ``stated_s`` is the spread of their offset that the cards allow.
    """

    y: str
    x: str
    by: str
    lag: Lag
    stated_s: float = 0.0

    @property
    def pair(self) -> Pair:
        """Their names."""
        return self.y, self.x

    @property
    def limit_s(self) -> float:
        """What noise, sampling and the cards explain."""
        lag = self.lag
        return max(limit(lag.sigma_s, lag.n_windows - 1, self.stated_s), lag.step_s)

    @property
    def is_vague(self) -> bool:
        """Whether the data alone leave the offset open by more than `VAGUE_S`."""
        lag = self.lag
        return max(limit(lag.sigma_s, lag.n_windows - 1, 0.0), lag.step_s) > VAGUE_S

    @property
    def apart(self) -> bool:
        """Whether the two clocks differ by more."""
        return abs(self.lag.lag_s) > self.limit_s


def clock_findings(pairs: Sequence[ClockPair], others: Collection[str] = ()) -> Iterator[Finding]:
    """Judge the clocks of all sensors that are compared with any other.

    Parameters
    ----------
    pairs : sequence of ClockPair
    others : collection of str
        Sensors whose clocks matter too: those that no pair names are said to be unknown.
    """
    apart = [p for p in pairs if p.apart]
    least_s = min((abs(p.lag.lag_s) for p in apart), default=np.inf)
    together = [p for p in pairs if not p.apart and p.limit_s < least_s]
    late = suspects([p.pair for p in apart], [p.pair for p in together])
    for name in late:
        own = [p for p in apart if name in p.pair]
        offsets = [p.lag.lag_s if p.y == name else -p.lag.lag_s for p in own]
        weights = [1.0 / max(p.lag.sigma_s, 1e-3) ** 2 for p in own]
        offset_s = float(np.average(offsets, weights=weights))
        seen = " and ".join(
            f"{p.by} {abs(p.lag.lag_s):.2f} s (sigma {p.lag.sigma_s:.2f}) "
            f"{'later' if offset < 0 else 'earlier'} than {p.x if p.y == name else p.y}"
            for p, offset in zip(own, offsets, strict=True)
        )
        rivals = [other for other in late if other != name]
        or_else = f", unless the clock of {' or '.join(rivals)} is wrong" if rivals else ""
        message = f"its stamps show {seen}{or_else}"
        yield Finding("clock offset", name, "warning", message, fixes.later(offset_s))
    compared = {name for p in pairs for name in p.pair}
    unknown = [name for name in others if name not in compared]
    read = [_agreement(pairs)] if pairs and not apart else []
    if unknown:
        read.append(f"of the clock of {' and '.join(unknown)} nothing tells")
    if read:
        yield Finding("clock offset", None, "ok", "; ".join(read))


def _agreement(pairs: Sequence[ClockPair]) -> str:
    """Whose clocks agree, and of whose the data do not tell enough."""
    telling = [p for p in pairs if not p.is_vague]
    told = sorted({name for p in telling for name in p.pair})
    read = []
    if telling:
        widest = max(telling, key=lambda p: abs(p.lag.lag_s))
        closely = f"{widest.y} and {widest.x} to {abs(widest.lag.lag_s):.2f} s"
        read.append(f"the clocks of {', '.join(told)} agree, {closely}")
    for name in sorted({name for p in pairs for name in p.pair} - {*told}):
        own = min((p for p in pairs if name in p.pair), key=lambda p: p.lag.sigma_s)
        other = own.x if own.y == name else own.y
        seen = f"{abs(own.lag.lag_s):.2f} s against {other}, sigma {own.lag.sigma_s:.2f} s"
        read.append(f"of {name}'s the data do not tell ({seen})")
    return "; ".join(read)
