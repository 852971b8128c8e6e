"""Shared data of the MAVLink microservices: the state of the robot, and the output of a step."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol, TypeAlias

from pymavlink.dialects.v20 import common

from robotctl.estimation.ranging.sonar_config import SonarModelConfig
from robotctl.mavlink.catalogue import Catalogue
from robotctl.mavlink.command import IN_PROGRESS, Command
from robotctl.mavlink.config import MavlinkConfig
from robotctl.mavlink.ftp.files import Files
from robotctl.mavlink.globe import Origin
from robotctl.mavlink.guards.stale_link import HeldBack
from robotctl.mavlink.guards.word_limit import WordLimit
from robotctl.mavlink.parameters.parameter_set import NO_PARAMETERS, ParameterSet
from robotctl.mavlink.parameters.store import NoParameterStore, ParameterStore
from robotctl.mavlink.personality import PERSONALITIES, Personality
from robotctl.messages.control import (
    Ack,
    ControlRequest,
    ControlState,
    Mode,
    NavigationRequest,
    NavigationState,
    Notice,
    Severity,
)
from robotctl.messages.estimation import LidarScan, LocalisationState
from robotctl.messages.mavlink_port import Address, MavlinkPort, Peer, Received
from robotctl.messages.plans import BoundsView, MissionView
from robotctl.messages.supervision import SupervisorRequest
from robotctl.messages.tuning import ParameterNews, ParameterRequest
from robotctl.messages.world_pose import WorldPose
from robotctl.model.fence import Fence
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.sonar import SonarMount
from robotctl.safety.state_machine import ENABLED

FRESH_NS = 1_000_000_000
"""Age beyond which a state is meaningless [ns]."""

MAX_TEXTS = 64
"""Maximum number of texts that wait."""

UNKNOWN = 255
"""Unknown `progress` of COMMAND_ACK."""

TRANSPORT_NS = 20_000_000
"""Delay of a set-point on its way through this process and to control [ns]: it expires that much
earlier, so that the robot brakes in time."""

LOCALISER_NOT_READY = "the localiser is not ready"

Request: TypeAlias = ControlRequest | NavigationRequest
Answer: TypeAlias = Callable[[int], None]
"""Sends the MAV_MISSION_RESULT of a change of a plan to the station that asked for it."""
Clear: TypeAlias = Callable[[Address, Answer, int], None]
"""Removes the plan of one kind for a station, now [ns]; the answer follows."""
State: TypeAlias = (
    ControlState
    | NavigationState
    | LocalisationState
    | LidarScan
    | Notice
    | MissionView
    | BoundsView
    | ParameterRequest
)


@dataclass(frozen=True, slots=True)
class TelemetryRobot:
    """Facts about the robot that its processes do not publish.

    Parameters
    ----------
    name : str
        Name of the robot; its hash is the unique identifier of AUTOPILOT_VERSION.
    version : str
        Version of robotctl, `major.minor.patch`.
    sonars : tuple of SonarMount
        In the order of `ControlState.sonar_m`.
    sonar : SonarModelConfig
        What each of them hears, the robot's `[localisation.sonar]`: its range and its beam.
    has_imu : bool
        It has an IMU.
    has_localiser : bool
        Its navigation has a localiser, which must be ready before the robot is armed.
    arm_timeout_s : float
        How long the control process tries to arm before it refuses [s].
    home : SE2
        `base` in `world` at the start.
    plans : bool
        It plans its way to a goal; else it drives straight.
    holonomic : bool
        It moves sideways, too.
    """

    name: str = "robot"
    version: str = "0.0.0"
    sonars: tuple[SonarMount, ...] = ()
    sonar: SonarModelConfig = field(default_factory=SonarModelConfig)
    has_imu: bool = False
    has_localiser: bool = False
    arm_timeout_s: float = 1.0
    home: SE2 = field(default_factory=SE2)
    plans: bool = True
    holonomic: bool = False


class PlanStore(Protocol):
    """Storage in which a plan of one kind that came over MAVLink outlives a power cut."""

    def load(self) -> bytes:
        """Return what was saved; empty: nothing."""

    def save(self, content: bytes) -> str:
        """Save a file beside the present one; return its path, empty: it is not kept."""

    def keep(self, content: bytes) -> None:
        """Remove all that was saved but this."""


class NoStore:
    """Keeps nothing."""

    def load(self) -> bytes:
        """Return nothing."""
        return b""

    def save(self, content: bytes) -> str:  # noqa: ARG002
        """Save nothing."""
        return ""

    def keep(self, content: bytes) -> None:
        """Have nothing to remove."""


class CanTap(Protocol):
    """The robot's CAN bus, for stations that watch it; no method blocks or raises."""

    def open(self) -> bool:
        """Open the bus if it is closed; return whether it is open."""

    def receive(self) -> Sequence[tuple[int, bytes]]:
        """Return identifiers and data of what came since the last call."""

    def send(self, number: int, data: bytes) -> None:
        """Send a frame, if the bus takes it."""

    def close(self) -> None:
        """Release it."""


