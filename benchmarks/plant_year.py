"""A year of a plant that tests weekly, sent as RUN.json over HTTP with an injected clock.

``python -m benchmarks.plant_year --axes 40 --weeks 52`` simulates axes that are healthy, wear, or have a worn
bearing, sends a run a week of each through the HTTP API, some late and some never, and lets people
acknowledge alarms, inspect the axis two weeks later, and close them with what the simulated truth is; a worn
nut is replaced. Messages go to two webhooks. At the end alarms, troubles, retractions and messages are
counted, and precision and lead time of the server are compared with a recount from the truth.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import os
import re
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from statistics import median
from threading import Thread
from typing import Any

import numpy as np
from fastapi.testclient import TestClient

from ballscrew.axis.sheet_file import axis_toml
from ballscrew.base.jsonfile import write_json
from ballscrew.base.provenance import FileRef, digest
from ballscrew.calibration.calibration import calibrate
from ballscrew.calibration.modelfile import model_json
from ballscrew.fcft.planfile import plan_toml
from ballscrew.modal.analyze import analyze
from ballscrew.modal.run import Run
from ballscrew.reproduction.plant import (
    CHANNELS,
    PLANT,
    WEEKS,
    AxisType,
    PlantAxis,
    random_of,
    rig_of,
    temperature,
)
from ballscrew.reproduction.plant_runs import TrueState, _true_state, imitate_run
from ballscrew.service.alarms import Action, watch_for_silence
from ballscrew.service.app import create_app
from ballscrew.service.delivering import plan_messages, send_messages
from ballscrew.service.jobs import lease_job
from ballscrew.service.serving import ServedStore, Service
from ballscrew.service.settings import ServerSettings
from ballscrew.service.working import do_task, finish, task_of
from ballscrew.store.folder import at_time
from ballscrew.store.migrating import create_store
from ballscrew.testbed.run import simulate_run

_TYPES = tuple({id(axis.type): axis.type for axis in PLANT}.values())
_PRESENT = datetime(2026, 6, 29, 12, tzinfo=UTC)  # Monday; runs before it
_SECRET = "BALLSCREW_BENCHMARK_SECRET"  # noqa: S105  name of a variable
_LATE, _MISSED, _IGNORED = 0.03, 0.02, 0.15  # parts of runs and of alarms
_INSPECTED = timedelta(days=14)  # after an alarm
_EXCLUDED = timedelta(days=3)  # after an alarm, runs with a wrong load
_TRUE_LOSS = 0.03  # of the stiffness's preload, from which an alarm is right
_DISTURBED = 0.985  # of the frequencies of a run with a wrong load
_END = 0.5  # P/P₀ at the end of a life
_RECEIVED = timedelta(minutes=12)


@dataclass
class LivingAxis:
    """An axis as it is at present: a repair changes it."""

    axis: PlantAxis
    template: Run
    then: TrueState
    random: np.random.Generator
    sent: list[Run] = field(default_factory=list)
    disturbed: tuple[int, ...] = ()
    bearing_repaired: int | None = None
    has_model: bool = False

    def at(self, week: int) -> PlantAxis:
        """The axis without a bearing's fault after its repair."""
        if self.bearing_repaired is not None and week > self.bearing_repaired:
            return replace(self.axis, bearing=None)
        return self.axis

    def ratio(self, week: float) -> float:
        """True preload of the nut, or of the bearing if that is less, relative to the new one."""
        axis, found = self.at(int(week)), 1.0
        if axis.worn is not None and (axis.replaced is None or week <= axis.replaced):
            begin, life = axis.worn
            found = (1 - min(max(week - begin, 0.0) / life, 0.95)) ** 1.5
        if axis.bearing is not None:
            begin, rate = axis.bearing
            found = min(found, 1 - rate * max(week - begin, 0.0))
        return found

    def end(self) -> float | None:
        """Week in which half of the preload would be lost."""
        if self.axis.worn is None:
            return None
        begin, life = self.axis.worn
        return float(begin + life * (1 - _END ** (2 / 3)))

    def measure(self, week: int, seed: int) -> Run:
        """The test of a week."""
        axis = self.at(week)
        state = _true_state(axis, week, seed)
        if week in self.disturbed:
            state = replace(state, free=_DISTURBED * state.free, rotor_held=_DISTURBED * state.rotor_held)
        run = imitate_run(self.template, self.then, state, random_of(axis, seed, week, 2))
        measured_at = axis.measured_at(week, _PRESENT).isoformat()
        identity = digest([axis.name, measured_at, seed])
        files = tuple(FileRef(file.name, digest([identity, number])) for number, file in enumerate(run.files))
        return replace(
            run, id=identity, axis=axis.name, measured_at=measured_at, files=files,
            temperature_C=temperature(axis, week, seed),
        )  # fmt: skip


