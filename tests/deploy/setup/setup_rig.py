"""The guide with a simulated robot that is wired otherwise than its file says, and its witness."""

from __future__ import annotations

import tomllib
from pathlib import Path

from robotctl.app.simulation.lockstep_stack import LockstepStack
from robotctl.cli.setup.simulated import SimulatedBuses, SimulatedPerson
from robotctl.config.file_edit import Change, edit
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import find_file, load_robot
from robotctl.deploy.setup.dialogue import Ask
from robotctl.deploy.setup.guide import Guide
from robotctl.deploy.setup.registry import STEPS
from robotctl.messages.control import Arm, SafetyState, VelocityCommand

MOST_M_S = 0.2
STEP = {step.name: step for step in STEPS}


class WatchedBuses(SimulatedBuses):
    """Also remembers the fastest that any wheel has truly been."""

    def __init__(self, file: Path) -> None:
        super().__init__(file)
        self.fastest_m_s = 0.0
        clock, simulation = self.clock, self.simulation
        radii_m = load_robot(file).drive.wheel_radii_m
        outer = self

        class Clock:
            def now_ns(self):
                return clock.now_ns()

            def sleep_until(self, deadline_ns):
                while clock.now_ns() < deadline_ns:
                    clock.sleep_until(min(clock.now_ns() + 1_000_000, deadline_ns))
                    simulation.run_to(simulation.now_ns)
                    for axis, radius_m in zip(simulation.plant.axes, radii_m, strict=True):
                        fast_m_s = abs(axis.speed_rad_s) * radius_m
                        outer.fastest_m_s = max(outer.fastest_m_s, fast_m_s)

        self.clock = Clock()


class Heard(SimulatedPerson):
    """Also remembers what was said."""

    def __init__(self, simulation) -> None:
        super().__init__(simulation)
        self.said: list[str] = []
        self.asked: list[Ask] = []
        self.script: dict = {}
        """Answers by topic instead of the truth, each used once; "" for the default."""

    def tell(self, text: str) -> None:
        super().tell(text)
        self.said.append(text)

    def ask(self, question: Ask) -> None:
        super().ask(question)
        self.asked.append(question)

    def _reply(self, question: Ask) -> str:
        answer = super()._reply(question)
        waiting = self.script.get(question.topic)
        return waiting.pop(0) if waiting else answer


class SetupRig:
    """A robot's file in a folder, its truth, and a person.

    Parameters
    ----------
    folder
        Where the file is.
    robot
        Robot that comes with robotctl.
    believed
        Replaced text of its file.
    truth
        What is true of its drives, by their names: `[simulation.twin.NAME]`.
    """

    def __init__(
        self,
        folder: Path,
        robot: str,
        truth: dict | None = None,
        believed: tuple[tuple[str, str], ...] = (),
    ) -> None:
        text = find_file(robot).read_text()
        for old, new in believed:
            assert old in text
            text = text.replace(old, new, 1)
        self.file = folder / "robot.toml"
        true = [
            Change(("simulation", "twin", drive, key), value)
            for drive, keys in (truth or {}).items()
            for key, value in keys.items()
        ]
        self.file.write_text(edit(text, true)[0])
        self.before = self.file.read_text()
        self.buses = WatchedBuses(self.file)
        self.simulation = self.buses.simulation
        self.person = Heard(self.simulation)
        self.guide = Guide(self.file, self.buses, self.person)

    def run(self, *steps: str) -> list[bool]:
        """Do some steps; return whether each is done."""
        done = [self.guide.run(STEP[step]) for step in steps]
        assert self.buses.fastest_m_s <= MOST_M_S
        return done

    @property
    def config(self):
        """The robot by its file."""
        return load_robot(self.file)

    @property
    def text(self) -> str:
        """The file."""
        return self.file.read_text()

    @property
    def tables(self):
        """The file as a foreign reader has it."""
        return tomllib.loads(self.text)

    def heard(self, words: str) -> bool:
        """Return whether words were said."""
        return any(words in each for each in self.person.said)

    def drive_straight(self, v_m_s: float = 0.3, seconds: float = 3.0):
        """Let the robot by its new file drive on the floor; return its true x, y, heading."""
        buses = SimulatedBuses(self.file)
        start = buses.simulation.pose()
        stack = LockstepStack(self.config, StackOptions("t", str(self.file)), buses.simulation)
        for _ in range(2000):
            wish = (Arm(stack.clock.now_ns(), stack.ticks, arm=True),)
            stack.tick(wish if stack.snapshot().state is SafetyState.STANDBY else ())
            if stack.snapshot().state is SafetyState.ARMED:
                break
        else:
            raise AssertionError(stack.snapshot().reason)
        for _ in range(round(seconds * 1e9 / stack.period_ns)):
            now_ns = stack.clock.now_ns()
            stack.tick((VelocityCommand(now_ns, now_ns + 100_000_000, v_m_s, 0.0),))
        assert stack.snapshot().state is SafetyState.DRIVING, stack.snapshot().reason
        x, y, theta = buses.simulation.pose()
        return x - start[0], y - start[1], theta - start[2]
