"""Everything that clients may ask of the robot: judged, handed on, answered.

Pure: messages and times go in, requests to the robot's processes and answers to clients come out.
What could move the robot is refused where it comes late, where its client may only look, and where
another client drives. Stops, HOLD and disarming are always carried out for those who may drive, an
emergency stop for everybody.
"""

from __future__ import annotations

from collections import deque
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
from robotctl.safety.state_machine import POWERED
from robotctl.web.driving import AHEAD_NS, Driving
from robotctl.web.plan_uploads import Offered
from robotctl.web.published import (
    BoundsView,
    ControlState,
    LocalisationState,
    NavigationState,
    ParameterAnswer,
    ParameterTable,
    ParameterValues,
    Published,
    RecorderState,
)
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
    Response,
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
ANSWER_NS: Final = 1_500_000_000
"""Time that navigation has to be in a mode that was asked for [ns]."""
MANUAL_NS: Final = 1_000_000_000
"""Time from the first stick to MANUAL [ns]."""
RESPONSE_STATES: Final = 250
"""Most states of control that a response is made of: those of five seconds."""
SILENT_NS: Final = 500_000_000
"""Age of a state of the robot that says nothing of the present [ns]."""
RECORDER_SILENT_NS: Final = 5_000_000_000
"""The same of the recorder, which waits for the disk [ns]."""
PLACED_COVARIANCE: Final = (0.25**2, 0.0, 0.0, 0.25**2, 0.0, 0.2**2)
"""Standard deviation of a pose that a person points at: 0.25 m, 0.2 rad."""


class Now(NamedTuple):
    """The present by the server's monotonic clock, and by the robot's, which may pause [ns]."""

    server_ns: int
    robot_ns: int


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


@dataclass(frozen=True, slots=True)
class _Asked:
    """Request that waits for its answer."""

    client: int
    number: int
    deadline_ns: int


