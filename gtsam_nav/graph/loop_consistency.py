"""Which loop closures to believe: those that agree with each other and with all other sensors.

A closure is compared with what everything but the closures says. With e the stacked residuals of
all of them there, G the covariance that the other sensors leave to their predictions and R their
own, ``e ~ N(0, G + R)``. Two closures are consistent where their part of this passes its
chi-square test, and the largest set of pairwise consistent ones is believed: the criterion of
Mangelson et al. (2018, pairwise consistency maximization), with the joint compatibility of Neira
and Tardos (2001) in place of the cycle along the odometry, so that compass and GNSS count too.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gtsam_nav.frames import Array, wrap_angle
from gtsam_nav.graph.cliques import largest_clique
from gtsam_nav.graph.factors import X
from gtsam_nav.graph.scan_matching import ScanMatch, between
from gtsam_nav.graph.sensor_posterior import SensorPosterior
from gtsam_nav.sensors.prediction import chi2_limit
from gtsam_nav.series import BoolArray, IntArray

SURELY_TRUE = 0.3
"""So many of the closures, the best by the other sensors, tell how far these may be trusted."""
MOST_OVERCONFIDENT = 1e4
"""Factor on the covariance of what the other sensors predict, at most."""
GRADUATION = 1.4
"""Factor by which the non-convexity grows from one step of GNC to the next."""
MAX_STEPS = 100


@dataclass(frozen=True)
class LoopEvidence:
    """Closures against what all other sensors say.

    Attributes
    ----------
    residual : ndarray, shape (n, 3)
        Forward, starboard and yaw of b in a: measured less predicted.
    cov_predicted : ndarray, shape (n, 3, n, 3)
    cov : ndarray, shape (n, 3, 3)
        Of the closures themselves.
    """

    residual: Array
    cov_predicted: Array
    cov: Array

    def __len__(self) -> int:
        return len(self.residual)

    def select(self, which: IntArray) -> LoopEvidence:
        """Some of the closures."""
        across = self.cov_predicted[which][:, :, which]
        return LoopEvidence(self.residual[which], across, self.cov[which])


def keyframes_of(loops: list[ScanMatch], scan_keyframe: IntArray) -> IntArray:
    """Keyframes that closures join, in order."""
    return np.unique([scan_keyframe[s] for m in loops for s in (m.a, m.b)])


def evidence_of(
    loops: list[ScanMatch], scan_keyframe: IntArray, posterior: SensorPosterior
) -> LoopEvidence:
    """Closures against the posterior of `keyframes_of` them without any closure."""
    keyframes = keyframes_of(loops, scan_keyframe)
    values = posterior.moved()
    ends = np.array([[scan_keyframe[m.a], scan_keyframe[m.b]] for m in loops])
    places = np.searchsorted(keyframes, ends)
    poses = np.array([_planar(values.atNavState(X(k))) for k in keyframes.tolist()])
    H = np.zeros((len(loops), 3, 3 * len(keyframes)))
    residual = np.empty((len(loops), 3))
    for i, (a, b) in enumerate(places.tolist()):
        predicted, by_a, by_b = between(poses[a], poses[b])
        residual[i] = loops[i].match.q - predicted
        H[i, :, 3 * a : 3 * a + 3], H[i, :, 3 * b : 3 * b + 3] = by_a, by_b
    residual[:, 2] = wrap_angle(residual[:, 2])
    rows = H.reshape(3 * len(loops), -1)
    cov_predicted = (rows @ posterior.planar_cov @ rows.T).reshape(len(loops), 3, len(loops), 3)
    return LoopEvidence(residual, cov_predicted, np.array([m.match.cov for m in loops]))


def _planar(state: Any) -> Array:
    return np.array([*state.position()[:2], state.attitude().yaw()])


def normalised_squares(evidence: LoopEvidence, believed: BoolArray | None = None) -> Array:
    """Chi-square of each closure, shape (n,), three degrees of freedom.

    Parameters
    ----------
    believed : ndarray of bool, shape (n,), optional
        Closures that, beside the other sensors, say what the rest should be; means nothing for
        these themselves.
    """
    n = len(evidence)
    e, G = evidence.residual.ravel(), evidence.cov_predicted.reshape(3 * n, 3 * n)
    if believed is not None and np.any(believed):
        theirs = np.flatnonzero(np.repeat(believed, 3))
        S = G[np.ix_(theirs, theirs)] + _block_diagonal(evidence.cov[believed])
        gain = np.linalg.solve(S, G[theirs]).T
        e, G = e - gain @ e[theirs], G - gain @ G[theirs]
    own = G.reshape(n, 3, n, 3)[np.arange(n), :, np.arange(n)] + evidence.cov
    rows = e.reshape(n, 3)
    return np.asarray(np.einsum("ni,ni->n", rows, np.linalg.solve(own, rows[..., None])[..., 0]))


def _block_diagonal(blocks: Array) -> Array:
    n = len(blocks)
    whole = np.zeros((n, 3, n, 3))
    whole[np.arange(n), :, np.arange(n)] = blocks
    return whole.reshape(3 * n, 3 * n)


def doubted(evidence: LoopEvidence) -> LoopEvidence:
    """The same against other sensors that are no surer of themselves than the closures bear out.

    Dead reckoning whose errors are shared for long is over-confident where it drifts for long: all
    closures contradict it then, and agree with each other. The covariance of its predictions grows
    until the best of the closures lie where chi-square variables would; it never shrinks.
    """
    wanted = chi2_limit(SURELY_TRUE, 3)

    def surplus(log_factor: float) -> float:
        wider = replace(evidence, cov_predicted=np.exp(log_factor) * evidence.cov_predicted)
        return float(np.quantile(normalised_squares(wider), SURELY_TRUE)) - wanted

    most = float(np.log(MOST_OVERCONFIDENT))
    if surplus(0.0) <= 0.0:
        return evidence
    from scipy.optimize import brentq

    log_factor = brentq(surplus, 0.0, most) if surplus(most) < 0.0 else most
    return replace(evidence, cov_predicted=np.exp(log_factor) * evidence.cov_predicted)


def consistent_pairs(evidence: LoopEvidence, probability: float) -> BoolArray:
    """Which closures pass together, shape (n, n), six degrees of freedom; alone on the diagonal."""
    n, e = len(evidence), evidence.residual
    limit = chi2_limit(probability, 6)
    passes = np.empty((n, n), dtype=bool)
    own = evidence.cov_predicted[np.arange(n), :, np.arange(n)] + evidence.cov
    S = np.empty((n, 6, 6))
    for i in range(n):
        across = np.swapaxes(evidence.cov_predicted[i], 0, 1)
        S[:, :3, :3], S[:, 3:, 3:] = own[i], own
        S[:, :3, 3:], S[:, 3:, :3] = across, np.swapaxes(across, 1, 2)
        S[i, :3, 3:] = S[i, 3:, :3] = 0.0  # beside itself
        both = np.hstack([np.broadcast_to(e[i], e.shape), e])
        d2 = np.einsum("ni,ni->n", both, np.linalg.solve(S, both[..., None])[..., 0])
        passes[i] = d2 <= limit
    alone = normalised_squares(evidence) <= chi2_limit(probability, 3)
    passes[np.arange(n), np.arange(n)] = alone
    return np.asarray(passes & passes.T)


def largest_consistent_set(evidence: LoopEvidence, probability: float) -> BoolArray:
    """The largest set of closures of which all pairs are consistent, shape (n,)."""
    passes = consistent_pairs(evidence, probability)
    alone = np.diagonal(passes)
    chosen = np.zeros(len(evidence), dtype=bool)
    chosen[largest_clique(passes & alone & alone[:, None])] = True
    return chosen & alone


def graduated_inliers(evidence: LoopEvidence, probability: float) -> BoolArray:
    """Closures that graduated non-convexity with truncated least squares keeps, shape (n,).

    Yang et al. (2020), all other sensors being known inliers: with the closures' information
    ``W`` under their weights, their residuals in the joint solution are ``(I + G W)^-1 e``.
    """
    n, e = len(evidence), evidence.residual
    limit = chi2_limit(probability, 3)
    information = np.linalg.inv(evidence.cov)
    G = evidence.cov_predicted.reshape(3 * n, 3 * n)

    def squares(weight: Array) -> Array:
        weighted = weight[:, None, None] * information
        gain = np.einsum("knj,njl->knl", G.reshape(3 * n, n, 3), weighted).reshape(3 * n, 3 * n)
        r = np.linalg.solve(np.eye(3 * n) + gain, e.ravel()).reshape(n, 3)
        return np.asarray(np.einsum("ni,nij,nj->n", r, information, r))

    weight = np.ones(n)
    r2 = squares(weight)
    mu = limit / max(2.0 * float(r2.max()) - limit, 1e-9)
    for _ in range(MAX_STEPS):
        with np.errstate(divide="ignore"):
            between = np.sqrt(limit * mu * (mu + 1) / r2) - mu
        weight = np.clip(between, 0.0, 1.0)
        if np.all((weight == 0.0) | (weight == 1.0)):
            break
        r2, mu = squares(weight), GRADUATION * mu
    return weight > 0.5
