"""Evidence of the members of a family: the Kalman filter against the covariance of the whole process."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import log_ndtr
from scipy.stats import multivariate_normal
from tests.prognosis.lives import made

from ballscrew.prognosis.families import FAMILIES, N_PARAMETERS, Family, FamilyPrior, wear_depth
from ballscrew.prognosis.family_process import AHEAD, evidence_of
from ballscrew.prognosis.readings import readings_of

MEMBERS = 5
READINGS = replace(
    readings_of(made(24), 50),
    temperature=3 * np.random.default_rng(2).standard_normal(25),
    start_deviation=0.02,
)


DUTIES = {
    "of days": READINGS.days,
    "in pairs": READINGS.days - READINGS.days % 2,
    "none": np.zeros(len(READINGS.days)),
}


@pytest.mark.parametrize("duty", DUTIES.values(), ids=DUTIES)
@pytest.mark.parametrize("family", FAMILIES, ids=lambda family: family.name)
def test_evidence_and_forecasts_are_those_of_the_whole_covariance(family: Family, duty: np.ndarray) -> None:
    random = np.random.default_rng(1)
    z = np.zeros((MEMBERS, N_PARAMETERS))
    z[:, family.free] = random.standard_normal((MEMBERS, len(family.free)))
    cloud = family.cloud(z, FamilyPrior(), float(duty[-1]))
    found = evidence_of(cloud, duty, READINGS)
    course, since = cloud.rate[:, None] * cloud.course(duty), cloud.since(duty)
    for member in range(MEMBERS):
        exponent, g = cloud.exponent[member], course[member]
        depth = wear_depth(READINGS.remaining, exponent)
        slope = READINGS.smoothed**-exponent
        warm = READINGS.kelvin_deviation * READINGS.temperature * slope
        spread = cloud.noise[member] * READINGS.uncertainty * slope
        pace = (cloud.walk[member] * READINGS.typical) ** 2
        by_motion = pace * np.minimum(since[member][:, None], since[member])
        whole = (
            np.outer(g, g)
            + by_motion
            + READINGS.start_deviation**2
            + np.outer(warm, warm)
            + np.diag(spread**2)
        )
        density = multivariate_normal(cov=whole).logpdf(depth) + len(duty) / 2 * np.log(2 * np.pi)
        assert found.gains[member].sum() == pytest.approx(density + np.log(slope).sum(), abs=1e-4)
        mean, variance = g @ np.linalg.solve(whole, depth), 1 - g @ np.linalg.solve(whole, g)
        assert found.positive[member] == pytest.approx(log_ndtr(mean / np.sqrt(variance)), rel=1e-4)
        for column, ahead in enumerate(AHEAD):
            for reading in range(ahead, len(duty), 5):
                known = slice(0, reading - ahead + 1)
                gain = np.linalg.solve(whole[known, known], whole[known, reading])
                deviation = np.sqrt(whole[reading, reading] - gain @ whole[known, reading])
                error = (depth[reading] - gain @ depth[known]) / deviation
                assert found.error[member, reading, column] == pytest.approx(error, abs=1e-4)
                expected = -0.5 * error**2 - np.log(deviation / slope[reading])
                assert found.density[member, reading, column] == pytest.approx(expected, abs=1e-4)
            assert np.isnan(found.error[member, :ahead, column]).all()
