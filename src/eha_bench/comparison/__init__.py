"""Comparing results: differences with intervals, corrected for how many metrics were looked at."""
