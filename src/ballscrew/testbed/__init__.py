"""Simulated measurements of a machine with known values: dynamics, drive, instruments and wear."""
