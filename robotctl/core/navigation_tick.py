"""One step of navigation: for the navigation process and for lockstep."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final, Protocol

import msgspec

from robotctl.config_values import Value
from robotctl.core.navigation_adapter import NavigationAdapter
from robotctl.core.operator import Operator
from robotctl.errors import InvalidValue
from robotctl.messages.control import (
    ControlState,
    ExternalPose,
    NavigationRequest,
    NavigationState,
    Notice,
    Severity,
    StepBudget,
    VelocityCommand,
)
from robotctl.messages.estimation import (
    GivenMap,
    LiveMap,
    LocalisationState,
    ParticleCloud,
    SensorMessage,
    SlamGraph,
)
from robotctl.messages.tuning import Tuning
from robotctl.model.grid_map import GridMap

_UNMEASURED: Final = StepBudget()


class Estimation(Protocol):
    """Localiser and mapper of one robot, either of which may be missing."""

    def step(
        self,
        control: ControlState,
        scans: Sequence[SensorMessage],
        poses: Sequence[ExternalPose],
        now_ns: int,
    ) -> LocalisationState | None:
        """Take all inputs since the last step; return the localiser's estimate."""

    def pictures(self, now_ns: int) -> Sequence[ParticleCloud | LiveMap | SlamGraph]:
        """Return the estimators' data for display, if it is time."""

    def given_map(self, now_ns: int) -> Sequence[GivenMap]:
        """Return the localiser's map, if it is time to publish it again."""

    def settled_map(self) -> GridMap | None:
        """Return the map that is made to find the robot in, if it is drawn as it is known now."""

    def take_notices(self) -> Sequence[str]:
        """Return sentences on changes since the last call."""

    def retune(self, values: Mapping[str, Value]) -> None:
        """Take other settings; raises `InvalidValue` if one is not allowed, none is taken then."""


class NavigationTick:
    """States, scans and requests in; a velocity and messages for others out.

    It reads no clock and knows no sockets: the same inputs at the same times give the same outputs.

    Parameters
    ----------
    adapter
        The navigator with its message adapter.
    estimators
        The localiser; None: its odometry alone.
    operator
        Source of requests and receiver of notices.

    Attributes
    ----------
    state, localisation
        What the last step publishes of itself, and where it believed to be; None before the first,
        or without a localiser.
    """

    def __init__(
        self,
        adapter: NavigationAdapter,
        estimators: Estimation | None,
        operator: Operator[NavigationRequest],
    ) -> None:
        self.period_ns = adapter.period_ns
        self.state: NavigationState | None = None
        self.localisation: LocalisationState | None = None
        self._adapter = adapter
        self._estimators = estimators
        self._operator = operator
        self._control: ControlState | None = None
        self._seen: tuple[SensorMessage, ...] = ()
        self._requests: tuple[NavigationRequest, ...] = ()
        self._late_ns = 0
        self._recalled_ns = 0
        """Epoch of `world` in which the navigator was told what the map knows."""
        self._tuning = 0
        """Number of the tuning in force."""

    def receive(
        self, control: ControlState | None, seen: Sequence[SensorMessage], late_ns: int = 0
    ) -> None:
        """Take in the newest state of control, what was seen since the last step, and requests.

        `late_ns` is how long this process was kept from the step, by its own measure [ns].
        """
        self._control, self._late_ns = control, late_ns
        self._seen = self._adapter.outside_body(seen)
        self._requests = tuple(self._operator.ask())

    def localise(self, now_ns: int) -> None:
        """Find out where the robot is."""
        if self._estimators is None or self._control is None:
            return
        poses = [each for each in self._requests if isinstance(each, ExternalPose)]
        self.localisation = self._estimators.step(self._control, self._seen, poses, now_ns)

    def navigate(self, now_ns: int) -> tuple[VelocityCommand, NavigationState]:
        """Return the velocity decided, and the navigator's state."""
        for each in self._requests:
            if isinstance(each, Tuning):
                self._retune(each)
        command, state = self._adapter.step(
            self._control,
            self.localisation,
            self._requests,
            now_ns,
            self._seen,
            self._late_ns,
        )
        self._recall()
        self.state = msgspec.structs.replace(state, tuning=self._tuning)
        return command, self.state

    def _recall(self) -> None:
        """Tell the navigator, which forgot what it saw when the pose jumped, what the map knows."""
        found = self.localisation
        if self._estimators is None or found is None or found.epoch_ns == self._recalled_ns:
            return
        grid = self._estimators.settled_map()
        if grid is not None:
            self._adapter.navigator.recall(grid)
            self._recalled_ns = found.epoch_ns

    def _retune(self, tuning: Tuning) -> None:
        """Take other settings."""
        try:
            navigator = self._adapter.navigator
            navigator.retune(tuning.values)
            self._adapter.fence.retune(navigator.limits, navigator.body)
            if self._estimators is not None:
                self._estimators.retune(tuning.values)
            self._tuning = tuning.number
        except InvalidValue as error:
            text = f"tuning refused: {error}"
            self._operator.tell(Notice(tuning.stamp_ns, Severity.WARNING, text))

    def say(self, now_ns: int, text: str) -> None:
        """Tell people something."""
        self._operator.tell(Notice(now_ns, Severity.NOTICE, text))

    def publish(
        self,
        now_ns: int,
        localise_us: float = 0.0,
        step_us: float = 0.0,
        budget: StepBudget = _UNMEASURED,
        *,
        is_watched: bool = True,
    ) -> None:
        """Tell what was found and decided, with how long that took where it was measured.

        What the robot drives by is told for people to see: only where somebody may.
        """
        tell, estimators = self._operator.tell, self._estimators
        if estimators is not None and self._control is not None:
            if self.localisation is not None:
                tell(msgspec.structs.replace(self.localisation, step_us=localise_us))
            for picture in (*estimators.pictures(now_ns), *estimators.given_map(now_ns)):
                tell(picture)
            for text in estimators.take_notices():
                self.say(now_ns, text)
        for view in self._adapter.views(now_ns) if is_watched else ():
            tell(view)
        for text in self._adapter.take_notices():
            tell(Notice(now_ns, Severity.WARNING, text))
        if self.state is not None:
            tell(msgspec.structs.replace(self.state, step_us=step_us, budget=budget))
