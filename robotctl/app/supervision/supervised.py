"""One supervised process: start, readiness, detection of death or hang, restart."""

from __future__ import annotations

import enum
import math
import os
import signal
import subprocess
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from robotctl.app.supervision.child_process import start_child
from robotctl.app.supervision.pause import Pause, killed_for_memory, state_of
from robotctl.app.supervision.restart import CrashBudget, RestartPolicy
from robotctl.runtime.ipc.heartbeat import VARIABLE, HeartbeatMonitor

_LONGEST_STEP_S: Final = 0.5
"""Longest step that counts as silence of a process [s]; in a longer one the supervisor paused."""

_FIRST_VICTIM: Final = "500"
"""`oom_score_adj` of processes that the robot can spare for a while."""


class ProcessPhase(enum.Enum):
    """Phase of a process."""

    IDLE = "not started"
    STARTING = "starting"
    READY = "running"
    WAITING = "waiting to be restarted"
    GIVEN_UP = "given up"


@dataclass(frozen=True, slots=True)
class Role:
    """Settings of one kind of process.

    Parameters
    ----------
    module
        Its Python module.
    restart
        Back-off and crash budget.
    stall_s
        Time without progress after which a process hangs and is killed [s].
    start_s
        Time without progress after its start after which a process is killed [s].
    held_s
        Time without progress after which a running process is reported as stalled [s].
    vital
        Whether the whole stack ends when the budget of this process is spent.
    nice
        Nice value, -20 to 19; below 0 the kernel prefers the process to ordinary programs, where it
        has the right to (CAP_SYS_NICE). Not a real-time priority: what computes too much must not
        keep the emergency stop of page and ground station from the processor.
    """

    module: str
    restart: RestartPolicy
    stall_s: float
    start_s: float = 60.0
    held_s: float = math.inf
    vital: bool = False
    nice: int = 0

    @property
    def name(self) -> str:
        """Return the short name for people."""
        return self.module.rpartition(".")[2]


@dataclass(frozen=True, slots=True)
class Exit:
    """End of one run of a process.

    Parameters
    ----------
    name, pid
        Process concerned; pid 0: it could not be started.
    status
        Exit status; -n after signal n; errno where it could not be started.
    hung
        Whether it was killed for lack of progress.
    was_ready
        Whether it had worked before.
    asked
        Whether it was asked to end, because a process that it depends on restarts.
    beats
        Rounds of work done.
    ran_s
        Duration of the run [s].
    restart_in_s
        Pause before its restart [s]; None: it is not restarted.
    cause
        Known cause of its end; empty: none.
    """

    name: str
    pid: int
    status: int
    hung: bool
    was_ready: bool
    asked: bool
    beats: int
    ran_s: float
    restart_in_s: float | None
    cause: str = ""

    def words(self) -> str:
        """Return a line for people."""
        if self.asked and not self.hung:
            return f"{self.name} begins anew"
        how = status_words(self.status) if self.pid else f"not started: {os.strerror(self.status)}"
        if self.hung:
            how = f"it hung, {how}" if self.was_ready else f"it did not get ready, {how}"
        if self.cause:
            how += f": {self.cause}"
        line = f"{self.name} ended after {self.ran_s:.1f} s ({how}); "
        if self.restart_in_s is None:
            return line + "not restarted: it ended too often"
        return line + f"restarting it in {self.restart_in_s:g} s"


def status_words(status: int) -> str:
    """Return the end of a process as text: `exit status 1`, `signal 9, SIGKILL`."""
    if status >= 0:
        return f"exit status {status}"
    try:
        return f"signal {-status}, {signal.Signals(-status).name}"
    except ValueError:
        return f"signal {-status}"


