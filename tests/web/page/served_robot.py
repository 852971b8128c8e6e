"""A robot that is only what it publishes, behind the real server of the page.

It obeys as control and navigation do, as far as a page can see that, and keeps what it was asked.
"""

from __future__ import annotations

import asyncio
import math
import socket
import threading
import time
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import msgspec
import numpy as np
import uvicorn

import robotctl
from robotctl.app.processes.recordings import RecordingFolder
from robotctl.config.robot_file import contradictions, find_file, load_robot
from robotctl.mavlink.parameters.parameter import REAL32
from robotctl.mavlink.parameters.parameter_set import (
    Configurations,
    ParameterRefused,
    ParameterSet,
)
from robotctl.mavlink.parameters.published import table_of, values_of
from robotctl.messages.control import (
    Ack,
    Arm,
    BatteryFeedback,
    BusStatus,
    ControlState,
    EmergencyStop,
    ImuFeedback,
    LoopStatistics,
    ManualControl,
    NavigationState,
    NodeStatus,
    Notice,
    PositionTarget,
    SafetyState,
    SetMode,
    StepBudget,
)
from robotctl.messages.estimation import (
    GivenMap,
    LidarScan,
    LiveMap,
    LocalisationState,
    ParticleCloud,
    PlanView,
)
from robotctl.messages.faults import Fault, FaultCode
from robotctl.messages.fence import FenceState, SetFence
from robotctl.messages.mission import JumpToItem, LoadMission
from robotctl.messages.mode import Mode
from robotctl.messages.plans import BoundsView, MissionView, SetZones
from robotctl.messages.recording import RecorderState, SetRecording
from robotctl.messages.tuning import ParameterAnswer, ResetParameters
from robotctl.model.fence import Fence
from robotctl.model.geometry.localisation import LocalisationStatus
from robotctl.web.access import Access, Role
from robotctl.web.desk import Desk
from robotctl.web.recordings import RecordingPages
from robotctl.web.robot_side import PictureSource, RobotSide
from robotctl.web.robot_view import Now
from robotctl.web.server import PageServer
from robotctl.web.wire import ComputerState, RobotOutline, SonarOutline

T = TypeVar("T")

STATIC = Path(robotctl.__file__).parent / "web" / "static"
PERIOD_S = 0.05
MAP_M = (8.0, 6.0)
RESOLUTION_M = 0.1
OUTLINE = RobotOutline(
    name="tester",
    version="0",
    simulated=True,
    drive="diff",
    holonomic=False,
    has_lidar=True,
    has_localiser=True,
    bodies=((((0.3, -0.2), (0.3, 0.2), (-0.1, 0.2), (-0.1, -0.2)),),),
    sonars=(SonarOutline("front", 0.3, 0.0, 0.0),),
    v_max_m_s=1.0,
    omega_max_rad_s=2.0,
    vy_max_m_s=0.0,
    wheels=("left", "right"),
    file="/etc/robotctl/tester.toml",
)
CONFIG = load_robot(find_file("diff_drive"))


def walled_map() -> LiveMap:
    """Return a room, 8 m by 6 m, with its lower left corner in the origin."""
    cells = np.zeros((round(MAP_M[1] / RESOLUTION_M), round(MAP_M[0] / RESOLUTION_M)), np.int8)
    cells[[0, -1], :] = 100
    cells[:, [0, -1]] = 100
    return LiveMap(0, *cells.shape, RESOLUTION_M, 0.0, 0.0, cells.tobytes())


