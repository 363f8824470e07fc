"""The machine: its data sheet, its compliances, and the frequency that they predict."""
