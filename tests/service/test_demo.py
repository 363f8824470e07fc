"""The simulated plant: its story, its numbers, its folder."""

from __future__ import annotations

import sqlite3
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import closing
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from sqlalchemy import select
from tests.service.conftest import client_of

from ballscrew.base.errors import InputError
from ballscrew.base.provenance import digest
from ballscrew.calibration.frequency_table import frequency_table
from ballscrew.modal.run import Run
from ballscrew.reproduction import plant_histories
from ballscrew.reproduction.plant import PLANT, WEEKS, PlantAxis, rig_of
from ballscrew.service import demo
from ballscrew.service.demo_processes import demo_processes
from ballscrew.service.jobs import ASSESS, enqueue
from ballscrew.service.serving import ServedStore, Service
from ballscrew.service.settings import ServerSettings
from ballscrew.store.checking import verify
from ballscrew.store.folder import DataFolder, at_time, now
from ballscrew.store.migrating import create_store
from ballscrew.store.opened import OpenStore
from ballscrew.store.rows import unpack
from ballscrew.store.service_tables import JobRow
from ballscrew.store.tables import AlarmRow, Axis, ResultRow, RunRow, Source
from ballscrew.testbed.linear import true_frequency
from ballscrew.testbed.machine import constants

PRESENT = datetime(2026, 5, 1, 12, tzinfo=UTC)
_FIRST = WEEKS - 12
HEALTHY = replace(PLANT[1], first=_FIRST, recorded=(WEEKS - 1,), like=None)
ABSENT = replace(PLANT[8], type=HEALTHY.type, first=_FIRST, last=WEEKS - 3, recorded=(), like=HEALTHY.name)
ALIKE = replace(PLANT[0], first=_FIRST, recorded=(), like=HEALTHY.name, worn=None)
SMALL = (HEALTHY, ABSENT, ALIKE)
ALONE = replace(PLANT[9], like=None)
UNUSED = ThreadPoolExecutor(1)  # begins no thread before it has something to do


@pytest.fixture(scope="module")
def few_members() -> None:
    """Forecasts as users have them."""


