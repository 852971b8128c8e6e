"""Values of the configuration that change while the robot runs."""

from __future__ import annotations

import msgspec


class Tuning(msgspec.Struct, frozen=True, tag=True):
    """All values that differ now from those which the receiver began with.

    `values` are by their dotted keys in the robot's file; the receiver takes those that are of its
    own. `number` comes back in its state once they are taken; 0 where nothing differs.
    """

    stamp_ns: int
    values: dict[str, bool | int | float]
    number: int
