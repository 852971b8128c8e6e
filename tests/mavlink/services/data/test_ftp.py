"""Files over MAVLink: a client's side, over links that lose, repeat and reorder."""

import json
import random
import zlib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink import mavftp
from pymavlink.dialects.v20 import common as m

from robotctl.app.processes.served_folder import ServedFolder
from robotctl.config.robot_file import contradictions, find_file, load_robot
from robotctl.mavlink.ftp.payload import FtpError, FtpPayload, Opcode, unpack
from robotctl.mavlink.ftp.server import BURST_PARTS, IDLE_NS
from robotctl.mavlink.parameters.parameter_set import Configurations, ParameterSet
from robotctl.mavlink.telemetry import Telemetry
from robotctl.messages.mavlink_port import Peer
from tests.mavlink.conftest import Bench

CONFIG = load_robot(find_file("diff_drive"))
FIRST, SECOND = Peer(0, 0), Peer(1, 0)
TEXT = bytes(random.Random(1).randbytes(5000))


def bench_in(folder):
    """Return a robot that serves a folder with own files, and one with logs."""
    (folder / "own").mkdir()
    (folder / "logs" / "run").mkdir(parents=True)
    (folder / "logs" / "run" / "control.log").write_bytes(TEXT)
    (folder / "secret").write_bytes(b"of nobody's concern")
    bench = Bench(2)
    bench.parameters = ParameterSet(Configurations(CONFIG, CONFIG, contradictions), {})
    bench.telemetry = Telemetry(
        bench.config,
        bench.robot,
        bench.links,
        parameters=bench.parameters,
        folders={
            "": ServedFolder(folder / "own", writable=True),
            "@LOGS": ServedFolder(folder / "logs", writable=False),
        },
    )
    return bench


@pytest.fixture
def bench(tmp_path):
    return bench_in(tmp_path)


class Client:
    """A client that repeats what is not answered; `loss` is the share lost each way."""

    def __init__(self, bench, peer=FIRST, seed=None, loss=0.0):
        self.bench, self.peer, self.loss = bench, peer, loss
        self.rng = random.Random(seed)
        self.seq = 0
        self.session = 0

    def times(self):
        if not self.loss:
            return 1
        return 0 if self.rng.random() < self.loss else self.rng.choice((1, 1, 1, 2))

    def exchange(self, request, steps=1):
        """Send a request once, over the link; return what comes."""
        message = m.MAVLink_file_transfer_protocol_message(0, 1, 1, request.pack())
        for _ in range(self.times()):
            self.bench.receive(message, peer=self.peer)
        came = []
        for _ in range(steps):
            self.bench.step(self.bench.control(), advance_s=0.01)
            for reply, to in self.bench.take("FILE_TRANSFER_PROTOCOL"):
                if to == self.peer:
                    came += [unpack(bytes(reply.payload))] * self.times()
        if self.loss:
            self.rng.shuffle(came)
        return came

    def request(self, opcode, data=b"", offset=0, size=0, session=None):
        session = self.session if session is None else session
        self.seq = (self.seq + 1) % 0x10000
        data = data.encode() if isinstance(data, str) else data
        return FtpPayload(self.seq, session, opcode, data, offset, size)

    def ask(self, opcode, data=b"", offset=0, size=0, session=None):
        """Return the answer to a request, which is repeated until it has come."""
        request = self.request(opcode, data, offset, size, session)
        for _ in range(50):
            for reply in self.exchange(request, 3):
                if reply.seq == (request.seq + 1) & 0xFFFF and reply.req_opcode == opcode:
                    return reply
        raise AssertionError("no answer")

    def refusal(self, *arguments, **options):
        reply = self.ask(*arguments, **options)
        assert reply.opcode == Opcode.NAK
        return FtpError(reply.data[0])

    def open(self, path, opcode=Opcode.OPEN_FILE_RO):
        reply = self.ask(opcode, path)
        assert reply.opcode == Opcode.ACK, reply
        self.session = reply.session
        return int.from_bytes(reply.data, "little")

    def burst(self, path, size=0):
        """Return a file as clients read it: bursts, then the gaps one by one."""
        length = self.open(path)
        step = size or 239
        parts = {}
        for _ in range(100):
            begin = next((at for at in range(0, length, step) if at not in parts), None)
            if begin is None:
                break
            request = self.request(Opcode.BURST_READ_FILE, offset=begin, size=size)
            for reply in self.exchange(request, 80):
                if reply.opcode == Opcode.ACK and reply.req_opcode == Opcode.BURST_READ_FILE:
                    parts[reply.offset] = reply.data
        self.ask(Opcode.TERMINATE_SESSION)
        return b"".join(parts[at] for at in sorted(parts))

    def upload(self, path, content):
        self.open(path, Opcode.CREATE_FILE)
        for at in range(0, len(content), 239):
            assert self.ask(Opcode.WRITE_FILE, content[at : at + 239], at).opcode == Opcode.ACK
        self.ask(Opcode.TERMINATE_SESSION)

    def names(self, path):
        found = []
        while (reply := self.ask(Opcode.LIST_DIRECTORY, path, len(found))).opcode == Opcode.ACK:
            found += reply.data.rstrip(b"\0").decode().split("\0")
        assert reply.data[0] == FtpError.END_OF_FILE
        return found