class Year:
    """The plant, its server, and the people."""

    def __init__(self, service: Service, client: TestClient, axes: list[LivingAxis], seed: int) -> None:
        self.service, self.client, self.axes, self.seed = service, client, axes, seed
        self.random = np.random.default_rng([seed, 0x9EA])
        self.acknowledged: set[str] = set()
        self.due: list[tuple[datetime, str, str]] = []
        self.findings: list[dict[str, Any]] = []

    def call(self, at: datetime, method: str, path: str, **body: Any) -> Any:
        """Request at a time."""
        with at_time(at):
            answer = self.client.request(method, path, **body)
        assert answer.status_code < 300, (path, answer.status_code, answer.text[:300])
        return answer.json() if answer.content else None

    def set_up(self, living: LivingAxis, at: datetime) -> None:
        """Set up an axis with its documents and its schedule."""
        axis = living.axis
        schedule = {"period_s": 7 * 86400, "grace_s": 2 * 86400}
        body = {
            "machine": axis.machine, "site": axis.hall, "sheet": axis_toml(axis.sheet),
            "plan": plan_toml(axis.type.plan), "channels": CHANNELS, "schedule": schedule,
        }  # fmt: skip
        self.call(at, "PUT", f"/api/v1/axes/{axis.name}", json=body)

    def send(self, living: LivingAxis, run: Run, at: datetime) -> None:
        """Send a run, and calibrate by the first ones."""
        name, content = living.axis.name, write_json(run.to_json()).encode()
        sha256 = hashlib.sha256(content).hexdigest()
        url = f"/api/v1/axes/{name}/runs/{run.measured_at}"
        self.call(at, "PUT", f"{url}/files/{sha256}", content=content)
        self.call(at, "POST", f"{url}/complete", json={"files": [], "run_json": sha256})
        living.sent.append(run)
        if not living.has_model and len(living.sent) == 3:
            living.has_model = True
            model = model_json(calibrate(living.sent, living.axis.sheet))
            self.call(at, "PUT", f"/api/v1/axes/{name}/model", json=model)
        self.work(at)

    def work(self, at: datetime) -> None:
        """Do the jobs that wait."""
        with at_time(at):
            while (lease := lease_job(self.service)) is not None:
                task = task_of(self.service, lease)
                assert task is not None
                finish(self.service, lease, *do_task(task))

    def tick(self, at: datetime) -> None:
        """What the server and people do regularly."""
        with at_time(at):
            watch_for_silence(self.service, at)
        plan_messages(self.service, at)
        send_messages(self.service, lambda: at)
        for alarm in self.call(at, "GET", "/api/v1/alarms")["alarms"]:
            if (
                alarm["kind"] == "axis"
                and alarm["state"] == "raised"
                and alarm["id"] not in self.acknowledged
            ):
                self.acknowledged.add(alarm["id"])
                if self.random.uniform() >= _IGNORED:
                    self.due.append((at + timedelta(hours=8), alarm["id"], "acknowledge"))
                self.due.append((at + _EXCLUDED, alarm["id"], "exclude"))
                self.due.append((at + _INSPECTED, alarm["id"], "close"))
        for deed in sorted(deed for deed in self.due if deed[0] <= at):
            self.due.remove(deed)
            self.act(at, *deed[1:])

    def act(self, at: datetime, name: str, action: str) -> None:
        """Acknowledge an alarm, or inspect its axis, repair it and close the alarm."""
        found = {alarm["id"]: alarm for alarm in self.call(at, "GET", "/api/v1/alarms")["alarms"]}
        alarm = found[name]
        if alarm["state"] in ("retracted", "closed"):
            return
        living = next(each for each in self.axes if each.axis.name == alarm["axis"])
        if action == "exclude":
            self.exclude(living, at)
            return
        if action == "acknowledge":
            self.call(at, "POST", f"/api/v1/alarms/{name}", json={"action": action, "text": "seen"})
            return
        week = week_of(at)
        finding = "nothing found"
        if living.ratio(week) < 1 - _TRUE_LOSS:
            finding = "preload loss"
        body = {"action": "close", "text": finding}
        if "finding" in Action.model_fields:
            body["finding"] = finding
        self.call(at, "POST", f"/api/v1/alarms/{name}", json=body)
        raised_at, end = datetime.fromisoformat(alarm["raised_at"]), living.end()
        before = None if end is None else (end - week_of(raised_at)) * 7
        lead = (at - raised_at).total_seconds() / 86400
        axis = alarm["axis"]
        found_now = {"alarm": name, "axis": axis, "finding": finding, "lead": lead, "before_end": before}
        self.findings.append(found_now)
        if finding == "preload loss":
            self.repair(living, at, int(week))

    def exclude(self, living: LivingAxis, at: datetime) -> None:
        """Exclude the runs whose load was wrong, as somebody finds out after the alarm."""
        for run in living.sent:
            if math.ceil(week_of(datetime.fromisoformat(str(run.measured_at)))) in living.disturbed:
                path = f"/api/v1/axes/{living.axis.name}/runs/{run.id}/exclusion"
                self.call(at, "POST", path, json={"reason": "the load was another one"})
        living.disturbed = ()
        self.work(at)

    def repair(self, living: LivingAxis, at: datetime, week: int) -> None:
        """Replace the nut, or adjust the bearing, which begins a new epoch."""
        kind = "nut replaced"
        if living.axis.worn is None:
            kind, living.bearing_repaired = "bearing replaced", week
        else:
            living.axis = replace(living.axis, replaced=week)
        event = [{"at": at.isoformat(), "kind": kind, "text": "after an alarm"}]
        self.call(at, "POST", f"/api/v1/axes/{living.axis.name}/events", json=event)
        self.work(at)


