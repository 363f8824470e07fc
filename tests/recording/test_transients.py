from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.modal.plant import MOTION, Plant, trip, way

from ballscrew.base.tables import TRANSIENTS, validate
from ballscrew.fcft.cells import cells
from ballscrew.fcft.plan import Motion, Plan
from ballscrew.recording.kinematics import kinematics
from ballscrew.recording.phases import find_phases
from ballscrew.recording.transients import _hash, cut, label

RATE = 4000
STOPS = (0.0, 0.06, 0.12, 0.18)
PLAN = Plan(STOPS, 3, (100.0,), (MOTION,))


def trip_of(move, file=0, seed=0, responses=1, part=slice(None)):
    aligned = Plant().run(move, seed, responses=responses)
    aligned = replace(
        aligned,
        input=aligned.input[part],
        position=aligned.position[part],
        response=aligned.response[:, part],
    )
    phases = find_phases(kinematics(aligned.position, aligned.rate))
    return aligned, phases, cut(aligned, phases, file)


def labelled(moves, plan=None, **options):
    trips = [trip_of(move, i, i, **options) for i, move in enumerate(moves)]
    return label([s for t in trips for s in t[2]], trips[0][0], 100.0, plan)


@pytest.fixture(scope="module")
def three():
    return labelled([way(trip(STOPS), RATE)] * 3, PLAN)


def test_every_cell_of_the_plan_three_times(three):
    validate(three, TRANSIENTS)
    keys = list(
        zip(three["position_m"].values, three["condition"].values, three["motion"].values, strict=True)
    )
    wanted = {(c.position, str(c.condition), c.motion) for c in cells(PLAN)}
    assert set(keys) == wanted
    assert all(keys.count(key) == 3 for key in wanted)
    assert three["complete"].values.all()
    assert three["mass_kg"].values.tolist() == [100.0] * 36
    assert three.attrs["sample_rate"] == RATE
    assert (three["input"].attrs["unit"], three["input"].attrs["quantity"]) == ("N", "force")


def test_repetitions_are_numbered_over_the_files(three):
    for file in range(3):
        assert (three["repetition"].values[three["file"].values == file] == file + 1).all()


def test_a_table_of_two_trips_in_one_file():
    table = labelled([way([*trip(STOPS), *trip(STOPS)[1:]], RATE)], PLAN)
    assert table["file"].values.max() == 0
    assert table["repetition"].values.tolist() == [1] * 12 + [2] * 12


def test_the_phase_lies_where_it_says(three):
    truth = way(trip(STOPS), RATE).truth
    first = three.isel(transient=slice(0, 12))
    for row, true in enumerate(truth):
        item = first.isel(transient=row)
        assert float(item["start_s"]) == pytest.approx(true.start, abs=2e-3)
        assert float(item["stop_s"]) == pytest.approx(true.stop, abs=2e-3)
        assert float(item["reached_m"]) == pytest.approx(true.place, abs=1e-4)
        assert int(item["end"] - item["onset"]) / RATE == pytest.approx(
            float(item["stop_s"]) - float(item["start_s"])
        )


def test_segments_are_pieces_of_the_recording_and_end_before_their_neighbours():
    aligned, phases, segments = trip_of(way(trip(STOPS), RATE), responses=2)
    for index, segment in enumerate(segments):
        first = segment.phase.start - int(segment.onset)
        last = first + len(segment.input)
        np.testing.assert_array_equal(segment.input, aligned.input[first:last])
        np.testing.assert_array_equal(segment.position, aligned.position[first:last])
        np.testing.assert_array_equal(segment.response, aligned.response[:, first:last])
        assert not np.shares_memory(segment.response, aligned.response)
        assert first <= segment.phase.start < segment.phase.stop <= last
        assert segment.phase.start - first <= 0.15 * RATE + 1
        assert last - segment.phase.stop <= 0.25 * RATE + 1
        if index:
            assert first >= phases[index - 1].stop
        if index + 1 < len(phases):
            assert last <= phases[index + 1].start


def test_padding_is_nought_and_the_length_says_where_it_starts(three):
    for name in ("input", "position", "acceleration"):
        values = three[name].values
        values = values[0] if name == "acceleration" else values
        for row, length in enumerate(three["length"].values):
            assert not values[row, length:].any()
            assert values[row, :length].any()


def test_a_reversal_is_two_at_one_stop():
    table = labelled([way([0.0, 0.06, 0.0], RATE, replace(MOTION, dwell=0.0))])
    assert table["condition"].values.tolist() == ["PA", "PD", "NA", "ND"]
    assert table["position_m"].values == pytest.approx([0, 0.06, 0.06, 0], abs=1e-3)
    lengths, ends = table["length"].values, table["end"].values
    assert lengths[1] == ends[1], "nothing is kept past the turn"
    assert table["onset"].values[2] == 0


