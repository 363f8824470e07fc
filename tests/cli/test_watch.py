"""``ballscrew watch``: a folder of runs that grows."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from tests.cli.conftest import FILES
from tests.estimation.made_runs import calibrated
from tests.monitoring.histories import history, worn

from ballscrew import InputError, Run, watch
from ballscrew.base.provenance import FileRef, hash_file
from ballscrew.calibration.modelfile import write_model
from ballscrew.cli.watch import WatchedAxis
from ballscrew.modal.job import Job
from ballscrew.prognosis.monitor import monitor

pytestmark = pytest.mark.usefixtures("few_members")
RUNS = {f"day-{index:02d}": run for index, run in enumerate(history(range(4), worn(2.0, 40.0)))}


def analyzed(source: Path) -> Run:
    """Made run of that name, of the recordings and documents that the folder has now."""
    job = Job.read(source)
    files = tuple(FileRef(path.name, hash_file(path)) for path in job.files if isinstance(path, Path))
    identity = job.identity(files, job.measured_at)
    run = RUNS[source.parent.name.removesuffix(" copy")]
    return replace(
        run, id=identity, files=files, mass_kg=job.mass, measured_at=job.measured_at,
        temperature_C=job.temperature, made=replace(run.made, inputs=job.inputs()),
    )  # fmt: skip


def add_run(folder: Path, name: str, more: str = "") -> Path:
    """Recording and RUN.toml of one night."""
    path = folder / name
    path.mkdir()
    (path / "trip.csv").write_text(f"recording of {name}", encoding="utf-8")
    time = f'measured_at = "{RUNS[name].measured_at}"\n'
    text = 'channels = "../channels.toml"\nload = "100 kg"\nfiles = ["trip.csv"]\n' + (more or time)
    (path / "run.toml").write_text(text, encoding="utf-8")
    return path / "run.toml"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Three nights of the model's axis, with the shared files in the same folder."""
    write_model(calibrated(), tmp_path / "model.json")
    for name in ("axis.toml", "plan.toml", "channels.toml"):
        (tmp_path / name).write_text(FILES[name], encoding="utf-8")
    for name in list(RUNS)[:3]:
        add_run(tmp_path, name)
    return tmp_path


def watched(folder: Path, analyze_run: Callable[[Path], Run] = analyzed) -> WatchedAxis:
    return watch(folder, folder / "model.json", analyze_run=analyze_run)


def contents(folder: Path) -> dict[str, tuple[bytes, int]]:
    files = [path for path in folder.rglob("*") if path.is_file()]
    return {str(path): (path.read_bytes(), path.stat().st_mtime_ns) for path in files}


def no_analysis(source: Path) -> Run:
    raise AssertionError(f"{source} was analysed again")


def test_new_runs_are_analysed_once_and_the_axis_is_monitored(folder: Path) -> None:
    first = watched(folder)
    assert [path.parent.name for path in first.analyzed] == list(RUNS)[:3]
    assert first.failures == ()
    runs = [Run.read(folder / name / "run.json") for name in list(RUNS)[:3]]
    assert first.monitored.to_json() == monitor(runs, calibrated()).to_json()
    assert sorted(path.parent.name for path in folder.rglob("run.preload.json")) == list(RUNS)[:3]
    before = contents(folder)
    assert watched(folder, no_analysis).analyzed == ()
    assert contents(folder) == before  # neither written nor touched
    last = add_run(folder, list(RUNS)[3])
    assert watched(folder).analyzed == (last,)


def test_the_page_is_one_file(folder: Path) -> None:
    page = watched(folder).page.read_text(encoding="utf-8")
    assert page.count('src="data:image/png;base64,') == page.count("<img") == 1
    assert "http" not in page.replace("http-equiv", "")
    assert "day-02/run.toml" in page
    assert "NOT JUDGED" in page


def test_a_run_that_has_changed_is_analysed_again(folder: Path) -> None:
    watched(folder)
    source = folder / "day-01" / "run.toml"
    text = source.read_text(encoding="utf-8")
    source.write_text(text + 'temperature = "22 degC"\n', encoding="utf-8")
    assert watched(folder).analyzed == (source,)
    recording = folder / "day-02" / "trip.csv"
    recording.write_text("complete now", encoding="utf-8")
    later = (folder / "day-02" / "run.json").stat().st_mtime_ns + 1_000_000_000
    os.utime(recording, ns=(later, later))
    assert watched(folder).analyzed == (folder / "day-02" / "run.toml",)
    (folder / "day-00" / "trip.csv").unlink()  # once analysed, a recording may be archived
    result = folder / "day-02" / "run.json"
    os.utime(result, ns=(later, later))
    assert watched(folder, no_analysis).failures == ()


def test_a_run_that_cannot_be_used_is_named_and_the_others_are_monitored(folder: Path) -> None:
    add_run(folder, "day-03", more="# no time\n")
    broken = folder / "broken.toml"
    broken.write_text("files = [", encoding="utf-8")
    (folder / "misspelled.toml").write_text(
        'files = ["a.csv"]\nchanels = "channels.toml"\n', encoding="utf-8"
    )
    found = watched(folder)
    assert len(found.monitored.state.runs) == 3
    text = "\n".join(found.failures)
    assert "run.toml: has no time; add measured_at" in text
    assert "broken.toml: is not TOML" in text
    assert "misspelled" in text
    copy = folder / "day-02 copy"
    copy.mkdir()
    for name in ("run.toml", "run.json", "trip.csv"):
        (copy / name).write_bytes((folder / "day-02" / name).read_bytes())
    assert any("has a recording of" in failure for failure in watched(folder).failures)


