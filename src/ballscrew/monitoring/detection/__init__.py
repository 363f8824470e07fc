"""Early detection: charts with a fixed reference, and limits that are simulated for the axis and its runs."""
