"""The navigator: from mode, mission and requests to a body velocity, in pure steps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Final

from robotctl.config_values import Value, tuned
from robotctl.control.limiter import LimitsConfig
from robotctl.messages.control import NavigationState
from robotctl.messages.mode import Mode
from robotctl.model.body import BodyConfig
from robotctl.model.drives.drives import Drive
from robotctl.model.footprint import Footprint
from robotctl.model.geometry.se2 import SE2
from robotctl.model.geometry.twist import Twist
from robotctl.model.grid_map import GridMap
from robotctl.model.sensors.sonar import SonarMount
from robotctl.planning.behave.behaviours.behaviour import BehaviourOutput
from robotctl.planning.behave.behaviours.breadcrumbs import Breadcrumbs
from robotctl.planning.behave.behaviours.guarded import limited
from robotctl.planning.behave.behaviours.kind import UNHURRIED, NavigatedRobot, Pace, Pilot
from robotctl.planning.behave.mission.mission_file import Mission
from robotctl.planning.behave.modes.auto import Auto
from robotctl.planning.behave.modes.modes import Modes
from robotctl.planning.bounds import Bounds
from robotctl.planning.commander import Commander
from robotctl.planning.config import NavigationConfig
from robotctl.planning.guard.obstacle_guard import ObstacleGuard
from robotctl.planning.navigation_step import NavigationInputs, NavigationOutputs
from robotctl.planning.perception import Perception
from robotctl.planning.supervision import DriveSupervision

if TYPE_CHECKING:
    from robotctl.model.footprint_arrays import Sides  # which loads numpy, as does the other
    from robotctl.planning.behave.behaviours.outlook import Outlook


_REST: Final = Twist(0.0, 0.0)


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
    lidars
        Number of its lidars.
    sees_markers
        Whether it has a camera that looks for markers.
    places
        Names of the places that its pilot can drive to.
    body
        What moves with the robot, in its states.
    pace
        Told of the parts of its steps, and asked how much it may do in them.

    Attributes
    ----------
    auto
        Mode AUTO, with the mission.
    bounds
        Fence, zones and rally points.

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
        lidars: int = 0,
        sees_markers: bool = False,
        places: tuple[str, ...] = (),
        body: BodyConfig = BodyConfig(),  # noqa: B008
        pace: Pace = UNHURRIED,
    ) -> None:
        self._began_with = {"navigation": config, "limits": limits, "body": body}
        guard = ObstacleGuard(
            config.guard,
            mounts,
            has_lidar=lidars > 0,
            limits=limits if drive.holonomic else None,
            outline=body.footprint,
        )
        crumbs = Breadcrumbs(home, steered=drive.steered)
        self._robot = NavigatedRobot(config, drive, mounts, guard, crumbs, sees_markers, places)
        self._body_state = body.state
        self._perception = Perception(self._robot, lidars)
        self._supervision = DriveSupervision()
        self._modes = Modes(mission, self._robot, limits)
        self._commander = Commander(self._robot, self._modes, self._supervision)
        self.bounds = Bounds(self._robot)
        self._pace = pace
        self._wanted = _REST
        """Velocity that the present mode wants."""
        self._limited_by = ""
        """Obstacle for which the guard has slowed that; empty: it has not."""

    @property
    def auto(self) -> Auto:
        """Mode AUTO, with the mission."""
        return self._modes.auto

    @property
    def reach_over_m(self) -> tuple[float, float]:
        """How far the body reaches over the floor, ahead and behind, and to each side [m]."""
        return self._robot.guard.reach_over_m

    @property
    def body(self) -> Footprint:
        """The body in its present state."""
        return self._robot.guard.body

    @property
    def changing_sides(self) -> Sides | None:
        """The sides of a body that has several states; None: it has one."""
        return None if self._body_state is None else self._robot.guard.body_sides

    @property
    def limits(self) -> LimitsConfig:
        """The speed limits in force."""
        return self._modes.manual.limits

    @property
    def home(self) -> SE2:
        """Pose in `world` to which RTL leads without rally points."""
        return self._robot.crumbs.home

    def begin_at(self, home: SE2) -> None:
        """Have RTL lead to a pose in `world`; the way there is known from it on."""
        self._commander.begin_at(home)

    def retune(self, values: Mapping[str, Value]) -> None:
        """Take other settings: the guard at once, the rest with the next thing that it drives.

        What plans keeps those of the start, but for another state of the body, which counts at
        once. `InvalidValue`: one is not allowed, none is taken.
        """
        tables = tuned(self._began_with, values)
        self._robot.config, self._modes.manual.limits = tables["navigation"], tables["limits"]
        self._robot.guard.retune(self._robot.config.guard)
        self._modes.look_around.speed_m_s = self._robot.config.look_around_speed_m_s
        self._use_body(tables["body"])

    def _use_body(self, body: BodyConfig) -> None:
        """Take another state of the body, and plan again."""
        if body.state == self._body_state or (footprint := body.footprint) is None:
            return
        self._body_state = body.state
        self._robot.guard.use_body(footprint)
        self._perception.use_body(footprint)
        if self._robot.pilot is not None:
            self._robot.pilot.use_body(footprint)
        self._modes.pause()

    def take_pilot(self, pilot: Pilot) -> None:
        """Let a pilot plan what is driven to a goal."""
        self._robot.pilot = pilot
        self.bounds.brief_pilot()
        self.auto.brief_pilot()

    def recall(self, grid: GridMap) -> None:
        """Take what a map that the robot has made knows."""
        if self._robot.pilot is not None:
            self._robot.pilot.recall(grid)

    def outlook(self) -> Outlook | None:
        """Return what the pilot drives by and sees; None: there is none."""
        pilot = self._robot.pilot
        return None if pilot is None else pilot.outlook()

    def refusal(self, mode: Mode) -> str:
        """Return why `mode` cannot be had, empty if it can."""
        return self._commander.refusal(mode)

    def take_notices(self) -> list[str]:
        """Return sentences for people since the last call."""
        return self._supervision.take_notices()

    def step(self, inputs: NavigationInputs, now_ns: int) -> NavigationOutputs:
        """Return the decision at `now_ns`, monotonic [ns]. Input that is no number stops."""
        if reason := self._supervision.update(inputs, self._modes.mode, now_ns):
            self._modes.fall_back(reason)
        self._leave_crumb(inputs)
        for request in inputs.requests:
            self._commander.take(request, now_ns, enabled=inputs.enabled)
        if not inputs.localised:
            self._modes.guided.lose_place()
        return self._outputs(self._drive(inputs, now_ns), now_ns)

    def _leave_crumb(self, inputs: NavigationInputs) -> None:
        """Drop a breadcrumb; RTL picks them up, unless it has left the way to search.

        Where no known way leads home from where a search has ended, RTL ends.
        """
        if not (inputs.are_finite and inputs.localised):
            return
        returns = self._modes.mode is Mode.RTL
        if not returns or self._modes.is_searching:
            self._robot.crumbs.record(inputs.pose)
        if returns and (reason := self._modes.refusal(Mode.RTL)):
            self._modes.fall_back(reason)

    def _drive(self, inputs: NavigationInputs, now_ns: int) -> BehaviourOutput:
        """Return the velocity of the present mode, rest where the robot must not move."""
        self._wanted, self._limited_by = _REST, ""
        if not inputs.are_finite:
            return self._stand("no valid pose or velocity")
        situation = self._perception.observe(inputs, now_ns)
        if inputs.localised and self._robot.pilot is not None:
            self._supervision.note_areas(self._robot.pilot.areas)
        self._pace.lap("see")
        if reason := self._supervision.reason_to_stand(inputs, self._modes.mode):
            return self._stand(reason)
        step = self._modes.step(situation, now_ns, localised=inputs.localised)
        self._wanted = step.twist
        return step if self._modes.mode is Mode.MANUAL else self._within_guard(step)

    def _within_guard(self, step: BehaviourOutput) -> BehaviourOutput:
        """Return what the guard leaves of a velocity, whatever wants it: nothing comes after it."""
        if step.twist == _REST:
            return step
        slowed, verdict = limited(step, self._robot.guard)
        if slowed.twist != step.twist:
            self._limited_by = verdict.obstacle
        return slowed

    def _stand(self, reason: str) -> BehaviourOutput:
        """Return rest, and stop the time of what the present mode does."""
        self._modes.pause()
        return BehaviourOutput(0.0, 0.0, text=reason)

    def _outputs(self, step: BehaviourOutput, now_ns: int) -> NavigationOutputs:
        """Return a step as outputs."""
        pilot, modes, commander = self._robot.pilot, self._modes, self._commander
        refused, guided, home = commander.refused, modes.guided, commander.home
        state = NavigationState(
            stamp_ns=now_ns,
            mode=modes.mode,
            message=f"refused: {refused}" if refused else _message(step),
            held=not refused and bool(step.text) and step.text == modes.held_because,
            plans=pilot.plans if pilot else 0,
            recoveries=pilot.recoveries if pilot else 0,
            goals=guided.goals,
            goal_reached=guided.goal_reached,
            goal=modes.present.goal,
            reverse=self._robot.reverse,
            home=(home.x_m, home.y_m, home.theta_rad) if home else None,
            mission_runs=modes.auto.runs,
            mission_commands=commander.commands,
            wanted=(*self._wanted,),
            limited_by=self._limited_by,
            body=self._body_state or 0,
            areas=self._supervision.areas,
            **modes.auto.progress._asdict(),
        )
        return NavigationOutputs(
            step.v_m_s, step.omega_rad_s, step.vy_m_s, modes.present.expires_ns, state
        )


def _message(step: BehaviourOutput) -> str:
    """Return what a step says, for people."""
    return f"{step.task}: {step.text}" if step.task else step.text
