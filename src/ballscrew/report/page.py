"""One self-contained HTML page: conclusion, text, a table, pictures beside it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

from ballscrew.report.canvas import STATE_COLOURS, STATE_SIGNS

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
    body = [f"<h1>{escape(title)}</h1>"]
    if conclusion:
        body.append(_conclusion(conclusion, lamp))
    body += [f"<p>{escape(text)}</p>" for text in paragraphs]
    figures = [_figure(file, caption) for file, caption in pictures]
    if words:
        body += [_table(heading, rows, ' class="words"'), *figures]
    else:
        body += [*figures, _table(heading, rows, "")]
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)}</title><style>{_STYLE}</style></head>\n<body>\n"
        + "\n".join(body)
        + "\n</body></html>\n"
    )


def state_words(state: str) -> str:
    """State of a run with its sign, ``"■ alarm"``."""
    return f"{STATE_SIGNS[state]} {state}"


def _conclusion(text: str, lamp: str) -> str:
    if not lamp:
        return f'<p class="conclusion">{escape(text)}</p>'
    sign = f'<span class="lamp" aria-hidden="true">{STATE_SIGNS[lamp]}</span>'
    return f'<p class="conclusion" style="--lamp: {STATE_COLOURS[lamp]}">{sign} {escape(text)}</p>'


def _figure(file: str, caption: str) -> str:
    image = f'<img src="{escape(file, quote=True)}" alt="{escape(caption, quote=True)}">'
    return f'<figure><div class="wide">{image}</div><figcaption>{escape(caption)}</figcaption></figure>'


def _table(heading: Sequence[str], rows: Iterable[Sequence[str]], kind: str) -> str:
    lines = "".join(f"{_row(row, 'td')}\n" for row in rows)
    head = f"<thead>{_row(heading, 'th')}</thead>"
    return f'<div class="wide"><table{kind}>{head}<tbody>\n{lines}</tbody></table></div>'


def _row(cells: Iterable[str], tag: str) -> str:
    return "<tr>" + "".join(f"<{tag}>{escape(cell)}</{tag}>" for cell in cells) + "</tr>"
