"""E-mails: plain text, by SMTP with TLS."""

from __future__ import annotations

import smtplib
import socket
import ssl
from contextlib import suppress
from datetime import datetime
from email.message import EmailMessage
from email.policy import SMTP
from email.utils import format_datetime

from ballscrew.base.errors import printable
from ballscrew.service.recipients import SmtpServer
from ballscrew.service.webhooks import delivering, trusting

_READY = 220  # answer to STARTTLS


def send_mail(
    server: SmtpServer, to: str, subject: str, text: str, key: str, at: datetime, limit: float
) -> None:
    """Send an e-mail; it was accepted when this returns.

    Parameters
    ----------
    server : SmtpServer
        Server that takes it.
    to : str
        Address of the recipient.
    subject, text : str
        Its content.
    key : str
        First part of its Message-ID, the same with each attempt.
    at : datetime
        Date of the message.
    limit : float
        Time that it may take, s.

    Raises
    ------
    DeliveryError
        If it was not accepted.
    """
    message = EmailMessage(policy=SMTP)
    message["From"] = server.sender
    message["To"] = to
    message["Subject"] = printable(subject)  # no end of a line gets into a header
    message["Date"] = format_datetime(at)
    message["Message-ID"] = f"<{key}@{server.sender.rpartition('@')[2]}>"
    message["Auto-Submitted"] = "auto-generated"
    message.set_content(text)
    client = _Client(server, limit)
    with delivering(server.host, limit, lambda: client.sock, smtplib.SMTPException):
        try:
            client.connect(server.host, server.port)
            if server.tls == "starttls":
                client.starttls(context=trusting(server.ca_file))
            if server.user is not None:
                client.login(server.user, server.password())
            client.send_message(message, server.sender, [to])
        except smtplib.SMTPRecipientsRefused as error:
            raise _refusal(*error.recipients[to]) from None
        except smtplib.SMTPResponseException as error:
            raise _refusal(error.smtp_code, error.smtp_error) from None
        finally:
            client.leave()


def _refusal(code: int, text: bytes | str) -> ValueError:
    """Error with what a server answered."""
    words = text.decode("utf-8", "replace") if isinstance(text, bytes) else text
    return ValueError(f"it answered {code} {words}".rstrip(" ."))


class _Client(smtplib.SMTP):
    """Client whose socket can be closed at any time, also while it connects."""

    sock: socket.socket | None = None

    def __init__(self, server: SmtpServer, limit: float) -> None:
        super().__init__(timeout=limit)
        self._host = server.host  # whose certificate is verified; smtplib sets it if it connects at once
        self._server = server

    def _get_socket(self, host: str, port: int, timeout: float) -> socket.socket:
        """Connected socket; TLS from the beginning if it is set."""
        found = socket.create_connection((host, port), timeout)
        if self._server.tls == "tls":
            context = trusting(self._server.ca_file)
            found = context.wrap_socket(found, server_hostname=host, do_handshake_on_connect=False)
            self.sock = found
            found.do_handshake()
        return found

    def starttls(self, *, context: ssl.SSLContext) -> tuple[int, bytes]:  # type: ignore[override]
        """Begin TLS, on a socket that can be closed during the handshake."""
        self.ehlo_or_helo_if_needed()
        if not self.has_extn("starttls"):
            raise smtplib.SMTPNotSupportedError("it does not offer STARTTLS")
        code, text = self.docmd("STARTTLS")
        if code != _READY:
            raise smtplib.SMTPResponseException(code, text)
        assert self.sock is not None  # noqa: S101
        found = context.wrap_socket(self.sock, server_hostname=self._host, do_handshake_on_connect=False)
        self.sock = found
        found.do_handshake()
        self.file = self.helo_resp = self.ehlo_resp = None  # what was said before does not count
        self.esmtp_features, self.does_esmtp = {}, False
        return code, text

    def leave(self) -> None:
        """Close the connection; after a message was accepted, no error of this matters."""
        with suppress(OSError, smtplib.SMTPException):
            self.quit()
        self.close()
