"""From a mission's sonars to deskewed scans, and from a trajectory to the map: for every method."""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np

from gtsam_nav.mission import Mission, Rejection, Sensor
from gtsam_nav.preprocess.no_returns import without_no_returns
from gtsam_nav.solution import SonarMap, SonarScans
from gtsam_nav.sonar.defects import WHOLE_SENSOR, sonar_defect
from gtsam_nav.sonar.echoes import Echoes, echoes_of_scans, segment
from gtsam_nav.sonar.motion import PlanarMotion, placed_in_plane
from gtsam_nav.sonar.scans import (
    Scan,
    Turns,
    find_turns,
    form_scans,
    thin_by_motion,
    thin_scans,
)
from gtsam_nav.sonar.settings import SegmentationSettings, SonarSettings
from gtsam_nav.trajectory import Trajectory

log = logging.getLogger(__name__)

AT_ONCE_S = 1.0
"""Scans that follow each other faster took too little time to be bent by the motion."""


@dataclass(frozen=True)
class SonarData:
    """Echoes of a mission, cut into scans and deskewed by the vehicle's own motion.

    Attributes
    ----------
    echoes : Echoes
    turns : Turns
    scans : list of Scan
    at_once : bool
        Whether each scan was taken at once, so that motion does not bend it.
    """

    echoes: Echoes
    turns: Turns
    scans: list[Scan]
    at_once: bool = False

    def of_least(self, min_points: int) -> SonarData | None:
        """The scans that hold so many points, with their echoes; None without any."""
        enough = np.array([len(scan) >= min_points for scan in self.scans])
        if not np.any(enough):
            return None
        turns = self.turns.select(enough)
        echoes = self.echoes.select(turns.hold(self.echoes.beam))
        scans = [scan for scan in self.scans if len(scan) >= min_points]
        return SonarData(echoes, turns, scans, self.at_once)


def leave_out_defective_sonar(
    mission: Mission, settings: SonarSettings
) -> tuple[Mission, Echoes | None, tuple[Rejection, ...], tuple[str, ...]]:
    """The mission with the one sonar to be used, and its echoes; why others are not is recorded."""
    rejections: list[Rejection] = []
    warnings: list[str] = []
    used: str | None = None
    echoes: Echoes | None = None
    for sonar in [*mission.of_type("beams"), *mission.of_type("scans")]:
        if not settings.use:
            defect = "switched off by sonar.use"
        elif used is not None:
            defect = f"the sonar '{used}' is used"
        else:
            sonar, no_returns = without_no_returns(sonar)
            defect = sonar_defect(sonar)
            if not defect:
                found = _echoes(sonar, settings.segmentation)
                defect = "" if len(found) else "no echo stands out of its noise"
        if not defect:
            used, echoes, mission = sonar.name, found, mission.with_sensor(sonar)
            warnings += no_returns
            continue
        log.warning("sonar '%s' is not used: %s", sonar.name, defect)
        rejections.append(Rejection(float(sonar.series.t[0]), sonar.name, WHOLE_SENSOR, defect))
        mission = mission.without(sonar.name)
    warnings += [f"sonar '{r.sensor}' is not used: {r.reason}" for r in rejections]
    return mission, echoes, tuple(rejections), tuple(warnings)


def _echoes(sonar: Sensor, settings: SegmentationSettings) -> Echoes:
    if sonar.type == "beams":
        return segment(sonar, settings)
    return echoes_of_scans(sonar)


def scans_at_once(mission: Mission) -> bool:
    """Whether the sonar in use is a scanner, such as a laser, whose scans are taken at once."""
    scans = mission.first("scans")
    if scans is None or mission.first("beams") is not None or len(scans.series) < 2:
        return False
    return bool(np.median(np.diff(scans.series.t)) < AT_ONCE_S)


def sonar_turns(
    mission: Mission, settings: SonarSettings, motion: PlanarMotion | None = None
) -> Turns | None:
    """Turns of the one sonar that is left, thinned; None without a sonar or a single turn.

    Scans that are taken at once are thinned by the motion, where it is given.
    """
    sonar = mission.first("beams") or mission.first("scans")
    if sonar is None:
        return None
    turns, s = find_turns(sonar, settings.scans.max_gap_s), settings.scans
    if motion is not None and scans_at_once(mission):
        kept = thin_by_motion(turns.t_ref, motion, s.min_move_m, np.radians(s.min_turn_deg))
    else:
        kept = thin_scans(turns.t_ref, s.min_interval_s)
    turns = turns.select(kept)
    return turns if len(turns) else None


def deskewed(
    echoes: Echoes, turns: Turns, motion: PlanarMotion, at_once: bool = False
) -> SonarData:
    """The echoes that lie in a turn, and the scans that they make once the motion is taken out."""
    echoes = echoes.select(turns.hold(echoes.beam))
    return SonarData(echoes, turns, form_scans(echoes, turns, motion), at_once)


def registered_scans(mission: Mission, data: SonarData) -> SonarScans | None:
    """The scans as they were registered, for the record; None without a sonar in the mission."""
    sonar = mission.first("beams") or mission.first("scans")
    if sonar is None:
        return None
    sizes = [len(scan) for scan in data.scans]
    return SonarScans(
        sensor=sonar.name,
        t=data.turns.t_ref,
        first_beam=data.turns.first,
        last_beam=data.turns.last,
        first=np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64),
        xy=np.concatenate([scan.xy for scan in data.scans]),
    )


def sonar_map(echoes: Echoes, trajectory: Trajectory) -> SonarMap:
    """All echoes of the used scans where the trajectory puts them."""
    inside = (echoes.t >= trajectory.t[0]) & (echoes.t <= trajectory.t[-1])
    p_n = placed_in_plane(trajectory, echoes.t[inside], echoes.xy_b[inside])
    return SonarMap(p_n, echoes.t[inside], echoes.strength[inside])
