"""The set-up of a simulated robot: its buses, and a person who sees what is true and says so."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from robotctl.app.simulation.lockstep_stack import attach_port, make_simulation
from robotctl.config.robot_file import find_file, load_robot
from robotctl.deploy.setup.dialogue import Ask, Topic
from robotctl.deploy.setup.steps.counts import TURNS
from robotctl.deploy.setup.steps.directions import BACKWARDS, FORWARDS, NONE
from robotctl.deploy.setup.steps.sensors import HAND_M
from robotctl.messages.ports import CanPort, Clock
from robotctl.model.body import OUTSIDE_M

if TYPE_CHECKING:
    from firmware_sim.simulation import Simulation

HAND_RAD_S: Final = 6.0
"""Speed of a wheel that is turned by hand [rad/s]."""
TURNING_RAD_S: Final = 0.5
"""Rate at which the robot is turned by hand, as its gyro feels it [rad/s]."""
_SEEN_RAD: Final = 0.1
"""Turn of a wheel that a person sees [rad]."""
_WAYS: Final = {"ahead": (0, 1), "behind": (0, -1), "to the left": (1, 1), "to the right": (1, -1)}
"""Axis and sign of the ways in which a body reaches."""


class _SimulatedClock:
    """Time of a simulation, which advances in `sleep_until`."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation

    def now_ns(self) -> int:
        """Return the present time [ns]."""
        return self._simulation.now_ns

    def sleep_until(self, deadline_ns: int) -> None:
        """Let the robot live until then."""
        if deadline_ns > self._simulation.now_ns:
            self._simulation.advance(deadline_ns)


class SimulatedBuses:
    """Buses of a simulated robot, which is as it is from the beginning, whatever its file becomes.

    Parameters
    ----------
    file
        The robot's file.
    seed
        Seed of the simulated world.

    Attributes
    ----------
    simulation
        The robot in an empty room.
    clock
        Its time.
    """

    def __init__(self, file: Path, seed: int = 1) -> None:
        room = find_file("empty_room", "worlds")
        self.simulation: Simulation = make_simulation(file, room, seed, None)
        self.clock: Clock = _SimulatedClock(self.simulation)
        self._config = load_robot(file)
        self._opened = 0

    def open(self, identifiers: Mapping[str, Collection[int]]) -> dict[str, CanPort]:
        """Return a port on each bus."""
        buses = {bus.name: bus for bus in self._config.buses}
        self._opened += 1
        host = f"host {self._opened}"
        return {
            name: attach_port(self.simulation.buses[name], buses[name], numbers, self.clock, host)
            for name, numbers in identifiers.items()
        }


