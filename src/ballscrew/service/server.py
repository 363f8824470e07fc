"""``ballscrew serve``: one process that holds the store, its workers, and uvicorn."""

from __future__ import annotations

import logging
import shutil
import signal
import socket
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import uvicorn
from sqlalchemy import select

from ballscrew.base.errors import InputError
from ballscrew.base.files import write_text
from ballscrew.service.alarms import watch_for_silence, write_messages
from ballscrew.service.app import create_app
from ballscrew.service.delivering import run_messages
from ballscrew.service.health import beat_regularly
from ballscrew.service.jobs import release_jobs, request_assessment
from ballscrew.service.logs import logging_to
from ballscrew.service.serving import ServedStore, Service
from ballscrew.service.settings import ServerSettings, default_folder, origins, plain_setting, read_settings
from ballscrew.service.uploads import recover_uploads, remove_unused
from ballscrew.service.users import ADDRESS_FILE, LINK_HOURS, address_of_server, first_link
from ballscrew.service.working import Worker
from ballscrew.store.folder import DataFolder
from ballscrew.store.migrating import create_store
from ballscrew.store.retention import RetentionPolicy, retain
from ballscrew.store.tables import Axis

_log = logging.getLogger("ballscrew.service")

_PERIOD = 30.0  # s between looks for silence
_HOUR = 3600.0  # s between removals of unused files
_DAY = 86400.0  # s between deletions by the retention policy
_GRACEFUL = 5  # s that requests have to end
_WAITING = 2048  # connections that wait to be accepted


class GracefulServer(uvicorn.Server):
    """Server that stops after a signal with exit status 0, once requests and workers have ended.

    Parameters
    ----------
    config : uvicorn.Config
        Its configuration.
    service : Service
        What is to stop.
    """

    def __init__(self, config: uvicorn.Config, service: Service) -> None:
        super().__init__(config)
        self.service = service

    def handle_exit(self, sig: int, frame: Any) -> None:  # noqa: ARG002  as uvicorn calls it
        """Stop streams, and then the server; the signal is not raised again."""
        self.service.stopping.set()
        if self.should_exit and sig == signal.SIGINT:
            self.force_exit = True
        self.should_exit = True


def serve(
    data: str | Path | None = None, *, config: str | Path | None = None, quiet: bool = False, **options: Any
) -> None:
    """Serve a store over HTTP, until a signal.

    Parameters
    ----------
    data : path-like, optional
        Data folder of the store, created if missing; by default :func:`~.settings.default_folder`.
    config : path-like, optional
        File of settings; by default ``server.toml`` in the data folder.
    quiet : bool
        Whether the address is not printed.
    **options
        Settings, such as ``port``; they override the environment and the file.

    Raises
    ------
    InputError
        If a setting is wrong, the store is in use, or the address cannot be listened on.
    """
    folder = Path(data) if data is not None else default_folder()
    path = None if config is None else Path(config)
    settings = read_settings(folder, path, options)
    problems = settings.problems()
    if problems:
        raise InputError(problems[0])
    if not DataFolder(folder).exists():
        create_store(folder)
    with DataFolder(folder).locked("serve", serving=True), _listening(settings) as listener:
        service = Service(ServedStore(folder), settings, origins(folder, path, options))
        _recover(service)
        workers = [Worker(service, number) for number in range(settings.workers)]
        server = GracefulServer(_uvicorn_config(service, workers), service)
        host, port = listener.getsockname()[:2]
        scheme = "http" if settings.certificate is None else "https"
        if not quiet:
            shown_host = f"[{host}]" if ":" in host else host
            print(f"Serving {folder} at {scheme}://{shown_host}:{port}", flush=True)  # noqa: T201
        write_text(folder / ADDRESS_FILE, address_of_server(settings, port))
        _print_first_link(service, port)
        with logging_to(folder, settings.log), _working(service, workers):
            server.run(sockets=[listener])


def _print_first_link(service: Service, port: int) -> None:
    """Print a link for the first administrator, where people must sign in and there is no user."""
    settings = service.settings
    if settings.on_loopback and not settings.require_login:
        return
    link = first_link(service.store)
    if link is not None:
        address = f"{address_of_server(settings, port)}/link/{link}"
        print(f"The first administrator signs in, once, within {LINK_HOURS} h, at {address}", flush=True)  # noqa: T201


