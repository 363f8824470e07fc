"""Figures: the common look, an empty figure that pyplot does not know, labels beside curves, and saving."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ballscrew.base.errors import InputError
from ballscrew.base.files import replacing

if TYPE_CHECKING:  # matplotlib is optional, and loaded when a picture is drawn
    from matplotlib.axes import Axes as Axes
    from matplotlib.figure import Figure as Figure
    from matplotlib.figure import FigureBase as FigureBase
else:
    Axes = Figure = FigureBase = Any

# Okabe and Ito's palette: distinguishable with any colour vision.
CONDITION_COLOURS = {"PA": "#0072B2", "PD": "#009E73", "NA": "#D55E00", "ND": "#CC79A7"}
CONDITION_MARKERS = {"PA": "^", "PD": "v", "NA": ">", "ND": "<"}
POSITION_MAP = "viridis"
FRF_MAP = "magma"
CHANGE_MAP = "RdBu"
ANF, BACKLASH = "#332288", "#9C3A12"
ERROR_COLOUR = "#8B1A1A"
STAGES = ("#E9F0F8", "#FCEBDD")
REFUSED = "#DDDDDD"
REFUSED_LOOK: dict[str, Any] = {"fc": REFUSED, "hatch": "////", "lw": 0}
STATE_COLOURS = {
    "learning": "#56B4E9",
    "normal": "#009E73",
    "watch": "#E69F00",
    "alarm": "#D55E00",
    "unloaded": "#7A0177",
    "suspect": "#999999",
}
STATE_MARKERS = {"learning": "v", "normal": "o", "watch": "D", "alarm": "s", "unloaded": "X", "suspect": "P"}
STATE_SIGNS = {"learning": "▼", "normal": "●", "watch": "◆", "alarm": "■", "unloaded": "✖", "suspect": "✚"}
"""The markers as characters."""
STAR: dict[str, Any] = {
    "marker": "*",
    "markersize": 11,
    "markerfacecolor": "#F0E442",
    "markeredgecolor": "black",
    "markeredgewidth": 0.6,
}
FORMATS = (".png", ".svg", ".pdf")
RC: Any = {
    "font.size": 10,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.alpha": 0.25,
    "axes.titlesize": 10.5,
    "axes.titleweight": "bold",
    "legend.frameon": False,
    "svg.hashsalt": "ballscrew",  # the same figure gives the same file
}
_DPI = 150
_PANEL = (7.6, 4.2)  # inches
_STRIP = 26  # points: 0.1 of a panel of this height, and more than of those in a figure
_LINE = 1.25  # letter heights from one label to the next
SIDE_EDGE = ("axes fraction", "data")
"""Coordinates of a note at the left (0) or right (1) edge of the axes."""
TOP_EDGE = ("data", "axes fraction")
"""Coordinates of a note at the lower (0) or upper (1) edge of the axes."""
# Metadata that would make the file depend on the day; PNG has none.
_DATED = {".svg": "Date", ".pdf": "CreationDate"}
# Alignment of a note by the sign of its offset.
_ALIGN_ACROSS: dict[int, Any] = {-1: "right", 0: "center", 1: "left"}
_ALIGN_UP: dict[int, Any] = {-1: "top", 0: "center", 1: "bottom"}


def check_target(path: Path) -> None:
    """Refuse a picture that cannot be written, before any work is done for it.

    Parameters
    ----------
    path : path-like
        File to write.

    Raises
    ------
    InputError
        If its ending is no known format, it is a folder, its folder does not exist, or matplotlib is not
        installed.
    """
    if path.suffix.lower() not in FORMATS:
        raise InputError(f"{path}: a picture's name must end in {', '.join(FORMATS)}.")
    if path.is_dir():
        raise InputError(f"{path}: is a folder; give the picture's own name.")
    if not path.parent.is_dir():
        raise InputError(f"{path}: the folder {path.parent} does not exist.")
    check_drawing()


def check_drawing() -> None:
    """Refuse to draw where matplotlib is not installed.

    Raises
    ------
    InputError
        If matplotlib is not installed.
    """
    try:
        import matplotlib  # noqa: F401
    except ImportError:
        raise InputError(
            "pictures need matplotlib, which is not installed; install ballscrew[plot]."
        ) from None


@contextmanager
def styled() -> Iterator[None]:
    """Context, or decorator of a function, in which everything drawn has the common look."""
    check_drawing()
    import matplotlib as mpl

    with mpl.rc_context(RC), warnings.catch_warnings():
        # A name may contain signs that the font lacks; they are drawn as boxes.
        warnings.filterwarnings("ignore", message="Glyph .* missing from")
        yield


def blank(width: float, height: float, spacing: float = 0.03, *, constrained: bool = True) -> Figure:
    """Empty figure that draws on Agg and is unknown to pyplot.

    Parameters
    ----------
    width, height : float
        Size, inches.
    spacing : float
        Distance of two columns of axes, relative to the width of one.
    constrained : bool
        Whether the layout engine places the axes; otherwise the caller does.

    Returns
    -------
    Figure
        Without axes.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    figure = Figure(figsize=(width, height), dpi=_DPI)
    if constrained:
        figure.set_layout_engine(ConstrainedLayoutEngine(wspace=spacing))
    FigureCanvasAgg(figure)
    return figure