class SimulatedPerson:
    """Sees the simulated robot as it is, does what is asked, and answers truthfully.

    Parameters
    ----------
    simulation
        The robot.
    """

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._truth: Mapping[str, Mapping[str, Any]] = simulation.config.simulation.twin
        self._names = simulation.config.drive.wheel_names
        self._question: Ask | None = None
        self._turned_ns = 0
        self._left_rad = 0.0
        """Turn by hand that is left [rad]."""
        self._before = self._angles_rad()
        self._way = FORWARDS

    def tell(self, text: str) -> None:
        """Take note."""

    def interrupts(self) -> bool:
        """Let the robot do what it does."""
        return False

    def ask(self, question: Ask) -> None:
        """Take a question."""
        self._question = question
        self._turned_ns = self._simulation.now_ns
        self._left_rad = math.tau * TURNS if question.topic is Topic.TURN else 0.0

    def answer(self) -> str | None:
        """Do what the question asks for, and return the answer when that is done."""
        question = self._question
        assert question is not None  # noqa: S101 - asked before it is answered
        if self._left_rad > 0.0:
            self._turn_on(question.subject)
            return None
        text = self._reply(question)
        self._before = self._angles_rad()
        return text

    def _angles_rad(self) -> list[float]:
        """Return the true angles of the wheels [rad]."""
        self._simulation.run_to(self._simulation.now_ns)
        return [axis.angle_rad for axis in self._simulation.plant.axes]

    def _turn_on(self, wheel: str) -> None:
        """Turn a wheel on by hand."""
        now_ns = self._simulation.now_ns
        step_rad = min(HAND_RAD_S * (now_ns - self._turned_ns) * 1e-9, self._left_rad)
        self._turned_ns = now_ns
        self._left_rad -= step_rad
        self._simulation.plant.axes[self._names.index(wheel)].turn(step_rad)

    def _reply(self, question: Ask) -> str:
        """Do what a question asks for, and return the answer."""
        topic, subject = question.topic, question.subject
        simulation = self._simulation
        match topic:
            case Topic.BLOCKS:
                for place in range(len(self._names)):
                    simulation.plant.loosen(place, 0.0)
            case Topic.WHEEL | Topic.WAY:
                return self._wheel() if topic is Topic.WHEEL else self._way
            case Topic.NUMBER:
                # Which of two drives has which name is for the robot's file to say.
                node_id = str(self._true(subject, "node_id"))
                is_offered = not question.choices or node_id in question.choices
                return node_id if is_offered else question.default
            case Topic.SCALE:
                found = [each for each in question.choices if each in self._truth.get(subject, {})]
                return found[0] if found else "ratio"
            case Topic.PRESS | Topic.RELEASE:
                self._supply(off=topic is Topic.PRESS)
            case Topic.HAND | Topic.AWAY:
                self._stand_before_a_wall(subject)
            case Topic.BODY:
                return self._reach(question)
            case Topic.NEXT | Topic.AGAIN:
                return "go on" if topic is Topic.NEXT else "give up"
            case _:
                self._tilt_or_turn(topic, subject)
        return question.default

    def _reach(self, question: Ask) -> str:
        """Return how far the body reaches [m]; what is right to a centimetre stays."""
        axis, sign = _WAYS[question.subject]
        outlines = self._simulation.config.outlines[self._simulation.plant.body_state]
        reach_m = max(sign * corner[axis] for outline in outlines for corner in outline)
        is_right = reach_m <= float(question.default) + OUTSIDE_M
        return question.default if is_right else f"{reach_m:.3f}"

    def _tilt_or_turn(self, topic: Topic, way: str) -> None:
        """Tilt, turn or level the robot, as its IMU feels it."""
        faults = self._simulation.faults
        if topic in (Topic.LEVEL, Topic.TILT):
            faults.clear()
        if topic is Topic.TILT:
            # Positive roll has the left side up.
            angles = "pitch=20 roll=0" if way == "forwards" else "pitch=0 roll=-20"
            faults.inject(f"tilted {angles}")
        elif topic is Topic.TURN_LEFT:
            faults.inject(f"gyro_biased rate={TURNING_RAD_S} duration=3")

    def _wheel(self) -> str:
        """Return which wheel turned since the last answer, and remember which way."""
        turned_rad = self._turned_rad()
        most = max(turned_rad, key=lambda each: abs(turned_rad[each]))
        self._way = FORWARDS if turned_rad[most] > 0.0 else BACKWARDS
        return most if abs(turned_rad[most]) > _SEEN_RAD else NONE

    def _turned_rad(self) -> dict[str, float]:
        """Return by how much each wheel has turned since the last answer [rad]."""
        now = zip(self._names, self._angles_rad(), self._before, strict=True)
        return {name: after - before for name, after, before in now}

    def _true(self, drive: str, key: str) -> Any:
        """Return the true value of a key of a drive."""
        table = next(each for each in self._simulation.config.motors if each.name == drive)
        return {**table.keys, **self._truth.get(drive, {})}[key]

    def _supply(self, *, off: bool) -> None:
        """Take the supply from the drives, as an emergency stop does, or give it back."""
        simulation = self._simulation
        own = () if simulation.drive is None else (simulation.drive,)
        for drive in (*own, *simulation.twins):
            if off:
                simulation.power_off(drive)
            else:
                simulation.power_up(drive)

    def _stand_before_a_wall(self, sonar: str) -> None:
        """Put the robot where a wall is what the hand would be; amid the room without a name."""
        plant, world = self._simulation.plant, self._simulation.world
        low_x, low_y, high_x, high_y = world.bounds
        x_m, y_m = 0.5 * (low_x + high_x), 0.5 * (low_y + high_y)
        mount = next((each for each in self._simulation.config.sonar if each.name == sonar), None)
        if mount is None:
            plant.place(x_m, y_m, 0.0)
            return
        theta_rad = -math.radians(mount.heading_deg)
        ahead_m = math.cos(theta_rad) * mount.x_m - math.sin(theta_rad) * mount.y_m
        plant.place(high_x - HAND_M - ahead_m, y_m, theta_rad)
