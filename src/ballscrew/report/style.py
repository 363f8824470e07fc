"""One look for all figures: the same colour for the same thing, legible and safe for colour-blind eyes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ballscrew.base.errors import InputError

__all__ = [
    "ANF",
    "BACKLASH",
    "CHANGE_MAP",
    "CONDITION_COLOURS",
    "CONDITION_MARKERS",
    "FORMATS",
    "FRF_MAP",
    "HATCH",
    "POSITION_MAP",
    "RC",
    "REFUSED",
    "STAGES",
    "STAR",
    "STATE_COLOURS",
    "check_drawing",
    "check_target",
    "no_formula",
]

# Okabe and Ito's palette, which colour-blind readers can tell apart.
CONDITION_COLOURS = {"PA": "#0072B2", "PD": "#009E73", "NA": "#D55E00", "ND": "#CC79A7"}
CONDITION_MARKERS = {"PA": "^", "PD": "v", "NA": ">", "ND": "<"}
POSITION_MAP = "viridis"
FRF_MAP = "magma"
CHANGE_MAP = "RdBu"
ANF, BACKLASH = "#332288", "#9C3A12"
STAGES = ("#E9F0F8", "#FCEBDD")
REFUSED, HATCH = "#DDDDDD", "////"
STATE_COLOURS = {
    "learning": "#56B4E9",
    "normal": "#009E73",
    "watch": "#E69F00",
    "alarm": "#D55E00",
    "suspect": "#999999",
}
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
    "svg.hashsalt": "ballscrew",  # the same figure, the same file
}


def check_target(path: Path) -> None:
    """Refuse a picture that cannot be written, before any work is done for it.

    Parameters
    ----------
    path : path-like
        Where the picture shall go.

    Raises
    ------
    InputError
        If its ending is no known format, it is a folder or lies in none, or matplotlib is not installed.
    """
    if path.suffix.lower() not in FORMATS:
        raise InputError(f"{path}: a picture's name must end in {', '.join(FORMATS)}.")
    if path.is_dir():
        raise InputError(f"{path}: is a folder; give the picture's own name.")
    if not path.parent.is_dir():
        raise InputError(f"{path}: the folder {path.parent} does not exist.")
    check_drawing()


def check_drawing() -> None:
    """Refuse pictures where nothing can draw them, before any work is done for them.

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


def no_formula(text: str) -> str:
    """A text of files and names as it stands: matplotlib takes what is between dollar signs for a formula.

    Parameters
    ----------
    text : str
        Any text.

    Returns
    -------
    str
        The same with its dollar signs escaped.
    """
    return text.replace("$", r"\$")
