"""One estimate on one mission, and its errors axis by axis."""

from __future__ import annotations

from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np

import gtsam_nav as gn
from gtsam_nav.evaluation.matching import match
from gtsam_nav.evaluation.metrics import LEAST_COVERAGE, reference_series
from gtsam_nav.frames import Array


@dataclass(frozen=True)
class Job:
    """A method on a simulated mission.

    Attributes
    ----------
    label : str
        Row or column of the table that the run is of.
    scenario : str
    seed : int
    method : str
    overrides : tuple of str
        ``key=value`` settings.
    faults : tuple of str
        What is injected.
    """

    label: str
    scenario: str
    seed: int
    method: str
    overrides: tuple[str, ...] = ()
    faults: tuple[str, ...] = ()


@dataclass(frozen=True)
class Errors:
    """Errors of a run in n, e, d against the truth, m, without alignment."""

    rms: tuple[float, float, float]
    largest: tuple[float, float, float]
    mean_horizontal: float
    end_horizontal: float
    mean_3d: float

    @property
    def rms_3d(self) -> float:
        """Root of the mean squared distance, m."""
        return float(np.linalg.norm(self.rms))


def run(job: Job) -> Errors:
    """Simulate, estimate, compare; a run that leaves part of the mission out has failed."""
    mission = gn.simulate(job.scenario, seed=job.seed)
    config = gn.load_config(None, (f"seed={job.seed}", *job.overrides))
    solution = gn.estimate(mission, job.method, config, faults=job.faults)
    assert mission.reference is not None
    matched = match(solution.trajectory, reference_series(mission.reference))
    if matched is None or matched.coverage < LEAST_COVERAGE:
        coverage = 0.0 if matched is None else matched.coverage
        raise SystemExit(f"{job.label}, seed {job.seed}: covers {coverage:.3f} of its mission")
    return errors(matched.estimate.p_n - matched.reference.p_n)


def errors(error_n: Array) -> Errors:
    """Statistics of position errors, shape (m, 3)."""
    horizontal = np.linalg.norm(error_n[:, :2], axis=1)
    rms = np.sqrt(np.mean(error_n**2, axis=0))
    largest = np.max(np.abs(error_n), axis=0)
    return Errors(
        rms=(float(rms[0]), float(rms[1]), float(rms[2])),
        largest=(float(largest[0]), float(largest[1]), float(largest[2])),
        mean_horizontal=float(np.mean(horizontal)),
        end_horizontal=float(horizontal[-1]),
        mean_3d=float(np.mean(np.linalg.norm(error_n, axis=1))),
    )


def run_all(jobs: Iterable[Job], workers: int) -> dict[str, list[Errors]]:
    """Errors of all jobs by label, in the order of the jobs."""
    jobs = list(jobs)
    by_label: dict[str, list[Any]] = {}
    with ProcessPoolExecutor(max_workers=workers) as pool:
        for job, found in zip(jobs, pool.map(run, jobs), strict=True):
            by_label.setdefault(job.label, []).append(found)
    return by_label
