"""What a known machine would have measured: its dynamics, drive, instruments, wear and faults."""
