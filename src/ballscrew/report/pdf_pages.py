"""A report as PDF: blocks laid out on A4 pages by the widths of their letters, without a browser."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

from ballscrew.base.files import Progress, ignore_progress, replacing
from ballscrew.report import blocks, canvas
from ballscrew.report.a4 import (
    HEIGHT,
    INCH,
    SOFT,
    TEXT,
    WIDTH,
    Drawing,
    bar_at,
    pitch,
    rise,
    strip_at,
    words_at,
    wrapped,
)
from ballscrew.report.canvas import Figure

_MARGIN, _RIGHT, _TOP, _BOTTOM = 15.0, 282.0, 12.0, 198.0
_FOOT = 203.5
_SIZE, _SMALL, _CELL = 9.5, 7.2, 7.8  # points
_RULE = "#dddddd"
_GAP = 2.6  # mm between two columns
_INDENT = 4.0  # mm of an item
_MARK = 4.2  # mm of the sign of a state
_MEASURE = 200.0  # mm, longest line of a sentence
_MOST_LINES = 24  # of a cell; its whole text is in the HTML report
_LEAST_PICTURE = 0.5  # of its height; where there is less room, it is on the next page


def write_pdf(
    path: str | Path, title: str, content: Sequence[blocks.ReportBlock], progress: Progress = ignore_progress
) -> int:
    """Write a report as PDF; the same report gives the same file.

    Parameters
    ----------
    path : path-like
        File to write, whole or not at all.
    title : str
        Its title, also at the foot of each page.
    content : sequence of ReportBlock
        Its parts.
    progress : callable
        Called after each page.

    Returns
    -------
    int
        Number of pages.

    Raises
    ------
    InputError
        If matplotlib is not installed, or the file cannot be written.
    """
    with canvas.styled():
        from matplotlib import rc_context
        from matplotlib.backends.backend_pdf import PdfPages

        layout = _Layout()
        for block in content:
            layout.add(block)
        written = BytesIO()
        metadata = {"Title": title, "Creator": "ballscrew", "CreationDate": None}
        number = len(layout.pages)
        with rc_context({"pdf.fonttype": 42}), PdfPages(written, metadata=metadata) as pages:
            for index, page in enumerate(layout.pages):
                pages.savefig(_page(page, title, index + 1, number))
                progress(index + 1, number, f"page {index + 1}")
    with replacing(path) as temporary:
        temporary.write_bytes(written.getvalue())
    return number


def _page(drawings: Iterable[Drawing], title: str, number: int, total: int) -> Figure:
    """Figure of a page, with its foot."""
    figure = canvas.blank(WIDTH / INCH, HEIGHT / INCH)
    for draw in drawings:
        draw(figure)
    words_at(title, _MARGIN, _FOOT, _SMALL, colour=SOFT)(figure)
    words_at(f"{number} of {total}", _RIGHT, _FOOT, _SMALL, colour=SOFT, align="right")(figure)
    return figure


class _Layout:
    """Pages that are filled from top to bottom.

    Attributes
    ----------
    pages : list of list of Drawing
        What is drawn on each page.
    y : float
        Upper end of the free part of the last page, mm from its top.
    """

    def __init__(self) -> None:
        self.pages: list[list[Drawing]] = [[]]
        self.y = _TOP
        self._numbers: dict[str, int] = {}

    def add(self, block: blocks.ReportBlock) -> None:
        """Add a block, on further pages if need be."""
        match block:
            case blocks.PageHeading():
                self._heading(block)
            case blocks.SectionHeading(text):
                self._reserve(24.0)
                self.y += 3.0
                self._lines([text], 11.5, weight="bold")
                self.y += 0.6
            case blocks.StateWords():
                self._conclusion(block)
            case blocks.Sentences(text, soft):
                size, colour = (_SMALL, SOFT) if soft else (_SIZE, TEXT)
                self.y += 1.0
                self._lines(wrapped(text, _MEASURE, size), size, colour=colour)
            case blocks.ItemList(texts):
                for text in texts:
                    lines = wrapped(text, _MEASURE - _INDENT, _SIZE)
                    self._reserve(pitch(_SIZE))
                    self._draw(words_at("•", _MARGIN + 0.5, self.y + rise(_SIZE), _SIZE))
                    self._lines(lines, _SIZE, left=_MARGIN + _INDENT)
                    self.y += 0.5
            case blocks.ReportTable():
                self._table(block)
            case blocks.DrawnPicture():
                self._picture(block)

    def _draw(self, drawing: Drawing) -> None:
        self.pages[-1].append(drawing)

    def _begin_page(self) -> None:
        if self.pages[-1]:
            self.pages.append([])
        self.y = _TOP

    def _reserve(self, height: float) -> None:
        """Begin a page where the last one has less room."""
        if self.y + height > _BOTTOM:
            self._begin_page()

    def _lines(
        self,
        lines: Sequence[str],
        size: float,
        *,
        left: float = _MARGIN,
        colour: str = TEXT,
        weight: str = "normal",
    ) -> None:
        for line in lines:
            self._reserve(pitch(size))
            self._draw(words_at(line, left, self.y + rise(size), size, colour=colour, weight=weight))
            self.y += pitch(size)

    def _heading(self, block: blocks.PageHeading) -> None:
        self._begin_page()
        self._numbers[block.anchor] = len(self.pages)
        self._lines(wrapped(block.text, _RIGHT - _MARGIN, 17, bold=True), 17, weight="bold")
        self._lines(wrapped(block.below, _RIGHT - _MARGIN, _SIZE), _SIZE, colour=SOFT)

    def _conclusion(self, block: blocks.StateWords) -> None:
        """State in one line, set off by its colour and sign."""
        size, left = 11.5, _MARGIN + 4.0
        sign, colour = blocks.look_of(block.lamp)
        lines = wrapped(block.words, _RIGHT - left - 7.0, size, bold=True)
        height = len(lines) * pitch(size)
        self._reserve(height + 6.0)
        self.y += 3.0
        self._draw(bar_at(_MARGIN, self.y - 0.6, 1.8, height + 1.2, colour))
        self._draw(words_at(sign, left, self.y + rise(size), 15, colour=colour))
        self._lines(lines, size, left=left + 7.0, weight="bold")
        self.y += 2.0

    def _picture(self, block: blocks.DrawnPicture) -> None:
        self._reserve(_LEAST_PICTURE * block.height)
        top, height = self.y + 2.0, min(_BOTTOM - self.y - 2.0, block.height)

        def draw(figure: Figure) -> None:
            widths = (_MARGIN, _RIGHT - _MARGIN, WIDTH - _RIGHT)
            heights = (top, height, HEIGHT - top - height)
            grid = figure.add_gridspec(3, 3, wspace=0, hspace=0, width_ratios=widths, height_ratios=heights)
            block.draw(figure.add_subfigure(grid[1, 1]))

        self._draw(draw)
        self.y = top + height

    def _table(self, table: blocks.ReportTable) -> None:
        slots = _slots(table.columns)
        self.y += 1.5
        self._reserve(_head_height(slots) + 3 * pitch(_CELL))
        self._head(slots)
        for cells in table.rows:
            lines = []
            for cell, slot in zip(cells, slots, strict=True):
                lines.append(_cell_lines(cell, slot.width))
            height = max(map(len, lines)) * pitch(_CELL) + 1.6
            if self.y + height > _BOTTOM:
                self._begin_page()
                self._head(slots)
            for cell, texts, slot in zip(cells, lines, slots, strict=True):
                self._cell(cell, texts, slot)
            self.y += height
            self._draw(bar_at(_MARGIN, self.y - 0.2, _RIGHT - _MARGIN, 0.15, _RULE))
        self.y += 1.5

    def _head(self, slots: Sequence[_Slot]) -> None:
        """Headings of a table, the last lines of all at the same height."""
        height = _head_height(slots)
        if not height:
            return
        look: Any = {"colour": SOFT, "weight": "bold"}
        for slot in slots:
            y = self.y + height - 1.5 - len(slot.title) * pitch(_SMALL)
            for line in slot.title:
                self._draw(words_at(line, slot.edge, y + rise(_SMALL), _SMALL, align=slot.align, **look))
                y += pitch(_SMALL)
        self.y += height
        self._draw(bar_at(_MARGIN, self.y - 0.5, _RIGHT - _MARGIN, 0.25, SOFT))

    def _cell(self, cell: blocks.TableCell, lines: Sequence[str], slot: _Slot) -> None:
        x, y, weight = slot.edge, self.y + 0.7, "normal"
        match cell:
            case blocks.StateStrip():
                self._draw(strip_at(cell, x, y - 0.2, slot.width))
            case blocks.StateWords(lamp, _):
                sign, colour = blocks.look_of(lamp)
                self._draw(words_at(sign, x, y + rise(_CELL), _CELL + 2, colour=colour))
                x, weight = x + _MARK, "bold"
            case blocks.AxisLink(_, anchor):
                below = y + (len(lines) - 1) * pitch(_CELL) + rise(_CELL)
                self._draw(_page_number(self._numbers, anchor, x, below))
        for line in lines:
            self._draw(words_at(line, x, y + rise(_CELL), _CELL, weight=weight, align=slot.align))
            y += pitch(_CELL)


@dataclass(frozen=True, slots=True)
class _Slot:
    """A column of a table in its place.

    Parameters
    ----------
    title : list of str
        Lines of its heading.
    left, width : float
        mm.
    is_right : bool
        Whether its texts are aligned right.
    """

    title: list[str]
    left: float
    width: float
    is_right: bool

    @property
    def edge(self) -> float:
        """Where its texts begin, or end."""
        return self.left + self.width * self.is_right

    @property
    def align(self) -> str:
        """How its texts are aligned."""
        return "right" if self.is_right else "left"


def _slots(columns: Sequence[blocks.TableColumn]) -> list[_Slot]:
    """Columns over the whole width of a page."""
    total = sum(column.width for column in columns)
    share = (_RIGHT - _MARGIN - _GAP * (len(columns) - 1)) / total
    slots, left = [], _MARGIN
    for column in columns:
        width = share * column.width
        slots.append(_Slot(wrapped(column.title, width, _SMALL, bold=True), left, width, column.right))
        left += width + _GAP
    return slots


def _head_height(slots: Sequence[_Slot]) -> float:
    """Height of the headings of a table; 0 where all are empty."""
    if not any(any(slot.title) for slot in slots):
        return 0.0
    return max(len(slot.title) for slot in slots) * pitch(_SMALL) + 1.5


def _cell_lines(cell: blocks.TableCell, width: float) -> list[str]:
    """Lines of a cell; the last one of a link is for the number of its page."""
    match cell:
        case blocks.StateStrip():
            return ["", ""]
        case blocks.StateWords(_, words):
            return wrapped(words, width - _MARK, _CELL, bold=True)
        case blocks.AxisLink(name, _):
            return [*wrapped(name, width, _CELL), ""]
        case _:
            lines = wrapped(cell, width, _CELL)
            if len(lines) > _MOST_LINES:
                lines = [*lines[: _MOST_LINES - 1], "…"]
            return lines


def _page_number(numbers: dict[str, int], anchor: str, x: float, y: float) -> Drawing:
    """Number of the page of an axis, which is known only when all are laid out."""

    def draw(figure: Figure) -> None:
        words_at(f"page {numbers[anchor]}", x, y, _SMALL, colour=SOFT)(figure)

    return draw
