"""The change of the compliance in every cell, against a baseline run or the model.

The axial compliance C of the axis at position x determines the natural frequency: f² ∝ 1/C at the same load
and with the same rotor. Only the nut's part of C depends on the preload, so that

    Y = (f₀/f)² − 1 = s(x) [(P/P₀)^(−1/3) − 1].

The reference f₀, P₀ is a baseline run, or the model where there is none; s(x) is the nut's share of the
compliance in the state of the reference. Y is linear in u = (P/P₀)^(−1/3), so all cells are fused in closed
form.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ballscrew.axis.axial import PARAMETERS, AxialModel, frequency, gradient
from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.calibration.assumptions import DEFAULT_ASSUMPTIONS, Assumptions
from ballscrew.calibration.covariance import repeating_effects, with_repeating_load
from ballscrew.calibration.frequency_table import FrequencyTable, paired_cells
from ballscrew.calibration.worn_nut import frequency_loss_under_load
from ballscrew.estimation.change import DECLARED_LOAD, POSITION, ComplianceChange, ErrorTerm

BASELINE = "noise of the baseline"
BASELINE_PART = "the baseline's part"
WORN_NUT = "load on a worn nut"
"""Names of error terms, as printed; the baseline's part is of the errors that repeat."""

# Effects on Y of the cells by each error that repeats; keys are its name and its number among those of that
# name.
_Repeating = dict[tuple[str, int], Array]


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

    Errors that repeat from run to run cancel, except for the part of them that is new in each run.

    Parameters
    ----------
    run, baseline : FrequencyTable
        At about the same load.
    model : AxialModel
        Of the axis; only its shares of the compliance and its masses are used.
    bearing_share : float
        The thrust bearing's share of the model's compliance at its centre.
    reference_ratio : float
        P₀/P_ref: preload of the baseline over the model's reference preload.
    assumptions : Assumptions
        For the errors that no run shows.
    load_change : float
        Load of the run less that of the baseline, kg; its effect is removed from Y.
    ratio : float
        P/P₀ for which the softening of a worn nut by the test's own load is corrected, see
        :func:`~ballscrew.calibration.worn_nut.frequency_loss_under_load`.
    covariance : ndarray, shape (7, 7), optional
        Of the model's working vector (:func:`ballscrew.axis.axial.to_vector`), for the uncertainty of the
        effect of the load change.

    Returns
    -------
    ComplianceChange
        Of the cells that both runs have.

    Raises
    ------
    InputError
        If no cell is common to both.
    """
    rows, baseline_rows = paired_cells(run, baseline)
    if not rows:
        raise InputError(
            f"{run.name} and the baseline {baseline.name} have no good cell in common; a "
            "change requires the same stops, conditions and motions."
        )
    f, f0 = run.frequency[rows], baseline.frequency[baseline_rows]
    # f is too low by the loss; (f₀/f)² has grown by the load as well as by the compliance.
    loss, loss_spread = frequency_loss_under_load(baseline, baseline_rows, ratio, assumptions)
    by_load_change = _squared_frequency_ratio(model, baseline.load, load_change)
    y = (f0 / (f * (1 + loss))) ** 2 / by_load_change - 1
    per_log_frequency = 2 * (1 + y)  # |dY/d ln f|
    per_hertz, baseline_per_hertz = per_log_frequency / f, per_log_frequency / f0
    own, baseline_own = per_hertz * run.own[rows], baseline_per_hertz * baseline.own[baseline_rows]
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
    # The load and its change have independent errors, both in proportion.
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
        One run.
    model : AxialModel
        Of the axis.
    bearing_share : float
        The thrust bearing's share of the model's compliance at its centre.
    assumptions : Assumptions
        For the errors that no run shows.
    ratio : float
        P/P_ref for which the softening of a worn nut by the test's own load is corrected.

    Returns
    -------
    ComplianceChange
        Of all cells. The errors of the model are not among the terms: they follow from ``by_parameters``.
    """
    rows = list(range(len(run.frequency)))
    f = run.frequency
    loss, loss_spread = frequency_loss_under_load(run, rows, ratio, assumptions)
    y = (frequency(model, run.position, run.load) / (f * (1 + loss))) ** 2 - 1
    per_log_frequency = 2 * (1 + y)  # |dY/d ln f|
    per_hertz = per_log_frequency / f
    own = per_hertz * run.own
    random, by_name = _split_effects(run, rows, per_hertz)
    repeating = np.array(list(by_name.values())).reshape(-1, len(rows))
    terms = [
        ErrorTerm("noise of this run", True, np.vstack([random, np.diag(own)])),
        ErrorTerm("errors that repeat", False, repeating),
        ErrorTerm(WORN_NUT, False, (per_log_frequency * loss_spread)[None]),
    ]
    gradients = gradient(model, run.position, run.load)[:, : len(PARAMETERS)]
    return _change(
        _Reference(model, bearing_share, 1.0, run.load), run, rows, y, terms, assumptions,
        own=own, declared_load=run.load, by_parameters=per_log_frequency * gradients.T,
    )  # fmt: skip


def load_sensitivity(model: AxialModel, load: float) -> float:
    """Relative change of 1 + Y = (f₀/f)² per kg of load that was not declared, 1/kg.

    f² ∝ (1/m + 1/m_r)/C with the moving mass m and the rotor's inertia m_r, referred to the table.
    """
    moving = model.mass + load
    return 1 / (moving * (1 + moving / model.rotor))


