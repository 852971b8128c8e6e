"""The host's drive and the twin on a simulated bus, with a plant behind the twin."""

from __future__ import annotations

import dataclasses
from pathlib import Path

from firmware_sim.config.motors import AxisSection
from firmware_sim.drives.cia402.config import Cia402Motor as TwinTable
from firmware_sim.drives.cia402.settings import Cia402Settings
from robotctl.drivers.can.bus_notes import BusNotes
from robotctl.drivers.can.drives.axis import AxisConfig
from robotctl.drivers.can.drives.cia402.config import Cia402Motor
from robotctl.messages.actuators import ActuatorCommand, DriveState
from robotctl.messages.control import EmergencyStopSource
from tests.drivers.can.drives import bench
from tests.drivers.can.drives.bench import BRAKE, MS, Stand
from tests.drivers.can.drives.bench import COAST as OFF
from tests.drivers.can.drives.bench import PERIOD_NS as TICK_NS
from tests.drivers.can.drives.bench import TICKS as TICKS_PER_TURN

__all__ = ["BRAKE", "MS", "OFF", "TICKS_PER_TURN", "TICK_NS"]

NODE = 5
FAKE_EDS = str(Path(__file__).with_name("cia402_slave.eds"))

GENERIC = {"eds": "drives/cia402.eds", "counts_per_turn": 4096}
ZLAC = {"dialect": "zlac8015d"}
ROBOTEQ = {"dialect": "roboteq", "counts_per_turn": 4096, "accept_coasting": True}
DIALECTS = {"generic": GENERIC, "zlac8015d": ZLAC, "roboteq": ROBOTEQ}


def needs(**changes):
    given = {"command_timeout_ms": 100, "notes": BusNotes(), **changes}
    return dataclasses.replace(bench.NEEDS, **given)


def axes_of(kind, axes):
    return tuple(kind(**axis) for axis in axes)


TWO = ({"actuator": "left", "axis": 1}, {"actuator": "right", "axis": 2, "reversed": True})


class Rig(Stand):
    """Ticks of 5 ms: what was received, `check`, `command`, SYNC, `serve`."""

    def __init__(self, table=GENERIC, axes=TWO, settings=None, host=None, **changes):
        super().__init__("jackal")
        common = {"kind": "cia402", "name": "motors", "node_id": NODE}
        self.config = Cia402Motor(
            **{**common, **table, **(host or {})}, axes=axes_of(AxisConfig, axes)
        )
        self.needs = needs(**changes)
        self.drive = self.config.make(bench.axes_of(self.config), self.needs)
        section = TwinTable(**common, **table, axes=axes_of(AxisSection, axes))
        self.wheels = self.plant.axes[: len(axes)]
        self.twin = self.plug(section, settings or Cia402Settings(), self.wheels)
        self.sent = []
        self.is_silent = self.is_cut = False
        self.command = OFF

    def send(self, arbitration_id, data):
        self.sent.append((self.now_ns, arbitration_id, data))
        return self.is_cut or self.put(arbitration_id, data)

    def tick(self):
        self.advance(TICK_NS)
        if self.is_silent or self.is_cut:
            self.received.clear()
        if self.is_silent:
            return
        self.listen((self.drive,))
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

    def stop(self):
        return self.drive.emergency_stop(self.send, EmergencyStopSource.OPERATOR)
