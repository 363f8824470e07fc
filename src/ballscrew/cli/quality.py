"""``ballscrew quality``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ballscrew.base.jsonfile import SCHEMA
from ballscrew.cli.output import VERDICT_STYLE, console, print_json, progress_bar, report_quality
from ballscrew.modal.analyze import quality

__all__ = ["quality_command"]


def quality_command(
    files: Sequence[Path],
    *,
    channels: Path | None,
    axis: Path | None,
    plan: Path | None,
    mass: str | None,
    as_json: bool,
) -> int:
    """Check a measurement, print the verdict, and return the exit status."""
    with progress_bar("reading") as progress:
        verdict = quality(files, channels=channels, axis=axis, plan=plan, mass=mass, progress=progress)
    if as_json:
        print_json({"schema": SCHEMA, "quality": verdict.to_json(), "files": [file.name for file in files]})
    else:
        out = console()
        out.print(f"[bold {VERDICT_STYLE[verdict.verdict]}]{verdict.verdict}[/]")
        for reason in verdict.reasons:
            out.print(f"  • {reason}", markup=False)
    return report_quality(verdict)
