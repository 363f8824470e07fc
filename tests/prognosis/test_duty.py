"""Duty of an axis by the counters of its machine."""

from __future__ import annotations

import os
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from functools import partial

import numpy as np
import pytest
from tests.estimation.made_runs import calibrated
from tests.monitoring.histories import BEGIN, history
from tests.prognosis.test_result import ADDED

from ballscrew.base.errors import InputError
from ballscrew.prognosis.duty import DutyRecord, EpochDuty, read_duty
from ballscrew.prognosis.family_average import FamilyAverage
from ballscrew.prognosis.monitor import monitor
from ballscrew.prognosis.result import Prognosis

DAYS = tuple(float(day) for day in range(0, 63, 3))


def write(folder, *rows: str, heading: str = "date,revolutions,hours"):
    path = folder / "duty.csv"
    path.write_text("\n".join([heading, *rows]) + "\n", encoding="utf-8")
    return path


def record(per_day, days=range(-1, 70), name="revolutions") -> DutyRecord:
    """Counter of a duty per day, from the day before the first run on."""
    times = np.array([(BEGIN + timedelta(days=day)).timestamp() / 86_400 for day in days])
    return DutyRecord(times, {name: np.cumsum([per_day(day) for day in days])})


def test_a_file_is_read_with_its_counters_and_dates(tmp_path):
    duty = read_duty(write(tmp_path, "2026-01-01,100,8", "2026-01-02T12:00Z,400,16", "", "2026-01-05,400,16"))
    assert duty.source == "duty.csv"
    assert duty.counters["revolutions"].tolist() == [100, 400, 400]
    assert duty.counters["hours"].tolist() == [8, 16, 16]
    assert np.diff(duty.times) == pytest.approx([1.5, 2.5])
    other = read_duty(write(tmp_path, "7;2026-01-01;x", "8;2026-01-02;y", heading="Hours;Date;who"))
    assert list(other.counters) == ["hours"]


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (("2026-01-02,1,1", "2026-01-01,2,2"), "date in line 3 is not after the one before"),
        (("2026-01-01,1,1", "2026-01-01,2,2"), "date in line 3 is not after"),
        (("2026-01-01,-1,1", "2026-01-02,2,2"), "revolutions in line 2 is '-1'"),
        (("2026-01-01,1,1", "2026-01-02,,2"), "revolutions in line 3 is ''"),
        (("2026-01-01,1,1", "2026-01-02"), "revolutions in line 3 is ''"),
        (("2026-01-01,1,1", "2026-01-02,nan,2"), "revolutions in line 3 is 'nan'"),
        (("2026-01-01,1,1", "2026-01-02,inf,2"), "revolutions in line 3 is 'inf'"),
        (("2026-01-01,5,1", "2026-01-02,4,2"), "revolutions falls from 5 to 4 in line 3"),
        (("2026-01-01,1,1", "2026-01-02,2,99"), "hours rise by 98 up to line 3, in 24 hours"),
        (("soon,1,1", "2026-01-02,2,2"), "date in line 2 is 'soon'"),
        (("2026-01-01,1,1",), "has 1 reading below"),
        ((), "has 0 readings"),
    ],
)
def test_a_wrong_row_is_one_sentence(tmp_path, rows, message):
    with pytest.raises(InputError, match=r"duty\.csv") as error:
        read_duty(write(tmp_path, *rows))
    assert message in str(error.value)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "has 0 readings"),
        (b"day,turns\n1,2\n3,4\n", "must have date, and revolutions or hours"),
        (b"date,hours,hours\n1,2,3\n3,4,5\n", "same name"),
        (b"\xff\xfe\x00", "not text in UTF-8"),
        (b"date,hours\n" * 100_001, "100000 or fewer"),
    ],
)
def test_what_is_no_duty_is_refused(tmp_path, content, message):
    (tmp_path / "duty.csv").write_bytes(content)
    with pytest.raises(InputError) as error:
        read_duty(tmp_path / "duty.csv")
    assert message in str(error.value)
    with pytest.raises(InputError, match="cannot be read"):
        read_duty(tmp_path / "none.csv")


