"""Calibration: estimates, their uncertainties, outliers and refusals."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from benchmarks.axis_sampling import random_axis
from tests.calibration.tables import Errors, table

from ballscrew.axis.axial import PARAMETERS, frequency, from_sheet, from_vector, gradient, to_vector
from ballscrew.axis.axial_prior import prior
from ballscrew.axis.sheet import DataSheet, Limits
from ballscrew.axis.sheet_file import axis_toml
from ballscrew.base.errors import InputError, MeasurementError
from ballscrew.base.quantity import Quantity
from ballscrew.calibration import robust_fit
from ballscrew.calibration.anchors import LEVELS, SOFTENING_LAW, AnchorRow, anchor_covariance, known_preload
from ballscrew.calibration.assumptions import FORM, Assumptions
from ballscrew.calibration.bearing import bearing_share
from ballscrew.calibration.calibration import calibrate, solve_calibration
from ballscrew.calibration.covariance import FLOOR
from ballscrew.calibration.identifiability import describe_directions
from ballscrew.calibration.model_forms import EQ3, model_forms, without_rotor
from ballscrew.calibration.modelfile import model_json
from ballscrew.calibration.sampler import sample_posterior
from ballscrew.estimation.preload import preload
from ballscrew.modal.run import FrameMode, RigidBodyResult, Run
from ballscrew.testbed.linear import true_frequency
from ballscrew.testbed.machine import constants

KNOWN = {name: PARAMETERS.index(name) for name in PARAMETERS}


def test_exact_frequencies_give_the_axis_back(experiment, sheet, truth) -> None:
    found = calibrate(experiment(errors=None, measured_at="2026-01-01T08:00Z"), sheet)
    model = found.model
    assert model.slope == pytest.approx(truth.slope, rel=0.01)
    x, load = np.linspace(0, 0.4, 5)[:, None], np.array([0.0, 40.0, 120.0])
    np.testing.assert_allclose(frequency(model, x, load), frequency(truth, x, load), rtol=1e-3)
    assert not found.reasons
    assert (model.curve, found.free) == (0.0, tuple(n for n in PARAMETERS if n != "curve"))


@pytest.mark.slow
def test_bias_scatter_and_coverage_on_tables_of_the_models_own_form(experiment, sheet, truth) -> None:
    """24 samples of noise and of the method's error: they scatter as the covariance of the data states.

    Parameters that only the sheet determines do not scatter: their error is that of the sheet.
    """
    z = []
    for seed in range(24):
        random = np.random.default_rng(seed)
        found = calibrate(experiment(seed, bias=tuple(random.normal(size=2))), sheet)
        off = found.vector - to_vector(truth)
        z.append(off[[0, 1, 3, 4, 5, 6]] / np.sqrt(np.diag(found.covariance))[[0, 1, 3, 4, 5, 6]])
    scatter = np.array(z)
    assert np.all(np.abs(scatter) < 4)
    assert np.mean(np.abs(scatter) < 1.96) > 0.88
    # Not too wide either: an interval ten times as wide contains everything.
    assert 0.5 < np.sqrt(np.mean(scatter**2)) < 1.3
    # The data determine the slope best: unbiased, with the scatter that is stated.
    assert abs(scatter[:, 1].mean()) < 0.7
    assert 0.6 < scatter[:, 1].std() < 1.4


def test_intervals_contain_the_values_of_machines_beyond_the_model() -> None:
    """Random axes with a bed, a distributed screw, wrong sheets: errors as large as the uncertainties."""
    z = []
    for seed in range(12):
        sample = random_axis(seed)
        machine, data_sheet, stops = sample.rig.machine, sample.data_sheet, sample.plan.positions
        middle = (stops[0] + stops[-1]) / 2
        bias = tuple(np.random.default_rng(seed).normal(size=2))

        def ring(x: float, load: float, part: float = 1.0, axis=(machine, middle)) -> float:
            rig, centre = axis
            return true_frequency(constants(replace(rig, preload=rig.preload * part), load, centre), x)

        runs = [
            table(lambda x, m=m: ring(x, m), stops, m, 100 * seed + i, axis=data_sheet.name, bias=bias)
            for i, m in enumerate(np.array([0.0, 0.5, 1.0]) * data_sheet.table.mass)
        ]
        found = calibrate(runs, data_sheet)
        assert [c.name for c in found.candidates if c.chosen] == ["free rotor"]
        z.append(np.log(found.model.preload / machine.preload) / found.standard_uncertainty("preload"))
        # The share as a fall of the preload to a half shows it.
        f = np.array([[ring(x, 0.0, part) for x in stops] for part in (1.0, 0.5)])
        rise = (f[0] / f[1]) ** 2 - 1
        share = np.mean(rise / (2 ** (1 / 3) - 1) * (1 + found.model.slope * (np.array(stops) - middle)))
        logit = np.log(share / (1 - share)) - found.vector[KNOWN["share"]]
        z.append(logit / found.standard_uncertainty("share"))
    assert np.mean(np.abs(z) < np.float64(1.96)) > 0.8
    assert 0.6 < np.sqrt(np.mean(np.square(z))) < 1.4


@pytest.mark.parametrize("timed", [True, False])
def test_the_first_run_is_the_reference_and_the_order_of_the_others_does_not_matter(
    experiment, sheet, timed
) -> None:
    days = [f"2026-01-{day:02d}T08:00Z" if timed else None for day in (1, 1, 3, 3, 5)]
    runs = [replace(run, measured_at=day) for run, day in zip(experiment(ratio=0.9), days, strict=True)]
    first, *others = runs
    document = model_json(calibrate(runs, sheet))
    assert model_json(calibrate([first, *others[::-1]], sheet)) == document
    assert model_json(calibrate([first, *others[2:], *others[:2]], sheet)) == document
    last = calibrate(runs[::-1], sheet)
    assert last.runs[0].id == runs[-1].id


def test_at_one_preload_share_and_newtons_are_the_sheets(experiment, sheet) -> None:
    found = calibrate(experiment(), sheet)
    before, after = np.sqrt(np.diag(found.prior_covariance)), np.sqrt(np.diag(found.covariance))
    assert after[KNOWN["preload"]] == pytest.approx(before[KNOWN["preload"]], rel=0.1)
    assert after[KNOWN["share"]] > 0.8 * before[KNOWN["share"]]
    for name in ("compliance", "slope", "rotor"):
        assert after[KNOWN[name]] < 0.4 * before[KNOWN[name]]


def test_a_known_preload_settles_newtons_and_a_second_the_share(experiment, sheet, truth) -> None:
    day, later = "2026-01-01T08:00+00:00", "2026-03-01T08:00+00:00"
    runs = experiment(measured_at=day)
    worn = experiment(ratio=0.5, measured_at=later, loads=(100.0,))
    single = calibrate(runs, sheet, known={runs[0].id: Quantity(truth.preload, 0.02 * truth.preload, "N")})
    assert single.standard_uncertainty("preload") < 0.021
    assert single.model.preload == pytest.approx(truth.preload, rel=0.03)
    half = Quantity(truth.preload / 2, 0.01 * truth.preload, "N")
    both = calibrate(
        [*runs, *worn], sheet,
        known={runs[0].id: Quantity(truth.preload, 0.02 * truth.preload, "N"), worn[0].id: half},
        assumptions=Assumptions(bearing_drift=0.0),
    )  # fmt: skip
    assert both.standard_uncertainty("share") < 0.6 * single.standard_uncertainty("share")
    assert both.model.share == pytest.approx(truth.share, rel=0.15)
    assert both.log_ratios[1] == pytest.approx(np.log(0.5), abs=0.08)
    assert [a.kind for a in both.anchors] == ["known preload"] * 2
    assert all(a.share_with < 0.7 * a.share_without for a in both.anchors)
    assert [run.group for run in both.runs] == [0] * 5 + [1]


def test_the_nuts_softening_settles_newtons(experiment, sheet, truth) -> None:
    plain = calibrate(experiment(), sheet)
    runs = [
        replace(
            run,
            mass_over_preload_kg_per_N=Quantity(
                (32.0 + run.mass_kg) / truth.preload, 0.05 * (32.0 + run.mass_kg) / truth.preload, "kg/N"
            ),
        )
        for run in experiment()
    ]
    found = calibrate(runs, sheet)
    assert found.standard_uncertainty("preload") < 0.8 * plain.standard_uncertainty("preload")
    assert found.model.preload == pytest.approx(truth.preload, rel=0.1)
    # Its law errs alike in every run, and on every axis: five runs are not √5 times as sharp.
    alone = (found.covariance[6, 6] ** -1 - plain.covariance[6, 6] ** -1) ** -0.5
    assert np.hypot(0.05 * 0.8, SOFTENING_LAW) < alone < np.hypot(0.05, SOFTENING_LAW) * 1.05
    assert found.anchors[0].standard_uncertainty / found.anchors[0].preload > SOFTENING_LAW
    assert {a.kind for a in found.anchors} == {"nut load"}


def test_a_noisy_softening_takes_nothing_from_a_certain_one() -> None:
    rows = [
        AnchorRow("nut load", k, 0, 6.0, float(np.hypot(own, 0.08)), 0.08)
        for k, own in ((0, 0.33), (1, 0.12))
    ]
    weights = np.linalg.solve(anchor_covariance(rows), np.ones(2))
    assert 0 < weights[0] < 0.2 * weights[1]


def test_an_anchor_that_contradicts_is_named(experiment, sheet, truth) -> None:
    runs = experiment()
    found = calibrate(runs, sheet, known={runs[0].id: Quantity(2.5 * truth.preload, 5.0, "N")})
    assert any(
        doubt.name == "known-preload" and "standard deviations above" in doubt.text for doubt in found.reasons
    )


def test_one_cell_that_does_not_fit_is_named_and_hardly_counts(experiment, sheet) -> None:
    runs = experiment(3)
    wanted = calibrate(runs, sheet)
    cells = list(runs[1].cells)
    cells[6] = replace(cells[6], frequency_Hz=cells[6].frequency_Hz * 1.03)
    spoilt = [runs[0], replace(runs[1], cells=tuple(cells)), *runs[2:]]
    found = calibrate(spoilt, sheet)
    assert len(found.runs[1].outliers) == 1
    assert "100 mm NA" in found.runs[1].outliers[0]
    moved = (found.vector - wanted.vector) / np.maximum(np.sqrt(np.diag(wanted.covariance)), 1e-12)
    assert np.abs(moved).max() < 0.3


def test_a_run_with_another_load_than_declared_is_named(heavier, sheet, truth) -> None:
    found = calibrate(heavier(0, 2, -5.0), sheet)
    assert [run.weight < 0.5 for run in found.runs] == [False, False, True, False, False]
    assert any("check its load and its preload" in doubt.text for doubt in found.reasons)
    assert found.model.slope == pytest.approx(truth.slope, rel=0.03)


def test_two_runs_that_differ_are_named_but_neither_is_blamed(experiment, sheet) -> None:
    runs = [experiment(1, loads=(50.0,))[0], experiment(2, ratio=0.3, loads=(50.0,))[0]]
    found = calibrate(runs, sheet)
    assert any("contradict each other" in doubt.text for doubt in found.reasons)
    assert all(run.weight == 1 for run in found.runs)
    dated = [replace(run, measured_at=f"2026-0{i}-01T00:00Z") for i, run in enumerate(runs, 1)]
    assert [doubt.name for doubt in calibrate(dated, sheet).reasons] == ["differing-preloads"]


def days_apart(experiment, seed: int, ratios: tuple[float, ...]) -> list[Run]:
    runs = []
    for day, ratio in enumerate(ratios, 1):
        when = f"2026-01-0{day}T08:00Z"
        runs += experiment(10 * seed + day, loads=(50.0,), ratio=ratio, measured_at=when)
    return runs


def test_runs_of_one_state_that_differ_in_preload_are_a_doubt_that_names_them(experiment, sheet) -> None:
    for seed in range(5):
        runs = days_apart(experiment, seed, (1.0, 0.73, 1.0))
        found = calibrate(runs, sheet)
        assert found.verdict == "suspect"
        (doubt,) = found.reasons
        assert doubt.name == "differing-preloads"
        assert f"run {runs[1].id[:12]}" in doubt.text
        assert re.search(r"differ by [23]\d % \(± \d+ %, 95 %\)", doubt.text)
    # The most different pair is named, not each with the first.
    (doubt,) = calibrate(days_apart(experiment, 7, (0.85, 0.7, 1.1)), sheet).reasons
    assert "run 007200000700 and run 007300001100" in doubt.text


def test_runs_of_one_state_that_agree_are_good(experiment, sheet) -> None:
    """One false doubt in a hundred is allowed: none or one of thirty draws."""
    doubted = [
        bool(calibrate(days_apart(experiment, seed, (1.0, 1.0, 1.0)), sheet).reasons) for seed in range(30)
    ]
    assert sum(doubted) <= 1


def test_a_stated_preload_or_another_temperature_explains_a_difference(experiment, sheet, truth) -> None:
    runs = days_apart(experiment, 1, (1.0, 1.0, 0.73))
    worn = Quantity(0.73 * truth.preload, 0.03 * truth.preload, "N")
    assert "differing-preloads" not in {
        d.name for d in calibrate(runs, sheet, known={runs[2].id: worn}).reasons
    }
    warm = [replace(run, temperature_C=t) for run, t in zip(runs, (20.0, 20.0, 45.0), strict=True)]
    assert "differing-preloads" not in {doubt.name for doubt in calibrate(warm, sheet).reasons}


def test_a_curve_is_chosen_where_the_screw_is_fixed_at_both_ends_after_all(experiment, sheet, truth) -> None:
    bent = replace(truth, slope=0.5, curve=-1.4)
    found = calibrate(experiment(model=bent), sheet)
    assert [c.name for c in found.candidates if c.chosen] == ["free rotor, curve"]
    assert found.model.curve == pytest.approx(-1.4, rel=0.2)


def test_a_sheet_of_a_screw_fixed_at_both_ends(experiment, sheet) -> None:

    both = replace(sheet, support="fixed-fixed")
    model = from_vector(prior(both, 0.2)[0], 0.2)
    found = calibrate(experiment(model=model), both)
    assert found.candidates[0].name == "free rotor"
    assert found.model.curve == pytest.approx(model.curve, rel=0.1)
    wrong = calibrate(experiment(), both)
    assert [c.name for c in wrong.candidates if c.chosen] == ["free rotor, fixed at one end"]
    assert "has an end lost its pretension" in {d.name: d.text for d in wrong.reasons}["support"]
    assert "support" not in {doubt.name for doubt in found.reasons}


def test_both_bearings_of_a_fixed_fixed_screw_are_in_the_bearing_share(sheet) -> None:
    alike = replace(sheet, support="fixed-fixed")
    stated = replace(alike, bearing=replace(alike.bearing, far_stiffness=alike.bearing.stiffness))
    model = from_sheet(alike, 0.2)
    assert bearing_share(stated, model) == pytest.approx(bearing_share(alike, model))


@pytest.mark.parametrize("slope", [-1.0, 0.0, 0.02])
def test_loads_that_the_equivalent_mass_does_not_follow_are_in_doubt(experiment, sheet, slope) -> None:
    runs = []
    for run in experiment(loads=(0.0, 100.0)):
        masses = {"equivalent_mass_kg": 300.0 + slope * run.mass_kg}
        body = RigidBodyResult(**masses, standard_uncertainty={"equivalent_mass_kg": 1.0})
        runs.append(replace(run, rigid_body=body))
    texts = {doubt.name: doubt.text for doubt in calibrate(runs, sheet).reasons}
    assert "are the loads of the runs exchanged" in texts["loads"]
    assert "transmission" not in texts


@pytest.mark.parametrize(("ratio", "doubted"), [(1.0, False), (1.1, False), (2.0, True), (0.5, True)])
def test_a_transmission_is_in_doubt_where_a_load_does_not_add_its_mass(
    experiment, sheet, ratio, doubted
) -> None:
    runs = []
    for run in experiment(loads=(0.0, 100.0)):
        masses = {"equivalent_mass_kg": (300.0 + run.mass_kg) / ratio}
        body = RigidBodyResult(**masses, standard_uncertainty={"equivalent_mass_kg": 1.0})
        runs.append(replace(run, rigid_body=body))
    texts = {doubt.name: doubt.text for doubt in calibrate(runs, sheet).reasons}
    assert ("transmission" in texts) == doubted
    if doubted:
        assert f"a belt or gear of {ratio:.2g} times" in texts["transmission"]
    assert "transmission" not in {doubt.name for doubt in calibrate(runs[:1], sheet).reasons}


def test_five_loads_separate_eq_3_from_a_free_rotor_and_a_single_load_does_not(experiment, sheet) -> None:
    evidence = {c.name: c.log_evidence for c in calibrate(experiment(), sheet).candidates}
    assert evidence[EQ3] < evidence["free rotor"] - 10
    single_load = {c.name: c.log_evidence for c in calibrate(experiment(loads=(50.0,)), sheet).candidates}
    assert abs(single_load[EQ3] - single_load["free rotor"]) < 3


def test_eq_3_stands_in_for_a_free_rotor_at_its_load(sheet) -> None:

    own = model_forms(sheet, 0.2, 50.0)[0]
    without, free = (from_vector(form.mean, 0.2) for form in (without_rotor(own, 50.0), own))
    load = np.array([49.0, 50.0, 51.0])
    np.testing.assert_allclose(frequency(without, 0.1, load), frequency(free, 0.1, load), rtol=3e-5)
    assert frequency(without, 0.1, 0.0) != pytest.approx(float(frequency(free, 0.1, 0.0)), rel=5e-3)


def test_the_covariance_predicts_frequencies_at_a_load_that_was_not_measured(
    experiment, sheet, truth
) -> None:
    found = calibrate(experiment(), sheet)
    slopes = gradient(found.model, 0.35, 140.0)[:7]
    sd = float(np.sqrt(slopes @ found.covariance @ slopes))
    off = float(np.log(frequency(truth, 0.35, 140.0) / frequency(found.model, 0.35, 140.0)))
    assert abs(off) < 3 * sd < 0.02


def bowed(runs: list[Run], sizes: Sequence[float]) -> list[Run]:
    """Each run bent along its stops, by this part of its frequencies from the middle to the ends."""
    found = []
    for run, size in zip(runs, sizes, strict=True):
        x = np.array([cell.position_m for cell in run.cells])
        bend = 1 + size * (2 * ((x - x.mean()) / (np.ptp(x) / 2)) ** 2 - 1)
        cells = tuple(
            replace(c, frequency_Hz=c.frequency_Hz * float(b)) for c, b in zip(run.cells, bend, strict=True)
        )
        found.append(replace(run, cells=cells))
    return found


SMOOTH = Errors(own=1e-6)
"""As method joint errs: all cells of a run on one curve."""


def test_scatter_beyond_the_uncertainties_inflates_them_and_never_beyond_the_sheet(experiment, sheet) -> None:
    runs = experiment(5, errors=SMOOTH)
    calm = calibrate(runs, sheet)
    assert not any("scatter more" in doubt.text for doubt in calm.reasons)
    for size in (1e-3, 3e-3, 1e-2):
        found = calibrate(bowed(runs, [size, -size, size, -size, size]), sheet)
        assert any("scatter more" in doubt.text for doubt in found.reasons)
        before, after = np.sqrt(np.diag(found.prior_covariance)), np.sqrt(np.diag(found.covariance))
        assert np.all(after <= before * (1 + 1e-9))
        assert found.standard_uncertainty("compliance") > 2 * calm.standard_uncertainty("compliance")


def test_knowledge_agrees_with_the_covariance(experiment, sheet) -> None:
    runs = experiment(5, errors=SMOOTH)
    found = calibrate(bowed(runs, [2e-3, -2e-3, 2e-3, -2e-3, 2e-3]), sheet)
    spreads = {row["name"]: row["data"] for row in found.knowledge if row["kind"] == "quantity"}
    offered = next(row for row in found.knowledge if row["kind"] == "offer")
    assert spreads["preload in newtons"] == pytest.approx(found.standard_uncertainty("preload"))
    assert spreads["compliance in the middle"] == pytest.approx(found.standard_uncertainty("compliance"))
    assert offered["mass"] == pytest.approx(found.standard_uncertainty("mass"))


def test_forty_cells_on_one_curve_are_a_few_numbers(experiment, sheet) -> None:
    """χ² is compared with what is free to misfit: neither a perfect fit nor a bad one."""
    parts = []
    for seed in range(8):
        random = np.random.default_rng([seed, 0xC41])
        bends = list(FORM * random.normal() + FLOOR * random.normal(size=5))
        found = calibrate(bowed(experiment(seed, errors=SMOOTH), bends), sheet)
        assert found.degrees < 30
        parts.append(found.chi2 / found.degrees)
    assert 0.2 < np.mean(parts) < 1.5
    plain = calibrate(experiment(), sheet)
    assert plain.degrees > 60
    assert plain.chi2 == pytest.approx(plain.degrees, rel=0.5)


def test_a_run_with_too_many_outlying_cells_is_refused_and_named(experiment, sheet) -> None:
    runs = experiment(3)
    cells = list(runs[1].cells)
    for i in range(0, 18, 3):
        cells[i] = replace(cells[i], frequency_Hz=cells[i].frequency_Hz * (1.02 if i % 2 else 0.97))
    spoilt = [runs[0], replace(runs[1], cells=tuple(cells)), *runs[2:]]
    known = {runs[1].id: Quantity(600.0, 12.0, "N")}
    found = calibrate(spoilt, sheet, known=known)
    assert [run.id for run in found.runs] == [run.id for i, run in enumerate(runs) if i != 1]
    assert any("more than a quarter of its cells" in doubt.text for doubt in found.reasons)
    # By itself its good cells cannot be separated from its bad ones.
    assert any("scatter more" in doubt.text for doubt in calibrate([spoilt[1]], sheet).reasons)


def test_an_unfinished_search_is_reported(experiment, sheet, monkeypatch) -> None:
    runs = experiment(3)
    cells = list(runs[1].cells)
    for i, part in ((2, 1.03), (6, 0.97), (11, 1.02)):
        cells[i] = replace(cells[i], frequency_Hz=cells[i].frequency_Hz * part)
    spoilt = [runs[0], replace(runs[1], cells=tuple(cells)), *runs[2:]]
    assert not any("stopped" in doubt.text for doubt in calibrate(spoilt, sheet).reasons)
    monkeypatch.setattr(robust_fit, "_ROUNDS", 2)
    assert any("stopped after 2 cells" in doubt.text for doubt in calibrate(spoilt, sheet).reasons)


def test_cells_that_fit_another_form_are_no_outliers(experiment, sheet, truth) -> None:
    """A curve at the ends of the stops: what does not fit the sheet's form fits the one that is chosen."""
    bent = replace(truth, slope=0.5, curve=-1.4)
    found = calibrate(experiment(model=bent, errors=SMOOTH), sheet)
    assert [c.name for c in found.candidates if c.chosen] == ["free rotor, curve"]
    assert not any(run.outliers for run in found.runs)
    assert all(run.weight == 1 for run in found.runs)
    assert (
        found.candidates[0].log_evidence
        - next(c.log_evidence for c in found.candidates if c.name == "free rotor")
        > 100
    )


