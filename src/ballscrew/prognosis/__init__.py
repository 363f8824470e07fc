"""Remaining life from the history of an epoch by the laws of wear."""
