"""Sending of runs to a server: what a run is, the spool on the disk, and the way over the network."""
