"""Headings and tilts of a turned instrument as those of the body."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gtsam_nav.frames import Array, rotation_from_rpy, rpy_from_rotation, wrap_angle
from gtsam_nav.series import AttitudeSeries, HeadingSeries, Series

ORIENTING_TYPES = (HeadingSeries.TYPE, AttitudeSeries.TYPE)
"""Types of sensor whose series are the body's, so that their mounting is the identity."""


def in_body_axes(series: Series, R_bs: Array) -> Series:
    """The same series, but the heading or the tilt in it is that of the body.

    Parameters
    ----------
    series : Series
        Of the instrument; types other than `ORIENTING_TYPES` pass through.
    R_bs : ndarray, shape (3, 3)
        The instrument's mounting.
    """
    if isinstance(series, HeadingSeries):
        return replace(series, heading=body_heading(series.heading, R_bs))
    if isinstance(series, AttitudeSeries):
        roll, pitch = body_tilt(series.roll, series.pitch, R_bs)
        return replace(series, roll=roll, pitch=pitch)
    return series


def body_heading(heading_s: Array, R_bs: Array) -> Array:
    """Heading of the body of a level vehicle, rad in [-pi, pi).

    ``heading_s`` is that of the instrument's x axis, which stands at the azimuth of
    ``R_bs[:, 0]`` from the bow.
    """
    return wrap_angle(heading_s - np.arctan2(R_bs[1, 0], R_bs[0, 0]))


def body_tilt(roll_s: Array, pitch_s: Array, R_bs: Array) -> tuple[Array, Array]:
    """Roll and pitch of the body, rad: ``R_nb = R_ns R_sb``, in which the heading has no part."""
    if np.array_equal(R_bs, np.eye(3)):
        return roll_s, pitch_s
    R_ns = rotation_from_rpy(np.stack([roll_s, pitch_s, np.zeros_like(roll_s)], axis=-1))
    rpy = rpy_from_rotation(R_ns @ R_bs.T)
    return rpy[..., 0], rpy[..., 1]
