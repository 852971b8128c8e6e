"""Everything that clients may ask of the robot: judged, handed on, answered.

Pure: messages and times go in, requests to the robot's processes and answers to clients come out.
What could move the robot is refused where it comes late, where its client may only look, and where
another client drives. Stops, HOLD and disarming are always carried out for those who may drive, an
emergency stop for everybody.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final, NamedTuple

from robotctl.config_values import Value
from robotctl.messages.control import (
    Arm,
    ControlRequest,
    EmergencyStop,
    EmergencyStopSource,
    ExternalPose,
    ManualControl,
    NavigationRequest,
    PositionTarget,
    SetMode,
)
from robotctl.messages.mission import AbortMission, GoAhead, JumpToItem, MissionCommand
from robotctl.messages.mode import Mode
from robotctl.messages.recording import SetRecording
from robotctl.messages.requests import REQUEST_LIFE_NS
from robotctl.messages.tuning import ParameterRequest, ResetParameters, SetParameter
from robotctl.web.driving import AHEAD_NS, Driving
from robotctl.web.pending import ANSWER_NS, Asked, Pending
from robotctl.web.plan_uploads import Offered
from robotctl.web.published import ControlState, NavigationState, Published
from robotctl.web.robot_view import Now, RobotView
from robotctl.web.stops import Stops
from robotctl.web.wire import (
    Abort,
    ArmRequest,
    Dated,
    Downward,
    Driver,
    GiveDriving,
    GoOn,
    GoTo,
    JumpTo,
    LiveMessage,
    ModeRequest,
    Order,
    Ping,
    PlaceRobot,
    Pong,
    RecordRequest,
    Refused,
    ResetRequest,
    ResponseRequest,
    SaveRequest,
    Sticks,
    Stop,
    StopMessage,
    StopRequest,
    TakeDriving,
    Tuned,
    TuneRequest,
    WatchCamera,
)

LOOK_ONLY: Final = "this link may look only; open the page by the link with which one may drive"
MANUAL_NS: Final = 1_000_000_000
"""Time from the first stick to MANUAL [ns]."""
PLACED_COVARIANCE: Final = (0.25**2, 0.0, 0.0, 0.25**2, 0.0, 0.2**2)
"""Standard deviation of a pose that a person points at: 0.25 m, 0.2 rad."""


class Answer(NamedTuple):
    """Message for one connection."""

    connection: object
    message: Downward


@dataclass(slots=True)
class _Client:
    """One browser page."""

    connection: object
    may_drive: bool
    watches: bool = False
    """Whether it shows the camera's pictures."""


class Save(NamedTuple):
    """Values of parameters to write into the robot's file, by their keys, and who wants it."""

    connection: object
    number: int
    values: dict[str, Value]


@dataclass(slots=True)
class Outcome:
    """Messages to send since the last call."""

    to_control: list[ControlRequest] = field(default_factory=list)
    to_navigation: list[NavigationRequest] = field(default_factory=list)
    to_telemetry: list[ParameterRequest] = field(default_factory=list)
    saves: list[Save] = field(default_factory=list)
    answers: list[Answer] = field(default_factory=list)
    taken: list[Offered] = field(default_factory=list)
    """Plans that navigation has now."""
    to_recorder: list[SetRecording] = field(default_factory=list)


