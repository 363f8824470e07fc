"""Self-contained HTML: a page with conclusion, text, a table and pictures beside it; a report."""

from __future__ import annotations

import re
from base64 import b64encode
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path
from tempfile import TemporaryDirectory

from ballscrew.base.errors import InputError
from ballscrew.report import blocks
from ballscrew.report.canvas import STATE_SIGNS, Figure, blank, check_drawing, save_figure, styled

_DAY = re.compile(r"\b\d{4}-\d\d-\d\d\b(\s\d\d:\d\d)?")  # would be divided at its hyphens
_PICTURE_WIDTH = 267.0  # mm, that of a page of a PDF
_STYLE = """
:root { color-scheme: light dark; --text: #222; --soft: #555; --line: #ddd; --back: #fff; }
@media (prefers-color-scheme: dark) { :root { --text: #ddd; --soft: #aaa; --line: #444; --back: #1b1b1b; } }
body { font: 16px/1.5 system-ui, sans-serif; color: var(--text); background: var(--back); }
body { max-width: 60rem; margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.6rem; } img { max-width: 100%; height: auto; background: #fff; }
.conclusion { font-size: 1.15rem; font-weight: 600; border-left: 0.4rem solid var(--lamp, var(--soft)); }
.conclusion { padding-left: 0.8rem; } .lamp { color: var(--lamp); font-size: 1.6em; line-height: 0; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; margin: 1rem 0; font-variant-numeric: tabular-nums; }
th, td { padding: 0.25rem 0.8rem; text-align: right; border-bottom: 1px solid var(--line); }
.words th, .words td { text-align: left; vertical-align: top; }
figure { margin: 2rem 0; } figcaption { color: var(--soft); }
@media (max-width: 40rem) {
  body { margin: 1rem auto; } h1 { font-size: 1.3rem; } th, td { padding: 0.25rem 0.5rem; }
  figure .wide img { max-width: none; width: 44rem; }
}
"""

_REPORT_STYLE = """
body { max-width: 84rem; font-size: 15px; overflow-wrap: break-word; }
h1 { margin: 3rem 0 0; overflow-wrap: anywhere; } h1:first-of-type { margin-top: 0; }
h2 { font-size: 1.1rem; margin: 1.6rem 0 0.3rem; } .soft { color: var(--soft); } p.soft { margin-top: 0; }
th, td { text-align: left; vertical-align: top; padding: 0.3rem 0.9rem 0.3rem 0; }
th { color: var(--soft); font-weight: 600; font-size: 0.9em; vertical-align: bottom; }
table { width: 100%; font-size: 0.92em; } .number { text-align: right; }
.state { font-weight: 600; } .sign { font-size: 1.15em; } svg.strip { width: 13rem; height: 1.4rem; }
svg.strip { background: color-mix(in srgb, var(--line) 40%, transparent); vertical-align: top; }
ul { margin: 0.4rem 0; padding-left: 1.3rem; max-width: 60rem; } figure { margin: 1rem 0; }
figure img { max-width: 62rem; width: 100%; } a { color: inherit; }
.wide td { min-width: 6.5rem; max-width: 44rem; overflow-wrap: anywhere; }
.day { white-space: nowrap; } .wide td.number { min-width: 0; white-space: nowrap; }
@media print {
  :root { --text: #222; --soft: #555; --line: #ddd; --back: #fff; }
  @page { size: A4 landscape; margin: 12mm; } body { margin: 0; max-width: none; font-size: 9pt; }
  h1 { break-before: page; margin: 0; } h1:first-of-type { break-before: auto; }
  h2 { break-after: avoid; } tr, figure { break-inside: avoid; } .wide { overflow: visible; }
  figure img { width: auto; max-height: 150mm; }
}
"""


def html_page(
    title: str,
    paragraphs: Sequence[str],
    pictures: Sequence[tuple[str, str]],
    heading: Sequence[str],
    rows: Sequence[Sequence[str]],
    *,
    conclusion: str = "",
    lamp: str = "",
    words: bool = False,
) -> str:
    """Page as HTML.

    Parameters
    ----------
    title : str
        Title of the page.
    paragraphs : sequence of str
        Plain text.
    pictures : sequence of (file, caption)
        Files beside the page.
    heading, rows
        Table.
    conclusion : str
        One line, set off before the text.
    lamp : str
        State whose sign and colour stand before the conclusion.
    words : bool
        Whether the table contains sentences, not numbers; it then stands before the pictures.

    Returns
    -------
    str
        HTML; all texts are escaped.
    """
    body = [f"<h1>{_escaped(title)}</h1>"]
    if conclusion:
        body.append(_conclusion(conclusion, lamp))
    body += [f"<p>{_escaped(text)}</p>" for text in paragraphs]
    figures = [_figure(file, caption) for file, caption in pictures]
    if words:
        body += [_table(heading, rows, ' class="words"'), *figures]
    else:
        body += [*figures, _table(heading, rows, "")]
    return _document(title, _STYLE, body)


def html_report(title: str, content: Iterable[blocks.ReportBlock]) -> str:
    """Report as HTML.

    Parameters
    ----------
    title : str
        Its title.
    content : iterable of ReportBlock
        Its parts.

    Returns
    -------
    str
        One file that loads no other; all texts are escaped. Without matplotlib it has no picture.
    """
    return _document(title, _STYLE + _REPORT_STYLE, map(_block, content))