def test_an_outlier_that_fits_no_form_decides_nothing_between_them(experiment, sheet) -> None:
    runs = experiment(3)
    cells = list(runs[1].cells)
    cells[0] = replace(cells[0], frequency_Hz=cells[0].frequency_Hz * 1.05)
    spoilt = [runs[0], replace(runs[1], cells=tuple(cells)), *runs[2:]]
    clean, found = calibrate(runs, sheet), calibrate(spoilt, sheet)
    evidence = [{c.name: c.log_evidence for c in axis.candidates} for axis in (clean, found)]
    assert evidence[1] == pytest.approx(evidence[0], abs=1.0)
    assert [c.name for c in found.candidates if c.chosen] == ["free rotor"]


def test_offers_stay_on_the_axis(experiment, sheet) -> None:
    def stops(of: DataSheet) -> list[float]:
        words = [str(row["what"]) for row in calibrate(experiment(), of).knowledge if row["kind"] == "offer"]
        return [float(w.split("at ")[-1].split(" mm")[0]) / 1e3 for w in words if "another stop" in w]

    assert stops(sheet) == [pytest.approx(0.47)]  # the screw ends at 0.57 m, stops are 0.1 m apart
    low = replace(sheet, limits=Limits(lowest_position=-0.03, highest_position=0.42))
    assert stops(low) == [pytest.approx(-0.03)]
    assert stops(replace(sheet, limits=Limits(lowest_position=0.0, highest_position=0.41))) == []


