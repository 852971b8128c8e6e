"""Measures the wake-up latency of a real-time process on this computer.

It is a separate process, since real-time rights cannot be given back:
`python -m robotctl.deploy.wakeup OPTIONS SECONDS` prints one line of JSON.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import msgspec

from robotctl.deploy.check_result import Finding, fail, ok, warn
from robotctl.runtime.clock import RealClock
from robotctl.runtime.loop import Loop
from robotctl.runtime.realtime import LoopConfig, acquire_realtime

_SLACK_LIMIT_NS = 1_000
_LATE_SHARE = 0.1
_TOO_LATE_SHARE = 0.5
_MARGIN_S = 30.0


class Wakeups(msgspec.Struct, frozen=True):
    """The measurement.

    Attributes
    ----------
    refused
        Sentences of `acquire_realtime`.
    slack_ns
        Timer slack of the process [ns]; -1: unknown.
    ticks, overruns
        Wake-ups, and those a whole period late.
    lag_us_p50, lag_us_p99, lag_us_max
        Wake-up latency after the deadline [us].
    period_us
        Period of the deadlines [us].
    """

    refused: tuple[str, ...]
    slack_ns: int
    ticks: int
    overruns: int
    lag_us_p50: float
    lag_us_p99: float
    lag_us_max: float
    period_us: float


class _Idle:
    """A tick without work."""

    def receive(self, now_ns: int) -> None:
        """Do nothing with inputs."""

    control = send = publish = receive


def measure(config: LoopConfig, seconds: float) -> Wakeups:
    """Tick idly for a time [s], with the rights of the control loop."""
    refused = acquire_realtime(config)
    clock = RealClock()
    loop = Loop(clock, config.period_ns)
    end_ns = clock.now_ns() + round(seconds * 1e9)
    loop.run(_Idle(), lambda: clock.now_ns() >= end_ns)
    loop.refresh(whole=True)
    statistics = loop.statistics()
    return Wakeups(
        tuple(refused),
        _timer_slack_ns(),
        statistics.ticks,
        statistics.overruns,
        statistics.lag_us_p50,
        statistics.lag_us_p99,
        statistics.lag_us_max,
        config.period_ns / 1000,
    )


def _timer_slack_ns() -> int:
    """Return the timer slack of this process [ns], -1 if unknown."""
    try:
        return int(Path("/proc/self/timerslack_ns").read_text())
    except OSError:
        return -1


def measure_in_a_process(config: LoopConfig, seconds: float) -> Wakeups:
    """Call `measure` in a separate process.

    Raises
    ------
    subprocess.SubprocessError, msgspec.DecodeError
        If that process fails.
    """
    text = msgspec.json.encode(config).decode()
    done = subprocess.run(  # noqa: S603 - our own module
        [sys.executable, "-m", "robotctl.deploy.wakeup", text, str(seconds)],
        capture_output=True,
        timeout=seconds + _MARGIN_S,
        check=True,
    )
    return msgspec.json.decode(done.stdout, type=Wakeups)


def check_rights(wakeups: Wakeups, user: str) -> Finding:
    """Check that no real-time right was refused to `user`."""
    check = "real-time rights"
    if not wakeups.refused:
        return ok(check, f"priority, locked memory and idle states granted to {user}")
    return fail(
        check,
        f"as {user}: {'; '.join(wakeups.refused)}",
        "run as root to check the computer; `robotctl install` grants the service these rights",
    )


def check_timer_slack(wakeups: Wakeups) -> Finding:
    """Check that the kernel does not delay wake-ups to save power."""
    check = "timer slack"
    if wakeups.slack_ns <= _SLACK_LIMIT_NS:
        return ok(check, f"{wakeups.slack_ns} ns" if wakeups.slack_ns >= 0 else "unknown")
    return warn(
        check, f"{wakeups.slack_ns} ns", f"allow a timer slack under {_SLACK_LIMIT_NS} ns"
    )  # fmt: skip


def check_lag(wakeups: Wakeups) -> Finding:
    """Check wake-ups: p99 within a tenth of a period, none half a period late."""
    check = "wake-up lag"
    words = (
        f"p50 {wakeups.lag_us_p50:.0f}, p99 {wakeups.lag_us_p99:.0f}, max "
        f"{wakeups.lag_us_max:.0f} us in {wakeups.ticks} ticks of {wakeups.period_us:.0f} us"
    )
    fix = "fix kernel, governor and isolation as described above; stop other programs"
    if wakeups.lag_us_max > _TOO_LATE_SHARE * wakeups.period_us:
        return fail(check, f"{words}: more than half a period late", fix)
    if wakeups.lag_us_p99 > _LATE_SHARE * wakeups.period_us:
        return warn(check, f"{words}: p99 over a tenth of the period", fix)
    return ok(check, words)


if __name__ == "__main__":
    _config = msgspec.json.decode(sys.argv[1], type=LoopConfig)
    sys.stdout.buffer.write(msgspec.json.encode(measure(_config, float(sys.argv[2]))))
