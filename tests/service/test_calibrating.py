"""Calibration by stored runs: the API, and the page that calls it."""

from __future__ import annotations

import multiprocessing
import re
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
from fastapi.testclient import TestClient
from tests.service import quick_calibration
from tests.service.conftest import SETUP, NewService, client_of, send_result, wait_for
from tests.service.pages.forms import HOSTILE, fill_axis, get, post, problem
from tests.simulated_bench import AXIS
from tests.store.stored import MODEL, RUNS

from ballscrew.axis.sheet_file import read_axis
from ballscrew.base.errors import InputError
from ballscrew.base.files import write_text
from ballscrew.base.jsonfile import write_json
from ballscrew.calibration.calibration import calibrate
from ballscrew.calibration.modelfile import model_json
from ballscrew.service import calibrating
from ballscrew.service.calibrating import CalibrationTask, Calibrator, calibrate_stored
from ballscrew.service.pages import calibration_page
from ballscrew.service.pages.rendering import format_moment
from ballscrew.service.serving import Service
from ballscrew.store.adding import add_run
from ballscrew.store.raw_files import text_files

ADDRESS = "/api/v1/axes/bench/calibration"
PAGE = "/axes/bench/calibration"


@pytest.fixture(autouse=True)
def _plain_task(monkeypatch: pytest.MonkeyPatch) -> None:
    """The process gets a task without its class, and need not import the package."""

    def reduce(task: CalibrationTask) -> Any:
        return SimpleNamespace, (), {"store": task.store}

    monkeypatch.setattr(CalibrationTask, "__reduce__", reduce)


def set_target(client: TestClient, target: Any) -> Calibrator:
    """Replace the process of the calibration."""
    found: Calibrator = client.app.state.calibrator  # type: ignore[attr-defined]
    found.target = target
    return found


def ended(client: TestClient) -> dict[str, Any]:
    """The calibration, after it has ended."""

    def show() -> dict[str, Any]:
        found: dict[str, Any] = client.get(ADDRESS).json()["calibration"]
        return found

    wait_for(lambda: show()["status"] != "running")
    return show()


def test_a_stored_calibration_is_that_of_the_same_runs(client: TestClient, service: Service) -> None:
    for number in range(3):
        send_result(client, number)
    runs = [run.id for run in RUNS[:3]]
    found = calibrate_stored(CalibrationTask(str(service.store.path), "bench", tuple(runs), {}))
    with text_files({"axis": AXIS}) as paths:
        sheet = read_axis(paths["axis"])
    expected = model_json(calibrate(list(RUNS[:3]), sheet))
    assert found["parameters"] == expected["parameters"]
    assert found["covariance"] == expected["covariance"]
    for unknown in (("x",), (*runs, "y")):
        with pytest.raises(InputError, match="no result of a run"):
            calibrate_stored(CalibrationTask(str(service.store.path), "bench", unknown, {}))


def test_the_page_calibrates_shows_the_report_and_uses_the_model(
    client: TestClient, service: Service
) -> None:
    runs = fill_axis(client, service, 4)
    set_target(client, quick_calibration.give_model)
    assert "None since the server was started." in get(client, PAGE)
    assert "no calibration to use" in problem(post(client, PAGE, do="use"))
    answer = post(client, PAGE, do="start", run=runs[:3], **{f"known {runs[0]}": "600 N ± 10 N"})
    assert (answer.status_code, answer.headers["location"]) == (303, f"{PAGE}?done=start")
    assert 'hx-trigger="every 2s"' in get(client, PAGE)
    assert "is running" in problem(post(client, PAGE, do="start", run=runs[:3]))
    write_text(service.store.path / "model.json", write_json(model_json(MODEL)))
    assert ended(client)["status"] == "done"
    page = get(client, PAGE)
    assert "Use this model" in page
    assert 'hx-trigger="every 2s"' not in page
    for doubt in MODEL.reasons:
        assert doubt.name in page
    answer = client.get(f"{PAGE}/model")
    assert answer.json()["parameters"] == model_json(MODEL)["parameters"]
    assert post(client, PAGE, do="use", model=shown_model(page)).headers["location"] == f"{PAGE}?done=use"
    assert "The model is in use" in get(client, f"{PAGE}?done=use")


def shown_model(page: str) -> str:
    """Digest of the model that a page shows."""
    (found,) = re.findall('name="model" value="([0-9a-f]{64})"', page)
    return str(found)


def test_the_model_that_is_used_is_the_one_that_the_page_showed(client: TestClient, service: Service) -> None:
    runs = fill_axis(client, service, 4)
    set_target(client, quick_calibration.give_model)
    digests = []
    for note in ("of one person", "of another"):
        document = model_json(MODEL)
        document["notes"] = [note]
        (service.store.path / "model.json").write_text(write_json(document), encoding="utf-8")
        post(client, PAGE, do="start", run=runs[:3])
        assert ended(client)["status"] == "done"
        digests.append(shown_model(get(client, PAGE)))
    for form in ({"model": digests[0]}, {}):
        answer = post(client, PAGE, do="use", **form)
        assert (answer.status_code, "another calibration has ended" in problem(answer)) == (422, True)
    assert client.get("/api/v1/axes/bench").json()["corrections"] == []
    assert post(client, PAGE, do="use", model=digests[1]).status_code == 303
    (chosen,) = client.get("/api/v1/axes/bench").json()["corrections"]
    assert chosen["field"] == "model"


def test_a_model_that_is_used_replaces_the_one_before(client: TestClient, service: Service) -> None:
    fill_axis(client, service, 4)
    other = model_json(MODEL)
    other["notes"] = ["another"]
    digest = client.put("/api/v1/axes/bench/model", params={"use": True}, json=other).json()["digest"]
    show = client.get("/api/v1/axes/bench").json()
    assert [each["new"] for each in show["corrections"] if each["field"] == "model"] == [digest]


