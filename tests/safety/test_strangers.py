"""Other senders: which of what they do is a fault, and how often people are told."""

import pytest

from robotctl.messages.control import Stranger, StrangerKind
from robotctl.messages.faults import FaultCode
from robotctl.safety.strangers import FIRST_NS, NEXT_NS, RECENT_NS, Strangers

NOW = 50_000_000_000
MS = 1_000_000

HOST, SECOND = StrangerKind.HOST_FRAME, StrangerKind.SECOND_SENDER
FALSE, WRITE = StrangerKind.FALSE_STATE, StrangerKind.SDO_WRITE


ONLY_US = "only this computer may send it"
BESIDE = "has a second sender beside drive (node 1); surplus: 17 frames in 2.1 s"
AS_BEFORE = "for sonar (node 2), which went on as before: 1 frame"


def seen(kind, count, span_ms=0, name="MotorCommand", number=0x201, node="", refused=0):
    return Stranger(kind, name, number, node, count, NOW, NOW + span_ms * MS, refused)


@pytest.mark.parametrize(
    ("stranger", "code", "part", "text"),
    [
        (
            seen(HOST, 1),
            FaultCode.BUS_STRANGER,
            "MotorCommand",
            f"MotorCommand (0x201) came from another sender, 1 frame: {ONLY_US}",
        ),
        (
            seen(HOST, 39, 5, "NmtControl", 0),
            FaultCode.BUS_STRANGER,
            "NmtControl",
            "a device babbles: NmtControl (0x000) came from another sender, 39 frames in 5 ms",
        ),
        (
            seen(HOST, 9, 1, "Sync", 0x80),
            FaultCode.BUS_STRANGER,
            "Sync",
            f"Sync (0x080) came from another sender, 9 frames in 1 ms: {ONLY_US}",
        ),
        (
            seen(SECOND, 17, 2100, "WheelFeedback", 0x181, "drive"),
            FaultCode.NODE_DOUBLED,
            "drive",
            f"WheelFeedback (0x181) {BESIDE}",
        ),
        (
            seen(FALSE, 1, 0, "boot-up message", 0x702, "sonar"),
            FaultCode.NODE_MISREPORTED,
            "sonar",
            f"another sender sent a boot-up message (0x702) {AS_BEFORE}",
        ),
    ],
)
def test_what_a_robot_stops_for_names_the_frame_and_its_count(stranger, code, part, text):
    strangers = Strangers()
    strangers.take((stranger,), NOW)
    fault = strangers.fault(NOW)
    assert (fault.code, fault.part, fault.text) == (code, part, text)


def test_it_keeps_from_arming_until_it_has_been_quiet_for_a_while():
    strangers = Strangers()
    assert strangers.fault(NOW) is None
    strangers.take((seen(HOST, 1),), NOW)
    strangers.take((seen(HOST, 2),), NOW + RECENT_NS // 2)
    last_ns = NOW + RECENT_NS // 2
    assert strangers.fault(last_ns + RECENT_NS - 1) is not None
    assert strangers.fault(last_ns + RECENT_NS) is None


def test_news_of_one_kind_do_not_renew_another():
    strangers = Strangers()
    command = seen(HOST, 1)
    strangers.take((command,), NOW)
    write = seen(WRITE, 1, 0, "SDO", 0x601, "drive")
    strangers.take((command, write), NOW + RECENT_NS)
    assert strangers.fault(NOW + RECENT_NS) is None


def test_a_write_that_nodes_refuse_is_told_and_stops_nothing():
    strangers = Strangers()
    strangers.take((seen(WRITE, 40, 780, "SDO", 0x601, "drive", refused=39),), NOW)
    assert strangers.fault(NOW) is None
    (notice,) = strangers.take_notices(NOW + FIRST_NS)
    assert notice.text == (
        "another sender writes to drive (node 1) by SDO: 40 frames in 780 ms, 39 refused"
    )


def test_a_flood_is_one_notice_of_each_kind_and_then_one_each_ten_seconds():
    strangers, told = Strangers(), []
    for n in range(25_000):
        now_ns = NOW + n * MS
        commands = seen(HOST, n + 1, n)
        nmt = seen(HOST, n + 1, n, "NmtControl", 0)
        strangers.take((commands, nmt), now_ns)
        told += [(now_ns - NOW, each.text) for each in strangers.take_notices(now_ns)]
    times = [time_ns for time_ns, _ in told]
    assert times == [t for k in range(3) for t in (FIRST_NS + k * NEXT_NS,) * 2]
    assert told[0][1].startswith("MotorCommand (0x201) came from another sender, 1001 frames")
    assert told[1][1].startswith("NmtControl (0x000) came from another sender, 1001 frames")


def test_what_people_were_told_by_the_stop_is_repeated_only_with_more_frames():
    strangers = Strangers()
    strangers.take((seen(HOST, 1),), NOW)
    strangers.told()
    assert strangers.take_notices(NOW + FIRST_NS) == []
    strangers.take((seen(HOST, 2, 5000),), NOW + 5000 * MS)
    strangers.told()
    strangers.take((seen(HOST, 3, 5001),), NOW + 5001 * MS)
    assert strangers.take_notices(NOW + 5000 * MS + FIRST_NS - 1) == []
    (notice,) = strangers.take_notices(NOW + 5000 * MS + FIRST_NS)
    assert "3 frames in 5.0 s" in notice.text
