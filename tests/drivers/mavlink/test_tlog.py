"""Records of links, read by pymavlink."""

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import common as m

from robotctl.drivers.mavlink import tlog
from robotctl.drivers.mavlink.base import Channel, LinkContext
from robotctl.drivers.mavlink.signing import Signing
from robotctl.drivers.mavlink.tlog import TlogRecorder
from robotctl.messages.mavlink_port import Peer

WALL_NS = 1_700_000_000_123_456_000


@pytest.fixture
def recorder(tmp_path):
    found = TlogRecorder(tmp_path / "tlogs", lambda: WALL_NS)
    yield found
    found.close()


def files(folder):
    return sorted(path.name for path in folder.glob("*"))


def test_pymavlink_reads_what_was_sent_and_taken_with_its_time_and_no_key(recorder, tmp_path):
    channel = Channel(Peer(1, 0), LinkContext(None, [], 1, 1, Signing(), recorder))
    station = m.MAVLink(None, 255, 190)
    channel.encode(m.MAVLink_heartbeat_message(10, 3, 0, 4, 4, 3))
    for sent in (
        m.MAVLink_setup_signing_message(1, 1, [7] * 32, 0),
        m.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0),
    ):
        channel.reader.feed(bytes(sent.pack(station)) + b"noise", 1)
    recorder.flush(2 * 10**9)
    assert files(tmp_path / "tlogs") == ["link1-0001.tlog"]
    log = mavutil.mavlink_connection(str(tmp_path / "tlogs" / "link1-0001.tlog"))
    read = [log.recv_msg() for _ in range(3)]
    log.close()
    assert [each and each.get_type() for each in read] == ["HEARTBEAT", "COMMAND_LONG", None]
    assert [each.get_srcSystem() for each in read[:2]] == [1, 255]
    assert read[0]._timestamp == pytest.approx(WALL_NS / 1e9)


def test_files_are_bounded_and_the_oldest_go(recorder, tmp_path, monkeypatch):
    monkeypatch.setattr(tlog, "MOST_BYTES", 100)
    monkeypatch.setattr(tlog, "MOST_FILES", 3)
    (tmp_path / "tlogs").mkdir()
    (tmp_path / "tlogs" / "link0-mine.tlog").write_bytes(b"")
    for _ in range(50):
        recorder.record(0, bytes(30))
    names = files(tmp_path / "tlogs")
    assert len(names) == 4
    assert "link0-mine.tlog" in names
    assert names[0] == "link0-0015.tlog"


def test_a_disk_that_takes_nothing_ends_the_record_alone(tmp_path):
    (tmp_path / "file").write_bytes(b"")
    recorder = TlogRecorder(tmp_path / "file" / "tlogs")
    recorder.record(0, b"frame")
    recorder.record(0, b"frame")
    recorder.flush(10**12)
    assert "nothing is recorded" in recorder.take_trouble()
    assert recorder.take_trouble() == ""
