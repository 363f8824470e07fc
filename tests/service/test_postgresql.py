"""The service on PostgreSQL: set-up, upload, verdict, and what is read."""

from __future__ import annotations

import threading
import time
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import pytest
from sqlalchemy import select
from tests.service.conftest import SETUP, client_of, send, send_result, work_off
from tests.store.conftest import postgresql  # noqa: F401  a fixture
from tests.store.servers import PostgreSQL
from tests.store.stored import MODEL, RUNS

from ballscrew.calibration.modelfile import model_json
from ballscrew.service.pages import fleet
from ballscrew.service.serving import RefusedError, ServedStore, Service
from ballscrew.service.settings import ServerSettings
from ballscrew.store.migrating import create_store
from ballscrew.store.store import Store
from ballscrew.store.tables import StateRow


def test_a_round_trip_on_postgresql(postgresql: PostgreSQL, tmp_path: Path) -> None:  # noqa: F811
    folder = create_store(tmp_path / "store", database=postgresql.new_database()).path
    service = Service(ServedStore(folder), ServerSettings(min_free_bytes=0))
    service.partial.mkdir()
    with client_of(service) as client:
        assert client.put("/api/v1/axes/bench", json=SETUP).status_code == 200
        assert client.put("/api/v1/axes/bench/model", json=model_json(MODEL)).status_code == 200
        assert send(client).status_code == 202
        assert send(client).status_code == 200
        bad = replace(RUNS[2].quality, verdict="bad", reasons=("the sensor is loose.",))
        for number, quality in ((1, RUNS[1].quality), (2, bad)):
            assert send_result(client, number, quality=quality).status_code == 202
        work_off(service, lambda _: ("done", (RUNS[0].to_json(), [])))
        assert client.get("/api/v1/axes/bench/state").json()["state"] == "learning"
        (alarm,) = client.get("/api/v1/alarms").json()["alarms"]
        assert (alarm["kind"], alarm["state"]) == ("measurement", "raised")
        assert len(client.get("/api/v1/axes/bench/history").json()["history"]) == 3
        found = client.get(f"/api/v1/runs/{RUNS[0].id}").json()
        assert (found["sent"][0]["status"], found["run"]["id"]) == ("done", RUNS[0].id)
        assert client.get("/").status_code == 200
        with service.store.read() as session:
            begin = min(session.scalars(select(StateRow.time))) - 51.75 * 7 * 86400
            assert fleet._strips(session, begin)["bench"][0] == (51, 1, "learning")  # not rounded up
        excluded = client.post(f"/api/v1/axes/bench/runs/{RUNS[1].id}/exclusion", json={"reason": "x"})
        assert excluded.json()["excluded"]
        work_off(service, lambda _: ("failed", "no analysis"))
        assert client.get("/api/v1/jobs").json()["jobs"] == []
        assert "ballscrew_queue_jobs 0\n" in client.get("/metrics").text
    assert Store.verify(folder).faults == ()
    service.store.engine(writing=True).dispose()
    service.store.engine(writing=False).dispose()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # of broken connections
def test_what_is_acknowledged_outlives_a_database_that_is_stopped_and_restarted(
    postgresql: PostgreSQL,  # noqa: F811
    tmp_path: Path,
) -> None:
    """At once, while runs are sent, analysed and assessed."""
    folder = create_store(tmp_path / "store", database=postgresql.new_database()).path
    service = Service(ServedStore(folder), ServerSettings(min_free_bytes=0, lease_s=1.0, back_off_s=0.0))
    service.partial.mkdir()
    acknowledged, busy, ends = set[str](), [], threading.Event()
    with client_of(service) as client:
        assert client.put("/api/v1/axes/bench", json=SETUP).status_code == 200
        assert client.put("/api/v1/axes/bench/model", json=model_json(MODEL)).status_code == 200

        def send_all() -> None:
            for number in range(len(RUNS)):
                while f"analysed-{number}" not in acknowledged:
                    with suppress(AssertionError):  # of a part of it
                        answer = send_result(client, number)
                        assert answer.status_code in (200, 202), answer.text
                        acknowledged.add(f"analysed-{number}")
                with suppress(RefusedError):  # the jobs wait
                    work_off(service, lambda _: ("failed", "no analysis"))
            ends.set()

        sender = threading.Thread(target=send_all)
        sender.start()
        while not ends.is_set():
            time.sleep(0.3)
            postgresql.stop("immediate")
            busy.append(client.get("/readyz").status_code)
            postgresql.start()
        sender.join()
        time.sleep(1.1)  # leases have ended
        work_off(service, lambda _: ("failed", "no analysis"))
        sent = client.get("/api/v1/axes/bench/runs").json()["sent"]
        assert {each["run"]: each["status"] for each in sent} == dict.fromkeys(acknowledged, "done")
        assert client.get("/api/v1/axes/bench/state").json()["state"] == "alarm"  # as without
    assert set(busy) == {503}
    assert len(busy) >= 3
    assert len(acknowledged) == len(RUNS)
    assert Store.verify(folder).faults == ()
    for writing in (False, True):
        service.store.engine(writing=writing).dispose()
