"""What the score of a run keeps: no more the longer the run, but for its record."""

import tracemalloc
from pathlib import Path

import msgspec
import numpy as np

from robotctl.app.processes.robot import make_core
from robotctl.app.scoring.journey_score import JourneyScore
from robotctl.app.scoring.map_truth import MapTruth
from robotctl.app.scoring.run_score import RunScore
from robotctl.app.scoring.score import StampedPose
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import find_file, load_robot
from robotctl.logs.formats.tum import read_tum
from robotctl.messages.control import LoopStatistics
from robotctl.model.wall_map import WallMap

WALLS = WallMap(np.array([[0.0, 0.0, 4.0, 0.0]]))
MAP_TRUTH = MapTruth(WALLS, lambda: WALLS)
PERIOD_NS = 20_000_000
STATE = make_core(load_robot(find_file("diff_drive")), StackOptions("x", "")).snapshot(
    0, LoopStatistics()
)


def journey() -> JourneyScore:
    """Return the score of the way of a small robot."""
    body = np.array([(0.2, -0.1), (0.2, 0.1), (-0.2, 0.1), (-0.2, -0.1)])
    return JourneyScore([[body]], WALLS.segments)


def run(score: RunScore, begin: int, end: int) -> None:
    """Drive along x at 1 m/s; the odometry is 1 % long."""
    for tick in range(begin, end):
        now_ns = tick * PERIOD_NS
        x_m = now_ns * 1e-9
        score.control(msgspec.structs.replace(STATE, stamp_ns=now_ns, x_m=1.01 * x_m))
        score.truth(StampedPose(now_ns + PERIOD_NS // 2, x_m + 0.5e-9 * PERIOD_NS, 0.0, 0.0))


def growth(score: RunScore) -> int:
    """Return how many bytes six minutes take after one."""
    tracemalloc.start()
    try:
        run(score, 0, 3_000)
        before, _ = tracemalloc.get_traced_memory()
        run(score, 3_000, 21_000)
        return tracemalloc.get_traced_memory()[0] - before
    finally:
        tracemalloc.stop()


def test_a_run_without_a_record_keeps_no_more_the_longer_it_lasts() -> None:
    assert growth(RunScore(MAP_TRUTH, journey(), has_localiser=False, is_recorded=False)) < 10_000


def test_the_record_has_every_truth_and_the_figures_are_those_without(tmp_path: Path) -> None:
    recorded, other = (
        RunScore(MAP_TRUTH, journey(), has_localiser=False, is_recorded=True),
        RunScore(MAP_TRUTH, journey(), has_localiser=False, is_recorded=False),
    )
    for score in (recorded, other):
        run(score, 0, 10_000)
    assert recorded.pose_error == other.pose_error
    assert recorded.pose_error.max_m > 1.0
    recorded.save(tmp_path, 1)
    assert len(read_tum(tmp_path / "truth-0001.tum").stamps_ns) == 10_000
