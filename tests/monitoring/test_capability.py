"""Smallest detectable loss of preload."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from tests.estimation.made_runs import run_of

from ballscrew.axis.axial import frequency, from_sheet, from_vector
from ballscrew.axis.axial_prior import prior
from ballscrew.base.errors import InputError
from ballscrew.base.jsonfile import SCHEMA
from ballscrew.base.provenance import Made
from ballscrew.calibration.assumptions import Assumptions
from ballscrew.calibration.bearing import bearing_share
from ballscrew.calibration.calibrated_axis import CalibrationRun, Doubt
from ballscrew.estimation.preload import preload
from ballscrew.fcft.cells import cells
from ballscrew.fcft.scatter import DOUBT, FrequencyScatter
from ballscrew.modal.cell import CellResult
from ballscrew.modal.run import RigidBodyResult, Run
from ballscrew.monitoring.capability import capability
from ballscrew.recording.quality.finding import Quality
from ballscrew.testbed.example import AXIS, PLAN

SCATTER = FrequencyScatter(cell=0.08, trip=0.0, run=0.04, lasting=0.1)
MIDDLE = 0.225


def run(
    seed: int, ratio: float = 1.0, scatter: FrequencyScatter = SCATTER, load: float = 50.0, **changes
) -> Run:
    """A run of the example axis with random errors of cells, level and tilt, and a lasting error."""
    rng = np.random.default_rng(seed)
    every = [cell for cell in cells(PLAN) if cell.mass == PLAN.masses[0]]
    x = np.array([cell.position for cell in every])
    f = frequency(from_sheet(AXIS, MIDDLE), x, load, ratio)
    f = f + scatter.own(3) * rng.normal(size=len(x)) + 0.3
    f = f + scatter.of_run(3) * (rng.normal() + rng.normal() * (x - MIDDLE) / MIDDLE)
    row = CellResult(0.0, "PA", 0, 3, 1.0, 0.1, 0.03, "joint", "good", ())
    table = tuple(
        replace(row, position_m=cell.position, condition=str(cell.condition), frequency_Hz=float(value))
        for cell, value in zip(every, f, strict=True)
    )
    whole = Run(
        id=f"{seed:064d}",
        axis=AXIS.name,
        mass_kg=load,
        measured_at=None,
        temperature_C=None,
        files=(),
        quality=Quality("good", ()),
        rigid_body=RigidBodyResult(),
        transients=(),
        cells=table,
        made=Made(),
    )
    return replace(whole, **changes)


def losses(found) -> list[float]:
    return [entry.loss for entry in found.smallest]


def test_a_few_per_cent_are_detectable_and_less_after_more_runs():
    found = capability(PLAN, axis=AXIS)
    assert [entry.runs for entry in found.smallest] == [1, 3, 10]
    first, third, tenth = losses(found)
    assert 0.01 < tenth < third < first < 0.06
    for entry in found.smallest:
        low, high = entry.interval95
        assert low < entry.loss < high
    assert found.baseline_runs == 5
    assert found.known_from == "data sheet"
    assert any("no baseline was given" in note for note in found.notes)


def test_the_smallest_loss_is_detected_nine_times_in_ten():
    """The test is applied to runs sampled with the stated scatter, without linearisation."""
    from scipy.stats import t

    found = capability(PLAN, axis=AXIS, scatter=SCATTER, false_alarm=0.01, after=(3,), baseline_runs=4)
    smallest, scatter = found.smallest[0], found.scatter[0]
    weights, sigma = np.array(scatter.weights), scatter.log_ratio
    mean, _ = prior(AXIS, MIDDLE)
    model = from_vector(mean, MIDDLE)
    x = np.array([cell.position for cell in cells(PLAN)])
    rng = np.random.default_rng(3)

    def fused(ratio: float, count: int) -> np.ndarray:
        f = frequency(model, x, 50.0, ratio)
        noise = SCATTER.own(3) * rng.normal(size=(1500, count, len(x)))
        tilt = (x - MIDDLE) / MIDDLE
        noise += SCATTER.of_run(3) * (
            rng.normal(size=(1500, count, 1)) + rng.normal(size=(1500, count, 1)) * tilt
        )
        return np.log(f + noise).mean(axis=1) @ weights

    estimated = sigma * np.sqrt(rng.chisquare(scatter.degrees, 1500) / scatter.degrees)
    limit = t.isf(0.01, scatter.degrees) * estimated * math.sqrt(1 / 3 + 1 / 4)
    detected = fused(1.0, 4) - fused(1 - smallest.loss, 3) > limit
    assert detected.mean() == pytest.approx(0.9, abs=0.03)
    false_alarms = fused(1.0, 4) - fused(1.0, 3) > limit
    assert false_alarms.mean() < 0.02


def test_the_loss_after_one_run_and_after_many(calibrated):
    """The drift of the bearing counts in `preload` of a single run and not in a history of runs."""
    (note,) = [note for note in capability(PLAN, axis=AXIS).notes if "history of runs" in note]
    width = float(note.split("±")[1].split(" %")[0])
    axial = calibrated(1.0).model
    used = (CalibrationRun("base", 100.0, None, 0, 40),)
    model = replace(calibrated(1.0), bearing_share=bearing_share(AXIS, axial), runs=used)
    runs = [run_of(name=name, model=axial, stops=PLAN.positions, axis=AXIS.name) for name in ("base", "now")]
    half = [
        np.ptp(preload(runs[1], model, runs[0], assumptions=assumed).relative_to_baseline.interval) / 2
        for assumed in (Assumptions(), Assumptions(bearing_drift=0.0))
    ]
    assert width == pytest.approx(100 * math.sqrt(half[0] ** 2 - half[1] ** 2), rel=0.15)
    assert half[0] > width / 100
    assert losses(capability(PLAN, axis=AXIS))[-1] < width / 100  # ten runs detect what one run cannot


def test_a_more_certain_model_narrows_the_interval(calibrated):
    of_sheet, of_model = capability(PLAN, axis=AXIS), capability(PLAN, axis=AXIS, model=calibrated(0.3))
    widths = [np.ptp(found.smallest[0].interval95) for found in (of_sheet, of_model)]
    assert of_model.known_from == "model"
    assert widths[1] < 0.5 * widths[0]
    assert losses(of_model) == pytest.approx(losses(of_sheet), rel=1e-6)


def test_a_small_scatter_lowers_the_smallest_loss_and_an_excessive_one_is_noted():
    quiet = FrequencyScatter(cell=0.01, trip=0.0, run=0.004, lasting=0.1)
    wild = FrequencyScatter(cell=0.08, trip=0.0, run=0.8, lasting=0.1)
    none = capability(PLAN, axis=AXIS, scatter=SCATTER, baseline_runs=8)
    calm, loud = (
        capability(PLAN, axis=AXIS, baseline=[run(i, scatter=noise) for i in range(8)], scatter=SCATTER)
        for noise in (quiet, wild)
    )
    assert losses(calm)[0] < losses(none)[0] < losses(loud)[0]
    assert calm.scatter[0].degrees == DOUBT + 7
    assert calm.scatter[0].excess < 0.3
    assert not any("scatters" in note for note in calm.notes)
    assert any("times as much as axes of this size" in note for note in loud.notes)


def test_a_baselines_scatter_is_that_of_its_runs():
    from ballscrew.monitoring.baseline_scatter import read_baseline, run_scatter

    runs = [run(i) for i in range(300)]
    model = from_sheet(AXIS, MIDDLE)
    baseline = read_baseline(runs, AXIS)
    default = run_scatter(baseline.position, 50.0, model, SCATTER, 3)
    measured = run_scatter(baseline.position, 50.0, model, SCATTER, 3, baseline)
    assert measured.excess == pytest.approx(1.0, abs=0.1)
    assert measured.log_ratio == pytest.approx(default.log_ratio, rel=0.1)


def test_lasting_errors_cancel():
    """All runs are 0.3 Hz high, which is no scatter."""
    runs = [run(i, scatter=FrequencyScatter(1e-6, 0.0, 0.0, 0.0)) for i in range(4)]
    assert capability(PLAN, axis=AXIS, baseline=runs).scatter[0].excess < 1e-3


def test_cells_that_a_run_lacks_are_omitted():
    runs = [run(0), replace(run(1), cells=run(1).cells[4:])]
    found = capability(PLAN, axis=AXIS, baseline=runs)
    assert len(found.scatter[0].weights) == 36


def test_one_run_has_no_scatter():
    found = capability(PLAN, axis=AXIS, baseline=[run(0)])
    assert found.scatter[0].degrees == DOUBT
    assert any("one run has no scatter" in note for note in found.notes)


def test_every_load_of_a_plan_is_reported():
    found = capability(replace(PLAN, masses=(0.0, 50.0)), axis=AXIS)
    assert [(entry.load_kg, entry.runs) for entry in found.smallest] == [
        (load, n) for load in (0.0, 50.0) for n in (1, 3, 10)
    ]


def test_an_undetectable_loss_is_none_with_a_note():
    noisy = FrequencyScatter(cell=60.0, trip=0.0, run=60.0, lasting=0.1)
    found = capability(PLAN, axis=AXIS, scatter=noisy)
    assert found.smallest[0].loss is None
    assert found.smallest[0].interval95 is None
    assert any("99 %" in note for note in found.notes)


def test_a_note_names_a_test_that_unloads_the_nut():
    hard = replace(PLAN, motions=(replace(PLAN.motions[0], acceleration=30.0, jerk=30000.0),))
    assert any("unloads the nut" in note for note in capability(hard, axis=AXIS).notes)
    assert not any("unloads the nut" in note for note in capability(PLAN, axis=AXIS).notes)


def test_json_contains_the_provenance():
    document = capability(PLAN, axis=AXIS).to_json()
    assert document["schema"] == SCHEMA
    assert document["made"]["settings"]["false_alarm"] == 1e-3
    assert set(document["made"]["inputs"]) == {"axis", "plan"}


@pytest.mark.parametrize(
    ("runs", "message"),
    [
        ([run(0), run(1, axis="another")], "is of the axis 'another'"),
        ([run(0), run(1, load=40.0)], "load of 40 kg"),
        ([run(0), run(0)], "twice"),
        ([run(0), run(1, quality=Quality("bad", ("clipped",)))], "bad measurement"),
        ([run(0), run(1, mass_kg=None)], "mass_kg"),
        ([run(0), replace(run(1), cells=run(1).cells[:2])], "share 2 cells"),
        ([replace(run(0), cells=())], "bad measurement"),
    ],
)
def test_an_unusable_baseline_is_refused(runs, message):
    with pytest.raises(InputError, match=message):
        capability(PLAN, axis=AXIS, baseline=runs)


@pytest.mark.parametrize(
    "change",
    [
        {"false_alarm": 0.0},
        {"false_alarm": 0.95},
        {"power": 1.0},
        {"power": math.nan},
        {"power": "0.9"},
        {"after": ()},
        {"after": (0,)},
        {"after": (1.5,)},
        {"baseline_runs": 0},
        {"baseline_runs": 2.5},
    ],
)
def test_probabilities_and_counts_out_of_range_are_refused(change):
    with pytest.raises(InputError):
        capability(PLAN, axis=AXIS, **change)


def test_a_model_of_another_axis_is_refused(calibrated):
    with pytest.raises(InputError, match="is the model of the axis 'another'"):
        capability(PLAN, axis=AXIS, model=calibrated(1.0, axis="another"))


def test_files_are_read_and_a_missing_one_is_named(tmp_path):
    from ballscrew.base.jsonfile import write_json

    paths = []
    for i in range(3):
        paths.append(tmp_path / f"run{i}.json")
        paths[-1].write_text(write_json(run(i).to_json()), encoding="utf-8")
    assert capability(PLAN, axis=AXIS, baseline=paths).baseline_runs == 3
    with pytest.raises(InputError, match=r"no\.json: cannot be read"):
        capability(PLAN, axis=AXIS, baseline=[tmp_path / "no.json"])


@pytest.fixture
def calibrated():
    """The example's axis as if it had been calibrated, all standard uncertainties times a factor."""
    from ballscrew.calibration.calibrated_axis import CalibratedAxis

    mean, covariance = prior(AXIS, MIDDLE)

    def made(factor: float, axis: str = AXIS.name) -> CalibratedAxis:
        names = CalibratedAxis.__dataclass_fields__
        known = {
            "axis": axis,
            "model": from_vector(mean, MIDDLE),
            "covariance": factor**2 * covariance,
            "free": (),
            "runs": (),
            "log_ratios": np.zeros(1),
            "log_ratio_covariance": np.zeros((1, 1)),
            "cross_covariance": np.zeros((7, 1)),
            "prior_covariance": covariance,
            "chi2": 1.0,
            "degrees": 1.0,
            "candidates": (),
            "anchors": (),
            "load_rating": 17e3,
            "nut_mass": 41.5,
            "bearing_share": 0.3,
        }
        return CalibratedAxis(**{name: value for name, value in known.items() if name in names})

    return made


def test_a_suspect_calibration_is_noted(calibrated):
    doubtful = replace(calibrated(1.0), reasons=(Doubt("rigidity", "too stiff"),))
    assert (
        "the calibration is suspect (rigidity): too stiff"
        in capability(PLAN, axis=AXIS, model=doubtful).notes
    )
