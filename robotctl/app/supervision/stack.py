"""The processes of one robot: started in order, watched, ended with the motors off first.

Control is started first and alone; the others follow when its loop ticks. It never waits for them,
whatever happens to navigation and telemetry. A control process that ended is
restarted too, because it starts disarmed and the drive has stopped on its own time-out; its
odometry continues from the saved pose, and navigation restarts.

On a restart request all processes start again in that order, with the stored parameters.
"""

from __future__ import annotations

import os
import signal
import time
from typing import Final, NoReturn

from robotctl.app.signing_files import configured_key
from robotctl.app.supervision.announcer import Announcer
from robotctl.app.supervision.pause import Pause
from robotctl.app.supervision.restart import RestartPolicy
from robotctl.app.supervision.supervised import Exit, ProcessPhase, Role, Supervised, status_words
from robotctl.config.changes import with_changes
from robotctl.config.options import StackOptions
from robotctl.errors import ConfigError, RobotctlError
from robotctl.logs.mcap.live import check_sdk
from robotctl.messages.control import Severity
from robotctl.messages.supervision import LIFE_NS, Restart
from robotctl.model.sensors.lidar import SOCKET
from robotctl.runtime.ipc.topics import Endpoints, endpoint_directory
from robotctl.words import counted

CONTROL = "robotctl.app.processes.control"
NAVIGATION = "robotctl.app.processes.navigation"
TELEMETRY = "robotctl.app.processes.telemetry"
RECORDER = "robotctl.app.processes.recorder"
CAMERA = "robotctl.app.processes.camera"
LIDAR = "robotctl.app.processes.lidar"
WEB = "robotctl.app.processes.web"
FOXGLOVE = "robotctl.app.processes.foxglove"

_DRIVES: Final = -10
"""Nice value of what the robot drives by, below control and above all else: about nine tenths of a
core that is shared with one busy program."""

ROLES: Final = (
    Role(CONTROL, RestartPolicy(crashes=3), stall_s=1.0, held_s=0.3, vital=True),
    Role(
        NAVIGATION, RestartPolicy(crashes=5), stall_s=5.0, start_s=300.0, held_s=1.0, nice=_DRIVES
    ),
    Role(TELEMETRY, RestartPolicy(crashes=5), stall_s=5.0, held_s=1.0),
    Role(RECORDER, RestartPolicy(crashes=5), stall_s=60.0, held_s=5.0),
)
"""Roles in the order of their start. Navigation may have to compile its estimators first, which
takes a minute on a small computer; the recorder waits for the disk, which may be slow."""

CAMERA_ROLE: Final = Role(
    CAMERA, RestartPolicy(crashes=5), stall_s=5.0, start_s=300.0, held_s=1.0, nice=_DRIVES
)
"""Camera process of robots with a camera. It compiles like navigation."""

LIDAR_ROLE: Final = Role(LIDAR, RestartPolicy(crashes=5), stall_s=5.0, held_s=1.0, nice=_DRIVES)
"""Lidar process of robots whose lidar is read by a driver of ours."""

WEB_ROLE: Final = Role(WEB, RestartPolicy(crashes=5), stall_s=5.0, held_s=1.0)
"""Web process of robots with a page."""

FOXGLOVE_ROLE: Final = Role(FOXGLOVE, RestartPolicy(crashes=5), stall_s=5.0, held_s=1.0)
"""Foxglove process of robots that allow it."""

_BAD_INPUT = 2
_END_S = 3.0
HELD_S: Final = 1.0
"""Pause of the supervisor itself above which it is reported [s]."""
_TICKS_TO_STOP = 2
"""Ticks until an emergency stop is in effect: a signal of one tick acts in the next."""


class StackError(RobotctlError):
    """A vital process of the robot ended, or cannot start."""


