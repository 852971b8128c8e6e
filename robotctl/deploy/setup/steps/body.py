"""Step: how far the robot reaches, for all that keeps it off obstacles."""

from __future__ import annotations

from collections.abc import Generator

from robotctl.config.file_edit import Change
from robotctl.deploy.setup.bench import Bench
from robotctl.deploy.setup.dialogue import NO_CHANGES, Answer, Ask, Kind, Script, Tell, Topic
from robotctl.model.body import FARTHEST_M


def run(bench: Bench) -> Script:
    """Ask how far the body reaches to each side; write a rectangle if that is news."""
    yield Tell(
        "Obstacles are kept off the outline of the robot with all that it carries, at any height. "
        "Measure from the middle of the driven axle; of the rear one if the robot steers."
    )
    body = bench.config.footprint
    front_m = yield from _reach_m("ahead", body.front_m)
    rear_m = yield from _reach_m("behind", -body.rear_m)
    left_m = yield from _reach_m("to the left", body.left_m)
    right_m = yield from _reach_m("to the right", body.right_m)
    if None is front_m is rear_m is left_m is right_m:
        return NO_CHANGES
    front = body.front_m if front_m is None else front_m
    rear = body.rear_m if rear_m is None else -rear_m
    left = body.left_m if left_m is None else left_m
    right = body.right_m if right_m is None else right_m
    yield Tell("If it is no rectangle, you may enter its corners: docs/missions.md, [body].")
    corners = [[front, left], [rear, left], [rear, -right], [front, -right]]
    guard = "navigation", "guard"  # an outline takes the place of its measures
    return (
        Change(("body", "outline"), [[round(x, 4), round(y, 4)] for x, y in corners]),
        Change((*guard, "nose_m"), None),
        Change((*guard, "half_width_m"), None),
    )


def _reach_m(way: str, now_m: float) -> Generator[Ask | Tell, Answer, float | None]:
    """Ask how far the robot reaches, until the answer can be right [m]; None: as the file says."""
    now = f"{now_m:.3f}"
    while True:
        text = f"How far does it reach {way} [m]? (now {now})"
        answer = float((yield Ask(Topic.BODY, text, Kind.NUMBER, default=now, subject=way)))
        if answer == float(now):
            return None
        if 0.0 < answer <= FARTHEST_M:
            return answer
        yield Tell(f"{answer:g} found, above 0 to {FARTHEST_M:g} m allowed.")
