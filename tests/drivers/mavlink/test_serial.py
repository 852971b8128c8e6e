"""Serial lines, on a pseudo-terminal."""

import os
import tty

import pytest

from tests.drivers.mavlink.bench import decode, frame, readable


@pytest.fixture
def pseudo_terminal(tmp_path):
    """Return a function that makes a serial line at a fixed path: (our end, path)."""
    path = tmp_path / "tty"
    descriptors = []

    def make():
        ours, theirs = os.openpty()
        tty.setraw(theirs)
        path.unlink(missing_ok=True)
        path.symlink_to(os.ttyname(theirs))
        os.close(theirs)
        os.set_blocking(ours, False)
        descriptors.append(ours)
        return ours

    def unplug():
        os.close(descriptors.pop())

    yield make, unplug, path
    for descriptor in descriptors:
        os.close(descriptor)


def test_a_serial_line_carries_frames_and_is_reopened_after_unplugging(
    party, pseudo_terminal, eventually
):
    make, unplug, path = pseudo_terminal
    robot = party(f"serial:{path}:57600")
    robot.step()
    assert not robot.status().open
    assert robot.status().errors == 1
    for life in range(2):
        line = make()
        robot.offset_ns += 10_000_000_000
        eventually(lambda: robot.status().open, robot.step)
        os.write(line, b"boot noise" + frame())
        eventually(lambda life=life: len(robot.received) == life + 1, robot.step)
        robot.send()
        eventually(lambda line=line: readable(line), robot.step)
        assert [m.get_type() for m in decode(os.read(line, 4096))] == ["HEARTBEAT"]
        unplug()
        eventually(lambda: not robot.status().open, robot.step)
    assert robot.status().opened == 2
    assert robot.status().bad_bytes == 2 * len(b"boot noise")


def test_a_serial_line_that_takes_nothing_drops_telemetry(party, pseudo_terminal, eventually):
    make, _, path = pseudo_terminal
    make()
    robot = party(f"serial:{path}:57600")
    eventually(lambda: robot.status().open, robot.step)
    for _ in range(2000):
        robot.send()
    assert robot.status().dropped > 0
    assert robot.status().open


def test_a_device_that_is_no_serial_line_is_an_error_of_the_link(party):
    robot = party("serial:/dev/null:57600", "serial:/nowhere/tty:57600")
    robot.step()
    assert [status.open for status in robot.links.status()] == [False, False]
    assert all(status.last_error for status in robot.links.status())
