"""The paper's method on a plant with known truth: its bias, its scatter, and whether its ± is right.

What these tests state is what the method reaches. Without a servo, departures are read within 0.2 % and
their ± is right. A servo on the rotor goes on pushing while the axis rings, which one Hann window cannot
part: the reading is 0.3 to 1.2 % high. At arrivals the ringing of the phase's first blow still lasts where
no servo damps it: a third of the cells is refused for its phase, and the rest is up to 2.6 % off.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from tests.modal.conftest import RATE, STOPS, cell_of, estimate, table_of
from tests.modal.plant import MOTION, Plant, trip, way

from ballscrew.fcft.conditions import Condition
from ballscrew.modal.paper.cell import _amplification, _obstacle
from ballscrew.modal.paper.peak import Peak
from ballscrew.modal.paper.settings import PaperSettings
from ballscrew.modal.paper.window import LEAST, Extent
from ballscrew.modal.spectra import Spectra

DEFAULT = PaperSettings()


def readings(conditions, *, servo, count=25):
    """Errors and stated uncertainties (relative) of ``count`` plants: frequency, damping and sheet vary."""
    rng = np.random.default_rng(1)
    out = []
    for seed in range(count):
        frequency, damping = rng.uniform(110, 190), rng.uniform(0.03, 0.05)
        expected = frequency * rng.uniform(0.95, 1.05)
        table = table_of(Plant(frequency=frequency, damping=damping, servo=servo), seed=seed)
        for condition in conditions:
            mode = estimate(cell_of(table, condition), condition, expected)[0]
            refused = (np.nan, np.nan)
            found = mode.frequency_Hz is not None
            out.append(
                ((mode.frequency_Hz - frequency) / frequency, mode.standard_uncertainty_Hz / frequency)
                if found
                else refused
            )
    errors, stated = np.array(out).T
    return errors, stated


DEPARTURES, ARRIVALS = (Condition.PA, Condition.NA), (Condition.PD, Condition.ND)


@pytest.fixture(scope="module")
def free():
    return readings(Condition, servo=0.5)


@pytest.fixture(scope="module")
def held():
    return readings(Condition, servo=40.0)


def of(result, conditions, least=0.95):
    errors, stated = (part.reshape(-1, 4) for part in result)
    columns = [list(Condition).index(c) for c in conditions]
    errors, stated = errors[:, columns].ravel(), stated[:, columns].ravel()
    assert np.isfinite(errors).mean() >= least, "part of the cells that is reported"
    return errors[np.isfinite(errors)], stated[np.isfinite(errors)]


@pytest.mark.slow
def test_departures_of_a_free_rotor(free):
    errors, stated = of(free, DEPARTURES)
    assert abs(errors.mean()) < 3e-4, "bias"
    assert np.abs(errors).max() < 4e-3
    assert np.mean(np.abs(errors) < 1.96 * stated) > 0.9, "coverage of the 95 % intervals"
    assert np.median(stated) < 7e-3, "an interval that holds everything says nothing"


def test_arrivals_of_a_free_rotor(free):
    errors, _ = of(free, ARRIVALS, least=0.6)
    assert abs(errors.mean()) < 8e-3, "bias"
    assert np.median(np.abs(errors)) < 0.015
    assert np.abs(errors).max() < 0.03


@pytest.mark.slow
def test_a_servo_on_the_rotor(held):
    for conditions, bias in ((DEPARTURES, 0.0094), (ARRIVALS, 0.0062)):
        errors, _ = of(held, conditions)
        assert errors.mean() == pytest.approx(bias, abs=1.5e-3)
        assert errors.std() < 2.5e-3
        assert np.abs(errors).max() < 0.0125


@pytest.mark.parametrize("conditions", [DEPARTURES, ARRIVALS], ids=["departures", "arrivals"])
def test_the_intervals_contain_the_true_value_under_a_servo(held, conditions):
    errors, stated = of(held, conditions)
    assert np.mean(np.abs(errors) < 1.96 * stated) > 0.85


@pytest.mark.xfail(reason="the ringing of a phase's first blow is no part of the ± at its second")
def test_the_intervals_contain_the_true_value_at_arrivals(free):
    errors, stated = of(free, ARRIVALS, least=0.6)
    assert np.mean(np.abs(errors) < 1.96 * stated) > 0.85


@pytest.mark.slow
def test_scatter_over_repetitions_is_what_the_jackknife_says():
    """Same plant, 25 runs of three noisy repetitions."""
    noisy = Plant(servo=0.5, ripple=10.0, acceleration_noise=0.1)
    modes = [estimate(cell_of(table_of(noisy, seed=seed), "PA"), "PA", 150.0)[0] for seed in range(25)]
    scatter = np.std([mode.frequency_Hz for mode in modes], ddof=1)
    stated = np.sqrt(np.mean([mode.uncertainty_terms_Hz["repetitions"] ** 2 for mode in modes]))
    assert 0.05 < scatter < 0.6
    assert stated == pytest.approx(scatter, rel=0.45), "3 repetitions, 25 runs: ± 20 % by chance"


def test_what_a_good_cell_says(cell):
    mode, spectra = estimate(cell("PA"), "PA", 150.0)
    assert (mode.verdict, mode.reasons, mode.repetitions) == ("good", (), 3)
    assert mode.band_Hz == pytest.approx((112.5, 187.5))
    assert mode.coherence > 0.99
    assert mode.standard_uncertainty_Hz == pytest.approx(
        np.sqrt(sum(v**2 for v in mode.uncertainty_terms_Hz.values()))
    )
    assert set(mode.uncertainty_terms_Hz) == {"repetitions", "window", "moving table", "method"}
    assert spectra.count == 3


@pytest.mark.parametrize("sheet", [0.9, 0.95, 1.05, 1.15])
def test_the_sheet_decides_where_to_look_and_little_else(cell, sheet):
    mode, _ = estimate(cell("PA"), "PA", 150.0 * sheet)
    assert mode.frequency_Hz == pytest.approx(150.0, rel=0.006)


def test_a_table_that_moves_while_it_rings_costs_certainty(cell):
    still, moving = (estimate(cell("PA"), "PA", 150.0, slope)[0] for slope in (0.0, -150.0))
    travelled = moving.uncertainty_terms_Hz["moving table"] / 150.0
    assert 1e-4 < travelled < 2e-3, "the table leaves the stop by about a millimetre"
    assert moving.standard_uncertainty_Hz > still.standard_uncertainty_Hz
    assert moving.frequency_Hz == still.frequency_Hz


@pytest.mark.parametrize("estimator", ["H1", "H2", "Hv"])
@pytest.mark.parametrize("average", ["spectra", "ratios"])
def test_every_reading_of_the_paper(cell, estimator, average):
    settings = PaperSettings(estimator=estimator, average=average)
    mode, _ = estimate(cell("PA"), "PA", 150.0, settings=settings)
    assert mode.frequency_Hz == pytest.approx(150.0, abs=1.0)


def test_repetition_of_one_is_suspect(cell):
    mode, _ = estimate(cell("PA").isel(transient=[0]), "PA", 150.0)
    assert mode.verdict == "suspect"
    assert "one repetition" in mode.reasons[0]
    assert mode.repetitions == 1


def refusal(rows, condition, expected=150.0, settings=DEFAULT):
    mode, _ = estimate(rows, condition, expected, settings=settings)
    assert mode.verdict == "refused", mode
    assert mode.frequency_Hz is None
    assert mode.standard_uncertainty_Hz is None
    assert mode.reasons
    return "; ".join(mode.reasons)


@pytest.mark.parametrize("seed", range(12))
def test_noise_alone_is_refused(quiet_table, seed):
    """None of 12 × 4 cells of unrelated noise is a mode."""
    for condition in Condition:
        rows = cell_of(quiet_table, condition).copy(deep=True)
        rng = np.random.default_rng(seed)
        rows["input"].values[:] = rng.standard_normal(rows["input"].shape)
        rows["acceleration"].values[:] = rng.standard_normal(rows["acceleration"].shape)
        refusal(rows, condition)


@pytest.mark.parametrize("condition", list(Condition))
def test_a_rigid_axis_is_refused(condition):
    """No mode below 1 kHz: what ripples in the band is noise and nulls."""
    table = table_of(Plant(frequency=1200.0, damping=0.1))
    refusal(cell_of(table, condition), condition)


@pytest.mark.parametrize("band", [(60.0, 110.0), (80.0, 120.0), (200.0, 300.0), (250.0, 400.0)])
@pytest.mark.parametrize("condition", list(Condition))
def test_a_band_without_the_mode_is_refused(cell, band, condition):
    refusal(cell(condition), condition, settings=PaperSettings(band=band))


def test_a_band_that_ends_on_the_modes_flank_is_refused(cell):
    for band in ((100.0, 147.0), (154.0, 200.0)):
        refusal(cell("PA"), Condition.PA, settings=PaperSettings(band=band))


def test_a_rate_too_low_for_the_band_is_refused():
    move = way(trip(STOPS), 400)
    table = table_of(Plant(frequency=100.0, servo=0.5, ripple=0.5), move=move)
    words = refusal(cell_of(table, "PA"), Condition.PA, 150.0)
    assert words.startswith("the rate of 400 Hz is too low for the band up to 188 Hz")


def test_ringing_that_is_cut_off_is_refused():
    short = replace(MOTION, dwell=0.015)
    table = table_of(Plant(servo=0.5), move=way(trip(STOPS), RATE, short))
    words = refusal(cell_of(table, "PD"), Condition.PD)
    assert "the ringing is cut off" in words
    assert " ms later" in words


def test_without_sheet_or_band_there_is_no_search_band(cell):
    mode, spectra = estimate(cell("PA"), "PA", None)
    assert mode.verdict == "refused"
    assert "neither a data sheet (--axis) nor --band gives a search band" in mode.reasons[0]
    assert spectra is not None
    assert mode.band_Hz is None


def test_a_band_does_without_a_sheet(cell):
    mode, _ = estimate(cell("PA"), "PA", None, settings=PaperSettings(band=(110.0, 190.0)))
    assert mode.frequency_Hz == pytest.approx(150.0, abs=0.5)


def test_a_torque_that_excites_nothing_is_refused(cell):
    words = refusal(cell("PA"), Condition.PA, settings=PaperSettings(least_excitation=1e6))
    assert "the torque hardly excites" in words


def test_no_room_for_the_window_is_refused(cell):
    """One record has room before the blow, the other after it, and none both."""
    rows = cell("PA").isel(transient=[0, 1]).copy(deep=True)
    rows["onset"].values[:], rows["length"].values[:] = [740, 5], [750, 1400]
    assert "no transient contains the whole window" in refusal(rows, Condition.PA)


def test_a_dead_sensor_is_refused(cell):
    rows = cell("PA").copy(deep=True)
    rows["acceleration"].values[:] = 0.0
    refusal(rows, Condition.PA)
    rows = cell("PA").copy(deep=True)
    rows["input"].values[:] = 0.0
    refusal(rows, Condition.PA)


def test_a_phase_too_short_to_separate_its_blows_is_suspect(cell):
    expected = 149.5  # four periods are 133.8 samples
    for periods, verdict in ((LEAST + 0.1, "good"), (LEAST - 0.5, "suspect")):
        rows = cell("PA")
        rows = rows.assign(end=rows["onset"] + round(periods * RATE / expected))
        mode, _ = estimate(rows, "PA", expected)
        assert mode.verdict == verdict
        assert mode.frequency_Hz == pytest.approx(150.0, abs=3.0)
    assert mode.reasons == ("the phase is too short to separate the blows at its two ends",)


@pytest.mark.parametrize(("lowest", "known"), [(20.0, True), (50.0, False)])
def test_the_height_of_a_peak_is_relative_to_the_frf_far_below_it(lowest, known):
    f = np.arange(lowest, 300.0, 2.0)
    flat = np.where(f < 60.0, 2.0, 5.0)
    spectra = Spectra(f, np.ones(len(f)), flat[None] ** 2, flat[None].astype(complex), 3)
    found = _amplification(Peak(150.0, 24.0, at_edge=False), spectra)
    assert found == pytest.approx(12.0) if known else np.isnan(found)


@pytest.mark.parametrize(("missing", "suffices"), [(0, True), (1, False)])
def test_a_window_of_the_least_length_suffices_though_it_ends_on_a_sample(
    missing: int, suffices: bool
) -> None:
    rate, centre = 5000.0, 150.0
    after = math.floor(LEAST * rate / centre) - missing
    assert (_obstacle((100.0, 200.0), Extent(10, after), rate, centre) is None) == suffices