def image_of(figure: Figure) -> str:
    """A figure as the address of an image."""
    with TemporaryDirectory(prefix="ballscrew-") as folder:
        path = Path(folder) / "axis.png"
        save_figure(figure, path)
        data = b64encode(path.read_bytes()).decode("ascii")
    return f"data:image/png;base64,{data}"


def _document(title: str, style: str, body: Iterable[str]) -> str:
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{_escaped(title)}</title><style>{style}</style></head>\n<body>\n"
        + "\n".join(body)
        + "\n</body></html>\n"
    )


def _block(block: blocks.ReportBlock) -> str:
    match block:
        case blocks.PageHeading(text, below, anchor):
            return f'<h1 id="{anchor}">{_escaped(text)}</h1><p class="soft">{_escaped(below)}</p>'
        case blocks.SectionHeading(text):
            return f"<h2>{_escaped(text)}</h2>"
        case blocks.StateWords(lamp, words):
            return _conclusion(words, lamp)
        case blocks.Sentences(text, soft):
            kind = ' class="soft"' * soft
            return f"<p{kind}>{_escaped(text)}</p>"
        case blocks.ItemList(texts):
            return f"<ul><li>{'</li><li>'.join(map(_escaped, texts))}</li></ul>"
        case blocks.ReportTable():
            return _report_table(block)
        case blocks.DrawnPicture():
            return _picture(block)


def _picture(picture: blocks.DrawnPicture) -> str:
    """A picture; nothing without matplotlib."""
    try:
        check_drawing()
    except InputError:
        return ""
    with styled():
        figure = blank(_PICTURE_WIDTH / 25.4, picture.height / 25.4)
        picture.draw(figure)
    return _figure(image_of(figure), picture.caption)


def _report_table(table: blocks.ReportTable) -> str:
    head = ""
    for column in table.columns:
        head += f"<th{_kind(column)}>{_escaped(column.title)}</th>"
    lines = []
    for row in table.rows:
        cells = ""
        for column, cell in zip(table.columns, row, strict=True):
            cells += f"<td{_kind(column)}>{_cell(cell)}</td>"
        lines.append(f"<tr>{cells}</tr>\n")
    body = "".join(lines)
    return f'<div class="wide"><table><thead><tr>{head}</tr></thead><tbody>\n{body}</tbody></table></div>'


def _kind(column: blocks.TableColumn) -> str:
    return ' class="number"' if column.right else ""


def _cell(cell: blocks.TableCell) -> str:
    match cell:
        case blocks.StateWords(lamp, words):
            sign, colour = blocks.look_of(lamp)
            mark = f'<span class="sign" style="color: {colour}" aria-hidden="true">{sign}</span>'
            return f'<span class="state">{mark}&nbsp;{_escaped(words)}</span>'
        case blocks.AxisLink(name, anchor):
            return f'<a href="#{anchor}">{_escaped(name)}</a>'
        case blocks.StateStrip(parts):
            bars = []
            for begin, end, state in parts:
                height = 100 * blocks.height_of(state)
                place = f'x="{1000 * begin:.1f}" y="{100 - height:.0f}" width="{1000 * (end - begin):.1f}"'
                bars.append(f'<rect {place} height="{height:.0f}" fill="{blocks.look_of(state)[1]}"/>')
            view = 'viewBox="0 0 1000 100" preserveAspectRatio="none" shape-rendering="crispEdges" role="img"'
            return f'<svg class="strip" {view} aria-label="states of the year">{"".join(bars)}</svg>'
        case _:
            return _DAY.sub(r'<span class="day">\g<0></span>', _escaped(cell))


def state_words(state: str) -> str:
    """State of a run with its sign, ``"■ alarm"``."""
    return f"{STATE_SIGNS[state]} {state}"


def _conclusion(text: str, lamp: str) -> str:
    if not lamp:
        return f'<p class="conclusion">{_escaped(text)}</p>'
    sign, colour = blocks.look_of(lamp)
    mark = f'<span class="lamp" aria-hidden="true">{sign}</span>'
    return f'<p class="conclusion" style="--lamp: {colour}">{mark} {_escaped(text)}</p>'


def _figure(file: str, caption: str) -> str:
    image = f'<img src="{_escaped(file)}" alt="{_escaped(caption)}">'
    return f'<figure><div class="wide">{image}</div><figcaption>{_escaped(caption)}</figcaption></figure>'


def _table(heading: Sequence[str], rows: Iterable[Sequence[str]], kind: str) -> str:
    lines = "".join(f"{_row(row, 'td')}\n" for row in rows)
    head = f"<thead>{_row(heading, 'th')}</thead>"
    return f'<div class="wide"><table{kind}>{head}<tbody>\n{lines}</tbody></table></div>'


def _row(cells: Iterable[str], tag: str) -> str:
    return "<tr>" + "".join(f"<{tag}>{_escaped(cell)}</{tag}>" for cell in cells) + "</tr>"


def _escaped(text: str) -> str:
    return escape(blocks.single_line(text))
