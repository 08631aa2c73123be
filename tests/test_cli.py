"""The command line on a short simulated mission, and on everything that users get wrong."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from gtsam_nav.cli import main
from gtsam_nav.config import Config
from gtsam_nav.errors import DataError, EstimationError
from gtsam_nav.mission import Mission
from gtsam_nav.simulation import simulate
from gtsam_nav.solution import Solution
from gtsam_nav.writers.mission_folder import write_mission

DURATION_S = 30.0

registry = import_module("gtsam_nav.methods")


@dataclass(frozen=True)
class Outcome:
    """What a call of the command line left behind."""

    code: int
    out: str
    err: str

    @property
    def document(self) -> Any:
        return json.loads(self.out)


CommandLine = Callable[..., Outcome]


def run_main(*arguments: object) -> int:
    """Run ``gtsam-nav ARGUMENTS`` in this process; returns its exit code."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["gtsam-nav", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            main()
    return int(ended.value.code or 0)


@pytest.fixture
def gtsam_nav(capsys: pytest.CaptureFixture[str]) -> CommandLine:
    """Runs ``gtsam-nav ARGUMENTS`` and tells what it printed."""

    def call(*arguments: object) -> Outcome:
        code = run_main(*arguments)
        captured = capsys.readouterr()
        return Outcome(code, captured.out, captured.err)

    return call


