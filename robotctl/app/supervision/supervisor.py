"""The supervisor of a robot: processes, exit log, and notifications to systemd."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, TypeAlias

from robotctl.app.supervision.exit_log import ExitLog
from robotctl.app.supervision.service import ServiceNotifier
from robotctl.app.supervision.silence import silence
from robotctl.app.supervision.stack import CONTROL, Stack
from robotctl.app.supervision.supervised import ProcessPhase
from robotctl.messages.control import ControlState, NavigationState, Notice

Message: TypeAlias = ControlState | NavigationState | Notice

POLL_S: Final = 0.1
"""Interval between two steps of the supervisor [s]."""

_POLL_NS: Final = round(POLL_S * 1e9)
"""Interval between two reads of states [ns], longer than that of their publication."""


class Supervisor:
    """Watches a stack and reports on it; use as a context manager.

    The watchdog is fed when the control loop has ticked since it was fed last, and only then: a
    supervisor that is alive proves nothing about the robot.

    Parameters
    ----------
    stack
        Started processes.
    notifier
        Notifier of the service manager.
    log
        Log of ends of processes, if any.
    """

    def __init__(self, stack: Stack, notifier: ServiceNotifier, log: ExitLog | None) -> None:
        self._stack = stack
        self._notifier = notifier
        self._log = log
        self._ready = False
        self._state: ControlState | None = None
        self._fed_s = 0.0
        self._fed_ticks = (0, 0)

    def __enter__(self) -> Supervisor:
        """Report the begin of the start."""
        self._notifier.status("starting")
        return self

    def __exit__(self, *_error: object) -> None:
        """End the processes, control first."""
        self._notifier.stopping()
        self._notifier.status("stopping")
        self._stack.close()
        self._notifier.close()

    def step(self, messages: Sequence[Message], now_s: float) -> list[str]:
        """Supervise the stack at `now_s`, monotonic [s]; return lines for people.

        Parameters
        ----------
        messages
            Messages from the processes since the last step.
        now_s
            Monotonic time [s].

        Raises
        ------
        StackError
            As for `Stack.watch`; the end is logged first.
        """
        lines = self.last_words(messages)
        own: list[str] = []
        for message in messages:
            if isinstance(message, ControlState):
                self._state = message
        try:
            lines += self._stack.watch()
        finally:
            own += self._log_exits()
        if not self._ready and self._stack.ready and self._notifier.ready():
            self._ready = True
            own.append("ready: " + self._processes())
        for line in own:
            self._stack.tell(line)
        lines += own
        self._feed(now_s)
        self._notifier.status(self._status(now_s))
        return lines

    def last_words(self, messages: Sequence[Message]) -> list[str]:
        """Return what the processes have said before they are ended; do nothing else."""
        return [message.text for message in messages if isinstance(message, Notice)]

    def _log_exits(self) -> list[str]:
        """Log the ends and pauses of this step; return the errors of doing so."""
        return [] if self._log is None else self._log.note(self._stack.exits)

    def _feed(self, now_s: float) -> None:
        """Feed the watchdog if the control loop has made progress."""
        feed_s, ticks = self._notifier.feed_s, self._stack.ticks
        if feed_s is None or now_s - self._fed_s < feed_s:
            return
        if ticks == self._fed_ticks or ticks[1] == 0:
            return
        self._fed_s, self._fed_ticks = now_s, ticks
        self._notifier.feed_watchdog()

    def _status(self, now_s: float) -> str:
        """Return the robot's state at a time [s] and that of its processes in one line."""
        state = self._state
        if state is None or self._stack.phase(CONTROL) is not ProcessPhase.READY:
            return self._processes()
        words = state.state.name.lower().replace("_", " ")
        reason = f" ({state.reason})" if state.reason else ""
        silent = silence("control", state.stamp_ns, round(now_s * 1e9), _POLL_NS)
        if silent:
            return f"{silent} (before: {words}{reason}); {self._processes()}"
        return f"{words}{reason}; {self._processes()}"

    def _processes(self) -> str:
        """Return the phase of each process."""
        return ", ".join(
            f"{module.rpartition('.')[2]} {self._stack.phase(module).value}"
            for module in self._stack.modules
        )
