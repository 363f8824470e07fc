"""Messages that arrive: by real servers of e-mail and webhooks that refuse, dawdle, or outlive the sender."""

from __future__ import annotations

import json
import os
import signal
import socket
import ssl
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import select
from tests.service.conftest import SETUP, NewService, client_of, send_result, wait_for, work_off
from tests.service.sinks import (
    PASSWORD,
    USER,
    HookSink,
    MailSink,
    free_port,
    hook_sink,
    mail_sink,
    make_certificate,
)
from tests.simulated_bench import AXIS
from tests.store.stored import MODEL, RUNS

from ballscrew.calibration.modelfile import model_json
from ballscrew.service import delivering
from ballscrew.service.delivering import plan_messages, send_messages
from ballscrew.service.mail import send_mail
from ballscrew.service.planning import unclosed_alarms
from ballscrew.service.serving import ServedStore, Service
from ballscrew.service.settings import ServerSettings
from ballscrew.service.webhooks import DeliveryError
from ballscrew.store.opened import OpenStore
from ballscrew.store.service_tables import AlarmAction, Delivery, Message, Trouble
from ballscrew.store.tables import AlarmRow, Axis

AT = datetime(2026, 3, 2, 10, tzinfo=UTC)
TO = "anna@plant.example"
PATIENCE = 300.0  # s; the machine of a test may be slow
Certificate = tuple[Path, ssl.SSLContext]


@pytest.fixture(scope="module")
def tls(tmp_path_factory: pytest.TempPathFactory) -> Certificate:
    return make_certificate(tmp_path_factory.mktemp("certificate"))


@pytest.fixture
def mails(tls: Certificate, monkeypatch: pytest.MonkeyPatch) -> Iterator[MailSink]:
    monkeypatch.setenv("SMTP_PASSWORD", PASSWORD)
    with mail_sink(tls[1]) as sink:
        yield sink


@pytest.fixture
def hooks(tls: Certificate, monkeypatch: pytest.MonkeyPatch) -> Iterator[HookSink]:
    monkeypatch.setenv("HOOK_SECRET", "between us")
    with hook_sink(tls[1]) as sink:
        yield sink


def smtp(trusted: Certificate, port: int, **changes: Any) -> dict[str, Any]:
    return {
        "host": "localhost", "port": port, "sender": "ballscrew@plant.example", "user": USER,
        "password_env": "SMTP_PASSWORD", "ca_file": trusted[0], **changes,
    }  # fmt: skip


def hook(tls: Certificate, url: str) -> dict[str, Any]:
    return {
        "name": "cmms", "url": url, "secret_env": "HOOK_SECRET", "allow_private": True, "ca_file": tls[0],
    }  # fmt: skip


def mail_settings(trusted: Certificate, port: int, **changes: Any) -> ServerSettings:
    """Settings with one address."""
    given: dict[str, Any] = {"smtp": smtp(trusted, port, **changes), "email": [{"to": TO}]}
    return ServerSettings(public_url="http://plant", messages={"timeout_s": PATIENCE}, **given)


Made = Callable[..., Service]


@pytest.fixture
def make(new_service: NewService, tls: Certificate) -> Made:
    """A service whose axis has an alarm, with recipients."""

    def make_service(
        mails: MailSink | None = None, hooks: HookSink | None = None, **settings: Any
    ) -> Service:
        rules = {"timeout_s": PATIENCE} | settings.pop("messages", {})
        given: dict[str, Any] = {"public_url": "https://ballscrew.plant.example/", "messages": rules}
        if mails is not None:
            given |= {"smtp": smtp(tls, mails.port), "email": [{"to": TO, "level": "trouble"}]}
        if hooks is not None:
            given["webhook"] = [hook(tls, hooks.url)]
        service = new_service(**(given | settings))
        assert service.settings.problems() == []
        with client_of(service) as client:
            assert client.put("/api/v1/axes/bench", json=SETUP).status_code == 200
        raise_alarm(service)
        return service

    return make_service


