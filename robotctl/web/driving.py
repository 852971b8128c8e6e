"""Driving by sticks: one driver at a time, and a dead-man key by design.

One client is the driver. Another one takes over by asking: at once where nobody drives or the
driver has been idle for `IDLE_NS`, else if the driver gives.

The sticks of the driver go to the robot only while the dead-man key is held, the sample number of
the input device grows (a radio pad that lost its connection repeats its last sample for ever), and
no sample is older than `OLDEST_NS` by the server's clock. It begins with a *fresh edge* of the key:
a sample with the key released, then one with the key held, both since the client became the driver
and since the last interruption. Interruptions are samples that are late or stand still, a robot
that loses power, and another mode. After each of them holding on is not enough.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import Final, NamedTuple

from robotctl.web.wire import Driver, Sticks

OLDEST_NS: Final = 250_000_000
"""Age of the oldest sample that counts [ns]."""
AHEAD_NS: Final = 50_000_000
"""A sample that is said to be from further in the future is a mistake [ns]."""
LIFE_NS: Final = 300_000_000
"""Age of a sample at which the robot stops to follow it [ns]."""
STANDING_NS: Final = 200_000_000
"""Time without a new sample after which the key counts as released [ns]."""
IDLE_NS: Final = 5_000_000_000
"""Time without driving after which a driver can be replaced without being asked [ns]."""
ASKING_NS: Final = 10_000_000_000
"""Time that a driver has to give [ns]."""

_AGAIN: Final = "release the key and hold it again"
_FIRST: Final = "hold the key anew: it counts from when it was released once"


class Drive(NamedTuple):
    """Sticks for the robot, void after `life_ns`; `begins`: it is to go to MANUAL first."""

    forward: float
    turn: float
    sideways: float
    life_ns: int
    begins: bool = False


REST: Final = Drive(0.0, 0.0, 0.0, LIFE_NS)


class Denial(NamedTuple):
    """A client's request to drive that was not granted."""

    client: int
    number: int
    reason: str


class _Key(enum.Enum):
    """The dead-man key of the driver."""

    LOCKED = enum.auto()
    """Held, or never seen released: it must be released first."""
    RELEASED = enum.auto()
    HELD = enum.auto()
    """The robot follows the sticks."""


@dataclass(frozen=True, slots=True)
class _Asking:
    client: int
    number: int
    since_ns: int