def test_assumptions_of_the_grouping_are_reported(experiment, sheet) -> None:
    runs = experiment()
    assert any("5 runs have no time" in note for note in calibrate(runs, sheet).notes)
    dated = experiment(measured_at="2026-01-01T08:00Z")
    near = {dated[0].id: Quantity(600.0, 12.0, "N"), dated[2].id: Quantity(610.0, 12.2, "N")}
    found = calibrate(dated, sheet, known=near)
    assert [run.group for run in found.runs] == [0] * 5
    assert not found.reasons
    # A preload that is stated twice is not measured twice.
    assert len(found.anchors) == 1
    assert found.anchors[0].preload == pytest.approx(605, rel=0.002)
    assert found.anchors[0].standard_uncertainty / 605 == pytest.approx(0.02, rel=0.02)
    far = {dated[0].id: Quantity(600.0, 12.0, "N"), dated[2].id: Quantity(300.0, 6.0, "N")}
    notes = calibrate(dated, sheet, known=far).notes
    assert any("preloads of 600 N and 300 N, as stated" in note for note in notes)


def test_log_ratios_and_model_are_correlated(experiment, sheet) -> None:
    """The ratio of another preload is estimated with the share: their errors are correlated."""
    worn = experiment(ratio=0.5, measured_at="2026-03-01T08:00Z", loads=(100.0,))
    found = calibrate([*experiment(measured_at="2026-01-01T08:00Z"), *worn], sheet)
    share, ratio = KNOWN["share"], 1
    correlation = found.cross_covariance[share, ratio] / np.sqrt(
        found.covariance[share, share] * found.log_ratio_covariance[ratio, ratio]
    )
    assert correlation > 0.5
    # `preload` samples them together: newtons of a worn baseline err by ratio and share at once.
    table = experiment(7, ratio=0.5, loads=(100.0,))[0]
    uncorrelated = replace(found, cross_covariance=np.zeros_like(found.cross_covariance))
    preloads = [preload(table, axis, worn[0]).preload_N for axis in (found, uncorrelated)]
    assert all(axis is not None for axis in preloads)
    assert preloads[0].value == pytest.approx(preloads[1].value)
    assert preloads[0].standard_uncertainty != pytest.approx(preloads[1].standard_uncertainty, rel=0.01)


