"""Sending: runs are copied into the spool and sent from there, once or while a folder is watched."""

from __future__ import annotations

import random
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ballscrew.base.errors import InputError
from ballscrew.base.files import Progress, ignore_progress
from ballscrew.base.jsonfile import SCHEMA
from ballscrew.sending.outgoing import OutgoingRun, RunRule, find_runs
from ballscrew.sending.server import Answer, DelayError, RefusalError, Server
from ballscrew.sending.settings import SendSettings, check_address, check_key, spool_folder, token_source
from ballscrew.sending.spool import FullSpoolError, Spool
from ballscrew.sending.spooled import SpooledRun
from ballscrew.sending.watched import WatchedFolder

_SHORTEST_WAIT = 1.0  # s, after the first failure
_LONGEST_WAIT = 300.0  # s, unless the server asks for more
_PATIENCE = 120.0  # s; a command that does not watch ends where it would have to wait longer
_MEGABYTE = 1_000_000


@dataclass(frozen=True)
class SendHooks:
    """Functions that are called while runs are sent.

    Parameters
    ----------
    report : callable
        Called with each answer.
    complain : callable
        Called with each sentence about a run that was not sent, or about the connection.
    progress : Progress
        Called with the megabytes of a run that were sent.
    clock, sleep, random : callable
        Monotonic time, s; waiting; random numbers from 0 to 1, so that senders wait differently long.
    """

    report: Callable[[Answer], None]
    complain: Callable[[str], None]
    progress: Progress = ignore_progress
    clock: Callable[[], float] = time.monotonic
    sleep: Callable[[float], None] = time.sleep
    random: Callable[[], float] = random.random


@dataclass(frozen=True)
class SendResult:
    """Result of :func:`send`.

    Parameters
    ----------
    sent : tuple of Answer
        Runs that the server has.
    rejected : tuple of str
        Sentence for each run that the server refused.
    failures : tuple of str
        Sentence for each run that could not be read.
    spooled : tuple of str
        Names of the runs in the spool, and of those that did not fit.
    reason : str
        Why they wait.
    """

    sent: tuple[Answer, ...]
    rejected: tuple[str, ...]
    failures: tuple[str, ...]
    spooled: tuple[str, ...]
    reason: str

    @property
    def waiting(self) -> int:
        """Number of runs that were not sent."""
        return len(self.spooled)

    def to_json(self) -> dict[str, Any]:
        """Document of ``send --json``."""
        sent: dict[bool, list[Any]] = {True: [], False: []}
        for answer in self.sent:
            sent[answer.new].append(asdict(answer))
        return {
            "schema": SCHEMA,
            "sent": sent[True],
            "there_already": sent[False],
            "rejected": list(self.rejected),
            "failures": list(self.failures),
            "spooled": list(self.spooled),
            "reason": self.reason or None,
        }


def _ignore(_: object) -> None:
    """Report nothing."""


ANY_RUN = RunRule()
"""RUN.toml, RUN.json, folders and recordings, whose axis RUN.toml or RUN.json states."""

USUAL_SETTINGS = SendSettings()
"""A spool of 10 GB in the user's data folder, and a token of the environment, if there is one."""

SILENT = SendHooks(_ignore, _ignore)
"""Hooks that print nothing."""