def week_of(at: datetime) -> float:
    """Week of the plant in which a time is."""
    return WEEKS - 1 - (_PRESENT - at) / timedelta(weeks=1)


def make_axes(number: int, weeks: int, seed: int, folder: Path) -> list[LivingAxis]:
    """Axes of the plant: half of them healthy, every third worn, the others with a bearing's fault."""
    random, first = np.random.default_rng([seed, 0xA1]), WEEKS - weeks
    templates: dict[int, tuple[Run, TrueState, PlantAxis]] = {}
    found = []
    for index in range(number):
        kind = _TYPES[index % len(_TYPES)]
        names = (f"axis {index:02}", f"machine {index // 3}", f"hall {index // 12}")
        axis = PlantAxis(*names, kind, hour=float(4 + index * 3 % 150), first=first, recorded=())
        fate = index % 6
        begin = first + weeks * random.uniform(0.3, 0.7)
        if fate in (1, 4):
            axis = replace(axis, worn=(begin, float(random.uniform(60, 140))))
        elif fate == 5:
            axis = replace(axis, bearing=(begin, float(random.uniform(0.01, 0.03))))
        run, then = _template(axis, kind, templates, seed, folder)
        living = LivingAxis(axis, run, then, np.random.default_rng([seed, index]))
        if fate == 3:
            living.disturbed = tuple(range(int(begin), int(begin) + 3))
        found.append(living)
        print(
            f"{axis.name}: {'worn' if axis.worn else 'bearing' if axis.bearing else 'healthy'}",
            file=sys.stderr,
        )
    return found