def _split_effects(run: FrequencyTable, rows: list[int], scale: Array) -> tuple[Array, _Repeating]:
    """Effects of a run's shared errors on Y, split into random and repeating ones.

    They are those of :func:`ballscrew.calibration.covariance.joint_covariance`, except for the load on the
    nut. A run lists the error by this load as random, since the wear of the nut is unknown when the frequency
    is estimated. Here the wear is estimated, and
    :func:`~ballscrew.calibration.worn_nut.frequency_loss_under_load` corrects for it; what remains of the
    error repeats.

    Parameters
    ----------
    run : FrequencyTable
        The run.
    rows : list of int
        Rows of the run that are compared.
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
    return run.shared[~run.repeats][:, rows] * scale, repeating


def _repeating_terms(
    effects: _Repeating, baseline_effects: _Repeating, correlation: float, count: int
) -> list[ErrorTerm]:
    """Terms of errors that repeat.

    An error of both runs acts by the difference of its two effects, as far as it is correlated from run to
    run. The rest of its variance, and an error of one run only, is independent.

    Parameters
    ----------
    effects, baseline_effects : dict
        Repeating effects of the run and of the baseline.
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
            common.append(math.sqrt(correlation) * (effects[key] - baseline_effects[key]))
            of_run.append(math.sqrt(1 - correlation) * effects[key])
            of_baseline.append(math.sqrt(1 - correlation) * baseline_effects[key])
    return [
        ErrorTerm("errors that repeat", False, np.array(common).reshape(-1, count)),
        ErrorTerm("this run's part of them", True, np.array(of_run).reshape(-1, count)),
        ErrorTerm(BASELINE_PART, False, np.array(of_baseline).reshape(-1, count)),
    ]


@dataclass(frozen=True, slots=True)
class _Reference:
    """State that a change refers to: model, bearing's share at its centre, P₀/P_ref, and load, kg."""

    model: AxialModel
    bearing_share: float
    ratio: float
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
    load whose relative error is assumed, kg. The rest are fields of :class:`ComplianceChange`.
    """
    model, x = reference.model, run.position[rows]
    # Compliance in the state of the reference, over the model's at its centre and P_ref.
    from_centre, u0 = x - model.centre, reference.ratio ** (-1 / 3)
    compliance = 1 + model.slope * from_centre + model.curve * from_centre**2 + model.share * (u0 - 1)
    bearing = reference.bearing_share / compliance
    slope = (model.slope + 2 * model.curve * from_centre) / compliance
    by_load = load_sensitivity(model, reference.load) * (1 + y)
    per_log_frequency = 2 * (1 + y)  # |dY/d ln f|
    z = _centred(x)
    tilt = assumptions.tilt * y * z  # a part of the change
    # Level and tilt of a model are fitted; the errors of its form are the next two Legendre polynomials, and
    # parts of the frequency.
    quadratic, cubic = 1.5 * z**2 - 0.5, 2.5 * z**3 - 1.5 * z
    form = per_log_frequency * (assumptions.form * np.stack([quadratic, cubic]))
    return ComplianceChange(
        position=x,
        condition=tuple(run.condition[i] for i in rows),
        motion=tuple(run.motion[i] for i in rows),
        y=y,
        nut=model.share * u0 / compliance,
        bearing=bearing,
        slope=slope,
        by_load=by_load,
        frequency=run.frequency[rows],
        moving_mass=model.mass + reference.load,
        terms=(
            *terms,
            ErrorTerm(DECLARED_LOAD, False, (by_load * assumptions.load * declared_load)[None]),
            ErrorTerm(POSITION, False, ((1 + y) * slope * assumptions.position)[None]),
            ErrorTerm("shape of the model", False, np.vstack([tilt, form])),
        ),
        floor=math.sqrt(2) * assumptions.floor * per_log_frequency,  # √2: of two frequencies
        by_parameters=by_parameters,
        own=own,
    )


def _squared_frequency_ratio(model: AxialModel, load: float, added: float) -> float:
    """(f₀/f)² of the frequencies at ``load`` and at ``load + added``, kg, with the same compliance."""
    before, after = model.mass + load, model.mass + load + added
    if not after > 0:
        raise InputError(f"a load {added:+.3g} kg from the baseline's {load:.3g} kg leaves no mass.")
    return (1 / before + 1 / model.rotor) / (1 / after + 1 / model.rotor)


def _mass_uncertainty(model: AxialModel, covariance: Array, load: float, added: float) -> float:
    """Standard uncertainty of the logarithm of :func:`_squared_frequency_ratio` by the model's masses."""
    inverse_rotor = 1 / model.rotor
    inverse_moving = np.array([1 / (model.mass + load), 1 / (model.mass + load + added)])
    # Derivatives of ln f² at the two loads by the logarithms of mass and rotor.
    by_mass = -model.mass * inverse_moving**2 / (inverse_moving + inverse_rotor)
    by_rotor = -inverse_rotor / (inverse_moving + inverse_rotor)
    gradients = np.array([by_mass[0] - by_mass[1], by_rotor[0] - by_rotor[1]])
    at = [PARAMETERS.index("mass"), PARAMETERS.index("rotor")]
    return math.sqrt(max(float(gradients @ covariance[np.ix_(at, at)] @ gradients), 0.0))


def _centred(x: Array) -> Array:
    """Position, linear from −1 at the first stop to 1 at the last; zeros for one stop."""
    half_travel = float(np.ptp(x)) / 2
    if not half_travel > 0:
        return np.zeros_like(x)
    return np.asarray((x - (x.min() + half_travel)) / half_travel)
