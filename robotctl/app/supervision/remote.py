"""Driving a robot that runs on this computer, from another process."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final, TypeAlias

import zmq

from robotctl.app.supervision.running_robot import running
from robotctl.app.supervision.silence import STATE_PERIOD_NS, silence
from robotctl.errors import RobotctlError
from robotctl.messages.control import (
    ControlState,
    NavigationRequest,
    NavigationState,
    Notice,
    PositionTarget,
    SetMode,
)
from robotctl.messages.mission import (
    AbortMission,
    ExploreTarget,
    GoAhead,
    JumpToItem,
    LoadMission,
    PlaceTarget,
)
from robotctl.messages.mode import Mode
from robotctl.messages.ports import Clock
from robotctl.runtime.clock import RealClock
from robotctl.runtime.ipc.topics import RequestSender, Subscriber
from robotctl.safety.state_machine import POWERED

_Heard: TypeAlias = ControlState | NavigationState | Notice

_ANSWER_NS: Final = 3_000_000_000
_POLL_NS: Final = 50_000_000
_STEP_NS: Final = 50_000_000
"""Usual period of navigation [ns]."""
_GONE_NS: Final = 10_000_000_000
"""Silence after which a robot is given up [ns]; long enough for a restart of its process."""


class RefusedError(RobotctlError):
    """The robot refused a request."""


class RemoteRobot:
    """A running robot, driven by an operator beside it; use as a context manager.

    Parameters
    ----------
    instance
        Name of the robot; empty: the only one that runs.
    clock
        Clock of requests and of waiting for answers.

    Raises
    ------
    LinkError
        If there is none.
    """

    def __init__(self, instance: str = "", clock: Clock | None = None) -> None:
        endpoints = running(instance)
        self._context = zmq.Context()
        published = endpoints.control_state, endpoints.navigation_state
        self._states = Subscriber[_Heard](self._context, published, _Heard)
        self._to_navigation = RequestSender(self._context, endpoints.navigation_requests)
        self._clock = clock or RealClock()
        self.control: ControlState | None = None
        self.navigation: NavigationState | None = None

    def __enter__(self) -> RemoteRobot:
        """Wait for the robot's first messages.

        Raises
        ------
        RefusedError
            If none come in time.
        """
        try:
            self._await(
                lambda: self.control is not None and self.navigation is not None,
                self._unheard,
            )
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_error: object) -> None:
        """Leave the robot as it is."""
        self._context.destroy(linger=0)

    def goto(
        self, x_m: float, y_m: float, heading_rad: float | None = None
    ) -> Iterator[NavigationState]:
        """Drive to a place of `world` in mode GUIDED; yield the states until the drive has ended.

        `NavigationState.goal_reached` of the last one is the result.

        Raises
        ------
        RefusedError
            If the robot is not armed, or refuses, or another operator takes over.
        """
        return self._guide(lambda now_ns: PositionTarget(now_ns, x_m, y_m, heading_rad))

    def goto_place(self, place: str, start: str = "") -> Iterator[NavigationState]:
        """Drive to a place of the robot's topological map in mode GUIDED, otherwise like `goto`.

        `start` is the robot's present place; empty: the robot recognises it.
        """
        return self._guide(lambda now_ns: PlaceTarget(now_ns, place, start))

    def explore(self) -> Iterator[NavigationState]:
        """Explore in mode GUIDED until the map is complete, otherwise like `goto`."""
        return self._guide(ExploreTarget)

    def run_mission(self, file: str, content: bytes) -> Iterator[NavigationState]:
        """Drive the mission of a file in mode AUTO; yield the states until it has ended.

        `NavigationState.mission_completed` of the last one is the result. A HOLD on request does
        not end it.

        Raises
        ------
        RefusedError
            As for `goto`.
        """
        self._require_armed()
        self._command(lambda now_ns: LoadMission(now_ns, file, content))
        runs = self._seen()[1].mission_runs
        self._drive_mission()
        while True:
            _, state = self._seen()
            yield state
            if state.mission_completed or state.mission_failed:
                return
            if state.mission_runs != runs:
                raise RefusedError("given up for something else: another mission, or aborted")
            if state.held or state.mode not in {Mode.AUTO, Mode.HOLD}:
                raise RefusedError(
                    f"interrupted in mode {state.mode.name}: {self._why()}; "
                    "`robotctl mission resume` goes on"
                )
            self._listen()
            self._require_heard()

    def pause(self) -> None:
        """Pause the mission; the robot stands and keeps its place in it.

        Raises
        ------
        RefusedError
            If the robot drives no mission.
        """
        _, state = self._seen()
        if state.mode is not Mode.AUTO or state.mission_completed or state.mission_failed:
            raise RefusedError("no mission is under way")
        self.hold()

    def resume(self) -> None:
        """Resume the mission, retry a failed item, or give the awaited go-ahead.

        Raises
        ------
        RefusedError
            If there is nothing to resume, or the robot is not armed, or refuses.
        """
        _, state = self._seen()
        if state.mission_completed:
            raise RefusedError("the mission is completed; `robotctl mission run` starts one")
        if state.mode is Mode.AUTO and state.waits:
            self._command(GoAhead)
        elif state.mode is Mode.AUTO and not state.mission_failed:
            raise RefusedError("the mission is under way")
        else:
            self._require_armed()
            self._drive_mission()

    def jump(self, item: int | str) -> None:
        """Continue with another item of the mission: its number, counted from 1, or its name.

        Raises
        ------
        RefusedError
            If there is none.
        """
        self._command(lambda now_ns: JumpToItem(now_ns, item))

    def abort(self) -> None:
        """Abort the mission: the robot stands, and would start the mission from the beginning.

        Raises
        ------
        RefusedError
            If there is none.
        """
        self._command(AbortMission)

    def hold(self) -> None:
        """Stop the robot in mode HOLD."""
        self._ask(lambda now_ns: SetMode(now_ns, Mode.HOLD))
        self._await(lambda: self._mode is Mode.HOLD, self._why)

    def _guide(self, target: Callable[[int], NavigationRequest]) -> Iterator[NavigationState]:
        """Drive to a target in mode GUIDED; yield the states until the drive has ended."""
        before = self._seen()[1].goals
        self._require_armed()
        self._ask(lambda now_ns: SetMode(now_ns, Mode.GUIDED))
        self._await(lambda: self._mode is Mode.GUIDED, self._why)
        self._ask(target)
        self._await(lambda: self._seen()[1].goals > before, self._why)
        while True:
            _, state = self._seen()
            yield state
            if state.goal_reached is not None:
                return
            if state.mode is not Mode.GUIDED or state.goals != before + 1:
                raise RefusedError(f"given up for something else: {self._why()}")
            self._listen()
            self._require_heard()

    def _unheard(self) -> str:
        """Return the names of the silent processes."""
        parts = {"control": self.control, "navigation": self.navigation}
        missing = [name for name, state in parts.items() if state is None]
        are = "are" if len(missing) > 1 else "is"
        names = " and ".join(missing)
        return f"the robot's {names} {are} not heard: stopped, hung or just starting"

    @property
    def silence(self) -> str:
        """The process that has been silent for longest, and how long; empty: none is silent."""
        control, navigation = self._seen()
        now_ns = self._clock.now_ns()
        silences = (
            (control.stamp_ns, silence("control", control.stamp_ns, now_ns, STATE_PERIOD_NS)),
            (navigation.stamp_ns, silence("navigation", navigation.stamp_ns, now_ns, _STEP_NS)),
        )
        return min((each for each in silences if each[1]), default=(0, ""))[1]

    def _require_heard(self) -> None:
        """Raise `RefusedError` if a process that must answer has been silent for long."""
        control, navigation = self._seen()
        oldest_ns = min(control.stamp_ns, navigation.stamp_ns)
        if self._clock.now_ns() - oldest_ns > _GONE_NS:
            raise RefusedError(f"{self.silence}; the robot stops by itself")

    def _drive_mission(self) -> None:
        """Drive the mission from its present item."""
        self._ask(lambda now_ns: SetMode(now_ns, Mode.AUTO))
        self._await(
            lambda: self._mode is Mode.AUTO and not self._seen()[1].mission_failed, self._why
        )

    def _command(self, request: Callable[[int], NavigationRequest]) -> None:
        """Send a request about the mission, and wait until it is carried out."""
        before = self._seen()[1].mission_commands
        self._ask(request)
        self._await(lambda: self._seen()[1].mission_commands > before, self._why)

    def _require_armed(self) -> None:
        control, _ = self._seen()
        if control.state not in POWERED:
            raise RefusedError(
                f"the robot is not armed ({control.state.name.lower().replace('_', ' ')}"
                f"{': ' + control.reason if control.reason else ''}); arm it first"
            )

    def _ask(self, request: Callable[[int], NavigationRequest]) -> None:
        """Send a request, with its time, as soon as navigation takes it."""
        self._await(
            lambda: self._to_navigation.send(request(self._clock.now_ns())),
            lambda: "navigation takes no requests",
        )

    @property
    def _mode(self) -> Mode | None:
        return None if self.navigation is None else self.navigation.mode

    def _why(self) -> str:
        """Return the robot's latest message text."""
        return self.navigation.message if self.navigation and self.navigation.message else "no word"

    def _seen(self) -> tuple[ControlState, NavigationState]:
        """Return the newest states."""
        if self.control is None or self.navigation is None:
            raise RefusedError("the robot has not been heard")
        return self.control, self.navigation

    def _await(self, is_so: Callable[[], bool], why_not: Callable[[], str]) -> None:
        """Listen until a condition holds.

        Raises
        ------
        RefusedError
            If it does not in time.
        """
        deadline_ns = self._clock.now_ns() + _ANSWER_NS
        while not is_so():
            if self._clock.now_ns() > deadline_ns:
                raise RefusedError(why_not())
            self._listen()

    def _listen(self) -> None:
        """Receive messages for a moment."""
        self._clock.sleep_until(self._clock.now_ns() + _POLL_NS)
        for message in self._states.receive():
            if isinstance(message, ControlState):
                self.control = message
            elif isinstance(message, NavigationState):
                self.navigation = message
