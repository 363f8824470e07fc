"""Uncertainty of the final fit: the frequencies by the responses of nut and motor are compared."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.modal.joint.conftest import SmallRun
from tests.modal.joint.test_ripple import first_fit

from ballscrew.modal.joint.blocks import make_block
from ballscrew.modal.joint.fit import SAMPLES_PER_INDEPENDENT, JointFit, Prior, fit_blocks
from ballscrew.modal.joint.local_wear import LocalVariation, shrinkage_covariance
from ballscrew.modal.joint.mode import FORM_DEVIATION, FORM_MEAN, mode_frequency
from ballscrew.modal.joint.uncertainty import (
    _cell_covariance,
    _condition_covariance,
    _frequency_gradient,
    cell_steps,
    nut_loads,
    response_difference,
    tie_slopes,
)
from ballscrew.modal.joint.windows import select_cells


@pytest.fixture(scope="module")
def both(run: SmallRun) -> JointFit:
    """Fit of both responses to the torque."""
    found, _ = first_fit(run)
    windows = found.blocks[0].windows
    blocks = [make_block(name, windows) for name in ("torque-nut", "torque-motor")]
    return fit_blocks(blocks, found.modes[:1], ("compliance", "damping", "slope"))


def test_a_cell_has_its_step_and_its_information_by_all_blocks(both: JointFit) -> None:
    windows = both.blocks[0].windows
    parameters = np.arange(len(windows.cells)) % len(both.parameters)
    steps, information = cell_steps(both, parameters, (0, 1))
    for cell, parameter in enumerate(parameters.tolist()):
        rows = [(index, both.blocks[index].rows[cell]) for index in (0, 1)]
        column = np.concatenate([both.jacobian[index][of_cell, parameter] for index, of_cell in rows])
        residual = np.concatenate([both.residual[index][of_cell] for index, of_cell in rows])
        assert steps[cell] == pytest.approx(np.linalg.lstsq(column[:, None], residual)[0][0])
        assert information[cell] == pytest.approx(np.sum(column**2))


def test_the_load_on_the_nut_is_inertia_and_friction_of_the_guide(both: JointFit) -> None:
    """Over the preload; and not the torque that overcomes friction."""
    b = both.blocks[0]
    count = len(b.windows.speed)
    w = replace(b.windows, force=np.full(count, 5.0), drag=np.full(count, 3.0), speed=np.full(count, 0.1))
    mode = replace(
        both.modes[0], mass_over_preload=0.2, nut_over_rest=0.5, friction=0.3, viscous=10.0, guide_part=0.4
    )
    loads, _ = nut_loads(replace(both, blocks=(replace(b, windows=w), *both.blocks[1:]), modes=(mode,)))
    assert loads == pytest.approx(np.full(len(w.cells), 0.2 * (5.0 - 3.0 + 0.4 * 10.0 * 0.1 + 0.3)))


def test_responses_of_one_mode_agree(both: JointFit) -> None:
    compared = response_difference(both)
    assert compared is not None
    difference, deviation = compared
    assert np.abs(difference).max() < 0.002 * both.modes[0].middle_frequency
    assert 0 < deviation.min() <= deviation.max() < 0.002 * both.modes[0].middle_frequency


@pytest.mark.parametrize(("nut", "motor"), [(0.0, 0.02), (0.0, -0.05), (0.02, 0.0), (0.03, 0.03)])
def test_a_response_of_another_frequency_differs_by_as_much(both: JointFit, nut: float, motor: float) -> None:
    """A softer mode at a response adds its derivative to the residual there, and no noise."""
    before = response_difference(both)
    compliance = both.parameters.index(("compliance", 0))
    residuals = []
    for block, change in enumerate((nut, motor)):
        residuals.append(both.residual[block] + change * both.jacobian[block][:, compliance])
    after = response_difference(replace(both, residual=tuple(residuals)))
    assert before is not None
    assert after is not None
    frequency = mode_frequency(both.modes[0], both.blocks[0].windows.stops)
    change = after[0] - before[0]
    assert change == pytest.approx((nut - motor) / 2 * frequency, rel=0.1, abs=1e-3 * frequency.mean())
    assert after[1] == pytest.approx(before[1], rel=0.2)


def test_errors_that_both_responses_share_cancel(both: JointFit) -> None:
    """Each cell alone is softer or stiffer, at the nut as at the motor."""
    compliance = both.parameters.index(("compliance", 0))
    changes = 0.02 * np.random.default_rng(1).standard_normal(len(both.blocks[0].windows.cells))

    def deviation(signs: tuple[int, int]) -> float:
        residuals = []
        for block, sign in enumerate(signs):
            residual = both.residual[block].copy()
            for rows, change in zip(both.blocks[block].rows, changes.tolist(), strict=True):
                residual[rows] += sign * change * both.jacobian[block][rows, compliance]
            residuals.append(residual)
        compared = response_difference(replace(both, residual=tuple(residuals)))
        assert compared is not None
        return float(compared[1].mean())

    assert deviation((1, 1)) < 0.5 * deviation((1, -1))


def test_one_response_has_no_difference(both: JointFit) -> None:
    assert response_difference(replace(both, blocks=both.blocks[:1])) is None


def test_tied_slopes_are_nearer_and_what_both_modes_share_stays(run: SmallRun) -> None:
    """A common parameter is not changed, so its covariance is not either."""
    found, _ = first_fit(run)
    fields = ("compliance", "slope", "damping_exponent")
    fit = fit_blocks([make_block(name, found.blocks[0].windows) for name in ("torque-nut", "motor-nut")],
                     (found.modes[0],) * 2, fields)  # fmt: skip
    none = np.zeros((len(fit.parameters),) * 2)
    loose, tied = (tie_slopes(fit, none, deviation, 0.3) for deviation in (1e6, 1e-6))
    assert tied.modes[0].slope == pytest.approx(tied.modes[1].slope, rel=1e-3)
    assert abs(fit.modes[0].slope - fit.modes[1].slope) > 1e-3 * abs(tied.modes[0].slope)
    shared = fit.parameters.index(("damping_exponent", None))
    for part in ("noise", "conditions"):
        before, after = getattr(loose, part), getattr(tied, part)
        assert before[shared, shared] > 0
        assert after[shared, shared] == pytest.approx(before[shared, shared], rel=1e-9)
        slope = fit.parameters.index(("slope", 0))
        assert after[slope, slope] < before[slope, slope]


def test_the_scatter_of_conditions_needs_two_of_them(both: JointFit) -> None:
    windows = both.blocks[0].windows
    numbers = [number for number, cell in enumerate(windows.cells) if cell.condition == "PA"]
    assert 0 < len(numbers) < len(windows.cells)
    blocks = [make_block("torque-nut", select_cells(windows, numbers))]
    alone = fit_blocks(blocks, both.modes[:1], ("compliance", "damping", "slope"))
    size = len(alone.parameters)
    np.testing.assert_array_equal(_condition_covariance(alone), np.zeros((size, size)))
    assert (np.diag(_condition_covariance(both)) > 0).all()


def with_form(both: JointFit, deviation: float | None) -> JointFit:
    """The fit with the form of a screw, which is not fitted, or with a prior of this standard deviation."""
    mode = replace(both.modes[0], form=FORM_MEAN, form_curve=0.05)
    fields: tuple[str, ...] = ("compliance", "damping", "slope")
    if deviation is None:
        return fit_blocks(both.blocks, (mode,), fields)
    prior = Prior((("form", 1.0),), FORM_MEAN, deviation)
    return fit_blocks(both.blocks, (mode,), (*fields, "form"), (prior,))


def test_a_parameter_that_its_prior_determines_does_not_count_as_one_of_the_data(both: JointFit) -> None:
    """And neither widens nor narrows the others."""
    fitted, fixed = with_form(both, 1e-6), with_form(both, None)
    others = [fitted.parameters.index(parameter) for parameter in fixed.parameters]
    covariance = _cell_covariance(fitted)[np.ix_(others, others)]
    assert covariance == pytest.approx(_cell_covariance(fixed), rel=1e-2, abs=1e-3 * covariance.max())


@pytest.mark.parametrize(("inflation", "expected"), [(1e9, 1.0), (1e-9, 0.0)])
def test_the_form_is_uncertain_by_its_prior_as_far_as_no_data_determine_it(
    both: JointFit, inflation: float, expected: float
) -> None:
    deviation = FORM_DEVIATION * float(np.sqrt(SAMPLES_PER_INDEPENDENT / inflation))
    found = with_form(both, deviation)
    covariance = shrinkage_covariance(found, LocalVariation(0.0, 1.0, prior_inflation=inflation))
    form = found.parameters.index(("form", None))
    assert covariance[form, form] == pytest.approx(expected * FORM_DEVIATION**2, abs=1e-3)


def test_the_gradient_by_the_form_is_the_difference_quotient(both: JointFit) -> None:
    fit = with_form(both, 0.5)
    place, step = np.array([-0.2, -0.05, 0.1]), 1e-5
    mode = fit.modes[0]
    shifted = [mode_frequency(replace(mode, form=mode.form + sign * step), place) for sign in (1, -1)]
    form = fit.parameters.index(("form", None))
    assert _frequency_gradient(fit, 0, place)[:, form] == pytest.approx(
        (shifted[0] - shifted[1]) / (2 * step), rel=1e-6
    )


def test_a_parameter_that_its_prior_determines_blurs_no_comparison_of_responses(both: JointFit) -> None:
    """As noise of its own step, from a single response, would."""
    fitted, fixed = (response_difference(with_form(both, deviation)) for deviation in (0.1, None))
    assert fitted is not None
    assert fixed is not None
    assert fitted[1] == pytest.approx(fixed[1], rel=0.02)  # without the prior up to 57 % larger
