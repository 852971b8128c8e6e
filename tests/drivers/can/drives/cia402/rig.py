"""The host's drive and the twin on a simulated bus, with a plant behind the twin."""

from __future__ import annotations

from pathlib import Path

from firmware_sim.bus.core import Bus
from firmware_sim.config.motors import AxisSection
from firmware_sim.drives.cia402.config import Cia402Motor as TwinTable
from firmware_sim.drives.cia402.settings import Cia402Settings
from firmware_sim.drives.twin import Motor
from firmware_sim.nodes.parameter_store import MemoryStore
from robotctl.drivers.can.bus_notes import BusNotes
from robotctl.drivers.can.drives.axis import Axis, AxisConfig
from robotctl.drivers.can.drives.cia402.config import Cia402Motor
from robotctl.drivers.can.drives.motor_drive import DriveNeeds
from robotctl.messages.actuators import ActuatorCommand, DriveState
from robotctl.messages.control import EmergencyStopSource
from robotctl.model.actuators import Takes
from tests.firmware_sim.plant.plants import plant, robot

MS = 1_000_000
TICK_NS = 5_000_000
NODE = 5
TICKS_PER_TURN = 2400
FAKE_EDS = str(Path(__file__).with_name("cia402_slave.eds"))
OFF = ActuatorCommand(enable=False, brake=False)
BRAKE = ActuatorCommand(enable=False, brake=True)

GENERIC = {"eds": "drives/cia402.eds", "counts_per_turn": 4096}
ZLAC = {"dialect": "zlac8015d"}
ROBOTEQ = {"dialect": "roboteq", "counts_per_turn": 4096, "accept_coasting": True}
DIALECTS = {"generic": GENERIC, "zlac8015d": ZLAC, "roboteq": ROBOTEQ}


def needs(**changes):
    given = {
        "rate_hz": 200,
        "command_timeout_ms": 100,
        "heartbeat_timeout_ms": 350,
        "max_rad_s": 20.0,
        "codec": None,
        "notes": BusNotes(),
    }
    return DriveNeeds(**{**given, **changes})


def axes_of(kind, axes):
    return tuple(kind(**axis) for axis in axes)


TWO = ({"actuator": "left", "axis": 1}, {"actuator": "right", "axis": 2, "reversed": True})


class Rig:
    """Ticks of 5 ms: what was received, `check`, `command`, SYNC, `serve`."""

    def __init__(self, table=GENERIC, axes=TWO, settings=None, host=None, **changes):
        common = {"kind": "cia402", "name": "motors", "node_id": NODE}
        self.config = Cia402Motor(
            **{**common, **table, **(host or {})}, axes=axes_of(AxisConfig, axes)
        )
        self.needs = needs(**changes)
        self.drive = self.config.make(
            tuple(Axis(axis, Takes.SPEED, TICKS_PER_TURN) for axis in self.config.axes), self.needs
        )
        self.plant = plant(robot("jackal"))
        self.steps = 0
        section = TwinTable(**common, **table, axes=axes_of(AxisSection, axes))
        motors = [
            Motor(axis, (-1.0 if each.reversed else 1.0) * each.ratio)
            for axis, each in zip(self.plant.axes, section.axes, strict=False)
        ]
        self.wheels = self.plant.axes[: len(motors)]
        self.store = MemoryStore()
        self.twin = section.make(
            settings or Cia402Settings(), motors, self.plant, self.run_to, self.store
        )
        self.bus = Bus()
        self.sent = []
        self.heard = []
        self.inbox = []
        self.host = self.bus.attach("host", self.inbox.append, accept=list(self.drive.handlers))
        port = self.bus.attach("twin", self.twin.on_frame, accept=list(self.twin.arbitration_ids))
        self.bus.tap(self.heard.append)
        self.twin.connect(
            port, lambda due_ns, twin: self.bus.schedule(due_ns, lambda: twin.wake(due_ns))
        )
        self.twin.power_cycle(0)
        self.now_ns = 0
        self.is_silent = self.is_cut = False
        self.command = OFF

    def run_to(self, now_ns):
        steps = now_ns // MS - self.steps
        if steps > 0:
            self.plant.step(steps)
            self.steps += steps
        return self.steps * MS

    def send(self, arbitration_id, data):
        self.sent.append((self.now_ns, arbitration_id, data))
        if self.is_cut:
            return True
        return self.host.send(arbitration_id, data)

    def tick(self):
        self.now_ns += TICK_NS
        self.bus.advance(self.now_ns)
        self.run_to(self.now_ns)
        received, self.inbox[:] = list(self.inbox), []
        if self.is_silent:
            return
        for frame in () if self.is_cut else received:
            self.drive.handlers[frame.arbitration_id](frame.data, frame.stamp_ns)
        self.drive.check(self.now_ns)
        self.drive.command(self.send, self.command, self.now_ns)
        if self.drive.wants_sync:
            self.send(0x080, b"")
        self.drive.serve(self.send, self.now_ns)

    def run(self, ms, command=None):
        if command is not None:
            self.command = command
        for _ in range(round(ms / 5)):
            self.tick()
        return self

    def until(self, condition, ms=8000):
        for _ in range(ms // 5):
            if condition():
                return self
            self.tick()
        raise AssertionError(f"not within {ms} ms: {self.drive.status}, {self.drive.reports}")

    # What a test wants to say --------------------------------------------------------------------

    def in_service(self):
        self.until(lambda: not self.drive.status.problem)
        return self.run(50, OFF)

    def drives(self, *speeds, ms=1000):
        command = ActuatorCommand(enable=True, values=tuple(map(float, speeds)))
        return self.run(ms, command)

    def driving(self, *speeds, ms=1000):
        self.in_service().drives(*speeds, ms=ms)
        assert self.states == [DriveState.ENABLED] * len(self.drive.reports), self.drive.reports
        return self

    @property
    def states(self):
        return [report.state for report in self.drive.reports]

    @property
    def fault(self):
        return self.drive.reports[0].fault

    @property
    def speeds(self):
        return [wheel.speed_rad_s for wheel in self.wheels]

    @property
    def powered(self):
        return any(wheel.powered for wheel in self.wheels)

    def stop(self):
        return self.drive.emergency_stop(self.send, EmergencyStopSource.OPERATOR)