def draw_on(axes: Axes | None, draw: Callable[[Axes, Any], None], result: Any) -> Axes:
    """Draw a result on axes, or on those of a new figure of pyplot, which a notebook shows.

    Parameters
    ----------
    axes : Axes or None
        Axes to draw on.
    draw : callable
        Draws the result on axes.
    result : object
        Result to draw.

    Returns
    -------
    Axes
        With the drawing.
    """
    with styled():
        from matplotlib import pyplot

        if axes is not None:
            draw(axes, result)
            return axes
        figure, own = pyplot.subplots(figsize=_PANEL, layout="constrained")
        try:
            draw(own, result)
        except Exception:
            pyplot.close(figure)  # nothing was drawn
            raise
        return own


def save_figure(figure: Figure, path: str | Path) -> None:
    """Write a figure; the same figure gives the same file.

    Parameters
    ----------
    figure : Figure
        Figure to write.
    path : path-like
        PNG, SVG or PDF file.

    Raises
    ------
    InputError
        If the picture cannot be written.
    """
    path = Path(path)
    check_target(path)
    metadata: dict[str, Any] = {}
    dated = _DATED.get(path.suffix.lower())
    if dated is not None:
        metadata[dated] = None
    picture = BytesIO()  # on a full disk zlib fails in its own words
    with styled():
        figure.savefig(picture, format=path.suffix[1:], metadata=metadata)
    with replacing(path) as temporary:
        temporary.write_bytes(picture.getvalue())


def escape_dollars(text: str) -> str:
    """Text with its dollar signs escaped, so that matplotlib does not read a formula between them."""
    return text.replace("$", r"\$")


def colours_of(name: str, count: int, last: float = 0.8) -> list[Any]:
    """Colours from a perceptual map, without the end that is too light to read.

    Parameters
    ----------
    name : str
        Name of matplotlib's map.
    count : int
        Number of colours.
    last : float
        Place of the last colour in the map, 0 to 1.

    Returns
    -------
    list
        Colours, from dark to light.
    """
    from matplotlib import colormaps

    return [colormaps[name](last * index / max(count - 1, 1)) for index in range(count)]


def draw_unestimated(axes: Axes, x: Any) -> None:
    """Mark runs without an estimate by crosses in a grey strip of its own, below the scale.

    Parameters
    ----------
    axes : Axes
        Axes to draw at; the strip begins at its lower edge.
    x : sequence
        Places, or dates.
    """
    if not len(x):
        return
    from matplotlib.patches import Rectangle

    look: Any = {"clip_on": False, "zorder": 0.5}
    axes.add_patch(Rectangle((0, -0.1), 1, 0.085, transform=axes.transAxes, color="0.93", lw=0, **look))
    middle = [-0.0575] * len(x)
    edge = axes.get_xaxis_transform()
    axes.plot(x, middle, "x", color="0.35", ms=5, clip_on=False, transform=edge, label="no estimate")
    axes.tick_params(axis="x", pad=_STRIP)  # labels below the strip
    note(axes, "no estimate", (0, -0.0575), (-4, 0), coords="axes fraction", size=8.5, colour="0.35")


