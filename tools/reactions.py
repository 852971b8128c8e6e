"""How long reactions to faults take: in lockstep, each fault many times, at random moments.

Each fault of `hil_tests/fault_rows.py` befalls the simulated robot under way; a table says how long
its wheels had power, seen each millisecond. What is measured among processes, on real buses, comes
from `tools/soak.py`, in the same words. Exit status 1 where a reaction was later than its limit.
Faults of parts that the robot has not are named and not run.

With `--silence` the control process dies instead, on robots with drives of all makes, at any moment
of any motion: how long the wheels have power, and how far the robot goes until it rests.
"""

from __future__ import annotations

import argparse
import json
import math
import statistics
import sys
from collections import defaultdict
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from firmware_sim.config.config import RobotConfig as SimulatedRobot
from firmware_sim.faults.faults import check
from firmware_sim.simulation import Simulation
from hil_tests.fault_rows import ROWS, Row
from robotctl.app.simulation.lockstep_stack import LockstepStack, make_simulation
from robotctl.app.simulation.simulator_files import simulated_robot
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import find_file, load_robot
from robotctl.messages.control import Arm, SafetyState, VelocityCommand
from robotctl.messages.faults import FaultCode
from robotctl.safety.causes import AFTER_NS
from robotctl.safety.state_machine import POWERED

BUS = "simcan, lockstep"
V_M_S = 0.4
MIDDLE = (3.0, 2.0, 0.0)
MILLISECOND_NS = 1_000_000
SECOND_NS = 1000 * MILLISECOND_NS
HOLD_NS = 300 * MILLISECOND_NS
STEP = 10
"""Ticks between two velocity commands."""

DRIVEN = (
    "odrive", "skid_steer", "vesc_car", "moteus", "mecanum", "cia402", "zlac8015d", "roboteq",
    "diff_drive",
)  # fmt: skip
"""Robots with each make of drive; the last with our own."""
HALL = (6.0, 6.0, 0.0)
REST_NS = 30 * SECOND_NS
RESTS_M_S, RESTS_RAD_S = 0.01, 0.02


def reaction_table(lines: Iterable[str]) -> str:
    """Return a Markdown table, fault by bus: median and greatest time [ms], and of how many."""
    taken: dict[str, dict[str, list[float]]] = defaultdict(lambda: defaultdict(list))
    for line in lines:
        reaction = json.loads(line)
        taken[reaction["fault"]][reaction["bus"]].append(reaction["ms"])
    buses = sorted({bus for times in taken.values() for bus in times})

    def cell(ms: list[float]) -> str:
        return f"{statistics.median(ms):.1f} / {max(ms):.1f} ({len(ms)})" if ms else ""

    rows = [["fault", *buses], ["---"] * (1 + len(buses))]
    rows += [[fault, *(cell(taken[fault][bus]) for bus in buses)] for fault in sorted(taken)]
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


