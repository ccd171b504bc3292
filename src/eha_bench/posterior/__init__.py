"""What recordings left unknown of a machine, and draws of it."""
