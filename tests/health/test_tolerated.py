"""The end of a tolerance among the draws of a calibration."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from ballscrew.axis.axial_prior import prior, tolerated
from ballscrew.base.quantity import Quantity
from ballscrew.health.calibrated import Tolerated
from ballscrew.health.calibration import calibrate
from ballscrew.health.candidates import Form, forms
from ballscrew.health.fusion import draws
from ballscrew.health.preload import preload
from ballscrew.health.tolerated import found_within, kept_within, likelier

END = math.sqrt(3.0)
ROW = np.array([0.3, 0.0, 0.0, 0.1, 0.0, -0.2, 0.05])


def test_the_density_is_level_within_the_tolerance_and_integrates_to_one() -> None:
    z = np.linspace(-12.0, 12.0, 240_001)
    density = np.exp(likelier(z[:, None]) - z**2 / 2)
    assert float(np.sum(density) * (z[1] - z[0])) == pytest.approx(1.0, abs=1e-3)
    inside = density[np.abs(z) < END]
    assert inside.max() / inside.min() < 1.1
    assert float(np.sum(density[np.abs(z) > END]) * (z[1] - z[0])) == pytest.approx(0.02 * 0.3173, abs=2e-4)


def test_two_numbers_count_each_for_itself() -> None:
    pair = np.array([[0.3, 2.0], [-1.0, 0.0]])
    alone = likelier(pair[:, :1]) + likelier(pair[:, 1:])
    np.testing.assert_allclose(likelier(pair), alone)


def chosen(found: float, spread: float, prior_size: float = 1e-6) -> np.ndarray:
    """What is left of a number that a calibration puts at ``found`` ± ``spread``."""
    whole = np.outer(ROW, ROW) + prior_size * np.eye(7)
    drawn, beside = draws(spread**2 * np.outer(ROW, ROW), 1)
    at = kept_within([Tolerated("rigidity", ROW, found)], whole, drawn, beside)
    return np.asarray(found + drawn[at] @ ROW / float(ROW @ ROW))


def test_a_number_that_only_the_sheet_tells_ends_where_its_tolerance_does() -> None:
    left = chosen(0.0, 1.0)
    assert np.quantile(left, 0.975) == pytest.approx(1.69, abs=0.04)  # of a normal one 1.96
    assert np.quantile(left, 0.25) == pytest.approx(-END / 2, abs=0.05)  # of a normal one -0.67
    assert abs(np.mean(left)) < 0.02


def test_a_number_that_the_data_tell_stays_as_it_is() -> None:
    left = chosen(0.5, 0.1)
    assert np.mean(left) == pytest.approx(0.5, abs=0.02)
    assert np.std(left) == pytest.approx(0.1, rel=0.03)


@pytest.mark.parametrize("found", [2.5, 4.0, 40.0])
def test_where_the_data_know_better_the_tolerance_moves_nothing_much(found: float) -> None:
    left = chosen(found, 0.3)
    assert len(np.unique(left)) > 1000
    assert abs(np.mean(left) - found) < 0.6
    assert np.std(left) > 0.2


def test_what_the_vector_does_not_tell_is_drawn_beside_it() -> None:
    """A number whose effect drowns in what the model lacks is not bounded by it."""
    whole = np.outer(ROW, ROW) + 100.0 * np.eye(7)
    drawn, beside = draws(whole, 1)
    at = kept_within([Tolerated("rigidity", ROW, 0.0)], whole, drawn, beside)
    assert np.std(drawn[at][:, 0]) == pytest.approx(np.std(drawn[:, 0]), rel=0.05)
    assert np.quantile(beside[at, 0], 0.975) == pytest.approx(1.69, abs=0.05)


def test_without_tolerances_every_draw_counts_once() -> None:
    drawn, beside = draws(np.eye(7), 0)
    np.testing.assert_array_equal(kept_within((), np.eye(7), drawn, beside), np.arange(len(drawn)))


def test_the_prior_holds_what_is_tolerated(sheet) -> None:
    for form in forms(sheet, 0.225, 50.0):
        columns = np.stack(list(form.tolerated.values()), axis=1)
        left = form.covariance - columns @ columns.T
        assert np.linalg.eigvalsh(left).min() > -1e-9 * np.linalg.eigvalsh(form.covariance).max()
    assert set(tolerated(sheet, 0.225)) == {"rigidity", "stiffness", "preload_ratio"}


def test_a_vector_moved_by_one_number_is_found_there(sheet) -> None:
    mean, covariance = prior(sheet, 0.225)
    effects = tolerated(sheet, 0.225)
    form = Form("free rotor", mean, covariance, effects)
    for which in effects:
        found = {one.field: one.found for one in found_within(form, mean + effects[which])}
        assert found[which] == max(found.values())
        assert 0.5 < found[which] < 1.05


def test_a_sheet_without_tolerances_has_none(sheet) -> None:
    exact = replace(sheet, tolerances=dict.fromkeys(("rigidity", "stiffness", "preload_ratio"), 0.0))
    assert forms(exact, 0.225, 50.0)[0].tolerated == {}
    assert found_within(forms(exact, 0.225, 50.0)[0], prior(exact, 0.225)[0]) == ()


def test_a_preload_that_only_the_sheet_tells_lies_within_its_tolerance(experiment, sheet) -> None:
    runs = experiment()
    model = calibrate(runs, sheet)
    bounded = preload(runs[-2], model, runs[-1]).preload_N
    plain = preload(runs[-2], replace(model, tolerated=()), runs[-1]).preload_N
    assert bounded is not None
    assert plain is not None
    assert bounded.value == plain.value
    assert np.ptp(bounded.interval) < 0.99 * np.ptp(plain.interval)


def test_a_known_preload_leaves_the_sheet_little_to_say(experiment, sheet) -> None:
    runs = experiment()
    model = calibrate(runs, sheet, known={runs[0].id: Quantity(600.0, 6.0, "N")})
    bounded = preload(runs[-1], model).preload_N
    plain = preload(runs[-1], replace(model, tolerated=())).preload_N
    assert bounded is not None
    assert plain is not None
    np.testing.assert_allclose(bounded.interval, plain.interval, rtol=0.01)
