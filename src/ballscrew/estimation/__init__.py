"""Preload of a run by a model: its value, its change and the likely causes."""
