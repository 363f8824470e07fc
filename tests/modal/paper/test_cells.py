from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.modal.conftest import RATE, STOPS, table_of
from tests.modal.plant import MOTION, Plant, trip, way
from tests.recording.synthetic import SHEET

from ballscrew.axis.frequency import predicted_frequency
from ballscrew.base.tables import FREQUENCY_RESPONSE, validate
from ballscrew.fcft.plan import Plan
from ballscrew.modal import analyze
from ballscrew.modal.cell import CellResult
from ballscrew.modal.paper.cells import _assess_again, _refuse_strays, identify_cells
from ballscrew.modal.paper.settings import PaperSettings
from ballscrew.modal.reason import Reason
from ballscrew.recording.kinematics import kinematics
from ballscrew.recording.phases import find_phases
from ballscrew.recording.quality.finding import Quality
from ballscrew.recording.transients import cut, label

GOOD = Quality("good")
PLAN = Plan(STOPS, 3, (100.0,), (MOTION,))
MODE = float(predicted_frequency(SHEET, 0.06, 100.0))
ORDER = {"PD": 0, "PA": 1, "NA": 2, "ND": 3}


@pytest.fixture(scope="module")
def table():
    return table_of(Plant(frequency=MODE, servo=0.5), plan=PLAN)


def identified(table, *, quality=GOOD, sheet=SHEET, plan=PLAN, settings=PaperSettings()):  # noqa: B008
    return identify_cells(table, quality, sheet, plan, 100.0, settings)


def test_every_cell_of_the_plan_in_order(table):
    cells, response = identified(table)
    keys = [(c.position_m, ORDER[c.condition], c.motion) for c in cells]
    assert keys == sorted(keys)
    assert len(cells) == 8
    assert {c.repetitions for c in cells} == {3}
    assert all(c.verdict in ("good", "suspect") for c in cells), [c.reasons for c in cells]
    for cell in cells:
        assert cell.frequency_Hz == pytest.approx(MODE, rel=0.04)
        assert cell.standard_uncertainty_Hz > 0
        assert cell.damping_ratio is None
        assert cell.method == "paper"
        assert cell.band_Hz[0] < MODE < cell.band_Hz[1]
        terms = cell.uncertainty_terms_Hz
        assert "conditions" in terms
        assert cell.standard_uncertainty_Hz == pytest.approx(np.sqrt(sum(v**2 for v in terms.values())))
    validate(response, FREQUENCY_RESPONSE)
    assert response.sizes["cell"] == 8
    assert response["repetitions"].values.tolist() == [3] * 8
    assert response.attrs["input_unit"] == "N"


def test_the_conditions_disagreement_is_one_for_all(table):
    cells, _ = identified(table)
    assert len({cell.uncertainty_terms_Hz["conditions"] for cell in cells}) == 1


def test_cells_that_were_not_measured_are_listed(table):
    plan = replace(PLAN, positions=(*STOPS, 0.18))
    cells, _ = identified(table, plan=plan)
    missing = [c for c in cells if c.position_m == 0.18]
    assert [c.condition for c in missing] == ["PD", "NA"]
    for cell in missing:
        assert (cell.verdict, cell.repetitions, cell.frequency_Hz) == ("refused", 0, None)
        assert cell.reasons == ("no transient of this cell was measured",)


def test_a_cell_of_cut_phases_alone_is_listed_and_refused(table):
    cut = table.copy(deep=True)
    at = (cut["position_m"].values == 0) & (cut["condition"].values == "PA")
    cut["complete"].values[at] = False
    for plan in (PLAN, None):
        cells, _ = identified(cut, plan=plan)
        (first,) = [c for c in cells if abs(c.position_m) < 0.01 and c.condition == "PA"]
        assert first.verdict == "refused"
        assert first.reasons


def test_a_bad_measurement_refuses_every_cell(table):
    cells, response = identified(table, quality=Quality("bad", ("torque is clipped",)))
    assert response is None
    for cell in cells:
        assert (cell.verdict, cell.frequency_Hz) == ("refused", None)
        assert cell.reasons == ("the measurement is bad: torque is clipped",)


def test_no_transient_at_all():
    cells, response = identified(None)
    assert response is None
    assert len(cells) == 8
    assert all(c.verdict == "refused" for c in cells)
    assert identified(None, plan=None) == ((), None)


def test_without_a_sheet_all_are_refused_and_the_spectra_are_there(table):
    cells, response = identified(table, sheet=None, plan=None)
    assert response.sizes["cell"] == 8
    assert all("neither a data sheet" in c.reasons[0] for c in cells)


def test_a_stray_peak_is_refused_by_its_neighbours(table):
    """One cell rings 20 % higher than the rest of the axis: another part rings there."""
    other = table_of(Plant(frequency=1.2 * MODE, servo=0.5), seed=1)
    mixed = table.copy(deep=True)
    at = (mixed["position_m"].values == mixed["position_m"].values[0]) & (mixed["condition"].values == "PA")
    for name in ("input", "position"):
        size = min(mixed[name].shape[1], other[name].shape[1])
        mixed[name].values[at, :size] = other[name].values[at, :size]
    size = min(mixed["acceleration"].shape[2], other["acceleration"].shape[2])
    mixed["acceleration"].values[:, at, :size] = other["acceleration"].values[:, at, :size]
    for name in ("onset", "end", "length"):
        mixed[name].values[at] = np.minimum(other[name].values[at], size)
    cells, _ = identified(mixed)
    strays = [c for c in cells if "off the curve" in " ".join(c.reasons)]
    assert [(c.position_m, c.condition) for c in strays] == [(0.0, "PA")]
    assert strays[0].frequency_Hz is None
    assert strays[0].standard_uncertainty_Hz is None


