"""Gains that pass with the highest probability over what is not known of the machine."""