def test_a_folder_is_listed_in_as_many_parts_as_it_takes(bench, tmp_path):
    for number in range(60):
        (tmp_path / "own" / f"file_{number:02}").write_bytes(b"x" * number)
    (tmp_path / "own" / "way_out").symlink_to(tmp_path)
    names = Client(bench).names("/")
    assert names[:3] == ["D@LOGS", "D@META", "D@PARAM"]
    assert names[3:] == [f"Ffile_{number:02}\t{number}" for number in range(60)]
    assert Client(bench).names("@LOGS/run") == ["Fcontrol.log\t5000"]


@pytest.mark.parametrize("loss", [0.0, 0.2])
@pytest.mark.parametrize("size", [0, 80])
def test_a_burst_brings_the_file_over_a_clean_and_a_bad_link(bench, loss, size):
    assert Client(bench, seed=3, loss=loss).burst("@LOGS/run/control.log", size) == TEXT


@pytest.mark.parametrize("loss", [0.0, 0.2])
def test_what_is_written_is_read_again_and_has_the_right_checksum(bench, tmp_path, loss):
    client = Client(bench, seed=5, loss=loss)
    client.upload("/a.bin", TEXT[:2000])
    assert (tmp_path / "own" / "a.bin").read_bytes() == TEXT[:2000]
    crc = client.ask(Opcode.CALC_FILE_CRC32, "a.bin").data
    assert int.from_bytes(crc, "little") == crc_bit_by_bit(TEXT[:2000])
    assert client.burst("a.bin") == TEXT[:2000]
    client.ask(Opcode.REMOVE_FILE, "a.bin")
    assert list((tmp_path / "own").iterdir()) == []


def crc_bit_by_bit(data):
    """CRC-32 with the reflected polynomial, from 0, not inverted: as the protocol's page has it."""
    crc = 0
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc >> 1) ^ (0xEDB88320 if crc & 1 else 0)
    return crc


def test_a_burst_says_where_it_ends_and_one_from_the_end_on_is_refused(bench):
    client = Client(bench)
    client.open("@LOGS/run/control.log")
    parts = client.exchange(client.request(Opcode.BURST_READ_FILE), 20)
    assert [part.burst_complete for part in parts] == [0] * 20 + [1]
    assert [part.seq for part in parts] == [client.seq + 1 + n for n in range(21)]
    (end,) = client.exchange(client.request(Opcode.BURST_READ_FILE, offset=5000), 3)
    assert (end.opcode, end.data[0]) == (Opcode.NAK, FtpError.END_OF_FILE)
    assert client.refusal(Opcode.READ_FILE, offset=5000, size=10) == FtpError.END_OF_FILE
    assert client.ask(Opcode.READ_FILE, offset=4995, size=10).data == TEXT[4995:]
    assert BURST_PARTS * 239 > 5000