@pytest.fixture(scope="module")
def plant(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three axes over twelve weeks; one is absent in the end, and one imitates the first."""
    folder = tmp_path_factory.mktemp("demo") / "plant"
    with demo_processes() as pool:
        demo.make_plant(folder, pool, axes=SMALL, present=PRESENT)
    return folder


@pytest.fixture
def service(plant: Path) -> Service:
    """Service of this plant."""
    return Service(ServedStore(plant), ServerSettings(min_free_bytes=0))


def runs_of(folder: Path, axis: str) -> list[tuple[Run, bool]]:
    """Runs of an axis by time, and whether they have recordings."""
    store = OpenStore(folder)
    with store.read() as session:
        found = session.execute(
            select(ResultRow.document, Source.digest)
            .join(RunRow, RunRow.id == ResultRow.run_id)
            .join(Axis, Axis.id == RunRow.axis_id)
            .outerjoin(Source, Source.run_id == RunRow.id)
            .where(Axis.name == axis)
            .order_by(RunRow.time)
        ).all()
    return [(Run.from_json(unpack(document)), source is not None) for document, source in found]


def test_the_store_is_whole_and_is_marked(plant: Path, service: Service) -> None:
    assert verify(plant).faults == ()
    with client_of(service) as client:
        fleet = client.get("/api/v1/axes").json()
        assert client.get("/readyz").json()["simulated"]
    assert fleet["simulated"]
    assert {axis["site"] for axis in fleet["axes"]} == {"simulated plant, hall 1", "simulated plant, hall 2"}
    assert [axis["state"] for axis in fleet["axes"]] == 3 * ["normal"]
    assert list(plant.glob("recordings-*")) == []


def test_recordings_that_are_not_analysed_wait_in_the_queue(service: Service) -> None:
    with client_of(service) as client:
        jobs = client.get("/api/v1/jobs").json()["jobs"]
        sent = client.get(f"/api/v1/axes/{HEALTHY.name}/runs").json()["sent"]
    assert [job["kind"] for job in jobs] == ["analyse"]
    assert Counter(each["status"] for each in sent) == {"done": 11, "queued": 1}


def test_times_are_those_of_the_history(service: Service) -> None:
    """Only the queued test was sent now."""
    with client_of(service) as client:
        sent = client.get(f"/api/v1/axes/{HEALTHY.name}/runs").json()["sent"]
        alarms = client.get("/api/v1/alarms").json()["alarms"]
    received = [datetime.fromisoformat(each["received_at"]) for each in sent[:-1]]
    assert received[0] == HEALTHY.measured_at(_FIRST, PRESENT) + timedelta(minutes=12)
    assert set(np.diff(received)) == {timedelta(days=7)}
    (silence,) = alarms
    assert silence["kind"] == "silence"
    assert silence["axis"] == ABSENT.name
    last = ABSENT.measured_at(ABSENT.last, PRESENT)
    assert datetime.fromisoformat(silence["raised_at"]) - last == timedelta(days=9, minutes=13)


def test_imitated_runs_agree_with_the_analysed_one_and_scatter(plant: Path) -> None:
    runs = runs_of(plant, HEALTHY.name)
    assert [recorded for _, recorded in runs] == [True] + 10 * [False]
    (analysed, _), *imitated = runs
    first = frequency_table(analysed)
    assert len(first.frequency) == 4 * (len(HEALTHY.type.plan.positions) - 1)
    assert {run.quality.verdict for run, _ in runs} == {"good"}
    assert {run.made.inputs["plan"] for run, _ in runs} == {analysed.made.inputs["plan"]}
    tables = [frequency_table(run) for run, _ in imitated]
    moved = np.array([table.frequency / first.frequency - 1 for table in tables])
    stated = np.array([cell.standard_uncertainty_Hz / cell.frequency_Hz for cell in analysed.cells])
    assert np.abs(moved).max() < 5 * stated.max()
    assert (moved.std(axis=0) > 0.1 * stated).all()
    assert {run.made.inputs.get("imitated") for run, _ in imitated} == {analysed.id}


def test_an_axis_imitates_another_of_its_type(plant: Path) -> None:
    analysed = runs_of(plant, HEALTHY.name)[0][0]
    runs = runs_of(plant, ALIKE.name)
    assert [recorded for _, recorded in runs] == 12 * [False]
    assert {run.made.inputs["imitated"] for run, _ in runs} == {analysed.id}
    assert {run.axis for run, _ in runs} == {ALIKE.name}
    assert {run.made.inputs["axis"] for run, _ in runs}.isdisjoint({analysed.made.inputs["axis"]})
    places = ALIKE.type.plan.positions
    machines = [rig_of(axis, _FIRST, 0).machine for axis in (HEALTHY, ALIKE)]
    constant = [constants(machine, ALIKE.type.load, (places[0] + places[-1]) / 2) for machine in machines]
    tables = [frequency_table(run) for run in (analysed, runs[0][0])]
    spreads = {cell.position_m: cell.standard_uncertainty_Hz / cell.frequency_Hz for cell in analysed.cells}
    for place in places[1:]:
        true = true_frequency(constant[1], place) / true_frequency(constant[0], place)
        assert true > 1.005
        found = [table.frequency[table.position == place].mean() for table in tables]
        # An imitation adds errors of the size that the analysed run states.
        assert found[1] / found[0] == pytest.approx(true, rel=3 * spreads[place])
        assert 3 * spreads[place] < 0.005
    assert analysed.made.inputs["axis"] == digest(HEALTHY.sheet.to_settings())


def test_what_an_axis_imitates_is_of_its_type_and_analysed() -> None:
    axes = {axis.name: axis for axis in PLANT}
    for axis in PLANT:
        if axis.like is not None:
            other = axes[axis.like]
            assert other.type is axis.type, axis.name
            assert other.like is None, axis.name
            assert other.first in other.templates, axis.name


def test_each_axis_has_three_recorded_tests() -> None:
    for axis in PLANT:
        assert len({*axis.recorded, *axis.templates}) >= 3


def test_a_second_start_uses_the_same_plant(plant: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(demo, "make_plant", lambda *_, **__: pytest.fail("made again"))
    with demo.demo_store(plant, UNUSED) as folder:
        assert folder == plant
    assert plant.is_dir()


@pytest.fixture
def imitated_plant(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """An empty store in place of the plant; the folders in which one was made."""
    made: list[Path] = []

    def make(folder: Path, _: Executor, **_progress: Any) -> None:
        made.append(folder)
        create_store(folder)
        DataFolder(folder).create(None, simulated=True)

    monkeypatch.setattr(demo, "make_plant", make)
    return made


def test_a_temporary_plant_leaves_nothing(imitated_plant: list[Path]) -> None:
    with demo.demo_store(None, UNUSED) as folder:
        assert DataFolder(folder).is_simulated()
        assert folder == imitated_plant[0]
    assert not folder.parent.exists()


@pytest.mark.parametrize("exists", [False, True])
def test_a_new_folder_is_made_and_stays(imitated_plant: list[Path], tmp_path: Path, exists: bool) -> None:
    data = tmp_path / "new" / "plant"
    if exists:
        data.mkdir(parents=True)
    for _ in range(2):
        with demo.demo_store(data, UNUSED) as folder:
            assert folder == data
    assert len(imitated_plant) == 1
    assert [path.name for path in data.parent.iterdir()] == ["plant"]


@pytest.fixture(params=[None, "stated"])
def interrupted(
    request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Any]:
    """Folder of a plant that is interrupted; afterwards nothing is there."""
    monkeypatch.setattr(demo.tempfile, "tempdir", str(tmp_path))
    yield None if request.param is None else tmp_path / request.param
    assert list(tmp_path.iterdir()) == []


def test_an_interrupt_leaves_nothing(interrupted: Path | None, monkeypatch: pytest.MonkeyPatch) -> None:
    def make(folder: Path, _: Executor, **_progress: Any) -> None:
        create_store(folder)
        raise KeyboardInterrupt

    monkeypatch.setattr(demo, "make_plant", make)
    with pytest.raises(KeyboardInterrupt), demo.demo_store(interrupted, UNUSED):
        pytest.fail("it was made")


def test_another_folder_is_refused(tmp_path: Path) -> None:
    store = create_store(tmp_path / "store").path
    other = tmp_path / "other"
    other.mkdir()
    (other / "letter.txt").write_text("mine")
    for folder, words in (
        (store, "another store"),
        (other, "other files"),
        (other / "letter.txt", "other files"),
        (tmp_path / (300 * "x"), "cannot be read"),
    ):
        with pytest.raises(InputError, match=words), demo.demo_store(folder, UNUSED):
            pytest.fail("it was taken")
    assert (other / "letter.txt").read_text() == "mine"


@pytest.mark.usefixtures("imitated_plant")
def test_a_plant_of_an_older_schema_is_refused_with_what_to_do(tmp_path: Path) -> None:
    data = tmp_path / "plant"
    with demo.demo_store(data, UNUSED):
        pass
    with closing(sqlite3.connect(DataFolder(data).sqlite)) as connection, connection:
        connection.execute("UPDATE alembic_version SET version_num = '0003'")
    words = "run 'ballscrew store migrate', or give --demo a new folder"
    with pytest.raises(InputError, match=words), demo.demo_store(data, UNUSED):
        pytest.fail("it was taken")


def test_rows_have_the_time_of_the_history_in_its_block_only() -> None:
    with at_time(PRESENT):
        assert now() == "2026-05-01T12:00:00.000+00:00"
    assert now() > "2026-05-02"


@pytest.mark.slow
def test_the_whole_plant_is_as_its_story(tmp_path: Path) -> None:
    with demo_processes(early=True) as pool:
        demo.make_plant(tmp_path / "plant", pool)
    service = Service(ServedStore(tmp_path / "plant"), ServerSettings(min_free_bytes=0))
    with client_of(service) as client:
        axes = {axis["axis"]: axis for axis in client.get("/api/v1/axes").json()["axes"]}
        alarms = {each["axis"]: each for each in client.get("/api/v1/alarms").json()["alarms"]}
        jobs = client.get("/api/v1/jobs").json()["jobs"]
        bearing = client.get("/api/v1/axes/lathe 2 X").json()
        loose = client.get("/api/v1/axes/mill 7 Z").json()["runs"]
    states = {name: axis["state"] for name, axis in axes.items()}
    troubled = {"mill 4 X": "alarm", "mill 4 Z": "watch", "lathe 2 X": "alarm", "gantry 3 X": "learning"}
    assert states == dict.fromkeys(states, "normal") | troubled | {"gantry 3 Y": "not assessed"}
    assert axes["gantry 3 Y"]["missing"] == ["model", "run with a time"]
    assert {name: (each["kind"], each["state"]) for name, each in alarms.items()} == {
        "mill 4 X": ("axis", "raised"),
        "mill 7 X": ("axis", "closed"),
        "mill 7 Z": ("measurement", "raised"),
        "lathe 2 X": ("axis", "acknowledged"),
        "grinder 1 X": ("silence", "raised"),
    }
    assert axes["mill 4 X"]["stiffness"][2] < 0.95
    assert bearing["stiffness"][2] < 0.9 < bearing["runs"][-1]["nut"][0]
    assert {run["state"] for run in loose[-6:]} == {"suspect"}
    assert len(jobs) == sum(len(set(axis.recorded) - set(axis.templates)) for axis in PLANT)


@pytest.mark.parametrize("step", ["record_tests", "make_history"])
@pytest.mark.parametrize("failing", [HEALTHY, ABSENT, ALONE, None])
def test_the_histories_of_all_axes_come_or_the_error_of_one(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, step: str, failing: PlantAxis | None
) -> None:
    """The main process waits for a result of each axis; an error must not be lost."""
    templates: dict[str, Any] = {}

    def fail(name: str, axis: PlantAxis) -> None:
        if failing is not None and (name, axis.name) == (step, failing.name):
            raise InputError(f"{axis.name}: failed")

    def record_tests(axis: PlantAxis, *_: Any) -> dict[int, Path]:
        fail("record_tests", axis)
        return {0: Path(axis.name)}

    def make_history(
        axis: PlantAxis, _present: Any, _seed: Any, recordings: Any, template: Any = None
    ) -> Any:
        fail("make_history", axis)
        assert recordings == {0: Path(axis.name)}
        templates[axis.name] = template
        return SimpleNamespace(axis=axis, template=axis.name)

    monkeypatch.setattr(plant_histories, "record_tests", record_tests)
    monkeypatch.setattr(plant_histories, "make_history", make_history)
    with ThreadPoolExecutor(2) as pool:
        histories = plant_histories.make_histories(pool, (*SMALL, ALONE), PRESENT, 0, tmp_path)
        if failing is not None:
            with pytest.raises(InputError, match=failing.name):
                list(histories)
        else:
            assert {history.axis.name for history in histories} == {axis.name for axis in (*SMALL, ALONE)}
            alike = dict.fromkeys([ABSENT.name, ALIKE.name], HEALTHY.name)
            assert templates == {HEALTHY.name: None, ALONE.name: None} | alike


def test_a_folder_that_cannot_be_created_is_a_sentence(tmp_path: Path, imitated_plant: list[Path]) -> None:
    (tmp_path / "letter.txt").write_text("mine")
    data = tmp_path / "letter.txt" / "plants" / "new"
    with pytest.raises(InputError, match="cannot be created"), demo.demo_store(data, UNUSED):
        pytest.fail("it was made")
    assert imitated_plant == []


@pytest.fixture
def worn_plant(worn_service: Service) -> demo._Plant:
    """A plant whose only axis is in alarm."""
    return demo._Plant(worn_service, PRESENT)


BENCH = replace(HEALTHY, name="bench", recorded=(), raised=_FIRST + 3)
STORY = (
    (1.0, "acknowledge", "A nut is ordered."),
    (1.5, "nut replaced", "New nut."),
    (2.0, "close", "Worn."),
)


def test_people_act_on_the_newest_alarm_of_an_axis_and_record_events(worn_plant: demo._Plant) -> None:
    first = BENCH.measured_at(0, PRESENT)
    for weeks, kind, text in STORY:
        at = first + timedelta(weeks=weeks)
        with at_time(at):
            worn_plant._act(BENCH, kind, text, at)
            worn_plant._act(replace(BENCH, name="none"), "acknowledge", text, at)  # which has no alarm
        with client_of(worn_plant.service) as client:
            (alarm,) = client.get("/api/v1/alarms").json()["alarms"]
            events = client.get("/api/v1/axes/bench/trend").json()["events"]
        assert alarm["state"] == {"close": "closed"}.get(kind, "acknowledged")
    assert (alarm["actions"][-1]["text"], alarm["actions"][-1]["finding"]) == ("Worn.", "preload loss")
    assert [(event["kind"], event["text"]) for event in events] == [("nut replaced", "New nut.")]


def test_what_happened_to_an_axis_is_done_in_the_order_of_time(
    worn_plant: demo._Plant, monkeypatch: pytest.MonkeyPatch
) -> None:
    done: list[tuple[str, datetime]] = []

    def note(name: str) -> Any:
        return lambda *given: done.append(
            (given[2] if name == "act" else name, datetime.fromisoformat(now()))
        )

    for name in ("set_up", "assess", "act"):
        monkeypatch.setattr(demo._Plant, f"_{name}", note(name))
    axis = replace(BENCH, story=tuple((BENCH.first + weeks, kind, text) for weeks, kind, text in STORY))
    history: Any = SimpleNamespace(axis=axis, runs={}, recordings={}, model=None)
    worn_plant.replay(history)
    weeks = [(at - axis.measured_at(axis.first, PRESENT)).total_seconds() / 604_800 for _, at in done]
    assert [name for name, _ in done] == ["set_up", "acknowledge", "nut replaced", "close", "assess"]
    assert weeks == pytest.approx([0.0, 1.0, 1.5, 2.0, 3.0], abs=0.01)


def test_an_alarm_is_dated_when_its_run_was_received(worn_plant: demo._Plant) -> None:
    """As by a server that was there; one that was raised soon after its run stays as it is."""
    with worn_plant.service.store.read() as session:
        began = datetime.fromisoformat(session.scalars(select(AlarmRow)).one().began_at)
    worn_plant.date_alarms()
    later = began + timedelta(hours=3)
    for expected in (began + timedelta(minutes=12), later):
        with worn_plant.service.store.write("test") as session:
            row = session.scalars(select(AlarmRow)).one()
            assert expected == later or datetime.fromisoformat(row.raised_at) == expected
            row.raised_at = later.isoformat()
        worn_plant.date_alarms()
    with worn_plant.service.store.read() as session:
        assert datetime.fromisoformat(session.scalars(select(AlarmRow)).one().raised_at) == later


def test_an_axis_is_assessed_in_the_middle_of_its_history(
    worn_plant: demo._Plant, worn_service: Service
) -> None:
    with worn_service.store.write("test") as session:
        enqueue(session, ASSESS, "bench")
        session.scalars(select(Axis)).one().changed_at = "2026-03-01T00:00:00+00:00"
    worn_plant._assess(BENCH)
    with worn_service.store.read() as session:
        assert session.scalars(select(JobRow)).all() == []
        assert session.scalars(select(Axis)).one().changed_at is None
