"""Draws the schematics of the documentation: how the data are processed, and the testbed's five bodies.

Usage: python -m docs.schematics [FOLDER]

FOLDER is docs/_static where it is not given. Each is written as PNG and SVG.
"""

from __future__ import annotations

import sys
from pathlib import Path

from docs.pictures.processing import draw_processing
from docs.pictures.testbed import draw_testbed

from ballscrew.report.canvas import save_figure

SCHEMATICS = {"processing": draw_processing, "testbed_schematic": draw_testbed}


def main(folder: Path) -> None:
    """Draw both."""
    for name, draw in SCHEMATICS.items():
        for ending in (".png", ".svg"):
            save_figure(draw(), folder / f"{name}{ending}")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "_static")
