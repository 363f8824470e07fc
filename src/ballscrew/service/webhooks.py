"""Signed requests to webhooks: to an address that was checked, without redirects, within a time."""

from __future__ import annotations

import hashlib
import hmac
import http.client
import ipaddress
import socket
import ssl
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from datetime import datetime
from pathlib import Path
from urllib.parse import urlsplit

from ballscrew.base.errors import BallscrewError, printable
from ballscrew.service.recipients import WebhookRecipient

_UNICAST, _NAT64 = ipaddress.IPv6Network("2000::/3"), ipaddress.IPv6Network("64:ff9b::/96")
_METADATA = ipaddress.IPv6Address("fd00:ec2::254")  # of a cloud, whose IPv4 is link-local
_PORTS = {"http": 80, "https": 443}
_PAUSE = 0.1  # s between attempts to close a connection
_LONGEST_REASON = 300  # characters of what a server answers

Address = ipaddress.IPv4Address | ipaddress.IPv6Address


class DeliveryError(BallscrewError):
    """A recipient did not accept a message."""


@contextmanager
def delivering(
    what: str, limit: float, socket_of: Callable[[], socket.socket | None], errors: type[Exception]
) -> Iterator[None]:
    """Limit the time of a delivery as a whole, and report every error of it as a sentence.

    Parameters
    ----------
    what : str
        Whom it is delivered to, for the sentence.
    limit : float
        Time after which its connection is closed, s.
    socket_of : callable
        Gives the connection, if there is one.
    errors : type
        Errors besides those of the operating system.

    Yields
    ------
    None
        While it is delivered.

    Raises
    ------
    DeliveryError
        If it was not accepted.
    """
    is_late, has_ended = threading.Event(), threading.Event()

    def close() -> None:
        pause = limit
        while not has_ended.wait(pause):
            is_late.set()
            pause = _PAUSE  # there may be no connection yet
            found = socket_of()
            with suppress(OSError):
                if found is not None:
                    # Not the shutdown of TLS, which another thread reads.
                    socket.socket.shutdown(found, socket.SHUT_RDWR)

    threading.Thread(target=close, daemon=True).start()
    try:
        yield
    except (OSError, ValueError, errors) as error:
        reason = str(error) or type(error).__name__
        if is_late.is_set() or isinstance(error, TimeoutError):
            reason = f"no answer within {limit:g} s"
        raise DeliveryError(f"{what}: {printable(reason)[:_LONGEST_REASON]}.") from None
    finally:
        has_ended.set()


def trusting(ca_file: Path | None) -> ssl.SSLContext:
    """Context that verifies the certificate of a server."""
    return ssl.create_default_context(cafile=None if ca_file is None else str(ca_file))


def sign(secret: str, timestamp: str, body: bytes) -> str:
    """Signature of a request: HMAC-SHA256 of ``timestamp.body``, hexadecimal.

    Parameters
    ----------
    secret : str
        What both sides know.
    timestamp : str
        Header ``Ballscrew-Timestamp``.
    body : bytes
        Body of the request.

    Returns
    -------
    str
        As in the header ``Ballscrew-Signature`` after ``sha256=``.
    """
    return hmac.new(secret.encode(), timestamp.encode() + b"." + body, hashlib.sha256).hexdigest()