@pytest.fixture
def no_report(monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs draw no plots, which take the most of a short run's time."""

    def stand_in(_solutions: Sequence[Solution], out: Path, _config: Config) -> Path:
        return out / "report.html"

    monkeypatch.setattr(import_module("gtsam_nav.evaluation.report"), "write_report", stand_in)


@pytest.fixture(scope="session")
def mission() -> Mission:
    return simulate("marina", seed=3, duration_s=DURATION_S)


@pytest.fixture(scope="session")
def mission_folder(mission: Mission, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("cli") / "mission"
    write_mission(mission, folder)
    return folder


@pytest.fixture(scope="session")
def run_folder(mission_folder: Path) -> Path:
    """A finished dead reckoning."""
    out = mission_folder.parent / "out"
    assert run_main("run", mission_folder, "--method", "dr", "--out", out) == 0
    return out


def one_line(outcome: Outcome) -> bool:
    return outcome.err.count("\n") == 1 and "Traceback" not in outcome.err


# ------------------------------------------------------------------------------- what it can do


def test_the_version_is_the_installed_one(gtsam_nav: CommandLine) -> None:
    shown = gtsam_nav("--version")
    assert (shown.code, shown.out) == (0, f"gtsam-nav {version('gtsam-nav')}\n")


def test_help_names_every_command(gtsam_nav: CommandLine) -> None:
    shown = gtsam_nav("--help")
    assert shown.code == 0
    for command in (
        "inspect",
        "run",
        "compare",
        "evaluate",
        "simulate",
        "export",
        "config",
        "doctor",
    ):
        assert f"  {command}" in shown.out


def test_run_writes_scores_and_a_report(
    gtsam_nav: CommandLine, mission_folder: Path, tmp_path: Path
) -> None:
    out = tmp_path / "new" / "out"
    done = gtsam_nav("run", mission_folder, "-m", "dr", "--set", "gnss.use=none", "--out", out)
    assert done.code == 0
    assert "simulated sonar" in done.out
    assert f"report: {out / 'report.html'}" in done.out
    assert (out / "report.html").is_file()
    metrics = json.loads((out / "dr" / "metrics.json").read_text())
    assert metrics["coverage"] > 0.99
    assert metrics["ate"]["se2"]["mean"] < 3.0
    record = json.loads((out / "dr" / "run.json").read_text())
    assert 0.0 < record["wall_s"] < 60.0
    assert record["command"].startswith("gtsam-nav run ")
    config = yaml.safe_load((out / "dr" / "config.yaml").read_text())
    assert config["gnss"]["use"] == "none"


@pytest.mark.usefixtures("no_report")
def test_a_run_may_be_repeated_in_its_place(
    gtsam_nav: CommandLine, mission_folder: Path, run_folder: Path
) -> None:
    before = {
        path.name: path.read_bytes()
        for path in (run_folder / "dr").iterdir()
        if path.is_file() and path.name != "run.json"
    }
    assert gtsam_nav("run", mission_folder, "--method", "dr", "--out", run_folder).code == 0
    for name, content in before.items():
        assert (run_folder / "dr" / name).read_bytes() == content, name


@pytest.mark.slow
def test_both_methods_side_by_side(
    gtsam_nav: CommandLine, mission_folder: Path, tmp_path: Path
) -> None:
    chosen = [
        "-m",
        "dr",
        "-m",
        "graph",
        "--set",
        "gnss.use=window",
        "--set",
        "gnss.window_s=[0,15]",
    ]
    done = gtsam_nav("run", mission_folder, *chosen, "--out", tmp_path)
    assert done.code == 0, done.err
    assert done.err.count("simulated sonar") == 1
    assert "warning: dr, graph: " in done.err
    compared = gtsam_nav("compare", tmp_path, "--json")
    assert [Path(row["name"]).name for row in compared.document] == ["dr", "graph"]
    assert compared.document[1]["coverage"] > 0.99


@pytest.mark.usefixtures("no_report")
def test_start_and_stop_crop_the_mission(
    gtsam_nav: CommandLine, mission_folder: Path, tmp_path: Path
) -> None:
    span = ["--start", "5", "--stop", "20"]
    assert gtsam_nav("run", mission_folder, "-m", "dr", *span, "--out", tmp_path).code == 0
    t = np.loadtxt(tmp_path / "dr" / "trajectory.tum")[:, 0]
    assert t[0] == pytest.approx(5.0, abs=0.2)
    assert t[-1] == pytest.approx(20.0, abs=0.2)


def test_compare_puts_runs_side_by_side(gtsam_nav: CommandLine, run_folder: Path) -> None:
    by_folder = gtsam_nav("compare", run_folder, "--json")
    by_run = gtsam_nav("compare", run_folder / "dr", "--json")
    assert by_folder.code == 0
    assert by_folder.document == by_run.document
    metrics = json.loads((run_folder / "dr" / "metrics.json").read_text())
    assert by_run.document[0]["ate_se2_mean_m"] == metrics["ate"]["se2"]["mean"]
    table = gtsam_nav("compare", run_folder).out
    assert f"{metrics['ate']['se2']['mean']:.2f}" in table


def test_evaluate_agrees_with_the_run(
    gtsam_nav: CommandLine, mission_folder: Path, run_folder: Path
) -> None:
    metrics = json.loads((run_folder / "dr" / "metrics.json").read_text())
    scored = gtsam_nav("evaluate", run_folder / "dr" / "trajectory.tum", mission_folder, "--json")
    assert scored.code == 0
    assert scored.document["ate"]["none"]["mean"] == pytest.approx(metrics["ate"]["none"]["mean"])
    assert scored.document["coverage"] == pytest.approx(metrics["coverage"])


def test_evaluate_takes_files_windows_and_lever_arms(
    gtsam_nav: CommandLine, tmp_path: Path
) -> None:
    t = np.arange(0.0, 100.0)
    straight = "".join(f"{s} {s} 0 0 0 0 0 1\n" for s in t)
    (tmp_path / "estimate.tum").write_text(straight)
    rows = "".join(f"{s},{s + (3 if s >= 50 else 0)},4,0\n" for s in t)
    (tmp_path / "truth.csv").write_text("t,n,e,d\n" + rows)
    files = tmp_path / "estimate.tum", tmp_path / "truth.csv", "--json"
    early = gtsam_nav("evaluate", *files, "--window", "0,50").document
    assert early["ate"]["none"]["max"] == pytest.approx(4.0)
    late = gtsam_nav("evaluate", *files, "--window", "50,100").document
    assert late["ate"]["none"]["min"] == pytest.approx(5.0)
    moved = gtsam_nav("evaluate", *files, "--lever-arm", "3,4,0", "--window", "50,100").document
    assert moved["ate"]["none"]["max"] == pytest.approx(0.0, abs=1e-9)
    itself = gtsam_nav("evaluate", files[0], files[0])
    assert itself.code == 0
    assert "mean 0.00" in itself.out


@pytest.mark.usefixtures("no_report")
def test_evaluate_never_scores_on_fixes_that_a_run_used(
    gtsam_nav: CommandLine, mission: Mission, tmp_path: Path
) -> None:
    write_mission(mission.without("reference"), tmp_path / "mission")
    window = ["--set", "gnss.use=window", "--set", "gnss.window_s=[0,15]"]
    done = gtsam_nav("run", tmp_path / "mission", "-m", "dr", *window, "--out", tmp_path / "out")
    assert done.code == 0
    metrics = json.loads((tmp_path / "out" / "dr" / "metrics.json").read_text())
    trajectory = tmp_path / "out" / "dr" / "trajectory.tum"
    scored = gtsam_nav("evaluate", trajectory, tmp_path / "mission", "--json").document
    assert scored["ate"]["none"]["mean"] == pytest.approx(metrics["ate"]["none"]["mean"])
    everything = ["--set", "gnss.use=all", "--out", tmp_path / "all"]
    blind = gtsam_nav("run", tmp_path / "mission", "-m", "dr", *everything)
    assert blind.code == 0
    assert "no score" in blind.err
    refused = gtsam_nav(
        "evaluate", tmp_path / "all" / "dr" / "trajectory.tum", tmp_path / "mission"
    )
    assert refused.code == 3
    assert "gnss.use" in refused.err
    assert gtsam_nav("export", tmp_path / "all" / "dr", "--to", "tum").code == 0
    exported = tmp_path / "all" / "dr" / "export" / "trajectory.tum"
    assert gtsam_nav("evaluate", exported, tmp_path / "mission").code == 3


def test_evaluate_reads_no_configuration_above_a_folder_that_is_not_a_runs_export(
    gtsam_nav: CommandLine, mission_folder: Path, run_folder: Path, tmp_path: Path
) -> None:
    exported = tmp_path / "export" / "trajectory.tum"
    exported.parent.mkdir()
    exported.write_bytes((run_folder / "dr" / "trajectory.tum").read_bytes())
    (tmp_path / "config.yaml").write_text("of: another program")
    assert gtsam_nav("evaluate", exported, mission_folder).code == 0


def test_simulate_writes_the_same_mission_for_the_same_seed(
    gtsam_nav: CommandLine, tmp_path: Path
) -> None:
    for name in ("a", "b"):
        made = gtsam_nav(
            "simulate", "marina", "--seed", 5, "--duration", 20, "--out", tmp_path / name
        )
        assert made.code == 0
    for path in (tmp_path / "a").iterdir():
        assert path.read_bytes() == (tmp_path / "b" / path.name).read_bytes(), path.name
    found = gtsam_nav("inspect", tmp_path / "a", "--json").document
    assert found["span_s"][1] == pytest.approx(20.0, abs=0.5)


def test_simulate_lasts_as_long_as_its_scenario(gtsam_nav: CommandLine, tmp_path: Path) -> None:
    made = gtsam_nav("simulate", "ranger", "--seed", 1, "-q", "--out", tmp_path / "run")
    assert made.code == 0
    assert "mission 'ranger-1', 8.4 s" in made.out
    assert gtsam_nav("inspect", tmp_path / "run", "--json").code == 0


@pytest.mark.slow
def test_an_earlier_run_in_the_folder_is_named(
    gtsam_nav: CommandLine, mission_folder: Path, tmp_path: Path
) -> None:
    first = gtsam_nav("run", mission_folder, "-m", "dr", "--out", tmp_path)
    assert "earlier run" not in first.err
    (tmp_path / "dr").rename(tmp_path / "other")
    again = gtsam_nav("run", mission_folder, "-m", "dr", "--out", tmp_path)
    assert "also holds an earlier run of other" in again.err


@pytest.mark.slow
def test_injected_faults_are_on_the_record_and_on_the_page(
    gtsam_nav: CommandLine, mission_folder: Path, tmp_path: Path
) -> None:
    faults = ("--inject", "gnss:outliers=0.5", "--inject", "dvl:drop=10:14")
    done = gtsam_nav("run", mission_folder, "-m", "dr", *faults, "--out", tmp_path)
    assert done.code == 0, done.err
    named = ["gnss:outliers=0.5,size=20:100,burst=1", "dvl:drop=10:14"]
    assert json.loads((tmp_path / "dr" / "run.json").read_text())["faults"] == named
    page = (tmp_path / "report.html").read_text()
    assert "Faults were injected" in page
    for name in named:
        assert name in page
        assert f"warning: dr: injected {name}" in done.err


@pytest.mark.usefixtures("no_report")
def test_a_fault_that_the_mission_cannot_have_is_named(
    gtsam_nav: CommandLine, mission_folder: Path, tmp_path: Path
) -> None:
    refused = gtsam_nav(
        *("run", mission_folder, "-m", "dr", "--inject", "lidar:drop=0.5", "--out", tmp_path)
    )
    assert refused.code == 2
    assert one_line(refused)
    assert "no sensor 'lidar'; the choices are: imu, dvl" in refused.err


def test_a_fault_that_one_of_the_methods_cannot_have_is_named_before_any_runs(
    gtsam_nav: CommandLine, mission_folder: Path, tmp_path: Path
) -> None:
    both = ("-m", "graph", "-m", "dr", "--inject", "loops:false=0.5")
    refused = gtsam_nav("run", mission_folder, *both, "--out", tmp_path / "out")
    assert refused.code == 2
    assert "only graph takes false loop closures, not dr" in refused.err
    assert not (tmp_path / "out" / "graph").exists()


def test_inspect_as_a_table_and_as_json(gtsam_nav: CommandLine, mission_folder: Path) -> None:
    table = gtsam_nav("inspect", mission_folder)
    assert table.code == 0
    assert "dvl" in table.out
    assert "methods that can run: dr, ins-ekf, scan-match, pose-ekf, graph" in table.out
    document = gtsam_nav("inspect", mission_folder, "--json").document
    assert {sensor["name"] for sensor in document["sensors"]} >= {"imu", "dvl", "gnss"}


def test_export_writes_what_was_asked_for(gtsam_nav: CommandLine, run_folder: Path) -> None:
    done = gtsam_nav("export", run_folder / "dr", "--to", "tum,kitti,nav,kml", "--frame", "enu")
    assert done.code == 0
    written = [Path(line) for line in done.out.splitlines()]
    assert len(written) == 5
    assert all(path.is_file() for path in written)


def test_an_export_that_cannot_be_leaves_the_others(
    gtsam_nav: CommandLine, run_folder: Path
) -> None:
    done = gtsam_nav("export", run_folder / "dr", "--to", "g2o,tum")
    assert done.code == 3
    assert "the run has no graph.g2o" in done.err
    assert Path(done.out.strip()).name == "trajectory.tum"


def test_missions_are_not_replaced_unasked(gtsam_nav: CommandLine, tmp_path: Path) -> None:
    make = ("simulate", "laps", "--duration", 5, "--out", tmp_path / "m")
    assert gtsam_nav(*make).code == 0
    before = {path: path.stat().st_mtime_ns for path in (tmp_path / "m").iterdir()}
    for again in (make, ("convert", tmp_path / "m", "--out", tmp_path / "m")):
        refused = gtsam_nav(*again)
        assert refused.code == 2
        assert "--force replaces" in refused.err
        assert {path: path.stat().st_mtime_ns for path in (tmp_path / "m").iterdir()} == before
        assert gtsam_nav(*again, "--force").code == 0
        before = {path: path.stat().st_mtime_ns for path in (tmp_path / "m").iterdir()}


def test_config_dump_can_be_read_back(gtsam_nav: CommandLine, tmp_path: Path) -> None:
    dumped = gtsam_nav("config", "dump", "--set", "gnss.use=none")
    (tmp_path / "config.yaml").write_text(dumped.out)
    again = gtsam_nav("config", "dump", "-c", tmp_path / "config.yaml")
    assert again.out == dumped.out
    assert yaml.safe_load(again.out)["gnss"]["use"] == "none"


@pytest.mark.slow
def test_doctor_finds_this_environment_healthy(gtsam_nav: CommandLine) -> None:
    healthy = gtsam_nav("doctor")
    assert healthy.code == 0
    assert "gtsam" in healthy.out


# ------------------------------------------------------------------------- what users get wrong


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["config", "dump", "--set", "gnss.usr=none"], "use, every_k"),
        (["config", "dump", "--set", "gnss.use=some"], "'every_k'"),
        (["config", "dump", "--set", "gnss"], "key=value"),
        (["config", "dump", "-c", "absent.yaml"], "absent.yaml"),
        (["simulate", "ocean", "--out", "never"], "marina, laps, ranger, submarine"),
        (["run", "nowhere", "--inject", "gnss:wobble=1"], "SENSOR:outliers=SHARE"),
        (["evaluate", "a.tum", "b.tum", "--lever-arm", "1,2"], "3 numbers"),
        (["evaluate", "a.tum", "b.tum", "--window", "x,2"], "2 numbers"),
    ],
)
def test_wrong_settings_end_in_one_line_and_2(
    gtsam_nav: CommandLine,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    arguments: list[str],
    words: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    refused = gtsam_nav(*arguments)
    assert refused.code == 2
    assert words in refused.err
    assert one_line(refused)
    assert not Path("never").exists()


@pytest.mark.parametrize("arguments", [["fly"], ["run"], ["run", "x", "--speed", "9"]])
def test_wrong_usage_ends_in_2(gtsam_nav: CommandLine, arguments: list[str]) -> None:
    assert gtsam_nav(*arguments).code == 2


def test_unknown_method_is_refused_before_the_mission_is_opened(gtsam_nav: CommandLine) -> None:
    refused = gtsam_nav("run", "absent", "--method", "magic")
    assert refused.code == 2
    assert "dr, ins-ekf, landmark-ekf, scan-match, pose-ekf, kiss, graph" in refused.err
    assert one_line(refused)


@pytest.mark.parametrize("command", ["inspect", "run"])
def test_missing_mission_ends_in_3(
    gtsam_nav: CommandLine, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    monkeypatch.chdir(tmp_path)
    refused = gtsam_nav(command, "absent")
    assert refused.code == 3
    assert "absent" in refused.err
    assert one_line(refused)


def test_a_folder_that_is_no_mission_names_the_formats(
    gtsam_nav: CommandLine, tmp_path: Path
) -> None:
    refused = gtsam_nav("inspect", tmp_path)
    assert refused.code == 3
    assert "mission.yaml" in refused.err


def test_missing_runs_and_files_end_in_3(gtsam_nav: CommandLine, tmp_path: Path) -> None:
    assert gtsam_nav("compare", tmp_path).code == 3
    assert gtsam_nav("export", tmp_path, "--to", "tum").code == 3
    assert gtsam_nav("evaluate", tmp_path / "a.tum", tmp_path / "b.tum").code == 3


def test_unknown_export_formats_and_frames_end_in_2(
    gtsam_nav: CommandLine, run_folder: Path
) -> None:
    refused = gtsam_nav("export", run_folder, "--to", "tum,svg")
    assert refused.code == 2
    assert "geojson" in refused.err
    assert gtsam_nav("export", run_folder, "--to", "tum", "--frame", "up").code == 2


def test_output_below_a_file_is_refused_before_the_work(
    gtsam_nav: CommandLine, tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("here first")
    refused = gtsam_nav("run", "absent", "--out", tmp_path / "file" / "out")
    assert refused.code == 2
    assert "file" in refused.err
    assert one_line(refused)
    below = gtsam_nav("simulate", "marina", "--out", tmp_path / "file" / "mission")
    assert below.code == 2


def test_foreign_folders_are_not_overwritten(
    gtsam_nav: CommandLine, mission_folder: Path, tmp_path: Path
) -> None:
    keepsake = tmp_path / "dr" / "thesis.txt"
    keepsake.parent.mkdir()
    keepsake.write_text("years of work")
    refused = gtsam_nav("run", mission_folder, "-m", "dr", "--out", tmp_path)
    assert refused.code == 2
    assert one_line(refused)
    over = gtsam_nav("simulate", "marina", "--duration", "5", "--out", tmp_path / "dr")
    assert over.code == 2
    assert keepsake.read_text() == "years of work"


def test_a_span_without_samples_ends_in_3(
    gtsam_nav: CommandLine, mission_folder: Path, tmp_path: Path
) -> None:
    refused = gtsam_nav("run", mission_folder, "--start", "5000", "--out", tmp_path)
    assert refused.code == 3
    assert "spans 0.0 to 30" in refused.err


def test_sensors_that_never_overlap_are_named(
    gtsam_nav: CommandLine, mission: Mission, tmp_path: Path
) -> None:
    dvl = mission.sensors["dvl"]
    later = replace(dvl, series=dvl.series.shift(500.0))
    write_mission(mission.with_sensor(later), tmp_path / "mission")
    found = gtsam_nav("inspect", tmp_path / "mission")
    assert found.code == 0
    assert "warning: " in found.err
    assert "dvl" in found.err


def test_a_method_without_its_sensors_ends_in_3(
    gtsam_nav: CommandLine, mission: Mission, tmp_path: Path
) -> None:
    write_mission(mission.without("dvl", "odometry"), tmp_path / "mission")
    refused = gtsam_nav("run", tmp_path / "mission", "-m", "dr", "--out", tmp_path / "out")
    assert refused.code == 3
    assert "error: dr: " in refused.err
    assert "DVL" in refused.err


def failing(error: Exception) -> Callable[..., Solution]:
    """`estimate` with a graph that fails."""
    estimate = registry.estimate

    def stand_in(mission: Mission, method: str, *rest: Any, **named: Any) -> Solution:
        if method == "graph":
            raise error
        return estimate(mission, method, *rest, **named)

    return stand_in


@pytest.mark.slow
@pytest.mark.parametrize("error", [EstimationError("it diverged"), DataError("it diverged")])
def test_one_failing_method_loses_nothing_of_the_others(
    gtsam_nav: CommandLine,
    mission_folder: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    error: EstimationError | DataError,
) -> None:
    monkeypatch.setattr(registry, "estimate", failing(error))
    both = ["-m", "graph", "-m", "dr"]
    ended = gtsam_nav("run", mission_folder, *both, "--out", tmp_path)
    assert ended.code == error.exit_code
    assert "error: graph: it diverged" in ended.err
    assert (tmp_path / "dr" / "metrics.json").is_file()
    assert (tmp_path / "report.html").is_file()
    assert not (tmp_path / "graph").exists()


def test_what_speaks_against_the_mission_is_said_where_its_only_method_fails(
    gtsam_nav: CommandLine,
    mission_folder: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(registry, "estimate", failing(EstimationError("it diverged")))

    def alerted(mission: Mission) -> Mission:
        return replace(mission, warnings=("imu: deg/s",))

    monkeypatch.setattr("gtsam_nav.audit.with_alerts", alerted)
    ended = gtsam_nav("run", mission_folder, "--out", tmp_path)
    assert ended.err.splitlines() == ["warning: imu: deg/s", "error: graph: it diverged"]


def test_an_internal_error_is_one_line_unless_debugged(
    gtsam_nav: CommandLine,
    mission_folder: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(registry, "estimate", failing(ZeroDivisionError("of\nlines")))
    run = "run", mission_folder, "--out", tmp_path
    ended = gtsam_nav(*run)
    assert ended.code == 1
    assert ended.err == (
        "internal error: ZeroDivisionError: of lines (use --debug for the traceback)\n"
    )
    assert "Traceback" in gtsam_nav(*run, "--debug").err
    assert "Traceback" in gtsam_nav("--debug", *run).err


@pytest.mark.parametrize("command", [("run",), ("convert",), ("batch", "--workers", "0")])
def test_a_refusal_leaves_no_folder(
    gtsam_nav: CommandLine, tmp_path: Path, command: tuple[str, ...]
) -> None:
    (tmp_path / "nothing").mkdir()
    out = tmp_path / "made" / "for" / "it"
    ended = gtsam_nav(*command, tmp_path / "nothing", "--out", out)
    assert ended.code in (2, 3)
    assert not (tmp_path / "made").exists()


def test_a_refusal_leaves_a_folder_that_was_there(gtsam_nav: CommandLine, tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    assert gtsam_nav("run", tmp_path / "absent", "--out", tmp_path / "there").code == 3
    assert (tmp_path / "there").is_dir()


def test_interruption_ends_in_130(
    gtsam_nav: CommandLine,
    mission_folder: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(registry, "estimate", failing(KeyboardInterrupt()))  # type: ignore[arg-type]
    assert gtsam_nav("run", mission_folder, "--out", tmp_path).code == 130


@pytest.mark.parametrize(
    ("signalled", "code"), [(KeyboardInterrupt(), 130), (SystemExit(143), 143)]
)
def test_so_does_one_within_compiled_code(
    gtsam_nav: CommandLine,
    mission_folder: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    signalled: BaseException,
    code: int,
) -> None:
    told = SystemError("CPUDispatcher returned a result with an exception set")
    told.__cause__ = signalled
    monkeypatch.setattr(registry, "estimate", failing(told))  # type: ignore[arg-type]
    outcome = gtsam_nav("run", mission_folder, "--out", tmp_path)
    assert outcome.code == code
    assert "internal error" not in outcome.err


def test_the_installed_command_ends_with_the_same_codes(tmp_path: Path) -> None:
    command = shutil.which("gtsam-nav", path=str(Path(sys.executable).parent))
    assert command is not None
    ended = subprocess.run(
        [command, "inspect", str(tmp_path / "absent")], capture_output=True, text=True, check=False
    )
    assert (ended.returncode, ended.stdout) == (3, "")
    assert ended.stderr.startswith("error: ")


@pytest.mark.usefixtures("no_report")
def test_a_pose_graph_in_space_is_inspected_and_run(tmp_path: Path, gtsam_nav: CommandLine) -> None:
    upper = " ".join(map(str, np.eye(6)[np.triu_indices(6)]))
    steps = ((0, 1, "1 0 1 0 1 0 1"), (1, 2, "1 1 0 1 0 0 1"), (2, 3, "0 1 1 0 0 0 1"))
    lines = [f"EDGE_SE3:QUAT {a} {b} {step} {upper}\n" for a, b, step in steps]
    path = tmp_path / "some.g2o"
    path.write_text("".join(lines))
    told = gtsam_nav("inspect", path).out
    assert "3 edges of a pose graph, 0 of which close loops\n" in told
    assert "methods that can run: graph" in told
    assert gtsam_nav("run", path, "--out", tmp_path / "out").code == 0
    assert (tmp_path / "out" / "graph" / "trajectory.csv").is_file()
    assert gtsam_nav("run", path, "--start", 9, "--out", tmp_path / "none").code == 3
    path.write_text("".join([*lines, f"EDGE_SE3:QUAT 0 3 nan 0 0 0 0 0 1 {upper}\n"]))
    told = gtsam_nav("inspect", path).out
    assert "3 edges of a pose graph, 0 of which close loops; 1 more left out" in told
    assert json.loads(gtsam_nav("inspect", path, "--json").out)["edges_left_out"] == 1
