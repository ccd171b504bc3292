"""Shares in words: 0.946 as `95 %`."""

from __future__ import annotations


def per_cent(share: float, decimals: int = 0) -> str:
    """Return a share (1 is all) as per cent, with `decimals` digits after the point."""
    return f"{100.0 * share:.{decimals}f} %"
