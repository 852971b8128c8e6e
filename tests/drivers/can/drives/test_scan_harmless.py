"""No question of a scan, and no answer to it, is a command for anybody: all kinds, all numbers."""

from __future__ import annotations

import math
import struct

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from firmware_sim.bus.frame import EXTENDED_FLAG, FD_FLAG, REMOTE_FLAG, Frame
from firmware_sim.drives.moteus.registers import Write, subframes
from robotctl.drivers.can.drives.moteus.wire import command_id, pack_velocity
from robotctl.drivers.can.scanner import Verdict, all_probes
from robotctl.messages.actuators import DriveState
from tests.drivers.can.drives.drive_rig import DriveRig
from tests.drivers.can.drives.scan_bench import ScanBench

ODRIVE_COMMANDS = {2, 4, 6, 7, 8, *range(0x0B, 0x14), 0x16, *range(0x18, 0x1C), 0x1F}
"""Messages that the master sends with data, by the DBC files of both firmwares in odrive-can, and
0x06, 0x08, 0x10 and 0x1F, which set addresses and start-up, or update the firmware."""

QUIET = {"heartbeat_ms": 0, "encoder_ms": 0}


def is_odrive_command(frame, number):
    if frame.arbitration_id > 0x7FF:
        return False
    return frame.arbitration_id >> 5 == number and frame.arbitration_id & 0x1F in ODRIVE_COMMANDS


def is_canopen_command(frame, number):
    """By the predefined connection set of CiA 301; a heartbeat, or its request, starts watching."""
    plain = frame.arbitration_id & 0x7FF
    if frame.arbitration_id & ~0x7FF == REMOTE_FLAG:
        return plain == 0x700 + number
    if frame.arbitration_id > 0x7FF:
        return False
    if plain in (0x000, 0x001, 0x080) or 0x701 <= plain <= 0x77F:
        return True
    return plain in {base + number for base in (0x200, 0x300, 0x400, 0x500, 0x600)}


PAIRS = st.tuples(st.integers(0, 62), st.integers(1, 127))
NASTY = [(0, 1), (4, 2), (16, 23), (19, 119), (44, 7), (47, 98), (48, 9), (48, 23), (51, 119),
         (56, 5), (57, 32), (59, 127), (41, 52)]  # fmt: skip


def nasty(test):
    """Run a test with each pair whose identifiers meet, too."""
    for pair in NASTY:
        test = example(pair=pair, old=False)(example(pair=pair, old=True)(test))
    return test


@nasty
@given(pair=PAIRS, old=st.booleans())
@settings(max_examples=25, deadline=None)
def test_on_a_bus_of_odrive_and_canopen_no_frame_is_a_command_of_the_other(pair, old):
    """Neither a question nor the answer that it brings about: both only speak when asked."""
    odrive, node = pair
    bench = ScanBench()
    bench.add("odrive", odrive, settings={**QUIET, "firmware": (0, 5, 6) if old else (0, 6, 10)})
    bench.add("cia402", node, dialect="zlac8015d")
    bench.advance(700)
    frames = []
    bench.bus.tap(frames.append)
    report = bench.scanner().run()
    assert frames
    own_reads = {0x600 + node}
    for frame in frames:
        assert not is_odrive_command(frame, odrive), hex(frame.arbitration_id)
        if frame.arbitration_id in own_reads:
            assert frame.data[0] in (0x40, 0x60, 0x70)  # reads
        else:
            assert not is_canopen_command(frame, node), hex(frame.arbitration_id)
    assert report.verdict is Verdict.FOUND


# Let loose on each twin while it drives ---------------------------------------------------------


def drive_odrive(bench, number, send):
    send(number << 5 | 0x0B, struct.pack("<II", 2, 1))
    send(number << 5 | 0x0D, struct.pack("<ff", 2.0, 0.0))
    send(number << 5 | 0x07, struct.pack("<I", 8))


def drive_vesc(bench, number, send):
    send(EXTENDED_FLAG | 3 << 8 | number, struct.pack(">i", 900))


def drive_moteus(bench, number, send):
    send(command_id(number), pack_velocity(2.0, math.nan))


def drive_cia402(bench, number, send):
    send(0x000, bytes((1, number)))
    for index, size, value in ((0x6060, 1, 3), (0x60FF, 4, 8192), (0x6040, 2, 6),
                               (0x6040, 2, 7), (0x6040, 2, 15)):  # fmt: skip
        head = 0x23 | (4 - size) << 2
        send(0x600 + number, struct.pack("<BHBi", head, index, 0, value))


KINDS = {
    "odrive": (drive_odrive, {}, range(63), lambda twin: (twin.state, twin.errors.any)),
    "vesc": (drive_vesc, {}, range(255), lambda twin: (twin.fault, twin.timeout_ms)),
    "moteus": (drive_moteus, {}, range(1, 127), lambda twin: (twin.mode, twin.fault)),
    "cia402": (
        drive_cia402,
        {"counts_per_turn": 4096},
        range(1, 127),
        lambda twin: (twin.axes[0].state, twin.nmt_state, twin.axes[0].error),
    ),
}
SETTINGS = {"vesc": {"stored_timeout_ms": 0}, "odrive": {}, "moteus": {}, "cia402": {}}


