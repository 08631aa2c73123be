"""How the dead reckoning walks from scan to scan."""

from __future__ import annotations

import numpy as np

import gtsam_nav as gn
from gtsam_nav.config import load_config
from gtsam_nav.ekf.scan_track import follow_scans
from gtsam_nav.ekf.scan_walk import way_variance
from gtsam_nav.simulation.settings import SimulationSettings, StartSimulation


def test_before_the_first_velocity_a_way_is_no_less_sure_than_after_it() -> None:
    """The filter starts from no velocity at all, which the first reading tells of the way before
    it too; the first scan's north was unsure by half a metre for a moment."""
    start = StartSimulation(sigma_position_m=0.1, sigma_heading_deg=0.5)
    settings = SimulationSettings.matched().model_copy(update={"start": start})
    mission = gn.simulate("marina", seed=0, duration_s=30.0, settings=settings)
    track = follow_scans(mission, load_config(None, ["gnss.use=none"]))
    assert track.filtered.P[1, 0, 0] > 0.5
    variance = way_variance(track.filtered, track.record)
    assert np.all(np.diff(variance) >= 0.0)
    assert variance[0] == track.filtered.P[0, 0, 0]
    assert np.sqrt(variance[1] - variance[0]) < 0.05
    assert np.sqrt(track.frame_cov[0].diagonal()).max() < 0.04
