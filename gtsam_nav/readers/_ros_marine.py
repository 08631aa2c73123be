"""The numbers in the messages of marine packages: Doppler velocity logs, depth, scanning sonars.

As in `_ros_messages`, but in the instrument's own axes, forward, starboard, down; each function's
docstring says what its dialect calls valid and unknown.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from gtsam_nav.readers._ros_card import BagSensor
from gtsam_nav.readers._ros_messages import Sample, over_ground, sigma_of, xyz

PD0_BAD_M_S = 32.0
"""PD0 writes -32.768 m/s for a velocity that it could not measure."""


def waterlinked(m: Any, _: BagSensor) -> Sample | str:
    """Figure of merit as sigma; altitude -1 is none."""
    sigma = m.fom if m.fom > 0 else np.nan
    return over_ground(xyz(m.velocity), sigma, bool(m.velocity_valid), m.altitude)


def marine_acoustic(m: Any, _: BagSensor) -> Sample | str:
    """Covariance -1 is unknown; modes are 1 bottom, 2 water; three beams make a velocity."""
    sigma = sigma_of(*(m.velocity_covar[4 * k] for k in range(3)))
    valid = m.num_good_beams >= 3
    return over_ground(xyz(m.velocity), sigma, valid, m.altitude, m.velocity_mode != 2)


def uuv(m: Any, _: BagSensor) -> Sample | str:
    """Covariance 0 is unknown, -1 marks an invalid velocity."""
    sigma = sigma_of(*(m.velocity_covariance[4 * k] for k in range(3)))
    valid = m.velocity_covariance[0] >= 0
    return over_ground(xyz(m.velocity), sigma, valid, getattr(m, "altitude", np.nan))


def pd0(m: Any, _: BagSensor) -> Sample | str:
    """Teledyne RDI's four velocities: starboard, forward, down, and the error velocity.

    The error velocity is the two beam pairs' disagreement; without it three beams stand alone and
    nothing checks them. Checked on a dive of the SONIA vehicle: acceleration ahead goes with the
    change of the second (correlation 0.67), the rise of the pressure with the third (0.44).
    """
    starboard, forward, down, error = (float(v) for v in m.velocity)
    if not np.isfinite(error):
        return "non-finite error velocity"
    valid = all(abs(v) < PD0_BAD_M_S for v in (starboard, forward, down))
    ranges = np.asarray(m.range)[np.isfinite(m.range)]
    altitude_m = float(np.mean(ranges)) if len(ranges) else np.nan
    return over_ground((forward, starboard, down), np.nan, valid, altitude_m)


def linkquest(m: Any, _: BagSensor) -> Sample | str:
    """Flag 1 is valid; the velocity through the water stands in where the bottom is lost."""
    own = {key.lower(): getattr(m, key) for key in type(m).__dataclass_fields__}
    bottom = own["velocityinstflag"] == 1
    velocity = own["velocityinst"] if bottom else own["watervelocityinst"]
    valid = bottom or own["watervelocityinstflag"] == 1
    x, y, z = (float(v) for v in velocity)
    return over_ground((x, y, z), np.nan, valid, own["altitude"], bottom)


def depth(m: Any, _: BagSensor) -> Sample | str:
    """Depth, positive down."""
    return {"depth_m": m.depth, "sigma": np.nan}


def ping360(m: Any, card: BagSensor) -> Sample | str:
    """Echoes over ``range`` metres at ``angle`` rad."""
    if not len(m.intensities) or not m.range:
        return "no echoes"
    angle = m.angle if card.clockwise else -m.angle
    return {"angle": angle, "range_m": m.range, "intensity": m.intensities}


def range_image_beam(m: Any, card: BagSensor) -> Sample | str:
    """Echoes over ``max_range`` metres at ``angle_rad``; more than 255 is 255."""
    echoes = np.asarray(m.beam_data)
    if not len(echoes) or not m.max_range:
        return "no echoes"
    angle = m.angle_rad if card.clockwise else -m.angle_rad
    return {"angle": angle, "range_m": m.max_range, "intensity": np.clip(echoes, 0, 255)}
