"""How long reactions to faults take: in lockstep, each fault many times, at random moments.

Each fault of `hil_tests/fault_rows.py` befalls the simulated robot under way; a table says how long
its wheels had power, seen each millisecond. What is measured among processes, on real buses, comes
from `tools/soak.py`, in the same words. Exit status 1 where a reaction was later than its limit.
Faults of parts that the robot has not are named and not run.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from firmware_sim.config.config import RobotConfig as SimulatedRobot
from firmware_sim.faults.faults import check
from hil_tests.fault_rows import ROWS, Row
from robotctl.app.simulation.lockstep_stack import LockstepStack, make_simulation
from robotctl.app.simulation.sim_options import simulated_robot
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import find_file
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
    omega_rad_s
        How it turns.
    """

    def __init__(self, robot: Path, seed: int, omega_rad_s: float) -> None:
        x_m, y_m, theta_rad = MIDDLE
        options = StackOptions(
            instance="reactions", robot=str(robot), x_m=x_m, y_m=y_m, theta_rad=theta_rad
        )
        world = find_file("empty_room", "worlds")
        self._omega_rad_s = omega_rad_s
        self.simulation = make_simulation(robot, world, seed, MIDDLE)
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
            command = VelocityCommand(now_ns, now_ns + HOLD_NS, V_M_S, self._omega_rad_s)
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
    add("--keep", type=Path, metavar="FILE", help="add each reaction to this file, a JSON a line")
    options = parser.parse_args()
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
