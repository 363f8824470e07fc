"""Requests to the server: files by their hashes, resumed where they were cut, and then the run."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from email.utils import parsedate_to_datetime
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any
from urllib.parse import quote, unquote

from ballscrew._version import __version__
from ballscrew.base.errors import BallscrewError, InputError, printable, shown
from ballscrew.base.files import open_regular
from ballscrew.sending.spooled import SpooledFile, SpooledRun

if TYPE_CHECKING:
    from httpx import Response

Uploaded = Callable[[int], None]
"""Called with the number of bytes of a run that the server has."""

_BLOCK = 1 << 18
_ROUNDS = 8  # corrections of the offset of one file in one attempt
_LONGEST_ANSWER = 2000  # characters that are reported
_CONNECT_TIMEOUT = 10.0  # s
_TIMEOUT = 60.0  # s without any progress; a server makes a file durable in 1 s
_NO_HEAD = (405, 501)
_AGAIN = (408, 425, 429, 507)
_OVERLOADED = (429, 502, 503, 504, 507)
_COMPLETE, _OFFSET = "Upload-Complete", "Upload-Offset"
_OURS = "Ballscrew-API"  # header of each answer of a ballscrew server


class DelayError(BallscrewError):
    """The server cannot take a run now.

    Attributes
    ----------
    wait : float or None
        Time that the server asks for, s.
    general : bool
        Whether other runs have to wait, too.
    lasting : bool
        Whether someone must act before a repetition can succeed.
    """

    def __init__(
        self, message: str, *, wait: float | None = None, general: bool = True, lasting: bool = False
    ) -> None:
        super().__init__(message)
        self.wait = wait
        self.general = general
        self.lasting = lasting


class RefusalError(BallscrewError):
    """The server refuses a run; a repetition would be refused, too."""


@dataclass(frozen=True)
class Answer:
    """Answer of the server to a run that it has.

    Parameters
    ----------
    name : str
        Of the run at the sender.
    axis, run : str
        Axis, and key of the run.
    id : str or None
        Of its content, as the server computed it.
    status : str
        ``"queued"``, or what has become of it since.
    new : bool
        Whether it was not there before.
    doubt : str or None
        Why the server doubts the time of the run, which then does not count.
    """

    name: str
    axis: str
    run: str
    id: str | None
    status: str
    new: bool
    doubt: str | None = None


class Server:
    """Connection to a server.

    Parameters
    ----------
    address : str
        As :func:`~ballscrew.sending.settings.check_address` returned it.
    token : callable
        Returns the token or None; called before each pass, so that a new one needs no restart.
    timeout : float
        Longest time without progress, s.

    Raises
    ------
    InputError
        If httpx is not installed.
    """

    def __init__(self, address: str, token: Callable[[], str | None], timeout: float = _TIMEOUT) -> None:
        try:
            import httpx
        except ImportError:
            raise InputError(
                'send needs httpx; install it by python -m pip install "ballscrew[send]".'
            ) from None
        self.address = address
        self._token = token
        limits = httpx.Timeout(timeout, connect=min(timeout, _CONNECT_TIMEOUT))
        try:
            self._client = httpx.Client(
                base_url=address, timeout=limits, headers={"User-Agent": f"ballscrew/{__version__}"}
            )
        except (httpx.InvalidURL, OSError, ValueError) as error:  # certificates or a proxy of the environment
            raise InputError(f"{address}: no connection can be made ({error}).") from None

    def __enter__(self) -> Server:
        """Use the connection."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close it."""
        self._client.close()

    def authorise(self) -> None:
        """Read the token again."""
        token = self._token()
        if token is None:
            self._client.headers.pop("Authorization", None)
        else:
            self._client.headers["Authorization"] = f"Bearer {token}"

    def send(self, run: SpooledRun, uploaded: Uploaded) -> Answer:
        """Send a run; a repetition is the same to the server.

        Parameters
        ----------
        run : SpooledRun
            In the spool.
        uploaded : callable
            See :data:`Uploaded`.

        Returns
        -------
        Answer
            The server has the run durably.

        Raises
        ------
        DelayError
            If it should be sent again later.
        RefusalError
            If the server refuses it.
        """
        path = f"/api/v1/axes/{quote(run.axis, safe='')}/runs/{quote(run.key, safe='')}"
        before = 0
        for file in run.uploads:
            further = partial(_add, uploaded, before)
            self._upload(f"{path}/files/{file.sha256}", run.folder / file.sha256, file, further)
            before += file.size
        files = [{"name": file.name, "sha256": file.sha256} for file in run.files]
        document = {
            "files": files,
            "run_toml": run.run_toml,
            "run_json": run.run_json.sha256 if run.run_json else None,
            "measured_at": run.measured_at,
        }
        response = self._request("POST", f"{path}/complete", json=document)
        return self._answer(run, response)

    def _answer(self, run: SpooledRun, response: Response) -> Answer:
        """Answer to a run; a proxy that answers 200 to everything has not stored it."""
        try:
            found = response.json()
        except ValueError:
            found = None
        if not isinstance(found, dict) or found.get("run") != run.key:
            raise self._no_server(response)
        identity, doubt = found.get("id"), found.get("doubt")
        return Answer(
            name=run.name,
            axis=run.axis,
            run=run.key,
            id=None if identity is None else str(identity),
            status=str(found.get("status", "")),
            new=response.status_code != 200,
            doubt=None if doubt is None else str(doubt),
        )

    def _no_server(self, response: Response) -> DelayError:
        status = response.status_code
        return DelayError(
            f"{self.address}: answers {status} but not as a ballscrew server does; check --to, and the "
            "proxies in between.",
            general=status != 413,  # of a proxy, to a file that it does not pass on
            lasting=True,
        )

    def _upload(self, url: str, path: Path, file: SpooledFile, uploaded: Uploaded) -> None:
        """Send what the server lacks of a file."""
        if not path.is_file() or path.stat().st_size != file.size:
            raise RefusalError(f"{file.name}: its copy in the spool is damaged; send the run again.")
        offset = self._offset(url, file)
        if offset is None:
            return
        for _ in range(_ROUNDS):
            response = self._put(url, path, file, offset, uploaded)
            if response.status_code == 422:
                self._check_copy(path, file, response, offset)
                offset = 0  # what the server had of it was of another content
                continue
            if response.status_code in (200, 201):
                return
            further = _stated_offset(response, file.size)
            if further == offset:  # another sender is sending the same file
                break
            offset = further
        raise DelayError(
            f"{file.name}: the server does not accept the rest of it now.",
            wait=_retry_after(response),
            general=False,
        )

    def _check_copy(self, path: Path, file: SpooledFile, response: Response, offset: int) -> None:
        """Check the copy in the spool after the server computed another hash."""
        with open_regular(path) as stream:
            found = hashlib.file_digest(stream, "sha256").hexdigest()
        if found != file.sha256:
            raise RefusalError(f"{file.name}: its copy in the spool is damaged; send the run again.")
        if offset == 0:
            raise RefusalError(f"{file.name}: {_detail(response)}")

    def _offset(self, url: str, file: SpooledFile) -> int | None:
        """Bytes of a file that the server has; None if it has all."""
        response = self._request("HEAD", url, accepted=_NO_HEAD)
        if response.status_code >= 400:
            return 0
        if response.headers.get(_COMPLETE) == "?1":
            return None
        return _stated_offset(response, file.size)

    def _put(self, url: str, path: Path, file: SpooledFile, offset: int, uploaded: Uploaded) -> Response:
        headers = {"Content-Type": "application/octet-stream", "Content-Length": str(file.size - offset)}
        if offset:
            headers["Content-Range"] = f"bytes {offset}-{file.size - 1}/{file.size}"
        content = _blocks(path, offset, file.size, uploaded)
        return self._request("PUT", url, accepted=(409, 422), content=content, headers=headers)

    def _request(self, method: str, url: str, accepted: tuple[int, ...] = (), **body: Any) -> Response:
        """Response of the server.

        Raises
        ------
        DelayError
            If there is none, it asks for a repetition, or someone must act before one can succeed.
        RefusalError
            If it has any other status that is not 2xx and not accepted.
        """
        import httpx

        try:
            response = self._client.request(method, url, **body)
        except (httpx.TransportError, httpx.DecodingError) as error:
            cause = str(error) or type(error).__name__
            raise DelayError(f"{self.address}: no connection ({cause}).") from None
        status = response.status_code
        # A proxy that does not pass on HEAD may pass on the rest.
        if response.is_success or (status in accepted and (status in _NO_HEAD or not _is_foreign(response))):
            return response
        raise self._error(response, url)

    def _error(self, response: Response, url: str) -> BallscrewError:
        """Error after an answer that is not the expected one."""
        status = response.status_code
        if status >= 500 or status in _AGAIN:
            return DelayError(
                f"{self.address}: {_detail(response)}",
                wait=_retry_after(response),
                general=status in _OVERLOADED,
            )
        if status < 400 or _is_foreign(response):
            return self._no_server(response)
        return self._refusal(response, url)

    def _refusal(self, response: Response, url: str) -> BallscrewError:
        """Error after the server itself has refused a request."""
        status = response.status_code
        if status in (401, 403):
            return DelayError(f"{self.address}: {self._token_refused(response)}", lasting=True)
        if status == 404:
            axis = unquote(url.split("/")[4])
            reason = f"no run of the axis {shown(axis)} can be received yet ({_detail(response)})."
            return DelayError(f"{self.address}: {reason}", general=False, lasting=True)
        return RefusalError(_detail(response))

    def _token_refused(self, response: Response) -> str:
        """Sentence about a token that is refused; the answer to HEAD contains none."""
        reason = "the token is refused"
        if response.status_code == 403:
            reason = "the token is not allowed to send for this axis"
        elif "Authorization" not in self._client.headers:
            reason = "no token was given"
        return (
            f"{reason} ({_detail(response)}): check the token file (--token-file, or the variable "
            "BALLSCREW_TOKEN), and 'ballscrew token list' at the server."
        )


