"""The tap on a bus, beside python-can's own: it hears what others send, and is heard."""

import subprocess
import sys
import time

import can
import pytest

from robotctl.app.processes.can_tap import BusTap
from robotctl.drivers.can.config import CanConfig

PATIENT_S = 10.0


@pytest.fixture
def hub(tmp_path):
    """Return the channel of a simulated bus, and its process."""
    channel = str(tmp_path / "bus.sock")
    command = [sys.executable, "-m", "firmware_sim.bus", "--channel", channel]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    assert channel in process.stderr.readline()
    yield channel, process
    process.terminate()
    process.communicate(timeout=PATIENT_S)


def test_it_hears_data_frames_sends_some_and_survives_the_end_of_the_bus(hub):
    channel, process = hub
    tap = BusTap(CanConfig("simcan", channel))
    assert tap.receive() == []
    assert tap.open()
    assert tap.open()
    with can.Bus(interface="simcan", channel=channel) as other:
        other.send(can.Message(arbitration_id=0x181, data=b"\1\2\3", is_extended_id=False))
        heard, end_s = [], time.monotonic() + PATIENT_S
        while not heard and time.monotonic() < end_s:
            heard = tap.receive()
        assert heard == [(0x181, b"\1\2\3")]
        tap.send(0x601, b"\x40" + bytes(7))
        message = other.recv(PATIENT_S)
        assert (message.arbitration_id, bytes(message.data)) == (0x601, b"\x40" + bytes(7))
    process.terminate()
    process.wait(PATIENT_S)
    tap.receive()
    tap.receive()
    tap.send(0x601, bytes(8))
    assert not tap.open()
    tap.close()


def test_a_bus_that_is_not_there_is_not_opened(tmp_path):
    tap = BusTap(CanConfig("simcan", str(tmp_path / "none.sock")))
    assert not tap.open()
    assert tap.receive() == []
    tap.send(0x601, bytes(8))
    tap.close()
