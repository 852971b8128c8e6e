"""Two ODrives on a simulated bus, on a robot that drives, and the host's side of them."""

from __future__ import annotations

from functools import partial

from firmware_sim.bus.core import Bus
from firmware_sim.drives.config import AxisSection
from firmware_sim.drives.odrive.config import ODriveMotor as TwinMotor
from firmware_sim.drives.odrive.settings import ODriveSettings
from firmware_sim.drives.twin import Motor
from firmware_sim.nodes.parameter_store import MemoryStore
from robotctl.app.processes.robot import make_codec
from robotctl.drivers.can.bus_notes import BusNotes
from robotctl.drivers.can.drives.axis import Axis, AxisConfig
from robotctl.drivers.can.drives.motor_drive import DriveNeeds
from robotctl.drivers.can.drives.odrive.config import ODriveMotor
from robotctl.messages.actuators import ActuatorCommand, DriveState
from robotctl.model.actuators import Takes
from tests.firmware_sim.plant.plants import plant, robot

MS = 1_000_000
TICK_NS = 5 * MS
TICKS_PER_TURN = 2400
NEEDS = DriveNeeds(200, 90, 350, max_rad_s=16.0, codec=make_codec(), notes=BusNotes())
IDS = (33, 34)
OLD = {"firmware": (0, 5, 6), "watchdog_ms": 90.0}
"""A drive with firmware 0.5 whose owner has set its watchdog."""
NEW = {"firmware": (0, 6, 10)}
OFF = ActuatorCommand()


class Rig:
    """Robot with an ODrive at each wheel: the right one is mounted the other way round, geared 8:1.

    Parameters
    ----------
    more
        Settings of the host's table.
    settings
        Settings of both twins.
    """

    def __init__(self, more=None, **settings):
        self.bus = Bus()
        self.plant = plant(robot())
        self.stepped_ms = 0
        self.now_ns = 0
        self.sent = []
        self.heard = []
        self.silent = False
        self.commands = [OFF, OFF]
        self.port = self.bus.attach("host", self._receive)
        self.drives, self.twins = [], []
        for place, node_id in enumerate(IDS):
            turned, ratio = (False, 1.0) if place == 0 else (True, 8.0)
            self._add(place, node_id, turned, ratio, more or {}, ODriveSettings(**settings))
        self.handlers = {key: each for drive in self.drives for key, each in drive.handlers.items()}

    def _add(self, place, node_id, turned, ratio, more, settings):
        name = ("left", "right")[place]
        config = ODriveMotor("odrive", name, (AxisConfig(name, 1, turned, ratio),), node_id, **more)
        axis = Axis(config.axes[0], Takes.SPEED, TICKS_PER_TURN)
        self.drives.append(config.make((axis,), NEEDS))
        section = AxisSection(name, 1, turned, ratio)
        motor = Motor(self.plant.axes[place], -ratio if turned else ratio)
        twin = TwinMotor("odrive", name, (section,), node_id).make(
            settings, (motor,), self.plant, self.run_plant, MemoryStore()
        )
        port = self.bus.attach(name, twin.on_frame, accept=twin.arbitration_ids)
        twin.connect(
            port, lambda due_ns, each: self.bus.schedule(due_ns, partial(self._wake, each))
        )
        twin.power_cycle(0)
        self.twins.append(twin)

    def _wake(self, twin):
        twin.wake(self.bus.now_ns)

    def run_plant(self, now_ns):
        steps = now_ns // MS - self.stepped_ms
        if steps > 0:
            self.plant.step(steps)
            self.stepped_ms += steps
        return self.stepped_ms * MS

    def _receive(self, frame):
        self.heard.append(frame)

    def send(self, arbitration_id, data):
        self.sent.append((self.now_ns, arbitration_id, data))
        return self.port.send(arbitration_id, data)

    def tick(self):
        """Run one control period."""
        self.now_ns += TICK_NS
        self.bus.advance(self.now_ns)
        heard, self.heard = self.heard, []
        if self.silent:
            return
        for frame in heard:
            handler = self.handlers.get(frame.arbitration_id)
            if handler is not None:
                handler(frame.data, frame.stamp_ns)
        for drive, command in zip(self.drives, self.commands, strict=True):
            drive.check(self.now_ns)
            drive.command(self.send, command, self.now_ns)
            drive.serve(self.send, self.now_ns)

    def run(self, duration_ms):
        for _ in range(round(duration_ms / 5)):
            self.tick()

    def run_until(self, condition, limit_ms=2000):
        """Run until something holds; fail if it does not in time."""
        for _ in range(round(limit_ms / 5)):
            if condition():
                return
            self.tick()
        raise AssertionError(f"not within {limit_ms} ms: {[d.status for d in self.drives]}")

    def start(self):
        """Run until both drives are in service, and a little longer."""
        self.run_until(lambda: not any(drive.status.problem for drive in self.drives))
        self.run(300)
        return self

    def drive(self, left_rad_s, right_rad_s=None):
        """Command speeds of the wheels."""
        speeds = (left_rad_s, left_rad_s if right_rad_s is None else right_rad_s)
        self.commands = [ActuatorCommand(enable=True, values=(speed,)) for speed in speeds]

    def stop(self):
        self.commands = [OFF, OFF]

    def enable(self, left_rad_s, right_rad_s=None):
        """Command speeds and run until both drives say that they are enabled."""
        self.drive(left_rad_s, right_rad_s)
        self.run_until(lambda: self.states == [DriveState.ENABLED] * 2)
        return self

    def report(self, place=0):
        return self.drives[place].reports[0]

    @property
    def states(self):
        return [drive.reports[0].state for drive in self.drives]

    @property
    def faults(self):
        return [drive.reports[0].fault for drive in self.drives]

    def deliver(self, node_id, command, data):
        """Have the host receive a frame that no twin sent."""
        self.handlers[node_id << 5 | command](data, self.now_ns)