def _is_foreign(response: Response) -> bool:
    """Whether a proxy or another server answers."""
    return _OURS not in response.headers


def _add(uploaded: Uploaded, before: int, position: int) -> None:
    uploaded(before + position)


def _blocks(path: Path, offset: int, size: int, uploaded: Uploaded) -> Iterator[bytes]:
    with open_regular(path) as stream:
        stream.seek(offset)
        while block := stream.read(min(_BLOCK, size - offset)):
            yield block
            offset += len(block)
            uploaded(offset)


def _stated_offset(response: Response, size: int) -> int:
    """Offset that the server states; 0, so that all is sent anew, if it states none or an impossible one."""
    text = response.headers.get(_OFFSET, "")
    if not re.fullmatch(r"[0-9]{1,18}", text):
        return 0
    offset = int(text)
    return offset if offset < size else 0


def _detail(response: Response) -> str:
    """Status of an answer with its sentence."""
    try:
        detail = response.json()["detail"]
        text = detail if isinstance(detail, str) else json.dumps(detail)
    except (ValueError, TypeError, KeyError):
        text = response.text.strip()
    text = printable(" ".join(text.split()))[:_LONGEST_ANSWER]
    return f"{response.status_code} {text or response.reason_phrase}"


def _retry_after(response: Response) -> float | None:
    """Time that the server asks to wait, s: a number, or a date."""
    text = response.headers.get("Retry-After", "").strip()
    if re.fullmatch(r"[0-9]{1,9}", text):
        return float(text)
    try:
        date = parsedate_to_datetime(text)
    except ValueError:
        return None
    if date.tzinfo is None:
        date = date.replace(tzinfo=UTC)
    return max(0.0, (date - datetime.now(UTC)).total_seconds())
