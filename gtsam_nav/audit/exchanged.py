"""Latitude and longitude under each other's names, where both are valid either way.

Fixes that are exchanged so draw the way's reflection, stretched: a degree of longitude is shorter
than one of latitude. The way by compass and velocities tells that from a compass that counts from
east, whose reflection is true to scale.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gtsam_nav.audit import fixes
from gtsam_nav.audit.courses import (
    BOW,
    Baselines,
    Velocity,
    baselines,
    compass_series,
    velocity_sources,
)
from gtsam_nav.audit.findings import Finding
from gtsam_nav.audit.heading import CONVENTIONS
from gtsam_nav.audit.significance import decided, losses
from gtsam_nav.frames import Array, Origin, geodetic_from_ned, ned_from_geodetic, wrap_angle
from gtsam_nav.mission import Mission
from gtsam_nav.series import BoolArray, GnssSeries


def exchanged_findings(mission: Mission) -> Iterator[Finding]:
    """Judge the fixes of the first receiver; says nothing where they are in order."""
    origin = mission.origin
    ways = None if origin is None else baselines(mission, compass_series(mission))
    meant = None if origin is None or ways is None else _exchanged(ways, origin)
    if ways is None or meant is None:
        return
    for velocity in velocity_sources(mission):
        covered = ways.covered(velocity)
        if np.sum(covered) > 2:
            yield from _judged(ways, meant, velocity, covered)
            return


def _judged(
    ways: Baselines, meant: Baselines, velocity: Velocity, covered: BoolArray
) -> Iterator[Finding]:
    compass = np.unwrap(ways.compass.heading)
    errors = [_errors(meant, compass, velocity)]
    errors += [_errors(ways, c.applied(compass), velocity) for c in CONVENTIONS]
    if decided(losses(np.array(errors)[:, covered])) == 0:
        by = "compass" if velocity.name == BOW else f"compass and {velocity.name}"
        message = (
            "latitude and longitude are exchanged, those of the origin too:"
            f" put right, their way is that by {by}"
        )
        fix = fixes.EXCHANGED_DEGREES
        yield Finding("fixes mirrored", ways.gnss.name, "warning", message, fix)


def _errors(ways: Baselines, heading: Array, velocity: Velocity) -> Array:
    """Of the direction of each baseline and, where velocities tell it, of its length."""
    reckoned, seen = ways.reckoned(heading, velocity), ways.seen(heading)
    ratio = _as_complex(reckoned) / _as_complex(seen)
    if velocity.name == BOW:
        return wrap_angle(np.angle(ratio))
    return np.asarray(np.hypot(np.angle(ratio), np.log(np.abs(ratio))))


def _as_complex(v_n: Array) -> NDArray[np.complex128]:
    """North and east as a complex number; one that is zero is given the least length."""
    z = v_n[:, 0] + 1j * v_n[:, 1]
    return np.asarray(np.where(z == 0, 1e-9, z))


def _exchanged(ways: Baselines, origin: Origin) -> Baselines | None:
    """The fixes with latitude and longitude exchanged; None where that leaves the globe."""
    latitude_deg, longitude_deg, height_m = geodetic_from_ned(ways.fixes.p_n, origin)
    if np.any(np.abs(longitude_deg) > 90.0):
        return None
    there = Origin(float(longitude_deg[0]), float(latitude_deg[0]), origin.height_m)
    p_n = ned_from_geodetic(longitude_deg, latitude_deg, height_m, there)
    meant = replace(ways.fixes, p_n=p_n)
    assert isinstance(meant, GnssSeries)
    return replace(ways, fixes=meant)
