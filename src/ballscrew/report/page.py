"""One HTML page that stands by itself: text, a table, pictures beside it."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

__all__ = ["html_page"]

_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #222; max-width: 60rem; }
body { margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.6rem; } img { max-width: 100%; height: auto; }
table { border-collapse: collapse; margin: 1rem 0; font-variant-numeric: tabular-nums; }
th, td { padding: 0.25rem 0.8rem; text-align: right; border-bottom: 1px solid #ddd; }
.words th, .words td { text-align: left; vertical-align: top; }
figure { margin: 2rem 0; } figcaption { color: #555; }
"""


def html_page(
    title: str,
    paragraphs: Sequence[str],
    pictures: Sequence[tuple[str, str]],
    heading: Sequence[str],
    rows: Sequence[Sequence[str]],
    *,
    words: bool = False,
) -> str:
    """Write a page.

    Parameters
    ----------
    title : str
        Of the page.
    paragraphs : sequence of str
        Plain text.
    pictures : sequence of (file, caption)
        Beside the page.
    heading, rows
        Of the table.
    words : bool
        Whether the table holds sentences, not numbers; it then stands before the pictures.

    Returns
    -------
    str
        HTML; all texts are escaped.
    """
    head = "".join(f"<th>{escape(name)}</th>" for name in heading)
    lines = "".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>\n" for row in rows)
    kind = ' class="words"' if words else ""
    table = f"<table{kind}><thead><tr>{head}</tr></thead><tbody>\n{lines}</tbody></table>"
    shown = [
        f'<figure><img src="{escape(file, quote=True)}" alt="{escape(caption, quote=True)}">'
        f"<figcaption>{escape(caption)}</figcaption></figure>"
        for file, caption in pictures
    ]
    body = [f"<h1>{escape(title)}</h1>", *(f"<p>{escape(text)}</p>" for text in paragraphs)]
    body += [table, *shown] if words else [*shown, table]
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>'
        f"<style>{_STYLE}</style></head>\n<body>\n" + "\n".join(body) + "\n</body></html>\n"
    )
