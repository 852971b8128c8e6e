"""A robot that takes up a cart: whatever drives it goes by the body that it has then."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from firmware_sim.errors import SimulationError
from robotctl.app.simulation.lockstep import LockstepRun
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.config.robot_file import find_file
from robotctl.messages.tuning import Tuning

BODY = """
[body]
outline = [[0.2, 0.18], [-0.17, 0.18], [-0.17, -0.18], [0.2, -0.18]]
states = ["empty", "loaded"]
state = 0

[[body.part]]
name = "cart"
outline = [[0.25, 0.42], [-0.35, 0.42], [-0.35, -0.42], [0.25, -0.42]]
states = ["loaded"]
"""
WALLS = [
    [0, -1.5], [3, -1.5], [3, -0.4], [3.1, -0.4], [3.1, -1.5], [6, -1.5], [6, 4.5], [3.1, 4.5],
    [3.1, 3.9], [3, 3.9], [3, 4.5], [0, 4.5],
]  # fmt: skip
POST = [[3, 0.4], [3.1, 0.4], [3.1, 2.4], [3, 2.4]]
"""Below it is a door of 0.8 m, above it one of 1.5 m."""
MCL = ('localisation.method="mcl"',)
GOALS = (4.8, 1.2, 4.8)
LOADS_AFTER = 2
"""Goal at which the robot takes up the cart, in a corner with room for both."""


def drive(folder: Path, *, is_told: bool) -> tuple[LockstepRun, list[float], Any]:
    """Drive to and fro; return the run, where it passed the wall (y), and its report."""
    robot = folder / "robot.toml"
    robot.write_text(find_file("diff_drive").read_text() + BODY)
    start = "start = { x_m = 1.2, y_m = 0.0, heading_deg = 0.0 }"
    (folder / "doors.toml").write_text(
        f'[world]\nname = "doors"\nbounds = [0, -1.5, 6, 4.5]\n{start}\n'
        f"[[wall]]\npoints = {json.dumps(WALLS)}\nclosed = true\n"
        f"[[wall]]\npoints = {json.dumps(POST)}\nclosed = true\n"
    )
    items = "".join(f'[[item]]\nkind = "goto"\nx_m = {x_m}\ny_m = 0.0\n' for x_m in GOALS)
    mission = folder / "mission.toml"
    mission.write_text(f'name = "doors"\nworld = "doors.toml"\n{start}\n{items}')
    overrides = ("simulation.lidar.beams=360", "simulation.body=" + json.dumps(
        [[0.19, 0.17], [-0.16, 0.17], [-0.16, -0.17], [0.19, -0.17]]
    ))  # fmt: skip
    run = LockstepRun(
        SimOptions(robot, mission, seed=3, max_seconds=90.0, overrides=overrides, localisation=MCL)
    )
    requests: list[Any] = []
    ask = run._operator.mode
    run._operator.mode = lambda now_ns: requests.pop() if requests else ask(now_ns)  # type: ignore[method-assign]
    passed, before_m, is_loaded = [], 0.0, False
    states: list[int] = []

    def tell(control: Any, navigation: Any) -> None:
        nonlocal before_m, is_loaded
        x_m, y_m, _ = run.stack.simulation.pose()
        if (x_m - 3.05) * (before_m - 3.05) < 0.0 and before_m:
            passed.append(y_m)
        before_m = x_m
        if navigation.item == LOADS_AFTER and not is_loaded:
            is_loaded = True
            run.stack.simulation.faults.inject("body state=loaded")
            if is_told:
                requests.append(Tuning(control.stamp_ns, {"body.state": 1}, 1))
        states.append(navigation.body)

    report = run.run(tell)
    assert states[-1] == int(is_told)
    return run, passed, report


def test_with_a_cart_it_takes_the_door_that_is_wide_enough(tmp_path: Path) -> None:
    run, passed, report = drive(tmp_path, is_told=True)
    assert report.mission_completed, report.message
    assert report.collisions == 0
    assert run.stack.simulation.truth().body == 1
    assert [y_m > 2.4 for y_m in passed] == [False, False, True]
    assert report.min_clearance_m > 0.0


def test_not_told_of_its_cart_it_hits_the_narrow_door(tmp_path: Path) -> None:
    """So what the test above shows is not the simulator's kindness."""
    _, passed, report = drive(tmp_path, is_told=False)
    assert report.collisions > 0
    assert not report.mission_completed
    assert [y_m > 2.4 for y_m in passed] == [False, False]


def test_a_load_is_put_down_when_its_time_is_over(tmp_path: Path) -> None:
    (tmp_path / "robot.toml").write_text(find_file("diff_drive").read_text() + BODY)
    run = LockstepRun(SimOptions(tmp_path / "robot.toml", find_file("patrol", "missions")))
    simulation = run.stack.simulation
    simulation.faults.inject("body state=loaded duration=0.1")
    assert simulation.truth().body == 1
    simulation.advance(200_000_000)
    assert simulation.truth().body == 0


@pytest.mark.parametrize("state", ["lorded", "2"])
def test_a_state_that_there_is_not_is_named_with_the_nearest(state: str, tmp_path: Path) -> None:
    (tmp_path / "robot.toml").write_text(find_file("diff_drive").read_text() + BODY)
    run = LockstepRun(SimOptions(tmp_path / "robot.toml", find_file("patrol", "missions")))
    with pytest.raises(SimulationError, match=r"state: '.*', allowed: empty, loaded"):
        run.stack.simulation.faults.inject(f"body state={state}")