class Run:
    """One robot in the empty room, armed and under way.

    Parameters
    ----------
    robot
        Configuration file.
    seed
        Of the simulation.
    omega_rad_s, v_m_s, vy_m_s
        How it turns and drives.
    world, start
        Where.
    """

    def __init__(
        self,
        robot: Path,
        seed: int,
        omega_rad_s: float,
        v_m_s: float = V_M_S,
        vy_m_s: float = 0.0,
        *,
        world: str = "empty_room",
        start: tuple[float, float, float] = MIDDLE,
    ) -> None:
        x_m, y_m, theta_rad = start
        options = StackOptions(
            instance="reactions", robot=str(robot), x_m=x_m, y_m=y_m, theta_rad=theta_rad
        )
        self._wanted = v_m_s, omega_rad_s, vy_m_s
        self.simulation = make_simulation(robot, find_file(world, "worlds"), seed, start)
        self._stack = LockstepStack(options.load(), options, self.simulation)
        self._off_ns: int | None = None
        while self._stack.snapshot().state != SafetyState.ARMED:
            now_ns = self._stack.clock.now_ns()
            ask = self._stack.ticks % 100 == 99
            self._stack.tick((Arm(now_ns, self._stack.ticks, arm=True),) if ask else ())

    def drive(self, until_ns: int) -> None:
        """Hold the velocity up to a time, or until the host has stopped."""
        stack = self._stack
        while stack.clock.now_ns() < until_ns and stack.snapshot().state in POWERED:
            now_ns = stack.clock.now_ns()
            command = VelocityCommand(now_ns, now_ns + HOLD_NS, *self._wanted)
            stack.tick((command,) if stack.ticks % STEP == 0 else ())

    def now_ns(self) -> int:
        """Return the simulated time [ns]."""
        return self._stack.clock.now_ns()

    def fault(self) -> tuple[FaultCode, str]:
        """Return code and part of the fault for which the host has stopped, once it knows.

        It may hear of it later than the wheels, and of its cause yet later.
        """
        self.drive(self.now_ns() + SECOND_NS)
        known_ns = self.now_ns() + AFTER_NS
        while self.now_ns() <= known_ns:
            self._stack.tick(())
        control = self._stack.snapshot()
        return control.fault, control.fault_part

    def reason(self) -> str:
        """Return what the host says."""
        return self._stack.snapshot().reason

    def insist(self, duration_ns: int) -> bool:
        """Command the velocity although the host has stopped; return whether it gives power."""
        end_ns, powered = self.now_ns() + duration_ns, False
        while self.now_ns() < end_ns:
            now_ns = self.now_ns()
            self._stack.tick((VelocityCommand(now_ns, now_ns + HOLD_NS, *self._wanted),))
            powered |= self.simulation.plant.powered or self._stack.snapshot().state in POWERED
        return powered

    def _look(self) -> None:
        if self._off_ns is None and not self.simulation.plant.powered:
            self._off_ns = self.simulation.bus.now_ns

    def reaction_ms(self, row: Row, offset_ns: int) -> float:
        """Let the fault begin at an offset from now; return when the wheels were without power."""
        begin_ns = self.now_ns() + offset_ns
        simulation = self.simulation

        def begin() -> None:
            simulation.faults.inject(row.fault)
            simulation.faults.robot.repeat(self._look)

        simulation.bus.schedule(begin_ns, begin)
        limit_ns = begin_ns + round(2 * row.limit_ms * 1e6)
        self.drive(limit_ns)
        while self._off_ns is None and self.now_ns() < limit_ns:
            self._stack.tick(())
        return float("inf") if self._off_ns is None else (self._off_ns - begin_ns) / 1e6


class Silence(NamedTuple):
    """A robot whose control process died: times until no wheel has power, and until it rests.

    Infinite where that did not happen within `REST_NS`.
    """

    power_ms: float
    rest_ms: float
    distance_m: float

    @classmethod
    def of(cls, robot: Path, seed: int) -> Silence:
        """Let control die at a random moment of a random motion, and look at the robot."""
        rng = np.random.default_rng(seed)
        limits = load_robot(robot).limits
        greatest = limits.omega_max_rad_s, limits.v_max_m_s, limits.vy_max_m_s
        motion = (float(rng.uniform(-each, each)) for each in greatest)
        run = Run(robot, seed, *motion, world="hall", start=HALL)
        run.drive(run.now_ns() + round(rng.uniform(0.1, 2.0) * 1e9))
        simulation, period_ns = run.simulation, load_robot(robot).runtime.period_ns
        died_ns = run.now_ns() + int(rng.integers(0, period_ns))
        simulation.advance(died_ns)
        return cls._watch(simulation, died_ns)

    @classmethod
    def _watch(cls, simulation: Simulation, died_ns: int) -> Silence:
        """Look each millisecond until power and motion are over."""
        plant = simulation.plant
        x_m, y_m, _ = simulation.pose()
        power_ms = rest_ms = math.inf
        while math.isinf(power_ms + rest_ms) and simulation.now_ns < died_ns + REST_NS:
            if math.isinf(power_ms) and not plant.powered:
                power_ms = (simulation.now_ns - died_ns) / 1e6
            moves_m_s = math.hypot(plant.v_m_s, plant.vy_m_s)
            if moves_m_s < RESTS_M_S and abs(plant.omega_rad_s) < RESTS_RAD_S:
                rest_ms = (simulation.now_ns - died_ns) / 1e6
            simulation.advance(simulation.now_ns + MILLISECOND_NS)
            there = simulation.pose()
        return cls(power_ms, rest_ms, math.dist((x_m, y_m), there[:2]))


