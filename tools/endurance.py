"""A simulated mission of many hours in lockstep, with random faults and an operator.

The robot drives the patrol again and again. Faults strike at random: on the bus, in the nodes, in
the host. When the robot has stopped, the operator waits until the fault is over, arms it and sets
AUTO, as the one documented sequence says. After each lap somebody carries the robot back to its
start. The simulator's monitor, which knows the truth, counts what no robot may do. Exit status 1
where it has found anything, or a recovery failed, or no lap was completed, or memory grew, or the
robot stopped though there was no fault and it touched nothing (odometry that a fault has shifted
leads to walls).
`--every inf` leaves the faults out.
"""

from __future__ import annotations

import argparse
import resource
import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np

from firmware_sim.faults import fits
from firmware_sim.faults.catalogue import CATALOGUE, Kind
from firmware_sim.faults.parameters import DURATION, Parameter, Value
from robotctl.app.processes.navigator import load_mission, make_navigation
from robotctl.app.simulation.lockstep_stack import LockstepStack, make_simulation
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import find_file
from robotctl.estimation.odometry.odometry import Odometry
from robotctl.messages.control import (
    Arm,
    ControlRequest,
    ControlState,
    EmergencyStop,
    EmergencyStopSource,
    Mode,
    NavigationState,
    SetMode,
)
from robotctl.messages.faults import FaultCode
from robotctl.safety.state_machine import LATCHED, POWERED

SECOND_NS = 1_000_000_000
LAP_NS = 120 * SECOND_NS
"""A lap that has not ended by then is given up."""

RECOVERY_NS = 20 * SECOND_NS
"""After so long without a fault the operator's sequence has succeeded, or the run fails.

Faults strike while the robot stands, too: each holds the count up, none begins it anew.
"""

QUIET_NS = SECOND_NS // 2
"""The operator looks so long at a robot without fault before he arms it."""

AFTERMATH_NS = 5 * SECOND_NS
"""A stop later than this after the end of the last fault has no cause that anybody knows of."""

CHANGE_BELOW = 0.3
"""Charge [0, 1] at which the operator puts in a full battery, at the end of a lap."""

GROWTH_MIB = 8.0
"""More is a leak: Python's arenas move by some MiB."""

STORE = (0x601, b"\x23\x10\x10\x01save")
"""What the operator sends by hand where parameters were lost, as docs/safety.md tells him: store
what is valid now."""

NEVER_S = 1e9
"""No run is so long [s]."""

HELD_UP, PRESSED = "host_held_up", "emergency_stop"
HOST_FAULTS = (HELD_UP, PRESSED)
NOT_UNDER_WAY = ("wheels_swapped", "carried", "wheel_slipping", "body")
"""Nobody exchanges plugs or loads then, and odometry is lost when the robot is carried or a wheel
slips."""

FAULTS = {name: kind for name, kind in CATALOGUE.items() if name not in NOT_UNDER_WAY}
"""All that may befall a robot under way."""

IDENTIFIERS = (0, 0x181, 0x201)
"""Whose frames suffer: all, the feedback, the command."""

WIDE = 20.0
"""Bounds farther apart than this factor: each order of magnitude is as likely as another."""

LONGEST_S = 1.5
"""Of times that are drawn, so that a fault is soon over."""

LEFT = 0.9
"""Of the supply: what a brown-out leaves must be less than there is, also where it falls a bit."""


