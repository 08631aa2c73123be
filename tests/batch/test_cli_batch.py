"""The command ``batch``; the runs are made in this process, one after the other."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext
from importlib import import_module
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from gtsam_nav.batch.plan import PlannedRun
from gtsam_nav.batch.work import carry_out
from gtsam_nav.cli import app


@pytest.fixture(autouse=True)
def no_workers(monkeypatch: pytest.MonkeyPatch) -> None:
    def connect(_workers: int | None, _scheduler: str | None) -> AbstractContextManager[None]:
        return nullcontext()

    def carry_out_all(
        _client: None, runs: Sequence[PlannedRun], out: Path
    ) -> Iterator[tuple[PlannedRun, str | None]]:
        for run in runs:
            yield run, carry_out(run, out)

    workers = import_module("gtsam_nav.batch.workers")
    monkeypatch.setattr(workers, "connect", connect)
    monkeypatch.setattr(workers, "carry_out_all", carry_out_all)


def call(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["batch", *map(str, arguments)], catch_exceptions=False)


def test_it_ranks_and_says_where_the_results_are(missions: Path, tmp_path: Path) -> None:
    done = call(missions / "m?", "--out", tmp_path, "-m", "dr", "--sweep", "seed=1,2")
    assert done.exit_code == 0
    for line in ("dr seed=1", f"table: {tmp_path}/results.parquet", f"summary: {tmp_path}/report"):
        assert line in done.stdout
    assert (tmp_path / "m1/seed=2/dr/metrics.json").is_file()


def test_a_bad_mission_is_counted_and_sets_the_exit_code(missions: Path, tmp_path: Path) -> None:
    done = call(missions / "*", "--out", tmp_path, "-m", "dr")
    assert done.exit_code == 3
    assert "warning: DataError: 1 of 3 runs failed, the first bad, dr: " in done.stderr


def test_json_is_the_ranking(missions: Path, tmp_path: Path) -> None:
    document = json.loads(call(missions / "m0", "--out", tmp_path, "-m", "dr", "--json").stdout)
    assert document["score"] == "ate_none_mean_m"
    assert [v["method"] for v in document["variants"]] == ["dr"]


def test_it_resumes(missions: Path, tmp_path: Path) -> None:
    assert call(missions / "m0", "--out", tmp_path, "-m", "dr").exit_code == 0
    before = (tmp_path / "m0/dr/run.json").read_bytes()
    done = call(missions / "m?", "--out", tmp_path, "-m", "dr", "--resume")
    assert done.exit_code == 0
    assert (tmp_path / "m0/dr/run.json").read_bytes() == before
    assert (tmp_path / "m1/dr/run.json").is_file()


def test_missions_are_opened_by_the_card(tmp_path: Path) -> None:
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        rows = "".join(f"{200 * k},1,0,0,0\n" for k in range(50))
        (tmp_path / name / "log.csv").write_text(f"ms,u,v,w,yaw\n{rows}")
    card = tmp_path / "card.yaml"
    card.write_text(
        "seed: 3\n"
        "mission: {sensors: {"
        "dvl: {file: log.csv, columns: {t: ms, vx: u, vy: v, vz: w}, scale: {t: 0.001}},"
        "heading: {file: log.csv, columns: {t: ms, heading_deg: yaw}, scale: {t: 0.001}}}}"
    )
    out = tmp_path / "out"
    done = call(tmp_path / "[ab]", "--out", out, "-m", "dr", "-c", card)
    assert done.exit_code == 0, done.stderr
    record = json.loads((out / "b/dr/run.json").read_text())
    assert record["opening"]["card"] == str(card)
