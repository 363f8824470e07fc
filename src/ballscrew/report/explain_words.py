"""The explanation of a cell's result in sentences, and what would improve it."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ballscrew.base.quantity import NORMAL_95
from ballscrew.base.words import plural
from ballscrew.modal.cell import CellResult
from ballscrew.modal.evidence import Evidence
from ballscrew.modal.run import FrameMode, Run

_FAR = 3.0  # scatters of the cells, from which on a deviation is unusual
_AGREE = 2.0  # standard uncertainties of a difference
_FEW = 10  # repetitions, below which more are the cheapest improvement
_LOW_COHERENCE = 0.8
_DOMINANT = 0.5  # of the variance
_MEANS = {
    "joint": {
        "noise": "random scatter of the cells around one curve along the axis",
        "conditions": "change of the curve if PA, PD, NA or ND is used alone: window, motion and friction",
        "weights": "half of the change if the colour of the noise is ignored",
        "load": "softening of the nut by the test's own load: model uncertainty; wear assumed uniform",
        "residual": "response that the model does not explain: possibly a force that was not measured",
        "ripple": "a force that repeats between whole orders of a turn, and is modelled only in part",
        "local": "one stop deviates from its neighbours, and the course between them is unknown",
        "drives": "half of the difference between the curves from motor motion and from torque",
        "model": "lower limit of the uncertainty for any model of a run",
        "steps": "the torque is recorded in coarse steps",
        "clock": "the recorder's clock: 0.05 %, or its deviation from the plan",
        "damping": "dampers that lie in nut and bearings alone raise the frequency of a damped mode",
        "frame": "a mode of the machine's frame or of a pitching table, which is modelled with its own error",
    },
    "paper": {
        "repetitions": "scatter of the peak from repetition to repetition",
        "window": "shift of the peak if the window is 15 % longer or shorter",
        "moving table": "change of the frequency along the table's motion during the window",
        "method": "offset of the peak from the undamped frequency under so short a window",
        "conditions": "disagreement of the conditions at one stop",
    },
}  # fmt: skip
_HELP = {
    "noise": "more repetitions; four times as many halve this term",
    "repetitions": "more repetitions; four times as many halve this term",
    "conditions": "all four conditions at every stop, a longer dwell, and a check of the friction while the "
    "table starts and stops",
    "weights": "quieter or better fastened accelerometers: the result depends on the assumed noise",
    "drives": "a finer motor encoder, and a check of the scales of torque and position, which disagree",
    "model": "nothing in this run; this is the limit of the method",
    "steps": "a finer resolution of the torque",
    "clock": "nothing in this run; a recorder with a better clock",
    "damping": "nothing in this run; less grease, where the damping ratio has risen",
    "frame": "another load, or stops farther from each other, which move the two modes apart",
    "load": "a lower acceleration, or less load on the table, so that the test unloads the nut less",
    "residual": "more jerk, and a check of what else shakes the table: balls, a loose cover, the guide",
    "ripple": "another speed, which shifts the frequency of forces that repeat within a turn, as of a belt",
    "local": "stops nearer to each other around this one",
    "window": "a longer acceleration phase and dwell, which allow a longer window",
    "moving table": "a lower speed, or a shorter phase: the table moves less while it vibrates",
    "method": "the default method (--method joint), which models these effects",
}
_TONE = (
    "Provide a data sheet (--axis): with the lead, forces that repeat with every turn are modelled beside "
    "the mode. Or use another speed: such a force moves with it, the mode does not."
)


@dataclass(frozen=True, slots=True)
class Paragraph:
    """One part of the explanation.

    Parameters
    ----------
    title : str
        Subject.
    lines : tuple of str
        Sentences.
    listed : bool
        Whether the sentences are items of a list.
    before : str
        Sentence before the list.
    """

    title: str
    lines: tuple[str, ...]
    listed: bool = False
    before: str = ""


def headline(evidence: Evidence) -> str:
    """Axis, cell and frequency in one line, without the verdict.

    Parameters
    ----------
    evidence : Evidence
        Evidence for the cell.

    Returns
    -------
    str
        One line.
    """
    cell, run = evidence.cell, evidence.run
    where = place(cell)
    if any(other.motion != cell.motion for other in run.cells):
        where += f", motion {cell.motion}"
    if run.mass_kg is not None:
        where += f", load {run.mass_kg:g} kg"
    value = _value(cell.frequency_Hz, cell.standard_uncertainty_Hz) or "no frequency"
    return f"{run.axis or 'axis'}, {where}: {value}"


def place(cell: CellResult) -> str:
    """Stop and condition of a cell, ``"45 mm PD"``."""
    return f"{round(1e3 * cell.position_m, 1) + 0.0:g} mm {cell.condition}"


def explain(evidence: Evidence) -> tuple[Paragraph, ...]:
    """Explanation of a cell's result, or of its refusal.

    Parameters
    ----------
    evidence : Evidence
        Evidence for the cell.

    Returns
    -------
    tuple of Paragraph
        From the measurement to what would improve the result.
    """
    parts = (
        Paragraph("Measurement", _measured(evidence)),
        _frequency(evidence.cell),
        Paragraph("Rotor held", _rotor_held(evidence.cell)),
        Paragraph("Mode of frame or table", _frame(evidence.run)),
        Paragraph("Forces that repeat with every turn", _ripple(evidence.run)),
        Paragraph("This cell and the others", _deviation(evidence)),
        Paragraph("Coherence", _coherence(evidence.cell)),
        Paragraph("Peak of the FRF (method of the paper)", _paper(evidence)),
        _verdict(evidence),
        Paragraph("Improvements", advice(evidence), listed=True),
    )  # fmt: skip
    return tuple(part for part in parts if part.lines)


def _verdict(evidence: Evidence) -> Paragraph:
    cell = evidence.cell
    title = f"Verdict: {cell.verdict}"
    if cell.reasons:
        return Paragraph(title, cell.reasons, listed=True)
    if _far(evidence):
        return Paragraph(title, ("The run supports this result; this cell's own data do not (see above).",))
    return Paragraph(title, ("No problems found.",))


def _far(evidence: Evidence) -> bool:
    """True if the cell deviates from the curve by more than noise and the scatter of the cells explain."""
    deviation = abs(evidence.cell.deviation_Hz or 0.0)
    noise = NORMAL_95 * (evidence.cell.deviation_standard_uncertainty_Hz or 0.0)
    if evidence.scatter is None:
        return deviation > noise
    return deviation > max(noise, _FAR * evidence.scatter)


def _value(frequency: float | None, uncertainty: float | None) -> str:
    """Frequency with its 95 % interval; empty where there is none."""
    if frequency is None:
        return ""
    if uncertainty is None or not math.isfinite(uncertainty):
        return f"{frequency:.1f} Hz"
    half = NORMAL_95 * uncertainty
    digits = 2
    if half >= 0.15:
        digits = 1
    return f"{frequency:.{digits}f} ± {half:.{digits}f} Hz (95 %)"


def _measured(evidence: Evidence) -> tuple[str, ...]:
    cell, run = evidence.cell, evidence.run
    quality = f"Measurement {run.quality.verdict}."
    if run.quality.reasons:
        quality = f"Measurement {run.quality.verdict}: {'; '.join(run.quality.reasons)}."
    if not evidence.found:
        return (quality, "No transient of this cell was found in the recordings.")
    cut, remaining = evidence.found - evidence.whole, evidence.whole - cell.repetitions
    counts = f"{plural(evidence.found, 'transient')} of this cell in {plural(len(run.files), 'recording')}"
    if cell.repetitions == evidence.found:
        counts += ", all used"
    else:
        counts += f", {cell.repetitions} used"
    if cut:
        counts += f"; {cut} cut by the start or end of a recording, or part of a warm-up"
    if remaining > 0 and cell.repetitions:
        counts += f"; {remaining} could not be aligned with the others"
    return (quality, f"{counts}.")


def _frequency(cell: CellResult) -> Paragraph:
    value = _value(cell.frequency_Hz, cell.standard_uncertainty_Hz) or "none"
    means = _MEANS.get(cell.method, {})
    lines = []
    for name, term in sorted(cell.uncertainty_terms_Hz.items(), key=lambda item: -item[1]):
        lines.append(f"{name}, {term:.2f} Hz: {means.get(name, 'a further term')}")
    before, total = "", cell.standard_uncertainty_Hz
    if total is not None:
        before = f"The standard uncertainty is {total:.2f} Hz. Its terms, largest first (squares add up):"
    return Paragraph(f"Frequency, rotor free: {value}", tuple(lines), listed=True, before=before)


def _rotor_held(cell: CellResult) -> tuple[str, ...]:
    fixed, free = cell.rotor_held_frequency_Hz, cell.frequency_Hz
    if fixed is None or free is None:
        return ()
    value = _value(fixed, cell.rotor_held_standard_uncertainty_Hz)
    share = 100 * (fixed / free) ** 2
    meaning = "natural frequency of the table with the motor at rest, Eq. (3) of the paper"
    rotor = f"By the square of the frequencies' ratio, the rotor is {share:.0f} % of all that moves"
    return (f"{value}: {meaning}. {rotor}.",)


def _frame(run: Run) -> tuple[str, ...]:
    return () if run.frame_mode is None else (frame_words(run.frame_mode),)


def _ripple(run: Run) -> tuple[str, ...]:
    rows = []
    for row in run.motor_ripple or ():
        size, spread = row.torque_Nm, row.standard_uncertainty_Nm
        if size is None or spread is None:
            rows.append(f"{row.order} (size unknown)")
        else:
            rows.append(f"{row.order} ({1e3 * size:.1f} ± {1e3 * NORMAL_95 * spread:.1f} N·mm)")
    if not rows:
        return ()
    why = "Causes are cogging of the motor, and unevenness of screw or nut; they do not count as axial modes."
    if any("ripple" in cell.uncertainty_terms_Hz for cell in run.cells):
        why = (
            "Neighbouring orders come from one force between them, as behind a belt; the uncertainty term "
            "'ripple' covers the part that is not modelled."
        )
    return (f"Unmeasured forces were found at these orders (times a turn): {', '.join(rows)}. {why}",)


def frame_words(mode: FrameMode) -> str:
    """Sentence on the mode of the frame or of the pitching table.

    Parameters
    ----------
    mode : FrameMode
        As found.

    Returns
    -------
    str
        Frequency with its 95 % interval, and what it means for the frequencies reported.
    """
    frequency = _value(mode.frequency_Hz, mode.standard_uncertainty_Hz)
    if mode.pitching:
        return f"The table pitches at {frequency}. Frequencies are those of the axis without pitching."
    text = f"The machine's frame has a mode at {frequency}"
    if mode.mass_ratio is not None:
        text += f", with {mode.mass_ratio:.1f} times the moving mass"
    return f"{text}. Frequencies are those of the axis with the frame blocked."


def _deviation(evidence: Evidence) -> tuple[str, ...]:
    cell = evidence.cell
    if cell.frequency_Hz is None or cell.deviation_Hz is None:
        return ()
    half = NORMAL_95 * (cell.deviation_standard_uncertainty_Hz or 0.0)
    own = f"{cell.deviation_Hz:+.2f} ± {half:.2f} Hz (95 %, noise only)"
    lines = [f"This cell's own data deviate by {own} from the curve of all cells, which is the result."]
    if evidence.scatter is not None:
        conclusion = "this is within the usual scatter"
        if _far(evidence):
            conclusion = "this is an outlier: check this stop"
        lines.append(f"The cells of this run scatter by {evidence.scatter:.2f} Hz; {conclusion}.")
    siblings = [sibling for sibling in evidence.siblings if sibling.deviation_Hz is not None]
    if siblings:
        others = ", ".join(f"{sibling.condition} {sibling.deviation_Hz:+.2f}" for sibling in siblings)
        lines.append(
            f"Other conditions at this stop: {others} Hz. A local defect shifts all of them in the same "
            "direction; friction, motion and noise do not."
        )
    return tuple(lines)


def _coherence(cell: CellResult) -> tuple[str, ...]:
    if cell.coherence is None:
        return ()
    text = (
        f"{cell.coherence:.2f} at the frequency: the part of the acceleration that follows the torque alike "
    )
    text += "in every repetition"
    if cell.repetitions > 1:
        text += f"; unrelated signals would give {1 / cell.repetitions:.2f}"
    if 1 < cell.repetitions < 5:
        text += ". With so few repetitions it is not conclusive"
    return (f"{text}.",)


def _paper(evidence: Evidence) -> tuple[str, ...]:
    paper = evidence.paper
    if evidence.cell.method == "paper":
        return ()
    if paper.frequency_Hz is None:
        return (f"Refused: {'; '.join(paper.reasons)}.",)
    text = f"{_value(paper.frequency_Hz, paper.standard_uncertainty_Hz)}, {paper.verdict}"
    return (f"{text}{_comparison(evidence.cell, paper.frequency_Hz, paper.standard_uncertainty_Hz)}.",)


def _comparison(cell: CellResult, frequency: float, uncertainty: float | None) -> str:
    """Difference from the result of the run, and whether it is significant."""
    if cell.frequency_Hz is None:
        return ""
    difference = frequency - cell.frequency_Hz
    combined = math.hypot(uncertainty or 0.0, cell.standard_uncertainty_Hz or 0.0)
    direction, conclusion = "below", "consistent"
    if difference > 0:
        direction = "above"
    if abs(difference) > _AGREE * combined:
        conclusion = "more than their uncertainties explain"
    return f"; {abs(difference):.2f} Hz {direction} the result of the run: {conclusion}"


def advice(evidence: Evidence) -> tuple[str, ...]:
    """Measures that would improve the result of a cell.

    Parameters
    ----------
    evidence : Evidence
        Evidence for the cell.

    Returns
    -------
    tuple of str
        The most effective first.
    """
    cell, run = evidence.cell, evidence.run
    if run.quality.verdict == "bad":
        return ("Correct what the reasons of the measurement name, and measure again.",)
    if evidence.whole == 0:
        return ("Run the whole plan, and supply all recordings of the run: this cell was not measured.",)
    measures = []
    if cell.frequency_Hz is None:
        measures.append(_find_mode(evidence))
    helps = _dominant_terms(cell.uncertainty_terms_Hz)
    measures += helps
    if cell.repetitions < _FEW and not any("more repetitions" in text for text in helps):
        measures.append(
            f"More repetitions: {cell.repetitions} now; {_FEW} or more allow outliers to be found."
        )
    if cell.coherence is not None and cell.coherence < _LOW_COHERENCE:
        measures.append("A shorter jerk time, which excites more, or quieter sensors: the coherence is low.")
    return tuple(measures)


def _find_mode(evidence: Evidence) -> str:
    """For a refused cell: whether the peak of the FRF shows where to look."""
    cell, paper = evidence.cell, evidence.paper
    if any(kind in ("tone", "unmeasured-force") for kind in cell.reason_kinds):
        return _TONE
    if cell.method != "paper" and paper.frequency_Hz is not None:
        return (
            f"A search with --band around the peak at {paper.frequency_Hz:.1f} Hz, which may not be the mode."
        )
    return (
        "A motion that excites the mode (ballscrew plan states the relative torque): the frequency response "
        "of this cell shows none (--plot)."
    )


def _dominant_terms(terms: dict[str, float]) -> list[str]:
    """Measures against the terms that make up half of the variance."""
    total = sum(value**2 for value in terms.values())
    measures, covered = [], 0.0
    for name, value in sorted(terms.items(), key=lambda item: -item[1]):
        if covered >= _DOMINANT * total or value == 0:
            break
        covered += value**2
        measures.append(f"Against {name}, {value:.2f} Hz: {_HELP[name]}.")
    return measures
