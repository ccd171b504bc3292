"""Closes the loop: residual of a model against recordings, its cause, and a revised model."""
