"""Two sensors that see the same motion: how much of it, and how much later, one sees."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from gtsam_nav.audit.lagged_products import FEWEST_WINDOWS, WINDOWS_S, Signal, lagged_products
from gtsam_nav.audit.significance import FALSE_ALARM, losses, prefers, quantile
from gtsam_nav.frames import Array

LONGEST_LAG_S = 5.0
"""Of the search at full resolution, which begins where one in coarse steps has led."""
FARTHEST_LAG_S, COARSE_STEP_S = 40.0, 0.2
"""GPS time is 18 s ahead of UTC."""
MOST_LAGS = 100
ALIAS_FALSE_ALARM = 0.05
"""Probability that noise alone tells what is likelier beforehand from what is less so."""


@dataclass(frozen=True)
class Lag:
    """What is to be added to one sensor's stamps for another's clock.

    ``step_s`` is the sample interval below which clocks are not told apart, ``n_windows`` how many
    windows ``sigma_s`` rests on.
    """

    lag_s: float
    sigma_s: float
    step_s: float
    n_windows: int


@dataclass(frozen=True)
class Agreement:
    """``y(t) = gain * x(t + lag)``, but for a straight line in each window.

    Attributes
    ----------
    gain, gain_sigma : float
    lag_s, lag_sigma_s : float
        To be added to the stamps of y for the clock of x. Sigmas are those of the jackknife over
        windows, so that errors may be correlated within one.
    correlation : float
        Of the two signals, at that lag.
    step_s : float
        The longer of the two sensors' sample intervals.
    n_windows : int
    """

    gain: float
    gain_sigma: float
    lag_s: float
    lag_sigma_s: float
    correlation: float
    step_s: float
    n_windows: int

    @property
    def lag(self) -> Lag:
        """The lag by itself."""
        return Lag(self.lag_s, self.lag_sigma_s, self.step_s, self.n_windows)

    @property
    def significant(self) -> bool:
        """Whether the two have anything in common."""
        return abs(self.gain) > quantile(self.n_windows - 1) * self.gain_sigma

    @property
    def is_no_fault(self) -> bool:
        """Whether the two agree as they are, in sign and in clock."""
        noise_s = quantile(self.n_windows - 1) * self.lag_sigma_s
        return self.gain > 0 and abs(self.lag_s) <= max(noise_s, self.step_s)


@dataclass(frozen=True)
class Verdict:
    """An agreement, and whether it is significantly better than any other of as few faults."""

    agreement: Agreement
    unrivalled: bool


def agreement(y: Signal, x: Signal) -> Agreement | None:
    """Compare two signals of the same quantity, in whatever units.

    The lag is where one explains most of the other, over the windows of the length that tells it
    best. What goes up and down by waves agrees a wave later too, and reversed half a wave later:
    that a sign or a clock is wrong has to explain significantly more than any other lag does with
    as few faults.

    Parameters
    ----------
    y, x : Signal
        The gain is that of y, of which x should be the less noisy one: its noise lessens the gain.

    Returns
    -------
    Agreement or None
        None where they overlap too little, one of them never changes, they have nothing in common
        within `FARTHEST_LAG_S`, or a fault of sign or clock is not told from another.
    """
    if len(y.t) < 2 or len(x.t) < 2:
        return None
    step_s = max(float(np.median(np.diff(s.t))) for s in (y, x))
    n_lags = min(max(int(LONGEST_LAG_S / step_s), 2), MOST_LAGS)
    far = _far_lag(y, x, max(step_s, COARSE_STEP_S), n_lags * step_s)
    if far is None:
        return None
    far_s, unrivalled = far
    moved = Signal(x.t - far_s, x.values)
    windows = lagged_products(y, moved, step_s, n_lags)
    told = _fastest(list(_told(windows, step_s, moved_s=far_s)))
    if told is None:
        return None
    found = replace(told.agreement, lag_s=far_s + told.agreement.lag_s)
    return found if found.is_no_fault or (unrivalled and told.unrivalled) else None


def _far_lag(y: Signal, x: Signal, step_s: float, reach_s: float) -> tuple[float, bool] | None:
    """The lag in coarse steps, zero if within reach, and whether it is unrivalled.

    None where the best is beyond reach and not decided.
    """
    if _longest_silence_s(x) > _longest_silence_s(y):
        swapped = _far_lag(x, y, step_s, reach_s)
        return None if swapped is None else (-swapped[0], swapped[1])
    overlap_s = min(y.t[-1], x.t[-1]) - max(y.t[0], x.t[0])
    spared_s = 0.5 * (overlap_s - FEWEST_WINDOWS * WINDOWS_S[0])
    n_lags = int(max(min(FARTHEST_LAG_S, spared_s), reach_s) / step_s)
    windows = list(lagged_products(y, x, step_s, n_lags))
    told = _fastest(list(_told(windows, step_s, reach_s)))
    if told is not None:
        lag_s = told.agreement.lag_s
        if abs(lag_s) <= reach_s:
            return 0.0, told.unrivalled
        return (lag_s, True) if told.unrivalled else None
    best = [_best_lag(products.sum(axis=0)) - n_lags for products in windows]
    return None if any(abs(k) * step_s > reach_s for k in best) else (0.0, False)


def _longest_silence_s(signal: Signal) -> float:
    return float(np.max(np.diff(signal.t)))


def _told(
    windows: Iterable[Array], step_s: float, reach_s: float | None = None, moved_s: float = 0.0
) -> Iterator[Verdict]:
    """The significant agreements of the products of windows of each length."""
    reach = None if reach_s is None else round(reach_s / step_s)
    for products in windows:
        told = _over_windows(products, step_s, reach, round(moved_s / step_s))
        if told is not None and told.agreement.significant:
            yield told


def _fastest(told: list[Verdict]) -> Verdict | None:
    """The most precise of several, unless one of faster motion contradicts its lag.

    A clock is off for all motion alike; a filter, or a drift, delays what is slow.
    """
    if not told:
        return None
    chosen = min(told, key=lambda v: v.agreement.lag_sigma_s)
    for faster in reversed(told[: told.index(chosen)]):
        if _contradict(chosen.agreement, faster.agreement):
            chosen = faster
    alike = [v for v in told if not _contradict(v.agreement, chosen.agreement)]
    same_sign = [v for v in alike if v.agreement.gain * chosen.agreement.gain > 0]
    return replace(chosen, unrivalled=any(v.unrivalled for v in same_sign))


def _contradict(a: Agreement, b: Agreement) -> bool:
    """Whether the lags of two differ by more than noise explains."""
    sigma_s = float(np.hypot(a.lag_sigma_s, b.lag_sigma_s))
    dof = min(a.n_windows, b.n_windows) - 1
    return abs(a.lag_s - b.lag_s) > quantile(dof) * sigma_s


def _over_windows(products: Array, step_s: float, reach: int | None, moved: int) -> Verdict | None:
    """The agreement over windows of one length; None where one of the two never changes."""
    n = len(products)
    total = products.sum(axis=0)
    if not np.all(total[1:] > 0):
        return None
    k = _best_lag(total)
    estimates = [_peak(p, k) for p in (total, *(total - products))]
    figures = np.array(estimates) * [1.0, step_s]
    spread = np.sqrt((n - 1) / n * np.sum((figures[1:] - figures[1:].mean(axis=0)) ** 2, axis=0))
    found = Agreement(
        gain=float(figures[0, 0]),
        gain_sigma=float(spread[0]),
        lag_s=float(figures[0, 1]),
        lag_sigma_s=float(spread[1]),
        correlation=float(total[0, k] / np.sqrt(total[1, k] * total[2, k])),
        step_s=step_s,
        n_windows=n,
    )
    unrivalled = _is_unrivalled(products, k, reach, moved) and not _no_lag_will_do(
        products, k, moved
    )
    return Verdict(found, unrivalled)


def _best_lag(products: Array) -> int:
    """Index of the lag at which one signal explains most of the other; products (3, lags)."""
    xy, xx, _ = products
    return int(np.argmax(xy**2 / np.where(xx > 0, xx, np.inf)))


def _is_unrivalled(products: Array, best: int, reach: int | None, moved: int) -> bool:
    """Whether the best lag is significantly better than each other peak of as few faults.

    A reversed sign is one fault, and so is a lag. A small lag is likelier beforehand than one
    beyond ``reach`` (in steps), and a sign alone than a lag that happens to look like it: these are
    told less strictly, and what is nearer is left to the search at full resolution, which has no
    reach. ``moved`` is the lag of the middle, in steps.
    """
    xy, xx, _ = products.sum(axis=0)
    explained = xy**2 / xx
    lags = np.abs(np.arange(len(xy)) - len(xy) // 2 + moved)
    faults = (xy < 0).astype(int) + (lags > 1)
    # what passes for no fault in coarse steps may yet be a small lag
    rivals = [k for k in _other_peaks(explained, best) if faults[k] <= max(faults[best], 1)]
    sign_alone = xy[best] < 0 and faults[best] == 1
    small = reach is not None and faults[best] < 2 and lags[best] <= reach
    if small:
        rivals = [k for k in rivals if lags[k] > reach and not sign_alone]
    likelier = small or sign_alone
    questions, false_alarm = (1, ALIAS_FALSE_ALARM) if likelier else (len(rivals), FALSE_ALARM)

    loss = losses(np.array([_misfit(products, k) for k in (best, *rivals)]))
    return all(prefers(row, loss[0], questions, false_alarm) for row in loss[1:])


def _no_lag_will_do(products: Array, best: int, moved: int) -> bool:
    """Whether the best lag does not explain significantly more than none.

    What the windows leave of slow motion is noise for the most part: it moves a broad peak about.
    """
    xy = products[:, 0].sum(axis=0)
    none = len(xy) // 2 - moved
    if not 0 <= none < len(xy) or none == best or xy[none] * xy[best] <= 0:
        return False
    loss = losses(np.array([_misfit(products, k) for k in (best, none)]))
    return not prefers(loss[1], loss[0], 1, FALSE_ALARM)


def _misfit(products: Array, k: int) -> Array:
    """What lag k leaves unexplained of each window."""
    xy, xx, _ = products[:, :, k].sum(axis=0)
    gain = xy / xx
    of_x, of_xx, of_yy = products[:, :, k].T
    return np.asarray(np.sqrt(np.maximum(of_yy - 2 * gain * of_x + gain**2 * of_xx, 0.0)))


def _other_peaks(explained: Array, best: int) -> list[int]:
    """Where else it peaks; what is nearer than where half is left belongs to the same peak."""
    edged = np.concatenate([[-np.inf], explained, [-np.inf]])
    peaks = np.flatnonzero((edged[1:-1] >= edged[:-2]) & (edged[1:-1] >= edged[2:]))
    low = np.flatnonzero(explained < 0.5 * explained[best])
    first = max(low[low < best], default=-1)
    last = min(low[low > best], default=len(explained))
    return [int(k) for k in peaks if not first < k < last]


def _peak(products: Array, k: int) -> tuple[float, float]:
    """Gain and lag, in steps, where the explained sum of squares peaks next to lag k."""
    xy, xx, _ = products
    explained = xy**2 / xx
    near = slice(max(k - 1, 0), k + 2)
    k = near.start + int(np.argmax(explained[near]))
    offset = 0.0
    if 0 < k < len(explained) - 1:
        before, here, after = explained[k - 1 : k + 2]
        bend = before - 2 * here + after
        offset = float(np.clip(0.5 * (before - after) / bend, -1.0, 1.0)) if bend < 0 else 0.0
    return float(xy[k] / xx[k]), k - len(explained) // 2 + offset
