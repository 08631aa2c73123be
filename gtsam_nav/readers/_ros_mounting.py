"""Where the sensors of a bag sit: as a card says, or as its static transforms do."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gtsam_nav.cards import near_the_body
from gtsam_nav.errors import DataError
from gtsam_nav.frames import FLU_FROM_FRD, Array
from gtsam_nav.readers._ros_bag import Transform

BODY = "base_link"
WORLDS = ("map", "odom", "world", "earth", "world_ned", "odom_ned")

Mounting = tuple[Array, Array]
"""``R_bs`` (3, 3) and position (3,) in the body frame, forward, starboard, down."""


class Frames:
    """The static transforms of a bag.

    Parameters
    ----------
    transforms : mapping
        Frame to parent, rotation and translation, in ROS's axes.
    body_frame : str
        As a card names it; empty for ``base_link``, or what most frames hang from.

    Raises
    ------
    DataError
        Where a card names a body frame that the transforms do not.
    """

    def __init__(self, transforms: Mapping[str, Transform], body_frame: str = "") -> None:
        self._parents = transforms
        self.names = sorted({*transforms, *(parent for parent, _, _ in transforms.values())})
        wanted = body_frame.strip("/")
        if wanted and wanted not in self.names:
            choices = ", ".join(self.names) or "none: the bag has no static transforms"
            raise DataError(f"no static transform knows the body frame '{wanted}': {choices}")
        self.body = wanted or self._usual_body()

    def _usual_body(self) -> str:
        named = [name for name in self.names if name.rpartition("/")[2] == BODY]
        if named:
            return named[0]
        roots = [name for name in self.names if name not in self._parents and name not in WORLDS]
        return roots[0] if len(roots) == 1 else BODY

    def mounting(self, frame: str, *, turned: bool) -> Mounting | None:
        """Of a sensor; None where no chain of transforms leads from its frame to the body.

        Parameters
        ----------
        frame : str
        turned : bool
            Whether its samples were turned from the frame's axes to forward, starboard, down.
        """
        if frame == self.body:
            return np.eye(3), np.zeros(3)
        to_body = self._chain(frame)
        if to_body is None:
            return None
        R, p = to_body
        R_bs = FLU_FROM_FRD @ R
        return (R_bs @ FLU_FROM_FRD if turned else R_bs), FLU_FROM_FRD @ p

    def _chain(self, frame: str) -> Mounting | None:
        """Rotation and translation from a frame to the body, in ROS's axes."""
        up, down = self._to_root(frame), self._to_root(self.body)
        if not up or not down or up[-1][0] != down[-1][0]:
            return None
        (_, R_rs, p_rs), (_, R_rb, p_rb) = up[-1], down[-1]
        return R_rb.T @ R_rs, R_rb.T @ (p_rs - p_rb)

    def _to_root(self, frame: str) -> list[Transform]:
        """The frame's ancestors, each with the frame's place in it; none for a stranger."""
        if frame not in self.names:
            return []
        found: list[Transform] = [(frame, np.eye(3), np.zeros(3))]
        while found[-1][0] in self._parents and len(found) <= len(self.names):
            name, R, p = found[-1]
            parent, R_ps, p_ps = self._parents[name]
            found.append((parent, R_ps @ R, R_ps @ p + p_ps))
        return found


def check_near_the_body(sensor: str, mounting: Mounting) -> None:
    """Raise a DataError where the static transforms put a sensor farther than a vehicle reaches."""
    forward, starboard, down = mounting[1].tolist()
    try:
        near_the_body((forward, starboard, down))
    except ValueError as error:
        raise DataError(
            f"sensor '{sensor}' by the static transforms: {error}; a card may state its xyz_m"
        ) from error
