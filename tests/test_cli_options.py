"""What the shell is offered."""

from __future__ import annotations

from gtsam_nav.cli_options import (
    complete_formats,
    complete_frame,
    complete_method,
    complete_scenario,
)


def test_names_are_completed() -> None:
    assert complete_method("la") == ["landmark-ekf"]
    assert "dr" in complete_method("")
    assert complete_scenario("har") == ["harbour"]
    assert complete_frame("e") == ["enu"]
    assert complete_formats("tum,k") == ["tum,kitti", "tum,kml"]
    assert "tum,tum" not in complete_formats("tum,")
