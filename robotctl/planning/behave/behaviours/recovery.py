"""Recovery of a robot that cannot go on: a bounded ladder, one rung after the other."""

from __future__ import annotations

from robotctl.planning.config import RecoveryConfig, RungName


class Ladder:
    """Counts the tries of one journey, which all together are bounded.

    Trouble after some progress begins with the first rung again. Without progress each trouble
    leads to the next rung; beyond the last one, or on too many climbs, the robot gives up.

    Parameters
    ----------
    config
        Its rungs, and how often the robot may climb from the ground.
    can_turn
        Whether the robot turns on the spot; otherwise it cannot look around.

    Attributes
    ----------
    tries
        Rungs taken so far, and waits where the way was closed.
    """

    def __init__(self, config: RecoveryConfig | None = None, *, can_turn: bool) -> None:
        config = config or RecoveryConfig()
        impossible: set[RungName] = set() if can_turn else {"look_around"}
        if config.back_off_m == 0.0:
            impossible |= {"back_off", "retrace"}
        self._rungs = [rung for rung in config.ladder if rung not in impossible]
        self._retries = config.retries
        self._at = 0
        self._climbs = 0
        self.tries = 0

    def progress(self) -> None:
        """Take note that the robot has got on: the next trouble begins with the first rung."""
        self._at = 0

    def restart(self) -> None:
        """Forget all climbs: the robot drives elsewhere, or people want it to try again."""
        self._at = self._climbs = 0

    def climb(self) -> RungName | None:
        """Return what to try next; None: nothing is left."""
        if self._at == 0:
            self._climbs += 1
        if self._climbs > self._retries or self._at == len(self._rungs):
            return None
        rung = self._rungs[self._at]
        self._at += 1
        self.tries += 1
        return rung
