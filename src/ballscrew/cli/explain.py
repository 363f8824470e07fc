"""``ballscrew analyze --explain``: which cell is meant, and what speaks for its number."""

from __future__ import annotations

import textwrap
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
from ballscrew.report.explain_words import Paragraph, explain, headline

__all__ = ["Wanted", "explain_cell", "wanted"]

_WIDTH = 100
_FORM = 'it must be position, condition and perhaps motion, such as "45mm:PD" or "45mm:PD:1"'


@dataclass(frozen=True, slots=True)
class Wanted:
    """The cell that is to be explained.

    Parameters
    ----------
    position : float
        m.
    condition : str
        PA, PD, NA or ND.
    motion : int
        From 0.
    """

    position: float
    condition: str
    motion: int


def wanted(text: str) -> Wanted:
    """Read which cell is meant.

    Parameters
    ----------
    text : str
        ``"45mm:PD"`` or ``"45mm:PD:1"``.

    Returns
    -------
    Wanted
        The cell; nobody knows yet whether there is one.

    Raises
    ------
    InputError
        If it cannot be read.
    """
    place, *rest = (part.strip() for part in text.split(":"))
    if not 1 <= len(rest) <= 2:
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
    if not (number.isascii() and number.isdigit() and len(number) < 6):
        raise InputError(f"--explain is {text!r}; the motion must be a whole number, 0 for the first.")
    return Wanted(position, condition, int(number))


def explain_cell(analysis: Analysis, cell: Wanted, *, as_json: bool, plot: Path | None) -> None:
    """Print, and draw, why the number of a cell is what it is.

    Parameters
    ----------
    analysis : Analysis
        The run, with its transients.
    cell : Wanted
        One of its cells.
    as_json : bool
        Print JSON.
    plot : Path or None
        Where the picture goes.

    Raises
    ------
    InputError
        If there is no such cell.
    """
    named = find_cell(analysis.run, cell.position, cell.condition, cell.motion)
    told = evidence(analysis.run, named, analysis.paper, analysis.transients)
    if plot is not None:
        from ballscrew.report.canvas import save_figure
        from ballscrew.report.explain_figure import draw_explanation

        save_figure(draw_explanation(told), plot)
    paragraphs = explain(told)
    if as_json:
        print_json(_document(told, paragraphs))
    else:
        _print(told, paragraphs)


def _document(told: Evidence, paragraphs: tuple[Paragraph, ...]) -> dict[str, Any]:
    document = {
        "schema": SCHEMA,
        "id": told.run.id,
        "cell": asdict(told.cell),
        "paper": asdict(told.paper),
        "transients": {"found": told.found, "whole": told.whole},
        "words": [{"title": each.title, "before": each.before, "lines": each.lines} for each in paragraphs],
        "made": asdict(told.run.made),
    }
    result: dict[str, Any] = plain(document)
    return result


def _print(told: Evidence, paragraphs: tuple[Paragraph, ...]) -> None:
    out = console()
    style = VERDICT_STYLE[told.cell.verdict]
    out.print(f"[bold]{escape(headline(told))}[/]: [bold {style}]{told.cell.verdict}[/]")
    for each in paragraphs:
        out.print()
        out.print(f"[bold]{escape(each.title)}[/]")
        if each.before:
            out.print(
                textwrap.fill(each.before, _WIDTH, initial_indent="  ", subsequent_indent="  "), markup=False
            )
        for line in each.lines:
            first, rest = ("  • ", "    ") if each.listed else ("  ", "  ")
            text = textwrap.fill(
                line, _WIDTH, initial_indent=first, subsequent_indent=rest,
                break_long_words=False, break_on_hyphens=False,
            )  # fmt: skip
            out.print(text, markup=False, soft_wrap=True)