def test_knowledge_is_reported_in_words_and_numbers(experiment, sheet) -> None:
    known = calibrate(experiment(), sheet).knowledge
    words = [str(row["sentence"]) for row in known if row["kind"] == "quantity"]
    assert any(w.startswith("compliance in the middle: the data") for w in words)
    assert any(w.startswith("preload in newtons: only the sheet") for w in words)
    information = [row["information"] for row in known if row["kind"] == "direction"]
    assert information == sorted(information, reverse=True)
    assert information[0] > 100
    assert information[-1] < 0.3
    offers = {str(row["what"]): row for row in known if row["kind"] == "offer"}
    now = offers["as it is"]
    assert all(
        row[key] <= now[key] * 1.001 for row in offers.values() for key in ("share", "log_preload", "mass")
    )
    half = next(row for what, row in offers.items() if "half" in what)
    assert half["share"] < 0.7 * now["share"]
    assert next(row for what, row in offers.items() if "load, 200 kg" in what)["mass"] < now["mass"]


@pytest.mark.parametrize("loads", [(50.0,), (0.0, 100.0)])
def test_directions_without_information_do_not_depend_on_the_basis(experiment, sheet, loads) -> None:
    _, fit = solve_calibration(experiment(loads=loads), sheet, {}, Assumptions())
    size = len(fit.information)
    turn = np.linalg.qr(np.random.default_rng(3).normal(size=(size, size)))[0]
    turned = replace(fit, directions=fit.directions @ turn, information=turn.T @ fit.information @ turn)
    rows, again = describe_directions(fit), describe_directions(turned)
    assert [row["sentence"] for row in again] == [row["sentence"] for row in rows]
    for row, other in zip(rows, again, strict=True):
        assert other["parts"] == pytest.approx(row["parts"], abs=1e-4)
    assert rows[-1]["information"] == 0.0
    assert str(rows[-1]["sentence"]).startswith(f"{size - len(rows) + 1} combinations of")


