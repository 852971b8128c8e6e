"""Real-time rights, as far as they can be asked for without taking them."""

import struct
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
