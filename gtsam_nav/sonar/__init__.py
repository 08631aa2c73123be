"""Scanning sonar: from echo profiles to scans and maps."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gtsam_nav.lazy import lazy_names

if TYPE_CHECKING:
    from gtsam_nav.sonar.echoes import Echoes as Echoes
    from gtsam_nav.sonar.echoes import segment as segment
    from gtsam_nav.sonar.motion import PlanarMotion as PlanarMotion
    from gtsam_nav.sonar.preparation import sonar_map as sonar_map
    from gtsam_nav.sonar.scans import Scan as Scan
    from gtsam_nav.sonar.scans import Turns as Turns
    from gtsam_nav.sonar.scans import find_turns as find_turns
    from gtsam_nav.sonar.scans import form_scans as form_scans

_PUBLIC = {
    "Echoes": "echoes",
    "segment": "echoes",
    "PlanarMotion": "motion",
    "sonar_map": "preparation",
    "Scan": "scans",
    "Turns": "scans",
    "find_turns": "scans",
    "form_scans": "scans",
}

__all__ = sorted(_PUBLIC)
__getattr__ = lazy_names(__name__, _PUBLIC)