class Stack:
    """Control, navigation, telemetry, recorder and, if configured, camera, lidar and web page.

    Parameters
    ----------
    options
        Start options of the processes.

    Raises
    ------
    ConfigError
        If the robot's configuration is invalid, or its signing key cannot be read.
    """

    def __init__(self, options: StackOptions) -> None:
        self._options = options.validated()
        options, notes = with_changes(self._options)
        config = options.load()
        configured_key(config.mavlink)  # telemetry needs it, which starts when control runs
        roles: tuple[Role, ...] = ROLES
        if config.has_camera:
            roles += (CAMERA_ROLE,)
        if any(lidar.driver != SOCKET for lidar in config.lidars):
            roles += (LIDAR_ROLE,)
        if config.web.enabled:
            roles += (WEB_ROLE,)
        if config.web.foxglove:
            check_sdk()
            roles += (FOXGLOVE_ROLE,)
        self._processes = {
            role.module: Supervised(role, options.command(role.module)) for role in roles
        }
        self._control = self._processes[CONTROL]
        self._restarts = False
        self.shut_down = False
        """Whether it was asked to shut down all processes; the caller closes it."""
        self._stop_beats: int | None = None
        """Heartbeats of the control process when it last received an emergency stop."""
        self.exits: list[Exit | Pause] = []
        """Ends and pauses seen by the last `watch`, its own included."""
        self._announcer = Announcer(options.instance)
        # A file of a robot that ran before; a restarted web process keeps its own.
        Endpoints(endpoint_directory(options.instance)).web_links.unlink(missing_ok=True)
        self._clock = options.open_clock()
        self._watched_s: float | None = None
        for note in notes:
            self.tell(note, Severity.WARNING)
        self._control.start(self._now_s())

    @property
    def modules(self) -> tuple[str, ...]:
        """The modules of the processes, in the order of their start."""
        return tuple(self._processes)

    def pid(self, module: str) -> int:
        """Return the process id of `module`.

        Raises
        ------
        StackError
            If there is no process at the moment.
        """
        process = self._processes[module]
        if process.pid is None:
            raise StackError(f"{process.role.name} has no process: {process.phase.value}")
        return process.pid

    def phase(self, module: str) -> ProcessPhase:
        """Return the phase of `module`."""
        return self._processes[module].phase

    def starts(self, module: str) -> int:
        """Return the number of starts of `module`."""
        return self._processes[module].starts

    @property
    def ticks(self) -> tuple[int, int]:
        """Number of the control process's run, and the ticks of its loop in that run."""
        return self._control.starts, self._control.beats

    @property
    def ready(self) -> bool:
        """Whether the control loop ticks and the others work, or are no longer waited for."""
        return self._control.phase is ProcessPhase.READY and all(
            each.was_ready or each.phase is ProcessPhase.GIVEN_UP
            for each in self._processes.values()
        )

    def watch(self) -> list[str]:
        """Start, restart and kill as needed; return a line for each end and each pause.

        Ground stations and logs receive the same. Call ten times a second.

        Raises
        ------
        StackError
            If the control process ended too often, or a process never starts.
        """
        now_s = self._now_s()
        self.exits = self._own_pause(now_s)
        for pause in self.exits:
            self.tell(pause.words(), _severity(pause, vital=False))
        if self._control.phase is ProcessPhase.READY:
            self._announcer.open()
        self._announcer.step(self._clock.now_ns())
        self._take_requests()
        for process in self._processes.values():
            if process.phase is ProcessPhase.IDLE and self._control.phase is ProcessPhase.READY:
                process.let_start(now_s)
            starts = process.starts
            seen = process.step(now_s)
            if seen is not None:
                self.exits.append(seen)
                self.tell(seen.words(), _severity(seen, vital=process.role.vital))
            if isinstance(seen, Exit):
                self._judge(process, seen)
            elif process is self._control:
                self._repeat_emergency_stop(new_life=process.starts > starts)
        return [each.words() for each in self.exits]

    def _now_s(self) -> float:
        """Return the robot's time [s]: no process makes progress while it is paused."""
        return self._clock.now_ns() / 1e9

    def _own_pause(self, now_s: float) -> list[Exit | Pause]:
        """Return the pause of this process, if there was one; no other process reports it."""
        before_s, self._watched_s = self._watched_s, now_s
        if before_s is None or now_s - before_s < HELD_S:
            return []
        return [Pause("the supervisor", os.getpid(), now_s - before_s, "", over=True)]

    def tell(self, line: str, severity: Severity = Severity.INFORMATION) -> None:
        """Publish the supervisor's notices to ground stations and logs."""
        self._announcer.say(line, severity, self._clock.now_ns())

    def _judge(self, process: Supervised, ended: Exit) -> None:
        """Handle the consequences of a process's end for the others."""
        name = process.role.name
        # Bad input stays bad: a restart would only hide it.
        if ended.status == _BAD_INPUT and not process.was_ready:
            self._fail(f"the {name} process did not start ({status_words(ended.status)})")
        if process is not self._control:
            return
        if process.phase is ProcessPhase.GIVEN_UP:
            self._fail(
                f"the {name} process ended "
                f"{counted(process.role.restart.crashes + 1, 'time')} within "
                f"{process.role.restart.window_s:g} s ({status_words(ended.status)})"
            )
        if self._restarts:
            self._restarts = False
            self._start_others_again()
            return
        # Navigation restarts with control: its poses belong to the odometry that ended.
        self._processes[NAVIGATION].renew()

    def _take_requests(self) -> None:
        """Execute requests that are not too old."""
        for request in self._announcer.take_requests():
            if self._clock.now_ns() - request.stamp_ns > LIFE_NS:
                continue
            if isinstance(request, Restart):
                self.restart()
            else:
                self.tell("shutting down, as a ground station asked", Severity.WARNING)
                self.shut_down = True

    def restart(self) -> None:
        """Restart all processes, control first, with the stored parameters."""
        options, notes = with_changes(self._options)
        try:
            configured_key(options.load().mavlink)
        except ConfigError as error:
            self.tell(f"no restart, for telemetry would not come back: {error}", Severity.WARNING)
            return
        self.tell("restarting, as a ground station asked")
        for note in notes:
            self.tell(note, Severity.WARNING)
        for module, process in self._processes.items():
            process.command = options.command(module)
        if self._control.phase is ProcessPhase.READY:
            self._restarts = True
            self._control.renew()
        else:
            self._start_others_again()

    def _start_others_again(self) -> None:
        """Restart all processes but control."""
        for process in self._processes.values():
            if process is not self._control:
                process.revive(self._now_s())

    def _fail(self, problem: str) -> NoReturn:
        """Give up; tell the remaining processes why."""
        self.tell(f"robotctl ends: {problem}", Severity.CRITICAL)
        raise StackError(problem)

    def emergency_stop(self) -> None:
        """Stop the robot by a signal to the control process; needs no socket, waits for nothing.

        A control process that is restarting receives it as soon as it is up. May be called
        from a signal handler.
        """
        # A signal only, because this may run in a signal handler.
        self._stop_beats = self._control.beats
        self._control.signal(signal.SIGUSR1)

    def _repeat_emergency_stop(self, *, new_life: bool) -> None:
        """Repeat an emergency stop to a new control process if the previous one did not answer."""
        if self._stop_beats is None:
            return
        if new_life:
            self._stop_beats = 0
            self._control.signal(signal.SIGUSR1)
        elif self._control.beats >= self._stop_beats + _TICKS_TO_STOP:
            self._stop_beats = None

    def close(self) -> None:
        """End all processes, control first, and wait for them."""
        for process in self._processes.values():
            process.signal(signal.SIGTERM)
        deadline_s = time.monotonic() + _END_S
        for process in self._processes.values():
            process.end(max(0.0, deadline_s - time.monotonic()))
        self._announcer.close()


def _severity(seen: Exit | Pause, *, vital: bool) -> Severity:
    """Return the severity of an end or a pause."""
    if isinstance(seen, Pause):
        return Severity.NOTICE if seen.over else Severity.WARNING
    if seen.asked and not seen.hung:
        return Severity.INFORMATION
    return Severity.CRITICAL if vital else Severity.WARNING
