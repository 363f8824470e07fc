from __future__ import annotations

import numpy as np
import pytest
from tests.modal.joint.conftest import SmallRun

from ballscrew.modal.joint.fit import fit, with_places
from ballscrew.modal.joint.guess import whole_mass
from ballscrew.modal.joint.kernel import GIVE, LOAD_STEP
from ballscrew.modal.joint.local import Scatter, placed, priors, smooth, with_local
from ballscrew.modal.joint.model import block
from ballscrew.modal.joint.shape import Shape, compliance, frequency
from ballscrew.modal.joint.windows import windows

PLACES = (-0.2, -0.1, 0.05, 0.2)


def test_the_smooth_course_is_a_line_or_a_parabola() -> None:
    places = np.array(PLACES)
    for curved, power in ((False, 1), (True, 2)):
        basis = smooth(PLACES, curved)
        assert basis.T @ basis == pytest.approx(np.eye(power + 1), abs=1e-12)
        assert basis @ (basis.T @ places**power) == pytest.approx(places**power)


def test_parts_are_expected_to_be_0_within_the_spread_and_to_hold_no_smooth_course() -> None:
    found = priors(Scatter(0.02, 5.0), PLACES, curved=False)
    single = [p for p in found if len(p.fields) == 1]
    course = [p for p in found if len(p.fields) > 1]
    assert [p.fields[0][0] for p in single] == [f"local:{k}" for k in range(4)]
    assert all(p.deviation == pytest.approx(0.02) for p in single)
    assert len(course) == 2
    assert all(p.deviation < 0.001 for p in course)


def test_a_part_lowers_the_frequency_where_it_is() -> None:
    even = Shape(1e-6, 1.0, 0.0, 0.03, 0.1, 0.5, 0.1, 300.0, 0.03)
    bent = Shape(1e-6, 1.0, 0.0, 0.03, 0.1, 0.5, 0.1, 300.0, 0.03, PLACES, (0.0, 0.1, 0.0, 0.0))
    ratio = frequency(bent, np.array(PLACES)) / frequency(even, np.array(PLACES))
    assert ratio[[0, 2, 3]] == pytest.approx(1.0)
    assert ratio[1] == pytest.approx(np.sqrt(0.9 / 1.0), rel=1e-3)


def test_the_nut_gives_as_two_flanks_do() -> None:
    load = np.arange(len(GIVE)) * LOAD_STEP
    # Small loads: 1 + (F/P)²/216. One flank lets go at u = 1, F/P = 2^1.5, where 3 u = 3.
    assert np.interp(0.5, load, GIVE) == pytest.approx(0.25 / 216, rel=0.01)
    assert np.interp(2**1.5, load, GIVE) == pytest.approx(3 / 2**1.5 - 1, rel=2e-3)
    assert GIVE.max() == pytest.approx(6 / 3**1.5 - 1, rel=1e-3)


def test_places_are_seen_as_a_fit_of_no_step_would(run: SmallRun) -> None:
    mass = whole_mass(run.trips)
    assert mass is not None
    w = windows(run.trips, run.marks, mass, 90.0, 450.0)
    assert w is not None
    middle = float(np.mean(list(run.free.values())))
    shape = Shape(compliance(middle), 0.3, 0.0, 0.03, 0.0, 0.0, 0.0, 330.0, 0.03)
    blocks = [block(name, w, whole=False) for name in ("torque-nut", "motor-nut")]
    fields = ("compliance", "damping", "slope")
    ended = fit(blocks, [shape, shape], fields, most=4)
    places = tuple(sorted({cell[0] - w.middle for cell in w.cells}))
    wide = placed(ended.shapes, places)
    found = with_places(ended, wide, with_local((), places))
    other = fit(blocks, wide, with_local(fields, places), most=0)
    order = [found.keys.index(key) for key in other.keys]
    for one, two in zip(found.jacobian, other.jacobian, strict=True):
        np.testing.assert_allclose(one[:, order], two, rtol=1e-6, atol=1e-6 * np.abs(two).max())
    np.testing.assert_allclose(found.hessian[np.ix_(order, order)], other.hessian, rtol=1e-6)