class Supervised:
    """One process, across restarts.

    Parameters
    ----------
    role
        Module, budget and limits of the process.
    command
        Program and arguments.
    """

    def __init__(self, role: Role, command: Sequence[str]) -> None:
        self.role = role
        self.phase = ProcessPhase.IDLE
        self.starts = 0
        self.was_ready = False
        """Whether it ever worked, in this run or an earlier one."""
        self.command = list(command)
        """Program and arguments of the next start."""
        self._budget = CrashBudget(role.restart)
        self._process: subprocess.Popen[bytes] | None = None
        self._monitor: HeartbeatMonitor | None = None
        self._started_s = self._stepped_s = self._due_s = 0.0
        self._beats = 0
        self._stalled_s = 0.0
        self._hung = self._renewed = False
        self._reported_s = 0.0
        """Length of the pause when last reported [s]; 0: none."""
        self._cause = ""
        self._killed_for_memory = 0

    @property
    def pid(self) -> int | None:
        """Process id; None while there is no process."""
        return None if self._process is None else self._process.pid

    @property
    def beats(self) -> int:
        """Rounds of work in this run, or in the last one without a process."""
        monitor = self._monitor
        return self._beats if monitor is None else monitor.count()

    def start(self, now_s: float) -> None:
        """Start the process; raises OSError if memory or descriptors are short."""
        self.phase = ProcessPhase.STARTING
        self._started_s = self._stepped_s = now_s
        self._beats, self._stalled_s = 0, 0.0
        self._hung = self._renewed = False
        self._reported_s, self._cause = 0.0, ""
        self._killed_for_memory = killed_for_memory()
        monitor = self._monitor = HeartbeatMonitor()
        self._process = start_child(
            self.command,
            pass_fds=(monitor.descriptor,),
            env=os.environ | {VARIABLE: str(monitor.descriptor)},
        )
        if not self.role.vital:
            # Losing control costs the most: let the kernel sacrifice the others first.
            _kill_first_when_memory_is_short(self._process.pid)
        if self.role.nice:
            _prefer(self._process.pid, self.role.nice)
        self.starts += 1

    def let_start(self, now_s: float) -> None:
        """Let the next `step` start it; a failed first start is retried like any other."""
        self.phase, self._due_s = ProcessPhase.WAITING, now_s

    def step(self, now_s: float) -> Exit | Pause | None:
        """Supervise the process at `now_s`, monotonic [s].

        Returns its end if it has ended, or a pause that began or ended.
        """
        process = self._process
        if process is None:
            if self.phase is ProcessPhase.WAITING and now_s >= self._due_s:
                return self._start_again(now_s)
            return None
        status = process.poll()
        if status is not None:
            return self._ended(process.pid, status, now_s)
        return self._look_for_progress(process, now_s)

    def _start_again(self, now_s: float) -> Exit | None:
        """Restart the process; return its end if that fails."""
        try:
            self.start(now_s)
        except OSError as error:
            return self._ended(0, error.errno or 0, now_s)
        return None

    def _look_for_progress(self, process: subprocess.Popen[bytes], now_s: float) -> Pause | None:
        """Note progress; kill a process that has made none for too long."""
        beats = self.beats
        # A pause of the supervisor itself must not count as one of its processes.
        pause_s = min(now_s - self._stepped_s, _LONGEST_STEP_S)
        self._stepped_s = now_s
        if beats != self._beats:
            paused_s, self._stalled_s = self._stalled_s + pause_s, 0.0
            self._beats = beats
            self.phase = ProcessPhase.READY
            self.was_ready = True
            reported_s, self._reported_s = self._reported_s, 0.0
            return self._pause(process, paused_s, over=True) if reported_s else None
        self._stalled_s += pause_s
        patience_s = self.role.stall_s if self.phase is ProcessPhase.READY else self.role.start_s
        if self._stalled_s > patience_s:
            if not self._hung:  # once it is being killed its state is meaningless
                self._cause = state_of(process.pid)
            self._hung = True
            process.kill()
        elif (
            self.phase is ProcessPhase.READY
            and not self._reported_s
            and self._stalled_s > self.role.held_s
        ):
            self._reported_s, self._cause = self._stalled_s, state_of(process.pid)
            return self._pause(process, self._stalled_s, over=False)
        return None

    def _pause(self, process: subprocess.Popen[bytes], paused_s: float, *, over: bool) -> Pause:
        """Return the notice of a pause."""
        return Pause(self.role.name, process.pid, paused_s, self._cause, over)

    def _ended(self, pid: int, status: int, now_s: float) -> Exit:
        """Clean up after a process that ended, and plan its restart."""
        was_ready = self.phase is ProcessPhase.READY
        beats = self.beats
        self._forget()
        cause = self._cause if self._hung else ""
        if status == -signal.SIGKILL and killed_for_memory() > self._killed_for_memory:
            cause = "the computer was out of memory"
        # A requested restart is no crash and spends no budget.
        delay_s = 0.0 if self._renewed else self._budget.spend(now_s)
        self.phase = ProcessPhase.GIVEN_UP if delay_s is None else ProcessPhase.WAITING
        self._due_s = now_s + (delay_s or 0.0)
        ran_s = now_s - self._started_s
        return Exit(
            name=self.role.name,
            pid=pid,
            status=status,
            hung=self._hung,
            was_ready=was_ready,
            asked=self._renewed,
            beats=beats,
            ran_s=ran_s,
            restart_in_s=delay_s,
            cause=cause,
        )

    def _forget(self) -> None:
        """Release the resources of one run of the process."""
        self._process = None
        monitor, self._monitor = self._monitor, None
        if monitor is not None:
            monitor.close()

    def signal(self, number: int) -> bool:
        """Send a signal; return whether there was a process to take it."""
        if self._process is None or self._process.poll() is not None:
            return False
        self._process.send_signal(number)
        return True

    def renew(self) -> None:
        """Restart the process, without using its crash budget."""
        if self.signal(signal.SIGTERM):
            self._renewed = True

    def revive(self, now_s: float) -> None:
        """Restart the process, even one that was given up."""
        self.renew()
        if self.phase is ProcessPhase.GIVEN_UP:
            self._budget = CrashBudget(self.role.restart)
            self.let_start(now_s)

    def end(self, seconds: float) -> None:
        """Wait for the process to end, kill it after a time [s], and do not restart it."""
        self.phase = ProcessPhase.IDLE
        process = self._process
        if process is None:
            return
        try:
            process.wait(seconds)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        self._forget()


def _kill_first_when_memory_is_short(pid: int) -> None:
    """Let the kernel kill this process before the control process when memory is short."""
    try:
        Path(f"/proc/{pid}/oom_score_adj").write_text(_FIRST_VICTIM)
    except OSError:
        return  # it has ended already, or /proc is closed: then the kernel chooses by size


def _prefer(pid: int, nice: int) -> None:
    """Set the nice value of a process, and of the session that it is alone in.

    The kernel may share the processor among sessions first (sched(7), autogroups).
    """
    with suppress(OSError):  # no right to, or it has ended already
        os.setpriority(os.PRIO_PROCESS, pid, nice)
        Path(f"/proc/{pid}/autogroup").write_text(str(nice))
