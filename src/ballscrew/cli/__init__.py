"""The command line: one command group per room, the same words as the Python API."""
