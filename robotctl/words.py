"""Words for people."""

from __future__ import annotations


def counted(count: int, noun: str, plural: str = "") -> str:
    """Return a count with its noun, in the plural but for 1: "0 plans", "1 plan"."""
    return f"{count} {noun if count == 1 else plural or f'{noun}s'}"
