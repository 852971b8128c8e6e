"""One step of navigation: what it tells the navigator of the map that is made."""

import msgspec
import numpy as np

from robotctl.app.processes.navigator import make_navigation
from robotctl.app.processes.robot import make_core
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import find_file, load_robot
from robotctl.core.navigation_tick import NavigationTick
from robotctl.core.operator import Operator
from robotctl.messages.control import LoopStatistics
from robotctl.messages.estimation import LocalisationState
from robotctl.model.geometry.localisation import LocalisationStatus
from robotctl.model.grid_map import GridMap

CONFIG = load_robot(find_file("diff_drive"))
STATE = make_core(CONFIG, StackOptions("x", "")).snapshot(0, LoopStatistics())
STEP_NS = 50_000_000
GRID = GridMap(np.zeros((3, 3), np.int8), 0.1)


class Estimation:
    """An estimator whose pose jumps when a test says so, with a map that is drawn later."""

    def __init__(self) -> None:
        self.epoch_ns = STEP_NS
        self.settled: GridMap | None = None
        self.pictures = self.given_map = lambda now_ns: ()
        self.take_notices = lambda: ()

    def settled_map(self) -> GridMap | None:
        return self.settled

    def step(self, _control, _seen, _poses, now_ns: int) -> LocalisationState:
        status = LocalisationStatus.LOCALISED
        variances = (0.1, 0.0, 0.0, 0.1, 0.0, 0.1)
        state = LocalisationState(now_ns, "double", status, 1.0, 0.0, 0.0, variances)
        return msgspec.structs.replace(state, epoch_ns=self.epoch_ns)


def test_after_each_jump_the_navigator_is_told_once_what_the_map_knows_when_it_is_drawn(
    monkeypatch,
):
    adapter, estimation = make_navigation(CONFIG, StackOptions("x", "")), Estimation()
    told = []
    monkeypatch.setattr(adapter.navigator, "recall", lambda grid: told.append((now_ns, grid)))
    tick = NavigationTick(adapter, estimation, Operator(list, lambda message: None))
    for step in range(1, 13):
        now_ns = step * STEP_NS
        if step == 7:
            estimation.epoch_ns = now_ns
        estimation.settled = None if step in (1, 7, 8) else GRID
        tick.receive(msgspec.structs.replace(STATE, stamp_ns=now_ns), ())
        tick.localise(now_ns)
        tick.navigate(now_ns)
    assert told == [(2 * STEP_NS, GRID), (9 * STEP_NS, GRID)]
