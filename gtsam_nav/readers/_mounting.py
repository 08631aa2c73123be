"""Headings, attitudes and points of a mounted instrument as those of the body."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gtsam_nav.frames import Array, rotation_from_rpy, rpy_from_rotation, wrap_angle
from gtsam_nav.mission import Sensor
from gtsam_nav.series import AttitudeSeries, HeadingSeries, ReferenceSeries, ScanSeries


def in_body_axes(sensor: Sensor) -> Sensor:
    """The same sensor, but what can be told of the body's axes is: headings, tilts, the attitude of
    a reference, points of scans.

    Parameters
    ----------
    sensor : Sensor
        Its series as the instrument has them; types that are told in the instrument's axes pass
        through.
    """
    series, R_bs = sensor.series, sensor.R_bs
    if isinstance(series, HeadingSeries):
        turned = replace(series, heading=body_heading(series.heading, R_bs))
        return replace(sensor, series=turned, R_bs=np.eye(3))
    if isinstance(series, AttitudeSeries):
        roll, pitch = body_tilt(series.roll, series.pitch, R_bs)
        return replace(sensor, series=replace(series, roll=roll, pitch=pitch), R_bs=np.eye(3))
    if isinstance(series, ReferenceSeries) and series.rpy is not None:
        rpy = body_attitude(series.rpy, R_bs)
        return replace(sensor, series=replace(series, rpy=rpy), R_bs=np.eye(3))
    if isinstance(series, ScanSeries):
        here = sensor.xyz_b[: series.points_b.shape[1]]
        turn = R_bs[: len(here), : len(here)]
        placed = replace(series, points_b=here + series.points_b @ turn.T)
        return replace(sensor, series=placed, R_bs=np.eye(3))
    return sensor


def body_heading(heading_s: Array, R_bs: Array) -> Array:
    """Heading of the body of a level vehicle, rad in [-pi, pi).

    ``heading_s`` is that of the instrument's x axis, which stands at the azimuth of
    ``R_bs[:, 0]`` from the bow.
    """
    return wrap_angle(heading_s - np.arctan2(R_bs[1, 0], R_bs[0, 0]))


def body_tilt(roll_s: Array, pitch_s: Array, R_bs: Array) -> tuple[Array, Array]:
    """Roll and pitch of the body, rad, in which the heading has no part."""
    rpy = body_attitude(np.stack([roll_s, pitch_s, np.zeros_like(roll_s)], axis=-1), R_bs)
    return rpy[..., 0], rpy[..., 1]


def body_attitude(rpy_s: Array, R_bs: Array) -> Array:
    """Roll, pitch and yaw of the body, rad: ``R_nb = R_ns R_sb``."""
    if np.array_equal(R_bs, np.eye(3)):
        return rpy_s
    return rpy_from_rotation(rotation_from_rpy(rpy_s) @ R_bs.T)