def test_a_recording_that_grows_is_left_for_the_next_time(folder: Path) -> None:
    def growing(source: Path) -> Run:
        run = analyzed(source)
        if source.parent.name == "day-02":
            (source.parent / "trip.csv").write_text("longer than it was before", encoding="utf-8")
        return run

    found = watched(folder, growing)
    assert len(found.runs) == 2
    assert "changed during the analysis" in found.failures[0]
    assert not (folder / "day-02" / "run.json").exists()
    assert watched(folder).failures == ()


def test_a_file_of_another_kind_is_not_overwritten(folder: Path) -> None:
    other = folder / "day-00" / "run.json"
    other.write_text('{"schema": 2, "mine": 1}', encoding="utf-8")
    found = watched(folder)
    assert "is not a run of ballscrew" in found.failures[0]
    assert other.read_text(encoding="utf-8") == '{"schema": 2, "mine": 1}'


def test_the_command(ballscrew, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ballscrew.cli.watch.analyze", lambda source, **_: analyzed(source))
    outcome = ballscrew("watch", folder, "--model", folder / "model.json", "--exit-code")
    assert outcome.status == 5, outcome.err  # learning
    assert "NOT JUDGED" in outcome.out.splitlines()[0]
    assert outcome.out.count("Analysed: ") == 3
    outcome = ballscrew("watch", folder, "--model", folder / "model.json", "--json")
    assert (outcome.status, outcome.document["analyzed"]) == (0, [])
    duty = folder / "duty.csv"
    duty.write_text("date,hours\n2024-01-01,1\n2027-01-01,8000\n", encoding="utf-8")
    command = ("watch", folder, "--model", folder / "model.json", "--json", "--duty")
    outcome = ballscrew(*command, duty)
    assert "rul_hours" in outcome.document["monitor"], outcome.err
    assert "more than 0" in ballscrew(*command, "0 km").err
    add_run(folder, "day-03", more="# no time\n")
    assert ballscrew("watch", folder, "--model", folder / "model.json").status == 2


def test_a_folder_without_runs_and_a_page_of_another_kind(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="contains no run"):
        watch(tmp_path / "empty", folder / "model.json")
    with pytest.raises(InputError, match="must end in"):
        watch(folder, folder / "model.json", page=folder / "model.json")
    with pytest.raises(InputError, match="not a folder"):
        watch(folder / "model.json", folder / "model.json")


def test_a_link_out_of_the_folder_is_refused(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    secret = tmp_path_factory.mktemp("elsewhere") / "secret.csv"
    secret.write_text("recording of day-03", encoding="utf-8")
    trip = add_run(folder, "day-03").with_name("trip.csv")
    trip.rename(folder / "inside.csv")
    try:
        trip.symlink_to(secret)
    except OSError:
        pytest.skip("links cannot be made here")
    found = watched(folder)
    assert (len(found.runs), len(found.failures)) == (3, 1)
    assert "is a link out of the folder" in found.failures[0]
    trip.unlink()
    trip.symlink_to(folder / "inside.csv")
    assert watched(folder).failures == ()


def test_a_hidden_folder_is_not_watched(folder: Path) -> None:
    hidden = folder / ".trash"
    hidden.mkdir()
    add_run(hidden, "day-03")
    (hidden / "broken.toml").write_text("files = [", encoding="utf-8")
    found = watched(folder)
    assert (len(found.runs), found.failures) == (3, ())


def test_a_run_whose_time_has_changed_is_analysed_again(folder: Path) -> None:
    watched(folder)
    source = folder / "day-01" / "run.toml"
    text = source.read_text(encoding="utf-8")
    time = str(RUNS["day-01"].measured_at)
    later = time.replace("T08", "T09")
    source.write_text(text.replace(time, later), encoding="utf-8")
    assert watched(folder).analyzed == (source,)
    assert Run.read(source.with_suffix(".json")).measured_at == later


def test_a_run_of_another_axis_does_not_count(folder: Path) -> None:
    def of_another(source: Path) -> Run:
        name = "the other" if source.parent.name == "day-01" else "bench"
        return replace(analyzed(source), axis=name)

    found = watched(folder, of_another)
    (failure,) = found.failures
    assert failure == f"{folder / 'day-01' / 'run.toml'}: is of the axis 'the other', the model of 'bench'."
    assert len(found.monitored.state.runs) == 2
    assert not (folder / "day-01" / "run.preload.json").exists()


@pytest.mark.parametrize("content", ['{"schema": 2, "mine": 1}', '{"mine": 1}', "x"])
def test_a_file_that_is_no_preload_is_named_once_and_stays(folder: Path, content: str) -> None:
    other = folder / "day-01" / "run.preload.json"
    other.write_text(content, encoding="utf-8")
    (failure,) = watched(folder).failures
    assert failure.startswith(f"{other}: ")
    assert failure.count(other.name) == 1
    assert other.read_text(encoding="utf-8") == content
    assert (folder / "day-02" / "run.preload.json").is_file()


def test_without_matplotlib_the_page_has_no_picture(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def missing() -> None:
        raise InputError("matplotlib is not installed.")

    monkeypatch.setattr("ballscrew.report.axis_page.check_drawing", missing)
    page = folder / "axis.html"
    watch(folder, folder / "model.json", analyze_run=analyzed, page=page)
    text = page.read_text(encoding="utf-8")
    assert "<img" not in text
    assert "<table" in text