@dataclass(slots=True)
class _Robot:
    """Newest states of the robot."""

    control: ControlState | None = None
    navigation: NavigationState | None = None
    localisation: LocalisationState | None = None
    parameters: ParameterTable | None = None
    values: ParameterValues | None = None
    recorder: RecorderState | None = None
    recent: deque[ControlState] = field(default_factory=lambda: deque(maxlen=RESPONSE_STATES))
    """Last states of control."""

    def response(self, number: int) -> Response:
        """Return what the wheels did lately."""
        states = tuple(self.recent)
        return Response(
            number,
            tuple(each.stamp_ns for each in states),
            tuple(each.wheel_ref_rad_s for each in states),
            tuple(each.wheel_rad_s for each in states),
        )


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
        self._robot = _Robot()
        self._clients: dict[int, _Client] = {}
        self._driving = Driving()
        self._stops = Stops()
        self._arming: dict[int, _Asked] = {}
        self._modes: dict[int, tuple[_Asked, Mode]] = {}
        self._orders: dict[int, tuple[_Asked, int]] = {}
        """Orders to the mission by client, with the count of those done before."""
        self._plans: dict[str, tuple[_Asked, Offered]] = {}
        """Plans that navigation has still to take, by their kind."""
        self._tuning: dict[int, _Asked] = {}
        """Requests that telemetry has not answered, by their numbers."""
        self._last_request = 0
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
        if isinstance(message, ControlState):
            self._robot.control = message
            self._robot.recent.append(message)
            self._stops.hear(message, now.server_ns)
            self._answer_stops()
            self._answer_arming(message)
        elif isinstance(message, NavigationState):
            self._robot.navigation = message
            self._watch_mode(message, now)
            self._orders = {
                client: each
                for client, each in self._orders.items()
                if each[1] == message.mission_commands
            }
            self._note_plan("mission", message.mission_crc)
            self._note_plan("fence", message.fence.crc)
        elif isinstance(message, BoundsView):
            self._note_plan("zones", message.zones_crc)
        elif isinstance(message, LocalisationState):
            self._robot.localisation = message
        elif isinstance(message, ParameterTable):
            self._robot.parameters = message
        elif isinstance(message, ParameterValues):
            self._robot.values = message
        elif isinstance(message, ParameterAnswer):
            asked = self._tuning.pop(message.request_id, None)
            if asked is not None and message.refusal:
                self._tell(asked.client, Refused(asked.number, message.refusal))
        elif isinstance(message, RecorderState):
            self._robot.recorder = message
        self._drive(now)

    def step(self, now: Now) -> None:
        """Notice what does not come."""
        self._driving.step(now.server_ns)
        if self._driving.is_held and (objection := self._objection_to_motion(now)):
            self._driving.interrupt(objection)
        if self._stops.step(now.server_ns):
            self._send_stop(now)
        self._answer_stops()
        for process, waiting in (("control", self._arming), ("telemetry", self._tuning)):
            for number, asked in list(waiting.items()):
                if now.server_ns > asked.deadline_ns:
                    del waiting[number]
                    self._tell(asked.client, Refused(asked.number, f"{process} does not answer"))
        for client, (asked, mode) in list(self._modes.items()):
            if now.server_ns > asked.deadline_ns:
                del self._modes[client]
                self._tell(client, Refused(asked.number, self._why_not(mode)))
        self._tell_refusals(now)
        self._drive(now)

    def plan_objection(self, client: int, at_ms: float, now: Now) -> str:
        """Return why a page's plan is not handed on; empty: it is."""
        if client not in self._clients:
            return "this page is not connected"
        objection = self._objection_to_asker(client) or _untimely(at_ms, now)
        return objection or self._other_driver(client)

    def offer(self, client: int, number: int, plan: Offered, now: Now) -> None:
        """Hand on a plan that was checked; navigation's refusal is told later."""
        self._out.to_navigation.append(plan.request)
        if (waiting := self._plans.get(plan.kind)) is not None:
            self._tell(waiting[0].client, Refused(waiting[0].number, "another one came behind it"))
        asked = _Asked(client, number, now.server_ns + ANSWER_NS)
        self._plans[plan.kind] = (asked, plan)

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
                self._driving.sticks(client, message, now.server_ns, self._objection_to_motion(now))
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
        if objection := self._objection_to_asker(client):
            return objection
        if _stops(message):
            return ""
        if objection := _untimely(message.at_ms, now):
            return objection
        if isinstance(message, RecordRequest):
            return self._objection_to_recording(now)
        return "" if isinstance(message, TakeDriving) else self._conflict(client, message, now)

    def _objection_to_asker(self, client: int) -> str:
        """Return why a client may ask for nothing."""
        if self._clients[client].may_drive:
            return ""
        return LOOK_ONLY

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
                return self._objection_to_motion(now)
            case PlaceRobot() if not self._has_localiser:
                return "this robot has no localiser: its place is where its odometry says"
        return ""

    def _objection_to_recording(self, now: Now) -> str:
        """Return why the robot cannot record; empty: it can."""
        recorder = self._robot.recorder
        if recorder is None or now.robot_ns - recorder.stamp_ns > RECORDER_SILENT_NS:
            return "the recorder is silent"
        if not recorder.folder:
            return "this robot has no folder for recordings: start it with --record FOLDER"
        return ""

    def _objection_to_motion(self, now: Now) -> str:
        """Return why the robot cannot move now; empty: it can."""
        control = self._robot.control
        if control is None or now.robot_ns - control.stamp_ns > SILENT_NS:
            return "control is silent"
        if control.state not in POWERED:
            return f"{control.reason}: arm first" if control.reason else "arm first"
        return ""

    def _carry_out(self, client: int, message: Dated, now: Now) -> None:
        """Hand on a request."""
        stamp_ns, out = now.robot_ns, self._out.to_navigation
        match message:
            case ArmRequest():
                self._last_request = max(self._last_request + 1, stamp_ns)
                self._out.to_control.append(Arm(stamp_ns, self._last_request, message.arm))
                deadline_ns = now.server_ns + self._arm_timeout_ns
                self._arming[self._last_request] = _Asked(client, message.id, deadline_ns)
            case ModeRequest():
                out.append(SetMode(stamp_ns, message.mode))
                asked = _Asked(client, message.id, now.server_ns + ANSWER_NS)
                self._modes = {client: (asked, message.mode)}
            case GoTo():
                out.append(SetMode(stamp_ns, Mode.GUIDED))
                out.append(PositionTarget(stamp_ns, message.x_m, message.y_m, message.heading_rad))
                asked = _Asked(client, message.id, now.server_ns + ANSWER_NS)
                self._modes = {client: (asked, Mode.GUIDED)}
            case PlaceRobot():
                pose = message.x_m, message.y_m, message.theta_rad
                out.append(ExternalPose(stamp_ns, *pose, PLACED_COVARIANCE))
            case RecordRequest():
                self._out.to_recorder.append(SetRecording(stamp_ns, message.on))
            case TakeDriving():
                self._driving.take(client, message.id, now.server_ns)
            case GoOn() | JumpTo() | Abort():
                out.append(_order(message, stamp_ns))
                navigation = self._robot.navigation
                done = 0 if navigation is None else navigation.mission_commands
                asked = _Asked(client, message.id, now.server_ns + ANSWER_NS)
                self._orders[client] = (asked, done)
            case TuneRequest() | ResetRequest() | SaveRequest() | ResponseRequest():
                self._tune(client, message, now)

    def _tune(self, client: int, message: Tuned, now: Now) -> None:
        """Hand on a request about parameters."""
        stamp_ns = now.robot_ns
        match message:
            case TuneRequest():
                number = self._await_telemetry(client, message, now)
                request = SetParameter(stamp_ns, number, message.name, message.value)
                self._out.to_telemetry.append(request)
            case ResetRequest():
                number = self._await_telemetry(client, message, now)
                self._out.to_telemetry.append(ResetParameters(stamp_ns, number))
            case SaveRequest():
                self._save(client, message)
            case ResponseRequest():
                self._tell(client, self._robot.response(message.id))

    def _await_telemetry(self, client: int, message: Dated, now: Now) -> int:
        """Return the number of a request to telemetry, whose answer is for a client."""
        self._last_request = max(self._last_request + 1, now.robot_ns)
        asked = _Asked(client, message.id, now.server_ns + ANSWER_NS)
        self._tuning[self._last_request] = asked
        return self._last_request

    def _save(self, client: int, message: SaveRequest) -> None:
        """Have all parameters that may be set written into the robot's file."""
        table, values = self._robot.parameters, self._robot.values
        if table is None or values is None:
            self._tell(client, Refused(message.id, "telemetry has not told the parameters yet"))
            return
        pairs = zip(table.parameters, values.wanted, strict=True)
        wanted = {facts.key: value for facts, value in pairs if not facts.is_fixed}
        connection = self._clients[client].connection
        self._out.saves.append(Save(connection, message.id, wanted))

    def _stop(self, connection: object, message: Stop | StopRequest, now: Now) -> None:
        self._send_stop(now)
        self._stops.ask(connection, message.id, now.server_ns, now.robot_ns)

    def _send_stop(self, now: Now) -> None:
        stop = EmergencyStop(now.robot_ns, EmergencyStopSource.OPERATOR)
        self._out.to_control.insert(0, stop)

    def _note_plan(self, kind: str, crc: int) -> None:
        """Note which plan of a kind navigation has."""
        waiting = self._plans.get(kind)
        if waiting is not None and waiting[1].crc == crc:
            del self._plans[kind]
            self._out.taken.append(waiting[1])

    def _tell_refusals(self, now: Now) -> None:
        """Tell clients which of their plans and orders navigation has not taken."""
        navigation = self._robot.navigation
        why = navigation.message if navigation is not None else "navigation does not answer"
        for client, (asked, _) in list(self._orders.items()):
            if now.server_ns > asked.deadline_ns:
                del self._orders[client]
                self._tell(client, Refused(asked.number, why or "navigation did nothing"))
        for kind, (asked, _) in list(self._plans.items()):
            if now.server_ns > asked.deadline_ns:
                del self._plans[kind]
                reason = f"the robot has not taken it: {why or 'see the notices'}"
                self._tell(asked.client, Refused(asked.number, reason))

    def _answer_stops(self) -> None:
        self._out.answers += [Answer(*each) for each in self._stops.take_answers()]

    def _answer_arming(self, control: ControlState) -> None:
        """Tell clients why control did not arm."""
        for ack in control.acks:
            asked = self._arming.pop(ack.request_id, None)
            if asked is not None and not ack.accepted:
                reasons = "; ".join(str(each) for each in ack.reasons) or "refused"
                self._tell(asked.client, Refused(asked.number, reasons))

    def _watch_mode(self, navigation: NavigationState, now: Now) -> None:
        """Follow which mode the robot is in."""
        self._modes = {
            client: each for client, each in self._modes.items() if each[1] != navigation.mode
        }
        if navigation.mode is Mode.MANUAL:
            self._begun_ns = None
        elif self._driving.is_held:
            if self._begun_ns is None:
                self._driving.interrupt(f"the robot is in mode {navigation.mode.name} now")
            elif now.server_ns - self._begun_ns > MANUAL_NS:
                self._driving.interrupt(self._why_not(Mode.MANUAL))

    def _why_not(self, mode: Mode) -> str:
        """Return why the robot is not in a mode that was asked for."""
        navigation = self._robot.navigation
        if navigation is None:
            return "navigation does not answer"
        why = f": {navigation.message}" if navigation.message else ""
        return f"{mode.name} was asked for, the robot is in {navigation.mode.name}{why}"

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