def test_a_second_known_preload_determines_the_share_as_expected(experiment, sheet) -> None:
    """Samples of axes by the sheet: the error of the share is the expected uncertainty."""
    mean, spread = prior(sheet, 0.2)
    free = np.flatnonzero(np.diag(spread) > 0)
    half = np.linalg.cholesky(spread[np.ix_(free, free)])
    ratios = []
    for seed in range(20):
        random = np.random.default_rng([seed, 0x5EC])
        moved = mean.copy()
        moved[free] += half @ random.standard_normal(len(free))
        axis, bias = from_vector(moved, 0.2), tuple(random.normal(size=2))
        runs = experiment(seed, model=axis, measured_at="2026-01-01T08:00Z", loads=(0.0, 100.0), bias=bias)
        worn = experiment(
            seed, model=axis, ratio=0.5, measured_at="2026-03-01T08:00Z", loads=(100.0,), bias=bias
        )
        offers = [row for row in calibrate(runs, sheet).knowledge if row["kind"] == "offer"]
        expected = next(row for row in offers if "half" in str(row["what"]))["share"]
        known = {}
        for run, true in ((runs[0], axis.preload), (worn[0], axis.preload / 2)):
            value = true * (1 + 0.02 * random.standard_normal())
            known[run.id] = Quantity(value, 0.02 * value, "N")
        found = calibrate([*runs, *worn], sheet, known=known)
        ratios.append(np.log(found.model.share / axis.share) / expected)
    # Twenty samples determine a standard deviation to 16 %.
    assert 0.6 < np.sqrt(np.mean(np.square(ratios))) < 1.4


