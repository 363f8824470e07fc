"""P(x): a dent is found where it is, an even axis has none."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from tests.estimation.made_runs import STOPS, calibrated, run_of

from ballscrew.calibration.assumptions import Assumptions
from ballscrew.estimation.local_wear import largest_contrast, possible_places
from ballscrew.estimation.preload import preload

QUIET = 3e-4  # scatter of a cell's deviation, as a part of the frequency


def dent(middle: float, loss: float = 0.3, width: float = 0.09):
    return lambda x: np.where(np.abs(x - middle) <= width / 2 + 1e-9, 1 - loss, 1.0)


@pytest.mark.parametrize("middle", [0.0, 0.09, 0.225, 0.36, 0.45])
@pytest.mark.parametrize("seed", range(3))
def test_a_local_loss_is_found_within_a_stop(middle: float, seed: int) -> None:
    base = run_of(name="base", scatter=QUIET, seed=50 + seed)
    run = run_of(dent(middle), local=True, scatter=QUIET, seed=seed)
    found = preload(run, calibrated(), base)
    assert found.profile is not None
    assert found.profile.found
    assert min(abs(np.array(found.profile.places) - middle)) <= 0.045 + 1e-9
    assert found.profile.loss is not None
    assert found.profile.loss.value == pytest.approx(0.3, abs=0.12)
    assert found.verdict == "suspect"
    assert any("wear is local" in reason for reason in found.reasons)
    assert found.to_json()["profile"]["local"]["found"] is True


def test_the_loss_is_reported_with_an_interval_that_contains_it() -> None:
    contained, off = 0, []
    for seed in range(20):
        base = run_of(name="base", scatter=QUIET, seed=500 + seed)
        found = preload(run_of(dent(0.225), local=True, scatter=QUIET, seed=600 + seed), calibrated(), base)
        assert found.profile is not None
        loss = found.profile.loss
        assert loss is not None
        assert f"{100 * loss.value:.0f} % ± {100 * loss.standard_uncertainty:.0f} %" in found.profile.text
        contained += loss.interval[0] < 0.3 < loss.interval[1]
        off.append((loss.value - 0.3) / loss.standard_uncertainty)
    assert contained >= 16
    assert np.sqrt(np.mean(np.square(off))) < 1.5


def test_a_stop_without_an_upper_end_is_omitted() -> None:
    noisy = {"scatter": 2e-2, "uncertainty": 1e-3}
    found = preload(run_of(1.0, seed=3, **noisy), calibrated(), run_of(name="base", seed=4, **noisy)).profile
    assert found is not None
    assert len(found.position) == len(found.ratio)
    for _, ratio in (*zip(found.position, found.ratio, strict=True), *found.groups):
        assert ratio.interval[1] < 8000


def test_the_cells_own_noise_counts_once() -> None:
    """Stated and observed scatter give the same uncertainty."""
    spreads = []
    for own in (1e-6, 1e-3):
        runs = [
            own_noise(run_of(r, scatter=1e-3, seed=s, name=n), own)
            for r, s, n in ((1, 1, "run"), (1, 2, "base"))
        ]
        along = preload(runs[0], calibrated(), runs[1]).profile
        assert along is not None
        spreads.append(np.median([ratio.standard_uncertainty for ratio in along.ratio]))
    assert spreads[1] == pytest.approx(spreads[0], rel=0.15)


def own_noise(run, part: float):
    """The run with independent errors of its cells."""
    cells = tuple(
        dataclasses.replace(c, standard_uncertainty_Hz=part * c.frequency_Hz, uncertainty_terms_Hz={})
        for c in run.cells
    )
    return dataclasses.replace(run, cells=cells)


def test_the_rate_of_false_alarms_is_an_assumption() -> None:
    limits = []
    for alarm in (0.005, 0.2):
        along = preload(
            run_of(0.95, scatter=QUIET), calibrated(), run_of(name="base", scatter=QUIET, seed=1),
            assumptions=Assumptions(local_alarm=alarm),
        ).profile  # fmt: skip
        assert along is not None
        limits.append(along.limit)
    assert limits[1] < limits[0] - 1


def test_even_wear_shows_no_place() -> None:
    false = 0
    for seed in range(40):
        base = run_of(name="base", scatter=QUIET, seed=100 + seed)
        along = preload(run_of(0.95, scatter=QUIET, seed=seed), calibrated(), base).profile
        assert along is not None
        false += along.found
    assert false <= 1


def test_the_course_is_that_of_the_wear() -> None:
    base = run_of(name="base", scatter=QUIET / 3, seed=5)
    run = run_of(dent(0.225), local=True, scatter=QUIET / 3, seed=6)
    along = preload(run, calibrated(), base).profile
    assert along is not None
    ratios = dict(zip(along.position, along.ratio, strict=True))
    assert ratios[0.225].value == pytest.approx(0.7, abs=0.08)
    assert ratios[0.045].value == pytest.approx(1.0, abs=0.08)
    for x, ratio in ratios.items():
        low, high = ratio.interval
        assert low < dent(0.225)(x) < high


def test_conditions_are_compared() -> None:
    along = preload(run_of(0.6), calibrated(), run_of(name="base")).profile
    assert along is not None
    assert {name for name, _ in along.groups} == {"PA 0", "ND 0", "NA 0", "PD 0"}
    for _, ratio in along.groups:
        assert ratio.value == pytest.approx(0.6, abs=0.03)  # what is a condition's own cancels


def test_a_local_loss_is_found_without_a_baseline_too() -> None:
    along = preload(run_of(dent(0.18), local=True, scatter=QUIET), calibrated()).profile
    assert along is not None
    assert along.found
    assert 0.18 in along.places


def test_few_stops_have_no_profile() -> None:
    stops = STOPS[:4]
    assert preload(run_of(0.6, stops=stops), calibrated(), run_of(name="base", stops=stops)).profile is None


def test_windows_are_neighbours_of_a_third_at_most() -> None:
    places = possible_places(6)
    assert (0, 1) in places
    assert (4, 6) in places
    assert max(past - first for first, past in places) == 2
    assert possible_places(2) == [(0, 1), (1, 2)]


def test_the_limit_is_exceeded_as_rarely_as_stated() -> None:
    rng = np.random.default_rng(3)
    stops, free = 9, 12
    nut, noise = np.full(stops, 0.2), np.full(stops, 1e-6)
    basis = np.vander(np.linspace(-1, 1, stops), 2)
    over = 0
    for _ in range(300):
        guessed = noise * rng.chisquare(free) / free
        means = np.sqrt(noise) * rng.standard_normal(stops)
        statistic, limit, _ = largest_contrast(means, guessed, free, nut, basis, possible_places(stops))
        over += statistic > limit
    assert over <= 6  # 1.5 expected


def test_a_gain_of_preload_is_no_local_wear() -> None:
    nut, noise = np.full(9, 0.2), np.full(9, 1e-6)
    means = np.zeros(9)
    means[4] = -0.02
    statistic, limit, best = largest_contrast(
        means, noise, 20, nut, np.vander(np.linspace(-1, 1, 9), 2), possible_places(9)
    )
    assert possible_places(9)[best] != (4, 5)
    assert limit > 0
    assert statistic < 20
