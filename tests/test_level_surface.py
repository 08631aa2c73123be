"""Far from the mission's origin the water lies below the plane of its NED."""

from __future__ import annotations

import numpy as np
import pytest

import gtsam_nav as gn
from gtsam_nav.frames import Origin, ned_from_geodetic, sag_m
from gtsam_nav.mission import InitialState, Mission, Sensor
from gtsam_nav.series import (
    DepthSeries,
    DvlSeries,
    GnssSeries,
    HeadingSeries,
    LandmarkSeries,
    Series,
)

ORIGIN = Origin(42.2, 3.1, 50.0)
FAR_N = np.array([24_000.0, 18_000.0])
DEPTH_M = 2.0


def far_away() -> Mission:
    """Goes north by 60 m at a depth of 2 m, 30 km from the origin, and sees a landmark at first."""
    t = np.arange(0.0, 60.0, 0.2)
    n = len(t)
    seen = t[t < 2.0][::5]
    m = len(seen)
    series: dict[str, Series] = {
        "dvl": DvlSeries(
            t=t,
            v_d=np.tile([1.0, 0.0, 0.0], (n, 1)),
            sigma=np.full(n, 0.02),
            valid=np.ones(n, dtype=bool),
            bottom_lock=np.ones(n, dtype=bool),
        ),
        "heading": HeadingSeries(t=t, heading=np.zeros(n), sigma=np.full(n, 0.01)),
        "depth": DepthSeries(t=t, depth_m=np.full(n, DEPTH_M), sigma=np.full(n, 0.02)),
        "landmarks": LandmarkSeries(
            t=seen,
            id=np.zeros(m, dtype=int),
            range_m=10.0 - seen,
            bearing=np.zeros(m),
            sigma_range=np.full(m, 0.1),
            sigma_bearing=np.full(m, 0.02),
        ),
    }
    return Mission(
        "far",
        {name: Sensor(name, name, one) for name, one in series.items()},
        origin=ORIGIN,
        initial=InitialState(p_n=np.append(FAR_N, 0.0), sigma_p=0.1),
    )


@pytest.mark.parametrize("method", ["dr", "landmark-ekf", "graph"])
def test_a_depth_is_below_the_water_of_its_place(method: str) -> None:
    p_n = gn.estimate(far_away(), method).trajectory.p_n
    assert p_n[-1, 2] == pytest.approx(DEPTH_M + sag_m(p_n[-1], ORIGIN), abs=0.05)
    assert p_n[-1, 2] == pytest.approx(72.8, abs=0.2)


def test_without_a_gauge_dead_reckoning_keeps_to_the_level_surface() -> None:
    """A kilometre northward from a fix on the water sinks by 3.8 m in the plane of the NED."""
    t = np.arange(0.0, 1000.0, 1.0)
    n = len(t)
    dvl = DvlSeries(
        t=t,
        v_d=np.tile([1.0, 0.0, 0.0], (n, 1)),
        sigma=np.full(n, 0.02),
        valid=np.ones(n, dtype=bool),
        bottom_lock=np.ones(n, dtype=bool),
    )
    start = np.append(FAR_N, sag_m(np.append(FAR_N, 0.0), ORIGIN))
    fix = GnssSeries(t=t[:1], p_n=start[None], sigma=np.full((1, 3), 0.1))
    heading = HeadingSeries(t=t, heading=np.zeros(n), sigma=np.full(n, 0.01))
    sensors: dict[str, Series] = {"dvl": dvl, "gnss": fix, "heading": heading}
    aboard = {name: Sensor(name, name, one) for name, one in sensors.items()}
    mission = Mission("far", aboard, origin=ORIGIN)
    p_n = gn.estimate(mission, "dr", gn.Config(gnss={"use": "all"})).trajectory.p_n
    np.testing.assert_allclose(p_n[:, 2], sag_m(p_n, ORIGIN), atol=0.05)
    assert p_n[-1, 2] - p_n[0, 2] == pytest.approx(3.8, abs=0.3)


def test_the_sag_is_that_of_the_geodetic_surface() -> None:
    surface_n = ned_from_geodetic([42.4, 41.9], [3.2, 3.1], [50.0, 50.0], ORIGIN)
    np.testing.assert_allclose(sag_m(surface_n * [1.0, 1.0, 0.0], ORIGIN), surface_n[:, 2], 1e-4)
    np.testing.assert_array_equal(sag_m(surface_n, None), 0.0)
