"""Parts of a report from which its HTML page and its PDF are made, so that both show the same."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from ballscrew.base.errors import printable
from ballscrew.report.canvas import STATE_COLOURS, STATE_SIGNS, FigureBase

UNKNOWN, TROUBLE = "unknown", "trouble"
_UNKNOWN_LOOK, _TROUBLE_LOOK = ("○", "#767676"), ("▲", "#9a6700")
_LONGEST = 60  # characters of a name
_CUT = "…"
_HEIGHTS = {"alarm": 1.0, "unloaded": 1.0, "watch": 0.75, "suspect": 0.3}
_OTHER_HEIGHT = 0.45


@dataclass(frozen=True, slots=True)
class StateWords:
    """A state in words, with its sign and colour.

    Parameters
    ----------
    lamp : str
        State whose sign and colour it has, or *trouble* with a measurement; one that has none is *unknown*.
    words : str
        The words.
    """

    lamp: str
    words: str


@dataclass(frozen=True, slots=True)
class StateStrip:
    """States of an axis in a period, as a strip.

    Parameters
    ----------
    parts : tuple of (float, float, str)
        Begin and end, relative to the period, and state; nothing is known in between.
    """

    parts: tuple[tuple[float, float, str], ...]


@dataclass(frozen=True, slots=True)
class AxisLink:
    """Name of an axis that leads to its page.

    Parameters
    ----------
    name : str
        The name.
    anchor : str
        Of its heading.
    """

    name: str
    anchor: str


TableCell = str | StateWords | StateStrip | AxisLink


@dataclass(frozen=True, slots=True)
class TableColumn:
    """A column of a table.

    Parameters
    ----------
    title : str
        Heading.
    width : float
        Width relative to the other columns.
    right : bool
        Whether it contains numbers, aligned right.
    """

    title: str
    width: float
    right: bool = False


@dataclass(frozen=True, slots=True)
class ReportTable:
    """A table.

    Parameters
    ----------
    columns : tuple of TableColumn
        From left to right.
    rows : tuple of tuple of TableCell
        From top to bottom.
    """

    columns: tuple[TableColumn, ...]
    rows: tuple[tuple[TableCell, ...], ...]


@dataclass(frozen=True, slots=True)
class PageHeading:
    """Heading of a page, which begins there.

    Parameters
    ----------
    text : str
        Title.
    below : str
        Smaller line below it.
    anchor : str
        Its name in the file.
    """

    text: str
    below: str
    anchor: str


@dataclass(frozen=True, slots=True)
class SectionHeading:
    """Heading of a section.

    Parameters
    ----------
    text : str
        Title.
    """

    text: str


@dataclass(frozen=True, slots=True)
class Sentences:
    """Sentences.

    Parameters
    ----------
    text : str
        Plain text.
    soft : bool
        Whether it is grey.
    """

    text: str
    soft: bool = False


@dataclass(frozen=True, slots=True)
class ItemList:
    """Items, each with a bullet.

    Parameters
    ----------
    texts : tuple of str
        Plain texts.
    """

    texts: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class DrawnPicture:
    """A picture.

    Parameters
    ----------
    draw : callable
        Draws it on an empty figure, or on a part of one, that has a layout engine.
    caption : str
        What it shows.
    height : float
        Greatest height on a page, mm.
    """

    draw: Callable[[FigureBase], None]
    caption: str
    height: float


ReportBlock = PageHeading | SectionHeading | StateWords | Sentences | ItemList | ReportTable | DrawnPicture


def look_of(state: str) -> tuple[str, str]:
    """Sign and colour of a state; those of *unknown* where it has none."""
    if state in STATE_COLOURS:
        return STATE_SIGNS[state], STATE_COLOURS[state]
    if state == TROUBLE:
        return _TROUBLE_LOOK
    return _UNKNOWN_LOOK


def height_of(state: str) -> float:
    """Height of a state in a strip, relative to the strip: a shape besides the colour."""
    return _HEIGHTS.get(state, _OTHER_HEIGHT)


def short_name(name: str) -> str:
    """A name on one line, without control characters, cut where it is very long."""
    if len(name) > _LONGEST:
        name = name[: _LONGEST - 1] + _CUT
    return single_line(name)


def single_line(text: str) -> str:
    """A text on one line, with control characters and directions of writing escaped."""
    return printable(re.sub(r"[\t\r\n]+", " ", text))


def listed(texts: Sequence[str]) -> list[ReportBlock]:
    """Items, or nothing where there are none."""
    if not texts:
        return []
    return [ItemList(tuple(texts))]
