"""Targets: a trial becomes a recording, on a simulator, a rig, an FMU or an old log."""
