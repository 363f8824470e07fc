"""What every result offers at the prompt and in a notebook: a short text, a table and a plot."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from html import escape
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from ballscrew.base.errors import InputError, shown
from ballscrew.base.files import check_folder, replacing
from ballscrew.base.quantity import Quantity

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes

MOST_SENTENCES = 3
"""Reasons that a representation contains."""

_MOST_ROWS, _MOST_COLUMNS = 20, 10  # of the table in a notebook
_WITHIN = re.compile('([;\t\r\n]"? *)(?=[=+@＝＋－＠-])')
_FORMULA = tuple("=+-@\t\r\n＝＋－＠")  # first characters of a text that a spreadsheet executes


class Result:
    """A result with a short representation, also as HTML, and a table."""

    __slots__ = ()

    def _lines(self) -> Sequence[str]:
        """The conclusion in one line, and a few further ones."""
        raise NotImplementedError

    def to_dataframe(self) -> pd.DataFrame:
        """Table of the result, with units in the names of the columns."""
        raise NotImplementedError

    def export(self, path: str | Path) -> None:
        """Write the table of the result, see :func:`export_table`."""
        export_table(self.to_dataframe(), path)

    def __repr__(self) -> str:
        """The conclusion in one line, and a few further ones."""
        first, *others = self._lines()
        return "\n".join([f"<{type(self).__name__}> {first}", *(f"  {line}" for line in others)])

    def _repr_html_(self) -> str:
        """The same and the table, for a notebook."""
        first, *others = map(escape, self._lines())
        items = "".join(f"<li>{line}</li>" for line in others)
        table = self.to_dataframe().iloc[:, :_MOST_COLUMNS]
        rows = table.to_html(
            index=False, border=0, max_rows=_MOST_ROWS, na_rep="–", float_format="{:.4g}".format
        )
        return f"<p><strong>{first}</strong></p><ul>{items}</ul>{rows}"


class PlottedResult(Result):
    """A result with a plot."""

    __slots__ = ()

    _drawing: ClassVar[str]
    """Module of :mod:`ballscrew.report` and its function that draws on Axes, as ``module:function``."""

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the result.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            Axes to draw on; by default those of a new figure of pyplot.

        Returns
        -------
        matplotlib Axes
            ``ax``, or the new ones.

        Raises
        ------
        InputError
            If matplotlib is not installed, or there is nothing to draw.
        """
        # By name, since an import in this direction is against the layers: drawing is the last of them.
        module, _, name = self._drawing.partition(":")
        draw = getattr(import_module(f"ballscrew.report.{module}"), name)
        axes: Axes = import_module("ballscrew.report.canvas").draw_on(ax, draw, self)
        return axes


def check_export(path: str | Path) -> None:
    """Refuse a file to which no table can be written.

    Parameters
    ----------
    path : path-like
        The file.

    Raises
    ------
    InputError
        If its folder does not exist, its name does not end with .csv or .parquet, or pyarrow is not installed
        for the latter.
    """
    check_folder(Path(path))
    suffix = Path(path).suffix.casefold()
    if suffix not in (".csv", ".parquet"):
        raise InputError(f"{path}: a table is written to a file whose name ends with .csv or .parquet.")
    if suffix == ".parquet" and find_spec("pyarrow") is None:
        raise InputError(f'{path}: Parquet needs pyarrow: pip install "ballscrew[parquet]".')


def export_table(table: pd.DataFrame, path: str | Path) -> None:
    """Write a table as CSV (UTF-8, commas, decimal points) or Parquet, by the name of the file.

    A complex column becomes two, ``H1_real`` and ``H1_imag``. In CSV texts are quoted, and an apostrophe
    precedes one that a spreadsheet would execute as a formula.

    Parameters
    ----------
    table : DataFrame
        The table.
    path : path-like
        The file, replaced if it exists; its name ends with ``.csv`` or ``.parquet``.

    Raises
    ------
    InputError
        If the name ends otherwise, pyarrow is not installed for Parquet, two columns have one name, or the
        file cannot be written.
    """
    check_export(path)
    table = _real(table)
    with replacing(path) as temporary:
        if temporary.suffix.casefold() == ".parquet":
            table.to_parquet(temporary, engine="pyarrow", index=False)
        else:
            temporary.write_text(csv_text(table), encoding="utf-8", newline="")


def csv_text(table: pd.DataFrame) -> str:
    """Table as CSV: texts are quoted, and an apostrophe precedes one that a spreadsheet would execute."""
    safe = table.map(not_executed).rename(columns=not_executed)
    text: str = safe.to_csv(index=False, lineterminator="\n", quoting=csv.QUOTE_NONNUMERIC)
    return text


def _real(table: pd.DataFrame) -> pd.DataFrame:
    """Table in which a complex column is two: ``H1`` becomes ``H1_real`` and ``H1_imag``."""
    import pandas as pd

    columns: list[tuple[str, Any]] = []
    for name, column in table.items():
        if column.dtype.kind == "c":
            values = column.to_numpy()
            columns += [(f"{name}_real", values.real), (f"{name}_imag", values.imag)]
        else:
            columns.append((str(name), column))
    real: dict[str, Any] = {}
    for name, values in columns:
        if name in real:
            raise InputError(f"two columns of the table have the name {shown(name)}; rename one.")
        real[name] = values
    return pd.DataFrame(real, index=table.index)


def not_executed(cell: Any) -> Any:
    """Cell of a table, with an apostrophe before a text that a spreadsheet would execute.

    Also within the text, where a spreadsheet of another language begins a cell: after a semicolon, a tab, or
    the end of a line.
    """
    if not isinstance(cell, str):
        return cell
    text = _WITHIN.sub(r"\1'", cell)
    return f"'{text}" if text.lstrip(" ").startswith(_FORMULA) else text


def quantity_rows(rows: Sequence[tuple[str, Quantity | None]]) -> pd.DataFrame:
    """Table of quantities: value, standard uncertainty, 95 % interval and unit of each that is known."""
    import pandas as pd

    columns = ["quantity", "value", "standard_uncertainty", "low95", "high95", "unit"]
    known = []
    for name, quantity in rows:
        if quantity is not None:
            interval = quantity.interval
            known.append((name, quantity.value, quantity.standard_uncertainty, *interval, quantity.unit))
    return pd.DataFrame(known, columns=columns)


def with_interval(quantity: Quantity) -> str:
    """A quantity with its 95 % interval, ``"0.52 ± 0.02 (95 %: 0.48 to 0.56)"``."""
    low, high = quantity.interval
    digits = quantity.digits if quantity.standard_uncertainty else 3
    return f"{quantity} (95 %: {low:.{digits}f} to {high:.{digits}f})"


def first_sentences(sentences: Sequence[str]) -> list[str]:
    """The first sentences, and how many more there are."""
    shown = list(sentences[:MOST_SENTENCES])
    if len(sentences) > MOST_SENTENCES:
        shown.append(f"and {len(sentences) - MOST_SENTENCES} more")
    return shown
