"""A mission made ready for any estimator: what its card, and what it contradicts itself in, say."""

from __future__ import annotations

from dataclasses import replace

from gtsam_nav.mission import Mission
from gtsam_nav.preprocess.agility import fitted_to
from gtsam_nav.preprocess.false_start import without_false_starts
from gtsam_nav.preprocess.fix_steps import with_fix_steps
from gtsam_nav.preprocess.poorer_fixes import with_poorer_fixes
from gtsam_nav.preprocess.receivers import with_best_receiver_first
from gtsam_nav.preprocess.settings import MotionSettings
from gtsam_nav.preprocess.slant_ranges import with_slant_ranges


def made_ready(mission: Mission, motion: MotionSettings) -> tuple[Mission, MotionSettings]:
    """The mission as estimators take it, with what is said of it, and settings that fit it.

    Parameters
    ----------
    mission : Mission
    motion : MotionSettings
        As configured.
    """
    mission = _with_stated_wheels(mission, motion.nonholonomic)
    mission = with_slant_ranges(without_false_starts(mission))
    mission = with_best_receiver_first(with_poorer_fixes(with_fix_steps(mission)))
    motion, notes = fitted_to(mission, motion)
    return replace(mission, warnings=(*mission.warnings, *notes)), motion


def _with_stated_wheels(mission: Mission, nonholonomic: bool | None) -> Mission:
    """A mission whose vehicle rolls where the configuration says so, whatever its card says."""
    if nonholonomic is None:
        return mission
    constraints = replace(mission.constraints, nonholonomic=nonholonomic)
    return replace(mission, constraints=constraints)
