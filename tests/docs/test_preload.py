"""Every key of a preload's JSON is documented, and so is every assumption's default."""

from __future__ import annotations

import re

from tests.docs.pages import first_column, page, section
from tests.estimation.made_runs import calibrated, run_of

from ballscrew.calibration.anchors import SOFTENING_REPEATS
from ballscrew.calibration.assumptions import BEARING_PRELOAD, Assumptions
from ballscrew.estimation.causes import describe_cause
from ballscrew.estimation.preload import preload
from ballscrew.modal.run import SOFTENING_SPREAD

PAGE = "docs/reference/preload-json.md"


def test_every_key_is_documented_and_every_documented_key_exists() -> None:
    text = page(PAGE)
    document = preload(run_of(0.6), calibrated(), run_of(name="base")).to_json()
    assert first_column(text.split("\n## ")[0]) == list(document)
    for key in ("parts", "nut_or_bearing", "mass", "profile"):
        assert set(first_column(section(text, f"`{key}`"))) == set(document[key]), key
    assert set(first_column(section(text, "`causes`"))) == set(document["causes"][0])
    assert set(document["profile"]["local"]) <= set(re.findall(r"`(\w+)`", section(text, "`profile`")))


def test_every_cause_is_named() -> None:
    named = re.search(r"\| `cause` \| (.*) \|", page(PAGE))
    assert named is not None
    for cause in re.findall(r"`([\w ]+)`", named[1]):
        assert describe_cause(cause, 0.1)


def test_the_defaults_on_the_page_are_those_of_the_code() -> None:
    text, defaults = " ".join(page("docs/explanation/preload.md").split()), Assumptions()
    for row, value in (
        (r"declared load \| ([\d.]+) %", 100 * defaults.load),
        (r"zero of the position \| ([\d.]+) mm", 1e3 * defaults.position),
        (r"preload since the baseline \| ([\d.]+) %", 100 * BEARING_PRELOAD),
        (r"default of ([\d.]+) % of P_b", 100 * BEARING_PRELOAD),
        (r"share, tilt, bow \| ([\d.]+) %", 100 * defaults.share),
        (r"share, tilt, bow \| [\d.]+ %, ([\d.]+) %", 100 * defaults.tilt),
        (r"of the change at the ends, ([\d.]+) ‰", 1e3 * defaults.form),
        (r"nut \| ([\d.]+) times the baseline's term \*load\*", defaults.nut_load),
        (r"\*load\*, ± ([\d.]+)", defaults.nut_load_spread),
        (r"learned, or 0 ± ([\d.]+) %", 100 * defaults.temperature),
        (r"; ± ([\d.]+) K where it was not recorded", defaults.temperature_unknown),
        (r"chances of ([\d.]+) % for the nut", 100 * defaults.priors.nut_chance),
        (r"nut, ([\d.]+) % for the zero", 100 * defaults.priors.position_chance),
        (r"zero, ([\d.]+) % for nut and bearing", 100 * defaults.priors.both_chance),
        (r"at one end and ([\d.]+) % for each", 100 * defaults.priors.load_chance),
        (r"sizes of ([\d.]+) of u", defaults.priors.nut_size),
        (r"for the nut, ([\d.]+) % for the bearing", 100 * defaults.priors.bearing_size),
        (r"bearing is then allowed ([\d.]+) % of its rigidity", 100 * defaults.priors.bearing_size),
        (r"ratio ([\d.]+) % of the variance by its law", 100 * SOFTENING_REPEATS),
        (r"variance by its law \(([\d.]+) %\)", 100 * SOFTENING_SPREAD),
    ):
        found = re.search(row, text)
        assert found is not None, row
        assert abs(float(found[1]) - value) < 1e-9, row
