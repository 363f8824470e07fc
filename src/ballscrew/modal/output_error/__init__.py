"""Isolated cells by output error: all repetitions at once, at the limit of what they hold."""

from ballscrew.modal.output_error.bound import Bound, cell_bound
from ballscrew.modal.output_error.estimate import Candidate, CellEstimate, ModeEstimate
from ballscrew.modal.output_error.identify import identify_cell
from ballscrew.modal.output_error.windows import over_windows

__all__ = [
    "Bound",
    "Candidate",
    "CellEstimate",
    "ModeEstimate",
    "cell_bound",
    "identify_cell",
    "over_windows",
]
