"""The navigator: from mode, mission and requests to a body velocity, in pure steps."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import astuple
from typing import TYPE_CHECKING, TypeAlias

from robotctl.config_values import Value, tuned
from robotctl.control.limiter import LimitsConfig
from robotctl.errors import MissionError
from robotctl.messages.mode import Mode
from robotctl.messages.requests import (
    AbortRequest,
    ExploreRequest,
    GoAheadRequest,
    HomeRequest,
    JumpRequest,
    ModeRequest,
    PlaceRequest,
    PositionRequest,
    Request,
    ReverseRequest,
    StickRequest,
    VelocityRequest,
)
from robotctl.model.drives.drives import Drive
from robotctl.model.fence import Fence, Point
from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import GridMap
from robotctl.model.sensors.sonar import SonarMount
from robotctl.planning.behave.behaviours.behaviour import BehaviourInput, BehaviourOutput, Status
from robotctl.planning.behave.behaviours.breadcrumbs import Breadcrumbs
from robotctl.planning.behave.behaviours.goto import NO_PILOT
from robotctl.planning.behave.behaviours.goto_place import place_problems
from robotctl.planning.behave.behaviours.kind import NavigatedRobot, Pilot
from robotctl.planning.behave.behaviours.registry import behaviour_for
from robotctl.planning.behave.behaviours.rejoin import Rejoining
from robotctl.planning.behave.behaviours.relocalise import LookAround
from robotctl.planning.behave.mission.auto import Auto, needs_pilot
from robotctl.planning.behave.mission.mission_file import Mission
from robotctl.planning.behave.remote_velocity import guided_velocity, stick_velocity
from robotctl.planning.behave.stalls import SILENT, Stall, StallWatch
from robotctl.planning.config import NavigationConfig
from robotctl.planning.guard.obstacle_guard import ObstacleGuard
from robotctl.planning.map.zone import Zone
from robotctl.planning.navigation_step import (
    LoadRequest,
    NavigationInputs,
    NavigationOutputs,
    on_earth,
)
from robotctl.planning.path.global_planning.goal import Goal
from robotctl.planning.surroundings import Surroundings

if TYPE_CHECKING:
    from robotctl.planning.behave.behaviours.outlook import Outlook  # which loads numpy

_SAME_M, _SAME_RAD = 1e-3, 1e-3
"""Positions and headings of GUIDED that differ by less are one [m, rad]."""
_STREAM_NS = 1_500_000_000
"""Longest gap between two messages of a stream of positions [ns]."""

_STOPPED = "the robot was stopped"

_BY_HAND = frozenset({Mode.HOLD, Mode.MANUAL})
"""The modes without autonomous motion."""


_Commanded: TypeAlias = (
    LoadRequest | GoAheadRequest | JumpRequest | AbortRequest | ReverseRequest | HomeRequest
)
"""Requests that are refused with a reason where they cannot be carried out."""


class Navigator:
    """Decides the velocity of the body in each mode.

    - HOLD stands still. It is the mode at the start.
    - MANUAL scales the sticks to the limits, until they expire; without the obstacle guard, since
      the operator sees. The turn stick sets the turn rate of a differential drive and the
      curvature of a drive-and-steer robot.
    - GUIDED takes velocities, until they expire, and positions, both with the guard. A position
      counts only while `enabled`: arming shall not set off to one that was sent long before.
    - AUTO runs the mission from where it was left, also after an item has failed; a completed
      mission is repeated when AUTO is requested again.
    - RTL drives home by plan where the robot has a map or a lidar, otherwise, and where that
      fails, along the breadcrumbs, see `Breadcrumbs`.

    While `localised` is false, AUTO, RTL and positions of GUIDED look around, see `LookAround`: a
    way through the world needs a place in it. A velocity along a direction of the world is void.

    While `enabled` is false the output is zero. A robot that was enabled and is not any more goes
    to HOLD: it shall not drive on by itself when it is armed again. AUTO, asked for again, goes on
    where it was left. MANUAL stays: there the operator's hand is on the stick. So it is where a
    ground station is lost, and while `attended` is false: no other mode can be had then.

    While its navigator is held up, the robot stands; what follows, `StallWatch` says. One that
    counts on a camera stands while that shows nothing of the floor ahead, but by hand.

    Parameters
    ----------
    config
        Settings.
    drive
        Drive model.
    limits
        Speed limits; they scale the sticks.
    mounts
        The sonars, in the order of the ranges.
    mission
        What AUTO does; None: AUTO is refused.
    home
        Where RTL leads to, usually the start, in `world`.
    has_lidar, sees_markers
        Whether the robot has a lidar, and a camera that looks for markers.
    places
        Names of the places that its pilot can drive to.

    Raises
    ------
    MissionError
        If the robot cannot drive the mission; one line for each item.
    """

    def __init__(
        self,
        config: NavigationConfig,
        drive: Drive,
        limits: LimitsConfig,
        mounts: Sequence[SonarMount],
        mission: Mission | None,
        home: SE2,
        *,
        has_lidar: bool = False,
        sees_markers: bool = False,
        places: tuple[str, ...] = (),
    ) -> None:
        self._began_with = {"navigation": config, "limits": limits}
        self._drive = drive
        self._limits = limits
        self._guard = ObstacleGuard(
            config.guard, mounts, has_lidar=has_lidar, limits=limits if drive.holonomic else None
        )
        self._crumbs = Breadcrumbs(home, steered=drive.steered)
        self._robot = NavigatedRobot(
            config, drive, mounts, self._guard, self._crumbs, sees_markers, places
        )
        self._fence = Fence()
        self._surroundings = Surroundings(self._robot)
        self._auto = Auto(mission, self._robot)
        self._look_around = LookAround(drive, self._guard, mounts, config.look_around_speed_m_s)
        self._searching = False
        self._attended = True
        self._mode = Mode.HOLD
        self._velocity: VelocityRequest | None = None
        self._sticks: StickRequest | None = None
        self._behaviour: Rejoining | None = None
        self._ended = ""
        self._held = False
        """Whether `_ended` says why the robot itself went to HOLD."""
        self._refused = ""
        self._goal: Point | None = None
        """Goal of the last position of GUIDED."""
        self._guided: PositionRequest | ExploreRequest | PlaceRequest | None = None
        """Present or last target of GUIDED."""
        self._guided_ns = 0
        """Time of the last request for a position [ns]."""
        self._arrived: Rejoining | None = None
        """Behaviour that has ended at the last position; a stream of positions goes on with it."""
        self._guided_m_s = 0.0
        """Largest speed there [m/s]."""
        self._goals = 0
        self._commands = 0
        self._home: SE2 | None = None
        """Goal of RTL since it was moved."""
        self._goal_reached: bool | None = None
        self._enabled = False
        """As of the last step with a control state."""
        self._stopped_ns = -1
        """When a stop of the robot was last received [ns]."""
        self._stalls = StallWatch()
        self._notices: list[str] = []
        self._waits_to_see = False

    @property
    def mode(self) -> Mode:
        """The present mode."""
        return self._mode

    @property
    def mission_completed(self) -> bool:
        """AUTO would start the mission over."""
        return self._auto.is_completed

    @property
    def mission(self) -> Mission | None:
        """The mission of AUTO."""
        return self._auto.mission

    def resume(self, item: int, s_m: float, counts: Sequence[int] = ()) -> None:
        """Let AUTO resume at an item, a distance along it [m], and counts of repeats and jumps."""
        self._auto.resume(item, s_m, counts)

    @property
    def limits(self) -> LimitsConfig:
        """The speed limits in force."""
        return self._limits

    def load(self, mission: Mission) -> None:
        """Take another mission, as `Auto.load`."""
        self._auto.load(mission)

    def retune(self, values: Mapping[str, Value]) -> None:
        """Take other settings: the guard at once, the rest with the next thing that it drives.

        What plans keeps those of the start. `InvalidValue`: one is not allowed, none is taken.
        """
        tables = tuned(self._began_with, values)
        self._robot.config, self._limits = tables["navigation"], tables["limits"]
        self._guard.retune(self._robot.config.guard)
        self._look_around.speed_m_s = self._robot.config.look_around_speed_m_s

    def take_pilot(self, pilot: Pilot) -> None:
        """Let a pilot plan what is driven to a goal."""
        self._robot.pilot = pilot
        pilot.use_fence(self._fence)
        if self._auto.mission is not None:
            pilot.use_zones(self._auto.mission.zone)
            pilot.use_recovery(self._auto.mission.recovery)

    def use_fence(self, fence: Fence) -> None:
        """Plan within a fence."""
        self._fence = fence
        if self._robot.pilot is not None:
            self._robot.pilot.use_fence(fence)

    def use_drawn_zones(self, zones: Sequence[Zone]) -> None:
        """Plan round, or slowly through, the zones that people have drawn.

        Raises
        ------
        MissionError
            If the robot plans nothing.
        """
        if self._robot.pilot is None:
            raise MissionError(f"zones: {NO_PILOT}")
        self._robot.pilot.use_drawn_zones(zones)

    @property
    def own_zones(self) -> tuple[Zone, ...]:
        """Zones of the robot's file, which count if it plans."""
        return () if self._robot.pilot is None else self._robot.config.pilot.zone

    @property
    def home(self) -> SE2:
        """Pose in `world` to which RTL leads without rally points."""
        return self._crumbs.home

    def use_rally(self, places: tuple[Point, ...]) -> None:
        """Return to the nearest of these from now on, if there are some and it plans its way."""
        self._robot.rally = places

    def recall(self, grid: GridMap) -> None:
        """Take what a map that the robot has made knows."""
        if self._robot.pilot is not None:
            self._robot.pilot.recall(grid)

    def outlook(self) -> Outlook | None:
        """Return what the pilot drives by and sees; None: there is none."""
        pilot = self._robot.pilot
        return None if pilot is None else pilot.outlook()

    @property
    def drives_by_plan(self) -> bool:
        """The mission has items that a pilot drives, or zones that only a pilot knows."""
        return self._auto.needs_pilot

    def refusal(self, mode: Mode) -> str:
        """Return why `mode` cannot be had, empty if it can."""
        if not self._attended and mode not in _BY_HAND:
            return "no ground station is connected"
        if mode is Mode.AUTO and self._auto.mission is None:
            return "no mission is loaded"
        if mode is Mode.RTL and self._crumbs.has_gap and not self._robot.plans_home:
            return "the path home is not known: navigation started, or lost its place, on it"
        return ""

    def step(self, inputs: NavigationInputs, now_ns: int) -> NavigationOutputs:
        """Return the decision at `now_ns`, monotonic [ns]. Input that is no number stops."""
        self._attended = inputs.attended
        stopped = self._enabled and inputs.heard and not inputs.enabled
        if inputs.heard:
            self._enabled = inputs.enabled
        if stopped:
            self._stopped_ns = now_ns
        stall = self._held_up(inputs, now_ns)
        self._fall_back(inputs, stall, stopped=stopped)
        known = inputs.are_finite
        if known and inputs.localised:
            self._note_way(inputs.pose)
        for request in inputs.requests:
            self._take(request, inputs.enabled, now_ns)
        if not inputs.localised and self._velocity and self._velocity.needs_place:
            self._velocity = None
        if not known:
            self._pause()
            return self._outputs(BehaviourOutput(0.0, 0.0, text="no valid pose or velocity"))
        situation = self._surroundings.observe(inputs, now_ns)
        self._note_blindness(inputs.blind)
        if (why := self._stands_for(inputs, stall)) is not None:
            self._pause()
            return self._outputs(BehaviourOutput(0.0, 0.0, text=why))
        if self._searches(inputs.localised):
            return self._outputs(self._look_around.step(situation))
        return self._outputs(self._decide(situation, now_ns))

    def _held_up(self, inputs: NavigationInputs, now_ns: int) -> Stall | None:
        """Return the stall of an enabled robot's navigator; tell people of one that is over."""
        stall = self._stalls.step(now_ns, inputs.late_ns, heard=inputs.heard)
        if not self._enabled:
            return None
        if self._stalls.over and self._mode not in _BY_HAND:
            self._notices.append(self._stalls.over)
        return stall

    def _stands_for(self, inputs: NavigationInputs, stall: Stall | None) -> str | None:
        """Return why the robot must not move in this step, None if it may."""
        if stall is not None and self._mode not in _BY_HAND:
            return f"waits: {stall.words}"
        if inputs.enabled and inputs.blind and self._mode not in _BY_HAND:
            return f"waits: {inputs.blind}"
        if inputs.enabled:
            return None
        return "not armed" if inputs.heard else SILENT

    def _note_blindness(self, blind: str) -> None:
        """Report a robot in a mode of its own that stands because it sees no floor."""
        waits = bool(blind) and self._enabled and self._mode not in _BY_HAND
        if waits and not self._waits_to_see:
            self._notices.append(f"{blind}: the robot waits")
        elif self._waits_to_see and not blind:
            self._notices.append("the camera gives pictures again")
        self._waits_to_see = waits

    def take_notices(self) -> list[str]:
        """Return sentences for people since the last call."""
        notices, self._notices = self._notices, []
        return notices

    def _searches(self, localised: bool) -> bool:
        """Return whether the present behaviour needs a place in the world that is unknown."""
        searching = not localised and self._is_under_way()
        if searching and not self._searching:
            self._pause_mode()
            self._look_around.reset()
            if self._mode is Mode.AUTO:
                self._auto.relocate()
            elif self._behaviour is not None:
                self._behaviour.relocate()
        self._searching = searching
        return searching

    def _is_under_way(self) -> bool:
        """Say whether there is something to drive: what is done does not set off again."""
        if self._mode is Mode.AUTO:
            return self._auto.is_under_way
        return self._mode in {Mode.RTL, Mode.GUIDED} and self._behaviour is not None

    def _note_way(self, pose: SE2) -> None:
        """Drop a breadcrumb; RTL picks them up, unless it has left the way to search.

        Where no known way leads home from where a search has ended, RTL ends.
        """
        if self._mode is not Mode.RTL or self._searching:
            self._crumbs.record(pose)
        if self._mode is Mode.RTL and (reason := self.refusal(Mode.RTL)):
            self._change_mode(Mode.HOLD)
            self._ended, self._held = f"hold: {reason}", True

    def _fall_back(self, inputs: NavigationInputs, stall: Stall | None, *, stopped: bool) -> None:
        """Go to HOLD where the robot must not drive, or not without an operator, and say why."""
        if self._mode in _BY_HAND:
            return
        reason = ""
        if not self._attended:
            reason = "no ground station is connected"
        elif inputs.station_lost:
            reason = "the ground station is lost"
        elif stopped:
            reason = _STOPPED
        elif stall is not None and stall.ends_mode and self._enabled:
            reason = stall.words
            self._stalls.forget()
        if reason:
            self._change_mode(Mode.HOLD)
            self._ended, self._held = f"hold: {reason}", True

    def _take(self, request: Request | LoadRequest, enabled: bool, now_ns: int) -> None:
        """Take one request; of what was asked for until a stop was heard of nothing that drives."""
        match request:
            case ModeRequest(mode, stamp_ns):
                asked_ns = now_ns if stamp_ns is None else stamp_ns
                old = asked_ns <= self._stopped_ns and mode not in _BY_HAND
                self._refused = _STOPPED if old else self.refusal(mode)
                if not self._refused:
                    self._change_mode(mode)
            case VelocityRequest():
                self._velocity = request
                if self._mode is Mode.GUIDED:
                    self._behaviour = self._guided = self._arrived = None
            case PositionRequest() | ExploreRequest() | PlaceRequest():
                if enabled and self._mode is Mode.GUIDED:
                    self._guide(request, now_ns)
            case StickRequest():
                self._sticks = request
            case _:
                self._obey(request)

    def _obey(self, request: _Commanded) -> None:
        """Do what is asked, or note why it is refused."""
        try:
            self._command(request)
            self._refused = ""
        except (MissionError, ValueError) as error:
            self._refused = str(error)

    def _turn_round(self, request: ReverseRequest) -> None:
        """Drive to places in reverse from now on, or ahead again; `ValueError`: it cannot."""
        if request.reverse and self._mode not in {Mode.AUTO, Mode.GUIDED}:
            raise ValueError("driving in reverse is for AUTO and GUIDED")
        if request.reverse and (why := self._robot.against_reverse):
            raise ValueError(f"driving in reverse: {why}")
        self._use_reverse(reverse=request.reverse)

    def _move_home(self, to: HomeRequest) -> None:
        """Have RTL lead elsewhere; `ValueError`: it cannot now, or is no place."""
        if self._mode is Mode.RTL:
            raise ValueError("home is not moved while the robot drives there")
        if not (on_earth(to.x_m, to.y_m) and math.isfinite(to.theta_rad)):
            raise ValueError(f"home: x {to.x_m:g}, y {to.y_m:g} is no place")
        self.begin_at(SE2(*to))

    def begin_at(self, home: SE2) -> None:
        """Have RTL lead to a pose in `world`; the way there is known from it on."""
        self._crumbs.begin(home)
        self._home = home

    def _use_reverse(self, *, reverse: bool) -> None:
        self._robot.reverse = reverse
        if self._robot.pilot is not None:
            self._robot.pilot.use_reverse(reverse=reverse)

    def _guide(self, request: PositionRequest | ExploreRequest | PlaceRequest, now_ns: int) -> None:
        """Drive to a goal in GUIDED.

        Off-board programs send the same goal many times a second, or one that moves: the robot is
        on its way then and stays so. What it has given up it tries again once the stream has ended.
        """
        if isinstance(request, PlaceRequest):
            self._refused = "; ".join(place_problems(request, self._robot.places))
            if self._refused:
                return
        self._goals += 1
        self._velocity = None
        if isinstance(request, PositionRequest):
            if not on_earth(request.x_m, request.y_m):
                return
            streams = now_ns - self._guided_ns <= _STREAM_NS
            self._guided_ns = now_ns
            if self._repeats(request, streams=streams):
                return
            if self._behaviour is None and streams:
                self._behaviour = self._arrived
        self._goal_reached, self._ended = None, ""
        self._goal = (request.x_m, request.y_m) if isinstance(request, PositionRequest) else None
        self._guided_m_s = self._robot.config.guided_speed_m_s
        before, self._guided = self._guided, request
        if (
            self._behaviour is not None
            and isinstance(request, PositionRequest)
            and isinstance(before, PositionRequest)
        ):
            self._behaviour.redirect(Goal(*request), self._guided_m_s)
        else:
            self._behaviour = behaviour_for(request, self._robot)

    def _repeats(self, request: PositionRequest, *, streams: bool) -> bool:
        """Return whether a position only says again where the robot drives, or cannot get to."""
        if not isinstance(self._guided, PositionRequest) or not _are_same(request, self._guided):
            return False
        if self._behaviour is not None:
            return self._guided_m_s == self._robot.config.guided_speed_m_s
        return streams and self._goal_reached is False

    def _command(self, request: _Commanded) -> None:
        """Do what is asked of the mission; `MissionError`, `ValueError`: it cannot be done."""
        if isinstance(request, ReverseRequest):
            self._turn_round(request)
            return
        if isinstance(request, HomeRequest):
            self._move_home(request)
            return
        drives = self._mode is Mode.AUTO
        if isinstance(request, LoadRequest):
            if drives and self._auto.is_under_way:
                raise MissionError("a mission is under way; pause or abort it first")
            wanted = request.mission
            if wanted is not None and needs_pilot(wanted) and self._robot.pilot is None:
                raise MissionError(f"{wanted.name}: {NO_PILOT}")
            self._auto.load(wanted)
        elif isinstance(request, GoAheadRequest) and not drives:
            raise MissionError("the mission is not under way")
        else:
            self._auto.command(request)
        if drives and isinstance(request, LoadRequest | AbortRequest):
            self._change_mode(Mode.HOLD)
        self._commands += 1

    def _change_mode(self, mode: Mode) -> None:
        """Leave the present mode and start another; the same one starts over."""
        self._pause()
        self._mode = mode
        self._behaviour, self._velocity, self._sticks, self._ended = None, None, None, ""
        self._guided = self._arrived = None
        self._held = False
        self._use_reverse(reverse=False)
        if mode is Mode.AUTO:
            self._auto.begin()
        if mode is Mode.RTL:
            self._behaviour = behaviour_for(mode, self._robot)

    def _pause(self) -> None:
        """Stop the present behaviour, and its time."""
        self._look_around.pause()
        self._pause_mode()

    def _pause_mode(self) -> None:
        """Tell the present behaviour that another mode steers for a while."""
        if self._mode is Mode.AUTO:
            self._auto.pause()
        if self._behaviour is not None:
            self._behaviour.pause()

    def _decide(self, situation: BehaviourInput, now_ns: int) -> BehaviourOutput:
        """Return the step of the present mode."""
        if self._mode is Mode.MANUAL:
            return stick_velocity(self._sticks, self._limits, self._drive, now_ns)
        if self._mode is Mode.AUTO:
            return self._auto.step(situation, now_ns)
        if self._behaviour is not None:
            step = self._behaviour.step(situation, now_ns)
            if step.status is Status.RUNNING:
                return step
            self._arrived, self._behaviour = self._behaviour, None
            self._ended = step.text or "arrived"
            if self._mode is Mode.GUIDED:
                self._goal_reached = step.status is Status.DONE
        if self._mode is Mode.GUIDED and self._velocity is not None:
            heading_rad = situation.pose.theta_rad
            return guided_velocity(self._velocity, heading_rad, self._drive, self._guard, now_ns)
        return BehaviourOutput(0.0, 0.0, text=self._ended)

    def _expires_ns(self) -> int | None:
        """Return when the sticks or the velocity of GUIDED are void [ns], None if none steer."""
        remote = {Mode.MANUAL: self._sticks, Mode.GUIDED: self._velocity}.get(self._mode)
        return remote and remote.expires_ns

    def _present_goal(self) -> Point | None:
        """Return where in `world` the robot drives now [m]; None: to no place that has a name."""
        if self._mode is Mode.AUTO:
            return self._auto.goal
        if self._behaviour is None:
            return None
        if self._mode is Mode.GUIDED:
            return self._goal
        home = self._crumbs.home
        return None if self._robot.rally else (home.x_m, home.y_m)

    def _outputs(self, step: BehaviourOutput) -> NavigationOutputs:
        """Return a step as outputs."""
        pilot = self._robot.pilot
        return NavigationOutputs(
            step.v_m_s,
            step.omega_rad_s,
            step.vy_m_s,
            self._expires_ns(),
            self._mode,
            f"refused: {self._refused}" if self._refused else step.text,
            self._held and not self._refused and step.text == self._ended,
            pilot.plans if pilot else 0,
            pilot.recoveries if pilot else 0,
            self._goals,
            self._goal_reached,
            self._present_goal(),
            self._robot.reverse,
            astuple(self._home) if self._home else None,
            self._auto.runs,
            self._commands,
            **self._auto.progress._asdict(),
        )


def _are_same(one: PositionRequest, other: PositionRequest) -> bool:
    """Return whether two positions differ only by rounding."""
    if math.dist(one[:2], other[:2]) > _SAME_M:
        return False
    if one.heading_rad is None or other.heading_rad is None:
        return one.heading_rad is other.heading_rad
    return abs(wrap_angle(one.heading_rad - other.heading_rad)) <= _SAME_RAD
