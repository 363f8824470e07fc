"""Blocks of a history: few, and never moved."""

from __future__ import annotations

import numpy as np
import pytest

from ballscrew.base.blocks import anchored_blocks


@pytest.mark.parametrize("singles", [1, 15, 30])
def test_blocks_are_joined_but_never_moved(singles: int) -> None:
    before = set(anchored_blocks(singles, singles).tolist())
    for count in range(singles + 1, 700):
        starts = anchored_blocks(count, singles)
        assert set(starts.tolist()) <= before | set(range(count - 1, count))
        assert starts[0] == 0
        assert (np.diff(starts) > 0).all()
        assert starts[-singles:].tolist() == list(range(count - singles, count))
        before = set(starts.tolist())


def test_few_runs_are_blocks_of_their_own_and_many_make_few() -> None:
    assert anchored_blocks(30, 30).tolist() == list(range(30))
    assert anchored_blocks(32, 30).tolist() == list(range(32))
    assert anchored_blocks(33, 30).tolist() == [0, *range(3, 33)]
    assert len(anchored_blocks(1825, 30)) < 85
    assert len(anchored_blocks(100_000, 30)) < 135
