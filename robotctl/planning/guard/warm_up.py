"""The guard's kernels made ready, so that none is loaded or compiled while the robot drives."""

from __future__ import annotations

from robotctl.model.footprint import Footprint
from robotctl.model.footprint_arrays import side_rows
from robotctl.model.geometry.se2 import SE2
from robotctl.model.geometry.twist import Twist
from robotctl.model.sensors.sonar import SonarMount
from robotctl.planning.guard.change_of_course import Agility, is_free
from robotctl.planning.guard.course import Course
from robotctl.planning.guard.echo_memory import EchoMemory
from robotctl.planning.guard.swept_body import free_way


def warm_up() -> None:
    """Keep an echo, and look how far, and on which course, a body may go before it."""
    ahead, body = SonarMount("ahead", 0.2, 0.0, 0.0), Footprint.rectangle(-0.2, 0.2, 0.2)
    memory = EchoMemory((ahead,), body)
    for now_ns in range(3):
        points = memory.hear(SE2(), (0.5,), (False,), now_ns)
    sides = side_rows(body)
    free_way(sides, points, 0.1, Course(1.0, 0.0, 0.0))
    agility = Agility((1.0, 1.0, 1.0), (1.0, 1.0, 1.0), 0.2)
    is_free(sides, points, Twist(0.1, 0.0), Twist(0.0, 0.0, 0.1), agility)
