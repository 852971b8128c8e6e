"""Two ODrives on a simulated bus, on a robot that drives, and the host's side of them."""

from __future__ import annotations

from firmware_sim.drives.config import AxisSection
from firmware_sim.drives.odrive.config import ODriveMotor as TwinMotor
from firmware_sim.drives.odrive.settings import ODriveSettings
from robotctl.drivers.can.drives.axis import AxisConfig
from robotctl.drivers.can.drives.odrive.config import ODriveMotor
from robotctl.messages.actuators import ActuatorCommand, DriveState
from tests.drivers.can.drives.bench import COAST as OFF
from tests.drivers.can.drives.bench import MS, NEEDS, Stand, axes_of
from tests.drivers.can.drives.bench import PERIOD_NS as TICK_NS
from tests.drivers.can.drives.bench import TICKS as TICKS_PER_TURN

__all__ = ["IDS", "MS", "NEEDS", "NEW", "OLD", "TICKS_PER_TURN", "TICK_NS", "Rig"]

IDS = (33, 34)
OLD = {"firmware": (0, 5, 6), "watchdog_ms": 90.0}
"""A drive with firmware 0.5 whose owner has set its watchdog."""
NEW = {"firmware": (0, 6, 10)}


class Rig(Stand):
    """Robot with an ODrive at each wheel: the right one is mounted the other way round, geared 8:1.

    Parameters
    ----------
    more
        Settings of the host's table.
    settings
        Settings of both twins.
    """

    def __init__(self, more=None, **settings):
        super().__init__("diff_drive")
        self.drives = []
        self.sent = []
        self.silent = False
        self.commands = [OFF, OFF]
        for name, node_id, turned, ratio in zip(
            ("left", "right"), IDS, (False, True), (1.0, 8.0), strict=True
        ):
            section = AxisSection(name, 1, turned, ratio)
            self.plug(TwinMotor("odrive", name, (section,), node_id), ODriveSettings(**settings))
            axis = AxisConfig(name, 1, turned, ratio)
            config = ODriveMotor("odrive", name, (axis,), node_id, **(more or {}))
            self.drives.append(config.make(axes_of(config), NEEDS))
        self.handlers = {key: each for drive in self.drives for key, each in drive.handlers.items()}

    def send(self, arbitration_id, data):
        self.sent.append((self.now_ns, arbitration_id, data))
        return self.put(arbitration_id, data)

    def tick(self):
        """Run one control period."""
        self.advance(TICK_NS)
        if self.silent:
            self.received.clear()
            return
        self.listen(self.drives)
        for drive, command in zip(self.drives, self.commands, strict=True):
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