class NoCan:
    """No bus."""

    def open(self) -> bool:
        """Fail."""
        return False

    def receive(self) -> Sequence[tuple[int, bytes]]:
        """Hear nothing."""
        return ()

    def send(self, number: int, data: bytes) -> None:
        """Send nothing."""

    def close(self) -> None:
        """Have nothing to do."""


def _take_no_key(key: bytes, stamp: int) -> str:  # noqa: ARG001
    """Return why no key for signing is taken."""
    return "nothing keeps it"


def _have_no_supervisor(request: SupervisorRequest) -> bool:  # noqa: ARG001
    """Return that a request has no receiver."""
    return False


@dataclass(frozen=True, slots=True)
class GroundStation:
    """A ground station that is alive: its address, and when each link last heard it [ns]."""

    system_id: int
    component_id: int
    heard_ns: dict[int, int]

    @property
    def links(self) -> tuple[int, ...]:
        """Links on which it was heard."""
        return tuple(sorted(self.heard_ns))


class Said(NamedTuple):
    """A line for people: its severity, and when it was said [ns]."""

    severity: int
    text: str
    stamp_ns: int
    peer: Peer | None = None
    """Receiver; None: everybody."""


@dataclass(slots=True)
class Pending:
    """A command that waits for its result: since when, and when its sender heard of it [ns]."""

    command: Command
    asked_ns: int
    told_ns: int
    percent: int = UNKNOWN
    """How much of it is done, as far as its service knows."""


