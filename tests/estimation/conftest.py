"""The known axis and its runs, as the tests of the calibration have them."""

from tests.calibration.conftest import experiment, heavier, sheet, truth

__all__ = ["experiment", "heavier", "sheet", "truth"]