def test_motions_have_cells_of_their_own():
    slow = replace(MOTION, speed=0.05)
    plan = replace(PLAN, motions=(MOTION, slow))
    stops = [*trip(STOPS), *trip(STOPS)[1:]]
    move = way(stops, RATE, [MOTION] * 4 + [slow] * 4)
    aligned = Plant(frequency=MODE, servo=0.5).run(move)
    segments = cut(aligned, find_phases(kinematics(aligned.position, aligned.rate)), 0)
    cells, _ = identified(label(segments, aligned, 100.0, plan), plan=plan)
    assert len(cells) == 16
    assert {c.motion for c in cells} == {0, 1}
    assert {c.repetitions for c in cells} == {1}


def test_cells_of_other_windows_share_one_grid(table):
    _, response = identified(table)
    grid = response["frequency"].values
    np.testing.assert_allclose(np.diff(grid), grid[1] - grid[0], rtol=1e-6)
    assert np.isfinite(response["S_uu"].values).all()


@pytest.mark.parametrize("average", ["spectra", "ratios"])
def test_thinned_transients_give_the_same_results(table, average):
    settings = PaperSettings(average=average)
    thin = table_of(Plant(frequency=MODE, servo=0.5), plan=PLAN, top=analyze.highest(SHEET, 100.0, settings))
    assert thin.attrs["step"] > 1
    whole, whole_response = identified(table, settings=settings)
    cells, response = identified(thin, settings=settings)
    for one, other in zip(cells, whole, strict=True):
        assert one.verdict == other.verdict
        assert one.frequency_Hz == pytest.approx(other.frequency_Hz, rel=1e-4)
        assert one.standard_uncertainty_Hz == pytest.approx(other.standard_uncertainty_Hz, rel=1e-2)
    np.testing.assert_allclose(response["frequency"], whole_response["frequency"])
    band = (response["frequency"].values > 0.75 * MODE) & (response["frequency"].values < 1.25 * MODE)
    h1, true = (each["H1"].values[..., band] for each in (response, whole_response))
    strong = whole_response["coherence"].values[..., band] > 0.9
    assert np.abs(h1 / true - 1)[strong].max() < 1e-4


def test_spectra_without_a_frequency(table):
    """For a method that reads them by itself: the same cells, the same spectra, no peak."""
    cells, response = identify_cells(table, GOOD, SHEET, PLAN, 100.0, PaperSettings(), spectra_alone=True)
    whole, same = identified(table)
    assert response.identical(same)
    assert [(c.position_m, c.condition, c.repetitions) for c in cells] == [
        (c.position_m, c.condition, c.repetitions) for c in whole
    ]
    assert {c.frequency_Hz for c in cells} == {None}


def peaks_of(frequencies, repetitions=3):
    """Results of cells of one condition, 45 mm from each other; None is a refused one that was measured."""
    out = {}
    for number, frequency in enumerate(frequencies):
        cell = CellResult(0.045 * number, "PA", 0, repetitions, frequency, 0.5, None, "paper", "good", ())
        if frequency is None:
            cell = CellResult.refused(cell.key, repetitions, "paper", [Reason("no-mode", "no peak")])
        out[cell.key] = cell
    return out


def test_a_few_peaks_on_a_curve_are_no_mode_of_the_axis():
    few = _refuse_strays(peaks_of([150.0, 149.0, *[None] * 10]))
    assert {cell.verdict for cell in few.values()} == {"refused"}
    first, *_ = few.values()
    assert first.reasons == (
        "only 2 of 12 cells show a peak on one curve along the axis: that is no mode of it",
    )
    enough = peaks_of([150.0, 149.0, 148.0, 147.0, *[None] * 8])
    assert _refuse_strays(enough) == enough
    nothing = peaks_of([None] * 3)
    assert _refuse_strays(nothing) == nothing


@pytest.mark.parametrize(("scatter", "verdict"), [(0.3, "good"), (3.0, "suspect"), (30.0, "refused")])
def test_conditions_of_a_stop_that_disagree_make_a_cell_suspect_or_refused(scatter, verdict):
    (cell,) = peaks_of([150.0]).values()
    cell = replace(cell, uncertainty_terms_Hz={"window": 0.5})
    assessed = _assess_again(cell, scatter, PaperSettings())
    assert assessed.verdict == verdict
    if verdict == "refused":
        assert assessed.frequency_Hz is None
        assert assessed.reasons[0].endswith(": the conditions of one stop disagree")
    else:
        assert assessed.standard_uncertainty_Hz == pytest.approx(np.hypot(0.5, scatter))
        assert assessed.uncertainty_terms_Hz == {"window": 0.5, "conditions": scatter}