@pytest.mark.parametrize(
    ("form", "sentence"),
    [
        ({}, "The choice of runs must not be empty."),
        ({"run": ["a"] * 101}, "The choice of runs must have 100 entries or fewer."),
        ({"run": ["a"], "known a": "heavy"}, "is not a number with a unit"),
        ({"run": ["a"], "known a": HOSTILE}, "is not a number with a unit"),
    ],
)
def test_a_wrong_choice_is_one_sentence(client: TestClient, form: dict[str, Any], sentence: str) -> None:
    answer = post(client, PAGE, do="start", **form)
    assert answer.status_code == 422
    assert sentence in problem(answer)
    assert client.get(ADDRESS).json()["calibration"] is None


def test_a_preload_of_a_run_that_is_not_chosen_is_refused(client: TestClient) -> None:
    body = {"runs": ["a"], "known_preloads": {"b": "600 N"}}
    answer = client.post(ADDRESS, json=body)
    assert (answer.status_code, "no run of the calibration" in answer.json()["detail"]) == (422, True)


def test_a_process_that_dies_or_takes_too_long_is_a_sentence(new_service: NewService) -> None:
    service = new_service()
    with client_of(service) as client:
        client.put("/api/v1/axes/bench", json=SETUP)
        for target, limit, sentence in (
            (quick_calibration.die, 600.0, "ended without a result"),
            (quick_calibration.wait, 0.5, "took longer than 0.5 s"),
        ):
            set_target(client, target)
            service.settings = service.settings.model_copy(update={"lease_s": limit})
            assert client.post(ADDRESS, json={"runs": ["a"]}).status_code == 202
            found = ended(client)
            assert (found["status"], found["model"]) == ("failed", None)
            assert sentence in found["error"]
            assert sentence in get(client, PAGE)


def test_an_axis_without_a_data_sheet_is_not_calibrated(new_service: NewService) -> None:
    service = new_service()
    add_run(service.store, RUNS[0])
    with pytest.raises(InputError, match="the axis 'bench' has no data sheet: set it up first"):
        calibrate_stored(CalibrationTask(str(service.store.path), "bench", (RUNS[0].id,), {}))


@pytest.mark.parametrize(
    ("end", "answer"),
    [
        (lambda _: {"kind": "model"}, ("done", {"kind": "model"})),
        (lambda task: calibrate_stored(task), ("refused", "no axis 'none'")),
        (lambda _: 1 / 0, ("failed", "unexpected error (ZeroDivisionError: division by zero)")),
    ],
)
def test_the_process_sends_the_model_or_a_sentence(
    service: Service, monkeypatch: pytest.MonkeyPatch, end: Any, answer: tuple[str, Any]
) -> None:
    monkeypatch.setattr(calibrating, "calibrate_stored", end)
    ours, theirs = multiprocessing.Pipe(duplex=False)
    calibrating.work(theirs, CalibrationTask(str(service.store.path), "none", ("a",), {}))
    theirs.close()
    status, result = ours.recv()
    assert status == answer[0]
    assert result == answer[1] or answer[1] in result


def test_a_model_for_a_server_that_has_gone_is_no_error(
    service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(calibrating, "calibrate_stored", lambda _: {})
    ours, theirs = multiprocessing.Pipe(duplex=False)
    ours.close()
    calibrating.work(theirs, CalibrationTask(str(service.store.path), "bench", ("a",), {}))


def test_a_process_that_cannot_be_started_is_a_sentence_and_another_calibration_can_begin(
    client: TestClient, service: Service
) -> None:
    set_target(client, lambda *_: None)  # which cannot be sent to a process
    changes = service.changes
    for _ in range(2):
        assert client.post(ADDRESS, json={"runs": ["a"]}).status_code == 202
        found = ended(client)
        assert found["status"] == "failed"
        assert found["error"].startswith("the calibration failed: ")
    wait_for(lambda: service.changes >= changes + 2)


def test_a_calibration_ends_with_the_server(client: TestClient, service: Service) -> None:
    set_target(client, quick_calibration.wait)
    assert client.post(ADDRESS, json={"runs": ["a"]}).status_code == 202
    service.stopping.set()
    found = ended(client)
    assert (found["status"], found["error"]) == ("failed", "the server stops.")


def test_the_page_offers_the_first_and_the_last_runs_of_a_long_history(
    client: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    for number in range(5):
        send_result(client, number)
    runs = [run.id for run in RUNS[:5]]
    monkeypatch.setattr(calibration_page, "_LISTED", 2)
    page = get(client, PAGE)
    assert re.findall('name="run" value="([^"]+)"', page) == [*runs[:2], *runs[-2:]]
    monkeypatch.setattr(calibration_page, "_LISTED", 3)
    assert re.findall('name="run" value="([^"]+)"', get(client, PAGE)) == runs


def test_the_page_says_what_is_determined_and_what_one_more_measurement_would_determine() -> None:
    offer = {"kind": "offer", "what": "one more load", "share": 0.1, "log_preload": 0.2, "mass": 0.3}
    sentence = f"The preload of {RUNS[1].id[:12]} is determined by the data."
    known = {"kind": "direction", "sentence": sentence}
    model = replace(MODEL, knowledge=(known, offer))
    found = calibration_page.report_of(model, {RUNS[1].id: "2026-03-01T08:00:00+00:00"}, "en")
    assert found["offers"] == [offer]
    time = format_moment("2026-03-01T08:00:00+00:00", "en")
    assert found["determined"] == [f"The preload of {time} is determined by the data."]
