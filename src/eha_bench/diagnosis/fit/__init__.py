"""The simulation error over windows, its minimum, and what the minimum is worth."""
