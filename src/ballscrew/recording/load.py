"""Reading of a file, by a channel map, into a recording."""

from __future__ import annotations

from pathlib import Path

from ballscrew.base.provenance import FileRef, hash_file
from ballscrew.recording.channels import ChannelMap
from ballscrew.recording.convert import check_sources, convert
from ballscrew.recording.readers.process import opened
from ballscrew.recording.recording import Recording, make_recording


def read_recording(path: str | Path, channels: ChannelMap) -> Recording:
    """Read the mapped channels of a file, and no others, into SI.

    Parameters
    ----------
    path : path-like
        The file, of any format with a reader.
    channels : ChannelMap
        Meaning of the channels.

    Returns
    -------
    Recording
        With the file's SHA-256.

    Raises
    ------
    InputError
        If no reader can read the file, a channel is not in it, has too few samples or another length than
        those of the same rate, or no rate can be found.
    """
    path = Path(path)
    sources = list(dict.fromkeys(channel.source for channel in channels.channels))
    with opened(path) as source:
        digest = hash_file(path)
        header = source.header
        check_sources(path, header, channels)
        raw = source.read(sources)
    converted = convert(path, header, channels, raw)
    file = FileRef(path.name, digest)
    return make_recording(converted, file, header.reader or source.reader, header.started_at)
