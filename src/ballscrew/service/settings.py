"""Settings of the service: options, environment, ``server.toml``, defaults, in this order."""

from __future__ import annotations

import ipaddress
import os
import re
import sys
from collections.abc import Mapping
from contextlib import suppress
from datetime import date
from pathlib import Path
from typing import Annotated, Any, Literal
from urllib.parse import urlsplit

from pydantic import AfterValidator, BaseModel, BeforeValidator, Field, SecretStr, ValidationError
from pydantic_core import PydanticCustomError
from pydantic_settings import BaseSettings, SettingsConfigDict, SettingsError

from ballscrew.base.errors import InputError, shown
from ballscrew.base.tomlfile import read_toml
from ballscrew.service.recipients import (
    EmailRecipient,
    MessageRules,
    Recipient,
    SmtpServer,
    WebhookRecipient,
    recipient_problems,
)
from ballscrew.store.calendars import CALENDAR, DAYS, RunCalendar, Weekday, known_zone, parse_shifts
from ballscrew.store.retention import RetentionPolicy

PREFIX = "BALLSCREW_SERVER_"
"""Beginning of the names of environment variables."""

CONFIG = "server.toml"


def _checked_shifts(texts: tuple[str, ...]) -> tuple[str, ...]:
    parse_shifts(texts)
    return texts


def _checked_day(value: object) -> object:
    if isinstance(value, date):
        return value
    if isinstance(value, str) and re.fullmatch(r"\d{4}-\d\d-\d\d", value, re.ASCII):
        with suppress(ValueError):  # pydantic would read a number as seconds since 1970
            return date.fromisoformat(value)
    raise PydanticCustomError("date_parsing", "must be a date such as 2026-12-25")


Day = Annotated[date, BeforeValidator(_checked_day)]
"""A date, or a text such as 2026-12-25."""

Shifts = Annotated[tuple[str, ...], Field(max_length=24), AfterValidator(_checked_shifts)]
"""Shifts such as 06:00-14:00."""


