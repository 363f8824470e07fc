"""Answers about the raw signals of a run, down to the sample."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from fastapi import APIRouter, Query
from fastapi.responses import JSONResponse
from sqlalchemy.orm import Session

from ballscrew.base.errors import InputError, shown
from ballscrew.base.jsonfile import SCHEMA, plain
from ballscrew.base.provenance import digest
from ballscrew.recording.channels import read_channels
from ballscrew.recording.envelope import read_envelope, write_envelope
from ballscrew.recording.load import read_recording
from ballscrew.recording.quantities import INPUTS
from ballscrew.recording.recording import Recording
from ballscrew.service.access import RunningService, ViewerCaller
from ballscrew.service.on_demand import Signals, not_yet
from ballscrew.service.serving import RefusedError
from ballscrew.service.stored_runs import RAW_GONE, StoredRun, locate_run, recordings_of, stated_of
from ballscrew.store.raw_files import materialised, text_files

router = APIRouter(prefix="/api/v1/runs/{run}")

_ALIGNED = (*INPUTS, "position", "acceleration")  # quantities that an analysis aligns

Place = Annotated[int, Query(ge=0, le=100_000)]
Seconds = Annotated[float | None, Query(ge=-1e9, le=1e9, allow_inf_nan=False)]


@dataclass(frozen=True, slots=True)
class SignalTask:
    """Signals of a raw file, as plain data for a process.

    Parameters
    ----------
    store_folder : str
        Folder of raw files.
    file : (name, sha256, compression)
        The file.
    channels : str
        Text of the channel map.
    """

    store_folder: str
    file: tuple[str, str, str]
    channels: str

    def write(self, folder: Path) -> None:
        """Write ``about.json`` and a folder for each channel, by its number."""
        with (
            text_files({"channels": self.channels}) as texts,
            materialised(Path(self.store_folder), [self.file]) as (path,),
        ):
            try:
                recording = read_recording(path, read_channels(texts["channels"]))
            except InputError as error:
                raise InputError(str(error).replace(str(path), path.name)) from None
        origin = _origin(recording)
        channels = []
        for number, (name, values) in enumerate(recording.channels.items()):
            samples = values.to_numpy()
            write_envelope(folder / str(number), samples)
            about = values.attrs
            begin = (about["start"] or 0.0) - origin
            channels.append(
                {
                    "name": name, "quantity": about["quantity"], "unit": about["unit"], "begin_s": begin,
                    "sample_rate_Hz": about["sample_rate"], "samples": len(samples),
                    "not_finite": int(np.count_nonzero(~np.isfinite(samples))),
                }
            )  # fmt: skip
        (folder / "about.json").write_text(json.dumps({"channels": channels, "notes": recording.notes}))


def _origin(recording: Recording) -> float:
    """Time from which those of transients count: all channels that an analysis aligns have begun."""
    origin = 0.0
    for values in recording.channels.values():
        if values.attrs["quantity"] in _ALIGNED:
            origin = max(origin, values.attrs["start"] or 0.0)
    return origin


@router.get("/signals", response_model=None)
def show_signals(
    run: str,
    caller: ViewerCaller,  # noqa: ARG001
    service: RunningService,
    results: Signals,
    file: Place = 0,
    channel: str | None = None,
    begin: Annotated[Seconds, Query(alias="from")] = None,
    end: Annotated[Seconds, Query(alias="to")] = None,
    points: Annotated[int, Query(ge=2, le=10_000)] = 1000,
) -> dict[str, Any] | JSONResponse:
    """Channels of a raw file of a run; with ``channel``, its samples from a time to another.

    Times are in seconds from the file's first sample. Where there are more samples than twice ``points``,
    ``low`` and ``high`` are the lowest and highest of as many blocks as ``points``. 202 while the file is
    being read.
    """
    with service.store.read() as session:
        found = locate_run(session, run)
        task = _signal_task(session, found, file, str(service.store.folder.files.resolve()))
    key = digest([*task.file[:2], task.channels])[:32]  # the name too: a reader may be chosen by it
    folder = results.find(key, task)
    if folder is None:
        return not_yet("the file is being read.")
    try:
        about: dict[str, Any] = json.loads((folder / "about.json").read_text())
        document = {"schema": SCHEMA, "run": found.id, "file": file, "file_name": task.file[0]}
        if channel is None:
            return document | about
        names = [each["name"] for each in about["channels"]]
        if channel not in names:
            raise RefusedError(404, f"the file has no channel {shown(channel)}.")
        number = names.index(channel)
        part = _part(folder / str(number), about["channels"][number], begin, end, points)
    except OSError:  # it was removed meanwhile, as the oldest
        return not_yet("the file is being read.")
    return document | part


def _signal_task(session: Session, found: StoredRun, file: int, folder: str) -> SignalTask:
    recordings, stated = recordings_of(session, found), stated_of(session, found)
    if file >= len(recordings):
        raise RefusedError(404, f"the run has {len(recordings)} files, and none of the number {file}.")
    recording = recordings[file]
    if recording.compression is None or stated is None:
        raise RefusedError(404, f"{RAW_GONE}: {shown(recording.name)}.")
    return SignalTask(
        folder, (recording.name, recording.sha256, recording.compression), stated[1]["channels"]
    )


def _part(
    folder: Path, about: dict[str, Any], begin: float | None, end: float | None, points: int
) -> dict[str, Any]:
    """Samples of a channel from a time to another, and one more on either side, so that a line has no end."""
    rate, start, count = about["sample_rate_Hz"], about["begin_s"], about["samples"]
    first, stop = 0, count
    if begin is not None:
        first = min(max(math.floor((begin - start) * rate), 0), count - 1)
    if end is not None:
        stop = min(max(math.ceil((end - start) * rate) + 1, first + 1), count)
    part = read_envelope(folder, first, stop, points)
    middle = part.first
    if not part.has_samples:  # the middle of each block
        middle = (part.first + np.append(part.first[1:], part.end) - 1) / 2
    document = about | {
        "each_sample": part.has_samples,
        "time_s": start + middle / rate,
        "low": part.low,
        "high": None if part.has_samples else part.high,
    }
    result: dict[str, Any] = plain(document, 12)
    return result
