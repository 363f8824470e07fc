"""Header of a file, read before its samples."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class RawChannel:
    """One channel as the file has it.

    Parameters
    ----------
    name : str
        Its name; what lies in groups or structs has a path, ``"group/acc1_x"``.
    size : int
        Number of samples; of a text file, lines of the table.
    unit : str, optional
        The unit that the file gives, as written there.
    sample_rate : float, optional
        The rate that the file gives for this channel, Hz, unchecked.
    start : float, optional
        Time of its first sample since the start of the recording, s, in a file that has times for each
        channel: its channels may then begin and end at different times.
    scaled : bool
        False where the values are counts, or shares of a full scale that the file does not give.
    """

    name: str
    size: int
    unit: str | None = None
    sample_rate: float | None = None
    start: float | None = None
    scaled: bool = True


@dataclass(frozen=True, slots=True)
class Header:
    """All that a file says about itself.

    Parameters
    ----------
    channels : tuple of RawChannel
        In the order of the file.
    sample_rate : float, optional
        The rate that the file gives for all channels, Hz, unchecked.
    started_at : str, optional
        When the recording began, as written in the file.
    reader : str
        Name of the reader that read it.
    """

    channels: tuple[RawChannel, ...]
    sample_rate: float | None = None
    started_at: str | None = None
    reader: str = ""
