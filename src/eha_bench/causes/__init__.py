"""Causes behind a history: what of the machine wears, since when, how fast, for how long yet."""
