"""The test bench: simulated firmware and control stack as processes on one bus, and an observer."""

from __future__ import annotations

import contextlib
import itertools
import math
import os
import shutil
import signal
import subprocess
import time
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import zmq

from hil_tests.bus_tool import DRIVE, BusTool
from hil_tests.firmware import Firmware
from hil_tests.processes import children_of
from robotctl.app.simulation.run_status import BEST_EFFORT, PATIENCE, Truth
from robotctl.app.supervision.child_process import start_child
from robotctl.app.supervision.stack import CONTROL, NAVIGATION, RECORDER, TELEMETRY, WEB
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import find_file
from robotctl.messages.control import (
    Ack,
    Arm,
    ControlState,
    EmergencyStop,
    EmergencyStopSource,
    Mode,
    NavigationState,
    Notice,
    SafetyState,
    SetMode,
    VelocityCommand,
    VelocityTarget,
)
from robotctl.model.geometry.angles import wrap_angle
from robotctl.runtime.ipc.topics import Endpoints, RequestSender, Subscriber, endpoint_directory

ROOM_M = (6.0, 4.0)

SUPERVISOR = "supervisor"
UNIT = (SUPERVISOR, CONTROL, NAVIGATION, TELEMETRY, RECORDER)
"""The processes of a robot."""

CIRCLE_M, NEAR_M = 0.5, 0.7
"""Radius of the circles that tests drive; how near to the middle of the room there is space."""

GUEST_TIME = os.environ.get("VCAN_GUEST", "")
"""The time of the guest that the tests are in: empty in none; real: one slow processor for all;
virtual: computing takes no time, so that a busy process never gets late."""

PATIENT_S = 30.0
"""So long may starting and recovering take on a busy machine; reactions have their own limits."""

_POLL_S = 0.005
_MOMENTS_S = 0.02
"""Four periods of the loop, and one of the states that control publishes."""
_TOLD, _TOLD_NS = 40, 50_000_000
"""So many states, so far apart, are told of a failure."""
_TRUE = 100
"""So many truths are kept: those of 2 s."""
_PREFERRED = 1
"""SCHED_FIFO priority of processes that have none on a robot: below all that have one there."""
_ABOVE_CONTROL = 10
"""A real drive has a processor of its own: a host that computes for ever does not hold it up."""
_instances = itertools.count()


def is_exact(bus: str) -> bool:
    """Return whether a late frame on the bus is the robot's own: virtual time, or a real robot."""
    return bus == "can0" or GUEST_TIME == "virtual"


def _numbers(values: Sequence[float]) -> str:
    return " ".join(f"{value:.1f}" for value in values)


class UnsafeMotionError(AssertionError):
    """The simulator's monitor saw the robot move as nobody allowed."""