class Driving:
    """Arbitration between clients, and the dead-man key of the one that drives."""

    def __init__(self) -> None:
        self._names: dict[int, str] = {}
        self._driver: int | None = None
        self._asking: _Asking | None = None
        self._key = _Key.LOCKED
        self._samples: dict[int, int] = {}
        """Largest sample number that each client has sent."""
        self._new_ns = self._moved_ns = 0
        """When the last new sample came, and when the robot last followed one [ns]."""
        self._why = self._locked = ""
        self._drives: list[Drive] = []
        self._denials: list[Denial] = []

    @property
    def driver(self) -> int | None:
        """Client that drives; None: there is none."""
        return self._driver

    @property
    def is_held(self) -> bool:
        """Whether the robot follows the sticks."""
        return self._key is _Key.HELD

    @property
    def state(self) -> Driver:
        """State of driving, for all clients."""
        asking = None if self._asking is None else self._asking.client
        return Driver(
            self._driver,
            self._name(self._driver),
            self._why,
            asking,
            self._name(asking),
            self.is_held,
            self._locked,
        )

    def take_drives(self) -> list[Drive]:
        """Return what the robot is to do, since the last call."""
        drives, self._drives = self._drives, []
        return drives

    def take_denials(self) -> list[Denial]:
        """Return which clients did not become the driver, since the last call."""
        denials, self._denials = self._denials, []
        return denials

    def join(self, client: int, name: str) -> None:
        """Know a client that may drive."""
        self._names[client] = name

    def leave(self, client: int, now_ns: int) -> None:
        """Forget a client whose connection ended."""
        if self._asking is not None and self._asking.client == client:
            self._asking = None
        if self._driver == client:
            self._end(f"the connection of {self._name(client)} ended", now_ns)
        self._names.pop(client, None)
        self._samples.pop(client, None)

    def take(self, client: int, number: int, now_ns: int) -> None:
        """Make a client the driver, or ask the present one; `number` is that of the request."""
        if client == self._driver or client not in self._names:
            return
        if self._driver is None or self._is_idle(now_ns):
            self._begin(client, f"{self._name(client)} took over", now_ns)
        elif self._asking is None:
            self._asking = _Asking(client, number, now_ns)
        elif self._asking.client != client:
            denial = f"{self._name(self._asking.client)} asked before"
            self._denials.append(Denial(client, number, denial))

    def give(self, client: int, now_ns: int) -> None:
        """End the driving of a client, as it asked."""
        if client == self._driver:
            self._end(f"{self._name(client)} gave it", now_ns)

    def interrupt(self, why: str) -> None:
        """Stop following the sticks until the key is released and held again."""
        if self._driver is not None and self._key is not _Key.LOCKED:
            self._let_go()
            self._key, self._locked = _Key.LOCKED, f"{why}: {_AGAIN}"

    def sticks(self, client: int, sticks: Sticks, now_ns: int, objection: str = "") -> None:
        """Take a sample of the input device of a client.

        Parameters
        ----------
        client, sticks, now_ns
            Who sent it, what, and the time when it came [ns].
        objection
            Why the robot would not follow; empty: it would.
        """
        is_new = sticks.sample > self._samples.get(client, -(2**63))
        self._samples[client] = max(sticks.sample, self._samples.get(client, sticks.sample))
        if client != self._driver:
            return
        if not sticks.held:
            self._release()
        age_ns = now_ns - round(sticks.at_ms * 1e6)
        if not -AHEAD_NS <= age_ns <= OLDEST_NS:
            self.interrupt(f"what the input device says comes {age_ns / 1e9:.1f} s late")
            return
        self._watch(now_ns)
        if not is_new:
            return
        self._new_ns = now_ns
        if not sticks.held:
            self._key, self._locked = _Key.RELEASED, ""
        elif self._key is _Key.LOCKED:
            self._locked = self._locked or _FIRST
        elif objection:
            self.interrupt(objection)
        else:
            begins = self._key is _Key.RELEASED
            self._key, self._moved_ns = _Key.HELD, now_ns
            life_ns = LIFE_NS - max(age_ns, 0)
            self._drives.append(
                Drive(sticks.forward, sticks.turn, sticks.sideways, life_ns, begins)
            )

    def step(self, now_ns: int) -> None:
        """Notice what does not come: samples, and answers of the driver."""
        self._watch(now_ns)
        if self._asking is None or self._driver is None:
            return
        if self._is_idle(now_ns):
            self._end(f"{self._name(self._driver)} was idle", now_ns)
        elif now_ns - self._asking.since_ns > ASKING_NS:
            denial = f"{self._name(self._driver)} drives, and did not give"
            self._denials.append(Denial(self._asking.client, self._asking.number, denial))
            self._asking = None

    def _watch(self, now_ns: int) -> None:
        """Interrupt where no new sample has come for too long."""
        if self._key is _Key.HELD and now_ns - self._new_ns > STANDING_NS:
            self.interrupt("the input device stood still, or the connection did")

    def _is_idle(self, now_ns: int) -> bool:
        return not self.is_held and now_ns - self._moved_ns > IDLE_NS

    def _release(self) -> None:
        """Stop the robot because the key was released, however old the sample is that says so."""
        self._let_go()
        self._key = _Key.LOCKED

    def _let_go(self) -> None:
        if self._key is _Key.HELD:
            self._drives.append(REST)

    def _end(self, why: str, now_ns: int) -> None:
        """End the driving of the driver; who asked for it is the next."""
        asking, self._asking = self._asking, None
        if asking is not None:
            self._begin(asking.client, why, now_ns)
            return
        self._let_go()
        self._driver, self._key = None, _Key.LOCKED
        self._why, self._locked = why, ""

    def _begin(self, client: int, why: str, now_ns: int) -> None:
        """Make a client the driver, whose key must be seen released first."""
        self._let_go()
        had_driver = self._driver is not None
        self._driver, self._key = client, _Key.LOCKED
        self._asking, self._moved_ns = None, now_ns
        self._why, self._locked = why if had_driver else "", ""

    def _name(self, client: int | None) -> str:
        return "" if client is None else self._names.get(client, f"client {client}")
