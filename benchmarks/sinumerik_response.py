"""A frequency response that SINUMERIK measured, against the spectra in its own file, and halves of its data.

    python -m benchmarks.sinumerik_response --file FILE.xml [--plot FILE.png] [--page PAGE]

The file has the time series of set-point and actual speed in both directions, each one period of a binary
sequence, and the cross- and autospectra that the control computed. The response of the whole is compared with
theirs; antiresonance and resonance are estimated by both series, and by each of them alone in the same band.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

import ballscrew
from ballscrew.modal.resonance_verdicts import EstimatedMode
from ballscrew.modal.resonances import Resonances
from ballscrew.recording.readers.process import opened
from ballscrew.recording.readers.sinumerik import _decoded
from ballscrew.report.canvas import save_figure
from ballscrew.report.resonance_figure import draw_responses
from benchmarks.identification_tables import write
from benchmarks.machine import heading

Series = list[NDArray[np.float64]]
SET_POINT, ACTUAL = "62", "61"
RANGE = (20.0, 500.0)  # Hz, of the comparison


def spectra(path: Path) -> tuple[NDArray[np.complex128], NDArray[np.float64]]:
    """Response and frequencies (Hz) of the file's own spectra, from the second line on."""
    found: dict[tuple[str, str | None], tuple[NDArray[np.complex128], NDArray[np.float64]]] = {}
    for info in ElementTree.parse(path).getroot().iter("SigNodeCrossSpectrumInfo"):  # noqa: S314  a file of ours
        spectrum = info.find("CrossSpectrum")
        assert spectrum is not None
        numbers = {
            each.get("name"): _decoded(path, "spectrum", next(each.iter("raw")).text or "")
            for each in spectrum.iter("NumericArray")
        }
        parts = numbers["m_ValueVector"].view(np.complex128)
        signal = info.findtext("unsigned_int")
        kind = "auto" if info.get("name") == "m_autospectrumInfo" else "cross"
        found[kind, signal] = parts, numbers["m_FrequencyVector"]
    cross, frequencies = found["cross", SET_POINT]
    response: NDArray[np.complex128] = np.conj(cross) / found["auto", SET_POINT][0]
    return response[1:], frequencies[1:]


def time_series(path: Path) -> tuple[Series, Series, float]:
    """Set-point and actual speed of both series, and their rate, Hz."""
    with opened(path) as file:
        names = [channel.name for channel in file.header.channels]
        rate = file.header.channels[0].sample_rate
        values = file.read(names)
    assert rate is not None
    inputs, outputs = (
        [values[name] for name in names if name.startswith(f"signal {number},")]
        for number in (SET_POINT, ACTUAL)
    )
    return inputs, outputs, rate


def difference(path: Path, inputs: Series, outputs: Series, rate: float) -> tuple[float, float]:
    """Largest relative difference of the responses, and of their frequencies."""
    before, after = (np.array([np.fft.rfft(x)[1:] for x in series]) for series in (inputs, outputs))
    own = np.sum(np.conj(before) * after, axis=0) / np.sum(np.abs(before) ** 2, axis=0)
    response, frequencies = spectra(path)
    lines = np.arange(1, len(response) + 1) * rate / len(inputs[0])
    within = (lines > RANGE[0]) & (lines < RANGE[1])
    deviation = np.abs(response / own[: len(response)] - 1)[within]
    return float(deviation.max()), float(np.max(frequencies[within] / lines[within] - 1))


def _text(mode: EstimatedMode) -> str:
    if mode.frequency is None:
        return mode.verdict
    low, high = mode.frequency.interval
    return f"{mode.frequency.value:.1f} ({low:.1f} to {high:.1f}), {mode.verdict}"


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--file", type=Path, required=True)
    parser.add_argument("--plot", type=Path)
    parser.add_argument("--page", type=Path)
    given = parser.parse_args()
    inputs, outputs, rate = time_series(given.file)

    def estimated(part: slice, band: tuple[float, float] | None) -> Resonances:
        return ballscrew.resonances(
            inputs[part], outputs[part], rate, quantities=("speed", "speed"), band=band
        )

    whole = estimated(slice(None), None)
    rows = [("both series", whole)]
    rows += [(f"series {at + 1}", estimated(slice(at, at + 1), whole.band)) for at in range(len(inputs))]
    response, frequency = difference(given.file, inputs, outputs, rate)
    text = (
        f"Response against the file's own spectra, {RANGE[0]:g} to {RANGE[1]:g} Hz: largest relative "
        f"difference {response:.0e}; the file's frequencies are {100 * frequency:.2f} % higher."
    )
    lines = [
        text,
        "",
        "| data | antiresonance, Hz (95 %) | resonance of the closed loop, Hz (95 %) |",
        "|---|---|---|",
        *(f"| {name} | {_text(found.antiresonance)} | {_text(found.resonance)} |" for name, found in rows),
        "",
        heading("python -m benchmarks.sinumerik_response"),
    ]
    print("\n".join(lines))
    if given.plot is not None:
        save_figure(draw_responses([(0.0, whole)]), given.plot)
    if given.page is not None:
        write(given.page, "sinumerik-response", lines)


if __name__ == "__main__":
    main()
