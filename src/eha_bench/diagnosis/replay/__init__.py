"""Whole runs, simulated freely from their inputs and first sample."""