def _template(
    axis: PlantAxis, kind: AxisType, templates: dict[int, Any], seed: int, folder: Path
) -> tuple[Run, TrueState]:
    """An analysed run of the type of an axis, and the true state at it."""
    if id(kind) not in templates:
        at = axis.measured_at(axis.first, _PRESENT).isoformat()
        rig = rig_of(axis, axis.first, seed)
        options: dict[str, Any] = {"seed": seed, "sheet": axis.sheet, "measured_at": at, "workers": 1}
        files = simulate_run(rig, kind.plan, kind.load, folder / axis.name, **options)
        run = replace(analyze(files.run), frequency_response=None)
        templates[id(kind)] = run, _true_state(axis, axis.first, seed)
    found: tuple[Run, TrueState] = templates[id(kind)]
    return found


@contextmanager
def webhook() -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """A local webhook; its URL and what it received."""
    received: list[dict[str, Any]] = []

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            body = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
            received.append(body | {"to": self.path, "header": self.headers["Idempotency-Key"]})
            self.send_response(204)
            self.end_headers()

        def log_message(self, *_: object) -> None:
            """Nothing is printed."""

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    thread = Thread(target=server.serve_forever)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_address[1]}", received
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


def live(year: Year, weeks: int) -> Counter[str]:
    """Let the year pass, half a day at a time; what became of the runs."""
    first, counts = WEEKS - weeks, Counter[str]()
    begin = min(each.axis.measured_at(first, _PRESENT) for each in year.axes) - timedelta(hours=6)
    for living in year.axes:
        year.set_up(living, begin)
    waiting: list[tuple[datetime, int, int]] = []
    for number, living in enumerate(year.axes):
        for week in range(first, WEEKS):
            at = living.axis.measured_at(week, _PRESENT) + _RECEIVED
            chance = living.random.uniform()
            if chance < _MISSED and week > first + 3:
                counts["never sent"] += 1
                continue
            if chance < _MISSED + _LATE and week > first + 3:
                counts["late"] += 1
                at += timedelta(days=10)
            waiting.append((at, number, week))
    waiting.sort()
    at = begin
    while at < _PRESENT + timedelta(days=30):
        at += timedelta(hours=12)
        while waiting and waiting[0][0] <= at:
            received, number, week = waiting.pop(0)
            living = year.axes[number]
            year.send(living, living.measure(week, year.seed), received)
            counts["runs"] += 1
        year.tick(at)
        if not waiting and at > _PRESENT:
            break
        if at.hour == 0 and at.weekday() == 0:
            print(f"{at:%Y-%m-%d}: {counts['runs']} runs", file=sys.stderr)
    return counts


def report(year: Year, counts: Counter[str], received: list[dict[str, Any]]) -> list[str]:
    """Print what happened; a sentence for each difference between the server and the recount."""
    alarms = year.call(_PRESENT, "GET", "/api/v1/alarms")["alarms"]
    of_axes = [alarm for alarm in alarms if alarm["kind"] == "axis"]
    retracted = [alarm for alarm in of_axes if alarm["state"] == "retracted"]
    print(f"runs: {counts['runs']}, late {counts['late']}, never sent {counts['never sent']}")
    states = Counter(alarm["state"] for alarm in of_axes)
    print(f"alarms: {len(of_axes)}, of them retracted {len(retracted)}; {dict(states)}")
    print(f"troubles: {Counter(alarm['kind'] for alarm in alarms if alarm['kind'] != 'axis')}")
    print(f"messages: {Counter((each['to'], each['kind']) for each in received)}")
    confirmed = [each for each in year.findings if each["finding"] == "preload loss"]
    leads = [each["lead"] for each in confirmed]
    ahead = [each["before_end"] for each in confirmed if each["before_end"] is not None]
    true = [living for living in year.axes if living.axis.worn or living.axis.bearing]
    found = {alarm["axis"] for alarm in of_axes}
    print(f"closed: {len(year.findings)}, confirmed by the truth {len(confirmed)}")
    if leads:
        print(f"from alarm to repair: median {median(leads):.1f} d")
    if ahead:
        print(f"before half of the preload was lost: median {median(ahead):.0f} d, least {min(ahead):.0f} d")
    print(f"axes with a fault: {len(true)}, with an alarm {sum(each.axis.name in found for each in true)}")
    wrong = []
    if len({each["key"] for each in received}) != len(received):
        wrong.append("a message was sent twice.")
    wrong += _unbalanced(received)
    answer = year.client.get("/api/v1/findings")
    if answer.status_code == 200:
        summary = answer.json()["all"]
        recount = (len(year.findings), len(confirmed))
        if (summary["inspected"], summary["confirmed"]) != recount:
            wrong.append(f"the server counts {summary}, the recount is {recount}.")
        if leads and abs(summary["lead_days"][0] - median(leads)) > 0.1:
            wrong.append(f"the server's lead time is {summary['lead_days']}, the recount {median(leads)} d.")
        print(f"precision of the server: {summary['precision']}, lead time {summary['lead_days']}")
    wrong += _differences_of_page(year)
    return wrong