def measure_silence(robots: Sequence[str], repeats: int) -> int:
    """Print the table of robots whose control process dies; return how many kept power too long."""
    heads = "robot", "no power, ms", "at most", "at rest, ms", "distance, m"
    rows, late = [heads, ("---",) * len(heads)], 0
    for name in robots:
        robot = find_file(name)
        config = load_robot(robot)
        limit_ms = config.safety.command_timeout_ms + config.runtime.period_ns / 1e6
        found = [Silence.of(robot, seed) for seed in range(repeats)]
        late += sum(each.power_ms > limit_ms for each in found)
        columns = list(zip(*found, strict=True))
        power, rest, way = (
            f"{statistics.median(column):.{digits}f} / {max(column):.{digits}f}"
            for column, digits in zip(columns, (0, 0, 2), strict=True)
        )
        rows.append((name, power, f"{limit_ms:g}", rest, way))
        print(f"{name}: {repeats} deaths", file=sys.stderr, flush=True)
    print("\n".join(f"| {' | '.join(row)} |" for row in rows))
    print(f"{late} of {len(robots) * repeats} robots had power for too long")
    return late


def can_feel(robot: SimulatedRobot, row: Row) -> bool:
    """Return whether a fault can befall a robot: it has the part."""
    name, *words = row.fault.split()
    kind, arguments = check(name, dict(word.split("=") for word in words))
    return not any(kind.fits(robot, arguments))


def measure(robot: Path, row: Row, seed: int) -> float:
    """Return one reaction time [ms] to a fault at a random moment, which the robot can feel."""
    rng = np.random.default_rng(seed)
    run = Run(robot, seed, row.omega_rad_s)
    run.drive(run.now_ns() + round(rng.uniform(0.8, 1.2) * 1e9))
    return run.reaction_ms(row, int(rng.integers(0, 10 * MILLISECOND_NS)))


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(prog="tools/reactions.py", description=__doc__)
    add = parser.add_argument
    add("--repeats", type=int, default=20, help="of each fault (%(default)s)")
    add("--robot", default="diff_drive", help="(%(default)s)")
    add(
        "--silence",
        nargs="*",
        metavar="ROBOT",
        help=f"let the control process die instead; default: {', '.join(DRIVEN)}",
    )
    add("--keep", type=Path, metavar="FILE", help="add each reaction to this file, a JSON a line")
    options = parser.parse_args()
    if options.silence is not None:
        return 1 if measure_silence(options.silence or DRIVEN, options.repeats) else 0
    robot, lines, late = find_file(options.robot), [], 0
    simulated = simulated_robot(robot)
    felt = [row for row in ROWS if can_feel(simulated, row)]
    for number, row in enumerate(felt, 1):
        for seed in range(options.repeats):
            taken_ms = measure(robot, row, seed)
            late += taken_ms > row.limit_ms
            lines.append(json.dumps({"fault": row.name, "bus": BUS, "ms": round(taken_ms, 3)}))
        print(f"{number} of {len(felt)}: {row.name}", file=sys.stderr, flush=True)
    if options.keep is not None:
        with options.keep.open("a", encoding="utf-8") as output:
            output.write("".join(f"{line}\n" for line in lines))
    print(reaction_table(lines))
    for row in ROWS:
        if row not in felt:
            print(f"not run, {options.robot} cannot feel it: {row.name}")
    print(f"{late} of {len(lines)} reactions later than their limit")
    return 1 if late else 0


if __name__ == "__main__":
    sys.exit(main())
