"""Real-time rights of a process: priority, memory, processor, idle states, timers, collector."""

from __future__ import annotations

import ctypes
import gc
import os
import struct
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from robotctl.errors import InvalidValue

_MCL_CURRENT, _MCL_FUTURE, _MCL_ONFAULT = 1, 2, 4
_PR_SET_TIMERSLACK = 29

MAX_CPU: Final = 8191
"""Highest processor number of Linux; `robotctl doctor` checks which exist."""

IDLE_STATES: Final = Path("/dev/cpu_dma_latency")
"""Linux's PM QoS interface: the process that holds it open limits the wake-up latency."""


@dataclass(frozen=True, slots=True)
class LoopConfig:
    """The control loop.

    Parameters
    ----------
    rate_hz
        Control rate [Hz], 100 to 1000.
    priority
        SCHED_FIFO priority of the loop, 1 to 99; its helper threads are right below. 0 keeps the
        default scheduler.
    cpu
        Processor to run on, 0 to 8191; -1 leaves the choice to the kernel.
    wake_latency_us
        Maximum exit latency of idle states while the loop runs [us]; -1 leaves them to the kernel.
        0 lets idle processors of a PC spin: the least lag, especially in a virtual machine, for
        the most power.
    allow_best_effort
        Whether the robot arms although the computer refused a real-time right.
    """

    rate_hz: int = 200
    priority: int = 60
    cpu: int = -1
    wake_latency_us: int = 20
    allow_best_effort: bool = False

    def __post_init__(self) -> None:
        """Check the ranges."""
        if not 100 <= self.rate_hz <= 1000:
            raise InvalidValue("rate_hz", f"must be 100 to 1000, not {self.rate_hz}", self.rate_hz)
        if not 0 <= self.priority <= 99:
            raise InvalidValue("priority", f"must be 0 to 99, not {self.priority}", self.priority)
        if not -1 <= self.cpu <= MAX_CPU:
            raise InvalidValue("cpu", f"must be -1 to {MAX_CPU}, not {self.cpu}", self.cpu)
        if not -1 <= self.wake_latency_us <= 10_000:
            raise InvalidValue(
                "wake_latency_us",
                f"must be -1 to 10000, not {self.wake_latency_us}",
                self.wake_latency_us,
            )

    @property
    def period_ns(self) -> int:
        """Period of the loop [ns]."""
        return round(1_000_000_000 / self.rate_hz)


def acquire_realtime(config: LoopConfig) -> list[str]:
    """Acquire the rights that the machine grants; return one sentence for each that it refuses.

    Memory is locked as pages are touched (MCL_ONFAULT), which keeps the untouched stacks of
    library threads out of the resident set. The garbage collector is frozen and disabled: the
    hot path makes no reference cycles, and a full collection takes milliseconds. The last one is
    done before the priority is set, so that no other real-time process waits for it. The threads of
    ZeroMQ are right below the loop: a request to stop passes through them.
    """
    gc.collect()
    gc.freeze()
    gc.disable()
    refused = []
    if config.priority:
        try:
            _schedule_first(config.priority)
        except OSError as error:
            refused.append(
                f"SCHED_FIFO priority {config.priority} refused ({error.strerror}): expect late "
                "ticks; run as root or grant CAP_SYS_NICE"
            )
    if config.cpu >= 0:
        try:
            os.sched_setaffinity(0, {config.cpu})
        except OSError as error:
            allowed = sorted(os.sched_getaffinity(0))
            refused.append(f"processor {config.cpu} refused ({error.strerror}); allowed: {allowed}")
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.mlockall(_MCL_CURRENT | _MCL_FUTURE | _MCL_ONFAULT) != 0:
        reason = os.strerror(ctypes.get_errno())
        refused.append(f"locking memory refused ({reason}): grant CAP_IPC_LOCK or raise memlock")
    if config.wake_latency_us >= 0:
        refused += limit_wake_latency(config.wake_latency_us)
    # The default slack of 50 us would delay wake-ups if SCHED_FIFO was refused.
    libc.prctl(_PR_SET_TIMERSLACK, 1, 0, 0, 0)
    return refused


def _schedule_first(priority: int) -> None:
    """Take SCHED_FIFO for this thread, and one priority below it for the others of the process."""
    own = threading.get_native_id()
    # ZeroMQ's threads carry requests to stop, so they rank above ordinary load, below the loop.
    below = max(os.sched_get_priority_min(os.SCHED_FIFO), priority - 1)
    for thread in (int(task.name) for task in Path("/proc/self/task").iterdir()):
        taken = os.sched_param(priority if thread == own else below)
        os.sched_setscheduler(thread, os.SCHED_FIFO, taken)


def limit_wake_latency(latency_us: int, device: Path = IDLE_STATES) -> list[str]:
    """Keep processors from idle states that take longer than `latency_us` [us] to leave.

    The request holds while the device is open: until this process ends. Returns one sentence if it
    was refused. A machine without the device (a container, a kernel without idle states) is
    unchanged.
    """
    try:
        # Never closed on purpose: the kernel holds the request while the descriptor is open.
        descriptor = os.open(device, os.O_WRONLY | os.O_CLOEXEC)
        os.write(descriptor, struct.pack("=i", latency_us))
    except FileNotFoundError:
        return []
    except OSError as error:
        reason = f"limiting the wake-up time of idle processors refused ({error.strerror})"
        remedy = f"run as root, open {device} to this user, or set runtime.wake_latency_us=-1"
        return [f"{reason}: {remedy}"]
    return []
