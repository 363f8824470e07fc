"""Figures, texts and pages of results."""