def _differences_of_page(year: Year) -> list[str]:
    """Rows of the page of findings that differ from the recount: numbers and median lead time by axis."""
    page = year.client.get("/findings").text
    number = r'<td class="number">(\d+)</td>' * 6
    lead = r'<td class="number" data-value="[^"]*">.*?</td><td class="number" data-value="([^"]*)">'
    shown = {}
    for row in re.findall(rf'<th scope="row"><a href="/axes/[^"]*">([^<]+)</a></th>{number}{lead}', page):
        name, _, _, inspected, confirmed, another, nothing, days = row
        shown[name] = ([int(each) for each in (inspected, confirmed, another, nothing)], days)
    wrong = []
    for name in {each["axis"] for each in year.findings} | set(shown):
        mine = [each for each in year.findings if each["axis"] == name]
        sure = [each["lead"] for each in mine if each["finding"] == "preload loss"]
        count = [len(mine), len(sure), 0, len(mine) - len(sure)]
        numbers, days = shown.get(name, ([0, 0, 0, 0], ""))
        is_same_lead = abs(float(days) - median(sure)) < 0.1 if days and sure else not days and not sure
        if numbers != count or not is_same_lead:
            wrong.append(f"the page has {numbers} and {days!r} d for {name}, the recount {count} and {sure}.")
    print(f"rows of the page of findings compared with the recount: {len(shown)}")
    return wrong


def _unbalanced(received: list[dict[str, Any]]) -> list[str]:
    """Axes of which a second alarm was reported without a retraction or a repair in between."""
    wrong: list[str] = []
    standing: set[tuple[str, str]] = set()
    for each in received:
        if each["to"] != "/maintenance" or each["kind"] not in ("raised", "urgent", "retracted"):
            continue
        name = each["items"][0]["alarm"]
        if each["kind"] == "retracted" and each["items"][0]["axis"] not in {axis for axis, _ in standing}:
            wrong.append(f"{name} was retracted, and never reported.")
        if each["kind"] == "raised" and (each["items"][0]["axis"], name) in standing:
            wrong.append(f"{name} was reported twice.")
        standing.add((each["items"][0]["axis"], name))
    return wrong


def main() -> None:
    """Simulate, and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--axes", type=int, default=40)
    parser.add_argument("--weeks", type=int, default=52)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    os.environ[_SECRET] = "between us"
    with tempfile.TemporaryDirectory() as folder, webhook() as (url, received):
        hook = {"secret_env": _SECRET, "allow_private": True, "allow_http": True}
        hooks = [
            {"name": "maintenance", "url": f"{url}/maintenance", "level": "trouble", **hook},
            {"name": "chief", "url": f"{url}/chief", "escalation": True, **hook},
        ]
        given: dict[str, Any] = {"public_url": "http://plant", "webhook": hooks, "min_free_bytes": 0}
        store = ServedStore(create_store(Path(folder) / "store").path)
        service = Service(store, ServerSettings(**given))
        assert service.settings.problems() == []
        service.partial.mkdir()
        axes = make_axes(options.axes, options.weeks, options.seed, Path(folder))
        with TestClient(create_app(service), base_url="http://localhost") as client:
            year = Year(service, client, axes, options.seed)
            counts = live(year, options.weeks)
            wrong = report(year, counts, received)
    for sentence in wrong:
        print(f"wrong: {sentence}")
    sys.exit(bool(wrong))


if __name__ == "__main__":
    main()
