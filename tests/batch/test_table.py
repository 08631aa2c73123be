"""The table: whole rows, one a run, readable at any time."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest
from batch_rows import row

from gtsam_nav.batch.table import TABLE, compact, read_results, row_path, write_row
from gtsam_nav.errors import DataError


@pytest.fixture
def out(tmp_path: Path) -> Path:
    (tmp_path / TABLE).mkdir()
    return tmp_path


def test_rows_come_back_as_they_were(out: Path) -> None:
    good, bad = row("m1", error_m=0.25), row("m2", cause="DataError", error="no file")
    for one in (bad, good):
        write_row(out / TABLE, one)
    read = read_results(out)
    for k, one in enumerate((good, bad)):
        expected = one.to_record()
        assert {n: None if pd.isna(v) else v for n, v in read.iloc[k].items()} == expected


def test_pandas_reads_it_before_and_after_compaction(out: Path) -> None:
    for k in range(3):
        write_row(out / TABLE, row(f"m{k}"))
    before = pd.read_parquet(out / TABLE)
    compacted = compact(out)
    after = pd.read_parquet(out / TABLE)
    assert len(list((out / TABLE).iterdir())) == 1
    assert set(before["mission"]) == set(after["mission"]) == {"m0", "m1", "m2"}
    assert before.dtypes.to_dict() == after.dtypes.to_dict() == compacted.dtypes.to_dict()


def test_the_newest_row_of_a_run_counts(out: Path) -> None:
    write_row(out / TABLE, row("m1", error_m=1.0))
    compact(out)
    write_row(out / TABLE, row("m1", error_m=2.0, finished_utc=2.0))
    assert list(read_results(out)["ate_none_mean_m"]) == [2.0]


def test_a_half_written_row_is_not_seen(out: Path) -> None:
    write_row(out / TABLE, row("m1"))
    whole = row_path(out / TABLE, row("m1").key).read_bytes()
    (out / TABLE / ".m2.parquet.1.draft").write_bytes(whole[: len(whole) // 2])
    assert list(read_results(out)["mission"]) == ["m1"]
    assert list(pd.read_parquet(out / TABLE)["mission"]) == ["m1"]


def test_a_compaction_that_was_cut_short_loses_and_doubles_nothing(out: Path) -> None:
    write_row(out / TABLE, row("m1"))
    left = row_path(out / TABLE, row("m1").key).read_bytes()
    compact(out)
    row_path(out / TABLE, row("m1").key).write_bytes(left)
    assert len(read_results(out)) == 1
    assert len(compact(out)) == 1


def test_compaction_drops_what_is_to_be_done_again(out: Path) -> None:
    for name in ("m1", "m2"):
        write_row(out / TABLE, row(name))
    compact(out, dropped={row("m1").key})
    assert list(pd.read_parquet(out / TABLE)["mission"]) == ["m2"]


def test_a_table_without_rows_has_its_columns(out: Path) -> None:
    read = read_results(out)
    assert len(read) == 0
    assert {"mission", "cause", "ate_none_mean_m"} <= set(read.columns)


def test_a_damaged_table_is_an_error_that_names_it(out: Path) -> None:
    (out / TABLE / "rows-1.parquet").write_bytes(b"PAR1 and nothing else")
    with pytest.raises(DataError, match=r"results\.parquet: cannot read the results"):
        read_results(out)


def test_a_folder_without_a_table_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="not a batch's folder"):
        read_results(tmp_path)
