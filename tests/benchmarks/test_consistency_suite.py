"""The small twin of ``benchmarks.consistency``: a minute or two, a handful of runs."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks import consistency
from benchmarks.consistency import FIXES, NO_FIXES, NO_SONAR, Case, Run, judged, outcome, run
from gtsam_nav.evaluation.ensemble import NormalisedErrors


def mean_per_dof(case: Case, runs: int, duration_s: float) -> dict[str, float]:
    found = [run(case, duration_s, seed).errors for seed in range(runs)]
    return {
        name: float(np.mean([each.values[name] for each in found])) / dof
        for name, dof in found[0].dof.items()
    }


@pytest.mark.slow
def test_dead_reckoning_is_as_good_as_it_says() -> None:
    means = mean_per_dof(Case("dr", overrides=NO_FIXES), 6, 40.0)
    assert set(means) == {"position", "heading", "velocity_n", "velocity_e"}
    for name, mean in means.items():
        assert 0.3 < mean < 1.8, name


@pytest.mark.slow
@pytest.mark.parametrize("method", ["graph", "ins-ekf"])
def test_between_keyframes_too_the_estimate_is_as_good_as_it_says(method: str) -> None:
    means = mean_per_dof(Case(method, overrides=(*FIXES, NO_SONAR)), 6, 60.0)
    for name, mean in means.items():
        assert 0.5 < mean < 1.8, name


@pytest.mark.slow
def test_without_an_imu_the_heading_is_as_good_as_it_says() -> None:
    means = mean_per_dof(Case("graph", noise="matched, no IMU", overrides=FIXES), 6, 200.0)
    for name, mean in means.items():
        assert 0.5 < mean < 1.1, name


@pytest.mark.slow
def test_an_outcome_has_a_row_a_quantity_and_a_sensor() -> None:
    case = Case("ins-ekf", "laps")
    rows = outcome(case, range(2), workers=1, duration_s=30.0).rows()
    quantities = [row["quantity"] for row in rows]
    assert "NEES velocity_n" in quantities
    assert "NIS gnss" in quantities
    for row in rows:
        assert row["holds"] == (row["fraction_inside"] >= 0.9)
        assert ("autocorrelation" in row) == row["quantity"].startswith("NIS")


@pytest.mark.parametrize(
    ("levels", "verdicts"), [((0.5, 1.4), [False, True]), ((0.5, 0.6), [False, False])]
)
def test_what_does_not_hold_is_judged_over_twice_the_missions(
    levels: tuple[float, float], verdicts: list[bool], monkeypatch: pytest.MonkeyPatch
) -> None:
    """An error that is one draw a run, of half the stated variance by chance or in truth."""
    asked: list[range] = []

    def ensembles(cases: list[Case], seeds: range, workers: int) -> list[list[Run]]:
        asked.append(seeds)
        assert workers == 3
        heading = np.full(5, levels[seeds.start // 50])
        errors = NormalisedErrors(np.arange(5.0), {"heading": heading}, {"heading": 1})
        return [[Run(errors, {})] * len(seeds) for _ in cases]

    monkeypatch.setattr(consistency, "ensembles", ensembles)
    promised, measured = Case("kiss"), Case("scan-match", promised=False)
    of_promised, of_measured = judged([promised, measured], 50, workers=3)
    assert [found.runs for found in of_promised] == [50, 100]
    assert [found.holds for found in of_promised] == verdicts
    assert [found.runs for found in of_measured] == [50]
    assert asked == [range(50), range(50, 100)]
