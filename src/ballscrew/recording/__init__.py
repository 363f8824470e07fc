"""Measurements: from files to a recording, its quality and its transients."""
