"""Real-time rights, as far as they can be asked for without taking them."""

import os
import struct
import subprocess
import sys
from pathlib import Path

import pytest

from robotctl.runtime.realtime import LoopConfig, limit_wake_latency


def test_the_wake_latency_is_written_as_the_kernel_wants_it(tmp_path: Path) -> None:
    device = tmp_path / "cpu_dma_latency"
    device.touch()
    assert limit_wake_latency(20, device) == []
    assert device.read_bytes() == struct.pack("=i", 20)


def test_a_machine_without_the_device_is_left_as_it_is(tmp_path: Path) -> None:
    assert limit_wake_latency(20, tmp_path / "missing") == []


def test_a_refusal_says_what_would_help(tmp_path: Path) -> None:
    (sentence,) = limit_wake_latency(20, tmp_path)  # a directory cannot be written
    assert "wake_latency_us=-1" in sentence
    assert str(tmp_path) in sentence


@pytest.mark.parametrize("latency_us", [-2, 10_001])
def test_a_wake_latency_out_of_range_is_refused(latency_us: int) -> None:
    with pytest.raises(ValueError, match="wake_latency_us must be -1 to 10000"):
        LoopConfig(wake_latency_us=latency_us)


@pytest.mark.parametrize("cpu", [-2, 8192])
def test_a_processor_that_no_machine_has_is_refused(cpu: int) -> None:
    with pytest.raises(ValueError, match=f"cpu must be -1 to 8191, not {cpu}"):
        LoopConfig(cpu=cpu)


THREADS = """
import gc, os, threading
from robotctl.runtime.realtime import LoopConfig, acquire_realtime

ended = threading.Event()
thread = threading.Thread(target=ended.wait)
thread.start()
print(acquire_realtime(LoopConfig(priority=PRIORITY, wake_latency_us=-1)))
for task in (0, thread.native_id):
    print(os.sched_getscheduler(task), os.sched_getparam(task).sched_priority)
print(gc.isenabled(), gc.get_freeze_count() > 0)
ended.set()
"""


@pytest.mark.parametrize(("priority", "below"), [(60, 59), (1, 1)])
def test_the_loop_comes_first_and_the_threads_that_serve_it_right_below(
    priority: int, below: int
) -> None:
    script = THREADS.replace("PRIORITY", str(priority))
    ended = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=60
    )
    refused, loop, thread, collector = ended.stdout.splitlines()
    if f"SCHED_FIFO priority {priority} refused" in refused:
        assert loop == thread == f"{os.SCHED_OTHER} 0"
    else:
        assert loop == f"{os.SCHED_FIFO} {priority}"
        assert thread == f"{os.SCHED_FIFO} {below}"
    assert collector == "False True"
