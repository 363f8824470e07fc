"""What the machine is: its data sheet, its compliances, and the frequency that they predict."""
