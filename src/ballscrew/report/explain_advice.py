"""What would make the number of a cell better."""

from __future__ import annotations

from ballscrew.modal.evidence import Evidence

__all__ = ["advice"]

_FEW = 10  # repetitions, below which more are the cheapest help
_LOW = 0.8  # coherence
_DOMINANT = 0.5  # of the variance
_APART = 2.0  # standard uncertainties of a difference
_HELP = {
    "noise": "more repetitions: four times as many halve this part",
    "repetitions": "more repetitions: four times as many halve this part",
    "conditions": "all four conditions at every stop, a longer dwell, and a look at the friction while the "
    "table starts and stops",
    "weights": "quieter or better fastened accelerometers: the answer hangs on how the noise is weighed",
    "drives": "a finer motor encoder, and a check of the scales of torque and position: the two ways to the "
    "mode differ",
    "model": "nothing in this run: it is the floor of the method",
    "load": "a lower acceleration, or less load on the table: the test then unloads the nut less",
    "left": "more jerk, and a look at what else shakes the table: balls, a loose cover, the guide",
    "ripple": "another speed: what repeats with part of a turn, as by a belt, meets the mode elsewhere then",
    "local": "stops nearer to each other about this one",
    "window": "a longer acceleration phase and dwell, so that a longer window finds room",
    "moving table": "a lower speed, or a shorter phase: the table moves less while it rings",
    "method": "the default method (--method joint), which models what the peak leaves out",
}

_TONE = (
    "A data sheet (--axis), which tells the lead: then what repeats with every turn is told beside the mode. "
    "Else another speed: a tone moves with it, and the mode does not."
)


def advice(told: Evidence) -> tuple[str, ...]:
    """Say what would make the number of a cell better.

    Parameters
    ----------
    told : Evidence
        Of the cell.

    Returns
    -------
    tuple of str
        What helps most stands first.
    """
    cell, run = told.cell, told.run
    if run.quality.verdict == "bad":
        return ("Put right what the measurement's reasons say, and measure again.",)
    if told.whole == 0:
        return ("Run the whole plan, and give all recordings of the run: this cell was not measured.",)
    out = [] if cell.frequency_Hz is not None else [_refused(told)]
    out += _terms(cell.uncertainty_terms_Hz)
    if cell.repetitions < _FEW and not any("more repetitions" in each for each in out):
        out.append(f"More repetitions: there are {cell.repetitions}, and {_FEW} or more let strays be told.")
    if cell.coherence is not None and cell.coherence < _LOW:
        out.append(
            "A shorter jerk time, which excites more at the mode, or quieter sensors: the coherence is low."
        )
    return tuple(out)


def _refused(told: Evidence) -> str:
    """Help for a refused cell: whether the paper's peak finds a mode, which says where to look."""
    if any("force which repeats" in why or "was not measured" in why for why in told.cell.reasons):
        return _TONE
    peak = told.paper.frequency_Hz
    if told.cell.method != "paper" and peak is not None:
        return f"A look with --band around the paper's peak at {peak:.1f} Hz, which is no proof by itself."
    return "A look at the picture (--plot): the cell's frequency response shows no mode."


def _terms(terms: dict[str, float]) -> list[str]:
    """Help against the parts that make half of the variance."""
    whole = sum(value**2 for value in terms.values())
    out, so_far = [], 0.0
    for name, value in sorted(terms.items(), key=lambda item: -item[1]):
        if so_far >= _DOMINANT * whole or value == 0:
            break
        so_far += value**2
        out.append(f"Against {name}, {value:.2f} Hz: {_HELP[name]}.")
    return out
