"""The acceptance language: what a metric must keep, and what a channel must keep."""