def test_without_a_plan_stops_are_clusters():
    table = labelled([way([x + 0.013 for x in trip(STOPS)], RATE)] * 2)
    places = np.unique(table["position_m"].values)
    np.testing.assert_allclose(places, np.array(STOPS) + 0.013, rtol=0, atol=1e-4)
    assert table["repetition"].values.max() == 2


def test_a_plan_gives_the_nominal_place():
    table = labelled([way([x + 4e-4 for x in trip(STOPS)], RATE)], PLAN)
    assert set(table["position_m"].values) <= set(STOPS)
    assert np.abs(table["reached_m"].values - table["position_m"].values - 4e-4).max() < 1e-4


def test_motions_are_separated():
    slow, fast = Motion(0.05, 2.0, 500.0, 0.3), Motion(0.15, 2.0, 500.0, 0.3)
    hard = Motion(0.15, 5.0, 1500.0, 0.3)
    moves = [way(trip(STOPS[:3]), RATE, [slow] * 4), way(trip(STOPS[:3]), RATE, [fast] * 4)]
    assert labelled(moves)["motion"].values.tolist() == [0] * 8 + [1] * 8
    plan = Plan(STOPS[:3], 1, (0.0,), (hard, slow, fast))
    three = labelled([*moves, way(trip(STOPS[:3]), RATE, [hard] * 4)], plan)
    assert three["motion"].values.tolist() == [1] * 8 + [2] * 8 + [0] * 8
    assert three["repetition"].values.tolist() == [1] * 24


def test_a_cut_phase_is_shown_and_counts_for_nothing():
    move = way(trip(STOPS), RATE)
    first = round(RATE * 0.5 * (move.truth[0].start + move.truth[0].stop))
    trips = [trip_of(move, 0, 0, part=slice(first, None)), trip_of(move, 1, 1)]
    table = label([s for t in trips for s in t[2]], trips[0][0], 100.0, PLAN)
    assert table["complete"].values.tolist() == [False] + [True] * 23
    assert table["repetition"].values[0] == 0
    at_start = (table["position_m"].values == 0) & (table["condition"].values == "PA")
    assert table["repetition"].values[at_start].tolist() == [0, 1]


def test_no_transient_at_all():
    like = trip_of(way(STOPS[:2], RATE))[0]
    for plan in (None, PLAN):
        table = label([], like, 0.0, plan)
        validate(table, TRANSIENTS)
        assert table.sizes["transient"] == 0


@pytest.mark.parametrize("load", [100, 100.0])
def test_a_load_may_be_a_whole_number(load):
    like, _, segments = trip_of(way(STOPS[:2], RATE))
    assert label(segments, like, load)["mass_kg"].dtype == np.float64


def test_thinned_segments_keep_the_blow_next_to_standstill_and_what_lies_beside_it():
    aligned, phases, whole = trip_of(way(trip(STOPS), RATE), responses=2)
    top = RATE / 17
    thin = cut(aligned, phases, 0, top)
    step = thin[0].step
    assert step == 5
    for item, all_of in zip(thin, whole, strict=True):
        assert (item.rate, item.step, item.content) == (all_of.rate, step, all_of.content)
        length = item.phase.stop - item.phase.start
        at = item.onset if item.phase.condition.accelerating else item.onset + length / step
        assert at == pytest.approx(round(at), abs=1e-9)
        first = round(all_of.onset - step * item.onset)
        assert 0 <= first < step
        assert len(item.input) == -(-(len(all_of.input) - first) // step)
        np.testing.assert_allclose(item.position, all_of.position[first::step], atol=1e-6)


def test_a_table_of_thinned_segments_says_its_rate():
    aligned, phases, _ = trip_of(way(trip(STOPS), RATE))
    table = label(cut(aligned, phases, 0, RATE / 17), aligned, 100.0, PLAN)
    assert table.attrs["sample_rate"] == RATE / 5
    assert table.attrs["step"] == 5
    assert float(table["start_s"][0]) == pytest.approx(phases[0].start / RATE)


def test_signals_that_are_equal_have_one_hash_and_constant_ones_none():
    x = np.random.default_rng(0).normal(size=100)
    assert _hash(x) == _hash(x.copy()) != _hash(x[::-1])
    assert len(_hash(x)) == 64
    assert _hash(np.zeros(0)) == _hash(np.full(100, 0.5)) == ""