class Endurance:
    """One robot, its operator and its bad luck.

    Parameters
    ----------
    robot
        Configuration file.
    seed
        Of the simulation, the faults and their times.
    mean_s
        Mean time between faults [s].
    """

    def __init__(self, robot: Path, seed: int, mean_s: float) -> None:
        mission = find_file("patrol", "missions")
        self._start = start = load_mission(mission).start.pose
        options = StackOptions(
            instance="endurance",
            robot=str(robot),
            mission=str(mission),
            x_m=start.x_m,
            y_m=start.y_m,
            theta_rad=start.theta_rad,
        )
        self._config, self._options = options.load(), options
        world = find_file(load_mission(mission).world, "worlds")
        pose = (start.x_m, start.y_m, start.theta_rad)
        self.simulation = simulation = make_simulation(robot, world, seed, pose)
        self.stack = LockstepStack(self._config, options, simulation)
        self._adapter = make_navigation(self._config, options)
        self._every = max(1, round(self._adapter.period_ns / self.stack.period_ns))
        self._rng = np.random.default_rng(seed)
        self._mean_s = mean_s
        self.faults: Counter[str] = Counter()
        self.stops: Counter[str] = Counter()
        self.causeless: list[str] = []
        """Stops that neither a fault nor a wall explains: when, and what the robot said."""
        self.laps: Counter[str] = Counter()
        """How they ended: completed, failed or given up."""
        self.recoveries = self.failed_recoveries = 0
        """From a stop that latched. The robot is armed for each lap, too; that may fail as well."""
        self.slowest_recovery_s = 0.0
        """Without the time of faults: a new one holds the count up and does not begin it anew."""
        self.batteries = 1
        self._fault_end_ns = self._pause_end_ns = self._asked_ns = 0
        self._stopped_ns: int | None = None
        self._latched = False
        self._quiet_ns = 0
        """How long no fault was there since the robot has stopped."""
        self._lap_end_ns = LAP_NS
        self._next_fault_ns = self._draw_ns()
        self._navigation: NavigationState | None = None
        self._wishes: list[ControlRequest] = []
        self._number = 0

    @property
    def now_ns(self) -> int:
        """Simulated time [ns]."""
        return self.stack.clock.now_ns()

    def run_until(self, end_ns: int) -> None:
        """Simulate up to `end_ns`."""
        requests: tuple[ControlRequest, ...] = ()
        stack = self.stack
        while self.now_ns < end_ns:
            if self.now_ns < self._pause_end_ns:  # the host is held up
                now_ns = self.now_ns + stack.period_ns
                self.simulation.advance(now_ns)
                stack.clock.sleep_until(now_ns)
                continue
            stack.tick(requests)
            requests = ()
            if stack.ticks % self._every == 0:
                requests = self._navigate(stack.snapshot())

    def _navigate(self, control: ControlState) -> tuple[ControlRequest, ...]:
        """Be navigator, operator and fate."""
        now_ns = control.stamp_ns
        for ack in control.acks:
            if not ack.accepted:
                self.simulation.monitor.on_refusal(ack.request_id)
        if now_ns >= self._next_fault_ns:
            self._strike(now_ns)
        modes: tuple[SetMode, ...] = ()
        navigation = self._navigation
        if control.state in POWERED:
            self._recovered()
            if navigation is not None and navigation.mode == Mode.HOLD:
                modes = (SetMode(now_ns, Mode.AUTO),)
            if ended := self._end_of_lap(navigation, control, now_ns):
                self.laps[ended] += 1
                return self._begin_lap(now_ns)
        wishes, self._wishes = self._wishes, []
        wishes += self._operate(control, now_ns)
        command, self._navigation = self._adapter.step(control, None, modes, now_ns)
        return (command, *wishes)

    def _operate(self, control: ControlState, now_ns: int) -> list[ControlRequest]:
        """Recover a robot that has stopped, once the fault is over."""
        if control.state in POWERED:
            return []
        if self._stopped_ns is None:
            self._stopped_ns, self._quiet_ns, self._latched = now_ns, 0, False
        if control.state in LATCHED and not self._latched:  # disarmed between laps, perhaps
            self._latched, self._quiet_ns = True, 0
            self.stops[control.fault.name] += 1
            late = now_ns > self._fault_end_ns + AFTERMATH_NS or not self.faults
            if late and not self.simulation.plant.touching:
                self.causeless.append(f"{now_ns / 1e9:.3f} s: {control.reason}")
        since_ns = max(self._stopped_ns, self._fault_end_ns) + QUIET_NS
        if now_ns >= self._fault_end_ns:
            self._quiet_ns += self._adapter.period_ns
        if self._quiet_ns > RECOVERY_NS:
            self.failed_recoveries += 1
            print(f"{now_ns / 1e9:.1f} s: not recovered: {control.state.name}, {control.reason}, "
                  f"{control.acks[-1:]}", flush=True)  # fmt: skip
            self._quiet_ns = 0
        if now_ns < since_ns or now_ns - self._asked_ns < SECOND_NS:
            return []
        self._asked_ns = now_ns
        refused = {reason.code for ack in control.acks[-1:] for reason in ack.reasons}
        if FaultCode.DRIVE_PARAMETER in refused:
            [host] = (port for port in self.simulation.bus.ports if port.name == "host")
            host.send(*STORE)
        self._number += 1
        self.simulation.monitor.on_arming(self._number)
        return [Arm(now_ns, self._number, arm=True)]

    def _recovered(self) -> None:
        """Note the end of a stop."""
        if self._stopped_ns is not None and self._latched:
            self.slowest_recovery_s = max(self.slowest_recovery_s, self._quiet_ns / 1e9)
            self.recoveries += 1
        self._stopped_ns = None

    def _end_of_lap(
        self, navigation: NavigationState | None, control: ControlState, now_ns: int
    ) -> str:
        """Return how the lap has ended, empty while it goes on."""
        if navigation is not None and abs(control.v_m_s) < 0.01:
            if navigation.mission_completed:
                return "completed"
            if navigation.mission_failed:
                return "failed"
        return "given up" if now_ns >= self._lap_end_ns else ""

    def _begin_lap(self, now_ns: int) -> tuple[ControlRequest, ...]:
        """Disarm the robot, carry it to its start and let its odometry begin there.

        Where the battery is low it is changed for a full one.
        """
        self._lap_end_ns = now_ns + LAP_NS
        start, drive = self._start, self._config.drive
        plant = self.simulation.plant
        plant.place(start.x_m, start.y_m, start.theta_rad)
        if plant.charge < CHANGE_BELOW:
            plant.charge = 1.0
            self.batteries += 1
        angles = [way_m / drive.wheel_radius_m for way_m in self.stack.snapshot().wheel_distance_m]
        self.stack.core.motion.odometry = Odometry(drive, start)
        self.stack.core.motion.odometry.reset(tuple(angles[: len(drive.wheel_names)]))
        self._adapter = make_navigation(self._config, self._options)
        self._navigation = None
        self._number += 1
        return (Arm(now_ns, self._number, arm=False),)

    def _draw_ns(self) -> int:
        """Draw the time of the next fault."""
        wait_s = min(self._rng.exponential(self._mean_s), NEVER_S)
        return self.now_ns + round(wait_s * 1e9)

    def _strike(self, now_ns: int) -> None:
        """Let one fault happen."""
        end_ns = now_ns + round(self._rng.uniform(0.005, 0.8) * 1e9)
        name, arguments = self._draw_fault(end_ns - now_ns)
        self.faults[name] += 1
        if name in FAULTS:
            self.simulation.faults.begin(name, arguments)
        elif name == HELD_UP:
            self._pause_end_ns = end_ns
        else:
            self._wishes.append(EmergencyStop(now_ns, EmergencyStopSource.OPERATOR))
        self._fault_end_ns = max(self._fault_end_ns, end_ns)
        self._next_fault_ns = self._draw_ns()

    def _draw_fault(self, lasts_ns: int) -> tuple[str, dict[str, Value]]:
        """Draw a fault that this robot can feel: it may have but one motor."""
        while True:
            name = str(self._rng.choice([*FAULTS, *HOST_FAULTS]))
            if name in HOST_FAULTS:
                return name, {}
            kind = FAULTS[name]
            arguments = self._arguments(kind, lasts_ns)
            if not any(kind.fits(self.simulation.config, kind.complete(arguments))):
                return name, arguments

    def _arguments(self, kind: Kind, lasts_ns: int) -> dict[str, Value]:
        """Draw them all: whose, for how long, how often, how much."""
        robot = self.simulation.config
        last_sonar = max(0, len(robot.sonar) - 1)
        drives = [motor.name for motor in robot.motors]
        named = {"node": fits.nodes(robot), "drive": drives}
        highest: dict[str, float] = {
            "delay": LONGEST_S,
            "sag": LONGEST_S,
            "volts": LEFT * self.simulation.plant.bus_voltage_v,
            "sonar": last_sonar,
            "other": last_sonar,
        }
        drawn: dict[str, Value] = {}
        for name, parameter in kind.parameters.items():
            if parameter.named:
                drawn[name] = str(self._rng.choice(named.get(name, robot.drive.wheel_names)))
            elif parameter.words:
                drawn[name] = str(self._rng.choice(parameter.words))
            elif name == DURATION:
                drawn[name] = lasts_ns / 1e9
            elif name == "id":
                drawn[name] = int(self._rng.choice(IDENTIFIERS))
            else:
                drawn[name] = _draw(self._rng, parameter, highest.get(name, parameter.high))
        return drawn


