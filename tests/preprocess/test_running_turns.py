"""Running products of turns, of one spell after the other."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from gtsam_nav.preprocess.running_turns import running_turns


def test_turns_of_each_spell_multiply_in_their_order() -> None:
    rng = np.random.default_rng(3)
    lengths = (1, 5, 2, 13)
    turns = rng.normal(scale=0.8, size=(sum(lengths), 3))
    turns[4] = 0.0
    found = running_turns(turns, np.concatenate([np.arange(n) for n in lengths]))
    row = 0
    for n in lengths:
        total = Rotation.identity()
        for _ in range(n):
            total = total * Rotation.from_rotvec(turns[row])
            np.testing.assert_allclose(found[row], total.as_matrix(), atol=1e-12)
            row += 1