class ServerSettings(BaseSettings):
    """Settings of ``ballscrew serve``.

    Each is a key of ``server.toml``, and in capitals, after ``BALLSCREW_SERVER_``, an environment variable.
    """

    model_config = SettingsConfigDict(env_prefix=PREFIX, extra="forbid", frozen=True)

    host: str = Field("127.0.0.1", description="Address to listen on.")
    port: int = Field(8000, ge=0, le=65535, description="Port to listen on; 0 for any that is free.")
    workers: int = Field(
        max(1, min(4, (os.cpu_count() or 2) - 1)), ge=1, le=64, description="Processes that analyse."
    )
    method: str = Field("joint", pattern="^(joint|paper)$", description="Method of the analysis.")
    allowed_hosts: tuple[str, ...] = Field(
        (), description="Names by which clients may address the server, besides those of this computer."
    )
    allow_plain_http: bool = Field(
        False, description="Permit other addresses than loopback without TLS; tokens then travel unencrypted."
    )
    certificate: Path | None = Field(None, description="Certificate chain for TLS, PEM.")
    private_key: Path | None = Field(None, description="Private key of the certificate, PEM.")
    require_login: bool = Field(
        False, description="Require a sign-in or a token on this computer too, before there is a user."
    )
    session_idle_h: float = Field(
        12.0, gt=0, le=8760, description="Time without use after which a person must sign in again, in hours."
    )
    session_days: float = Field(
        30.0, gt=0, le=365, description="Time after which a person must sign in again, in days."
    )
    max_file_bytes: int = Field(1 << 30, ge=1, description="Largest file that is received.")
    max_queue: int = Field(1000, ge=1, description="Runs that may wait; more are refused with 429.")
    min_free_bytes: int = Field(
        1 << 30, ge=0, description="Free space of the disk below which files are refused with 507."
    )
    lease_s: float = Field(
        600.0, gt=0, description="Time that an analysis may take before its process is killed."
    )
    attempts: int = Field(3, ge=1, description="Attempts after which a run is set aside.")
    back_off_s: float = Field(
        30.0, ge=0, description="Pause before the second attempt; doubled each time, up to an hour."
    )
    upload_idle_s: float = Field(30.0, gt=0, description="Time without a byte that ends an upload.")
    unused_days: float = Field(
        7.0,
        gt=0,
        description="Age at which incomplete uploads and files of no run are removed.",
    )
    working_days: tuple[Weekday, ...] = Field(
        DAYS, min_length=1, description="Days on which runs are expected: on others no silence is counted."
    )
    holidays: tuple[Day, ...] = Field((), description="Days on which none are expected besides.")
    time_zone: str = Field("UTC", description="Time zone of these days, such as Europe/Berlin.")
    shifts: Shifts = Field(
        (), description="Times of these days, such as 06:00-14:00, outside of which no silence is counted."
    )
    public_url: str | None = Field(None, description="Address at which people reach the server, for links.")
    smtp: SmtpServer | None = Field(None, description="Server that takes the e-mails.")
    email: tuple[EmailRecipient, ...] = Field((), description="Who receives messages by e-mail.")
    webhook: tuple[WebhookRecipient, ...] = Field((), description="Programs that receive messages.")
    messages: MessageRules = Field(MessageRules.model_validate({}), description="When messages are sent.")
    retention_days: float | None = Field(
        None, ge=0, le=36_500, description="Age from which raw files are deleted; without it none are."
    )
    retention_newest: int = Field(
        30, ge=0, description="Newest runs of each axis whose raw files are not deleted by age."
    )
    heartbeat_url: SecretStr | None = Field(
        None, description="Address that is called while runs are received and analysed."
    )
    heartbeat_s: float = Field(300.0, ge=10, description="Period of these calls.")
    log: Literal["text", "json"] = Field(
        "text", description="Log on the terminal: warnings as text, or every line as JSON."
    )

    @property
    def on_loopback(self) -> bool:
        """Whether only this computer can reach the server."""
        if self.host == "localhost":
            return True
        with suppress(ValueError):
            return ipaddress.ip_address(self.host).is_loopback
        return False

    @property
    def calendar(self) -> RunCalendar:
        """When runs of an axis are expected whose schedule does not state it."""
        return RunCalendar().changed(self.model_dump(mode="json", include=set(CALENDAR)))

    @property
    def recipients(self) -> tuple[Recipient, ...]:
        """Everyone who receives messages."""
        return (*self.email, *self.webhook)

    def problems(self) -> list[str]:
        """What is wrong with the settings together, a sentence each."""
        found = []
        if (self.certificate is None) != (self.private_key is None):
            found.append("TLS needs both certificate and private_key.")
        for name in ("certificate", "private_key"):
            path = getattr(self, name)
            if path is not None and not path.is_file():
                found.append(f"{name}: {path} is not a file.")
        if known_zone(self.time_zone) is None:
            found.append(f"time_zone: {shown(self.time_zone)} is not known; give one such as Europe/Berlin.")
        found += filter(None, [self.calendar.problem()])
        if not self.on_loopback and self.certificate is None and not self.allow_plain_http:
            found.append(
                f"{self.host} is not a loopback address: give certificate and private_key, or set "
                "allow_plain_http, with which tokens travel unencrypted."
            )
        found += recipient_problems(self.public_url, self.smtp, self.recipients, self.messages)
        return found + self._heartbeat_problems()

    def _heartbeat_problems(self) -> list[str]:
        if self.heartbeat_url is None or _is_web(self.heartbeat_url.get_secret_value()):
            return []
        return ["heartbeat_url: is no address that begins with https:// or http://."]

    @property
    def retention(self) -> RetentionPolicy | None:
        """Which raw files stay; None where none are deleted."""
        if self.retention_days is None:
            return None
        return RetentionPolicy(self.retention_days, self.retention_newest)


