"""``ballscrew analyze --explain``: the result of one cell and its evidence."""

from __future__ import annotations

import re
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from rich.markup import escape

from ballscrew.base.errors import InputError
from ballscrew.base.jsonfile import SCHEMA, plain
from ballscrew.base.units import parse
from ballscrew.cli.output import VERDICT_STYLE, console, print_json
from ballscrew.fcft.conditions import Condition
from ballscrew.modal.analyze import Analysis
from ballscrew.modal.evidence import Evidence, evidence, find_cell
from ballscrew.report.canvas import save_figure
from ballscrew.report.explain_words import Paragraph, explain, headline

_FORM = 'it must be position, condition and perhaps motion, such as "45mm:PD" or "45mm:PD:1"'


@dataclass(frozen=True, slots=True)
class CellSelection:
    """Cell to explain.

    Parameters
    ----------
    position : float
        Position of the stop, m.
    condition : str
        PA, PD, NA or ND.
    motion : int
        Index of the motion, from 0.
    """

    position: float
    condition: str
    motion: int


def parse_cell(text: str) -> CellSelection:
    """Cell that a text of the command line selects.

    Parameters
    ----------
    text : str
        ``"45mm:PD"`` or ``"45mm:PD:1"``.

    Returns
    -------
    CellSelection
        Position, condition and motion; the run may lack such a cell.

    Raises
    ------
    InputError
        If it cannot be read.
    """
    place, *rest = map(str.strip, text.split(":"))
    if len(rest) not in (1, 2):
        raise InputError(f"--explain is {text!r}; {_FORM}.")
    if not any(letter.isalpha() for letter in place):
        raise InputError(f"--explain is {text!r}; the position needs its unit, such as 45mm.")
    try:
        position = parse(place, "m")
    except InputError as error:
        raise InputError(f"--explain is {text!r}: {str(error).rstrip('.')}; {_FORM}.") from None
    condition = rest[0].upper()
    if condition not in list(Condition):
        raise InputError(f"--explain is {text!r}; the condition must be one of {', '.join(Condition)}.")
    number = rest[1] if len(rest) == 2 else "0"
    if re.fullmatch("[0-9]{1,5}", number) is None:
        raise InputError(f"--explain is {text!r}; the motion must be a whole number, 0 for the first.")
    return CellSelection(position, condition, int(number))


def explain_cell(analysis: Analysis, cell: CellSelection, *, as_json: bool, plot: Path | None) -> None:
    """Print, and plot, the evidence for the result of a cell.

    Parameters
    ----------
    analysis : Analysis
        Run with its transients.
    cell : CellSelection
        Cell of the run.
    as_json : bool
        Whether to print JSON.
    plot : Path or None
        File for the picture.

    Raises
    ------
    InputError
        If there is no such cell.
    """
    result = find_cell(analysis.run, cell.position, cell.condition, cell.motion)
    found = evidence(analysis.run, result, analysis.paper, analysis.transients)
    if plot is not None:
        from ballscrew.report.explain_figure import draw_explanation

        save_figure(draw_explanation(found), plot)
    paragraphs = explain(found)
    if as_json:
        print_json(_document(found, paragraphs))
    else:
        _print(found, paragraphs)


def _document(found: Evidence, paragraphs: tuple[Paragraph, ...]) -> dict[str, Any]:
    words = [{"title": p.title, "before": p.before, "lines": p.lines} for p in paragraphs]
    document: dict[str, Any] = plain(
        {
            "schema": SCHEMA,
            "id": found.run.id,
            "cell": asdict(found.cell),
            "paper": asdict(found.paper),
            "transients": {"found": found.found, "whole": found.whole},
            "words": words,
            "made": asdict(found.run.made),
        }
    )
    return document


def _print(found: Evidence, paragraphs: tuple[Paragraph, ...]) -> None:
    screen = console()
    style = VERDICT_STYLE[found.cell.verdict]
    screen.print(f"[bold]{escape(headline(found))}[/]: [bold {style}]{found.cell.verdict}[/]")
    for paragraph in paragraphs:
        screen.print()
        screen.print(f"[bold]{escape(paragraph.title)}[/]")
        if paragraph.before:
            screen.print(f"  {paragraph.before}", markup=False)
        bullet = "  • " if paragraph.listed else "  "
        for line in paragraph.lines:
            screen.print(f"{bullet}{line}", markup=False)