def test_two_acceleration_levels_determine_the_preload_as_expected(experiment, sheet, truth) -> None:
    offers = [row for row in calibrate(experiment(), sheet).knowledge if row["kind"] == "offer"]
    expected = next(row for row in offers if "acceleration levels" in str(row["what"]))
    assert f"±{100 * LEVELS:.0f} %" in str(expected["what"])
    mass = 32.0 + 100.0
    runs = experiment()
    runs[-1] = replace(
        runs[-1],
        mass_over_preload_kg_per_N=Quantity(mass / truth.preload, 0.05 * mass / truth.preload, "kg/N"),
    )
    found = calibrate(runs, sheet)
    assert found.standard_uncertainty("preload") == pytest.approx(expected["log_preload"], rel=0.03)


@pytest.mark.parametrize(
    ("text", "value", "spread"),
    [("600N", 600, 12), ("0.6 kN", 600, 12), ("600N±10N", 600, 10), ("600 N +- 10 N", 600, 10)],
)
def test_known_preloads_are_read(text: str, value: float, spread: float) -> None:
    found = known_preload(text)
    assert (found.value, found.standard_uncertainty) == pytest.approx((value, spread))


@pytest.mark.parametrize(
    "text", ["", "600 kg", "-5N", "0N", "600N±0N", "600N±700N", "much", "600N±", "1e999N"]
)
def test_known_preloads_that_cannot_be_are_refused(text: str) -> None:
    with pytest.raises(InputError):
        known_preload(text)


