"""Events and the epochs that they make."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballscrew.base.errors import InputError
from ballscrew.monitoring.epochs import BEGINS, KINDS, Event, epochs_of, moment, read_events

NUT = Event("2026-02-01T08:00Z", "nut replaced", "by the night shift")
GREASE = Event("2026-01-10", "greased")


def test_a_file_of_events_is_read_in_time_order(tmp_path: Path) -> None:
    file = tmp_path / "EVENTS.toml"
    file.write_text(
        '[[events]]\nat = "2026-02-01T08:00Z"\nkind = "nut replaced"\ntext = "by the night shift"\n'
        '[[events]]\nat = 2026-01-10\nkind = "greased"\n',
        encoding="utf-8",
    )
    read = read_events(file)
    assert [event.kind for event in read] == ["greased", "nut replaced"]
    assert read[1] == NUT


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ('[[events]]\nkind = "greased"\n', "at is missing"),
        ('[[events]]\nat = "yesterday"\nkind = "greased"\n', "yesterday"),
        ('[[events]]\nat = 5\nkind = "greased"\n', "at is 5"),
        ('[[events]]\nat = "2026-01-10"\nkind = "oiled"\n', "oiled"),
        ('[[events]]\nat = "2026-01-10"\n', "kind is missing"),
        ('[[events]]\nat = "2026-01-10"\nkind = "note"\ntxt = "x"\n', "txt"),
        ("events = 3\n", "events"),
        ("[event]\n", "event"),
    ],
)
def test_wrong_files_are_refused(tmp_path: Path, text: str, what: str) -> None:
    file = tmp_path / "EVENTS.toml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=what):
        read_events(file)


def test_an_empty_file_has_no_event(tmp_path: Path) -> None:
    file = tmp_path / "EVENTS.toml"
    file.write_text("", encoding="utf-8")
    assert read_events(file) == ()


def test_a_new_nut_begins_an_epoch_and_grease_does_not() -> None:
    first, second = epochs_of([NUT, GREASE])
    assert (first.begins, first.ends, first.events) == (None, NUT.at, (GREASE,))
    assert (second.begins, second.ends, second.cause, second.events) == (NUT.at, None, "nut replaced", (NUT,))


def test_what_comes_after_the_newest_run_begins_no_epoch() -> None:
    (only,) = epochs_of([NUT, GREASE], moment("2026-01-31T08:00Z", "a run"))
    assert (only.begins, only.ends, only.events) == (None, None, (GREASE, NUT))
    assert len(epochs_of([NUT, GREASE], moment(NUT.at, "a run"))) == 2


@given(st.lists(st.tuples(st.integers(0, 400), st.sampled_from(KINDS)), max_size=12))
def test_epochs_contain_every_event_once(rows: list[tuple[int, str]]) -> None:
    events = [Event(f"2026-01-01T{day % 24:02d}:{day // 24:02d}Z", kind) for day, kind in rows]
    found = epochs_of(events)
    inside = [event.at for epoch in found for event in epoch.events]
    assert sorted(inside) == sorted(event.at for event in events)
    begins = {event.at for event in events if event.kind in BEGINS}
    assert len(found) == len(begins) + 1


@pytest.mark.parametrize("time", ["0001-01-01T00:00Z", "1969-12-31", "2126-01-01", "9999-12-31T23:59Z"])
def test_a_year_that_no_test_was_run_in_is_refused(time: str) -> None:
    with pytest.raises(InputError, match="look at the clock"):
        moment(time, "a run")
    assert moment("1970-01-01", "a run").year == 1970
