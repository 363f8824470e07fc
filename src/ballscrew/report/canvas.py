"""An empty figure without any state of pyplot's, labels beside its curves, and its way into a file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ballscrew.base.errors import InputError
from ballscrew.base.files import replacing
from ballscrew.report.style import RC, check_target

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["blank", "colours_of", "label_ends", "note", "save_figure", "second_scale", "styled"]

_DPI = 150
_LINE = 1.25  # heights of a letter from one label to the next


def styled() -> Any:
    """Context in which everything that is drawn has the one look."""
    try:
        import matplotlib as mpl
    except ImportError:
        raise InputError(
            "pictures need matplotlib, which is not installed; install ballscrew[plot]."
        ) from None
    return mpl.rc_context(RC)


def blank(width: float, height: float, apart: float = 0.03) -> Figure:
    """Make an empty figure that draws on Agg.

    Parameters
    ----------
    width, height : float
        Inches.
    apart : float
        Between two columns of axes, as a part of one.

    Returns
    -------
    Figure
        Not known to pyplot: nothing is left open, nothing is shown.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    figure = Figure(figsize=(width, height), dpi=_DPI, layout=ConstrainedLayoutEngine(wspace=apart))
    FigureCanvasAgg(figure)
    return figure


def save_figure(figure: Figure, path: str | Path) -> None:
    """Write a figure; the same figure becomes the same file.

    Parameters
    ----------
    figure : Figure
        Drawn.
    path : path-like
        PNG, SVG or PDF file.

    Raises
    ------
    InputError
        If the picture cannot be written.
    """
    path = Path(path)
    check_target(path)
    # The day on which it was drawn would make another file of it; PNG knows none.
    dated = {".svg": "Date", ".pdf": "CreationDate"}.get(path.suffix.lower())
    with styled(), replacing(path) as temporary:
        figure.savefig(temporary, metadata={dated: None} if dated else None)


def colours_of(name: str, count: int, last: float = 0.8) -> list[Any]:
    """Colours from a perceptual map, without the end that is too light to read.

    Parameters
    ----------
    name : str
        Of matplotlib's map.
    count : int
        How many.
    last : float
        Where in the map the last one lies.

    Returns
    -------
    list
        From dark to light.
    """
    from matplotlib import colormaps

    return [colormaps[name](last * index / max(count - 1, 1)) for index in range(count)]


def label_ends(
    axes: Axes, heights: Sequence[float], texts: Sequence[str], colours: Sequence[Any], size: float = 8.5
) -> None:
    """Write the name of each curve at its end, right of the axes, apart from one another.

    Parameters
    ----------
    axes : Axes
        Its limits are final.
    heights : sequence of float
        Where the curves end.
    texts, colours : sequence
        Of each curve.
    size : float
        Of the letters, points.
    """
    low, high = axes.get_ylim()
    inches = axes.get_window_extent().height / axes.figure.dpi
    gap = _LINE * size / 72 / inches * (high - low)
    order = sorted(range(len(heights)), key=lambda index: heights[index])
    places = [heights[index] for index in order]
    for _ in range(200):
        # Neighbours that are too close push each other apart, and stay about where they were.
        for upper in range(1, len(places)):
            lacking = gap - (places[upper] - places[upper - 1])
            if lacking > 0:
                places[upper] += lacking / 2
                places[upper - 1] -= lacking / 2
    for index, place in zip(order, places, strict=True):
        axes.annotate(
            texts[index],
            (1, place),
            xycoords=("axes fraction", "data"),
            xytext=(4, 0),
            textcoords="offset points",
            color=colours[index],
            fontsize=size,
            va="center",
            annotation_clip=False,
        )


def note(
    axes: Axes,
    text: str,
    point: tuple[float, float],
    offset: tuple[float, float],
    *,
    colour: Any = "black",
    size: float = 9,
) -> None:
    """Write beside a point.

    Parameters
    ----------
    axes : Axes
        To write in.
    text : str
        What.
    point : tuple of float
        Beside which point, in the axes' units.
    offset : tuple of float
        How far from it, points; the text grows away from it in the same direction.
    colour : str
        Of the letters.
    size : float
        Of the letters, points.
    """
    across, up = offset
    axes.annotate(
        text,
        point,
        offset,
        textcoords="offset points",
        color=colour,
        fontsize=size,
        ha="center" if across == 0 else "left" if across > 0 else "right",
        va="center" if up == 0 else "bottom" if up > 0 else "top",
    )


def second_scale(axes: Axes, factor: float, label: str) -> None:
    """Write the same heights on the right in another unit.

    Parameters
    ----------
    axes : Axes
        To write at.
    factor : float
        The other unit's value over the left one's.
    label : str
        The other's name and unit.
    """

    def there(values: Any) -> Any:
        return values * factor

    def back(values: Any) -> Any:
        return values / factor

    axes.secondary_yaxis("right", functions=(there, back)).set_ylabel(label)