def label_ends(
    axes: Axes, heights: Sequence[float], texts: Sequence[str], colours: Sequence[Any], size: float = 8.5
) -> None:
    """Write the name of each curve at its end, right of the axes, without overlap.

    Parameters
    ----------
    axes : Axes
        Axes whose limits are final.
    heights : sequence of float
        Heights at which the curves end.
    texts, colours : sequence
        Name and colour of each curve.
    size : float
        Letter size, points.
    """
    low, high = axes.get_ylim()
    inches = axes.get_window_extent().height / axes.figure.dpi
    gap = _LINE * size / 72 / inches * (high - low)
    order = sorted(range(len(heights)), key=lambda index: heights[index])
    places = [heights[index] for index in order]
    for _ in range(200):
        # Neighbours that are too close push each other away by equal parts.
        for upper in range(1, len(places)):
            lacking = gap - (places[upper] - places[upper - 1])
            if lacking > 0:
                places[upper] += lacking / 2
                places[upper - 1] -= lacking / 2
    for index, place in zip(order, places, strict=True):
        look: Any = {"coords": SIDE_EDGE, "colour": colours[index], "annotation_clip": False}
        note(axes, texts[index], (1, place), (4, 0), size=size, **look)


def note(
    axes: Axes,
    text: str,
    point: tuple[Any, float],
    offset: tuple[float, float],
    *,
    colour: Any = "black",
    size: float = 9,
    coords: Any = "data",
    **look: Any,
) -> None:
    """Write a text beside a point.

    Parameters
    ----------
    axes : Axes
        Axes to draw in.
    text : str
        Text.
    point : tuple
        Point, in ``coords``.
    offset : tuple of float
        Distance from the point, points; the text is aligned away from it.
    colour : str
        Colour of the letters.
    size : float
        Letter size, points.
    coords : str or tuple of str
        Coordinates of the point, as matplotlib's ``xycoords``.
    **look
        Further properties of the text; ``ha`` and ``va`` replace the alignment.
    """
    across, up = offset
    look.setdefault("ha", _ALIGN_ACROSS[(across > 0) - (across < 0)])
    look.setdefault("va", _ALIGN_UP[(up > 0) - (up < 0)])
    axes.annotate(
        text, point, offset, xycoords=coords, textcoords="offset points", color=colour, fontsize=size, **look
    )


def draw_star(axes: Axes, x: float, y: float, size: float = 11, label: str | None = None) -> None:
    """Draw the star that marks an axial natural frequency."""
    look = STAR | {"markersize": size}
    axes.plot([x], [y], linestyle="none", zorder=5, label=label, **look)


def legend_line(label: str, linestyle: Any = "-", **look: Any) -> Any:
    """Entry of a legend, for a line."""
    from matplotlib.lines import Line2D

    return Line2D([], [], label=label, linestyle=linestyle, **look)


def legend_mark(label: str, **look: Any) -> Any:
    """Entry of a legend, for a marker."""
    return legend_line(label, "none", **look)


def legend_patch(label: str, **look: Any) -> Any:
    """Entry of a legend, for an area."""
    from matplotlib.patches import Patch

    return Patch(label=label, **look)


def second_scale(axes: Axes, factor: float, label: str) -> None:
    """Add a scale in another unit on the right.

    Parameters
    ----------
    axes : Axes
        Axes to draw at.
    factor : float
        Value in the other unit over the value on the left.
    label : str
        Name and unit on the right.
    """

    def forward(values: Any) -> Any:
        return values * factor

    def inverse(values: Any) -> Any:
        return values / factor

    axes.secondary_yaxis("right", functions=(forward, inverse)).set_ylabel(label)
