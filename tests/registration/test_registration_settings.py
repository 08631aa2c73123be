"""Limits of the registrations' settings: the last value that is taken, the first that is not."""

from __future__ import annotations

from typing import Any

import pytest
from pydantic import ValidationError

from gtsam_nav.registration.settings import CorrelativeSettings, Open3dSettings, PicSettings

POSITIVE = {
    PicSettings: ("gate", "shrink", "cauchy_k", "wall_radius_m"),
    CorrelativeSettings: ("cell_m", "reach_m", "reach_deg", "max_rival", "rival_m", "rival_deg"),
    Open3dSettings: ("voxel_m",),
}
NOT_NEGATIVE = {
    PicSettings: ("min_overlap", "floor_xy_m", "floor_yaw_deg"),
    CorrelativeSettings: ("min_score",),
    Open3dSettings: ("min_fitness", "floor_m", "floor_deg"),
}
LEAST_COUNTS = {
    PicSettings: {"max_iterations": 1},
    CorrelativeSettings: {},
    Open3dSettings: {"min_points": 3},
}
LARGEST = {
    PicSettings: {"shrink": 1.0, "min_overlap": 1.0},
    CorrelativeSettings: {"reach_deg": 180.0, "min_score": 1.0, "max_rival": 1.0},
    Open3dSettings: {"min_fitness": 1.0},
}
every_method = pytest.mark.parametrize("settings", POSITIVE, ids=lambda each: each.__name__)


def takes(settings: Any, name: str, value: float) -> bool:
    try:
        settings(**{name: value})
    except ValidationError:
        return False
    return True


@every_method
def test_every_number_has_its_limits(settings: Any) -> None:
    for name in POSITIVE[settings]:
        assert (takes(settings, name, 1e-9), takes(settings, name, 0.0)) == (True, False), name
    for name in NOT_NEGATIVE[settings]:
        assert (takes(settings, name, 0.0), takes(settings, name, -1e-9)) == (True, False), name
    for name, least in LEAST_COUNTS[settings].items():
        assert (takes(settings, name, least), takes(settings, name, least - 1)) == (True, False)
    for name, most in LARGEST[settings].items():
        assert (takes(settings, name, most), takes(settings, name, most + 1e-9)) == (True, False)
    numbers = {n for n, field in settings.model_fields.items() if field.annotation in (int, float)}
    assert numbers == {*POSITIVE[settings], *NOT_NEGATIVE[settings], *LEAST_COUNTS[settings]}


@every_method
def test_defaults_are_within_their_own_limits(settings: Any) -> None:
    assert settings.model_validate(settings().model_dump()) == settings()
