"""The change of the compliance in each cell, against a baseline run or the model.

The axial compliance C of the axis at position x determines the natural frequency: f² ∝ 1/C at the same load
and with the same rotor. Only the nut's part of C depends on the preload P, with its power −1/3 (Hertz), so
that

    Y = (f₀/f)² − 1 = s(x) (u − 1),  u = (P/P₀)^(−1/3).

The reference f₀, P₀ is a baseline run, or the model where there is none; s(x) is the nut's share of the
compliance in the state of the reference. Y is linear in u, so that the estimate of u from all cells has a
closed form (:mod:`ballscrew.estimation.fusion`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ballscrew.axis.axial import PARAMETERS, AxialModel, frequency, gradient
from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.calibration.assumptions import DEFAULT_ASSUMPTIONS, Assumptions
from ballscrew.calibration.covariance import error_correlation, repeating_effects, with_repeating_load
from ballscrew.calibration.frequency_table import FrequencyTable, paired_cells
from ballscrew.calibration.worn_nut import frequency_loss_under_load
from ballscrew.estimation.change import DECLARED_LOAD, POSITION, ComplianceChange, ErrorTerm

BASELINE = "noise of the baseline"
BASELINE_PART = "new errors of the baseline"
WORN_NUT = "load on a worn nut"
"""Printed names of error terms. A tenth of the variance of an error that repeats is new in each run."""

# Effects of each repeating error on Y, shape (cells,). A key is the name of the error and its number among
# those of this name.
_RepeatingEffects = dict[tuple[str, int], Array]


def change_since(
    run: FrequencyTable,
    baseline: FrequencyTable,
    model: AxialModel,
    bearing_share: float,
    reference_ratio: float = 1.0,
    assumptions: Assumptions = DEFAULT_ASSUMPTIONS,
    load_change: float = 0.0,
    ratio: float = 1.0,
    covariance: Array | None = None,
) -> ComplianceChange:
    """Change of the compliance since a baseline.

    Errors that repeat from run to run cancel, except for the part of their variance that is new in each run.

    Parameters
    ----------
    run, baseline : FrequencyTable
        At about the same load.
    model : AxialModel
        Of the axis; its frequencies are not used, only its masses and its shares of the compliance.
    bearing_share : float
        Share of the support bearing, or of both, of the model's compliance at its centre.
    reference_ratio : float
        P₀/P_ref, the preload of the baseline over the model's reference preload.
    assumptions : Assumptions
        Sizes of the errors that no run determines.
    load_change : float
        Load of the run less that of the baseline, kg; its effect is removed from Y.
    ratio : float
        P/P₀ for which the softening of a worn nut by the test's own load is corrected, see
        :func:`~ballscrew.calibration.worn_nut.frequency_loss_under_load`.
    covariance : ndarray, shape (7, 7), optional
        Of the model's working vector (:func:`ballscrew.axis.axial.to_vector`), for the uncertainty of the
        effect of the load change; without it this uncertainty is omitted.

    Returns
    -------
    ComplianceChange
        Of the cells that both runs contain.

    Raises
    ------
    InputError
        If the runs have no cell in common, or the change of the load exceeds the moving mass.
    """
    rows, baseline_rows = paired_cells(run, baseline)
    if not rows:
        raise InputError(
            f"{run.name} and the baseline {baseline.name} have no good cell in common; a "
            "change requires the same stops, conditions and motions."
        )
    f = run.frequency[rows]
    f0 = baseline.frequency[baseline_rows]
    # f is too low by the loss, and (f₀/f)² contains the effect of the load change.
    loss, loss_spread = frequency_loss_under_load(baseline, baseline_rows, ratio, assumptions)
    by_load_change = _squared_frequency_ratio(model, baseline.load, load_change)
    y = (f0 / (f * (1 + loss))) ** 2 / by_load_change - 1
    per_log_frequency = 2 * (1 + y)  # |dY/d ln f|, and the same for f₀
    per_hertz = per_log_frequency / f
    baseline_per_hertz = per_log_frequency / f0
    own = per_hertz * run.own[rows]
    baseline_own = baseline_per_hertz * baseline.own[baseline_rows]
    random, repeating = _split_effects(run, rows, per_hertz)
    baseline_random, baseline_repeating = _split_effects(baseline, baseline_rows, baseline_per_hertz)
    terms = [
        ErrorTerm("noise of this run", True, np.vstack([random, np.diag(own)])),
        ErrorTerm(BASELINE, False, np.vstack([baseline_random, np.diag(baseline_own)])),
        *_repeating_terms(repeating, baseline_repeating, assumptions.repeats, len(rows)),
    ]
    if covariance is not None and load_change != 0:
        spread = _mass_uncertainty(model, covariance, baseline.load, load_change)
        terms.append(ErrorTerm("mass of the model", False, ((1 + y) * spread)[None]))
    terms.append(ErrorTerm(WORN_NUT, False, (per_log_frequency * loss_spread)[None]))
    reference = _Reference(model, bearing_share, reference_ratio, baseline.load + load_change)
    # Two independent errors, of the load from run to run and of its declared change, each relative to its
    # value.
    declared_load = math.hypot(run.load, load_change)
    return _change(
        reference, run, rows, y, terms, assumptions,
        own=np.hypot(own, baseline_own), declared_load=declared_load,
    )  # fmt: skip


def change_from_model(
    run: FrequencyTable,
    model: AxialModel,
    bearing_share: float,
    assumptions: Assumptions = DEFAULT_ASSUMPTIONS,
    ratio: float = 1.0,
) -> ComplianceChange:
    """Change of the compliance against the model at its reference preload.

    Parameters
    ----------
    run : FrequencyTable
        Of n cells.
    model : AxialModel
        Of the axis.
    bearing_share : float
        Share of the support bearing, or of both, of the model's compliance at its centre.
    assumptions : Assumptions
        Sizes of the errors that no run determines.
    ratio : float
        P/P_ref by which the error of the run's frequencies by the load on a worn nut is corrected.

    Returns
    -------
    ComplianceChange
        Of all cells. The errors of the model's parameters are not among the terms: they follow from the
        covariance of the model and ``by_parameters``.
    """
    rows = list(range(len(run.frequency)))
    f = run.frequency
    loss, loss_spread = frequency_loss_under_load(run, rows, ratio, assumptions)
    y = (frequency(model, run.position, run.load) / (f * (1 + loss))) ** 2 - 1
    per_log_frequency = 2 * (1 + y)  # |dY/d ln f|
    per_hertz = per_log_frequency / f
    own = per_hertz * run.own
    random, repeating = _split_effects(run, rows, per_hertz)
    terms = [
        ErrorTerm("noise of this run", True, np.vstack([random, np.diag(own)])),
        # All of it: the part that is new in each run is not separated.
        ErrorTerm("errors that repeat", False, _stacked([*repeating.values()], len(rows))),
        ErrorTerm(WORN_NUT, False, (per_log_frequency * loss_spread)[None]),
    ]
    # ∂ ln f by the working vector; the last column, by ln(P/P_ref), is omitted.
    gradients = gradient(model, run.position, run.load)[:, : len(PARAMETERS)]
    return _change(
        _Reference(model, bearing_share, 1.0, run.load), run, rows, y, terms, assumptions,
        own=own, declared_load=run.load, by_parameters=per_log_frequency * gradients.T,
    )  # fmt: skip


def load_sensitivity(model: AxialModel, load: float) -> float:
    """Relative change of 1 + Y = (f₀/f)² per kg of load that was not declared, 1/kg.

    It is −d ln f²/dm, where f² ∝ (1/m + 1/m_r)/C with the moving mass m and the mass m_r of the rotor, its
    inertia referred to the table.

    Parameters
    ----------
    model : AxialModel
        With the moving mass without load and the rotor, kg.
    load : float
        On the table, kg.

    Returns
    -------
    float
        1/kg.
    """
    moving = model.mass + load
    return 1 / (moving * (1 + moving / model.rotor))


def _split_effects(run: FrequencyTable, rows: list[int], scale: Array) -> tuple[Array, _RepeatingEffects]:
    """Effects of a run's shared errors on Y, split into random and repeating ones.

    They are those of :func:`ballscrew.calibration.covariance.joint_covariance`, except for the error by the
    load on the nut. A run states this error as random, since it depends on the wear of the nut, which is not
    known when the frequencies are estimated. Here the wear is estimated, and
    :func:`~ballscrew.calibration.worn_nut.frequency_loss_under_load` corrects the frequencies for it. The
    error that remains is the same in each run.

    Parameters
    ----------
    run : FrequencyTable
        The run.
    rows : list of int
        Rows of its cells that are compared.
    scale : ndarray, shape (rows,)
        |dY/df| of each cell, 1/Hz.

    Returns
    -------
    random : ndarray, shape (k, rows)
        Effects on Y of k errors that differ from run to run.
    repeating : dict of (str, int) to ndarray, shape (rows,)
        Effects on Y of each error that repeats.
    """
    run = with_repeating_load(run)
    repeating = {key: effects[rows] * scale for key, effects in repeating_effects(run).items()}
    random = run.shared[~run.repeats][:, rows] * scale
    return random, repeating


def _repeating_terms(
    effects: _RepeatingEffects, baseline_effects: _RepeatingEffects, correlation: float, count: int
) -> list[ErrorTerm]:
    """Error terms of errors that repeat.

    The part of an error that is common to both runs changes Y by the difference of its two effects. The rest
    of its variance, and an error that only one run states, is independent between the runs.

    Parameters
    ----------
    effects, baseline_effects : dict of (str, int) to ndarray, shape (count,)
        Effects on Y of the repeating errors of the run and of the baseline.
    correlation : float
        Correlation of a repeating error from run to run.
    count : int
        Number of cells.

    Returns
    -------
    list of ErrorTerm
        Three: common to both runs, of the run alone, of the baseline alone.
    """
    common, of_run, of_baseline = [], [], []
    for key in sorted(effects.keys() | baseline_effects.keys()):
        if key not in baseline_effects:
            of_run.append(effects[key])
        elif key not in effects:
            of_baseline.append(baseline_effects[key])
        else:
            repeated = error_correlation(key[0], correlation)
            common.append(math.sqrt(repeated) * (effects[key] - baseline_effects[key]))
            of_run.append(math.sqrt(1 - repeated) * effects[key])
            of_baseline.append(math.sqrt(1 - repeated) * baseline_effects[key])
    return [
        ErrorTerm("errors that repeat", False, _stacked(common, count)),
        ErrorTerm("new errors of this run", True, _stacked(of_run, count)),
        ErrorTerm(BASELINE_PART, False, _stacked(of_baseline, count)),
    ]


def _stacked(effects: list[Array], count: int) -> Array:
    """Effects as the rows of an array, shape (k, count); k may be 0."""
    return np.array(effects).reshape(-1, count)


@dataclass(frozen=True, slots=True)
class _Reference:
    """State that a change refers to.

    ``bearing_share`` is the share of the support bearing, or of both, of the model's compliance at its
    centre, ``preload_ratio`` is P₀/P_ref, and ``load`` is that of the run, with its correction, kg.
    """

    model: AxialModel
    bearing_share: float
    preload_ratio: float
    load: float


def _change(
    reference: _Reference,
    run: FrequencyTable,
    rows: list[int],
    y: Array,
    terms: list[ErrorTerm],
    assumptions: Assumptions,
    *,
    own: Array,
    declared_load: float,
    by_parameters: Array | None = None,
) -> ComplianceChange:
    """The change ``y`` of the cells ``rows``, with their shares of the compliance and all error terms.

    ``terms`` are those of the runs, to which those of the assumptions are added; ``declared_load`` is the
    load to which the relative error of the assumptions applies, kg. The rest are fields of
    :class:`ComplianceChange`.
    """
    model = reference.model
    x = run.position[rows]
    # Compliance in the state of the reference, over the model's at its centre and P_ref.
    from_centre = x - model.centre
    u0 = reference.preload_ratio ** (-1 / 3)
    compliance = 1 + model.slope * from_centre + model.curve * from_centre**2 + model.share * (u0 - 1)
    log_slope = (model.slope + 2 * model.curve * from_centre) / compliance
    by_load = load_sensitivity(model, reference.load) * (1 + y)
    per_log_frequency = 2 * (1 + y)  # |dY/d ln f|
    z = _normalised_position(x)
    tilt = assumptions.tilt * y * z  # in proportion to the change
    # A calibration fits level and slope along the axis, the Legendre polynomials of orders 0 and 1. The error
    # of the model's form is assumed to consist of those of orders 2 and 3, and is relative to f. A change
    # since a baseline keeps it in full: the change itself may have another form than the model's.
    quadratic = 1.5 * z**2 - 0.5
    cubic = 2.5 * z**3 - 1.5 * z
    form = per_log_frequency * (assumptions.form * np.stack([quadratic, cubic]))
    return ComplianceChange(
        position=x,
        condition=tuple(run.condition[i] for i in rows),
        motion=tuple(run.motion[i] for i in rows),
        y=y,
        nut_share=model.share * u0 / compliance,
        bearing_share=reference.bearing_share / compliance,
        log_slope=log_slope,
        by_load=by_load,
        frequency=run.frequency[rows],
        moving_mass=model.mass + reference.load,
        terms=(
            *terms,
            ErrorTerm(DECLARED_LOAD, False, (by_load * assumptions.load * declared_load)[None]),
            ErrorTerm(POSITION, False, ((1 + y) * log_slope * assumptions.position)[None]),
            ErrorTerm("shape of the model", False, np.vstack([tilt, form])),
        ),
        floor=math.sqrt(2) * assumptions.floor * per_log_frequency,  # √2: f and a measured f₀
        by_parameters=by_parameters,
        own=own,
    )


def _squared_frequency_ratio(model: AxialModel, load: float, added: float) -> float:
    """(f₀/f)² of the frequencies at ``load`` and at ``load + added``, kg, with the same compliance."""
    before = model.mass + load
    after = before + added
    if not after > 0:
        raise InputError(f"a load {added:+.3g} kg from the baseline's {load:.3g} kg leaves no mass.")
    return (1 / before + 1 / model.rotor) / (1 / after + 1 / model.rotor)


def _mass_uncertainty(model: AxialModel, covariance: Array, load: float, added: float) -> float:
    """Standard uncertainty of the logarithm of :func:`_squared_frequency_ratio` by the model's masses."""
    inverse_rotor = 1 / model.rotor
    inverse_moving = np.array([1 / (model.mass + load), 1 / (model.mass + load + added)])
    # Derivatives of ln f² at the two loads with respect to ln mass and ln rotor, as in the working vector.
    by_mass = -model.mass * inverse_moving**2 / (inverse_moving + inverse_rotor)
    by_rotor = -inverse_rotor / (inverse_moving + inverse_rotor)
    gradients = np.array([by_mass[0] - by_mass[1], by_rotor[0] - by_rotor[1]])
    rows = [PARAMETERS.index("mass"), PARAMETERS.index("rotor")]
    return math.sqrt(max(float(gradients @ covariance[np.ix_(rows, rows)] @ gradients), 0.0))


def _normalised_position(x: Array) -> Array:
    """Position scaled to −1 at the first stop and 1 at the last; zeros where there is one stop."""
    half_travel = float(np.ptp(x)) / 2
    if not half_travel > 0:
        return np.zeros_like(x)
    return np.asarray((x - (x.min() + half_travel)) / half_travel)
