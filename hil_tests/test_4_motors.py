"""Bring-up, fourth step: open loop, each motor turns its own wheel the right way."""

import time
from collections.abc import Iterator

import pytest

from hil_tests.rig import Rig
from robotctl.app.processes.robot import make_robot
from robotctl.messages.actuators import ActuatorCommand
from robotctl.runtime.clock import RealClock


class OpenLoop:
    """Commands duties without any control, as in a first spin with the wheels off the ground."""

    def __init__(self, rig: Rig) -> None:
        self.rig = rig
        self.clock = RealClock()
        self.robot = make_robot(rig.config, self.clock)
        self.wheels = ()
        self.nodes = ()

    def hold(self, command: ActuatorCommand, seconds: float) -> tuple[int, int]:
        """Send `command` at 200 Hz for so long; return how far both counts moved."""
        first = None
        deadline_ns = self.clock.now_ns()
        end_ns = deadline_ns + round(seconds * 1e9)
        while deadline_ns < end_ns:
            deadline_ns += 5_000_000
            self.clock.sleep_until(deadline_ns)
            feedback = self.robot.receive(deadline_ns)
            self.nodes = feedback.nodes
            if feedback.actuators[0].motion_ns > 0:
                self.wheels = feedback.actuators
                first = first or self.wheels
            self.robot.send(command, deadline_ns)
            self.rig.listen()
        assert first is not None
        return tuple(
            (after.position_ticks - before.position_ticks + 0x8000) % 0x10000 - 0x8000
            for before, after in zip(first, self.wheels, strict=True)
        )


@pytest.fixture
def open_loop(rig: Rig) -> Iterator[OpenLoop]:
    bench = OpenLoop(rig)
    deadline = time.monotonic() + 10
    bench.hold(ActuatorCommand(), 0.3) if not bench.nodes else None
    while not bench.nodes or any(node.problem for node in bench.nodes):
        assert time.monotonic() < deadline, bench.nodes
        bench.hold(ActuatorCommand(), 0.2)
    yield bench
    bench.robot.close()


def test_each_duty_moves_its_own_wheel_in_its_own_direction(open_loop: OpenLoop) -> None:
    for duties in ((0.2, 0.0), (0.0, 0.2), (-0.2, 0.0), (0.0, -0.2), (0.2, 0.2)):
        counts = open_loop.hold(ActuatorCommand(True, False, duties), 1.0)
        for duty, count in zip(duties, counts, strict=True):
            if duty:
                assert count * duty > 0, duties
                assert abs(count) > 200, duties
            else:
                assert abs(count) < 60, duties
        open_loop.hold(ActuatorCommand(), 0.5)


def test_the_left_wheel_alone_turns_the_robot_right(open_loop: OpenLoop) -> None:
    before = open_loop.rig.truth
    open_loop.hold(ActuatorCommand(True, False, (0.25, 0.0)), 0.8)
    open_loop.rig.wait(lambda: open_loop.rig.truth is not before, 1, "truth")
    assert open_loop.rig.truth.theta_rad < -0.2


def test_a_disabled_bridge_leaves_the_wheels_still(open_loop: OpenLoop) -> None:
    assert open_loop.hold(ActuatorCommand(), 0.5) == (0, 0)
