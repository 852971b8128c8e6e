"""Manners in which people walk."""

from __future__ import annotations

import argparse
from enum import StrEnum
from typing import Final

import numpy as np

from firmware_sim.errors import nearest


class Manner(StrEnum):
    """Manner of walking; `firmware_sim.world.walking.walkers` has a walker for each."""

    STUBBORN = "stubborn"
    """Path at a steady speed, whoever is in the way."""
    EVADES = "evades"
    """Path, off the robot, people and walls; turns back where it is stuck."""
    WANDERS = "wanders"
    """Random directions, speeds and stops, whoever is in the way."""
    RUNS = "runs"
    """Bursts of running with sudden turns and stops, like a child."""


STUBBORN: Final = (Manner.STUBBORN,)
"""Manners of people of whom nothing is said."""
MIXED: Final = "mixed"
"""Name of all manners in turn."""


def parse_manners(text: str) -> tuple[Manner, ...]:
    """Return the manners that a command line names: one, several with commas, or `mixed`.

    Raises
    ------
    argparse.ArgumentTypeError
        If there is no such manner.
    """
    if text == MIXED:
        return tuple(Manner)
    manners = [each.value for each in Manner]
    for word in text.split(","):
        if word not in manners:
            raise argparse.ArgumentTypeError(
                f"{word!r} is no manner of walking; allowed: {', '.join(manners)}, several with "
                f"commas, {MIXED}{nearest(word, [*manners, MIXED])}"
            )
    return tuple(Manner(word) for word in text.split(","))


def deal(manners: tuple[Manner, ...], count: int, rng: np.random.Generator) -> list[Manner]:
    """Return manners for some people, each equally often as far as their number allows."""
    if len(manners) == 1:  # takes no draw, so that walkers of one manner keep their paths
        return [*manners] * count
    first = int(rng.integers(len(manners)))
    return [manners[(first + number) % len(manners)] for number in range(count)]
