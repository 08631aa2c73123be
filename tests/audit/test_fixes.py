"""The lines that go into a card are YAML, and mean what they say."""

from __future__ import annotations

import numpy as np
import yaml

from gtsam_nav.audit import fixes
from gtsam_nav.audit.findings import Finding
from gtsam_nav.frames import rotation_from_rpy


def read(line: str) -> dict[str, object]:
    found = yaml.safe_load("{" + line + "}")
    assert isinstance(found, dict)
    return found


def test_lines_are_keys_of_a_card() -> None:
    assert read(fixes.scale("gx gy", -1)) == {"scale": {"gx": -1, "gy": -1}}
    assert read(fixes.columns({"vx": "vy", "vy": "vx"})) == {"columns": {"vx": "vy", "vy": "vx"}}
    assert read(fixes.position(np.array([0.1, -2.0, -0.0]))) == {"xyz_m": [0.1, -2, 0]}
    assert read(fixes.later(-0.5).split(" (")[0]) == {"time_offset_s": -0.5}


def test_a_turned_mounting_is_the_product() -> None:
    R_bs = rotation_from_rpy(np.radians([180.0, 0.0, 60.0]))
    rpy_deg = read(fixes.turned_mounting(np.radians(-15.0), R_bs))["rpy_deg"]
    wanted = rotation_from_rpy(np.radians([0.0, 0.0, -15.0])) @ R_bs
    assert np.allclose(rotation_from_rpy(np.radians(rpy_deg)), wanted, atol=1e-3)


def test_a_finding_says_what_mends_it() -> None:
    assert Finding("gyro unit", "imu", "ok", "fine").text == "fine"
    text = Finding("gyro unit", "imu", "warning", "in deg/s", "gyro_unit: deg/s").text
    assert text == "in deg/s; in the card: gyro_unit: deg/s"
