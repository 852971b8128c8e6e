"""CANopen node 2: ring of up to 16 sonars, fired in groups of four in turn."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from typing import Final, Protocol, TypeAlias

from firmware_sim.nodes import wire
from firmware_sim.nodes.e2e import Protector
from firmware_sim.nodes.node import MILLISECOND_NS, NEVER_NS, NmtState, Node
from firmware_sim.nodes.object_dictionary import ObjectDictionary
from firmware_sim.nodes.parameter_store import ParameterStore
from firmware_sim.nodes.standard_objects import (
    pdo_communication,
    pdo_image,
    pdo_mapping,
    standard_objects,
)
from firmware_sim.nodes.variables import Access, DataType, Object, variable

NODE_ID: Final = 2
GROUP_SIZE: Final = 4
SONARS_MAX: Final = 16
SONAR_COUNT: Final = 0x2200
RING_PERIOD: Final = 0x2201
RANGES_IMAGE: Final = 0x2210
EVENT_DRIVEN: Final = 254

SPEED_OF_SOUND_M_S: Final = 343.0
PROCESSING_NS: Final = 500_000
"""Time from the last echo to the frame [ns]."""

Ranges: TypeAlias = tuple[float, float, float, float]


class Echoes(Protocol):
    """Fires one group from the robot's present pose [m]; inf: no echo, nan: no such sensor."""

    def __call__(self, group: int, now_ns: int) -> Ranges:
        """Return the ranges of sonars 4 * group to 4 * group + 3."""


def sonar_objects(count: int) -> list[Object]:
    """Return all objects of a ring of `count` sonars.

    All rings have the same objects; PDOs of groups without a sonar do not exist.
    """
    groups = len(range_identifiers(count))
    communications, mappings, images = [], [], []
    for group, can_id in enumerate(wire.SONAR_RANGES):
        name, image = f"TPDO {group + 1}", RANGES_IMAGE + group
        communications.append(
            pdo_communication(
                0x1800 + group, f"{name} communication", can_id, EVENT_DRIVEN, exists=group < groups
            )
        )
        mappings.append(pdo_mapping(0x1A00 + group, f"{name} mapping", image))
        images.append(pdo_image(image, f"Ranges of group {group + 1}"))
    return [
        *standard_objects(NODE_ID, "robotctl sonar ring", 2),
        *communications,
        *mappings,
        variable(SONAR_COUNT, "Number of sonars", DataType.UNSIGNED8, Access.RO, count),
        variable(
            RING_PERIOD, "Ring period [ms]", DataType.UNSIGNED16, Access.RW, 50,
            low=20, high=2000, stored=True,
        ),
        *images,
    ]  # fmt: skip


def range_identifiers(count: int) -> tuple[int, ...]:
    """Return the identifiers of the frames with the ranges of `count` sonars."""
    return wire.SONAR_RANGES[: -(-count // GROUP_SIZE)]


class SonarNode(Node):
    """The sonar ring.

    In operational each group fires once a ring period, the groups evenly spread over it. Its frame
    leaves with the last echo, or, if one is missing, when the time of the maximum range has passed.

    Parameters
    ----------
    count
        Number of sonars, 0..16.
    max_range_m
        Maximum range, which determines how long they listen.
    fire
        Function that returns the ranges of a group.
    store
        Non-volatile memory.

    Raises
    ------
    ValueError
        If `count` is outside 0..16.
    """

    def __init__(
        self, count: int, max_range_m: float, fire: Echoes, store: ParameterStore | None = None
    ) -> None:
        if not 0 <= count <= SONARS_MAX:
            raise ValueError(f"{count} sonars, allowed are 0..{SONARS_MAX}")
        identifiers = range_identifiers(count)
        self._groups = len(identifiers)
        self._max_range_m = max_range_m
        self._fire: Callable[[int, int], Ranges] = fire
        self._protectors = [Protector(wire.data_id(each)) for each in identifiers]
        self._group = 0
        self._fire_ns = NEVER_NS
        self._echoes: deque[tuple[int, int, Ranges]] = deque()
        super().__init__(NODE_ID, "sonar", ObjectDictionary(sonar_objects(count)), store)

    def _on_power_up(self) -> None:
        for protector in self._protectors:
            protector.reset()
        self._silence()

    def _silence(self) -> None:
        self._fire_ns = NEVER_NS
        self._echoes.clear()

    def _on_nmt_change(self) -> None:
        self._silence()
        if self.state is NmtState.OPERATIONAL and self._groups:
            self._group = 0
            self._fire_ns = self._now_ns

    def _due_ns(self) -> int:
        return min(self._fire_ns, self._echoes[0][0]) if self._echoes else self._fire_ns

    def _step(self, now_ns: int) -> None:
        while self._echoes and now_ns >= self._echoes[0][0]:
            _, group, ranges_m = self._echoes.popleft()
            payload = self._protectors[group].protect(wire.sonar_ranges(ranges_m))
            self.send_image(wire.SONAR_RANGES[group], RANGES_IMAGE + group, payload)
        if now_ns >= self._fire_ns:
            self._fire_group(now_ns)

    def _fire_group(self, now_ns: int) -> None:
        group = self._group
        ranges_m = self._fire(group, now_ns)
        done_ns = now_ns + self._listen_ns(ranges_m) + PROCESSING_NS
        if self._echoes:
            done_ns = max(done_ns, self._echoes[-1][0])
        self._echoes.append((done_ns, group, ranges_m))
        self._group = (group + 1) % self._groups
        period_ns = self.dictionary.number(RING_PERIOD) * MILLISECOND_NS
        self._fire_ns += self.clock.span_ns(period_ns // self._groups)

    def _listen_ns(self, ranges_m: Ranges) -> int:
        farthest_m = max((each for each in ranges_m if not math.isnan(each)), default=0.0)
        return int(2e9 * min(farthest_m, self._max_range_m) / SPEED_OF_SOUND_M_S)
