"""The peer of the tick: the control process with python-can messages and cantools.

Everything else is the same: loop, core, commissioning, checks of counters and CRC (ours, which
favours the peer). `python -m benchmarks.ordinary OPTIONS` takes the place of the control process.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Collection
from typing import Any

import can
import cantools.database

from robotctl.app.processes import control
from robotctl.app.processes.entry import enter
from robotctl.app.processes.robot import make_codec, make_parts
from robotctl.config.robot_file import RobotConfig, config_directory
from robotctl.drivers.can.codec import compile_syndrome
from robotctl.drivers.can.descriptor import CAN_SFF_MASK, NODE_NAME
from robotctl.drivers.can.nodes.robot_codec import COMMAND, RobotCodec
from robotctl.drivers.can.robot_can import CanRobot
from robotctl.messages.control import BusStatus
from robotctl.messages.ports import Clock, Frame


class OrdinaryPort:
    """A `CanPort` by `can.Bus.recv` and `can.Bus.send`."""

    def __init__(self, interface: str, channel: str, arbitration_ids: Collection[int]) -> None:
        self._bus = can.Bus(
            interface=interface,
            channel=channel,
            node=NODE_NAME,
            can_filters=[
                {"can_id": each, "can_mask": CAN_SFF_MASK, "extended": False}
                for each in arbitration_ids
            ],
        )
        self._epoch_s = time.time() - time.monotonic()
        self._received = self._sent = self._failures = 0

    def send(self, arbitration_id: int, data: bytes) -> bool:
        message = can.Message(arbitration_id=arbitration_id, data=data, is_extended_id=False)
        try:
            self._bus.send(message)
        except can.CanError:
            self._failures += 1
            return False
        self._sent += 1
        return True

    def receive(self) -> list[Frame]:
        frames = []
        while (message := self._bus.recv(timeout=0)) is not None:
            if not message.is_error_frame:
                stamp_ns = round((message.timestamp - self._epoch_s) * 1e9)
                frames.append(Frame(message.arbitration_id, bytes(message.data), stamp_ns))
        self._received += len(frames)
        return frames

    def status(self) -> BusStatus:
        return BusStatus(received=self._received, sent=self._sent, send_failures=self._failures)

    def close(self) -> None:
        self._bus.shutdown()


class OrdinaryCodec(RobotCodec):
    """The robot's codec by `cantools` encode and decode."""

    def __init__(self, ours: RobotCodec) -> None:
        self._database = cantools.database.load_file(config_directory() / "robot.dbc")
        self._crc = compile_syndrome(ours.dbc.message(COMMAND))
        super().__init__(ours.dbc)
        self.encode_command = self._encode_command

    def decoder(self, message: str, *signals: str, raw: Collection[str] = ()) -> Any:
        decode = self._database.get_message_by_name(message).decode

        def read(data: bytes) -> tuple[Any, ...]:
            values = decode(data, decode_choices=False, scaling=not raw)
            return tuple(values[signal] for signal in signals)

        return read

    def _encode_command(
        self, counter: int, enable: bool, brake: bool, duty1: float, duty2: float, steering: float
    ) -> bytes:
        data = bytearray(
            self._database.encode_message(
                COMMAND,
                {
                    "Crc": 0,
                    "Counter": counter,
                    "Enable": int(enable),
                    "Brake": int(brake),
                    "Duty1": duty1,
                    "Duty2": duty2,
                    "SteeringAngle": steering,
                },
            )
        )
        data[0] = self._crc(bytes(data))
        return bytes(data)


def make_ordinary_robot(config: RobotConfig, _clock: Clock) -> CanRobot:
    """Return what `make_robot` returns, in the ordinary way."""
    parts = make_parts(config, OrdinaryCodec(make_codec()))
    bus = config.buses[0]
    port = OrdinaryPort(bus.interface, bus.channel, parts.identifiers(bus.name))
    return CanRobot({bus.name: port}, parts)


if __name__ == "__main__":
    control.make_robot = make_ordinary_robot
    sys.exit(enter("control", control.run))