def post_webhook(webhook: WebhookRecipient, body: bytes, key: str, at: datetime, limit: float) -> None:
    """Send a request; its answer is not read beyond the status.

    Parameters
    ----------
    webhook : WebhookRecipient
        The recipient.
    body : bytes
        JSON.
    key : str
        Idempotency key, the same with each attempt.
    at : datetime
        The present time.
    limit : float
        Time that it may take, s.

    Raises
    ------
    DeliveryError
        If it was not accepted with a status of 2xx.
    """
    parts = urlsplit(webhook.url)
    timestamp = str(int(at.timestamp()))
    headers = {
        "Content-Type": "application/json",
        "User-Agent": "ballscrew",
        "Idempotency-Key": key,
        "Ballscrew-Timestamp": timestamp,
        "Ballscrew-Signature": f"sha256={sign(webhook.secret(), timestamp, body)}",
        "Connection": "close",
    }
    path = (parts.path or "/") + (f"?{parts.query}" if parts.query else "")
    context = None
    if parts.scheme == "https":
        context = trusting(webhook.ca_file)
    connection = _Connection(webhook.host, parts.port or _PORTS[parts.scheme], context, limit)
    with delivering(webhook.name, limit, lambda: connection.sock, http.client.HTTPException):
        connection.addresses = resolve(webhook.host, connection.port, allow_private=webhook.allow_private)
        try:
            connection.request("POST", path, body, headers)
            status = connection.getresponse().status
        finally:
            connection.close()
        if 300 <= status < 400:
            raise ValueError(f"it answered {status}, and redirects are not followed")
        if not 200 <= status < 300:
            raise ValueError(f"it answered {status}")


def resolve(host: str, port: int, *, allow_private: bool) -> list[str]:
    """Addresses of a host, all of which are permitted.

    Parameters
    ----------
    host : str
        Its name.
    port : int
        Its port.
    allow_private : bool
        Whether they may be of this computer or of a private network.

    Returns
    -------
    list of str
        Addresses to connect to: the name is not looked up again.

    Raises
    ------
    ValueError
        If one is not permitted.
    OSError
        If there is none.
    """
    found = []
    for *_, address in socket.getaddrinfo(host, port, type=socket.SOCK_STREAM):
        text = str(address[0])
        if not _is_permitted(ipaddress.ip_address(text), allow_private=allow_private):
            raise ValueError(f"its address {text} is not permitted (allow_private)")
        if text not in found:
            found.append(text)
    return found


def _is_permitted(address: Address, *, allow_private: bool) -> bool:
    """Whether an address may be connected to."""
    if isinstance(address, ipaddress.IPv6Address) and address.ipv4_mapped is not None:
        return _is_permitted(address.ipv4_mapped, allow_private=allow_private)
    return _is_public(address) or (allow_private and _is_near(address))


def _is_public(address: Address) -> bool:
    """Whether an address is one of the internet, and what it leads to in IPv4 too."""
    if isinstance(address, ipaddress.IPv6Address):
        if not any(address in network for network in (_UNICAST, _NAT64)):
            return False
        leads_to = [address.sixtofour, *(address.teredo or ())]
        if address in _NAT64:
            leads_to.append(ipaddress.IPv4Address(int(address) & 0xFFFFFFFF))
        if not all(each is None or _is_public(each) for each in leads_to):
            return False
    return address.is_global and not address.is_multicast


def _is_near(address: Address) -> bool:
    """Whether an address is of this computer or a private network; metadata of clouds are not."""
    if address.is_link_local or address.is_unspecified or address.is_multicast or address == _METADATA:
        return False
    is_reserved = address.version == 4 and address.is_reserved  # of IPv6, ::1 is too
    return address.is_private and not is_reserved


class _Connection(http.client.HTTPConnection):
    """Connection to addresses that were checked, for the name that the request and TLS have."""

    def __init__(self, host: str, port: int, context: ssl.SSLContext | None, limit: float) -> None:
        super().__init__(host, port, timeout=limit)
        self.addresses: list[str] = []
        self._limit = limit
        self._context = context
        if context is not None:
            self.default_port = _PORTS["https"]

    def connect(self) -> None:
        """Connect to the first address that answers, all within the limit of time."""
        deadline = time.monotonic() + self._limit
        for place, address in enumerate(self.addresses, start=1):
            remaining = max(deadline - time.monotonic(), _PAUSE)
            try:
                self.sock = socket.create_connection((address, self.port), remaining)
                break
            except OSError:
                if place == len(self.addresses) or time.monotonic() >= deadline:
                    raise
        self.sock.settimeout(self._limit)
        if self._context is not None:
            self.sock = self._context.wrap_socket(
                self.sock, server_hostname=self.host, do_handshake_on_connect=False
            )
            self.sock.do_handshake()
