"""The host drives the mock of the package odrive-can, and needs less time than its driver."""

from __future__ import annotations

import asyncio
import logging
import timeit
from types import SimpleNamespace

import can
import odrive_can.linear_model
import pytest
from odrive_can import get_dbc
from odrive_can.mock import ODriveCANMock, OdriveMock
from odrive_can.odrive import CanMsg, ODriveCAN

from robotctl.drivers.can.drives.axis import Axis, AxisConfig
from robotctl.drivers.can.drives.odrive.config import ODriveMotor
from robotctl.messages.actuators import ActuatorCommand, DriveState
from robotctl.model.actuators import Takes
from tests.drivers.can.drives.odrive.rig import NEEDS, Rig

NODE = 1
REMOTE = 0x4000_0000
TURN = 6.283185307179586


class VirtualLoop(asyncio.SelectorEventLoop):
    """An event loop in whose sleep no time passes."""

    def __init__(self):
        super().__init__()
        self._now = 0.0
        select = self._selector.select

        def pass_time(timeout=None):
            self._now += timeout or 0.0
            return select(0)

        self._selector.select = pass_time

    def time(self):
        return self._now


class Mock(ODriveCANMock):
    """The package's mock between two queues; zeros are no answer to some of the host's questions.

    Its driver never asks for the version, and expects estimates only by themselves.
    """

    def __init__(self, take):
        self.log = logging.getLogger("mock")
        self.dbc = get_dbc()
        self.axis_id = NODE
        self.bus = SimpleNamespace(send=take, shutdown=lambda: None)
        self.notifier = SimpleNamespace(stop=lambda: None)
        self.can_reader = can.AsyncBufferedReader()
        self.odrive = OdriveMock(logger=self.log)

    def send_message(self, msg_name, msg_dict=None, rtr=False):
        if msg_name.endswith("Get_Version"):
            msg_dict = {"Protocol_Version": 2, "Hw_Version_Major": 4, "Fw_Version_Minor": 6}
        if msg_name.endswith("Get_Encoder_Estimates"):
            self.odrive.update()
            estimates = self.odrive.position, self.odrive.velocity
            msg_dict = dict(zip(("Pos_Estimate", "Vel_Estimate"), estimates, strict=True))
        super().send_message(msg_name, msg_dict, rtr)


def make_drive():
    config = ODriveMotor("odrive", "left", (AxisConfig("left"),), NODE)
    return config.make((Axis(config.axes[0], Takes.SPEED, 2400),), NEEDS)


async def run_host(loop, drive, told, reader, command, until):
    """Run control periods until something holds."""

    def send(arbitration_id, data):
        is_remote = bool(arbitration_id & REMOTE)
        reader.on_message_received(
            can.Message(
                arbitration_id=arbitration_id & 0x7FF,
                data=None if is_remote else data,
                is_remote_frame=is_remote,
                is_extended_id=False,
            )
        )
        return True

    for _ in range(4000):
        if until():
            return
        now_ns = round(loop.time() * 1e9)
        while told:
            message = told.pop(0)
            handler = drive.handlers.get(message.arbitration_id)
            if handler is not None:
                handler(bytes(message.data), now_ns)
        drive.check(now_ns)
        drive.command(send, command, now_ns)
        drive.serve(send, now_ns)
        await asyncio.sleep(0.005)
    raise AssertionError(f"not within 20 s: {drive.status}, {drive.reports}")


def test_the_host_drives_the_mock_of_odrive_can(monkeypatch):
    loop = VirtualLoop()
    monkeypatch.setattr(odrive_can.linear_model, "time", SimpleNamespace(time=loop.time))
    told = []
    drive = make_drive()

    async def story():
        mock = Mock(told.append)
        tasks = [
            asyncio.ensure_future(each)
            for each in (mock.heartbeat_loop(), mock.encoder_loop(), mock.message_handler())
        ]

        async def run(command, until):
            await run_host(loop, drive, told, mock.can_reader, command, until)

        go = ActuatorCommand(enable=True, values=(2.0 * TURN,))
        await run(ActuatorCommand(), lambda: not drive.status.problem)
        assert drive.proof.startswith("firmware 0.6.0 on 4.0.0: the watchdog cannot be read")
        await run(ActuatorCommand(), lambda: drive.reports[0].state is DriveState.READY)
        await run(go, lambda: drive.reports[0].state is DriveState.ENABLED)
        assert str(mock.odrive.control_mode) == "VELOCITY_CONTROL"
        await run(go, lambda: abs(drive.reports[0].speed_rad_s - 2.0 * TURN) < 0.01)
        assert mock.odrive.velocity == pytest.approx(2.0, abs=0.01)
        before = drive.reports[0].position_ticks
        after = loop.time() + 1.0
        await run(go, lambda: loop.time() >= after)
        assert drive.reports[0].position_ticks - before == pytest.approx(2 * 2400, rel=0.15)
        await run(ActuatorCommand(), lambda: drive.reports[0].state is DriveState.READY)
        assert str(mock.odrive.axis_state) == "IDLE"
        assert drive.reports[0].fault is None
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    try:
        loop.run_until_complete(story())
    finally:
        loop.close()


def test_a_tick_takes_at_most_half_of_the_time_of_the_package():
    """Two axes: a speed and two requests out, their answers in."""
    rig = Rig(motor_thermistor=True)
    answers = []
    rig.bus.attach("tap", answers.append)
    rig.start().enable(3.0)
    rig.run(100)
    names = (0x09, 0x14)
    newest = {frame.arbitration_id: frame.data for frame in answers}
    frames = [(node << 5 | name, newest[node << 5 | name]) for node in (33, 34) for name in names]
    command = rig.commands[0]

    def ours():
        for arbitration_id, data in frames:
            rig.handlers[arbitration_id](data, rig.now_ns)
        for drive in rig.drives:
            drive.check(rig.now_ns)
            drive.command(lambda *_: True, command, rig.now_ns)

    bus = SimpleNamespace(send=lambda _: None, shutdown=lambda: None)
    peers = [ODriveCAN(axis, bus) for axis in (0, 1)]
    messages = [
        can.Message(
            arbitration_id=axis << 5 | name, data=newest[33 << 5 | name], is_extended_id=False
        )
        for axis in (0, 1)
        for name in names
    ]

    def theirs():
        for message in messages:
            CanMsg(message)
        for peer in peers:
            peer.set_input_vel(1.0)
            peer._send_message("Get_Encoder_Estimates", rtr=True)
            peer._send_message("Get_Iq", rtr=True)

    our_s = min(timeit.repeat(ours, number=200, repeat=5)) / 200
    their_s = min(timeit.repeat(theirs, number=200, repeat=5)) / 200
    assert our_s <= their_s / 2, f"ours {our_s * 1e6:.1f} us, odrive-can {their_s * 1e6:.1f} us"