def raise_alarm(service: Service, number: int = 1, axis: str = "bench", at: datetime = AT) -> None:
    text = at.isoformat()
    with service.store.write("test") as session:
        axis_id = session.scalars(select(Axis.id).where(Axis.name == axis)).one()
        session.add(AlarmRow(id=number, axis_id=axis_id, epoch=number, began_at=text, raised_at=text))
    add_message(service, f"alarm-{number}", "raised", axis, at)


def add_message(
    service: Service,
    subject: str,
    kind: str,
    axis: str = "bench",
    at: datetime = AT,
    detail: dict[str, Any] | None = None,
) -> None:
    with service.store.write("test") as session:
        axis_id = session.scalars(select(Axis.id).where(Axis.name == axis)).one()
        rows = session.scalars(select(Message.id).where(Message.key.startswith(f"{subject}/"))).all()
        document = {"subject": subject, "axis": axis} | (detail or {"began_at": at.isoformat()})
        key = f"{subject}/{len(rows) + 1}"
        session.add(Message(key=key, axis_id=axis_id, kind=kind, detail=document, at=at.isoformat()))


def deliver(service: Service, at: datetime = AT) -> int:
    plan_messages(service, at)
    return send_messages(service, lambda: at)


def rows(service: Service) -> list[tuple[str, str, int]]:
    """Recipient, status and attempts of each delivery."""
    with service.store.read() as session:
        found = session.scalars(select(Delivery).order_by(Delivery.id))
        return [(row.recipient, row.status, row.attempts) for row in found]


def test_an_alarm_reaches_everybody_once_over_tls(make: Made, mails: MailSink, hooks: HookSink) -> None:
    service = make(mails, hooks)
    assert deliver(service) == 2
    assert deliver(service, AT + timedelta(hours=1)) == 0
    assert rows(service) == [(TO, "sent", 1), ("cmms", "sent", 1)]
    (mail,) = mails.mails
    assert (mail["To"], mail["From"], mail["Subject"]) == (TO, "ballscrew@plant.example", "Alarm of bench")
    assert mails.signed_in == [USER]
    ((headers, body),) = hooks.requests
    document = json.loads(body)
    assert (document["kind"], document["key"]) == ("raised", headers["Idempotency-Key"])
    assert document["items"][0]["axis"] == "bench"
    assert mail["Message-ID"] != headers["Idempotency-Key"]
    link = "https://ballscrew.plant.example/axes/bench"
    assert document["items"][0]["link"] == link
    text = mail.get_content()
    assert link in text
    assert "Machine: mill 4, hall 2" in text


def test_a_message_says_axis_state_number_with_interval_what_to_do_and_link(
    new_service: NewService, mails: MailSink, tls: Certificate
) -> None:
    """The number is that of the page, in the language of the recipient."""
    recipients = [{"to": f"{language}@plant.example", "language": language} for language in ("en", "de")]
    service = new_service(
        public_url="http://plant",
        smtp=smtp(tls, mails.port),
        email=recipients,
        messages={"timeout_s": PATIENCE},
    )
    with client_of(service) as client:
        client.put("/api/v1/axes/bench", json=SETUP)
        for number in range(len(RUNS)):
            send_result(client, number)
        client.put("/api/v1/axes/bench/model", json=model_json(MODEL))
        work_off(service, lambda _: pytest.fail("no analysis"))
        deliver(service, datetime.now(UTC))
        actions = [each["text"] for each in client.get("/api/v1/axes/bench").json()["to_do"]]
        for mail, state in zip(mails.mails, ("State: alarm", "Zustand: Alarm"), strict=True):
            text = mail.get_content()
            page = client.get("/axes/bench", headers={"Accept-Language": mail["To"][:2]}).text
            values = [line.partition(": ")[2].strip() for line in text.splitlines() if "%" in line]
            assert len(values) == 2
            for value in values:
                assert f"<dd>{value}</dd>" in page
            assert state in text
            assert "http://plant/axes/bench" in text
            assert text.count("\n- ") == len(actions)
    assert all(action in mails.mails[0].get_content() for action in actions)