class Desk:
    """Judges what clients ask for.

    Parameters
    ----------
    has_localiser
        Whether the robot estimates its place.
    arm_timeout_ns
        Time that control has to arm [ns].
    """

    def __init__(self, *, has_localiser: bool, arm_timeout_ns: int) -> None:
        self._has_localiser = has_localiser
        self._arm_timeout_ns = arm_timeout_ns
        self._robot = RobotView()
        self._pending = Pending(self._robot, self._tell)
        self._clients: dict[int, _Client] = {}
        self._driving = Driving()
        self._stops = Stops()
        self._begun_ns: int | None = None
        """When MANUAL was asked for, until navigation is in it [ns]."""
        self._out = Outcome()

    @property
    def driver(self) -> Driver:
        """Present driver."""
        return self._driving.state

    @property
    def is_busy(self) -> bool:
        """Whether a client drives the robot, or a stop is not answered yet."""
        return self._driving.is_held or self._stops.is_pending

    @property
    def watchers(self) -> list[object]:
        """Connections of clients that show the camera's pictures."""
        return [each.connection for each in self._clients.values() if each.watches]

    def take(self) -> Outcome:
        """Return what is to be sent since the last call."""
        for denial in self._driving.take_denials():
            self._tell(denial.client, Refused(denial.number, denial.reason))
        out, self._out = self._out, Outcome()
        out.taken, self._pending.taken = self._pending.taken, []
        return out

    def join(self, client: int, connection: object, *, may_drive: bool) -> None:
        """Take up a client."""
        self._clients[client] = _Client(connection, may_drive)

    def name(self, client: int, name: str) -> None:
        """Give a client that may drive the name that others see."""
        self._driving.join(client, name)

    def leave(self, client: int, now: Now) -> None:
        """Forget a client, and stop the robot if that drove it."""
        self._driving.leave(client, now.server_ns)
        self._clients.pop(client, None)
        self._drive(now)

    def hear(self, message: Published, now: Now) -> None:
        """Take note of how the robot is."""
        self._robot.hear(message)
        if isinstance(message, ControlState):
            self._stops.hear(message, now.server_ns)
            self._out.answers += [Answer(*each) for each in self._stops.take_answers()]
        elif isinstance(message, NavigationState):
            self._watch_mode(message, now)
        self._pending.hear(message)
        self._drive(now)

    def step(self, now: Now) -> None:
        """Notice what does not come."""
        self._driving.step(now.server_ns)
        if self._driving.is_held and (objection := self._robot.objection_to_motion(now)):
            self._driving.interrupt(objection)
        if self._stops.step(now.server_ns):
            self._send_stop(now)
        self._out.answers += [Answer(*each) for each in self._stops.take_answers()]
        self._pending.step(now.server_ns)
        self._drive(now)

    def plan_objection(self, client: int, at_ms: float, now: Now) -> str:
        """Return why a page's plan is not handed on; empty: it is."""
        if client not in self._clients:
            return "this page is not connected"
        if not self._clients[client].may_drive:
            return LOOK_ONLY
        return _untimely(at_ms, now) or self._other_driver(client)

    def offer(self, client: int, number: int, plan: Offered, now: Now) -> None:
        """Hand on a plan that was checked; navigation's refusal is told later."""
        self._out.to_navigation.append(plan.request)
        self._pending.plan(Asked(client, number, now.server_ns + ANSWER_NS), plan)

    def stop(self, connection: object, message: StopMessage, now: Now) -> None:
        """Take a message of a connection that is for stops only."""
        if isinstance(message, Ping):
            pong = Pong(message.t, now.server_ns, now.robot_ns)
            self._out.answers.append(Answer(connection, pong))
        else:
            self._stop(connection, message, now)

    def take_message(self, client: int, message: LiveMessage, now: Now) -> None:
        """Take a message of a page."""
        me = self._clients[client]
        match message:
            case Ping():
                self._tell(client, Pong(message.t, now.server_ns, now.robot_ns))
            case StopRequest():
                self._stop(me.connection, message, now)
            case GiveDriving():
                self._driving.give(client, now.server_ns)
            case Sticks():
                objection = self._robot.objection_to_motion(now)
                self._driving.sticks(client, message, now.server_ns, objection)
            case WatchCamera():
                me.watches = message.watch
            case _:
                objection = self._objection(client, message, now)
                if objection:
                    self._tell(client, Refused(message.id, objection))
                else:
                    self._carry_out(client, message, now)
        self._drive(now)

    def _objection(self, client: int, message: Dated, now: Now) -> str:
        """Return why a request is not carried out; empty: it is."""
        if not self._clients[client].may_drive:
            return LOOK_ONLY
        if _stops(message):
            return ""
        if objection := _untimely(message.at_ms, now):
            return objection
        if isinstance(message, RecordRequest):
            return self._robot.objection_to_recording(now)
        return "" if isinstance(message, TakeDriving) else self._conflict(client, message, now)

    def _other_driver(self, client: int) -> str:
        """Return why a client has to leave the robot to another one."""
        if self._driving.driver in (None, client):
            return ""
        return f"{self.driver.name} drives: take over first"

    def _conflict(self, client: int, message: Dated, now: Now) -> str:
        """Return what of the robot, or of other clients, speaks against a request."""
        if objection := self._other_driver(client):
            return objection
        if isinstance(message, Tuned):
            return ""  # who drives may tune meanwhile: nothing jumps
        if self._driving.is_held:
            return "let the sticks go first"
        match message:
            case ArmRequest() if self._has_localiser and self._robot.localisation is None:
                return "the localiser is not ready"
            case GoTo():
                return self._robot.objection_to_motion(now)
            case PlaceRobot() if not self._has_localiser:
                return "this robot has no localiser: its place is where its odometry says"
        return ""

    def _carry_out(self, client: int, message: Dated, now: Now) -> None:
        """Hand on a request."""
        stamp_ns, out = now.robot_ns, self._out.to_navigation
        match message:
            case ArmRequest():
                asked = Asked(client, message.id, now.server_ns + self._arm_timeout_ns)
                number = self._pending.number("control", asked, stamp_ns)
                self._out.to_control.append(Arm(stamp_ns, number, message.arm))
            case ModeRequest():
                out.append(SetMode(stamp_ns, message.mode))
                self._pending.mode(_asked(client, message, now), message.mode)
            case GoTo():
                out.append(SetMode(stamp_ns, Mode.GUIDED))
                out.append(PositionTarget(stamp_ns, message.x_m, message.y_m, message.heading_rad))
                self._pending.mode(_asked(client, message, now), Mode.GUIDED)
            case PlaceRobot():
                pose = message.x_m, message.y_m, message.theta_rad
                out.append(ExternalPose(stamp_ns, *pose, PLACED_COVARIANCE))
            case RecordRequest():
                self._out.to_recorder.append(SetRecording(stamp_ns, message.on))
            case TakeDriving():
                self._driving.take(client, message.id, now.server_ns)
            case GoOn() | JumpTo() | Abort():
                out.append(_order(message, stamp_ns))
                self._pending.order(_asked(client, message, now))
            case TuneRequest() | ResetRequest() | SaveRequest() | ResponseRequest():
                self._tune(client, message, now)

    def _tune(self, client: int, message: Tuned, now: Now) -> None:
        """Hand on a request about parameters."""
        stamp_ns = now.robot_ns
        match message:
            case TuneRequest():
                number = self._pending.number("telemetry", _asked(client, message, now), stamp_ns)
                request = SetParameter(stamp_ns, number, message.name, message.value)
                self._out.to_telemetry.append(request)
            case ResetRequest():
                number = self._pending.number("telemetry", _asked(client, message, now), stamp_ns)
                self._out.to_telemetry.append(ResetParameters(stamp_ns, number))
            case SaveRequest():
                self._save(client, message)
            case ResponseRequest():
                self._tell(client, self._robot.response(message.id))

    def _save(self, client: int, message: SaveRequest) -> None:
        """Have all parameters that may be set written into the robot's file."""
        wanted = self._robot.settable()
        if wanted is None:
            self._tell(client, Refused(message.id, "telemetry has not told the parameters yet"))
            return
        connection = self._clients[client].connection
        self._out.saves.append(Save(connection, message.id, wanted))

    def _stop(self, connection: object, message: Stop | StopRequest, now: Now) -> None:
        self._send_stop(now)
        self._stops.ask(connection, message.id, now.server_ns, now.robot_ns)

    def _send_stop(self, now: Now) -> None:
        stop = EmergencyStop(now.robot_ns, EmergencyStopSource.OPERATOR)
        self._out.to_control.insert(0, stop)

    def _watch_mode(self, navigation: NavigationState, now: Now) -> None:
        """Follow which mode the robot is in."""
        if navigation.mode is Mode.MANUAL:
            self._begun_ns = None
        elif self._driving.is_held:
            if self._begun_ns is None:
                self._driving.interrupt(f"the robot is in mode {navigation.mode.name} now")
            elif now.server_ns - self._begun_ns > MANUAL_NS:
                self._driving.interrupt(self._robot.why_not(Mode.MANUAL))

    def _drive(self, now: Now) -> None:
        """Hand on sticks."""
        for drive in self._driving.take_drives():
            stamp_ns, out = now.robot_ns, self._out.to_navigation
            if drive.begins:
                out.append(SetMode(stamp_ns, Mode.MANUAL))
                self._begun_ns = now.server_ns
            axes = drive.forward, drive.turn, drive.sideways
            out.append(ManualControl(stamp_ns, stamp_ns + drive.life_ns, *axes))

    def _tell(self, client: int, message: Downward) -> None:
        if client in self._clients:
            self._out.answers.append(Answer(self._clients[client].connection, message))


def _asked(client: int, message: Dated, now: Now) -> Asked:
    """Return a request that is to be carried out within `ANSWER_NS`."""
    return Asked(client, message.id, now.server_ns + ANSWER_NS)


def _stops(message: Dated) -> bool:
    """Return whether a request lets the robot stand."""
    if isinstance(message, ArmRequest):
        return not message.arm
    if isinstance(message, Abort):
        return True
    return isinstance(message, ModeRequest) and message.mode is Mode.HOLD


def _untimely(at_ms: float, now: Now) -> str:
    """Return why a request of a time is none of the present; empty: it is."""
    age_ns = now.server_ns - round(at_ms * 1e6)
    if age_ns > REQUEST_LIFE_NS:
        return f"it came {age_ns / 1e9:.1f} s late: ask again"
    if age_ns < -AHEAD_NS:
        return f"it is dated {-age_ns / 1e9:.1f} s ahead of the robot's clock"
    return ""


def _order(message: Order, stamp_ns: int) -> MissionCommand:
    """Return what is asked of the mission."""
    match message:
        case GoOn():
            return GoAhead(stamp_ns)
        case JumpTo(item=item):
            return JumpToItem(stamp_ns, item)
        case Abort():
            return AbortMission(stamp_ns)