def test_a_repeated_request_is_answered_as_before_and_not_carried_out_again(bench, tmp_path):
    client = Client(bench)
    remove = client.request(Opcode.REMOVE_FILE, "a")
    (tmp_path / "own" / "a").touch()
    assert client.exchange(remove) == client.exchange(remove)
    opening = client.request(Opcode.OPEN_FILE_RO, "@PARAM/param.pck")
    assert client.exchange(opening) == client.exchange(opening)
    client.ask(Opcode.OPEN_FILE_RO, "@PARAM/param.pck", session=7)  # the second, not the third


def test_two_sessions_are_read_side_by_side_and_a_third_waits(bench, tmp_path):
    (tmp_path / "own" / "b").write_bytes(b"other")
    client, other = Client(bench), Client(bench, SECOND)
    first = client.ask(Opcode.OPEN_FILE_RO, "@LOGS/run/control.log").session
    second = client.ask(Opcode.OPEN_FILE_RO, "b").session
    assert first != second
    assert client.refusal(Opcode.OPEN_FILE_RO, "b") == FtpError.NO_SESSIONS_AVAILABLE
    assert client.ask(Opcode.READ_FILE, size=5, session=second).data == b"other"
    assert client.ask(Opcode.READ_FILE, size=5, session=first).data == TEXT[:5]
    # Another client's sessions are its own.
    assert other.refusal(Opcode.READ_FILE, size=5, session=first) == FtpError.INVALID_SESSION
    other.ask(Opcode.RESET_SESSIONS)
    assert client.ask(Opcode.READ_FILE, size=5, session=first).data == TEXT[:5]
    client.ask(Opcode.RESET_SESSIONS)
    assert client.refusal(Opcode.TERMINATE_SESSION, session=first) == FtpError.INVALID_SESSION
    client.ask(Opcode.OPEN_FILE_RO, "b", session=9)
    bench.step(bench.control(), advance_s=IDLE_NS * 1e-9 + 1.0)
    assert client.refusal(Opcode.READ_FILE, size=5, session=9) == FtpError.INVALID_SESSION


@pytest.mark.parametrize(
    "path", ["../secret", "/../secret", "@LOGS/../../secret", "out/secret", "a/./../../secret"]
)
@pytest.mark.parametrize("opcode", [Opcode.OPEN_FILE_RO, Opcode.CREATE_FILE, Opcode.REMOVE_FILE])
def test_nothing_outside_is_reached(bench, tmp_path, path, opcode):
    (tmp_path / "own" / "out").symlink_to(tmp_path)
    assert Client(bench).refusal(opcode, path) == FtpError.FILE_NOT_FOUND
    assert (tmp_path / "secret").read_bytes() == b"of nobody's concern"


def test_refusals_say_what_is_wrong(bench, tmp_path):
    client = Client(bench)
    assert client.refusal(Opcode.OPEN_FILE_RO, "none") == FtpError.FILE_NOT_FOUND
    assert client.refusal(Opcode.OPEN_FILE_RO, b"\xff\xfe") == FtpError.FILE_NOT_FOUND
    assert client.refusal(Opcode.LIST_DIRECTORY, "none") == FtpError.FILE_NOT_FOUND
    assert client.refusal(Opcode.REMOVE_FILE, "@LOGS/run/control.log") == FtpError.FILE_PROTECTED
    assert client.refusal(Opcode.CREATE_FILE, "@LOGS/a") == FtpError.FILE_PROTECTED
    assert client.refusal(Opcode.CREATE_FILE, "@PARAM/a") == FtpError.FILE_PROTECTED
    assert client.refusal(16) == FtpError.UNKNOWN_COMMAND
    assert client.refusal(99) == FtpError.UNKNOWN_COMMAND
    assert client.refusal(Opcode.READ_FILE, size=240) == FtpError.INVALID_DATA_SIZE
    assert client.refusal(Opcode.READ_FILE, size=9, session=3) == FtpError.INVALID_SESSION
    assert client.ask(Opcode.CREATE_DIRECTORY, "folder").opcode == Opcode.ACK
    assert client.refusal(Opcode.CREATE_DIRECTORY, "folder") == FtpError.FILE_EXISTS
    assert client.refusal(Opcode.OPEN_FILE_RO, "folder") == FtpError.FILE_NOT_FOUND
    (tmp_path / "own" / "folder" / "file").touch()
    assert client.refusal(Opcode.REMOVE_DIRECTORY, "folder") == FtpError.FAIL_ERRNO
    client.ask(Opcode.REMOVE_FILE, "folder/file")
    assert client.ask(Opcode.REMOVE_DIRECTORY, "folder").opcode == Opcode.ACK
    client.open("big", Opcode.CREATE_FILE)
    assert client.refusal(Opcode.WRITE_FILE, b"x", offset=1 << 30) == FtpError.FAIL_ERRNO