def test_units_of_a_known_preload_are_converted(experiment, sheet: DataSheet) -> None:
    runs = experiment()
    expected = calibrate(runs, sheet, known={runs[0].id: Quantity(600.0, 12.0, "N")})
    for given in (Quantity(0.6, 0.012, "kN"), "600 N ± 12 N"):
        found = calibrate(runs, sheet, known={runs[0].id: given})
        assert found.model == expected.model
        assert found.anchors == expected.anchors
    below, wide = Quantity(-600.0, 10.0, "N"), Quantity(600.0, 700.0, "N")
    for wrong in (Quantity(600.0, 12.0, "mm"), 600.0, "600 kg", below, wide):
        with pytest.raises(InputError, match=f"the known preload of run {runs[0].id[:12]}"):
            calibrate(runs, sheet, known={runs[0].id: wrong})  # type: ignore[dict-item]


def test_what_does_not_belong_together_is_refused(experiment, sheet: DataSheet) -> None:
    runs = experiment()
    with pytest.raises(InputError, match="given twice"):
        calibrate([runs[0], runs[0]], sheet)
    with pytest.raises(InputError, match="is of the axis"):
        calibrate([replace(runs[0], axis="lathe")], sheet)
    with pytest.raises(InputError, match="was not given"):
        calibrate(runs, sheet, known={"f" * 64: Quantity(600.0, 1.0, "N")})
    with pytest.raises(InputError, match="0 runs"):
        calibrate([], sheet)
    far = replace(runs[0], cells=tuple(replace(c, position_m=4.0) for c in runs[0].cells))
    with pytest.raises(InputError, match=f"run {far.id[:12]}: the stop is 4 m; it must be on the screw"):
        calibrate([far], sheet)
    none = replace(runs[0], cells=tuple(replace(c, verdict="refused") for c in runs[0].cells))
    with pytest.raises(MeasurementError, match="refused"):
        calibrate([none], sheet)
    found = calibrate([none, *runs[1:]], sheet)
    assert len(found.runs) == 4
    assert any("left out" in doubt.text for doubt in found.reasons)


