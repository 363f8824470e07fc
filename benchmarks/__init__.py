"""Benchmarks: each a command, each prints its table.  Nothing here is timed in a test."""
