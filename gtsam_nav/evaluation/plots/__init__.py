"""The report's figures. Each function returns a matplotlib figure, or None for want of data."""

from __future__ import annotations

from gtsam_nav.evaluation.plots.consistency import ensemble_figure, mission_nees, mission_nis
from gtsam_nav.evaluation.plots.errors import horizontal_errors, position_errors
from gtsam_nav.evaluation.plots.heading import compass_bias, heading_errors, slow_states
from gtsam_nav.evaluation.plots.loops import loop_verdicts
from gtsam_nav.evaluation.plots.plan import plan_view
from gtsam_nav.evaluation.plots.style import save_png
from gtsam_nav.evaluation.plots.timeline import sensor_timeline
from gtsam_nav.evaluation.plots.weakness import position_sigma

__all__ = [
    "compass_bias",
    "ensemble_figure",
    "heading_errors",
    "horizontal_errors",
    "loop_verdicts",
    "mission_nees",
    "mission_nis",
    "plan_view",
    "position_errors",
    "position_sigma",
    "save_png",
    "sensor_timeline",
    "slow_states",
]