def _draw(rng: np.random.Generator, parameter: Parameter, highest: float) -> float:
    """Draw a number of a parameter, none above `highest`."""
    low, high = parameter.low, min(parameter.high, highest)
    if parameter.whole:
        return float(rng.integers(round(low), round(high), endpoint=True))
    if low > 0.0 and high > WIDE * low:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))
    return float(rng.uniform(low, high))


def resident_mib() -> float:
    """Return the memory of this process [MiB]."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * resource.getpagesize() / 2**20


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(prog="tools/endurance.py", description=__doc__)
    add = parser.add_argument
    add("--hours", type=float, default=1.0, help="of simulated time (%(default)s)")
    add("--seed", type=int, default=1, help="(%(default)s)")
    add("--robot", default="diff_drive", help="(%(default)s)")
    add("--every", type=float, default=20.0, help="mean time between faults [s] (%(default)s)")
    options = parser.parse_args()
    run = Endurance(find_file(options.robot), options.seed, options.every)
    begin_s, before_mib = time.monotonic(), 0.0
    parts = max(10, round(options.hours * 4))
    for part in range(1, parts + 1):
        run.run_until(round(options.hours * 3600e9 * part / parts))
        if part == max(1, parts // 10):
            before_mib = resident_mib()
        monitor = run.simulation.monitor
        print(
            f"{run.now_ns / 3600e9:6.2f} h  {run.laps.total()} laps  {run.faults.total()} faults  "
            f"{run.stops.total()} stops  {run.recoveries} recoveries  "
            f"{monitor.count} unsafe motions  {resident_mib():.1f} MiB  "
            f"{run.now_ns / 1e9 / (time.monotonic() - begin_s):.0f} x real time",
            flush=True,
        )
    return conclude(run, resident_mib() - before_mib)


def conclude(run: Endurance, growth_mib: float) -> int:
    """Print the sums; return the exit status."""
    simulation = run.simulation
    for title, counts in (("laps", run.laps), ("faults", run.faults), ("stops", run.stops)):
        print(f"\n{title}")
        for name, count in counts.most_common():
            print(f"  {count:6d}  {name}")
    bus = run.stack.snapshot().bus
    print(
        f"\nhost: {bus.crc_rejects} frames rejected for their CRC, {bus.counter_rejects} for their "
        f"counter, {bus.lost} lost\n"
        f"{run.recoveries} recoveries from {run.stops.total()} stops, slowest "
        f"{run.slowest_recovery_s:.1f} s without a fault; {run.failed_recoveries} failed\n"
        f"{run.batteries} batteries\n"
        f"memory grew by {growth_mib:.1f} MiB after the first tenth\n"
        f"{simulation.monitor.count} unsafe motions"
    )
    for finding in simulation.monitor.findings:
        print(f"  {finding.stamp_ns / 1e9:.3f} s: {finding.reason}")
    print(f"{len(run.causeless)} stops without a fault or a wall")
    for stop in run.causeless:
        print(f"  {stop}")
    grew = growth_mib > GROWTH_MIB
    bad = simulation.monitor.count or run.failed_recoveries or run.causeless or grew
    bad = bad or not run.laps["completed"]
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
