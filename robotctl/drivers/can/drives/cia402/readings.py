"""Cyclic SDO readings of a drive: its settings, values that no PDO carries, its target.

No process data of CiA 402 tells that a command was lost: the drive goes on with the last, which the
host's heartbeat lets it. The target velocity that it has tells.
"""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Callable, Sequence
from typing import Final

from robotctl.drivers.can.drives.cia402.axis_side import AxisSide
from robotctl.drivers.can.drives.cia402.dialects import Polled
from robotctl.drivers.can.drives.cia402.settings import DriveSetup
from robotctl.drivers.can.drives.cia402.wire import Mapped, Role
from robotctl.drivers.can.nodes.node import Node
from robotctl.drivers.can.nodes.sdo import Request, SdoResponse
from robotctl.messages.actuators import NEVER_NS

READ_NS: Final = 25_000_000
"""Period of reading: each second time a target, in between a setting or a value [ns]."""

SENT_S: Final = 0.15
"""Age of a command beyond which it cannot be the newest that the drive has [s]."""

_DOUBTS: Final = 2
"""Readings in a row of a target that was not commanded: a single one may be damaged."""


class Readings:
    """Reads something each `READ_NS`.

    Parameters
    ----------
    node
        The drive's SDO server.
    plan
        What the drive has.
    sides
        Its axes.
    places
        Their places in the process data.
    rate_hz
        Rate of commands [Hz].
    lost
        Told in words that commands do not reach the drive.

    Attributes
    ----------
    voltage_v, supply_ns
        Supply, where it is read here [V]; when that was [ns].
    """

    __slots__ = (
        "_doubts",
        "_due_ns",
        "_lost",
        "_node",
        "_places",
        "_sent",
        "_sides",
        "_targets",
        "_turn",
        "_values",
        "supply_ns",
        "voltage_v",
    )

    def __init__(
        self,
        node: Node,
        plan: DriveSetup,
        sides: Sequence[AxisSide],
        places: Sequence[int],
        rate_hz: int,
        lost: Callable[[str], None],
    ) -> None:
        self._node, self._lost = node, lost
        self._sides, self._places = sides, places
        self._values = [
            (Request(each.index, each.subindex, "value"), each)
            for each in plan.device.dialect.polled
            if (each.axis is None or each.axis < max(len(sides), 1))
            and (plan.device.eds is None or plan.device.has(each.index, each.subindex))
        ]
        self._targets = [
            (Request(each.index, each.subindex, "target velocity"), each)
            for pdo in plan.layout.receive
            for each in pdo.objects
            if any(role is Role.TARGET for role, _ in each.parts)
        ]
        self._sent: deque[Sequence[int]] = deque(maxlen=max(2, round(SENT_S * rate_hz)))
        """Newest targets of all axes."""
        self._doubts: dict[Request, int] = {}
        """Readings in a row of each target that was not commanded; of one that ever was: not every
        drive tells it unchanged."""
        self._turn = 0
        self._due_ns = 0
        self.voltage_v: float | None = None
        self.supply_ns = NEVER_NS

    def note(self, targets: Sequence[int]) -> None:
        """Note what is commanded in this tick; empty: no power."""
        if targets:
            self._sent.append(tuple(targets))
        else:
            self._sent.clear()
            self._doubts = dict.fromkeys(self._doubts, 0)

    def step(self, now_ns: int) -> None:
        """Begin the next reading when it is due [ns]."""
        if now_ns < self._due_ns:
            return
        self._due_ns = now_ns + READ_NS
        turn, self._turn = self._turn, self._turn + 1
        if turn % 2:
            request, target = self._targets[turn // 2 % len(self._targets)]
            self._node.request(request, lambda response: self._compare(request, target, response))
        elif turn % 4 == 0 or not self._values:
            self._node.read_back(now_ns)
        else:
            request, value = self._values[turn // 4 % len(self._values)]
            self._node.request(request, lambda response: self._keep(value, response, now_ns))

    def _compare(self, request: Request, target: Mapped, response: SdoResponse) -> None:
        """Compare the target that the drive has with those sent to it."""
        if response.value is None or len(self._sent) < (self._sent.maxlen or 0):
            return
        size = target.bits // 8
        found = response.value & (1 << target.bits) - 1
        pack = struct.Struct("<" + target.code).pack
        axes = [axis for _, axis in target.parts]
        sent = {pack(*[targets[axis] for axis in axes]) for targets in self._sent}
        if found.to_bytes(size, "little") in sent:
            if found:
                self._doubts[request] = 0
        elif request in self._doubts:
            self._doubts[request] += 1
            if self._doubts[request] >= _DOUBTS:
                self._lost(
                    f"its target velocity is 0x{found:0{2 * size}X}, which was not commanded "
                    f"within {SENT_S * 1000:g} ms: commands do not reach it"
                )

    def _keep(self, polled: Polled, response: SdoResponse, now_ns: int) -> None:
        """Keep a value."""
        if response.value is None:
            return
        bits = abs(polled.bits)
        raw = response.value & (1 << bits) - 1
        if polled.bits < 0 and raw >> bits - 1:
            raw -= 1 << bits
        value = raw * polled.scale
        if polled.role is Role.VOLTAGE:
            self.voltage_v, self.supply_ns = value, now_ns
        for place, side in zip(self._places, self._sides, strict=True):
            if polled.axis in (None, place):
                if polled.role is Role.CURRENT:
                    side.current_a = side.axis.current_a(value)
                elif polled.role is None:
                    side.temperature_c = value