@dataclass
class Context:
    """The present state and the outputs of a step, shared by all microservices."""

    config: MavlinkConfig
    robot: TelemetryRobot
    links: MavlinkPort
    stores: Mapping[str, PlanStore] = field(default_factory=dict)
    """Storage of plans, by their kind."""
    parameters: ParameterSet = field(default_factory=lambda: NO_PARAMETERS)
    parameter_store: ParameterStore = field(default_factory=NoParameterStore)
    """Storage of `parameters`."""
    take_key: Callable[[bytes, int], str] = _take_no_key
    """Use and keep a key for signing with its time stamp; return why not."""
    ask_supervisor: Callable[[SupervisorRequest], bool] = _have_no_supervisor
    """Hand the supervisor a request; return whether it is there."""
    folders: Mapping[str, Files] = field(default_factory=dict)
    """Files that are served, by their names in the root, which is "" itself."""
    can: CanTap = field(default_factory=NoCan)
    """The robot's bus."""
    origin: Origin | None = None
    """Place of `world` on the globe, once that is known."""
    origin_users: set[str] = field(default_factory=set)
    """Kinds of plans that have places by `origin`."""
    clears: list[Clear] = field(default_factory=list)
    """Functions that remove the plan of each kind."""
    fence: Fence = Fence()  # noqa: RUF009 - it does not change
    """The last fence that navigation took."""
    fence_crc: int = 0
    """Its name in `NavigationState`."""
    wall_ns: Callable[[], int] = time.time_ns
    """Return the time of day [ns since 1970]."""
    scans: dict[str, LidarScan] = field(default_factory=dict)
    """The last of each lidar, by its name."""
    control: ControlState | None = None
    navigation: NavigationState | None = None
    mission: MissionView | None = None
    """The mission that navigation has, wherever it is from."""
    bounds: BoundsView | None = None
    """Bounds that navigation keeps to, wherever they are from."""
    world: WorldPose = field(init=False)
    catalogue: Catalogue = field(default_factory=Catalogue)
    """The sum of all services, known once all are made."""
    stretch: dict[int, float] = field(default_factory=dict)
    """How many times longer than asked for the intervals of streams are, by link."""
    peers: tuple[Peer, ...] = ()
    """Peers served on the links now."""
    receivers: Callable[[int], Collection[Peer]] = field(init=False)
    """Return the peers that get a periodic message, by its number."""
    heard_ns: dict[Peer, int] = field(default_factory=dict)
    """Time at which each of them was heard last [ns]."""
    ground_stations: dict[Address, GroundStation] = field(default_factory=dict)
    """Stations alive, the longest known first."""
    held_back: HeldBack = field(default_factory=HeldBack)
    pending: dict[tuple[Address, int, Peer], Pending] = field(default_factory=dict)
    """Commands that wait for their results, by sender, number and peer."""
    acks: list[Ack] = field(default_factory=list)
    """Answers of the control process in this step."""
    requests: list[Request] = field(default_factory=list)
    parameter_requests: list[ParameterRequest] = field(default_factory=list)
    """Requests of other processes of the robot in this step."""
    news: list[ParameterNews] = field(default_factory=list)
    """Messages about parameters for other processes of the robot."""
    notices: deque[Notice] = field(default_factory=lambda: deque(maxlen=MAX_TEXTS))
    """Texts for the process, which may publish them; they are sent, and must not come back."""
    texts: deque[Said] = field(default_factory=lambda: deque(maxlen=MAX_TEXTS))
    """Texts for the STATUSTEXT service."""
    asker: Peer | None = None
    """Sender of the message that is handled now."""
    words: WordLimit = field(default_factory=WordLimit)
    """Limit on what each peer makes the robot say."""

    def __post_init__(self) -> None:
        """Wait for the localiser, where the robot has one; begin with the configured origin."""
        self.origin = self.origin or self.config.origin
        self.world = WorldPose(has_localiser=self.robot.has_localiser)
        self.receivers = lambda _message_id: self.peers

    @property
    def personality(self) -> Personality:
        """The autopilot that the robot claims to be."""
        return PERSONALITIES[self.config.personality]

    def store_of(self, word: str) -> PlanStore:
        """Return what keeps one kind of plans."""
        return self.stores.get(word) or NoStore()

    def hear(self, received: Sequence[Received], now_ns: int) -> None:
        """Note the peers on the links, and which of them have sent something."""
        self.peers = self.links.peers()
        self.heard_ns.update((each.peer, now_ns) for each in received)
        for gone in self.heard_ns.keys() - self.peers:
            del self.heard_ns[gone]

    def take(self, state: State) -> None:
        """Take one message of another process."""
        if isinstance(state, ControlState):
            self.control = state
            self.acks.extend(state.acks)
        elif isinstance(state, NavigationState):
            self.navigation = state
        elif isinstance(state, LocalisationState):
            self.world.localise(state)
        elif isinstance(state, LidarScan):
            self.scans[state.name] = state
        elif isinstance(state, MissionView):
            self.mission = state
        elif isinstance(state, BoundsView):
            self.bounds = state
        elif isinstance(state, ParameterRequest):
            self.parameter_requests.append(state)
        else:
            stamp_ns = state.stamp_ns
            self.texts.extend(
                Said(state.severity, line, stamp_ns) for line in state.text.splitlines()
            )

    def may_speak(self, now_ns: int) -> bool:
        """Return whether a text may be queued: there is room, and its cause has not had too many.

        Not where half the room for texts is taken, nor for a sender of `BURST` texts: whoever asks
        for nonsense again and again must not crowd out what the other processes say, such as why
        the robot has stopped.
        """
        has_room = len(self.texts) < MAX_TEXTS // 2
        return has_room and (self.asker is None or self.words.allows(self.asker, now_ns))

    def say(self, now_ns: int, text: str, severity: Severity = Severity.WARNING) -> None:
        """Send `text` to ground stations and notices, if it `may_speak`."""
        self._speak(now_ns, Said(severity, text, now_ns))

    def tell_asker(self, now_ns: int, text: str, severity: Severity = Severity.WARNING) -> None:
        """Send `text` to the sender in hand, if it `may_speak`; a warning to notices, too."""
        self._speak(now_ns, Said(severity, text, now_ns, self.asker))

    def _speak(self, now_ns: int, said: Said) -> None:
        if not self.may_speak(now_ns):
            return
        if self.asker is not None:
            self.words.take(self.asker, now_ns)
        self.texts.append(said)
        if said.peer is None or said.severity <= Severity.WARNING:
            self.notices.append(Notice(now_ns, said.severity, said.text))

    def acknowledge(self, command: Command, result: int) -> None:
        """Send COMMAND_ACK with a MAV_RESULT to the sender of `command`, which has ended."""
        self.pending.pop(command.key, None)
        self.tell_result(command, result)

    def tell_progress(self, command: Command, percent: int, now_ns: int) -> None:
        """Tell the sender of `command`, which goes on, how much of it is done."""
        self.tell_result(command, IN_PROGRESS, percent)
        if (pending := self.pending.get(command.key)) is not None:
            pending.told_ns, pending.percent = now_ns, percent

    def tell_result(self, command: Command, result: int, progress: int = 0) -> None:
        """Send COMMAND_ACK with a MAV_RESULT to the sender of `command`."""
        system, component = command.sender
        ack = common.MAVLink_command_ack_message(
            command.number, result, progress, 0, target_system=system, target_component=component
        )
        self.links.reply(ack, command.peer)

    def fresh_control(self, now_ns: int) -> ControlState | None:
        """Return the control process's state, None if it is silent."""
        state = self.control
        return state if state is not None and now_ns - state.stamp_ns <= FRESH_NS else None

    def is_armed(self, now_ns: int) -> bool:
        """Say whether the robot is known to be armed, or a motor of it tested."""
        control = self.fresh_control(now_ns)
        return control is not None and control.state in ENABLED

    def fresh_navigation(self, now_ns: int) -> NavigationState | None:
        """Return the navigation process's state, None if it is silent."""
        state = self.navigation
        return state if state is not None and now_ns - state.stamp_ns <= FRESH_NS else None

    def fresh_localisation(self, now_ns: int) -> LocalisationState | None:
        """Return the localiser's estimate; None if it is silent or absent."""
        state = self.world.latest
        return state if state is not None and now_ns - state.stamp_ns <= FRESH_NS else None

    def fresh_pose(self, now_ns: int) -> tuple[ControlState, SE2] | None:
        """Return the control process's state and `base` in `world`, None if that is unknown."""
        control = self.fresh_control(now_ns)
        pose = None if control is None else self.world.pose(control)
        return None if control is None or pose is None else (control, pose)

    def fresh_fix(self, now_ns: int) -> LocalisationState | None:
        """Return the localiser's pose; None while it does not vouch for it."""
        control, believed = self.control, self.fresh_localisation(now_ns)
        is_sure = control is not None and self.world.is_sure(control)
        return believed if is_sure else None

    def known_pose(self, now_ns: int) -> SE2 | None:
        """Return `base` in `world`, None if the robot does not know where it is."""
        found = self.fresh_pose(now_ns)
        if found is None or not _is_finite(found[1]):
            return None
        if self.robot.has_localiser and self.fresh_fix(now_ns) is None:
            return None
        return found[1]

    def fence_objection(self, x_m: float, y_m: float, now_ns: int) -> str:
        """Return why the fence keeps the robot from a point of `world` [m]; empty: it does not."""
        navigation = self.fresh_navigation(now_ns)
        if navigation is None or not navigation.fence.enabled:
            return ""
        if navigation.fence.crc != self.fence_crc or self.fence.allows(x_m, y_m):
            return ""
        return f"x {x_m:.2f} m, y {y_m:.2f} m is beyond the fence, a place within it allowed"

    @property
    def home(self) -> SE2:
        """Goal of RTL in `world`, as navigation last said."""
        moved = None if self.navigation is None else self.navigation.home
        return self.robot.home if moved is None else SE2(*moved)

    @property
    def setpoint_life_ns(self) -> int:
        """How long velocities and sticks count from when they were sent [ns]."""
        return round(self.config.setpoint_timeout_s * 1e9) - TRANSPORT_NS

    def has_localiser_ready(self, now_ns: int) -> bool:
        """Say whether the localiser works, where the robot has one."""
        return not self.robot.has_localiser or self.fresh_localisation(now_ns) is not None

    def against_arming(self, now_ns: int) -> tuple[str, ...] | None:
        """Return all that speaks against arming now; None while the robot is armed."""
        control = self.fresh_control(now_ns)
        if control is None:
            return ("control is silent",)
        if control.state in ENABLED:
            return None
        reasons = tuple(str(each) for each in control.against_arming)
        return reasons if self.has_localiser_ready(now_ns) else (*reasons, LOCALISER_NOT_READY)

    def mode(self, now_ns: int) -> Mode:
        """Return the active mode; None if the navigation process is silent."""
        navigation = self.fresh_navigation(now_ns)
        return Mode.HOLD if navigation is None else navigation.mode


def _is_finite(pose: SE2) -> bool:
    """Say whether all of a pose is known."""
    return math.isfinite(pose.x_m + pose.y_m + pose.theta_rad)