@contextmanager
def _listening(settings: ServerSettings) -> Iterator[socket.socket]:
    """A socket that listens."""
    try:
        family, _, _, _, address = socket.getaddrinfo(settings.host, settings.port, type=socket.SOCK_STREAM)[
            0
        ]
        listener = socket.socket(family)
    except OSError as error:
        raise InputError(
            f"{settings.host}: is no address of this computer ({error.strerror or error})."
        ) from None
    with listener:
        try:
            if hasattr(socket, "SO_EXCLUSIVEADDRUSE"):  # Windows would share the port
                listener.setsockopt(socket.SOL_SOCKET, socket.SO_EXCLUSIVEADDRUSE, 1)
            else:
                listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listener.bind(address)
            listener.listen(_WAITING)
        except OSError as error:
            where = f"{settings.host}:{settings.port}"
            raise InputError(f"{where}: cannot be listened on ({error.strerror or error}).") from None
        yield listener


def _uvicorn_config(service: Service, workers: Sequence[Worker]) -> uvicorn.Config:
    settings = service.settings
    return uvicorn.Config(
        create_app(service, workers),
        access_log=False,
        log_config=None,
        server_header=False,
        backlog=_WAITING,
        timeout_graceful_shutdown=_GRACEFUL,
        ssl_certfile=settings.certificate,
        ssl_keyfile=settings.private_key,
    )


def _recover(service: Service) -> None:
    """Continue after an earlier server: release its leases, write messages and request assessments."""
    shutil.rmtree(service.scratch, ignore_errors=True)
    for folder in (service.scratch, service.partial):
        folder.mkdir(exist_ok=True)
    recover_uploads(service)
    with service.store.write("recover") as session:
        release_jobs(session)
        for axis in session.scalars(select(Axis)):
            write_messages(session, axis)
            if axis.changed_at is not None:
                request_assessment(session, axis)


@contextmanager
def _working(service: Service, workers: Sequence[Worker]) -> Iterator[None]:
    """Workers and regular tasks, as long as the block lasts."""
    keeper = threading.Thread(target=_run_regularly, args=(service,), name="regular tasks", daemon=True)
    sender = threading.Thread(target=run_messages, args=(service,), name="messages", daemon=True)
    beat = threading.Thread(target=beat_regularly, args=(service, workers), name="heartbeat", daemon=True)
    for thread in (*(worker.thread for worker in workers), keeper, sender, beat):
        thread.start()
    try:
        yield
    finally:
        service.stopping.set()
        service.announce()
        for worker in workers:
            worker.thread.join()
        keeper.join()
        sender.join(_GRACEFUL)  # what it sends meanwhile is sent again
        beat.join(_GRACEFUL)


def _run_regularly(service: Service) -> None:
    next_removal = next_retention = time.monotonic()
    while not service.stopping.is_set():
        try:
            watch_for_silence(service)
            if time.monotonic() >= next_removal:
                next_removal = time.monotonic() + _HOUR
                remove_unused(service)
            if service.settings.retention is not None and time.monotonic() >= next_retention:
                next_retention = time.monotonic() + _DAY
                delete_by_policy(service, service.settings.retention)
        except Exception:  # noqa: BLE001  they go on, whatever it is
            _log.exception("regular tasks")
        service.stopping.wait(_PERIOD)


def delete_by_policy(service: Service, policy: RetentionPolicy) -> None:
    """Delete raw files by the retention policy, and log what was deleted.

    Parameters
    ----------
    service : Service
        The service.
    policy : RetentionPolicy
        What stays.
    """
    document = retain(service.store, policy)
    if document["axes"]:
        number = sum(len(each["files"]) for each in document["axes"])
        _log.info("%d raw files deleted by policy, %d bytes", number, document["bytes"])
        service.announce()


def check(
    data: str | Path | None = None, *, config: str | Path | None = None, **options: Any
) -> tuple[dict[str, tuple[Any, str]], list[str]]:
    """Settings of a server, where each comes from, and what is wrong.

    Parameters
    ----------
    data, config, **options
        As for :func:`serve`.

    Returns
    -------
    tuple
        Value and origin of each setting by its name; a sentence for each problem.
    """
    folder = Path(data) if data is not None else default_folder()
    path = None if config is None else Path(config)
    settings = read_settings(folder, path, options)
    found = {}
    for name, origin in origins(folder, path, options).items():
        found[name] = (plain_setting(getattr(settings, name)), origin)
    return found, settings.problems()
