"""A log of frames on a full disk ends; the bus does not."""

from pathlib import Path

from firmware_sim.bus.core import Bus
from firmware_sim.bus.log import LogWriter

FULL = Path("/dev/full")


def test_a_full_disk_ends_the_log_and_the_bus_goes_on(capsys) -> None:
    bus = Bus()
    heard = []
    sender = bus.attach("sender", lambda _: None)
    bus.attach("receiver", heard.append)
    with LogWriter(bus, FULL):
        for number in range(1000):
            sender.send(0x100 + number % 8, bytes(8))
            bus.advance(bus.now_ns + 1_000_000)
    assert len(heard) == 1000
    (line,) = capsys.readouterr().err.splitlines()
    assert line == "/dev/full: logging of frames stopped: No space left on device"
