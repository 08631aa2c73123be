"""The frame that a file is written in: NED with FRD body axes, or ENU with FLU (ROS REP-103)."""

from __future__ import annotations

from typing import Literal, cast, get_args

from gtsam_nav.errors import ConfigError
from gtsam_nav.frames import ENU_FROM_NED, FLU_FROM_FRD, Array

Frame = Literal["ned", "enu"]


def frame_named(name: str) -> Frame:
    """The frame of that name; raises a ConfigError for another."""
    for frame in get_args(Frame):
        if name == frame:
            return cast("Frame", frame)
    raise ConfigError(f"unknown frame '{name}'; the choices are: {', '.join(get_args(Frame))}")


def express_points(points_n: Array, frame: Frame) -> Array:
    """Points (k, 3) of local NED in a frame."""
    return points_n @ ENU_FROM_NED.T if frame == "enu" else points_n


def express_rotations(R_nb: Array, frame: Frame) -> Array:
    """Attitudes (k, 3, 3) from FRD to NED as attitudes in a frame's own body axes."""
    return ENU_FROM_NED @ R_nb @ FLU_FROM_FRD if frame == "enu" else R_nb
