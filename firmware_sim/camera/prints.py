"""Posters and notices on walls and furniture, by which a camera distinguishes places.

Each side of a thing is cut into slots of about `SLOT_M`, and most of these have a print: a window
of three patterns, mixed and coloured as no other one.
"""

from __future__ import annotations

import colorsys
from dataclasses import dataclass
from typing import Final

import numpy as np

from firmware_sim.camera.floor import PERIOD_M

SLOT_M: Final = 0.9
SHARE: Final = 0.6
"""Share of the slots that have a print."""
_LEAST_SLOT_M: Final = 0.3
_MARGIN_M: Final = 0.05
"""Margin between a print and the end of its slot, or the top of its thing [m]."""
_WIDTH_M: Final = (0.2, 0.4)
_FOOT_M: Final = (0.4, 0.6)
"""Range of the height of the lower edge [m]: below it walls are plain, so that their feet show."""
_HEIGHT_M: Final = (0.25, 0.7)
_HUE: Final = (0.25, 0.9)
"""Hues of prints, from green over blue to violet: other hues are those of floors."""
_SATURATION: Final = (0.5, 0.9)
_BRIGHTNESS: Final = 1.2

PRINT: Final = np.dtype(
    [
        (name, np.float64)
        for name in (
            "left", "right", "low", "high", "x", "y", "first", "second", "third",
            "blue", "green", "red",
        )
    ]
)  # fmt: skip
"""A print: its extent along its side and upwards [m]; the offset to its window of the patterns [m];
the patterns' shares; its colour."""
NONE: Final = np.zeros(0, dtype=PRINT)
"""Slots of a side without prints."""


@dataclass(frozen=True, slots=True, eq=False)
class Prints:
    """All prints of a scene.

    Attributes
    ----------
    slots
        (n,) of `PRINT`; one without a print is empty.
    first
        First slot of each side, (sides,).
    per_m
        Slots per metre of each side, (sides,); 0 where there are none.
    """

    slots: np.ndarray
    first: np.ndarray
    per_m: np.ndarray


def prints_of(sides: list[np.ndarray], lengths_m: np.ndarray) -> Prints:
    """Return the prints of a scene from the slots and the length of each side."""
    counts = np.array([len(each) for each in sides], dtype=np.int64)
    # One more, for pixels that rounding puts behind the last slot.
    slots = np.concatenate([*sides, np.zeros(1, dtype=PRINT)])
    return Prints(slots, np.cumsum(counts) - counts, counts / lengths_m)


def side_slots(length_m: float, height_m: float, rng: np.random.Generator) -> np.ndarray:
    """Draw the slots of one side of a thing, (n,) of `PRINT`; none of a short one."""
    if length_m < _LEAST_SLOT_M:
        return NONE
    n = max(1, int(length_m / SLOT_M))
    slots = np.zeros(n, dtype=PRINT)
    room_m = length_m / n - 2.0 * _MARGIN_M
    width = np.minimum(rng.uniform(*_WIDTH_M, n), room_m)
    slots["left"] = np.arange(n) * (room_m + 2.0 * _MARGIN_M) + _MARGIN_M
    slots["left"] += rng.random(n) * (room_m - width)
    slots["right"] = slots["left"] + width
    slots["low"] = rng.uniform(*_FOOT_M, n)
    slots["high"] = np.minimum(slots["low"] + rng.uniform(*_HEIGHT_M, n), height_m - _MARGIN_M)
    slots["x"], slots["y"] = rng.uniform(0.0, PERIOD_M, (2, n))
    slots["first"], slots["second"], slots["third"] = rng.dirichlet((0.6, 0.6, 0.6), n).T
    hues, saturations = rng.uniform(*_HUE, n), rng.uniform(*_SATURATION, n)
    for slot, hue, saturation in zip(slots, hues, saturations, strict=True):
        red, green, blue = colorsys.hsv_to_rgb(hue, saturation, _BRIGHTNESS)
        slot["blue"], slot["green"], slot["red"] = blue, green, red
    slots[rng.random(n) >= SHARE] = np.zeros((), dtype=PRINT)
    return slots
