"""Colours that must be told apart, also by the colour-blind and on dark ground."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from gtsam_nav.evaluation.plots.style import ACCEPTED, REFERENCE, REJECTED, method_colour
from gtsam_nav.frames import Array
from gtsam_nav.methods import methods

# Machado, Oliveira, Fernandes, A physiologically-based model for simulation of color vision
# deficiency, IEEE TVCG 15(6), 2009, severity 1, on linear RGB
VISIONS = {
    "full": np.eye(3),
    "no red": [[0.152, 1.053, -0.205], [0.115, 0.786, 0.099], [-0.004, -0.048, 1.052]],
    "no green": [[0.367, 0.861, -0.228], [0.280, 0.673, 0.047], [-0.012, 0.043, 0.969]],
    "no blue": [[1.256, -0.077, -0.179], [-0.078, 0.931, 0.148], [0.005, 0.691, 0.304]],
}
LEAST_DIFFERENCE = 0.07
"""In Oklab, where 0.02 can just be seen."""


def srgb(colour: str) -> Array:
    return np.array([int(colour[at : at + 2], 16) for at in (1, 3, 5)]) / 255.0


def oklab(rgb: Array, vision: str) -> Array:
    """Björn Ottosson's perceptual colour space, of what an eye makes of a colour."""
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    seen = np.clip(np.array(VISIONS[vision]) @ linear, 0.0, 1.0)
    cones = np.array([[0.4122, 0.5363, 0.0514], [0.2119, 0.6807, 0.1074], [0.0883, 0.2817, 0.6300]])
    lab = np.array(
        [[0.2105, 0.7936, -0.0041], [1.9780, -2.4286, 0.4506], [0.0259, 0.7828, -0.8087]]
    )
    return np.asarray(lab @ np.cbrt(cones @ seen))


@pytest.mark.parametrize("vision", VISIONS)
@pytest.mark.parametrize("ground", ["light", "dark"])
def test_methods_and_reference_are_told_apart(vision: str, ground: str) -> None:
    colours = {name: srgb(method_colour(name)) for name in methods()}
    if ground == "dark":
        # as the page's onGround has it
        colours = {name: rgb + 0.4 * (1.0 - rgb) for name, rgb in colours.items()}
    else:
        colours["reference"] = srgb(REFERENCE)
    for (a, rgb_a), (b, rgb_b) in combinations(colours.items(), 2):
        difference = np.linalg.norm(oklab(rgb_a, vision) - oklab(rgb_b, vision))
        assert difference > LEAST_DIFFERENCE, f"{a} and {b}: {difference:.3f}"


@pytest.mark.parametrize("vision", VISIONS)
def test_verdicts_are_told_apart(vision: str) -> None:
    accepted, rejected = (oklab(srgb(colour), vision) for colour in (ACCEPTED, REJECTED))
    assert np.linalg.norm(accepted - rejected) > LEAST_DIFFERENCE