def _is_web(url: str) -> bool:
    """Whether a text is the address of a web server."""
    with suppress(ValueError):
        parts = urlsplit(url)
        return parts.scheme in ("https", "http") and bool(parts.hostname)
    return False


def read_settings(folder: Path, config: Path | None, options: dict[str, Any]) -> ServerSettings:
    """Settings of a server.

    Parameters
    ----------
    folder : Path
        Data folder, which may contain ``server.toml``.
    config : Path or None
        Another file instead.
    options : dict
        Options that were given; they override the environment, which overrides the file.

    Returns
    -------
    ServerSettings
        Valid each; :meth:`ServerSettings.problems` lists what is wrong with them together.

    Raises
    ------
    InputError
        If one is wrong or unknown.
    """
    path = config_path(folder, config)
    stated = {} if path is None else read_toml(path).table
    for name in sorted(set(stated) - set(ServerSettings.model_fields)):
        raise InputError(f"{path}: {name} is not a known setting.")
    for name in sorted(set(os.environ) - {_variable(name) for name in ServerSettings.model_fields}):
        if name.startswith(PREFIX):
            raise InputError(f"{name}: is not a known setting.")
    # pydantic reads the environment, which the file must not override.
    given = {name: value for name, value in stated.items() if not _environment(name)} | options
    try:
        return ServerSettings(**given)
    except SettingsError as error:
        raise InputError(f"{PREFIX}*: {error}.") from None
    except ValidationError as error:
        raise InputError(_sentence(error, origins(folder, config, options))) from None


def _sentence(error: ValidationError, sources: Mapping[str, str]) -> str:
    """Sentence about the first setting that is wrong; a value in a table may be a secret, and is left out."""
    first = error.errors(include_url=False)[0]
    place = [str(each) for each in first["loc"]] or ["the settings"]
    source = sources.get(place[0], "settings")
    reason = first["msg"].removeprefix("Value error, ")
    if len(place) > 1:
        if first["type"] == "extra_forbidden":
            reason = "is not a known setting"
        return f"{source}: {'.'.join(place)}: {reason}."
    return f"{source}: {place[0]} is {shown(first['input'])}: {reason}."


def plain_setting(value: Any) -> Any:
    """Value of a setting as JSON has it, without secrets and the URLs of webhooks."""
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json")
    if isinstance(value, tuple):
        return list(map(plain_setting, value))
    if isinstance(value, SecretStr):
        return "set"
    return str(value) if isinstance(value, Path | date) else value


def config_path(folder: Path, config: Path | None) -> Path | None:
    """File of settings, or None if there is none.

    Raises
    ------
    InputError
        If the one that was given does not exist.
    """
    if config is None:
        config = folder / CONFIG
        return config if config.is_file() else None
    if not config.is_file():
        raise InputError(f"{config}: there is no such file.")
    return config


def origins(folder: Path, config: Path | None, options: dict[str, Any]) -> dict[str, str]:
    """Where each setting comes from: option, an environment variable, the file, or default."""
    path = config_path(folder, config)
    stated = {} if path is None else read_toml(path).table
    found = {}
    for name in ServerSettings.model_fields:
        found[name] = "default"
        if name in stated:
            found[name] = str(path)
        if _environment(name):
            found[name] = _variable(name)
        if name in options:
            found[name] = "option"
    return found


def _environment(name: str) -> str:
    return os.environ.get(_variable(name), "")


def _variable(name: str) -> str:
    """Environment variable of a setting."""
    return f"{PREFIX}{name.upper()}"


def default_folder() -> Path:
    """Data folder in BALLSCREW_STORE, or else in the user's data directory."""
    stated = os.environ.get("BALLSCREW_STORE")
    if stated:
        return Path(stated)
    if sys.platform == "win32":
        base = os.environ.get("LOCALAPPDATA") or str(Path.home() / "AppData" / "Local")
        return Path(base) / "ballscrew"
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Application Support" / "ballscrew"
    return Path(os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share") / "ballscrew"
