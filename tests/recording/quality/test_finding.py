from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.docs.test_reasons import codes_in_the_source

from ballscrew.base.errors import InputError
from ballscrew.recording.quality.finding import _RANK, Finding, Quality, in_order


def test_nothing_found_is_good():
    assert Quality.of(()) == Quality("good", ())


def test_the_worst_finding_gives_the_verdict_and_stands_first():
    suspect, bad = Finding("suspect", "hum", "a.h5: it hums"), Finding("bad", "nan", "a.h5: it has NaN")
    assert Quality.of([suspect]).verdict == "suspect"
    assert Quality.of([suspect, bad]) == Quality("bad", ("a.h5: it has NaN", "a.h5: it hums"))


def test_the_same_message_counts_once():
    fault = Finding("suspect", "load", "the load is wrong")
    assert Quality.of([fault, fault, Finding("suspect", "other", "the load is wrong")]).reasons == (
        fault.message,
    )


def test_a_fault_of_several_files_is_one_sentence_with_the_numbers_of_the_first():
    found = [Finding("suspect", "clipped", f"trip{i}.h5: torque is clipped at ±1.{i} N m") for i in (1, 2, 3)]
    assert Quality.of(found).reasons == (
        "trip1.h5 (likewise trip2.h5, trip3.h5): torque is clipped at ±1.1 N m",
    )


def test_many_files_are_counted_not_listed():
    found = [Finding("suspect", "hum", f"trip{i}.csv: it hums") for i in range(30)]
    assert Quality.of(found).reasons == (
        "trip0.csv (likewise trip1.csv, trip2.csv, trip3.csv and 26 more): it hums",
    )


def test_two_channels_of_two_files_are_two_sentences():
    found = [
        Finding("suspect", "scale", f"trip{i}.h5: acceleration:nut-{k}:x has 0.9 times the motion")
        for i in (1, 2)
        for k in (1, 2)
    ]
    assert len(Quality.of(found).reasons) == 2


def test_json_and_back():
    quality = Quality.of([Finding("bad", "nan", "a.h5: it has 3 NaN")], ["in m", "in m"])
    document = {"verdict": "bad", "reasons": ["a.h5: it has 3 NaN"], "notes": ["in m"]}
    assert quality.to_json() == document
    assert Quality.from_json(document) == quality
    assert Quality.from_json({"verdict": "good", "reasons": []}).notes == ()


@pytest.mark.parametrize(
    "document",
    [
        {},
        {"verdict": "green", "reasons": []},
        {"verdict": "good"},
        {"verdict": "good", "reasons": "all"},
        {"verdict": "good", "reasons": [], "notes": "all"},
        {"verdict": ["good"], "reasons": []},
        {"verdict": "bad", "reasons": [1]},
    ],
)
def test_a_verdict_that_is_none_is_refused(document):
    with pytest.raises(InputError, match=r"quality\.(verdict|reasons|notes)"):
        Quality.from_json(document)


FINDINGS = st.builds(
    Finding, st.sampled_from(["bad", "suspect"]), st.sampled_from("ab"), st.text(max_size=30)
)


@given(st.lists(FINDINGS))
def test_no_reason_is_lost_altogether_and_the_verdict_is_the_worst(findings):
    quality = Quality.of(findings)
    severities = {finding.severity for finding in findings}
    worst = "bad" if "bad" in severities else "suspect" if severities else "good"
    assert quality.verdict == worst
    assert bool(quality.reasons) == bool(findings)
    assert len(set(quality.reasons)) == len(quality.reasons)
    assert Quality.from_json(quality.to_json()) == quality


@pytest.mark.parametrize(
    ("cause", "effect"),
    [
        (("suspect", "polarity"), ("bad", "repetitions")),
        (("suspect", "speed"), ("suspect", "set-aside")),
        (("suspect", "wrapped"), ("suspect", "unrelated")),
        (("suspect", "clipped"), ("suspect", "set-aside")),
        (("suspect", "delay-changes"), ("bad", "delay")),
        (("suspect", "copies"), ("suspect", "pause")),
        (("suspect", "rate"), ("suspect", "delay")),
        (("bad", "flat"), ("bad", "wrapped")),
        (("bad", "hum"), ("suspect", "load")),
    ],
    ids=str,
)
def test_a_cause_stands_before_its_consequence_and_the_verdict_is_the_worst(cause, effect):
    found = [Finding(*effect, "a.h5: the effect"), Finding(*cause, "a.h5: the cause")]
    for findings in (found, found[::-1]):
        quality = Quality.of(findings)
        assert quality.reasons == ("a.h5: the cause", "a.h5: the effect")
        assert quality.verdict == min(cause[0], effect[0])
        assert [finding.code for finding in in_order(findings)] == [cause[1], effect[1]]


def test_every_code_that_is_ordered_is_one_that_is_found():
    assert set(_RANK) <= codes_in_the_source()


def test_a_name_with_control_characters_cannot_add_a_line():
    assert Finding("bad", "clipped", "a\x1b[31m\nb: is clipped").message == "a\\x1b[31m\\nb: is clipped"
