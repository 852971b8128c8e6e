"""Sessions with bought drives: scripts, lost answers, restarts; and the latches of the host."""

from __future__ import annotations

import pytest

from robotctl.drivers.can.drives.session import (
    ANSWER_NS,
    ATTEMPTS,
    RETRY_NS,
    UNREAD_MAX,
    Exchange,
    Session,
)
from robotctl.messages.faults import Fault, FaultCode

MS = 1_000_000
READING_NS = 500 * MS
ASK = Exchange(((1, b"a"), (2, b"b")), "read of a thing", b"A")
READ = Exchange(((3, b"r"),), "read of the setting", b"R")


class Rig:
    """A session on a bus that takes all frames, or none, and a clock."""

    def __init__(self, script=None, reading=None):
        self.now_ns = 0
        self.sent = []
        self.full = False
        self.session = Session(
            7,
            "motor",
            (9, b"ping"),
            script or self.script,
            reading or self.reading,
            READING_NS,
            350 * MS,
        )

    def script(self):
        answer = yield ASK
        return ASK.unanswered() if answer is None else None

    def reading(self):
        answer = yield READ
        if answer is None:
            return READ.unanswered()
        return None if answer == b"R1" else Fault(FaultCode.NODE_CHANGED, "it was changed")

    def send(self, arbitration_id, data):
        if self.full:
            return False
        self.sent.append((arbitration_id, data))
        return True

    def tick(self, ms=5, *, hear=True):
        self.now_ns += ms * MS
        if hear:
            self.session.hear(self.now_ns)
        self.session.check(self.now_ns)
        return self.session.serve(self.send, self.now_ns)

    def run(self, ms, answer=None, *, hear=True):
        """Run; give `answer` to each frame of its key."""
        for _ in range(ms // 5):
            before = len(self.sent)
            self.tick(hear=hear)
            for frame in self.sent[before:]:
                if answer and frame[0] in answer:
                    self.session.answer(answer[frame[0]], self.now_ns)


@pytest.fixture
def rig():
    return Rig()


def in_service(rig):
    rig.run(250, {2: b"A"})
    assert rig.session.in_service
    return rig


def test_a_silent_drive_is_called_and_nothing_else(rig):
    rig.run(1000, hear=False)
    assert set(rig.sent) == {(9, b"ping")}
    assert 3 <= len(rig.sent) <= 5
    assert rig.session.status.fault is FaultCode.NODE_NOT_HEARD
    assert rig.session.status.boots == 0


def test_at_most_one_frame_a_tick_in_their_order(rig):
    assert rig.tick()
    assert rig.tick()
    assert not rig.tick()
    assert rig.sent == [(1, b"a"), (2, b"b")]
    rig.session.answer(b"A", rig.now_ns)
    assert rig.session.in_service
    assert (rig.session.status.nmt_state, rig.session.status.problem) == (5, "")


def test_a_frame_that_the_bus_does_not_take_is_sent_later(rig):
    rig.full = True
    for _ in range(10):
        assert not rig.tick()
    rig.full = False
    in_service(rig)
    assert rig.sent == [(1, b"a"), (2, b"b")]


@pytest.mark.parametrize("early", [True, False])
def test_an_answer_that_is_not_the_one_awaited_is_ignored(rig, early):
    rig.tick()
    if not early:
        rig.tick()
    rig.session.answer(b"A" if early else b"B", rig.now_ns)
    assert not rig.session.in_service
    in_service(rig)


def test_unanswered_frames_are_repeated_and_then_the_drive_is_refused_and_tried_again(rig):
    rig.run(ATTEMPTS * (ANSWER_NS // MS + 20) + 20)
    assert rig.sent == ATTEMPTS * [(1, b"a"), (2, b"b")]
    status = rig.session.status
    assert status.fault is FaultCode.NODE_NO_ANSWER
    assert status.problem == "motor (node 7): no answer to the read of a thing"
    rig.run(RETRY_NS // MS)
    assert len(rig.sent) > 2 * ATTEMPTS
    assert rig.session.status.problem == status.problem, "the sentence stays meanwhile"
    in_service(rig)


def test_single_unanswered_readings_are_no_change_but_several_in_a_row_are(rig):
    in_service(rig)
    per_reading_ms = READING_NS // MS + ATTEMPTS * (ANSWER_NS // MS + 15)
    rig.run((UNREAD_MAX - 1) * per_reading_ms)
    assert rig.session.in_service
    rig.run(per_reading_ms, {3: b"R1"})
    rig.run((UNREAD_MAX - 1) * per_reading_ms)
    assert rig.session.in_service, "an answer in between counts"
    rig.run(4 * per_reading_ms)
    assert not rig.session.in_service
    assert rig.session.status.fault is FaultCode.NODE_NO_ANSWER


def test_a_setting_that_was_changed_takes_it_out_of_service_and_it_is_set_anew(rig):
    in_service(rig)
    rig.run(600, {3: b"R2"})
    assert rig.session.status.fault is FaultCode.NODE_CHANGED
    rig.run(1200, {2: b"A", 3: b"R1"})
    assert rig.session.in_service


def test_a_drive_that_is_lost_and_comes_back_has_booted(rig):
    in_service(rig)
    rig.run(400, hear=False)
    status = rig.session.status
    assert (status.fault, status.nmt_state, status.boots) == (FaultCode.NODE_SILENT, 0, 1)
    assert status.problem == "motor (node 7): nothing heard for 350 ms"
    in_service(rig)
    assert rig.session.status.boots == 2


def test_a_restart_in_the_middle_of_a_reading_begins_from_the_start(rig):
    in_service(rig)
    while rig.sent[-1][0] != 3:
        rig.tick()
    rig.session.restart()
    assert not rig.session.in_service
    rig.session.answer(b"R1", rig.now_ns)
    assert rig.session.status.fault is FaultCode.NODE_STARTING
    in_service(rig)
    assert rig.session.status.boots == 2


def test_the_status_is_another_object_only_now_and_then(rig):
    in_service(rig)
    seen = {id(rig.session.status)}
    for _ in range(20):
        rig.tick()
        seen.add(id(rig.session.status))
    assert 2 <= len(seen) <= 4
    assert rig.now_ns - rig.session.status.heartbeat_ns <= 60 * MS
