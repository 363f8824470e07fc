"""The quality gate: whether a measurement can be believed, and why not, in words."""
