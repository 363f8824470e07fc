from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import butter, sosfilt
from tests.recording.synthetic import changed, recorded, synthetic_trip

from ballscrew.recording.aligned import align
from ballscrew.recording.kinematics import kinematics
from ballscrew.recording.phases import find_phases
from ballscrew.recording.quality.high_pass import check_high_pass, undo_high_pass

RATE = 12800.0


def coupled(x, corner, order):
    return sosfilt(butter(order, corner, "high", fs=RATE, output="sos"), x)


def undone(recording):
    aligned = align(recording)
    motion = kinematics(aligned.position, aligned.rate)
    derived = (False,) * len(aligned.responses)
    return undo_high_pass(aligned, find_phases(motion), derived)


@pytest.mark.parametrize(("corner", "order"), [(0.3, 1), (1.0, 1), (5.0, 2)])
def test_a_high_pass_is_found_and_undone(run, corner, order):
    changed_run = changed(run.one, lambda _, x: coupled(x, corner, order), "acc1_x")
    before, none = undone(run.one)
    after, corners = undone(changed_run)
    assert max(none) == 0
    assert corners[0] == pytest.approx(corner, rel=0.05)
    assert set(corners[1:]) <= {0.0}
    middle = slice(len(after.position) // 4, len(after.position) // 2)
    rest = (after.response[0] - before.response[0])[middle]
    assert np.std(rest) < 0.1 * np.std(before.response[0][middle])
    names = [finding.code for finding in check_high_pass("a.h5", after.responses, corners)]
    assert names == (["high-pass"] if corner > 0.5 else [])


@pytest.mark.parametrize("signal", ["zero", "noise"])
def test_a_response_that_does_not_follow_the_encoder_has_no_corner(signal):
    random = np.random.default_rng(0)
    change = {"zero": lambda _, x: 0 * x, "noise": lambda _, x: random.standard_normal(len(x))}[signal]
    trip = recorded(synthetic_trip())
    after, corners = undone(changed(trip, change, "acc1_x"))
    assert corners == (0.0, 0.0)
    np.testing.assert_array_equal(after.response[1], undone(trip)[0].response[1])
