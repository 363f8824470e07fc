"""A report shows what the store has, on HTML and PDF alike, and nothing unknown as good."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import delete
from tests.monitoring.histories import at, history
from tests.simulated_bench import AXIS
from tests.store.stored import EVENTS, MODEL, RUNS, count

from ballscrew.base.errors import InputError
from ballscrew.base.provenance import FileRef, digest
from ballscrew.base.words import interval_words
from ballscrew.modal.run import Run
from ballscrew.monitoring.epochs import Event
from ballscrew.store.adding import add_events, add_model, add_run
from ballscrew.store.reading import find_axis
from ballscrew.store.reporting import report
from ballscrew.store.service_tables import AlarmAction, Setup, Trouble
from ballscrew.store.store import Store
from ballscrew.store.tables import AlarmRow, Audit, Explanation, MachineRow

TIME = datetime(2026, 2, 12, tzinfo=UTC)
HOSTILE = "<script>alert(1)<script> $x_1$ \\frac{1}{2} 😀"
LONG = "Z" * 200
UNKNOWN = "C axis, no model"


def runs_of(axis: str, runs: list[Run]) -> list[Run]:
    """The same runs, of another axis."""
    found = []
    for number, run in enumerate(runs):
        files = tuple(FileRef(file.name, digest([axis, file.sha256, number])) for file in run.files)
        found.append(replace(run, axis=axis, id=digest([axis, number]), files=files))
    return found


def add_axis(store: Store, axis: str, runs: list[Run]) -> None:
    for run in runs_of(axis, runs):
        add_run(store, run)
    add_model(store, replace(MODEL, axis=axis))


@pytest.fixture(scope="module")
def plant(tmp_path_factory: pytest.TempPathFactory) -> Store:
    """A worn axis with alarm and trouble, a good one, and one without a model."""
    store = Store(Store.init(tmp_path_factory.mktemp("report") / "plant").path)
    add_axis(store, "bench", RUNS)
    add_events(store, EVENTS, "bench")
    store.monitor("bench")
    add_axis(store, "A axis", history([3.0 * day for day in range(8)]))
    store.monitor("A axis")
    for run in runs_of(UNKNOWN, RUNS[:2]):
        add_run(store, run)
    with store.write("test") as session:
        machine = MachineRow(site="hall 2", name="mill 4")
        session.add(machine)
        session.flush()
        axis = find_axis(session, "bench")
        axis.machine_id = machine.id
        alarm = session.query(AlarmRow).filter_by(axis_id=axis.id).one()
        taken = AlarmAction(action="acknowledged", until=None, text="nut ordered", actor="Ada", at=at(44.0))
        taken.alarm_id = alarm.id
        trouble = Trouble(axis_id=axis.id, kind="measurement", began_at=at(43.0), text="Clipped.")
        trouble.raised_at, trouble.ended_at = at(43.0), None
        session.add_all([taken, trouble])
    return store


@pytest.fixture
def written(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """All texts that are written on pages of a PDF."""
    from matplotlib.figure import Figure

    texts: list[str] = []
    text = Figure.text

    def write(figure: Figure, x: float, y: float, words: str, **look: Any) -> Any:
        texts.append(words)
        return text(figure, x, y, words, **look)

    monkeypatch.setattr(Figure, "text", write)
    return texts


def page_of(store: Store, folder: Path, axis: str | None = None, at: datetime = TIME) -> str:
    report(store, axis, out=folder / "a.html", at=at)
    return (folder / "a.html").read_text(encoding="utf-8")


def test_the_numbers_are_those_of_store_show(plant: Store, tmp_path: Path, written: list[str]) -> None:
    page = page_of(plant, tmp_path)
    for axis in (None, "bench", "A axis"):
        pages = report(plant, axis, out=tmp_path / "a.pdf", at=TIME)["pages"]
        assert {f"{number + 1} of {pages}" for number in range(pages)} <= set(written)
    assessed = [row for row in plant.list()["axes"] if row["stiffness"]]
    assert len(assessed) == 2
    for row in assessed:
        shown = plant.show(row["axis"])
        numbers = [interval_words(row["stiffness"])]
        for run in shown["runs"]:
            numbers += [interval_words(run["stiffness"]), interval_words(run["nut"])]
        for number in numbers:
            assert number in page
            assert number in written
    days = plant.show("bench")["rul_days"]
    life = f"{days['0.5']:.0f} ({days['0.05']:.0f} to {days['0.95']:.0f})"
    assert life in page
    assert life in written


def test_a_pdf_of_all_axes_has_an_overview_and_one_or_two_pages_of_each_that_needs_attention(
    plant: Store, tmp_path: Path, written: list[str]
) -> None:
    pages = report(plant, out=tmp_path / "a.pdf", at=TIME)["pages"]
    assert 3 <= pages <= 5
    text = " ".join(written)
    assert text.count("A axis") == 1  # in the overview, without the number of a page
    assert {"bench", "page 2", UNKNOWN} <= set(written)
    assert "Axes that need nothing have no page here." in text
    assert "How the numbers were made" not in written
    assert "Epochs" not in written
    for words in ("order a nut", "Clipped.", "by Ada: nut ordered", "Newest 6 of 14 runs"):
        assert words in text


def test_the_report_of_an_axis_has_what_to_do_alarms_events_and_origins(
    plant: Store, tmp_path: Path, written: list[str]
) -> None:
    page = page_of(plant, tmp_path, "bench")
    report(plant, "bench", out=tmp_path / "a.pdf", at=TIME)
    assert "data:image/png;base64," in page
    assert page.index("What to do") < page.index("data:image") < page.index("Alarms and actions")
    shown, text = plant.show("bench"), " ".join(written)
    for words in (
        "order a nut", "Clipped.", "acknowledged", "by Ada: nut ordered", "greased", "mill 4 · hall 2",
        "method joint, revision 1", shown["runs"][-1]["run"], "false alarms per year 0.1",
    ):  # fmt: skip
        assert words in page
        assert words in text
    assert "A axis" not in page


@pytest.fixture
def without_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """No pictures on HTML pages, as without matplotlib."""

    def refuse() -> None:
        raise InputError("no matplotlib")

    monkeypatch.setattr("ballscrew.report.page.check_drawing", refuse)


@pytest.mark.usefixtures("without_pictures")
def test_the_worst_axis_is_first_and_one_without_a_model_is_not_assessed(
    plant: Store, tmp_path: Path
) -> None:
    page = page_of(plant, tmp_path)
    names = re.findall(r'<a href="#axis-\d">([^<]*)</a>', page)
    assert names == ["bench", UNKNOWN, "A axis"]
    assert "3 axes: 1 alarm, 1 not assessed, 1 normal" in page
    assert "It cannot be assessed: the store has no model" in page


@pytest.fixture
def changed(plant: Store) -> Iterator[Callable[..., None]]:
    """Changes columns of the axis that is normal, until the end of the test."""

    def change(
        period: float | None = None, changed_at: str | None = None, calendar: dict[str, Any] | None = None
    ) -> None:
        with plant.write("test") as session:
            axis = find_axis(session, "A axis")
            axis.changed_at = changed_at
            setup = session.get(Setup, axis.id) or Setup(axis_id=axis.id, set_up_at=at(0.0))
            setup.sheet = setup.plan = setup.channels = None
            setup.period_s, setup.grace_s, setup.calendar = period, 0.0, calendar
            session.add(setup)

    yield change
    change()


@pytest.mark.usefixtures("without_pictures")
@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"changed_at": at(50.0)}, "unknown, normal before"),
        ({"period": 3600.0}, "unknown, its run is overdue; normal before"),
    ],
)
def test_what_is_not_known_is_never_good(
    plant: Store, tmp_path: Path, changed: Callable[..., None], change: dict[str, Any], words: str
) -> None:
    assert ">●</span>&nbsp;normal<" in page_of(plant, tmp_path)
    changed(**change)
    page = page_of(plant, tmp_path)
    assert f">○</span>&nbsp;{words}<" in page
    assert ">●</span>&nbsp;normal<" not in page.split("What to do")[0]
    assert "1 alarm, 1 unknown, 1 not assessed" in page


@pytest.mark.usefixtures("without_pictures")
def test_a_report_without_a_server_has_the_calendar_of_the_axis(
    plant: Store, tmp_path: Path, changed: Callable[..., None]
) -> None:
    idle = [str((TIME - timedelta(days=day)).date()) for day in range(-1, 60)]
    changed(period=3600.0, calendar={"holidays": idle})
    assert ">●</span>&nbsp;normal<" in page_of(plant, tmp_path)


@pytest.mark.usefixtures("without_pictures")
def test_a_state_without_a_schedule_is_unknown_when_it_is_old(plant: Store, tmp_path: Path) -> None:
    page = page_of(plant, tmp_path, at=TIME + timedelta(days=60))
    assert "unknown, last run is old; normal before" in page
    assert ">■</span>&nbsp;alarm<" in page
    assert ">no recent run<" in page
    assert ">good<" not in page.split("What to do")[0]
    assert page.count("Run the test: the newest run is too old to show the present state.") == 3


@pytest.mark.usefixtures("without_pictures")
def test_a_state_of_a_run_in_the_future_is_unknown(plant: Store, tmp_path: Path) -> None:
    page = page_of(plant, tmp_path, "A axis", at=TIME - timedelta(days=60))
    assert "UNKNOWN, its newest run is in the future; before: " in page
    assert "Correct the time of the newest run, which is in the future" in page
    assert ">no recent run<" in page


def test_a_picture_is_drawn_only_of_the_assessment_that_is_stored(
    plant: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("ballscrew.store.assessment_rows.__version__", "another")
    page = page_of(plant, tmp_path, "bench")
    assert "Preload of every run" not in page
    assert "which is not of the present history" in page
    assert "Assess it by its present history and this version" in page
    assert interval_words(plant.show("bench")["stiffness"]) in page


@pytest.mark.slow
def test_the_same_store_and_time_give_the_same_file(plant: Store, tmp_path: Path) -> None:
    for name, axis in (("a.pdf", "bench"), ("a.html", UNKNOWN)):
        files = []
        for _ in range(2):
            report(plant, axis, out=tmp_path / name, at=TIME)
            files.append((tmp_path / name).read_bytes())
        assert files[0] == files[1]
    content = (tmp_path / "a.pdf").read_bytes()
    assert content.startswith(b"%PDF")
    assert b"Date" not in content


@pytest.mark.usefixtures("without_pictures")
def test_a_store_is_only_read_also_while_it_is_served(plant: Store, tmp_path: Path) -> None:
    rows = count(plant, Audit)
    with plant.folder.locked("serve", serving=True):
        report(plant, out=tmp_path / "a.html", at=TIME)
    assert count(plant, Audit) == rows


def test_an_axis_that_is_only_set_up_is_in_the_report(tmp_path: Path) -> None:
    store = Store(Store.init(tmp_path / "store").path)
    (tmp_path / "axis.toml").write_text(AXIS, encoding="utf-8")
    store.add(tmp_path / "axis.toml")
    report(store, out=tmp_path / "a.html", at=TIME)
    assert "1 axis: 1 not assessed" in (tmp_path / "a.html").read_text(encoding="utf-8")
    assert report(store, out=tmp_path / "a.pdf", at=TIME)["pages"] == 2


class _Tags(HTMLParser):
    """Tags of a page, and their attributes."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.tags: set[str] = set()
        self.attributes: set[str] = set()
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        self.attributes |= {name for name, _ in attrs}


