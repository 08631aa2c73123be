"""The small twin of ``benchmarks.mutation``: what is drawn, and that a trial bites."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.mutation.trials import Fate, Mutant, fate, mirroring_tests

MODULE = '''"""A sum - or what looks like one."""
from numba import njit

@njit(cache=True)
def total(a: float | None, *, b: int = 7) -> float | None:
    weight: int | float = 2
    if a > b:
        return a + weight
    return -a
'''


@pytest.fixture
def module(tmp_path: Path) -> Path:
    path = tmp_path / "module.py"
    path.write_text(MODULE)
    return path


def test_every_place_that_acts_has_one_mutant(module: Path) -> None:
    mutants = pytest.importorskip("benchmarks.mutation.mutants", exc_type=ImportError)
    drawn = mutants.sample([module], 100, seed=0)
    # the default, the weight, the condition as a whole and its comparison, the sum, the sign
    assert [mutant.line for mutant in drawn] == [5, 6, 7, 7, 8, 9]
    for mutant in drawn:
        before, after = mutant.diff.splitlines()
        assert before[1:] == MODULE.splitlines()[mutant.line - 1]
        assert after[1:] == mutant.source.splitlines()[mutant.line - 1]


def test_a_seed_draws_the_same_mutants(module: Path) -> None:
    mutants = pytest.importorskip("benchmarks.mutation.mutants", exc_type=ImportError)
    assert mutants.sample([module], 3, seed=1) == mutants.sample([module], 3, seed=1)
    draws = {tuple(mutants.sample([module], 3, seed)) for seed in range(8)}
    assert len(draws) > 1
    assert {len(draw) for draw in draws} == {3}


def test_tests_of_the_same_name_come_first() -> None:
    assert mirroring_tests(Path("gtsam_nav/sensors/dvl.py")) == (
        "tests/sensors/test_dvl.py",
        "tests/sensors",
        "tests/test_structure.py::test_data_of_the_estimation_core_is_frozen[sensors]",
    )
    assert mirroring_tests(Path("gtsam_nav/sonar/_peaks.py")) == ("tests/sonar/test_echoes.py",)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changed", "expected", "limit_s"),
    [
        ("lever_b - 1 * depth_m", Fate.SURVIVED, 100.0),
        ("lever_b + depth_m", Fate.FAILED, 100.0),
        ("lever_b - sum(iter(int, 1))", Fate.HUNG, 8.0),
    ],
    ids=["the same", "a sign", "no end"],
)
def test_trials_find_what_is_wrong_and_end(changed: str, expected: Fate, limit_s: float) -> None:
    path = Path("gtsam_nav/sensors/depth.py")
    source = path.read_text()
    assert "lever_b - depth_m" in source
    mutant = Mutant(path, "by hand", 1, source.replace("lever_b - depth_m", changed), "")
    test = "tests/sensors/test_conformance.py::test_the_graph_has_the_same_residual[depth_reading]"
    assert fate(mutant, (test,), limit_s) is expected
    assert path.read_text() == source