def test_frequencies_of_no_such_axis_are_reported(experiment, sheet) -> None:
    runs = experiment()
    tiny = [
        replace(r, cells=tuple(replace(c, frequency_Hz=c.frequency_Hz / 40) for c in r.cells)) for r in runs
    ]
    try:
        found = calibrate(tiny, sheet)
    except MeasurementError:
        return
    assert found.reasons


@pytest.mark.slow
def test_the_sampler_is_reported_missing_or_agrees(experiment, sheet) -> None:
    _, fit = solve_calibration(experiment(loads=(0.0, 100.0)), sheet, {}, Assumptions())
    try:
        import emcee  # noqa: F401
    except ImportError:
        with pytest.raises(InputError, match=r"pip install \"ballscrew\[sample\]"):
            sample_posterior(fit)
        return
    assert sample_posterior(fit, steps=600).agrees


def test_frequencies_of_a_loaded_nut_are_reported(experiment, sheet) -> None:
    runs = experiment()
    paper = [replace(r, cells=tuple(replace(c, method="paper") for c in r.cells)) for r in runs]
    assert any("under load" in doubt.text for doubt in calibrate(paper, sheet).reasons)


def test_errors_that_are_smaller_make_a_sharper_model(experiment, sheet) -> None:
    good = Errors(noise=3e-4, method=3e-4, own=1e-4)
    sharp, plain = calibrate(experiment(errors=good), sheet), calibrate(experiment(), sheet)
    assert sharp.standard_uncertainty("mass") < plain.standard_uncertainty("mass")


def test_loads_that_do_not_determine_the_mass_are_a_rank_too_few(experiment, sheet) -> None:
    assert calibrate(experiment(loads=(0.0, 50.0)), sheet).reasons == ()
    assert calibrate(experiment(loads=(50.0,)), sheet).reasons == ()
    (doubt,) = calibrate(experiment(loads=(50.0, 50.2)), sheet).reasons
    assert doubt.name == "rank"
    assert (
        "5 stops and 2 loads should determine 3 combinations of the parameters, the frequencies determine 2"
        in (doubt.text)
    )


def test_a_frame_mode_in_some_runs_only_makes_a_calibration_suspect(experiment, sheet) -> None:
    runs, frame = experiment(), FrameMode(180.0, 0.2, 0.05, 8.0, 0.3, True)
    (doubt,) = calibrate((replace(runs[0], frame_mode=frame), *runs[1:]), sheet).reasons
    assert doubt.name == "frame-mode"
    assert calibrate([replace(run, frame_mode=frame) for run in runs], sheet).reasons == ()


def test_a_spring_makes_a_calibration_suspect(experiment, sheet) -> None:
    sprung = replace(sheet, screw=replace(sheet.screw, preload_by="spring"))
    names = [doubt.name for doubt in calibrate(experiment(), sprung).reasons]
    assert "spring-preload" in names


def test_files_are_read_as_runs_and_sheets_are(experiment, sheet, tmp_path) -> None:
    runs = experiment()[:3]
    (tmp_path / "axis.toml").write_text(axis_toml(sheet), encoding="utf-8")
    paths = []
    for number, run in enumerate(runs):
        paths.append(tmp_path / f"run{number}.json")
        run.write(paths[-1])
    found = calibrate([str(paths[0]), runs[1], paths[2]], tmp_path / "axis.toml")
    np.testing.assert_allclose(found.vector, calibrate(runs, sheet).vector, rtol=1e-6)
    (alone,) = calibrate(paths[0], str(tmp_path / "axis.toml")).runs
    assert alone.id == runs[0].id


def test_a_fit_that_does_not_converge_is_said(experiment, sheet, monkeypatch) -> None:
    monkeypatch.setattr("ballscrew.calibration.fit._MOST_EVALUATIONS", 1)
    with pytest.raises(MeasurementError, match="the calibration does not converge"):
        calibrate(experiment(), sheet)
