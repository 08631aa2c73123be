"""How a match answers to echoes that are not where they should be.

Echoes that are misplaced together, such as by an error of the motion while their scan was taken, do
not average out in a match as their own noise does. To first order the match moves by the
pseudo-inverse of its Hessian times what they add to its gradient: the implicit-function argument of
the covariance itself (Censi, *An accurate closed-form estimate of ICP's covariance*, 2007).
"""

from __future__ import annotations

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.registration.pic import observed_inverse
from gtsam_nav.registration.settings import PicSettings
from gtsam_nav.sonar.scans import Scan


def response(
    reference: Scan,
    new: Scan,
    q: Array,
    moved_reference: Array,
    moved_new: Array,
    settings: PicSettings,
) -> tuple[Array, Array]:
    """How far a match moves where the echoes of its scans are moved.

    Parameters
    ----------
    reference, new : Scan
        Of n and k echoes.
    q : ndarray, shape (3,)
        The match: pose of the new scan in the reference: x, y, yaw.
    moved_reference, moved_new : ndarray, shape (n, 2, m) and (k, 2, l)
        Displacements of the echoes, each in its scan's axes, m, in m and l ways, or none.
    settings : PicSettings

    Returns
    -------
    tuple of ndarray, shapes (3, m) and (3, l)
        By the reference and by the new scan; zero in directions that the match does not observe.
    """
    if moved_reference.shape[2] == moved_new.shape[2] == 0:
        return np.zeros((3, 0)), np.zeros((3, 0))
    from gtsam_nav.registration._pic_information import pulls

    H, by_reference, by_new = pulls(
        reference.xy,
        reference.cov,
        new.xy,
        new.cov,
        q,
        settings.wall_radius_m,
        settings.cauchy_k,
        moved_reference,
        moved_new,
    )
    gain = observed_inverse(H)
    return gain @ by_reference, gain @ by_new