class Rig(BusTool):
    """One bench on one bus.

    Parameters
    ----------
    bus
        `simcan`, or a SocketCAN interface.
    seed
        Of the simulated robot's random draws, and of the moments of `at_any_moment`.
    robot, world, start
        What stands on the bench: configuration, world, and pose "x,y,heading_deg".
    mavlink_url
        The stack's only MAVLink link; empty: none.
    override
        A setting that differs from the configuration.
    directory
        Where output of the processes goes.
    """

    def __init__(
        self,
        bus: str,
        directory: Path,
        seed: int,
        robot: str = "diff_drive",
        world: str = "empty_room",
        start: str = "2.0,2.0,0",
        mavlink_url: str = "",
        mission: str = "",
        record: str = "",
        override: str = "",
    ) -> None:
        self.robot = robot
        number = next(_instances)
        name = f"hil-{os.getpid()}-{number}"
        simulated = bus == "simcan"
        super().__init__("simcan" if simulated else "socketcan", name if simulated else bus)
        self._firmware_bus = f"simcan:{name}" if simulated else bus
        self._world, self._start, self._directory = world, start, directory
        self._seed, self._rng = seed, np.random.default_rng(seed)
        x_m, y_m, heading_deg = (float(part) for part in start.split(","))
        self.options = StackOptions(
            instance=name,
            robot=str(find_file(robot).resolve()),
            overrides=(
                *(() if is_exact(bus) else (PATIENCE,)),
                BEST_EFFORT,
                f'can.interface="{self.interface}"',
                f'can.channel="{self.channel}"',
                f'mavlink.link=[{{url="{mavlink_url}"}}]' if mavlink_url else "mavlink.link=[]",
                *((override,) if override else ()),
            ),
            x_m=x_m,
            y_m=y_m,
            theta_rad=heading_deg * 0.017453292519943295,
            mission=mission,
            record=record,
        )
        self.config = self.options.load()
        self._folder = endpoint_directory(name)
        self.endpoints = Endpoints(self._folder)
        self._context = zmq.Context()
        if os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK == os.SCHED_FIFO:
            # Its thread does not take after the tests, which are reset on fork.
            self._context.set(zmq.THREAD_SCHED_POLICY, os.SCHED_FIFO)
            self._context.set(zmq.THREAD_PRIORITY, os.sched_getparam(0).sched_priority)
        self._states = Subscriber[ControlState | NavigationState | Notice](
            self._context, self.endpoints.published, ControlState | NavigationState | Notice
        )
        self._truths = Subscriber[Truth](self._context, (self.endpoints.truth,), Truth)
        self._requests = RequestSender(self._context, self.endpoints.control_requests)
        self._to_navigation = RequestSender(self._context, self.endpoints.navigation_requests)
        self._ids = itertools.count(1)
        self._processes: dict[str, subprocess.Popen[bytes] | Firmware] = {}
        self.control: ControlState | None = None
        self.navigation: NavigationState | None = None
        self.notices: list[str] = []
        self.acks: dict[int, Ack] = {}
        self._history: deque[ControlState] = deque(maxlen=_TOLD)
        self._true: deque[Truth] = deque(maxlen=_TRUE)
        self._unsafe: Truth | None = None
        """The newest truth with an unsafe motion; firmware that is started again counts anew."""
        self.tolerates_rejects = False
        """Whether the test disturbs frames on purpose."""

    # Processes

    def start_firmware(self) -> None:
        """Start firmware_sim and wait until its nodes are on the bus."""
        log = self._directory / "firmware.log"
        log.touch()
        already = log.read_bytes().count(b"ready")
        process = Firmware(
            [
                *("--robot", self.options.robot),
                *("--world", str(find_file(self._world, "worlds"))),
                *("--bus", self._firmware_bus),
                f"--start={self._start}",
                f"--seed={self._seed}",
                *("--truth", self.endpoints.truth),
                *("--priority", str(self.config.runtime.priority + _ABOVE_CONTROL)),
            ],
            log,
        )
        self._processes["firmware"] = process
        self._firmware_log = log

        def ready() -> bool:
            assert process.poll() is None, f"firmware_sim ended:\n{log.read_text()}"
            return log.read_bytes().count(b"ready") > already

        self.wait(ready, 90.0, "firmware_sim is ready")

    def at_any_moment(self) -> None:
        """Let what comes next strike at a random moment of the periods in which all else works."""
        time.sleep(self._rng.uniform(0.0, _MOMENTS_S))

    def inject(self, fault: str) -> float:
        """Let a fault befall the simulated robot; return when it began, in the wall's seconds."""
        log, process = self._firmware_log, self._processes["firmware"]
        said = len(log.read_text(encoding="utf-8"))
        assert isinstance(process, Firmware)
        process.tell(fault)

        def answer() -> str:
            return log.read_text(encoding="utf-8")[said:]

        self.wait(lambda: answer().endswith("\n"), 2.0, f"an answer to {fault}")
        words = answer().split()
        assert words[0] == "fault", answer()
        return time.time() - (time.monotonic_ns() - int(words[-1])) / 1e9

    def start(self, module: str = CONTROL, program: str = "") -> None:
        """Start one process of the stack, or another `program` in its place."""
        self._processes[module] = start_child(self.options.command(program or module))

    def start_supervised(self) -> None:
        """Start the whole stack under a supervisor, as on a robot, and wait until all of it works.

        `unit` has its processes then.
        """
        self.start(SUPERVISOR, "hil_tests.supervised")
        self.wait(lambda: len(self.unit()) == len(UNIT), PATIENT_S, "all processes have begun")
        self.wait(lambda: self.navigation, PATIENT_S, "navigation works")

    def unit(self) -> dict[str, int]:
        """Return the pids of the supervisor and its processes, as `systemctl kill` finds them."""
        pid = self.pid(SUPERVISOR)
        lines = children_of(pid)
        found = {
            module: child
            for module in UNIT
            for child, line in lines.items()
            if module.encode() in line
        }
        return {SUPERVISOR: pid, **found}

    def prefer(self, *names: str) -> None:
        """Let running processes come before ordinary tasks, where that is permitted.

        On a robot's own computer they need no priority. Here several robots share the processors
        with others that start: a navigation that gets none for 200 ms holds, as it must.
        """
        for name in names:
            for task in Path(f"/proc/{self.pid(name)}/task").iterdir():
                with contextlib.suppress(PermissionError, ProcessLookupError):
                    taken = os.sched_param(_PREFERRED)
                    os.sched_setscheduler(int(task.name), os.SCHED_FIFO, taken)

    def pid(self, name: str) -> int:
        """Return the process id of a running process."""
        process = self._processes.get(name)
        return self.unit()[name] if process is None else process.pid

    def is_running(self, name: str) -> bool:
        """Return whether a process was started and has not ended."""
        return name in self._processes and self._processes[name].poll() is None

    def send_signal(self, name: str, number: int) -> None:
        """Send a signal to a process that is to live on."""
        self._processes[name].send_signal(number)

    def kill(self, name: str, number: int = signal.SIGKILL) -> int:
        """Send a signal to a process, stopped or not; wait for its end and return its status."""
        process = self._processes.pop(name)
        process.send_signal(signal.SIGCONT)
        process.send_signal(number)
        return process.wait(10)

    def close_stack(self) -> dict[str, int]:
        """End all but the firmware; return how each of them ended."""
        return {
            name: self.kill(name, signal.SIGTERM)
            for name in (SUPERVISOR, WEB, TELEMETRY, NAVIGATION, CONTROL, RECORDER)
            if name in self._processes
        }

    def close(self) -> None:
        """End everything, the stack first."""
        super().close()
        self.close_stack()
        if "firmware" in self._processes:
            self.kill("firmware", signal.SIGTERM)
        self._context.destroy(linger=0)
        shutil.rmtree(self._folder, ignore_errors=True)

    # Looking

    def fresh_truth(self) -> Truth:
        """Return the first truth from now on."""
        return self.truth_at(time.monotonic_ns())

    def truth_at(self, stamp_ns: int) -> Truth:
        """Return the first truth at or after a time, which may be up to 2 s ago."""
        self.wait(
            lambda: self.truth and self.truth.stamp_ns >= stamp_ns, PATIENT_S, "a fresh truth"
        )
        return next(each for each in self._true if each.stamp_ns >= stamp_ns)

    @property
    def truth(self) -> Truth | None:
        """The newest truth; None before the first."""
        return self._true[-1] if self._true else None

    def room_distances(self) -> dict[str, float | None]:
        """Return the range to the wall of the empty room for each sonar square to one, else None.

        The robot must stand along the x axis.
        """
        x_m, y_m = self.options.x_m, self.options.y_m
        by_heading = {0: ROOM_M[0] - x_m, 90: ROOM_M[1] - y_m, 180: x_m, -90: y_m}
        return {
            mount.name: by_heading[mount.heading_deg] - max(abs(mount.x_m), abs(mount.y_m))
            if mount.heading_deg in by_heading
            else None
            for mount in self.config.sonar
        }

    def listen(self) -> None:
        """Take in what the processes have published."""
        for truth in self._truths.receive():
            self._true.append(truth)
            if truth.unsafe_motions:
                self._unsafe = truth
        for message in self._states.receive():
            if isinstance(message, ControlState):
                self.control = message
                self.acks.update({ack.request_id: ack for ack in message.acks})
                if not self._history or message.stamp_ns - self._history[-1].stamp_ns > _TOLD_NS:
                    self._history.append(message)
            elif isinstance(message, NavigationState):
                self.navigation = message
            elif isinstance(message, Notice):
                self.notices.append(message.text)

    def assert_safe(self) -> None:
        """Assert that no motion on this bench was unsafe, as far as it is known.

        Raises
        ------
        UnsafeMotionError
            With the newest reason.
        """
        if self._unsafe is not None:
            raise UnsafeMotionError(f"{self._unsafe.unsafe_motions}: {self._unsafe.unsafe_reason}")

    def told(self) -> str:
        """Return what the processes have said of themselves last, in a line."""
        control, navigation = self.control, self.navigation
        state = "silent"
        if control:
            late = f"{control.loop.overruns} overruns, {control.loop.lag_us_max / 1000:.1f} ms late"
            state = f"{control.state.name} {control.reason!r}, {late} at most"
        mode = f"{navigation.mode.name} {navigation.message!r}" if navigation else "silent"
        return f"control: {state}; navigation: {mode}; notices: {self.notices[-5:]}"

    def history(self) -> str:
        """Return what the wheels did in the last seconds, a line each: wanted, counted, amperes."""
        now_ns = time.monotonic_ns()
        return "\n".join(
            f"{(state.stamp_ns - now_ns) / 1e9:+.3f} s {state.state.name}, rad/s: "
            f"{_numbers(state.wheel_ref_rad_s)} wanted, {_numbers(state.wheel_rad_s)} counted; "
            f"A: {_numbers(state.current_a)}"
            for state in self._history
        )

    def wait(self, condition: Callable[[], Any], seconds: float, what: str) -> None:
        """Wait until `condition()`, listening; fail with what was waited for and the last state."""
        deadline_s = time.monotonic() + seconds
        while True:
            self.listen()
            if condition():
                return
            if time.monotonic() > deadline_s:
                raise AssertionError(f"not within {seconds} s: {what}; {self.told()}")
            time.sleep(_POLL_S)

    def wait_for_state(self, state: SafetyState, seconds: float = PATIENT_S) -> ControlState:
        """Wait until the control process is in `state`."""
        self.wait(lambda: self.control and self.control.state == state, seconds, state.name)
        assert self.control is not None
        return self.control

    # Doing

    def arm(self) -> None:
        """Arm and wait for it."""
        self.wait_for(self.ask_to_arm, SafetyState.ARMED)

    def ask_to_arm(self) -> int:
        """Send one request to arm; return its number, by which `acks` has the answer."""
        number = next(self._ids)
        self._requests.send(Arm(time.monotonic_ns(), number, arm=True))
        return number

    def wait_for(self, ask: Callable[[], Any], state: SafetyState) -> None:
        """Ask now and each second until the control process is in `state`."""
        asked_s = 0.0

        def asked() -> bool:
            nonlocal asked_s
            if self.control is not None and self.control.state == state:
                return True
            if time.monotonic() - asked_s > 1.0:
                asked_s = time.monotonic()
                ask()
            return False

        self.wait(asked, PATIENT_S, state.name)

    def velocity(self, v_m_s: float, omega_rad_s: float, ttl_s: float = 1.0) -> None:
        """Send one velocity command."""
        now_ns = time.monotonic_ns()
        self._requests.send(
            VelocityCommand(now_ns, now_ns + round(ttl_s * 1e9), v_m_s, omega_rad_s)
        )

    def drive(self, v_m_s: float, omega_rad_s: float, seconds: float) -> None:
        """Hold a velocity for so long, refreshing the command at 20 Hz."""
        deadline_s = time.monotonic() + seconds
        while time.monotonic() < deadline_s:
            self.velocity(v_m_s, omega_rad_s)
            time.sleep(0.05)
            self.listen()

    def drive_to_the_middle(self, radius_m: float = CIRCLE_M) -> None:
        """Drive the armed robot, by its true pose, to where it has space in the empty room.

        The circle to the left of that radius has its centre near the middle then; 0: the robot is
        there itself. After a while on the circle, it need not drive anywhere for the next one.
        """
        deadline_s = time.monotonic() + 20.0
        while True:
            truth = self.fresh_truth()
            x_m, y_m = ROOM_M[0] / 2 - truth.x_m, ROOM_M[1] / 2 - truth.y_m
            ahead = math.cos(truth.theta_rad), math.sin(truth.theta_rad)
            if math.hypot(x_m + radius_m * ahead[1], y_m - radius_m * ahead[0]) < NEAR_M:
                return
            assert time.monotonic() < deadline_s, f"not in the middle: {truth}"
            error_rad = wrap_angle(math.atan2(y_m, x_m) - truth.theta_rad)
            self.drive(0.4 if abs(error_rad) < 0.5 else 0.0, 2.0 * error_rad, 0.1)

    def ask_for_mode(self, mode: Mode) -> None:
        """Ask the navigation process for a mode once."""
        self._to_navigation.send(SetMode(time.monotonic_ns(), mode))

    def guide(self, v_m_s: float, omega_rad_s: float, seconds: float) -> None:
        """Let navigation hold a velocity in GUIDED for so long."""
        deadline_s = time.monotonic() + seconds
        while time.monotonic() < deadline_s:
            now_ns = time.monotonic_ns()
            target = VelocityTarget(now_ns, now_ns + 1_000_000_000, v_m_s, omega_rad_s)
            self._to_navigation.send(target)
            time.sleep(0.05)
            self.listen()

    def set_mode(self, mode: Mode) -> None:
        """Ask the navigation process for a mode until it is in it."""
        asked_s = 0.0

        def asked() -> bool:
            nonlocal asked_s
            if self.navigation is not None and self.navigation.mode == mode:
                return True
            if time.monotonic() - asked_s > 0.5:
                asked_s = time.monotonic()
                self.ask_for_mode(mode)
            return False

        self.wait(asked, PATIENT_S, f"mode {mode.name}")

    def at_rest(self) -> None:
        """Wait until the true robot stands for a tenth of a second."""
        self.listen()
        mark = self.fresh_truth()

        def still() -> bool:
            nonlocal mark
            if self.truth.distance_m - mark.distance_m > 1e-4:
                mark = self.truth
            return self.truth.stamp_ns - mark.stamp_ns > 100_000_000

        self.wait(still, 10.0, "the wheels stand")

    def emergency_stop(self) -> None:
        """Ask the control process for an emergency stop."""
        stop = EmergencyStop(time.monotonic_ns(), EmergencyStopSource.TEST)
        self.wait(
            lambda: self._requests.send(stop), PATIENT_S, "the control process takes requests"
        )

    def rejected_frames(self) -> dict[str, int]:
        """Return how many commands the drive has rejected, by cause."""
        if "firmware" not in self._processes:
            return {}
        causes = {"CRC": 2, "counter": 3, "length or range": 4}
        counts = self.read_objects(DRIVE, [(0x2100, sub) for sub in causes.values()])
        return dict(zip(causes, counts, strict=True))
