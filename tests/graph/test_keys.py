"""Letters and indices of GTSAM's keys."""

from __future__ import annotations

import gtsam
import pytest

from gtsam_nav.graph.keys import index_of, letter_of


@pytest.mark.parametrize(("letter", "index"), [("b", 0), ("x", 7), ("s", 10**8 + 3)])
def test_a_key_is_read_as_gtsam_writes_it(letter: str, index: int) -> None:
    key = gtsam.symbol(letter, index)
    assert (letter_of(key), index_of(key)) == (letter, index)
