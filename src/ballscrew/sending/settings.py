"""How runs are sent: settings, and the checks of URL, token and key."""

from __future__ import annotations

import ipaddress
import os
import platform
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote, urlsplit

from ballscrew.base.errors import InputError
from ballscrew.base.files import read_whole

_ENVIRONMENT = "BALLSCREW_TOKEN"
_LARGEST_TOKEN = 4096  # bytes


@dataclass(frozen=True)
class SendSettings:
    """How runs are sent.

    Parameters
    ----------
    spool : Path or None
        Folder of the spool, for one server; None for one in the user's data folder.
    spool_limit : float
        Its largest size, bytes.
    token_file : Path or None
        File with the token; None for the variable BALLSCREW_TOKEN, if it is set.
    plain_http : bool
        Whether plain HTTP is allowed to another host than this.
    tries : int
        Attempts without success after which a command that does not watch ends.
    settle : float
        A file of a watched folder is complete when it has not changed for this long, s.
    timeout : float
        A run of a watched folder is incomplete when nothing was added for this long, s.
    """

    spool: Path | None = None
    spool_limit: float = 10e9
    token_file: Path | None = None
    plain_http: bool = False
    tries: int = 6
    settle: float = 10.0
    timeout: float = 900.0


def spool_folder(settings: SendSettings, address: str) -> Path:
    """Folder of the spool for a server; by default in the user's data folder.

    Parameters
    ----------
    settings : SendSettings
        May state it.
    address : str
        URL of the server.

    Returns
    -------
    Path
        Need not exist.

    Raises
    ------
    InputError
        If the user has no home folder.
    """
    if settings.spool is not None:
        return settings.spool
    system = platform.system()
    stated = os.environ.get("LOCALAPPDATA" if system == "Windows" else "XDG_DATA_HOME")
    name = quote(address.partition("://")[2].strip("/"), safe="").replace("%", "-")
    try:
        if stated:
            data = Path(stated)
        elif system == "Darwin":
            data = Path.home() / "Library" / "Application Support"
        else:
            data = Path.home() / ".local" / "share"
    except RuntimeError:
        raise InputError("this user has no home folder; give a folder for the spool (--spool).") from None
    return data / "ballscrew" / "spool" / name


def check_address(address: str, *, plain: bool) -> str:
    """Check the URL of a server.

    Parameters
    ----------
    address : str
        ``https://host:port/path``.
    plain : bool
        Whether plain HTTP is allowed to another host than this.

    Returns
    -------
    str
        Without a slash at the end.

    Raises
    ------
    InputError
        If it is none, contains a password, or is plain HTTP to another host.
    """
    host = _host(address)
    parts = urlsplit(address)
    if parts.username is not None:
        raise InputError("--to contains a name or a password; use a token (--token-file).")
    if parts.query or parts.fragment:
        raise InputError(f"--to is {address!r}; it must have no '?' and no '#'.")
    if parts.scheme == "http" and not plain and not _is_this_host(host):
        raise InputError(
            f"{address}: plain HTTP would send recordings and token readable over the network; use https://, "
            "or --allow-plain-http where the network is trusted."
        )
    return address.rstrip("/")


def _host(address: str) -> str:
    """Host of a URL of http or https."""
    host = None
    if re.fullmatch(r"https?://[^\s\x00-\x1f\\]+", address):
        try:
            parts = urlsplit(address)
            host, _ = parts.hostname, parts.port
        except ValueError:  # brackets, or a port beyond 65535
            host = None
    if not host:
        raise InputError(f"--to is {address!r}; it must be a URL, such as https://host:8443.")
    return host


def check_key(key: str) -> None:
    """Check the key of a run, which is a part of URLs.

    Raises
    ------
    InputError
        If it has other characters, or too many.
    """
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]{0,99}", key):
        raise InputError(f"--run is {key!r}; it must have letters, digits, '.', '_' and '-', 100 at most.")


def _is_this_host(host: str) -> bool:
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def token_source(path: Path | None) -> Callable[[], str | None]:
    """Function that reads the token: from a file, else from the environment.

    Parameters
    ----------
    path : Path or None
        File with the token; None for the variable BALLSCREW_TOKEN.

    Returns
    -------
    callable
        Its result is None without a token. It raises an InputError, which does not contain the token, if the
        file cannot be read or the token could not be sent.
    """

    def read() -> str | None:
        if path is None:
            text, place = os.environ.get(_ENVIRONMENT, ""), _ENVIRONMENT
        else:
            text, place = read_whole(path, _LARGEST_TOKEN).decode("utf-8-sig", "replace"), str(path)
        token = text.strip()
        if not re.fullmatch(r"[\x21-\x7e]*", token):
            raise InputError(f"{place}: is no token: it has blanks, or characters beyond ASCII.")
        if path is not None and not token:
            raise InputError(f"{place}: is empty; it must contain the token.")
        return token or None

    return read