def send(
    files: Sequence[str | Path],
    to: str,
    *,
    rule: RunRule = ANY_RUN,
    run: str | None = None,
    settings: SendSettings = USUAL_SETTINGS,
    hooks: SendHooks = SILENT,
) -> SendResult:
    """Copy runs into the spool and send all that is in the spool, with repetitions.

    Parameters
    ----------
    files : sequence of path-like
        As for :func:`~ballscrew.sending.outgoing.find_runs`; empty to send what is in the spool.
    to : str
        URL of the server.
    rule : RunRule
        What makes files a run.
    run : str, optional
        Key of the run at the server; by default a hash of its content.
    settings : SendSettings
        Spool, token and repetitions.
    hooks : SendHooks
        Functions that are called while runs are sent.

    Returns
    -------
    SendResult
        What was sent, and what was not.

    Raises
    ------
    InputError
        If the URL, the token or the spool is wrong, or a key is given for several runs.
    """
    sender = _Sender(to, settings, hooks)
    found = list(find_runs([Path(path) for path in files], rule))
    if run is not None:
        check_key(run)
        if len(found) != 1:
            raise InputError(f"--run is the key of a single run; there are {len(found)}.")
    runs, failures = [], []
    for each in found:
        if isinstance(each, InputError):
            failures.append(str(each))
        else:
            runs.append(each)
    with sender.server:
        reason, pending = sender.send_all(runs, run, failures)
    for sentence in failures:
        hooks.complain(sentence)
    spooled = [*sender.spool.names(), *(run.name for run in pending)]
    if spooled and not reason:
        reason = f"{sender.spool.folder}: another process sends from this spool."
    return SendResult(tuple(sender.sent), tuple(sender.rejected), tuple(failures), tuple(spooled), reason)


