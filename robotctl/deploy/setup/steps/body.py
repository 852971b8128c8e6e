"""Step: how far the robot reaches, for all that keeps it off obstacles."""

from __future__ import annotations

from collections.abc import Generator
from typing import Final

from robotctl.config.file_edit import Change
from robotctl.deploy.setup.bench import Bench
from robotctl.deploy.setup.dialogue import NO_CHANGES, Answer, Ask, Kind, Script, Tell, Topic
from robotctl.model.body import FARTHEST_M

WAYS: Final = ("ahead", "behind", "to the left", "to the right")


def run(bench: Bench) -> Script:
    """Ask how far the body reaches to each side; write a rectangle if that is news."""
    yield Tell(
        "Obstacles are kept off the outline of the robot with all that it carries, at any height. "
        "Measure from the middle of the driven axle; of the rear one if the robot steers."
    )
    body = bench.config.footprint
    believed_m = [body.front_m, -body.rear_m, body.left_m, body.right_m]
    reach_m = []
    for way, now_m in zip(WAYS, believed_m, strict=True):
        reach_m.append((yield from _reach_m(way, now_m)))
    if reach_m == believed_m:
        return NO_CHANGES
    front, rear, left, right = reach_m
    yield Tell("If it is no rectangle, you may enter its corners: docs/missions.md, [body].")
    corners = [[front, left], [-rear, left], [-rear, -right], [front, -right]]
    guard = "navigation", "guard"  # an outline takes the place of its measures
    return (
        Change(("body", "outline"), [[round(x, 4), round(y, 4)] for x, y in corners]),
        Change((*guard, "nose_m"), None),
        Change((*guard, "half_width_m"), None),
    )


def _reach_m(way: str, now_m: float) -> Generator[Ask | Tell, Answer, float]:
    """Ask how far the robot reaches, until the answer can be right [m]."""
    now = f"{now_m:.3f}"
    while True:
        text = f"How far does it reach {way} [m]? (now {now})"
        answer = float((yield Ask(Topic.BODY, text, Kind.NUMBER, default=now, subject=way)))
        if answer == float(now):
            return now_m
        if 0.0 < answer <= FARTHEST_M:
            return answer
        yield Tell(f"{answer:g} found, above 0 to {FARTHEST_M:g} m allowed.")
