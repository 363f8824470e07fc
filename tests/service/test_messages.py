"""Which messages are due: hysteresis, quiet hours, digest, escalation, by an injected time."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, time, timedelta
from itertools import pairwise
from typing import Any
from zoneinfo import ZoneInfo

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ballscrew.service.messages import (
    MessagePlan,
    NewDelivery,
    Notice,
    Planned,
    SubjectState,
    keys_of,
    plan_deliveries,
)
from ballscrew.service.recipients import EmailRecipient, MessageRules, Recipient

MONDAY = datetime(2026, 3, 2, 10, tzinfo=UTC)
BERLIN = ZoneInfo("Europe/Berlin")
NIGHT = {"quiet_from": time(22), "quiet_until": time(6)}


def mail(name: str, **rules: Any) -> EmailRecipient:
    return EmailRecipient(to=f"{name}@plant.example", **rules)


ANNA, CHIEF = mail("anna", level="trouble"), mail("chief", escalation=True)


@dataclass
class Plant:
    """An outbox with its alarms, and what was sent; ``at`` is the present hour after Monday, 10:00 UTC."""

    recipients: tuple[Recipient, ...] = (ANNA, CHIEF)
    rules: dict[str, Any] = field(default_factory=dict)
    zone: Any = UTC
    notices: list[Notice] = field(default_factory=list)
    states: dict[str, SubjectState] = field(default_factory=dict)
    statuses: dict[str, str] = field(default_factory=dict)
    sent: list[NewDelivery] = field(default_factory=list)
    hour: float = 0.0

    @property
    def at(self) -> datetime:
        return MONDAY + timedelta(hours=self.hour)

    def change(self, subject: str, kind: str, topic: Any = ("bench", "0"), urgent: bool = False) -> None:
        """An alarm is raised or gone: a row of the outbox, and its state."""
        is_raised = kind == "raised"
        number, is_alarm = len(self.notices) + 1, subject.startswith("alarm")
        row = Notice(number, f"{subject}/{number}", subject, topic, is_alarm, "mill 4", is_raised, self.at)
        self.notices.append(row)
        if not is_raised and self.states[subject].state == "closed":
            return
        self.states[subject] = SubjectState(topic, "raised" if is_raised else "ended", None, urgent)

    def act(self, subject: str, state: str) -> None:
        self.states[subject] = replace(self.states[subject], state=state, acted_at=self.at)

    def plan(self, hour: float | None = None) -> Planned:
        """Plan at a time and send at once."""
        self.hour = self.hour if hour is None else hour
        plan = MessagePlan(self.recipients, MessageRules(**self.rules), self.zone)
        reported = {each.subject: each for each in self.notices if each.reported_at is not None}
        waiting = [each for each in self.notices if each.reported_at is None]
        notices = [*reported.values(), *waiting]
        keys = keys_of(plan, notices, self.at)
        known = {key: status for key, status in self.statuses.items() if key in keys}
        found = plan_deliveries(notices, self.states, known, plan, self.at)
        for place, each in enumerate(self.notices):
            if each.id in found.reported:
                self.notices[place] = replace(each, reported_at=self.at)
        for each in found.deliveries:
            assert each.key not in self.statuses, "planned twice"
            self.statuses[each.key] = "sent"
        self.sent += found.deliveries
        return found

    def log(self, recipient: Recipient = ANNA) -> list[str]:
        return [each.kind for each in self.sent if each.recipient == recipient.label]


def test_an_alarm_is_reported_once_and_its_retraction_after_the_hold_time() -> None:
    plant = Plant()
    plant.change("alarm-1", "raised")
    for hour in (0, 0.01, 5, 20):
        plant.plan(hour)
    assert plant.log() == ["raised"]
    plant.hour = 21
    plant.change("alarm-1", "retracted")
    assert plant.plan(44).waiting == {2: "hold time"}
    plant.plan(45)
    plant.plan(100)
    assert plant.log() == ["raised", "retracted"]
    assert plant.log(CHIEF) == []


def test_a_flapping_axis_makes_one_message_and_the_next_one_counts_it() -> None:
    plant = Plant()
    plant.change("alarm-1", "raised")
    plant.plan()
    for hour in range(1, 12, 2):
        plant.hour = hour
        plant.change("alarm-1", "retracted")
        plant.plan()
        plant.plan(hour + 1)
        plant.change("alarm-1", "raised")
        assert set(plant.plan().waiting.values()) == {"it came back: noted in the next message"}
    plant.hour = 13
    plant.change("alarm-1", "retracted")
    plant.plan(13 + 24)
    assert plant.log() == ["raised", "retracted"]
    assert plant.sent[-1].notices == tuple(range(2, 15))


def test_an_alarm_that_moves_by_a_run_is_the_same_alarm_and_one_of_the_next_epoch_is_not() -> None:
    plant = Plant()
    plant.change("alarm-1", "raised")
    plant.plan()
    plant.change("alarm-1", "retracted")
    plant.change("alarm-2", "raised")
    plant.plan(100)
    assert plant.log() == ["raised"]
    plant.change("alarm-3", "raised", ("bench", "1"))
    plant.plan()
    assert plant.log() == ["raised", "raised"]


def test_one_of_two_alarms_of_an_epoch_that_is_gone_is_no_retraction() -> None:
    plant = Plant()
    plant.change("alarm-1", "raised")
    plant.change("alarm-2", "raised")
    plant.plan()
    plant.change("alarm-2", "retracted")
    plant.plan(100)
    assert plant.log() == ["raised"]


def test_an_alarm_that_came_and_went_while_another_waited_does_not_hide_it() -> None:
    plant = Plant(rules=NIGHT, hour=13)
    plant.change("alarm-2", "raised")
    plant.change("alarm-1", "raised")
    plant.change("alarm-1", "retracted")
    plant.plan(21)
    plant.change("alarm-2", "retracted")
    plant.plan(50)
    assert plant.log() == ["raised", "retracted"]


def test_what_came_and_went_before_it_was_reported_is_not_sent() -> None:
    plant = Plant(rules=NIGHT)
    plant.hour = 13  # 23:00
    plant.change("alarm-1", "raised")
    assert plant.plan().waiting == {1: "quiet hours"}
    plant.change("alarm-1", "retracted")
    assert plant.plan(21).reported == (1, 2)
    assert plant.sent == []


@pytest.mark.parametrize(
    ("zone", "hour", "quiet"),
    [(UTC, 11.9, False), (UTC, 12, True), (UTC, 19.9, True), (UTC, 20, False), (BERLIN, 11, True),
     (BERLIN, 10.9, False), (BERLIN, 18.9, True), (BERLIN, 19, False)],
)  # fmt: skip
def test_quiet_hours_are_those_of_the_time_zone_and_urgent_alarms_pass(
    zone: Any, hour: float, quiet: bool
) -> None:
    for urgent in (False, True):
        plant = Plant(rules=NIGHT, zone=zone, hour=hour)
        plant.change("alarm-1", "raised", urgent=urgent)
        plant.plan()
        assert plant.log() == ([] if quiet and not urgent else ["urgent" if urgent else "raised"])


def test_quiet_hours_may_be_within_a_day() -> None:
    rules = MessageRules(quiet_from=time(9), quiet_until=time(12))
    assert [rules.is_quiet(MONDAY.replace(hour=hour), UTC) for hour in (8, 9, 11, 12)] == [
        False, True, True, False,
    ]  # fmt: skip


def test_an_alarm_that_becomes_urgent_is_reported_once_more() -> None:
    plant = Plant()
    plant.change("alarm-1", "raised")
    plant.plan()
    plant.states["alarm-1"] = replace(plant.states["alarm-1"], is_urgent=True)
    plant.plan(1)
    plant.plan(2)
    assert plant.log() == ["raised", "urgent"]
    plant.change("alarm-1", "retracted")
    plant.plan(50)
    assert plant.log() == ["raised", "urgent", "retracted"]


def test_troubles_are_gathered_to_one_message_a_day_at_an_hour() -> None:
    plant = Plant(recipients=(ANNA, mail("ben")))
    for number, kind in enumerate(("silence", "measurement", "silence"), start=1):
        plant.change(f"trouble-{number}", "raised", (f"axis {number}", kind))
    assert set(plant.plan(20.9).waiting.values()) == {"the next digest"}
    plant.change("trouble-1", "ended", ("axis 1", "silence"))  # before the digest
    found = plant.plan(21.5)  # 07:30: the server did not run at 07:00
    assert [each.kind for each in found.deliveries] == ["digest"]
    assert found.deliveries[0].notices == (2, 3)
    plant.change("trouble-4", "raised", ("axis 4", "silence"))
    assert plant.plan(44.9).deliveries == ()
    assert plant.plan(45).deliveries[0].notices == (5,)
    assert plant.log(mail("ben")) == []


def test_a_trouble_that_is_stored_after_the_digest_of_its_day_waits_for_the_next() -> None:
    plant = Plant(hour=20)
    plant.change("trouble-1", "raised", ("axis 1", "silence"))
    plant.plan(21)
    plant.hour = 20.9  # its time is before the digest
    plant.change("trouble-2", "raised", ("axis 2", "silence"))
    assert plant.plan(21.1).waiting == {2: "the next digest"}
    assert plant.plan(45).deliveries[0].notices == (2,)


def test_a_trouble_that_has_ended_is_reported_in_the_digest_after_the_hold_time() -> None:
    plant = Plant()
    plant.change("trouble-1", "raised", ("bench", "silence"))
    plant.plan(21)
    plant.hour = 30
    plant.change("trouble-1", "ended", ("bench", "silence"))
    for hour in range(31, 69):
        plant.plan(hour)
    assert plant.log() == ["digest"]
    plant.plan(69)
    assert plant.log() == ["digest", "digest"]


def test_a_trouble_is_sent_at_once_without_a_digest() -> None:
    plant = Plant(rules={"digest_hour": -1, "hold_h": 1})
    plant.change("trouble-1", "raised", ("bench", "silence"))
    plant.plan()
    plant.change("trouble-1", "ended", ("bench", "silence"))
    plant.plan(1)
    assert plant.log() == ["raised", "ended"]


def test_an_alarm_that_nobody_acknowledges_is_escalated_once_and_its_retraction_follows() -> None:
    plant = Plant()
    plant.change("alarm-1", "raised")
    plant.plan()
    plant.plan(23.9)
    assert plant.log(CHIEF) == []
    plant.plan(24)
    plant.plan(25)
    assert plant.log(CHIEF) == ["escalation"]
    plant.change("alarm-1", "retracted")
    plant.plan(49)
    assert (plant.log(), plant.log(CHIEF)) == (["raised", "retracted"], ["escalation", "retracted"])


@pytest.mark.parametrize("state", ["acknowledged", "shelved", "closed"])
def test_whoever_acts_on_an_alarm_stops_its_escalation(state: str) -> None:
    plant = Plant()
    plant.change("alarm-1", "raised")
    plant.plan()
    plant.hour = 23
    plant.act("alarm-1", state)
    plant.plan(60)
    assert plant.log(CHIEF) == []
    plant.act("alarm-1", "raised")  # reopened
    plant.plan(83.9)
    assert plant.log(CHIEF) == []
    plant.plan(84)
    assert plant.log(CHIEF) == ["escalation"]


def test_an_escalation_waits_for_the_end_of_the_quiet_hours() -> None:
    plant = Plant(rules=NIGHT | {"escalation_h": 13})
    plant.change("alarm-1", "raised")
    plant.plan()
    plant.plan(14)
    assert plant.log(CHIEF) == []
    plant.plan(20)
    assert plant.log(CHIEF) == ["escalation"]


def test_a_shelved_alarm_sends_nothing_until_the_shelving_ends() -> None:
    plant = Plant()
    plant.change("alarm-1", "raised")
    plant.act("alarm-1", "shelved")
    assert plant.plan(5).waiting == {1: "shelved"}
    plant.act("alarm-1", "raised")
    plant.plan(6)
    assert plant.log() == ["raised"]


def test_a_new_alarm_after_one_that_was_closed_is_reported_and_no_retraction_of_the_closed_one() -> None:
    plant = Plant()
    plant.change("alarm-1", "raised")
    plant.plan()
    plant.act("alarm-1", "closed")
    plant.change("alarm-1", "retracted")
    plant.plan(40)
    assert plant.log() == ["raised"]
    plant.change("alarm-2", "raised")
    plant.plan(41)
    assert plant.log() == ["raised", "raised"]


def test_a_closed_alarm_that_moved_by_a_late_run_sends_no_retraction() -> None:
    plant = Plant()
    plant.change("alarm-1", "raised")
    plant.plan(0)
    plant.change("alarm-1", "retracted")  # a late run: it began earlier
    plant.change("alarm-2", "raised")
    plant.plan(1)
    plant.act("alarm-2", "closed")
    for hour in (2, 30, 60):
        plant.plan(hour)
    assert plant.log() == ["raised"]


def test_who_was_not_informed_of_an_alarm_is_not_informed_of_its_end() -> None:
    ben = mail("ben", machines=("mill 4",))
    plant = Plant(recipients=(ben, mail("carl", machines=("mill 5",))))
    plant.change("alarm-1", "raised")
    plant.plan()
    assert (len(plant.sent), plant.log(ben)) == (1, ["raised"])
    plant.statuses = dict.fromkeys(plant.statuses, "failed")  # it was given up
    plant.change("alarm-1", "retracted")
    plant.plan(48)
    assert len(plant.sent) == 1


def test_the_hour_of_the_digest_is_that_of_the_time_zone_also_when_summer_time_begins() -> None:
    rules = MessageRules(digest_hour=7)
    for day, hour in ((28, 6), (29, 5)):  # UTC, of March 2026
        begin = datetime(2026, 3, day, hour, tzinfo=UTC)
        assert rules.last_digest(begin, BERLIN) == begin
        before = rules.last_digest(begin - timedelta(seconds=1), BERLIN)
        assert before is not None
        assert before.date().day == day - 1


def test_of_two_alarms_one_is_closed_and_the_other_one_is_reported_until_it_is_gone() -> None:
    plant = Plant()
    plant.change("alarm-1", "raised")
    plant.plan()
    plant.change("alarm-2", "raised")
    plant.act("alarm-2", "closed")
    plant.plan()
    assert plant.log() == ["raised", "raised"]
    plant.change("alarm-1", "retracted")
    plant.plan()
    plant.change("alarm-1", "raised")
    plant.plan(48)
    assert plant.log() == ["raised", "raised"]
    plant.change("alarm-1", "retracted")
    plant.plan(96)
    assert plant.log() == ["raised", "raised", "retracted"]


STEPS = st.lists(
    st.tuples(
        st.sampled_from(["change", "change", "change", "acknowledged", "shelved", "closed", "raised"]),
        st.sampled_from(["alarm-1", "alarm-2"]),
        st.floats(0, 40),
    ),
    max_size=16,
)


@settings(max_examples=60, deadline=None)
@given(STEPS)
def test_whatever_happens_messages_alternate_and_the_last_one_is_true(
    steps: list[tuple[str, str, float]],
) -> None:
    plant = Plant(rules=NIGHT)
    closings = 0
    for what, subject, hours in steps:
        plant.plan(plant.hour + hours / 2)
        plant.hour += hours / 2
        state = plant.states.get(subject)
        if what == "change":
            gone = state is None or state.state == "ended"
            if state is None or state.state != "closed":
                plant.change(subject, "raised" if gone else "retracted")
        elif state is not None and state.state != "ended":
            plant.act(subject, what)
            closings += what == "closed"
        plant.plan()
    for _ in range(12):
        plant.plan(plant.hour + 7)
    log = [kind for kind in plant.log() if kind != "urgent"]
    repeated = sum(first == second for first, second in pairwise(log))
    assert repeated <= closings
    assert log[:1] in ([], ["raised"])
    assert closings or plant.log(CHIEF).count("escalation") <= log.count("raised")
    standing = [each.state for each in plant.states.values() if each.state not in ("ended", "closed")]
    if not closings and any(state != "shelved" for state in standing):
        assert log[-1] == "raised"
    if not closings and not standing and log:
        assert log[-1] == "retracted"
