"""Recipients in server.toml: what is wrong is a sentence, and no secret is shown anywhere."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
from pydantic import BaseModel
from tests.docs.pages import page
from tests.service.conftest import NewService, client_of

from ballscrew.base.errors import InputError
from ballscrew.cli.shell import run
from ballscrew.service.recipients import (
    EmailRecipient,
    MessageRules,
    Recipient,
    SmtpServer,
    WebhookRecipient,
)
from ballscrew.service.settings import ServerSettings, read_settings

GOOD = """public_url = "https://ballscrew.plant.example"
time_zone = "Europe/Berlin"

[smtp]
host = "mail.plant.example"
sender = "ballscrew@plant.example"
user = "ballscrew"
password_env = "SMTP_PASSWORD"

[messages]
quiet_from = 22:00:00
quiet_until = "06:00"

[[email]]
to = "anna@plant.example"
level = "trouble"
machines = ["mill 4"]
language = "de"

[[email]]
to = "chief@plant.example"
escalation = true

[[webhook]]
name = "cmms"
url = "https://cmms.example/hook/T0KEN-IN-URL?x=1"
secret_file = "hook.secret"
"""
PASSWORD, SECRET, IN_URL = "correct horse", "between us", "T0KEN-IN-URL"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SMTP_PASSWORD", PASSWORD)
    (tmp_path / "hook.secret").write_text(f"{SECRET}\n")
    return tmp_path


def problems(folder: Path, text: str) -> list[str]:
    (folder / "server.toml").write_text(text)
    return read_settings(folder, None, {}).problems()


def test_a_password_that_cannot_be_sent_is_refused_without_it(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SMTP_PASSWORD", "schlüssel")
    (problem,) = problems(folder, GOOD)
    assert "characters other than ASCII" in problem
    assert "ü" not in problem


def test_recipients_are_read_from_the_file(folder: Path) -> None:
    assert problems(folder, GOOD) == []
    settings = read_settings(folder, None, {})
    assert [each.label for each in settings.recipients] == [
        "anna@plant.example",
        "chief@plant.example",
        "cmms",
    ]
    assert settings.smtp is not None
    assert (settings.smtp.port, settings.smtp.tls, settings.smtp.password()) == (587, "starttls", PASSWORD)
    assert settings.webhook[0].secret() == SECRET
    assert settings.messages.quiet_from is not None


@pytest.mark.parametrize(
    ("old", "new", "place"),
    [
        ('host = "mail.plant.example"', "", "smtp.host"),
        ('user = "ballscrew"', 'password = "hunter2"', "smtp.password: is not a known setting"),
        ('"ballscrew@plant.example"', '"ballscrew"', "smtp.sender: is no e-mail address"),
        ('"anna@plant.example"', '"anna@plant.example\\nBcc: x@y.example"', "email.0.to: is no e-mail"),
        ('"anna@plant.example"', '"anna@"', "email.0.to"),
        ('"anna@plant.example"', '"a b@plant.example"', "email.0.to"),
        ('level = "trouble"', 'level = "all"', "email.0.level"),
        ('language = "de"', 'language = "fr"', "email.0.language"),
        ('name = "cmms"', 'name = "c m"', "webhook.0.name"),
        ("https://cmms.example", "ftp://cmms.example", "webhook.0.url: is no URL"),
        ("https://cmms.example", "https://user:hunter2@cmms.example", "webhook.0.url: must contain neither"),
        ("https://cmms.example", "https://cmms.example:x", "webhook.0.url: is no URL"),
        ("https://cmms.example", "https://", "webhook.0.url: is no URL"),
        ("/hook/", "/ho\\r\\nok/", "webhook.0.url: is no URL"),
        ("secret_file", 'secret = "hunter2"\nsecret_file', "webhook.0.secret: is not a known setting"),
        ("quiet_from = 22:00:00", 'quiet_from = "late"', "messages.quiet_from"),
        ("quiet_from = 22:00:00", 'quiet_from = "22:00Z"', "messages.quiet_from: it must have no zone"),
        ("[messages]", "[messages]\nattempts = 0", "messages.attempts"),
    ],
)
def test_what_is_wrong_in_a_table_is_a_sentence_without_its_value(
    folder: Path, old: str, new: str, place: str
) -> None:
    assert old in GOOD
    with pytest.raises(InputError, match=re.escape(place)) as caught:
        problems(folder, GOOD.replace(old, new, 1))
    assert "server.toml" in str(caught.value)
    for secret in ("hunter2", IN_URL):
        assert secret not in str(caught.value)


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ('public_url = "https://ballscrew.plant.example"', "", "public_url: give the address"),
        ("https://ballscrew.plant.example", "ballscrew.plant.example", "is no URL such as"),
        ("https://ballscrew.plant.example", "javascript:alert(1)", "is no URL such as"),
        ('quiet_until = "06:00"', "", "both quiet_from and quiet_until"),
        ("chief@", "anna@", "anna@plant.example: is a recipient twice"),
        ('user = "ballscrew"', 'user = "ballscrew"\ntls = "none"', "a password is not sent without TLS"),
        ('user = "ballscrew"', 'user = "kugelrollspindel-ä"', "characters other than ASCII"),
        ("SMTP_PASSWORD", "NO_SUCH", "smtp.password: the environment variable 'NO_SUCH' has no text"),
        ('password_env = "SMTP_PASSWORD"', "", "smtp.password: give the name"),
        ('password_env = "SMTP_PASSWORD"', 'ca_file = "no.pem"\npassword_env = "SMTP_PASSWORD"', "no.pem"),
        ("hook.secret", "none.secret", "the secret of the webhook cmms: none.secret cannot be read"),
        ('secret_file = "hook.secret"', "", "the secret of the webhook cmms: give the name"),
        ("https://cmms", "http://cmms", "webhook cmms: its URL begins with http"),
        ("[messages]", '[messages]\nwebhook_hosts = ["a.example"]', "cmms.example is not among"),
    ],
)
def test_what_is_wrong_together_is_a_sentence(folder: Path, old: str, new: str, sentence: str) -> None:
    assert old in GOOD
    (problem,) = problems(folder, GOOD.replace(old, new, 1))
    assert sentence in problem
    assert run(["serve", "--check", "--data", str(folder)]) == 2


def test_e_mail_without_a_server_is_a_sentence(folder: Path) -> None:
    (problem,) = problems(folder, 'public_url = "http://x"\n[[email]]\nto = "a@b.example"\n')
    assert "a@b.example: a table [smtp]" in problem


@pytest.mark.parametrize("content", [b"", b"\n", b"two\nlines", b"\xff\xfe\x00", b"x" * 5000])
def test_a_file_that_contains_no_secret_is_a_sentence(folder: Path, content: bytes) -> None:
    (folder / "hook.secret").write_bytes(content)
    (problem,) = problems(folder, GOOD)
    assert "the secret of the webhook cmms: hook.secret" in problem


def test_no_secret_is_printed_or_on_a_page(
    folder: Path, capsys: pytest.CaptureFixture[str], new_service: NewService
) -> None:
    assert problems(folder, GOOD) == []
    assert run(["serve", "--check", "--data", str(folder)]) == 0
    table = capsys.readouterr()
    assert run(["serve", "--check", "--data", str(folder), "--json"]) == 0
    printed = capsys.readouterr()
    settings = read_settings(folder, None, {})
    service = new_service()
    service.settings = settings
    with client_of(service) as client:
        answers = [
            client.get(path).text for path in ("/settings", "/messages", "/api/v1/messages", "/metrics")
        ]
    shown = "".join([*table, *printed, *answers, repr(settings), str(settings)])
    for secret in (PASSWORD, SECRET, IN_URL):
        assert secret not in shown
    assert "anna@plant.example" in answers[0]
    assert "cmms.example" in answers[0]
    document = json.loads(printed.out)
    assert document["settings"]["webhook"]["value"][0]["host"] == "cmms.example"


def test_a_table_of_the_environment_overrides_that_of_the_file(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("BALLSCREW_SERVER_EMAIL", '[{"to": "b@plant.example"}]')
    (folder / "server.toml").write_text(GOOD)
    assert [each.to for each in read_settings(folder, None, {}).email] == ["b@plant.example"]


def test_settings_of_days_are_shown_on_the_page(new_service: NewService) -> None:
    with client_of(new_service(holidays=("2026-12-25",))) as client:
        assert "2026-12-25" in client.get("/settings").text


def test_the_page_lists_every_field_with_its_default() -> None:
    tables: list[tuple[str, type[BaseModel], tuple[str, ...]]] = [
        ("smtp", SmtpServer, ()),
        ("email", EmailRecipient, ("level", "machines", "language", "escalation")),
        ("webhook", WebhookRecipient, ("level", "machines", "language", "escalation")),
        ("messages", MessageRules, ()),
    ]
    text = page("docs/howto/messages.md")
    found: dict[str, dict[str, str]] = {}
    for table, name, default in re.findall(r"^\| `(\w+)\.(\w+)` \| ([^|]*?) \|", text, re.M):
        found.setdefault(table, {})[name] = default
    for table, model, shared in tables:
        fields: dict[str, Any] = dict(model.model_fields)
        assert sorted(found[table]) == sorted(set(fields) - set(shared)), table
        for name, default in found[table].items():
            if default.startswith("`"):
                value = json.loads(default.strip("`"))
                assert value == (
                    list(fields[name].default) if fields[name].default == () else fields[name].default
                )
    assert sorted(found["recipient"]) == sorted(Recipient.model_fields)
    assert set(ServerSettings.model_fields) >= {table for table, *_ in tables}
