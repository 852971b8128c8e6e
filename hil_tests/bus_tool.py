"""A tool on the bus beside the robot: hears all frames, reads and writes objects of nodes."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from typing import TypeVar

import can
import canopen

from firmware_sim.nodes import wire
from firmware_sim.nodes.e2e import crc8, data_id_crc

DRIVE, SONAR, POWER = 1, 2, 3
COMMAND, EMCY_DRIVE, EMERGENCY_STOP = 0x201, 0x081, 0x001
EMCY_COMMAND_TIMEOUT = 0x8130
_COMMAND_CRC = data_id_crc(wire.data_id(wire.MOTOR_COMMAND))
T = TypeVar("T")
NODE_NAMES = {DRIVE: "drive", SONAR: "sonar", POWER: "power"}


def _ask_again(ask: Callable[[], T]) -> T:
    """Ask a node by SDO until the answer is to this question.

    There is one SDO channel: the answer to the robot's own reading may come first, even to one of
    a control process that has just ended.
    """
    for _ in range(4):
        with contextlib.suppress(canopen.SdoCommunicationError):
            return ask()
    return ask()


def is_sound(command: can.Message) -> bool:
    """Return whether a MotorCommand frame fits its CRC."""
    return crc8(command.data[1:], _COMMAND_CRC) == command.data[0]


def enabled(command: can.Message) -> bool:
    """Return whether a MotorCommand frame lets the motors turn."""
    return bool(command.data[1] & 0x10)


class BusTool:
    """A further participant on a bus.

    Parameters
    ----------
    interface, channel
        The bus, as python-can names it.
    """

    def __init__(self, interface: str, channel: str) -> None:
        self.interface, self.channel = interface, channel
        self._observer: can.BusABC | None = None

    def close(self) -> None:
        """Leave the bus."""
        if self._observer is not None:
            self._observer.shutdown()

    @property
    def observer(self) -> can.BusABC:
        """A further participant on the bus, which hears all."""
        if self._observer is None:
            self._observer = can.Bus(
                interface=self.interface, channel=self.channel, receive_own_messages=False
            )
        return self._observer

    def heard(self, seconds: float, *, before: bool = False) -> list[can.Message]:
        """Return what the observer hears for so long; `before`: and has heard since last asked."""
        while not before and self.observer.recv(0) is not None:
            pass
        messages: list[can.Message] = []
        deadline_s = time.monotonic() + seconds
        while (left_s := deadline_s - time.monotonic()) > 0:
            message = self.observer.recv(left_s)
            if message is not None:
                messages.append(message)
        return messages

    def heard_until(self, arbitration_id: int, seconds: float) -> list[can.Message]:
        """Return what the observer has heard, up to and with the first frame of that identifier."""
        messages: list[can.Message] = []
        deadline_s = time.monotonic() + seconds
        while (left_s := deadline_s - time.monotonic()) > 0:
            message = self.observer.recv(left_s)
            if message is not None:
                messages.append(message)
                if message.arbitration_id == arbitration_id:
                    return messages
        raise AssertionError(f"no frame 0x{arbitration_id:03X} within {seconds} s")

    def read_objects(self, node: int, objects: Sequence[tuple[int, int]]) -> list[int]:
        """Read unsigned objects by SDO through the independent `canopen` master."""
        with self._sdo(node) as sdo:
            return [
                int.from_bytes(_ask_again(partial(sdo.upload, index, sub)), "little")
                for index, sub in objects
            ]

    def write_object(self, node: int, index: int, value: int, size: int) -> None:
        """Write an unsigned object by SDO as any tool does; raises what the node refuses."""
        with self._sdo(node) as sdo:
            _ask_again(partial(sdo.download, index, 0, value.to_bytes(size, "little")))

    def store_parameters(self, node: int) -> None:
        """Let a node keep the parameters that it has now."""
        with self._sdo(node) as sdo:
            _ask_again(partial(sdo.download, 0x1010, 1, b"save"))

    @contextmanager
    def _sdo(self, node: int) -> Iterator[canopen.sdo.SdoClient]:
        network = canopen.Network()
        network.connect(interface=self.interface, channel=self.channel)
        try:
            remote = network.add_node(node, canopen.objectdictionary.ObjectDictionary())
            remote.sdo.RESPONSE_TIMEOUT = 1.0
            yield remote.sdo
        finally:
            network.disconnect()
