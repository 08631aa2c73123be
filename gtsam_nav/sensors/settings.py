"""Settings of the sensors that every method treats alike."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from gtsam_nav.settings import Settings


class LandmarkSettings(Settings):
    """How sightings of landmarks are used.

    Attributes
    ----------
    use_map : bool
        Trust the mission's surveyed landmarks, where it has them; else all are learnt.
    association : {"ids", "nearest", "joint"}
        Which landmark a sighting is of: by the sensor's own ids, by the nearest compatible one
        each, or by joint compatibility of all sightings of a moment. The graph decides late: it
        follows a single hypothesis for "nearest", and the best few for "joint".
    gate_probability : float
        Probability of the chi-square gate on each sighting.
    new_probability : float
        A sighting without an id is of a new landmark only where it fails this wider gate for all
        that are known.
    """

    use_map: bool = True
    association: Literal["ids", "nearest", "joint"] = "ids"
    gate_probability: float = Field(default=0.999, gt=0, lt=1)
    new_probability: float = Field(default=0.99999, gt=0, lt=1)
