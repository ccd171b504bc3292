"""Watching the nights: trends over many results, where they changed, whether the newest drifted."""