class ServedRobot:
    """The robot, its server, and a thread in which both run.

    Attributes
    ----------
    pose
        x, y, heading of `base` in `odom`, which is `world` [m, m, rad].
    outline
        What the server says of it from its next start on.
    paused_ns
        How long the robot's clock has stood so far, as that of a simulation may.
    is_silent
        Whether control and navigation publish nothing.
    is_deaf
        Whether control takes requests, but does nothing.
    asked
        All requests to control and navigation, oldest first.
    wheel_distance_m, sonar_m, imu_rate_rad_s
        What control says of wheels and sonars [m]; of the gyro's z axis [rad/s], None: no IMU.
    parameters
        What telemetry knows of parameters.
    saved, why_not_saved
        Values that were written into the robot's file; why none are.
    particles
        x, y, heading of particles, (n, 3) float32.
    recorder
        What the recorder publishes; None: nothing.
    recordings
        Folder that is shown from the next start on; None: there is none.
    """

    def __init__(self, tokens: dict[Role, str] | None = None) -> None:
        self.pose = (2.0, 3.0, 0.0)
        self.state, self.reason, self.fault = SafetyState.ARMED, "", FaultCode.NONE
        self.against_arming: tuple[Fault, ...] = ()
        self.mode, self.message = Mode.HOLD, ""
        self.goal: tuple[float, float] | None = None
        self.outline = OUTLINE
        self.paused_ns = 0
        self.is_silent = self.is_deaf = False
        self.mission = LoadMission(0, "", b"")
        self.bounds = BoundsView(0, Fence(), 0, False, (), 0, (), 0, (0.5, 0.5, 0.0))
        self.item = 0
        self.camera: PictureSource | None = None
        self.asked: list[Any] = []
        self.wheel_distance_m = (0.0, 0.0)
        self.sonar_m: tuple[float, ...] = (1.0,)
        self.imu_rate_rad_s: float | None = None
        self.particles = np.empty((0, 3), np.float32)
        self.verdict = ""
        self.budget = StepBudget()
        self.published_ns: dict[int, int] = {}
        """Wall clock at which the server was given each state, by its stamp [ns]."""
        self.remarks: list[str] = []
        self.parameters = ParameterSet(Configurations(CONFIG, CONFIG, contradictions), {})
        self.saved: list[dict[str, Any]] = []
        self.why_not_saved: Exception | None = None
        self.recorder: RecorderState | None = None
        self.recordings: Path | None = None
        self._tokens = tokens or {}
        self._acks: tuple[Ack, ...] = ()
        self._encode = msgspec.msgpack.Encoder().encode
        self._extra: list[bytes] = []
        self.port = 0
        self.start()

    # The server's life

    def start(self) -> None:
        """Begin to serve; at the same port as before."""
        listener = socket.socket()
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind(("127.0.0.1", self.port))
        self.port = listener.getsockname()[1]
        side = RobotSide(
            self.outline,
            self._now,
            self._take,
            self._take,
            self.remarks.append,
            self._tune,
            self._take,
            self._save,
            camera=self.camera,
            computer=lambda: ComputerState(0.23, 54.4, 1_200_000_000, 4_000_000_000, 100_000_000),
        )
        desk = Desk(has_localiser=True, arm_timeout_ns=1_000_000_000)
        access = Access(self._tokens, (), self.port)
        folder = None if self.recordings is None else RecordingFolder(self.recordings)
        pages = RecordingPages(folder, access)
        self._page = PageServer(side, desk, access, STATIC, pages.routes)
        self._server = uvicorn.Server(
            uvicorn.Config(
                self._page.app,
                ws="websockets-sansio",
                ws_per_message_deflate=False,
                lifespan="off",
                log_config=None,
                timeout_graceful_shutdown=1,
            )
        )
        self._thread = threading.Thread(target=asyncio.run, args=(self._serve(listener),))
        self._thread.start()

    def stop(self) -> None:
        """End the server, and with it all connections."""
        self._server.should_exit = True
        self._thread.join()

    @property
    def url(self) -> str:
        """Address of the page."""
        return f"http://127.0.0.1:{self.port}/"

    async def _serve(self, listener: socket.socket) -> None:
        self._loop = asyncio.get_running_loop()
        serving = asyncio.create_task(self._server.serve([listener]))
        await asyncio.sleep(0)
        deadline_s = time.monotonic()
        while not serving.done():
            self._page.relay(self._published())
            deadline_s = max(deadline_s + PERIOD_S, time.monotonic())
            await asyncio.wait({serving}, timeout=deadline_s - time.monotonic())
        listener.close()

    # What it says

    def notice(self, severity: int, text: str) -> None:
        """Publish a notice."""
        self.publish(Notice(time.monotonic_ns(), severity, text))

    def publish(self, message: msgspec.Struct) -> None:
        """Publish a message besides all others, once."""
        self._extra.append(self._encode(message))

    def _published(self) -> list[bytes]:
        messages, self._extra = self._extra, []
        if self.is_silent:
            return messages
        now_ns = time.monotonic_ns() - self.paused_ns
        self.published_ns[now_ns] = time.time_ns()
        pictures = (
            GivenMap(now_ns, walled_map()),
            self._localisation(now_ns),
            self._scan(now_ns),
            ParticleCloud(now_ns, self.particles.tobytes()),
            self._plan(now_ns),
            MissionView(now_ns, "", self._mission_crc, self.mission.content),
            msgspec.structs.replace(self.bounds, stamp_ns=now_ns),
            table_of(self.parameters, now_ns),
            values_of(self.parameters, now_ns),
            self._navigation(now_ns),
            self._control(now_ns),
        )
        if self.recorder is not None:
            recorder = msgspec.structs.replace(self.recorder, stamp_ns=now_ns)
            messages.append(self._encode(recorder))
        return messages + [self._encode(each) for each in pictures]

    def _control(self, now_ns: int) -> ControlState:
        x_m, y_m, theta_rad = self.pose
        return ControlState(
            stamp_ns=now_ns,
            state=self.state,
            reason=self.reason,
            x_m=x_m,
            y_m=y_m,
            theta_rad=theta_rad,
            v_m_s=0.5 * math.sin(now_ns / 1e9),
            omega_rad_s=0.0,
            v_ref_m_s=0.5,
            omega_ref_rad_s=0.0,
            distance_m=0.0,
            wheel_rad_s=(1.0, 2.0),
            wheel_ref_rad_s=self._wheel_ref_rad_s,
            wheel_distance_m=self.wheel_distance_m,
            duty=(0.1, 0.2),
            current_a=(0.5, math.nan),
            temperature_c=(30.0, 31.0),
            steering_rad=math.nan,
            bus_voltage_v=12.0,
            battery=BatteryFeedback(now_ns, 12.1, 1.0, 0.8, 25.0, low=False, critical=False),
            sonar_m=self.sonar_m,
            imu=self._imu(now_ns),
            sonar_stamp_ns=(now_ns,),
            nodes=(NodeStatus(1, "drive", 5, now_ns, 1, ""),),
            bus=BusStatus(load=0.12),
            loop=LoopStatistics(rate_hz=200.0, lag_us_p99=150.0),
            acks=self._acks,
            fault=self.fault,
            against_arming=self.against_arming,
        )

    @property
    def _wheel_ref_rad_s(self) -> tuple[float, float]:
        sticks = self.sticks
        return (0.0, 0.0) if sticks is None else (10.0 * sticks[0], 10.0 * sticks[0])

    def _imu(self, now_ns: int) -> ImuFeedback | None:
        if self.imu_rate_rad_s is None:
            return None
        rate = (0.0, 0.0, self.imu_rate_rad_s)
        return ImuFeedback(now_ns, now_ns, rate, (0.0, 0.0, 9.81), (0.0, 0.0, 1.0))

    def _navigation(self, now_ns: int) -> NavigationState:
        return NavigationState(
            now_ns,
            self.mode,
            "",
            self.item,
            0,
            "",
            False,
            False,
            self.message,
            goal=self.goal,
            mission_crc=self._mission_crc,
            mission_commands=len(self.requests(JumpToItem)),
            fence=FenceState(self.bounds.fence_crc),
            budget=self.budget,
        )

    @property
    def _mission_crc(self) -> int:
        return zlib.crc32(self.mission.content)

    def _localisation(self, now_ns: int) -> LocalisationState:
        covariance = (0.01, 0.0, 0.0, 0.04, 0.0, 0.01)
        status = LocalisationStatus.LOCALISED
        count = len(self.particles)
        return LocalisationState(
            now_ns, "mcl", status, 0.0, 0.0, 0.0, covariance, count, verdict=self.verdict
        )

    def _scan(self, now_ns: int) -> LidarScan:
        ranges = np.full(360, 1.5, np.float32).tobytes()
        return LidarScan(now_ns, 0.0, 0.0, 0.0, 2 * math.pi / 360, 8.0, ranges)

    def _plan(self, now_ns: int) -> PlanView:
        x_m, y_m, theta_rad = self.pose
        path = np.array([[x_m, y_m, theta_rad], [6.0, 4.0, 0.0]], np.float32).tobytes()
        costs = LiveMap(now_ns, 1, 1, 0.5, 5.0, 1.0, bytes([50]))
        moving = ((5.0, 4.5, 0.3, 0.0, 0.3),)
        return PlanView(now_ns, path, b"", b"", moving, costs)

    # What it does

    def _now(self) -> Now:
        now_ns = time.monotonic_ns()
        return Now(now_ns, now_ns - self.paused_ns)

    def _take(self, request: Any) -> bool:
        self.asked.append(request)
        if self.is_deaf:
            return True
        match request:
            case EmergencyStop():
                self.state, self.reason = SafetyState.EMERGENCY_STOP, "emergency stop (operator)"
                self.fault = FaultCode.EMERGENCY_STOP
            case Arm(request_id=request_id, arm=arm):
                accepted = not (arm and self.against_arming)
                reasons = () if accepted else self.against_arming
                self._acks = (Ack(request_id, accepted, reasons),)
                if accepted:
                    self.state = SafetyState.ARMED if arm else SafetyState.STANDBY
                    self.reason, self.fault = "", FaultCode.NONE
            case SetMode(mode=mode):
                self.mode = mode
            case SetRecording(on=on) if self.recorder is not None:
                self.recorder = msgspec.structs.replace(self.recorder, is_recording=on)
            case PositionTarget(x_m=x_m, y_m=y_m):
                self.goal = (x_m, y_m)
            case _:
                self._take_plan(request)
        return True

    def _take_plan(self, request: Any) -> None:
        match request:
            case LoadMission():
                self.mission = request
            case SetFence(fence=fence, crc=crc):
                self.bounds = msgspec.structs.replace(
                    self.bounds, fence=fence, fence_crc=crc, fence_enabled=bool(crc)
                )
            case SetZones(zones=zones, crc=crc):
                self.bounds = msgspec.structs.replace(self.bounds, zones=zones, zones_crc=crc)
            case JumpToItem(item=item):
                self.item = int(item) - 1

    def _tune(self, request: Any) -> bool:
        """Set parameters as telemetry does, without control."""
        self.asked.append(request)
        refusal = ""
        if isinstance(request, ResetParameters):
            self.parameters.reset()
        else:
            refusal = self.set(request.name, request.value)
        self.publish(ParameterAnswer(request.request_id, refusal))
        return True

    def _save(self, values: Mapping[str, Any]) -> tuple[str, str, tuple[str, ...]]:
        if self.why_not_saved is not None:
            raise self.why_not_saved
        self.saved.append(dict(values))
        return "tester.toml", "tester.toml.~1~", tuple(self.parameters.changes())

    def set(self, name: str, value: float | None) -> str:
        """Set a parameter, as a ground station may; return why not."""
        parameter = self.parameters.parameters[self.parameters.index_of(name)]
        raw = self.parameters.default(parameter) if value is None else value
        try:
            self.parameters.set(parameter, float(raw), REAL32)
        except ParameterRefused as refusal:
            return str(refusal)
        return ""

    # What tests ask

    def requests(self, kind: type[T]) -> list[T]:
        """Return the requests of one kind so far."""
        return [each for each in self.asked if isinstance(each, kind)]

    @property
    def sticks(self) -> tuple[float, float] | None:
        """Forward and turn of the newest sticks in force; None: the robot stands."""
        drives = self.requests(ManualControl)
        if not drives or drives[-1].expires_ns < time.monotonic_ns():
            return None
        newest = drives[-1]
        return None if (newest.forward, newest.turn) == (0, 0) else (newest.forward, newest.turn)


def wait_for(condition: Callable[[], T], page: Any, limit_s: float = 5.0) -> T:
    """Let a page run until a condition holds, and return what it gave."""
    end_s = time.monotonic() + limit_s
    while not (found := condition()):
        assert time.monotonic() < end_s, "did not happen in time"
        page.wait_for_timeout(10)
    return found


def press(page: Any, name: str, condition: Callable[[], T], limit_s: float = 10.0) -> T:
    """Press a button until what it asks for has come about, and return what the condition gave.

    On a computer that stands still for a second a request comes too late, and the page says so: it
    is then asked for again, as a person would.
    """
    button = page.get_by_role("button", name=name, exact=True)
    toast = page.get_by_role("alert")

    def came_about() -> T:
        found = condition()
        if not found and toast.get_by_text("late: ask again").is_visible():
            toast.get_by_role("button").click()
            button.click()
        return found

    button.click()
    return wait_for(came_about, page, limit_s)