def send_new(
    folder: Path,
    to: str,
    *,
    rule: RunRule = ANY_RUN,
    settings: SendSettings = USUAL_SETTINGS,
    hooks: SendHooks = SILENT,
) -> None:
    """Send each run of a folder when it is complete, until interrupted.

    Parameters
    ----------
    folder : Path
        Searched at any depth.
    to, rule, settings, hooks
        As for :func:`send`.

    Raises
    ------
    InputError
        If folder, URL, token or spool is wrong.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: is not a folder; give the one that contains the runs.")
    sender = _Sender(to, settings, hooks)
    if sender.spool.folder.resolve().is_relative_to(folder.resolve()):
        raise InputError(f"{sender.spool.folder}: the spool must be outside of the watched folder (--spool).")
    watched = WatchedFolder(folder, rule, settings.settle, settings.timeout)
    with sender.server:
        sender.watch(watched)


class _Sender:
    """Spool and server, and the runs that went from one to the other."""

    def __init__(self, to: str, settings: SendSettings, hooks: SendHooks) -> None:
        address = check_address(to, plain=settings.plain_http)
        token = token_source(settings.token_file)
        token()  # a wrong one is an error of the command
        self.server = Server(address, token)
        self.spool = Spool(spool_folder(settings, address), settings.spool_limit)
        self.tries = settings.tries
        self.hooks = hooks
        self.sent: list[Answer] = []
        self.rejected: list[str] = []
        self._failures = 0
        self._complaints: dict[object, str] = {}

    def send_all(
        self, runs: Sequence[OutgoingRun], key: str | None, failures: list[str]
    ) -> tuple[str, list[OutgoingRun]]:
        """Spool and send as much as possible; why something waits, and runs that did not fit."""
        pending = list(runs)
        while True:
            pending, reason = self._spool_given(pending, key, failures)
            before = self.spool.waiting()
            delay = self._deliver()
            if delay is None:
                if not pending or before == 0:
                    return reason, pending
                continue  # there is room now
            wait = self._wait(delay)
            if delay.lasting or self._failures >= self.tries or wait > _PATIENCE:
                return str(delay), pending
            self._complain("server", str(delay))
            self.hooks.sleep(wait)

    def _spool_given(
        self, runs: Sequence[OutgoingRun], key: str | None, failures: list[str]
    ) -> tuple[list[OutgoingRun], str]:
        """Copy runs into the spool; those that do not fit, and why."""
        pending, reason = [], ""
        for run in runs:
            try:
                self.spool.put(run, key=key)
            except FullSpoolError as error:
                pending.append(run)
                reason = reason or str(error)
            except InputError as error:
                failures.append(str(error))
        return pending, reason

    def watch(self, watched: WatchedFolder) -> None:
        """Spool and send what is new, until interrupted."""
        pause = min(max(watched.settle / 2, 0.5), 10.0)
        next_attempt = self.hooks.clock()
        while True:
            now = self.hooks.clock()
            try:
                self._spool_new(watched, now)
                self._complaints.pop(watched.folder, None)
            except OSError as error:  # a share that is away
                self._complain(
                    watched.folder, f"{watched.folder}: cannot be read ({error.strerror or error})."
                )
            if now >= next_attempt and self.spool.waiting():
                delay = self._deliver()
                if delay is None:
                    self._complaints.pop("server", None)
                else:
                    next_attempt = now + self._wait(delay)
                    self._complain("server", f"{delay} {self.spool.waiting()} in the spool.")
            self.hooks.sleep(pause)

    def _spool_new(self, watched: WatchedFolder, now: float) -> None:
        for group, run in watched.scan(now):
            if isinstance(run, InputError):
                self._complain(group.source, str(run))
                continue
            if not group.complete:
                self._complain(group.source, f"{group.shortage} Sent as it is.")
            try:
                self._spool_once(run)
            except FullSpoolError as error:
                self._complain("spool", str(error))
                return
            except InputError as error:
                self._complain(group.source, str(error))
                continue
            watched.done(group)
            self._complaints.pop("spool", None)

    def _spool_once(self, run: OutgoingRun) -> None:
        """Copy a run into the spool unless it is known there."""
        state = self.spool.known_state(run)
        if not state and self.spool.put(run, links=False, again=False) is None:
            state = self.spool.known_state(run)
        if state == "rejected":
            self.hooks.complain(f"{run.name}: was refused before, and is in {self.spool.rejected}.")

    def _complain(self, subject: object, sentence: str) -> None:
        """Report a sentence unless it is the last one about its subject."""
        if self._complaints.get(subject) != sentence:
            self._complaints[subject] = sentence
            self.hooks.complain(sentence)

    def _wait(self, delay: DelayError) -> float:
        """Time to the next attempt: doubled after each failure, and at least what the server asks for."""
        if delay.lasting:
            return _LONGEST_WAIT
        doubled = min(_SHORTEST_WAIT * 2.0 ** min(self._failures - 1, 20), _LONGEST_WAIT)
        return max(doubled * (1 + self.hooks.random()) / 2, delay.wait or 0.0)

    def _deliver(self) -> DelayError | None:
        """Send what is in the spool once; why something could not be sent."""
        before = len(self.sent)
        try:
            with self.spool.sending() as locked:
                if locked:
                    delay = self._send_each()
                else:
                    delay = DelayError(f"{self.spool.folder}: another process sends from this spool.")
        except OSError as error:
            delay = DelayError(f"{self.spool.folder}: {error.strerror or error}.")
        except InputError as error:
            delay = DelayError(f"{self.spool.folder}: {error}")
        if delay is None or len(self.sent) > before:
            self._failures = 0
        if delay is not None:
            self._failures += 1
        return delay

    def _send_each(self) -> DelayError | None:
        self.server.authorise()
        delay = None
        for run in self.spool.runs(self._refuse):
            try:
                answer = self.server.send(run, self._progress(run))
            except RefusalError as error:
                self._reject(run, error)
            except DelayError as error:
                if delay is None or delay.lasting or error.general:
                    delay = error
                if error.general:
                    break
            else:
                self.spool.finish(run)
                self.sent.append(answer)
                self.hooks.report(answer)
        return delay

    def _reject(self, run: SpooledRun, error: RefusalError) -> None:
        place = self.spool.reject(run.folder, str(error))
        self._refuse(f"{run.name}: refused: {error} (its copy is in {place})")

    def _refuse(self, sentence: str) -> None:
        self.rejected.append(sentence)
        self.hooks.complain(sentence)

    def _progress(self, run: SpooledRun) -> Callable[[int], None]:
        total = sum(file.size for file in run.uploads) // _MEGABYTE

        def uploaded(size: int) -> None:
            self.hooks.progress(size // _MEGABYTE, total, f"MB of {Path(run.name).name}")

        return uploaded
