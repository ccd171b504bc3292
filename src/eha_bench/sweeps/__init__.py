"""A suite at many points: over gains, parameters, effects and keys of its trials."""