@pytest.mark.parametrize("query", ["", "?withdefaults=1"])
def test_the_packed_parameters_are_those_of_the_list(bench, query):
    """pymavlink's decoder, which is ArduPilot's."""
    bench.receive(m.MAVLink_param_set_message(1, 1, b"CTL_L_KP", 0.7, 9))
    bench.step(bench.control())
    decoded = mavftp.MAVFTP.ftp_param_decode(
        Client(bench, loss=0.2, seed=1).burst(f"@PARAM/param.pck{query}")
    )
    values = {name.decode(): value for name, value, _ in decoded.params}
    parameters = bench.parameters.parameters
    assert list(values) == [each.name for each in parameters]
    kept = [float(bench.parameters.value(each)) for each in parameters]
    assert list(values.values()) == pytest.approx(kept)
    if query:
        defaults = {name.decode(): value for name, value, _ in decoded.defaults}
        assert defaults["CTL_L_KP"] == pytest.approx(0.65)
        assert {n for n in values if values[n] != defaults[n]} == {"CTL_L_KP"}


def test_the_metadata_name_each_parameter_with_its_unit_and_range(bench):
    client = Client(bench)
    general = json.loads(client.burst("@META/general.json"))
    contents = {}
    for kind, uri, crc in [tuple(each.values()) for each in general["metadataTypes"]]:
        contents[kind] = client.burst(uri.removeprefix("mftp:///"))
        assert crc == crc_bit_by_bit(contents[kind])
    assert contents.keys() == {1, 4}  # parameters, events
    content = contents[1]
    entries = {each["name"]: each for each in json.loads(content)["parameters"]}
    assert list(entries) == [each.name for each in bench.parameters.parameters]
    limit = entries["LIM_V_MAX"]
    assert (limit["type"], limit["units"], limit["max"]) == ("Float", "m/s", 20.0)
    assert entries["SAF_ARM_MS"]["rebootRequired"]
    assert entries["SAF_ARM_MS"]["default"] == 1000
    assert zlib.crc32(content)  # not the same sum


PATHS = st.sampled_from(["", "/", "a", "b/c", "@PARAM/param.pck", "@LOGS/run/control.log", ".."])
REQUESTS = st.builds(
    lambda *fields: FtpPayload(*fields),  # noqa: PLW0108 - else those with a default are drawn
    st.integers(0, 3),
    st.integers(0, 2),
    st.sampled_from([*(each for each in Opcode if each < Opcode.ACK), 16, 77]),
    PATHS.map(str.encode) | st.binary(max_size=239),
    st.integers(0, 2**32 - 1) | st.integers(0, 6000),
    st.integers(0, 255),
)


def test_a_reply_is_not_replied_to(bench):
    client = Client(bench)
    for opcode in (Opcode.ACK, Opcode.NAK):
        assert client.exchange(client.request(opcode), 3) == []


@settings(deadline=None, max_examples=60)
@given(st.lists(st.tuples(REQUESTS, st.sampled_from([FIRST, SECOND])), max_size=15))
def test_whatever_comes_is_answered_and_leaves_all_else_alone(tmp_path_factory, requests):
    folder = tmp_path_factory.mktemp("served")
    bench = bench_in(folder)
    for request, peer in requests:
        assert Client(bench, peer).exchange(request, 2)
    assert (folder / "logs" / "run" / "control.log").read_bytes() == TEXT
    assert {each.name for each in folder.iterdir()} == {"own", "logs", "secret"}
