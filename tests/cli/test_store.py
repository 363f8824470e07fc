"""The commands of the store."""

from __future__ import annotations

import importlib.util
import json
import shutil
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import select
from tests.monitoring.histories import at
from tests.store.stored import EVENTS, MODEL, RUNS, imitate_analysis, write_recordings

from ballscrew.base.errors import InputError
from ballscrew.calibration.modelfile import write_model
from ballscrew.cli.shell import run
from ballscrew.report.stored_words import utc_minute
from ballscrew.store import adding
from ballscrew.store.opened import OpenStore
from ballscrew.store.service_tables import Trouble
from ballscrew.store.tables import AlarmRow, Axis

pytestmark = pytest.mark.usefixtures("few_members")


@pytest.fixture(scope="module")
def made_plant(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the files of an axis, and a store that has them."""
    folder = tmp_path_factory.mktemp("made")
    for number, each in enumerate(RUNS):
        each.write(folder / f"run{number:02d}.json")
    write_model(MODEL, folder / "model.json")
    lines = "".join(f'[[events]]\nat = {event.at}\nkind = "{event.kind}"\n' for event in EVENTS)
    (folder / "events.toml").write_text(lines, encoding="utf-8")
    with pytest.MonkeyPatch.context() as patched:
        patched.chdir(folder)
        patched.setenv("BALLSCREW_STORE", "plant")
        assert run(["store", "init", "plant"]) == 0
        assert run(["store", "add", *map(str, sorted(Path().glob("run*.json"))), "model.json"]) == 0
        assert run(["store", "add", "events.toml", "--axis", "bench"]) == 0
    return folder


@pytest.fixture
def plant(made_plant: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of that store, and of the files beside it."""
    shutil.copytree(made_plant, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("BALLSCREW_STORE", "plant")
    return tmp_path / "plant"


def printed(capsys: pytest.CaptureFixture[str], *command: str) -> dict[str, object]:
    capsys.readouterr()
    assert run([*command, "--json"]) == 0
    document: dict[str, object] = json.loads(capsys.readouterr().out)
    return document


@pytest.fixture(scope="module")
def made_with_files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a store that has six runs of a sound axis, with their raw files, and its model."""
    folder = tmp_path_factory.mktemp("with files")
    write_model(MODEL, folder / "model.json")
    with pytest.MonkeyPatch.context() as patched:
        patched.chdir(folder)
        patched.setenv("BALLSCREW_STORE", "plant")
        imitate_analysis(patched)
        assert run(["store", "init", "plant"]) == 0
        files = [str(write_recordings(Path(f"day{day}"), 3.0 * day, files=1)) for day in range(6)]
        assert run(["store", "add", *files, "model.json"]) == 0
        assert run(["monitor", "bench"]) == 0
    return folder


@pytest.fixture
def with_files(made_with_files: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> OpenStore:
    """A copy of that store, and an analysis that takes no time."""
    shutil.copytree(made_with_files / "plant", tmp_path / "plant")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("BALLSCREW_STORE", "plant")
    imitate_analysis(monkeypatch)
    return OpenStore(tmp_path / "plant")


def run_ids(capsys: pytest.CaptureFixture[str]) -> list[str]:
    """Ids of the runs of the axis, by time."""
    return [row["run"] for row in printed(capsys, "store", "show", "bench")["runs"]]  # type: ignore[index,attr-defined]


def words(capsys: pytest.CaptureFixture[str], *command: str, status: int = 0) -> str:
    """What a command prints, on one line."""
    capsys.readouterr()
    assert run(command) == status
    return " ".join(capsys.readouterr().out.split())


@pytest.mark.usefixtures("plant")
def test_monitor_of_a_store_prints_what_monitor_of_its_files_prints(
    capsys: pytest.CaptureFixture[str],
) -> None:
    runs = sorted(map(str, Path().glob("run*.json")))
    files = printed(capsys, "monitor", *runs, "--model", "model.json", "--events", "events.toml")
    stored = printed(capsys, "monitor", "bench", "--store", "plant")
    assert stored == files
    assert run(["store", "list"]) == 0
    assert "alarm" in capsys.readouterr().out
    assert run(["store", "show", "bench"]) == 0
    shown = capsys.readouterr().out
    assert "Alarm since" in shown
    assert "greased" in shown


@pytest.mark.usefixtures("plant")
def test_every_command_prints_a_document(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["monitor", "bench", "--store", "plant"]) == 0
    added = printed(capsys, "store", "add", "run00.json")["added"]
    assert added[0]["new"] is False  # type: ignore[index]
    corrected = printed(capsys, "store", "correct", RUNS[2].id, "--measured-at", "2026-01-08T08:00Z")
    assert printed(capsys, "store", "exclude", str(corrected["run"]), "--reason", "why")["excluded"] is True
    assert printed(capsys, "store", "show", "bench")["exclusions"] != []
    assert printed(capsys, "store", "exclude", str(corrected["run"]), "--undo")["excluded"] is False
    model = printed(capsys, "store", "add", "model.json")["added"][0]["id"]  # type: ignore[index]
    assert printed(capsys, "store", "correct", "bench", "--model", model[:9])["model"] == model
    assert printed(capsys, "store", "verify")["faults"] == []
    assert printed(capsys, "store", "gc", "--dry-run")["removed"] == []
    assert printed(capsys, "store", "backup", "--to", "backup") == {"schema": 2, "backup": "backup"}
    assert printed(capsys, "store", "restore", "backup", "--to", "restored")["store"] == "restored"
    assert printed(capsys, "store", "export", "bench", "--to", "bench")["to"] == "bench"
    assert printed(capsys, "store", "archive", "bench", "--to", "archive")["files"] == 0
    assert printed(capsys, "store", "retain", "--days", "1", "--dry-run")["axes"] == []
    assert printed(capsys, "store", "migrate")["from"] == printed(capsys, "store", "migrate")["to"]
    assert printed(capsys, "reprocess")["analyzed"] == 0
    fleet = ("store", "simulate-fleet", "--axes", "2", "--years", "0.2", "--cells", "4")
    assert printed(capsys, *fleet)["runs"] == 20
    assert len(printed(capsys, "store", "list")["axes"]) == 3  # type: ignore[arg-type]
    assert printed(capsys, "store", "verify")["faults"] == []


@pytest.mark.usefixtures("plant")
def test_a_report_is_written_and_named(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert run(["monitor", "bench"]) == 0
    document = printed(capsys, "report", "--data", "plant", "--out", "a.pdf")
    assert document["axes"] == [{"axis": "bench", "state": "alarm", "shown": "alarm"}]
    assert Path("a.pdf").read_bytes().startswith(b"%PDF")
    assert run(["report", "bench", "--out", "a.html"]) == 0
    assert capsys.readouterr().out == "Report: a.html\n"
    assert run(["report", "another", "--out", "a.html"]) == 2
    monkeypatch.delenv("BALLSCREW_STORE")
    assert run(["report", "--out", "a.html"]) == 2
    assert "no store is given: give its folder (--data DIR)" in capsys.readouterr().err


def test_the_settings_of_the_server_count_for_commands(
    plant: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    given: dict[str, Any] = {}
    monkeypatch.setattr("ballscrew.store.reporting.report", lambda *_, **options: given.update(options) or {})
    assert run(["report", "--out", "a.html"]) == 0
    assert "calendar" not in given
    settings = 'working_days = ["Mon"]\nretention_days = 5\nretention_newest = 7\n'
    (plant / "server.toml").write_text(settings, encoding="utf-8")
    assert run(["report", "--out", "a.html"]) == 0
    assert given["calendar"].weekdays == (0,)
    capsys.readouterr()
    assert printed(capsys, "store", "retain")["policy"] == {"days": 5.0, "newest": 7}
    assert printed(capsys, "store", "retain", "--newest", "1")["policy"] == {"days": 5.0, "newest": 1}
    assert run(["store", "retain", "--dry-run"]) == 0
    assert capsys.readouterr().out == "To be deleted: 0 raw files, 0 bytes.\n"
    (plant / "server.toml").write_text("nonsense = 1\n", encoding="utf-8")
    assert run(["report", "--out", "a.html"]) == 2


def test_a_support_bundle_is_written(plant: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["serve", "--data", "plant", "--support-bundle", "bundle.zip"]) == 0
    assert capsys.readouterr().out == "Support bundle: bundle.zip\n"
    assert (plant.parent / "bundle.zip").stat().st_size > 0
    assert run(["serve", "--data", "plant", "--support-bundle", "missing/bundle.zip"]) == 2


@pytest.mark.usefixtures("plant")
def test_monitor_takes_the_store_of_the_environment_for_the_name_of_an_axis(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    stored = printed(capsys, "monitor", "bench", "--store", "plant")
    assert printed(capsys, "monitor", "bench") == stored
    runs = sorted(map(str, Path().glob("run*.json")))
    assert printed(capsys, "monitor", *runs[:3], "--model", "model.json") != stored
    monkeypatch.delenv("BALLSCREW_STORE")
    assert run(["monitor", "bench"]) == 2
    assert "needs --store or BALLSCREW_STORE" in capsys.readouterr().err
    assert run(["monitor", "--help"]) == 0
    assert "BALLSCREW_STORE" in capsys.readouterr().out


@pytest.mark.usefixtures("plant")
def test_corrections_conflicts_and_provenance_are_printed(capsys: pytest.CaptureFixture[str]) -> None:
    replace(RUNS[0], cells=RUNS[0].cells[1:]).write("other.json")
    assert run(["store", "add", "other.json"]) == 2
    corrected = printed(
        capsys, "store", "correct", RUNS[2].id, "--measured-at", "2026-01-08T08:00Z", "--reason", "why"
    )
    assert run(["store", "show", "bench"]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert f"measured_at of the run {RUNS[2].id}, which is now" in shown
    assert "(why, " in shown
    assert f"another result of the run {RUNS[0].id} was refused" in shown
    assert run(["store", "show", str(corrected["run"])[:12]]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert f"Correction of the run {RUNS[2].id}" in shown
    assert f"SHA-256 {RUNS[2].files[0].sha256}" in shown
    assert "Result by joint, revision 1, ballscrew" in shown
    assert printed(capsys, "store", "show", RUNS[2].id)["corrected_as"] == [corrected["run"]]


@pytest.mark.usefixtures("plant")
def test_a_result_that_is_not_stored_is_printed(plant: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (plant / "damaged.txt").write_text("a fault\n", encoding="utf-8")
    assert run(["monitor", "bench"]) == 0
    found = capsys.readouterr()
    assert "alarm" in found.out
    assert "The result is not stored" in found.err


@pytest.mark.usefixtures("plant")
def test_every_command_prints_a_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    commands = [
        "store verify", "store gc",
        "store backup --to backup", "store restore backup --to restored", "store export bench --to bench",
        "store archive bench --to archive", "store migrate", "reprocess", "store list", "store show bench",
    ]  # fmt: skip
    for command in commands:
        assert run(command.split()) == 0
        assert capsys.readouterr().out.strip()
    assert run(["store", "correct", RUNS[1].id, "--mass", "101 kg"]) == 2
    assert "the store does not have the plan of the run" in capsys.readouterr().err


@pytest.mark.usefixtures("plant")
@pytest.mark.parametrize(
    ("command", "sentence"),
    [
        ("store list --store nothing", "nothing: is not a store"),
        ("store init plant", "plant: is a store already"),
        ("store add nothing.json", "nothing.json: cannot be read"),
        ("store add events.toml", "does not state the axis of its events; give its name (--axis)"),
        ("store add plant/store.toml", "is none of RUN.toml"),
        ("store add run01.json --site a", "a site is that of a machine"),
        ("store show nothing", "the store has no axis 'nothing'; it has 'bench'"),
        ("store exclude run", "an exclusion needs a reason"),
        ("store exclude run --reason x", "several runs whose id begins with 'run'"),
        ("store correct bench --model x --mass 1kg", "give one of them"),
        ("monitor bench --store plant --model model.json", "with --store, give the name of one axis"),
        ("monitor run01.json", "no model of the axis is given (--model)"),
        ("reprocess nothing", "the store has no axis 'nothing'"),
        ("reprocess --scheduler tcp://192.0.2.1:8786", "is on another computer"),
        ("reprocess --scheduler tcp://127.0.0.1:1 --workers 2", "give --scheduler or --workers"),
        ("store simulate-fleet --years 0", "50 years at most"),
        ("store retain", "state an age (--days), or retention_days in server.toml"),
        ("store retain --days -1", "must be 0 or more"),
        ("store retain --days 1000000", "days at most 36500"),
    ],
)
def test_what_is_wrong_is_a_sentence(capsys: pytest.CaptureFixture[str], command: str, sentence: str) -> None:
    capsys.readouterr()
    assert run(command.split()) == 2
    assert sentence in capsys.readouterr().err


def test_one_wrong_file_does_not_stop_the_others(plant: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (plant.parent / "wrong.json").write_text("{}", encoding="utf-8")
    assert run(["store", "add", "wrong.json", "run00.json"]) == 2
    found = capsys.readouterr()
    assert "was there already" in found.out
    assert "wrong.json" in found.err


def test_a_damaged_store_is_named(plant: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (plant / "store.sqlite").write_bytes(b"no database at all" * 1000)
    assert run(["store", "verify"]) == 2
    assert "damaged" in capsys.readouterr().err
    assert run(["store", "list"]) == 2
    assert "the database is damaged" in capsys.readouterr().err


def test_without_the_extra_there_is_a_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    find_spec = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name: None if name == "alembic" else find_spec(name)
    )
    monkeypatch.delitem(sys.modules, "ballscrew.store", raising=False)
    with pytest.raises(InputError, match=r'python -m pip install "ballscrew\[store\]"'):
        importlib.import_module("ballscrew.store")


def test_without_a_store_there_is_a_sentence(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("BALLSCREW_STORE", raising=False)
    for command in ("list", "verify", "gc", "migrate"):
        assert run(["store", command]) == 2
        assert "no store is given" in capsys.readouterr().err


def test_the_path_of_a_new_store_is_its_document(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert printed(capsys, "store", "init", str(tmp_path / "new"))["store"] == str(tmp_path / "new")
    assert (tmp_path / "new" / "store.toml").is_file()


@pytest.mark.usefixtures("plant")
def test_what_is_strange_about_a_run_is_printed_as_it_is_added(capsys: pytest.CaptureFixture[str]) -> None:
    files = (replace(RUNS[0].files[0], sha256="f" * 64),)
    later = replace(RUNS[0], id="f" * 64, measured_at="2090-01-01T00:00:00+00:00", files=files)
    later.write("future.json")
    shown = words(capsys, "store", "add", "future.json")
    assert "future.json: run ffffffffffff of bench: added." in shown
    assert "• The run's time, 2090-01-01T00:00:00+00:00, is in the future" in shown


def test_a_run_is_shown_with_its_state_and_the_place_of_its_recordings(
    with_files: OpenStore, capsys: pytest.CaptureFixture[str]
) -> None:
    ids = run_ids(capsys)
    shown = words(capsys, "store", "show", ids[3])
    state = printed(capsys, "store", "show", ids[3])["state"]
    assert f"State {state['state']}, epoch 0 from the first run, relative to the run {ids[0]}" in shown  # type: ignore[index]
    assert f"by the model {state['model_digest']}, ballscrew {state['version']}, {state['made_at']}" in shown  # type: ignore[index]
    assert "; in the store" in shown
    assert "It does not count" not in shown
    assert run(["store", "retain", "--days", "0", "--newest", "1"]) == 0
    deleted = printed(capsys, "store", "show", ids[4])["recordings"][0]["deleted_at"]  # type: ignore[index]
    shown = words(capsys, "store", "show", ids[4])
    assert f"; deleted by policy at {utc_minute(deleted)}" in shown
    assert "; in the store" not in shown
    corrected = printed(capsys, "store", "correct", ids[4], "--measured-at", at(13.0))["run"]
    shown = words(capsys, "store", "show", ids[4])
    assert "It does not count: it was corrected" in shown
    assert f"Corrected as the run {corrected}" in shown
    assert with_files.path.name == "plant"


def test_alarms_that_do_not_stand_and_a_trouble_of_the_measurement_are_shown(
    with_files: OpenStore, capsys: pytest.CaptureFixture[str]
) -> None:
    with with_files.write("test") as session:
        axis = session.scalars(select(Axis)).one().id
        for began, retracted in ((3.0, None), (6.0, at(12.0))):
            session.add(
                AlarmRow(
                    axis_id=axis, epoch=0, began_at=at(began), raised_at=at(began + 3), retracted_at=retracted
                )
            )  # fmt: skip
        trouble = Trouble(
            axis_id=axis, kind="silence", began_at=at(15.0), raised_at=at(20.0), ended_at=None,
            text="No run has come for 5 days.",
        )  # fmt: skip
        session.add(trouble)
    shown = words(capsys, "store", "show", "bench")
    first, second, third, fourth = (utc_minute(at(day)) for day in (3.0, 6.0, 9.0, 12.0))
    assert f"Alarm since {first}, raised {second}, over since {third}." in shown
    assert f"Alarm since {second}, raised {third}, retracted {fourth}." in shown
    assert "Measurement: No run has come for 5 days." in shown


@pytest.mark.usefixtures("plant")
def test_the_newest_runs_of_a_long_history_are_shown(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert "14 runs" in words(capsys, "store", "show", "bench")
    monkeypatch.setattr("ballscrew.cli.store._SHOWN_RUNS", 5)
    shown = words(capsys, "store", "show", "bench")
    assert "the newest 5 of 14 runs" in shown
    assert utc_minute(str(RUNS[9].measured_at)) in shown
    assert utc_minute(str(RUNS[8].measured_at)) not in shown


def test_raw_files_of_no_run_are_counted_by_verify(
    with_files: OpenStore, capsys: pytest.CaptureFixture[str]
) -> None:
    assert words(capsys, "store", "verify").endswith("6 raw files verified: 0 faults.")
    (with_files.folder.files / ".incoming-x").write_bytes(b"123")
    assert "0 faults. 1 files belong to no run; 'ballscrew store gc' removes them." in words(
        capsys, "store", "verify"
    )


def test_a_switch_of_runs_without_raw_files_is_described(
    with_files: OpenStore, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert "without raw files" not in words(capsys, "reprocess", "bench")
    assert run(["store", "archive", "bench", "--to", "archive", "--newest", "1"]) == 0
    monkeypatch.setattr(adding, "METHOD_REVISION", 2)
    imitate_analysis(monkeypatch, scale=31.0)  # 0.3 % more
    by_switch = words(capsys, "reprocess", "bench", status=2)
    assert "bench: 2 runs without raw files: by --switch they keep their results, with an event" in by_switch
    switched = words(capsys, "reprocess", "bench", "--switch")
    assert "bench: 2 runs without raw files keep their results, with an event of the step: as +" in switched
    assert switched.endswith("% of the preload, by 4 runs with both.")
    assert with_files.path.name == "plant"


@pytest.mark.usefixtures("with_files")
def test_a_run_that_cannot_be_analysed_again_is_named_and_has_status_2(
    capsys: pytest.CaptureFixture[str],
) -> None:
    newest = run_ids(capsys)[-1]
    assert run(["store", "archive", "bench", "--to", "archive", "--newest", "0"]) == 0
    capsys.readouterr()
    assert run(["reprocess", "bench", "--method", "paper"]) == 2
    found = capsys.readouterr()
    assert f"ballscrew: run {newest[:12]}: its raw files are archived or deleted" in found.err
    assert "without raw files; the step to the new results cannot be estimated." in found.out