class Driving:
    """A twin that drives, whose controller has fallen silent, and which no watchdog stops."""

    def __init__(self, kind, number):
        start, keys, _, self._state = KINDS[kind]
        self.bench = ScanBench(data_bitrate=5_000_000)
        self.twin = self.bench.add(kind, number, settings=SETTINGS[kind], **keys)
        port = self.bench.bus.attach("controller", lambda _: None)

        def send(arbitration_id, data):
            port.send(arbitration_id, data)
            self.bench.advance(2)

        self.bench.advance(700)
        start(self.bench, number, send)
        self.bench.advance(1500)
        port.set_listen_only(True)
        assert self.bench.plant.powered
        assert abs(self.bench.plant.axes[0].speed_rad_s) > 1.0
        self.before = self.now()

    def now(self):
        """State in its own words, and speed."""
        speed_rad_s = pytest.approx(self.bench.plant.axes[0].speed_rad_s, abs=0.3)
        return self._state(self.twin), self.bench.plant.powered, speed_rad_s

    def is_unchanged(self):
        """Whether the drive does what it did."""
        self.bench.advance(30)
        state, powered, _ = self.now()
        speed_rad_s = self.bench.plant.axes[0].speed_rad_s
        return (state, powered, speed_rad_s) == self.before


def questions_of(protocol):
    """All first questions of all probes but those of a protocol, and which those spare."""
    probes = all_probes()
    own = [each for each in probes if each.protocol == protocol]
    for probe in probes:
        if probe.protocol != protocol:
            for question in probe.questions(0):
                yield question, {n for each in own for n in each.obeyed_by(question.arbitration_id)}


PROTOCOLS = {"odrive": "CANSimple", "vesc": "VESC", "moteus": "moteus", "cia402": "CANopen"}


@pytest.mark.parametrize("kind", KINDS)
def test_every_question_leaves_a_driving_drive_of_another_protocol_as_it_is(kind):
    """Each with all its numbers; questions that would be its commands are held back by number."""
    every = list(questions_of(PROTOCOLS[kind]))
    assert len({question.arbitration_id for question, _ in every}) > 400
    for number in KINDS[kind][2]:
        driving = Driving(kind, number)
        asked = [question for question, spared in every if number not in spared]
        assert len(asked) > 400
        for question in asked:
            frame = Frame(question.arbitration_id, question.data, driving.bench.now_ns())
            driving.twin.on_frame(frame)
        assert driving.is_unchanged(), number


ODRIVES = (0, 3, 4, 12, 16, 33, 44, 47, *range(48, 52), *range(56, 60), 62)


@pytest.mark.parametrize(
    ("kind", "number"),
    [
        *(("odrive", each) for each in ODRIVES),
        *(("cia402", each) for each in (1, 2, 7, 9, 23, 32, 64, 96, 102, 126)),
        *(("vesc", each) for each in (0, 1, 127, 128, 254)),
        *(("moteus", each) for each in (1, 7, 8, 126)),
    ],
)
def test_a_whole_scan_finds_a_drive_that_drives_and_changes_nothing(kind, number):
    driving = Driving(kind, number)
    report = driving.bench.scanner().run()
    assert [(each.kind, each.number) for each in report.found] == [(kind, number)]
    assert driving.is_unchanged()


def test_our_own_drive_drives_on_among_all_questions_of_the_others():
    rig = DriveRig("diff_drive").commission()
    rig.drive(1.0)
    stranger = rig.simulation.bus.attach("stranger", lambda _: None, queue_limit=1000)
    for question, spared in questions_of("CANopen"):
        if not question.arbitration_id & FD_FLAG and 1 not in spared:
            stranger.send(question.arbitration_id, question.data)
    rig.drive(1.0, 300)
    assert rig.states == {DriveState.ENABLED}
    assert min(rig.wheels_rad_s) > 1.0
    rig.run(50)
    assert not rig.feedback.emergencies


def test_no_question_writes_a_register_of_a_moteus_that_reads_classic_frames_too():
    """Its documentation knows CAN FD only, but its firmware reads both."""
    for question, _ in questions_of("moteus"):
        if question.arbitration_id & REMOTE_FLAG or not question.data:
            continue
        try:
            parts = list(subframes(question.data))
        except (IndexError, struct.error):
            continue
        assert not any(isinstance(part, Write) for part in parts)


def test_the_driving_test_sees_a_command():
    driving = Driving("odrive", 48)
    driving.twin.on_frame(Frame(0x602, bytes(8), driving.bench.now_ns()))
    assert not driving.is_unchanged()
