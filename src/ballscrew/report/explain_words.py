"""Why the number of a cell is what it is, in words."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ballscrew.modal.evidence import Evidence
from ballscrew.modal.run import CellResult, Run
from ballscrew.report.explain_advice import advice

__all__ = ["Paragraph", "explain", "headline"]

_FACTOR = 1.96  # standard uncertainties that 95 % lie within
_FAR = 3.0  # scatters, from which on a deviation is told
_AGREE = 2.0  # of the standard uncertainty of a difference
_MEANS = {
    "joint": {
        "noise": "what the scatter of the cells around one curve along the axis leaves open here",
        "conditions": "what the curve would move by if PA, PD, NA and ND each had to tell it alone: window, "
        "motion and friction",
        "weights": "half of what changes where the noise's colour is left out of account",
        "load": "how the nut softens under the test's own load: the law's doubt, and that of an even wear",
        "left": "what the model leaves unexplained may be a force that nobody measured",
        "ripple": "a force repeats between whole orders of a turn, and what was fitted misses part of it",
        "local": "a stop stands out of its neighbours, and the course between them is not known",
        "drives": "half of what the curve from the motor's motion moves the one from the torque by",
        "model": "the least that any model of a run is trusted to, whatever its data say",
    },
    "paper": {
        "repetitions": "scatter of the peak from repetition to repetition",
        "window": "what a window 15 % longer or shorter moves the peak by",
        "moving table": "the table moves while the window lasts, and the frequency with it",
        "method": "a peak under a window this short lies beside the undamped frequency",
        "conditions": "what the conditions of one stop disagree by",
    },
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Paragraph:
    """One step of the explanation.

    Parameters
    ----------
    title : str
        What it is about.
    lines : tuple of str
        Sentences.
    listed : bool
        Whether they are a list.
    before : str
        A sentence before the list.
    """

    title: str
    lines: tuple[str, ...]
    listed: bool = False
    before: str = ""


def headline(told: Evidence) -> str:
    """Which cell, and its number.

    Parameters
    ----------
    told : Evidence
        Of the cell.

    Returns
    -------
    str
        Without the verdict.
    """
    cell = told.cell
    load = "" if told.run.mass_kg is None else f", load {told.run.mass_kg:g} kg"
    motion = f", motion {cell.motion}" if len({c.motion for c in told.run.cells}) > 1 else ""
    value = _value(cell.frequency_Hz, cell.standard_uncertainty_Hz)
    return f"{told.run.axis or 'axis'}, {place(cell)}{motion}{load}: {value or 'no frequency'}"


def place(cell: CellResult) -> str:
    """Stop and condition of a cell, ``"45 mm PD"``."""
    return f"{round(1e3 * cell.position_m, 1) + 0.0:g} mm {cell.condition}"


def explain(told: Evidence) -> tuple[Paragraph, ...]:
    """Say why the number of a cell is what it is.

    Parameters
    ----------
    told : Evidence
        Of the cell.

    Returns
    -------
    tuple of Paragraph
        From what was measured to what would make it better.
    """
    parts = (
        Paragraph("What was measured", _measured(told)),
        _frequency(told.cell),
        Paragraph("With the rotor held", _held(told.cell)),
        Paragraph("What repeats with every turn", _ripple(told.run)),
        Paragraph("This cell and the others", _deviation(told)),
        Paragraph("Coherence", _coherence(told.cell)),
        Paragraph("What the paper's peak says", _paper(told)),
        _verdict(told),
        Paragraph("What would make it better", advice(told), listed=True),
    )  # fmt: skip
    return tuple(part for part in parts if part.lines)


def _verdict(told: Evidence) -> Paragraph:
    cell = told.cell
    title = f"Verdict: {cell.verdict}"
    if cell.reasons:
        return Paragraph(title, cell.reasons, listed=True)
    if _far(told):
        said = "The run as a whole speaks for it; this cell's own data do not, see above."
        return Paragraph(title, (said,))
    return Paragraph(title, ("Nothing speaks against it.",))


def _far(told: Evidence) -> bool:
    """Whether a cell's own data lie off the curve by more than noise and the other cells' scatter make."""
    off = abs(told.cell.deviation_Hz or 0.0)
    noise = _FACTOR * (told.cell.deviation_standard_uncertainty_Hz or 0.0)
    return off > noise and (told.scatter is None or off > _FAR * told.scatter)


def _value(frequency: float | None, deviation: float | None) -> str:
    """A frequency with its 95 % interval."""
    if frequency is None:
        return ""
    if deviation is None or not math.isfinite(deviation):
        return f"{frequency:.1f} Hz"
    half = _FACTOR * deviation
    digits = 1 if half >= 0.15 else 2
    return f"{frequency:.{digits}f} ± {half:.{digits}f} Hz (95 %)"


def _measured(told: Evidence) -> tuple[str, ...]:
    cell, run = told.cell, told.run
    lines = [f"Measurement {run.quality.verdict}{': ' + '; '.join(run.quality.reasons) if run.quality.reasons else ''}."]  # fmt: skip  # noqa: E501
    if not told.found:
        return (*lines, "No transient of this cell was found in the recordings.")
    cut, left = told.found - told.whole, told.whole - cell.repetitions
    text = f"{_count(told.found, 'transient')} of this cell in {_count(len(run.files), 'recording')}"
    text += ", all used" if cell.repetitions == told.found else f", {cell.repetitions} used"
    if cut:
        text += f"; {cut} cut by a record's start or end, or of a warm-up"
    if left > 0 and cell.repetitions:
        text += f"; {left} could not be laid on the others"
    lines.append(f"{text}.")
    return tuple(lines)


def _frequency(cell: CellResult) -> Paragraph:
    terms = sorted(cell.uncertainty_terms_Hz.items(), key=lambda item: -item[1])
    means = _MEANS.get(cell.method, {})
    value = _value(cell.frequency_Hz, cell.standard_uncertainty_Hz)
    title = f"Frequency, rotor free: {value}" if value else "Frequency, rotor free: none"
    if not terms:
        return Paragraph(title, ())
    lines = tuple(f"{name}, {value:.2f} Hz: {means.get(name, 'a part of it')}" for name, value in terms)
    total = cell.standard_uncertainty_Hz
    said = (
        ""
        if total is None
        else f"The standard uncertainty is {total:.2f} Hz. Its parts, the largest first (squares add up):"
    )
    return Paragraph(title, lines, listed=True, before=said)


def _held(cell: CellResult) -> tuple[str, ...]:
    held, free = cell.rotor_held_frequency_Hz, cell.frequency_Hz
    if held is None or free is None:
        return ()
    value = _value(held, cell.rotor_held_standard_uncertainty_Hz)
    share = 100 * (held / free) ** 2
    said = f"{value}: the table on its spring, were the motor to stand still; the paper's Eq. (3)."
    why = f"The square of the two frequencies' ratio says that the rotor is {share:.0f} % of all that moves."
    return (f"{said} {why}",)


def _ripple(run: Run) -> tuple[str, ...]:
    if not run.motor_ripple:
        return ()
    rows = []
    for row in run.motor_ripple:
        size, spread = row.torque_Nm, row.standard_uncertainty_Nm
        told = "size not told"
        if size is not None and spread is not None:
            told = f"{1e3 * size:.1f} ± {1e3 * _FACTOR * spread:.1f} N·mm"
        rows.append(f"{row.order} ({told})")
    said = "Forces that come so many times a turn, which no channel tells, were found beside the mode"
    why = (
        "The motor cogs, or screw and nut run unevenly: their part of the response is not taken for the axis."
    )
    if any("ripple" in cell.uncertainty_terms_Hz for cell in run.cells):
        why = (
            "Those beside each other are made by one force between them, as behind a belt: what they miss of "
            "it is the uncertainty's term 'ripple'."
        )
    return (f"{said}: {', '.join(rows)}. {why}",)


def _deviation(told: Evidence) -> tuple[str, ...]:
    cell = told.cell
    if cell.frequency_Hz is None or cell.deviation_Hz is None:
        return ()
    half = _FACTOR * (cell.deviation_standard_uncertainty_Hz or 0.0)
    own = f"{cell.deviation_Hz:+.2f} ± {half:.2f} Hz (95 %, of noise alone)"
    lines = [f"By its own data this cell lies {own} off the curve of all cells; the curve is reported."]
    if told.scatter is not None:
        out = "far out: look at this stop" if _far(told) else "nothing out of the ordinary"
        lines.append(f"Cells of this run scatter around it by {told.scatter:.2f} Hz, so this is {out}.")
    others = [f"{c.condition} {c.deviation_Hz:+.2f}" for c in told.siblings if c.deviation_Hz is not None]
    if others:
        lines.append(
            f"The other conditions of this stop: {', '.join(others)} Hz. A local defect moves all of them to "
            "one side; friction, the motion and noise move each its own way."
        )
    return tuple(lines)


def _coherence(cell: CellResult) -> tuple[str, ...]:
    if cell.coherence is None:
        return ()
    chance = f"; torque and acceleration that have nothing to do with each other would give {1 / cell.repetitions:.2f}" if cell.repetitions > 1 else ""  # fmt: skip  # noqa: E501
    few = " With so few repetitions it says little." if 1 < cell.repetitions < 5 else ""
    same = "so much of the acceleration there follows the torque the same way in every repetition"
    return (f"{cell.coherence:.2f} at the frequency: {same}{chance}.{few}",)


def _paper(told: Evidence) -> tuple[str, ...]:
    if told.cell.method == "paper":
        return ()
    paper = told.paper
    if paper.frequency_Hz is None:
        return (f"Nothing: refused, since {'; '.join(paper.reasons)}.",)
    text = f"{_value(paper.frequency_Hz, paper.standard_uncertainty_Hz)}, {paper.verdict}"
    return (f"{text}{_beside(told.cell, paper.frequency_Hz, paper.standard_uncertainty_Hz)}.",)


def _beside(cell: CellResult, frequency: float, deviation: float | None) -> str:
    if cell.frequency_Hz is None:
        return ""
    off = frequency - cell.frequency_Hz
    both = math.hypot(deviation or 0.0, cell.standard_uncertainty_Hz or 0.0)
    agree = "they agree" if abs(off) <= _AGREE * both else "more than both uncertainties allow"
    return f"; {abs(off):.2f} Hz {'above' if off > 0 else 'below'} the number above: {agree}"


def _count(number: int, what: str) -> str:
    return f"{number} {what}" if number == 1 else f"{number} {what}s"