def test_an_axis_repaired_since_its_newest_run_is_unknown_and_needs_no_nut(tmp_path: Path) -> None:
    store = Store(Store.init(tmp_path / "store").path)
    add_axis(store, "bench", RUNS)
    store.monitor("bench")
    before = page_of(store, tmp_path, "bench")
    add_events(store, (Event(at(40.0), "nut replaced", ""),), "bench")
    store.monitor("bench")
    after = page_of(store, tmp_path, "bench")
    assert "UNKNOWN, it was repaired after its newest run; before: ALARM" in after
    assert "a new baseline begins with the next one" in after
    for text, page in ((True, before), (False, after)):
        assert ("order a nut" in page.lower()) == text


def test_hostile_names_are_shown_and_do_nothing(tmp_path: Path, written: list[str]) -> None:
    store = Store(Store.init(tmp_path / "store").path)
    runs = history([3.0 * day for day in range(4)])
    for name in (HOSTILE, LONG):
        add_axis(store, name, runs)
    add_events(
        store,
        (Event(at(3.0), "note", "<img src=x onerror=alert(1)> $\\frac{$ " + "long \u202e " * 400),),
        HOSTILE,
    )
    store.monitor(HOSTILE)
    page = page_of(store, tmp_path)
    found = _Tags(page)
    assert not found.tags & {"script", "img src=x", "link", "iframe"}
    assert not any(name.startswith("on") for name in found.attributes)
    assert "src=x" not in re.sub("&lt;.*?&gt;", "", page)
    assert len(page) < 1_000_000
    assert "\u202e" not in page
    report(store, out=tmp_path / "a.pdf", at=TIME)
    text = " ".join(written)
    assert "\u202e" not in text
    assert "$x_1$" in text
    assert "ZZZZ" in text
    assert len(text) < 60_000


