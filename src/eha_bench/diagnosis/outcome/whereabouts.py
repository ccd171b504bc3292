"""Where something acts, in words: its balance, or its sensor, and the place of its best curve."""

from __future__ import annotations

_MEASUREMENT = "measurement"


def channel_of(place: str) -> str:
    """Return the channel where a place is its sensor, else the place."""
    return place.removesuffix(".sensor")


def element_of(place: str) -> str:
    """Return the channel where a place is its sensor, the element where it is its drive."""
    return channel_of(place).removesuffix(".drive")


def acts_in(equation: str, place: str) -> str:
    """Return "acts in the ..." of a balance, and of where a curve of it does best.

    Args:
        equation: balance. place: node, element or sensor of the curve; "" where there is none.
    """
    if equation == _MEASUREMENT:
        return f"acts in the measurement of {channel_of(place) or 'a channel'}"
    text = f"acts in the {equation} balance"
    return f"{text}, best described at '{place}'" if place else text
