"""Who receives messages, by which server, and by which rules: tables of ``server.toml``.

No secret is a setting: each is read from an environment variable or a file when it is used.
"""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Callable, Sequence
from datetime import datetime, time, timedelta, tzinfo
from pathlib import Path
from typing import Literal
from urllib.parse import urlsplit

from pydantic import BaseModel, ConfigDict, Field, computed_field, field_validator

from ballscrew.base.errors import InputError, shown

_ADDRESS = re.compile(r"[!#-'*+\-./0-9=?A-Z^_`a-z{|}~]{1,64}@[A-Za-z0-9](?:[A-Za-z0-9.-]{0,250}[A-Za-z0-9])?")
_LONGEST_SECRET = 4096  # bytes


class _SettingsTable(BaseModel):
    """A table of the file: what is not known is refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)


def _checked_address(text: str) -> str:
    if not _ADDRESS.fullmatch(text):
        raise ValueError("is no e-mail address such as maintenance@plant.example")
    return text


class SmtpServer(_SettingsTable):
    """Server that takes the e-mails."""

    host: str = Field(min_length=1, max_length=253, description="Its name.")
    port: int = Field(587, ge=1, le=65535, description="Its port.")
    tls: Literal["starttls", "tls", "none"] = Field(
        "starttls", description='TLS after STARTTLS, or from the beginning; "none" sends without.'
    )
    sender: str = Field(description="Address that the messages come from.")
    user: str | None = Field(None, description="Name to sign in with.")
    password_env: str | None = Field(None, description="Environment variable of the password.")
    password_file: Path | None = Field(None, description="File of the password.")
    ca_file: Path | None = Field(None, description="Certificates to trust instead of the system's, PEM.")

    _address = field_validator("sender")(_checked_address)

    def password(self) -> str:
        """The password.

        Raises
        ------
        InputError
            If it cannot be read.
        """
        return read_secret("smtp.password", self.password_env, self.password_file)


class Recipient(_SettingsTable):
    """Which messages a recipient gets."""

    level: Literal["alarm", "trouble"] = Field(
        "alarm", description="Alarms alone, or also trouble with measurements."
    )
    machines: tuple[str, ...] = Field((), description="Names of machines; none for all.")
    language: Literal["en", "de"] = Field("en", description="English or German.")
    escalation: bool = Field(
        False, description="Only alarms that nobody acknowledged within escalation_h hours."
    )

    @property
    def label(self) -> str:
        """Name of the recipient, which no other has."""
        raise NotImplementedError


class EmailRecipient(Recipient):
    """Somebody with an e-mail address."""

    to: str = Field(description="The address.")

    _address = field_validator("to")(_checked_address)

    @property
    def label(self) -> str:
        """The address."""
        return self.to


class WebhookRecipient(Recipient):
    """A program that receives signed requests; its URL, which may contain a secret, is never shown."""

    name: str = Field(pattern=r"^[\w.-]{1,64}$", description="Its name, for people.")
    url: str = Field(max_length=2000, exclude=True, repr=False, description="Where the requests go.")
    secret_env: str | None = Field(None, description="Environment variable of the secret that signs.")
    secret_file: Path | None = Field(None, description="File of the secret.")
    allow_private: bool = Field(False, description="Permit addresses of this computer and of its network.")
    allow_http: bool = Field(False, description="Permit http: the messages then travel unencrypted.")
    ca_file: Path | None = Field(None, description="Certificates to trust instead of the system's, PEM.")

    @field_validator("url")
    @classmethod
    def _checked_url(cls, text: str) -> str:
        try:
            parts = urlsplit(text)
            good = parts.scheme in ("https", "http") and parts.hostname and parts.port != 0
        except ValueError:
            good = False
        if not good or not text.isascii() or not text.isprintable() or " " in text:
            raise ValueError("is no URL such as https://cmms.example/hook")
        if "@" in parts.netloc or parts.fragment:
            raise ValueError("must contain neither a user nor a fragment (#)")
        return text

    @computed_field  # type: ignore[prop-decorator]
    @property
    def host(self) -> str:
        """Name of the server in the URL."""
        return urlsplit(self.url).hostname or ""

    @property
    def label(self) -> str:
        """The name."""
        return self.name

    def secret(self) -> str:
        """The secret that signs.

        Raises
        ------
        InputError
            If it cannot be read.
        """
        return read_secret(f"the secret of the webhook {self.name}", self.secret_env, self.secret_file)


class MessageRules(_SettingsTable):
    """When messages are due."""

    hold_h: float = Field(
        24.0,
        ge=0,
        le=24 * 366,
        description="Hours for which an alarm must be gone before that is reported; one that comes back "
        "within them makes no second message.",
    )
    quiet_from: time | None = Field(None, description="Begin of the quiet hours, by time_zone.")
    quiet_until: time | None = Field(None, description="Their end; only urgent alarms are sent within.")
    digest_hour: int = Field(
        7, ge=-1, le=23, description="Hour at which troubles are sent, one message a day; -1: each at once."
    )
    escalation_h: float = Field(
        24.0, gt=0, le=24 * 366, description="Hours without acknowledgement until an escalation."
    )
    attempts: int = Field(24, ge=1, le=1000, description="Attempts after which a message is given up.")
    back_off_s: float = Field(
        60.0, ge=0, description="Pause before the second attempt; doubled each time, up to an hour."
    )
    timeout_s: float = Field(20.0, gt=0, le=300, description="Time that a recipient has to answer.")
    webhook_hosts: tuple[str, ...] = Field((), description="Names that webhooks may have; none for any.")

    @field_validator("quiet_from", "quiet_until")
    @classmethod
    def _check_zone(cls, value: time | None) -> time | None:
        """Refuse a time of another zone than that of the server."""
        if value is not None and value.tzinfo is not None:
            raise ValueError("it must have no zone: time_zone states it.")
        return value

    def is_quiet(self, at: datetime, zone: tzinfo) -> bool:
        """Whether a time is within the quiet hours."""
        if self.quiet_from is None or self.quiet_until is None:
            return False
        present = at.astimezone(zone).time()
        if self.quiet_from <= self.quiet_until:
            return self.quiet_from <= present < self.quiet_until
        return present >= self.quiet_from or present < self.quiet_until

    def last_digest(self, at: datetime, zone: tzinfo) -> datetime | None:
        """The last time at or before a time at which troubles are sent; None where each is sent at once."""
        if self.digest_hour < 0:
            return None
        present = at.astimezone(zone)
        today = datetime.combine(present.date(), time(self.digest_hour), zone)
        if today > present:
            today = datetime.combine(present.date() - timedelta(days=1), time(self.digest_hour), zone)
        return today


def read_secret(what: str, variable: str | None, file: Path | None) -> str:
    """Secret from an environment variable, or else from a file.

    Parameters
    ----------
    what : str
        Its name, for the message.
    variable : str or None
        Name of the environment variable.
    file : Path or None
        The file; ends of lines around the secret do not count.

    Returns
    -------
    str
        The secret.

    Raises
    ------
    InputError
        If there is none.
    """
    if variable is not None:
        text = os.environ.get(variable, "")
        source = f"the environment variable {shown(variable)}"
    elif file is not None:
        source = str(file)
        try:
            with file.open("rb") as stream:
                text = stream.read(_LONGEST_SECRET + 1).decode("utf-8-sig").strip("\r\n")
        except (OSError, UnicodeDecodeError, ValueError):
            raise InputError(f"{what}: {source} cannot be read as text.") from None
    else:
        raise InputError(f"{what}: give the name of an environment variable, or a file.")
    if not text or len(text) > _LONGEST_SECRET or not text.isprintable():
        raise InputError(f"{what}: {source} has no text of one line.")
    return text


def recipient_problems(
    public_url: str | None,
    smtp: SmtpServer | None,
    recipients: Sequence[Recipient],
    rules: MessageRules,
) -> list[str]:
    """What is wrong with recipients, server and rules together, a sentence each."""
    found = _rule_problems(public_url, rules) + _repetitions(recipients)
    if recipients and public_url is None:
        found.append("public_url: give the address at which people reach the server; messages link to it.")
    if smtp is not None:
        found += _smtp_problems(smtp)
    for recipient in recipients:
        if isinstance(recipient, WebhookRecipient):
            found += _webhook_problems(recipient, rules)
        elif smtp is None:
            found.append(f"{recipient.label}: a table [smtp] with host and sender is needed for e-mail.")
    return found


def _repetitions(recipients: Sequence[Recipient]) -> list[str]:
    labels = Counter(recipient.label for recipient in recipients)
    repeated = [label for label, count in labels.items() if count > 1]
    return [f"{label}: is a recipient twice; each is one table." for label in repeated]


def _rule_problems(public_url: str | None, rules: MessageRules) -> list[str]:
    found = []
    if public_url is not None and not re.fullmatch(r"https?://[^\s?#@]+", public_url):
        found.append(f"public_url: {shown(public_url)} is no URL such as https://ballscrew.plant.example.")
    if (rules.quiet_from is None) != (rules.quiet_until is None):
        found.append("messages: quiet hours need both quiet_from and quiet_until.")
    return found


def _smtp_problems(smtp: SmtpServer) -> list[str]:
    found = []
    if smtp.user is not None:
        if smtp.tls == "none":
            found.append("smtp: a password is not sent without TLS; set tls, or leave out user.")
        found += _why_unread(smtp.password) or _why_unsent(smtp)
    return found + _missing_file("smtp.ca_file", smtp.ca_file)


def _why_unsent(smtp: SmtpServer) -> list[str]:
    """Why nobody can sign in; only ASCII can be sent."""
    if f"{smtp.user}{smtp.password()}".isascii():
        return []
    return ["smtp: user or password has characters other than ASCII, which cannot be sent; choose others."]


def _webhook_problems(webhook: WebhookRecipient, rules: MessageRules) -> list[str]:
    found = _why_unread(webhook.secret)
    what = f"webhook {webhook.name}"
    if not webhook.allow_http and not webhook.url.startswith("https:"):
        found.append(f"{what}: its URL begins with http; use https, or set allow_http.")
    if rules.webhook_hosts and webhook.host not in rules.webhook_hosts:
        found.append(f"{what}: {webhook.host} is not among messages.webhook_hosts.")
    return found + _missing_file(f"{what}: ca_file", webhook.ca_file)


def _why_unread(read: Callable[[], str]) -> list[str]:
    """Why a secret cannot be read; empty if it can."""
    try:
        read()
    except InputError as error:
        return [str(error)]
    return []


def _missing_file(what: str, path: Path | None) -> list[str]:
    if path is None or path.is_file():
        return []
    return [f"{what}: {path} is not a file."]
