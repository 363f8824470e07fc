"""What does it look like?  Results → figures."""
