"""Axial model of an axis, with its uncertainties, from runs at several loads."""