def test_a_counter_is_linear_between_readings_and_continues_at_the_mean_of_a_month():
    days = np.array([0.0, 10.0, 60.0, 70.0])
    duty = EpochDuty(days, np.array([5.0, 105.0, 605.0, 905.0]), 60.0)
    assert duty.per_day == pytest.approx(10.0)
    assert duty.ahead_per_day == pytest.approx(500 / 30)
    assert duty.up_to(np.array([5.0, 65.0, 100.0])) == pytest.approx([55.0, 755.0, 905 + 500.0])
    assert duty.average_days(np.array([0.0, 60.0])) == pytest.approx([0.0, 60.0])
    assert duty.remaining(60.0, 10.0) == pytest.approx(300.0)


def test_a_duty_must_cover_the_runs_and_count_between_them():
    first, last = datetime(2026, 1, 1, tzinfo=UTC), datetime(2026, 3, 1, tzinfo=UTC)
    with pytest.raises(InputError, match="from 2025-12-31 to 2026-01-30, and the runs of the epoch are from"):
        record(lambda _: 1.0, range(-1, 30)).of_epoch(first, last)
    with pytest.raises(InputError, match="within 7 days"):
        record(lambda _: 1.0, range(20, 70)).of_epoch(first, last)
    with pytest.raises(InputError, match="revolutions does not rise from 2026-01-01 to 2026-03-01"):
        record(lambda _: 0.0).of_epoch(first, last)


def paused(day: float) -> float:
    """Two weeks of work, two of rest."""
    return 1000.0 * (day % 28 < 14)


RUNS = history(
    DAYS, lambda day: (1 - 1000 * sum(day_ % 28 < 14 for day_ in range(int(day) + 1)) / 250_000) ** 3
)
"""Wear by the revolutions of a paused duty, from the first day on; half the preload at 51 575."""


@pytest.fixture(scope="module")
def prognosis():
    """Of the runs, and the document of the whole result."""
    turns = record(paused, range(70))
    both = replace(turns, counters={**turns.counters, "hours": turns.counters["revolutions"] / 100})
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            "ballscrew.prognosis.monitor.FamilyAverage", partial(FamilyAverage, members=20, samples=200)
        )
        result = monitor(RUNS, calibrated(), duty=both)
    return result.prognosis, result.to_json()


def test_the_remaining_life_is_that_of_the_counters(prognosis):
    found, document = prognosis
    assert found.duty_per_day["revolutions"] == pytest.approx(16_000 / 30)
    rows = found.rul_revolutions
    assert rows[0.05] < 51_575 - 33_000 < rows[0.75]
    assert found.rul_hours[0.5] == pytest.approx(rows[0.5] / 100)
    assert any(line.startswith("In revolutions of the screw: not before ") for line in found.statement)
    assert any("533 revolutions and 5.33 hours a day" in line for line in found.assumptions)
    assert document["rul_revolutions"]["quantiles"]["0.5"] == pytest.approx(rows[0.5])
    read = Prognosis.from_json(document["prognosis"])
    assert read.rul_revolutions[0.5] == pytest.approx(rows[0.5])


def test_laws_by_the_counters_join_the_average(prognosis):
    families = prognosis[0].families
    law = "law of wear, by "
    assert families[law + "travel"] + families[law + "hours"] > 3 * families[law + "time"]


def test_a_prognosis_of_an_earlier_version_is_read(prognosis):
    old = {key: value for key, value in prognosis[1]["prognosis"].items() if key not in ADDED}
    assert Prognosis.from_json(old).rul_revolutions == {}
    assert Prognosis.from_json(old).rul_days[0.5] == pytest.approx(prognosis[0].rul_days[0.5])


def test_a_field_that_no_table_has_is_one_sentence(tmp_path):
    file = write(tmp_path, "2026-01-01,1,1", f"2026-01-02,2,{'2' * 200_000}")
    with pytest.raises(
        InputError, match=r"^duty\.csv: line 3 is no CSV \(field larger than field limit"
    ) as error:
        read_duty(file)
    assert "\n" not in str(error.value)


def test_a_pipe_is_no_duty(tmp_path):
    os.mkfifo(tmp_path / "duty.csv")
    with pytest.raises(InputError, match=r"it is a pipe.*; a duty is a CSV file"):
        read_duty(tmp_path / "duty.csv")


def test_an_epoch_of_one_run_has_no_duty_between_runs(tmp_path):
    duty = read_duty(write(tmp_path, "2026-01-01,1,1", "2026-01-05,100,2"))
    run = datetime(2026, 1, 2, tzinfo=UTC)
    assert duty.of_epoch(run, run) == {}
