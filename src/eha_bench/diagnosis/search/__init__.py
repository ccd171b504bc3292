"""What is missing: one known effect after the other."""
