"""The floor that every other room stands on: channels, units, recordings, trials, results."""