@pytest.mark.parametrize("kind", ["email", "webhook"])
def test_a_server_that_is_killed_between_sending_and_marking_sends_again_with_the_same_key(
    make: Made, mails: MailSink, hooks: HookSink, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    service = make(*((mails, None) if kind == "email" else (None, hooks)))

    def die(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(delivering, "_finish", die)
        with pytest.raises(KeyboardInterrupt):
            deliver(service)
    after = Service(ServedStore(service.store.path), service.settings)
    assert deliver(after, AT + timedelta(seconds=59)) == 0
    assert deliver(after, AT + timedelta(seconds=60)) == 1
    assert deliver(after, AT + timedelta(hours=9)) == 0
    assert [each[1:] for each in rows(after)] == [("sent", 2)]
    keys = [mail["Message-ID"] for mail in mails.mails]
    keys += [headers["Idempotency-Key"] for headers, _ in hooks.requests]
    assert len(keys) == 2
    assert len(set(keys)) == 1


@pytest.mark.slow
def test_a_process_that_is_killed_while_the_recipient_accepts_sends_again_after_its_restart(
    make: Made, mails: MailSink, tls: Certificate, tmp_path: Path
) -> None:
    """kill -9 before the answer of the recipient; then a restart."""
    folder = make(mails).store.path
    config = tmp_path / "server.toml"
    config.write_text(
        f'''public_url = "http://plant"
email = [{{to = "{TO}"}}]
messages = {{back_off_s = 0, timeout_s = {PATIENCE}}}
[smtp]
host = "localhost"
port = {mails.port}
sender = "b@plant.example"
user = "{USER}"
password_env = "SMTP_PASSWORD"
ca_file = '{tls[0]}'
'''
    )
    command = [sys.executable, "-m", "ballscrew", "serve", "--data", str(folder), "--config", str(config)]

    def kill(_: object) -> None:
        holder = json.loads((folder / "store.lock").read_text())
        os.kill(holder["process"], getattr(signal, "SIGKILL", signal.SIGTERM))

    mails.before = kill
    subprocess.run([*command, "--port", "0", "--workers", "1"], check=False)  # noqa: S603  it is killed
    received = threading.Event()
    mails.before = lambda _: received.set()
    process = subprocess.Popen([*command, "--port", "0", "--workers", "1"])  # noqa: S603
    try:
        assert received.wait(300)
        store = OpenStore(folder)
        for _ in range(3000):
            with store.read() as session:
                (row,) = session.scalars(select(Delivery)).all()
            if row.status == "sent":
                break
            time.sleep(0.1)
        assert (row.status, row.attempts) == ("sent", 2)
    finally:
        process.terminate()
        process.wait()
    assert len(mails.mails) == 2
    assert mails.mails[0]["Message-ID"] == mails.mails[1]["Message-ID"]


def test_a_server_that_is_killed_before_sending_sends_once(
    make: Made, mails: MailSink, monkeypatch: pytest.MonkeyPatch
) -> None:
    service = make(mails)

    def die(*_: object) -> None:
        raise KeyboardInterrupt

    for step in ("_reserve", "_send"):
        with monkeypatch.context() as patched:
            patched.setattr(delivering, step, die)
            with pytest.raises(KeyboardInterrupt):
                deliver(service)
    deliver(service, AT + timedelta(hours=1))
    assert len(mails.mails) == 1


def test_a_server_that_is_always_killed_while_it_sends_gives_up_after_the_promised_attempts(
    make: Made, mails: MailSink, monkeypatch: pytest.MonkeyPatch
) -> None:
    service = make(mails, messages={"attempts": 3})
    monkeypatch.setattr(delivering, "_finish", lambda *_: None)
    for hour in range(10):
        deliver(service, AT + timedelta(hours=hour))
    assert len(mails.mails) == 3
    assert rows(service) == [(TO, "failed", 3)]


def test_a_recipient_that_refuses_is_tried_again_given_up_and_stands_in_no_ones_way(
    make: Made, mails: MailSink, hooks: HookSink
) -> None:
    service = make(mails, hooks, messages={"attempts": 3, "back_off_s": 100.0})
    mails.refused = {TO}
    assert deliver(service) == 2
    assert (len(mails.mails), len(hooks.requests)) == (0, 1)
    times = [at for at in range(0, 1000, 10) if deliver(service, AT + timedelta(seconds=at))]
    assert times == [100, 300]
    assert rows(service) == [(TO, "failed", 3), ("cmms", "sent", 1)]
    with client_of(service) as client:
        log = client.get("/api/v1/messages").json()["messages"]
        (failed,) = [each for each in log if each["status"] == "failed"]
        assert "550" in failed["error"]
        assert "\x1b" not in failed["error"]
        assert f"1 message to {TO} was given up." in client.get("/status").text
        metrics = client.get("/metrics").text
        assert 'ballscrew_messages{status="failed"} 1\n' in metrics
        assert "ballscrew_message_attempts_total 4\n" in metrics
        mails.refused = set()
        raise_alarm(service, 2, at=AT + timedelta(hours=2))
        deliver(service, AT + timedelta(hours=2))
        assert "was given up" not in client.get("/status").text
    assert len(mails.mails) == 1


def test_what_waits_for_a_recipient_that_refuses_is_sent_when_it_accepts_again_in_order(
    make: Made, mails: MailSink
) -> None:
    service = make(mails, messages={"back_off_s": 10.0, "hold_h": 0.0})
    mails.refused = {TO}
    deliver(service)
    with service.store.write("test") as session:
        session.get_one(AlarmRow, 1).retracted_at = AT.isoformat()
    add_message(service, "alarm-1", "retracted", at=AT + timedelta(seconds=1))
    deliver(service, AT + timedelta(seconds=2))
    mails.refused = set()
    for second in range(3, 60):
        deliver(service, AT + timedelta(seconds=second))
    assert [mail["Subject"] for mail in mails.mails] == ["Alarm of bench", "Retracted: alarm of bench"]


def test_the_pause_begins_with_the_attempt_and_not_with_the_round(
    make: Made, mails: MailSink, hooks: HookSink
) -> None:
    """Recipients before may have taken long."""
    hooks.statuses = [500]
    service = make(mails, hooks, messages={"back_off_s": 60.0})
    plan_messages(service, AT)
    times = (AT + timedelta(seconds=each) for each in (0, 10, 300, 301, 302))
    assert send_messages(service, lambda: next(times)) == 2
    with service.store.read() as session:
        (waiting,) = session.scalars(select(Delivery).where(Delivery.status == "queued"))
        (sent,) = session.scalars(select(Delivery).where(Delivery.status == "sent"))
    assert (sent.recipient, sent.sent_at) == (
        TO,
        (AT + timedelta(seconds=10)).isoformat(timespec="milliseconds"),
    )
    assert (waiting.recipient, waiting.not_before) == ("cmms", AT.timestamp() + 300 + 60)


@pytest.mark.parametrize("jump", [timedelta(days=-366), timedelta(days=-1), timedelta(days=1)])
def test_a_clock_that_jumps_delays_no_message(make: Made, hooks: HookSink, jump: timedelta) -> None:
    hooks.statuses = [500]
    service = make(hooks=hooks)
    deliver(service)
    assert rows(service) == [("cmms", "queued", 1)]
    send_messages(service, lambda: AT + jump)
    assert rows(service) == [("cmms", "sent", 2)]


def test_a_slow_recipient_has_a_time_limit_and_stands_in_no_ones_way(
    make: Made, mails: MailSink, hooks: HookSink, monkeypatch: pytest.MonkeyPatch
) -> None:
    hooks.statuses = [0]
    service = make(mails, hooks)
    post = delivering.post_webhook
    with monkeypatch.context() as patched:
        patched.setattr(delivering, "post_webhook", lambda *given: post(*given[:-1], 1.0))
        deliver(service)
    assert rows(service) == [(TO, "sent", 1), ("cmms", "queued", 1)]
    hooks.statuses = []
    deliver(service, AT + timedelta(minutes=1))
    assert rows(service) == [(TO, "sent", 1), ("cmms", "sent", 2)]
    assert len({headers["Idempotency-Key"] for headers, _ in hooks.requests}) == 1


def test_mail_is_not_sent_without_tls_or_to_another_server(
    make: Made, mails: MailSink, tls: Certificate, monkeypatch: pytest.MonkeyPatch
) -> None:
    service = make(mails)
    for number, changes in enumerate(({"ca_file": None}, {"tls": "tls"}, {"tls": "none", "user": None})):
        wrong = Service(service.store, mail_settings(tls, mails.port, **changes))
        deliver(wrong, AT + timedelta(days=number))
    assert mails.mails == []
    monkeypatch.setenv("SMTP_PASSWORD", "wrong")
    deliver(service, AT + timedelta(days=9))
    with service.store.read() as session:
        error = session.scalars(select(Delivery.error)).one()
    assert error is not None
    assert "535" in error
    assert "wrong" not in error
    monkeypatch.setenv("SMTP_PASSWORD", PASSWORD)
    deliver(service, AT + timedelta(days=10))
    assert len(mails.mails) == 1


def test_mail_is_sent_with_tls_from_the_beginning(
    make: Made, tls: Certificate, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SMTP_PASSWORD", PASSWORD)
    with mail_sink(tls[1], "tls") as sink:
        service = make(sink, smtp=smtp(tls, sink.port, tls="tls"))
        deliver(service)
    assert len(sink.mails) == 1


def test_a_server_that_is_not_there_is_tried_again(
    make: Made, tls: Certificate, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SMTP_PASSWORD", PASSWORD)
    service = make(smtp=smtp(tls, free_port()), email=[{"to": TO}])
    deliver(service)
    assert rows(service) == [(TO, "queued", 1)]


HOSTILE = "x\r\nBcc: evil@example.org\r\n\r\n<script>\x1b[2J\u2028"


def test_no_name_ends_a_header_or_a_line(make: Made, mails: MailSink, hooks: HookSink) -> None:
    """Such a name cannot be set up today; the store may have one."""
    service = make(mails, hooks)
    with service.store.write("test") as session:
        session.scalars(select(Axis)).one().name = HOSTILE
    deliver(service)
    (mail,) = mails.mails
    assert mail["Bcc"] is None
    assert mail["Subject"].startswith(r"Alarm of x\r\nBcc: evil@example.org")
    assert "\nBcc" not in mail.get_content()
    document = json.loads(hooks.requests[0][1])
    assert "\n" not in document["subject"]
    assert "\r" not in document["text"]


def test_troubles_are_one_message_a_day(make: Made, mails: MailSink) -> None:
    service = make(mails)
    with client_of(service) as local:
        local.put("/api/v1/axes/Y axis", json=SETUP | {"sheet": AXIS.replace('"bench"', '"Y axis"')})
    text, at = "no run since x: overdue.", AT.isoformat()
    with service.store.write("test") as session:
        for number, axis in enumerate(session.scalars(select(Axis)).all(), start=1):
            trouble = {"kind": "silence", "began_at": at, "raised_at": at, "text": text}
            session.add(Trouble(id=number, axis_id=axis.id, **trouble))
    for number, name in enumerate(("bench", "Y axis"), start=1):
        add_message(service, f"trouble-{number}", "raised", name, detail={"kind": "silence", "text": text})
    for hour in range(0, 40, 2):
        deliver(service, AT + timedelta(hours=hour))
    subjects = [mail["Subject"] for mail in mails.mails]
    assert subjects == ["Alarm of bench", "2 messages about measurements"]
    content = mails.mails[1].get_content().replace("\r", "")
    assert "/axes/bench\n" in content
    assert "/axes/Y%20axis\n" in content
    assert content.count("- Run the test, or find out why no run arrives: it is overdue.") == 2


def test_a_recipient_that_was_removed_is_dropped(make: Made, mails: MailSink) -> None:
    service = make(mails)
    plan_messages(service, AT)
    others = ServerSettings(
        public_url="http://plant", smtp=service.settings.smtp, email=[{"to": "b@plant.example"}]
    )
    send_messages(Service(service.store, others), lambda: AT)
    assert rows(service) == [(TO, "dropped", 0)]
    assert mails.mails == []


def test_a_message_that_cannot_be_composed_stands_in_no_ones_way(
    make: Made, mails: MailSink, hooks: HookSink, monkeypatch: pytest.MonkeyPatch
) -> None:
    service = make(mails, hooks)
    compose = delivering.compose

    def fail(*given: Any) -> Any:
        if given[-2] == "en" and not failed:
            failed.append(True)
            raise ZeroDivisionError
        return compose(*given)

    failed: list[bool] = []
    monkeypatch.setattr(delivering, "compose", fail)
    deliver(service)
    assert rows(service) == [(TO, "queued", 1), ("cmms", "sent", 1)]
    deliver(service, AT + timedelta(minutes=2))
    assert rows(service)[0] == (TO, "sent", 2)


def test_without_recipients_nothing_is_planned_and_the_first_one_learns_what_stands(
    make: Made, mails: MailSink, tls: Certificate
) -> None:
    service = make()
    deliver(service)
    assert rows(service) == []
    deliver(Service(service.store, mail_settings(tls, mails.port)), AT + timedelta(days=3))
    assert rows(service) == [(TO, "sent", 1)]


def test_alarms_that_are_closed_or_retracted_are_planned_no_more(make: Made, hooks: HookSink) -> None:
    service = make(hooks=hooks)
    deliver(service)
    later = AT + timedelta(days=1)
    assert read_subjects(service) == {"alarm-1"}
    with service.store.write("test") as session:
        session.add(AlarmAction(alarm_id=1, action="closed", at=later.isoformat(), actor="anna", text="worn"))
    assert read_subjects(service) == set()
    raise_alarm(service, 2, at=later)
    assert read_subjects(service) == {"alarm-2"}
    with service.store.write("test") as session:
        session.get_one(AlarmRow, 2).retracted_at = later.isoformat()
    assert read_subjects(service) == set()


def read_subjects(service: Service) -> set[str]:
    with service.store.read() as session:
        return {name for _, name in unclosed_alarms(session)}


def test_messages_are_planned_and_sent_until_the_service_stops_and_after_an_error(
    new_service: NewService, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """A change wakes the thread at once."""
    service = new_service()
    done: list[str] = []

    def plan(_: Service, at: datetime) -> None:
        assert (datetime.now(UTC) - at).total_seconds() < PATIENCE
        done.append("plan")
        if len(done) == 1:
            raise OSError("no disk")

    def send(_: Service, clock: Callable[[], datetime]) -> None:
        assert clock().tzinfo is UTC
        done.append("send")

    monkeypatch.setattr(delivering, "plan_messages", plan)
    monkeypatch.setattr(delivering, "send_messages", send)
    monkeypatch.setattr(delivering, "_PERIOD", 2 * PATIENCE)
    thread = threading.Thread(target=delivering.run_messages, args=(service,), daemon=True)
    thread.start()
    for number in (1, 3, 5):
        wait_for(lambda: len(done) >= number)  # noqa: B023  waited for here
        if number == 5:
            service.stopping.set()
        service.announce()
    thread.join(PATIENCE)
    assert not thread.is_alive()
    assert done == ["plan", "plan", "send", "plan", "send"]
    assert [record.getMessage() for record in caplog.records] == ["messages"]


@pytest.mark.parametrize(
    ("answers", "sentence"),
    [
        (["250 sink"], "it does not offer STARTTLS"),
        (["250-sink\r\n250 STARTTLS", "454 TLS not available"], "it answered 454 TLS not available"),
    ],
)
def test_a_server_of_e_mail_without_tls_receives_neither_password_nor_message(
    tls: Certificate, monkeypatch: pytest.MonkeyPatch, answers: list[str], sentence: str
) -> None:
    monkeypatch.setenv("SMTP_PASSWORD", PASSWORD)
    heard: list[str] = []
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def answer() -> None:
            connection, _ = listener.accept()
            with connection, connection.makefile("rwb", buffering=0) as stream:
                stream.write(b"220 sink\r\n")
                for text in answers:
                    heard.append(stream.readline().decode())
                    stream.write(f"{text}\r\n".encode())
                for line in stream:
                    heard.append(line.decode())
                    stream.write(b"221 bye\r\n")

        thread = threading.Thread(target=answer)
        thread.start()
        settings = mail_settings(tls, listener.getsockname()[1])
        assert settings.smtp is not None
        with pytest.raises(DeliveryError, match=sentence):
            send_mail(settings.smtp, TO, "an alarm", "text", "key-1", AT, PATIENCE)
        thread.join(PATIENCE)
    assert [line.split()[0] for line in heard][: len(answers)] == ["ehlo", "STARTTLS"][: len(answers)]
    assert not any(line.startswith(("AUTH", "MAIL")) for line in heard)
