"""Each classic mistake in a mission of one seed, and what its fix makes of it.

The small twin of ``python -m benchmarks.audit``.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml

import gtsam_nav as gn
from benchmarks.audit import names, warnings
from benchmarks.mistakes import MISTAKES, SILENT, Mistake
from gtsam_nav.audit import audit
from gtsam_nav.writers.mission_folder import MISSION_FILE, write_mission

SEED = 2
BY_NAME = {mistake.name: mistake for mistake in MISTAKES}
QUICK = ("gyro in deg/s, no DVL", "GNSS velocity ENU")


def look(mistake: Mistake) -> None:
    found = list(warnings(audit(mistake.mission(SEED))))
    assert any(names(finding, mistake) for finding in found), [f.text for f in found]


@pytest.mark.parametrize("name", QUICK)
def test_quick_mistakes_are_found(name: str) -> None:
    look(BY_NAME[name])


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in BY_NAME if name not in QUICK])
def test_mistakes_are_found(name: str) -> None:
    look(BY_NAME[name])


def test_a_clean_mission_is_not_warned_of() -> None:
    assert list(warnings(audit(gn.simulate("laps", SEED)))) == []


@pytest.mark.slow
def test_clean_missions_are_not_warned_of() -> None:
    for seed in (SEED, SEED + 1):
        assert list(warnings(audit(gn.simulate("marina", seed, settings=SILENT)))) == []


def card_lines(fix: str) -> dict[str, Any]:
    """The keys of a card that a fix states, its remarks left out."""
    text = fix.split(", or ")[0].split(" (")[0]
    lines = yaml.safe_load("{" + text + "}")
    assert isinstance(lines, dict)
    return lines


MENDED = (
    *("gyro in deg/s", "accelerometer in g", "gravity sign", "IMU axes FLU", "heading ENU"),
    *("heading in radians", "DVL velocities reversed", "DVL misaligned by 10 deg"),
    *("GNSS clock 2 s late", "lever arm sign", "stale headings", "mirrored sonar"),
)
"""One for each kind of line."""


@pytest.mark.slow
@pytest.mark.parametrize("name", MENDED)
def test_the_fix_mends_it(name: str, tmp_path: Path) -> None:
    mistake = BY_NAME[name]
    spoilt = mistake.mission(SEED)
    imu = spoilt.sensors["imu"]
    slower = replace(imu, series=imu.series.select(slice(None, None, 4)))
    write_mission(spoilt.with_sensor(slower).without("reference"), tmp_path / "mission")
    before = gn.open_mission(tmp_path / "mission")
    (finding,) = [f for f in warnings(audit(before)) if names(f, mistake)]
    card = tmp_path / "mission" / MISSION_FILE
    tree = yaml.safe_load(card.read_text())
    tree["sensors"][mistake.sensor] |= card_lines(finding.fix)
    card.write_text(yaml.safe_dump(tree))
    left = [f.text for f in warnings(audit(gn.open_mission(tmp_path / "mission")))]
    assert left == []
