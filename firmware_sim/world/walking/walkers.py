"""The walker of each manner."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from firmware_sim.errors import SimulationError
from firmware_sim.world.free_space import FreeSpace
from firmware_sim.world.manner import Manner
from firmware_sim.world.walking.evading import Evading
from firmware_sim.world.walking.roaming import RUNNING, Habit, Roaming, wandering
from firmware_sim.world.walking.stubborn import Stubborn
from firmware_sim.world.walking.walker import RADIUS_M, ROOM_M, Walker
from firmware_sim.world.world import World


@dataclass(frozen=True, slots=True, eq=False)
class Outset:
    """Path, speed and room of a walker at the start.

    Attributes
    ----------
    corners
        Corners of a closed path, the first again at the end, (k, 2) [m].
    speed_m_s
        Usual speed; that of a wanderer is the fastest, that of a child its own.
    world
        The room with what stands in it.
    rng
        Generator of the walker's own draws.
    space
        Places where it may be; None: to be found.
    stands_s
        Time for which it stands at the last corner [s]; of the stubborn.
    """

    corners: np.ndarray
    speed_m_s: float
    world: World
    rng: np.random.Generator
    space: FreeSpace | None = None
    stands_s: float = 0.0


def _roaming(outset: Outset, habit: Habit) -> Roaming:
    x_m, y_m = outset.corners[0].tolist()
    space = outset.space or FreeSpace(outset.world, RADIUS_M + ROOM_M, (x_m, y_m))
    if not space.is_free((x_m, y_m)):
        raise SimulationError(
            f"{outset.world.name}: a person begins at x {x_m:g} m, y {y_m:g} m, nearer than "
            f"{RADIUS_M + ROOM_M:g} m to what stands there; put it farther away"
        )
    return Roaming((x_m, y_m), habit, space, outset.rng)


WALKERS: Final[dict[Manner, Callable[[Outset], Walker]]] = {
    Manner.STUBBORN: lambda outset: Stubborn(outset.corners, outset.speed_m_s, outset.stands_s),
    Manner.EVADES: lambda outset: Evading(outset.corners, outset.speed_m_s, outset.world.touchable),
    Manner.WANDERS: lambda outset: _roaming(outset, wandering(outset.speed_m_s)),
    Manner.RUNS: lambda outset: _roaming(outset, RUNNING),
}
"""Makes the walker of a manner."""