def test_no_axis_is_a_page_too(tmp_path: Path) -> None:
    store = Store(Store.init(tmp_path / "store").path)
    assert "The store has no axis." in page_of(store, tmp_path)
    assert report(store, out=tmp_path / "a.pdf", at=TIME)["pages"] == 1


@pytest.mark.parametrize(
    ("axis", "out", "message"),
    [
        (None, "a.docx", "must end in .html, .htm, .pdf"),
        (None, "none/a.pdf", "make the folder"),
        ("no such axis", "a.pdf", "the store has no axis 'no such axis'"),
    ],
)
def test_what_cannot_be_written_is_one_sentence(
    plant: Store, tmp_path: Path, axis: str | None, out: str, message: str
) -> None:
    with pytest.raises(InputError, match=re.escape(message)):
        report(plant, axis, out=tmp_path / out)
    assert list(tmp_path.iterdir()) == []


def test_no_report_is_written_into_a_store(plant: Store) -> None:
    with pytest.raises(InputError, match="is in the store"):
        report(plant, out=plant.path / "a.pdf")


def test_a_file_that_exists_stays_if_the_report_fails(
    plant: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.pdf"
    path.write_bytes(b"before")

    def fail(*_: Any) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr("ballscrew.report.monitor_figure.draw_panels", fail)
    with suppress(ZeroDivisionError):
        report(plant, "bench", out=path, at=TIME)
    assert path.read_bytes() == b"before"
    assert [each.name for each in tmp_path.iterdir()] == ["a.pdf"]


def test_the_time_is_that_of_the_environment(
    plant: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1770854400")
    assert report(plant, UNKNOWN, out=tmp_path / "a.html")["at"] == TIME.isoformat()
    for wrong in ("yesterday", "1e99"):
        monkeypatch.setenv("SOURCE_DATE_EPOCH", wrong)
        with pytest.raises(InputError, match="SOURCE_DATE_EPOCH is"):
            report(plant, UNKNOWN, out=tmp_path / "a.html")


@pytest.mark.usefixtures("without_pictures")
def test_an_axis_without_a_stored_explanation_has_the_page_of_one_with_it(
    plant: Store, tmp_path: Path
) -> None:
    """As of an assessment by an earlier version."""
    shutil.copytree(plant.path, tmp_path / "store")
    store = Store(tmp_path / "store")
    expected = page_of(store, tmp_path, "bench")
    with store.write("test") as session:
        session.execute(delete(Explanation))
    assert page_of(store, tmp_path, "bench") == expected
