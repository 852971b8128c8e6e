"""Set-points that a link held back: how late they are by the clock of their sender."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common

from robotctl.mavlink.context import TRANSPORT_NS
from robotctl.mavlink.guards.rhythm import INTERVALS
from robotctl.mavlink.guards.transport_delay import FORGET_NS, LET_GO, MAX_STREAMS, SenderClocks
from robotctl.messages.control import PositionTarget, VelocityTarget
from robotctl.messages.mavlink_port import Peer
from robotctl.messages.requests import REQUEST_LIFE_NS

BODY_NED, LOCAL = 8, 1
VELOCITY, POSITION = 0xFC7, 0xFF8
WRAP_MS = 1 << 32
TIMEOUT_NS = 300_000_000 - TRANSPORT_NS
"""Of a sender that sends ten times a second."""
FIRST_PEER = Peer(0, 0)
LEFT_OF_2_S = 6
"""So many of 20 held back for 2 s may count: those of the last 0.3 s, and of LET_GO of the 2 s."""


class Sender:
    """A ground station that sends a velocity ten times a second, by a clock of its own."""

    def __init__(self, bench, boot_ms=7_000, rate=1.0, tick_ms=1, peer=FIRST_PEER):
        self.bench, self.rate, self.tick_ms, self.peer = bench, rate, tick_ms, peer
        self.restart(boot_ms)

    def restart(self, boot_ms):
        self.zero_ms, self.zero_ns = boot_ms, self.bench.now_ns

    def message(self, mask=VELOCITY, frame=BODY_NED):
        passed_ms = (self.bench.now_ns - self.zero_ns) / 1e6 * self.rate
        boot_ms = self.zero_ms + int(passed_ms / self.tick_ms) * self.tick_ms
        return common.MAVLink_set_position_target_local_ned_message(
            boot_ms % WRAP_MS, 1, 1, frame, mask, 3.0, 1.0, 0, 0.5, *[0.0] * 7
        )

    def send(self, seconds, delay_s=0.0):
        """Send for a while, each message on its way for `delay_s`; return the requests."""
        requests, underway = [], []
        for _ in range(round(seconds * 10)):
            underway.append(self.message())
            if len(underway) > round(delay_s * 10):
                self.bench.receive(underway.pop(0), peer=self.peer)
            requests += self.bench.step(advance_s=0.1)
        return requests

    def stall(self, seconds):
        """Send for a while, all of it held back; return what is on its way."""
        held = []
        for _ in range(round(seconds * 10)):
            held.append(self.message())
            self.bench.step(advance_s=0.1)
        return held

    def deliver(self, held):
        for message in held:
            self.bench.receive(message, peer=self.peer)
        return self.bench.step(advance_s=0.0)


@pytest.fixture
def sender(bench):
    """Return a sender that the robot has heard for three seconds."""
    sender = Sender(bench)
    assert len(sender.send(3.0)) == 30
    return sender


def test_what_was_held_back_counts_from_when_it_was_sent(bench, sender):
    """Two seconds at once: what is void by then is refused, the newest lives longest."""
    requests = sender.deliver(sender.stall(2.0))
    assert 3 <= len(requests) <= LEFT_OF_2_S
    assert all(isinstance(request, VelocityTarget) for request in requests)
    assert all(request.expires_ns - request.stamp_ns == TIMEOUT_NS for request in requests)
    assert [request.expires_ns for request in requests] == sorted(
        request.expires_ns for request in requests
    )
    assert bench.now_ns < requests[0].expires_ns
    assert requests[-1].stamp_ns <= bench.now_ns
    bench.run(0.1)
    assert "Setpoint: came 0.28 s late or later" in bench.texts()


def test_a_sender_that_ended_behind_a_held_up_link_drives_nothing(bench, sender):
    held = sender.stall(1.0)
    bench.step(advance_s=1.0)
    assert sender.deliver(held) == []


def test_positions_that_are_late_do_not_move_the_robot(bench, sender):
    point = sender.message(POSITION, LOCAL)
    bench.step(advance_s=0.8)
    (request,) = sender.deliver([point])
    assert isinstance(request, PositionTarget)
    assert bench.now_ns - request.stamp_ns > 0.6e9
    point = sender.message(POSITION, LOCAL)
    bench.step(advance_s=1.5 * REQUEST_LIFE_NS / 1e9)
    assert sender.deliver([point]) == []


def test_new_set_points_are_followed_at_once_after_late_ones(bench, sender):
    sender.deliver(sender.stall(5.0)[:10])
    (request,) = sender.deliver([sender.message()])
    assert request.stamp_ns == bench.now_ns


@pytest.mark.parametrize("boot_ms", [0, 3_000, 6_999])
def test_a_sender_that_was_started_anew_is_followed_at_once(bench, sender, boot_ms):
    sender.restart(boot_ms)
    requests = sender.send(5.0)
    assert len(requests) == 50
    assert sender.deliver(sender.stall(2.0)[:10]) == []  # and protected again


def test_a_sender_started_anew_may_have_another_clock(sender):
    """It is not trusted for what the one before was."""
    sender.restart(0)
    sender.rate = 0.5
    assert len(sender.send(20.0)) == 200


def test_the_wrap_of_the_clock_is_not_noticed(bench):
    sender = Sender(bench, WRAP_MS - 4_000)
    assert len(sender.send(3.0)) == 30
    held = sender.stall(2.0)
    assert held[0].time_boot_ms > WRAP_MS - 2_000
    assert held[-1].time_boot_ms < 1_000
    assert len(sender.deliver(held)) <= LEFT_OF_2_S
    assert len(sender.send(3.0)) == 30


@pytest.mark.parametrize("rate", [0.92, 0.999, 1.0, 1.001, 1.08])
def test_clocks_may_run_apart(bench, rate):
    sender = Sender(bench, rate=rate)
    requests = sender.send(120.0)
    assert len(requests) == 1200
    lives_ns = {request.expires_ns - request.stamp_ns for request in requests[INTERVALS:]}
    assert lives_ns == {TIMEOUT_NS}
    assert len(sender.deliver(sender.stall(2.0))) <= LEFT_OF_2_S


@pytest.mark.parametrize(
    "clock",
    [
        {"rate": 0.0},
        {"rate": 0.0, "boot_ms": 0},
        {"rate": 1e-3},  # seconds in place of milliseconds
        {"rate": 1e3},  # microseconds
        {"rate": 1e6},  # nanoseconds: wraps every 4.3 s
        {"rate": 0.5},
        {"tick_ms": 1_000},
    ],
)
def test_a_sender_without_a_clock_of_milliseconds_is_followed_as_ever(bench, clock):
    """Its set-points count from their arrival, late or not."""
    sender = Sender(bench, **clock)
    assert len(sender.send(30.0)) == 300
    requests = sender.deliver(sender.stall(2.0))
    assert len(requests) == 20
    assert {request.stamp_ns for request in requests} == {bench.now_ns}


def test_a_delay_that_all_have_in_common_is_not_seen(bench):
    sender = Sender(bench)
    assert len(sender.send(10.0, delay_s=1.0)) == 90


def test_a_clock_that_stood_still_is_let_go_after_a_while(bench, sender):
    """A computer that slept for 4 s: refused at first, then followed again."""
    bench.step(advance_s=4.0)
    sender.zero_ns += 4_000_000_000
    assert sender.send(1.0) == []
    sender.send(3.5 / LET_GO)
    assert len(sender.send(1.0)) == 10


def test_a_sender_silent_for_long_begins_anew(bench, sender):
    bench.step(advance_s=FORGET_NS / 1e9 + 1.0)
    sender.zero_ns += FORGET_NS
    assert len(sender.send(1.0)) == 10


def test_each_sender_on_each_link_has_a_clock_of_its_own(bench, sender):
    other = Sender(bench, boot_ms=4_000_000, peer=Peer(1, 0))
    for _ in range(30):
        assert len(sender.deliver([sender.message()])) == 1
        assert len(other.deliver([other.message()])) == 1
        bench.step(advance_s=0.1)
    assert sender.deliver(sender.stall(2.0)[:10]) == []
    assert other.deliver([other.message()])


def test_invented_senders_take_no_room_and_leave_those_who_were_heard_alone():
    clocks = SenderClocks()
    for ms in range(0, 5000, 100):
        assert clocks.late_ns("known", ms, ms * 1_000_000) == 0
        for number in range(100):
            clocks.late_ns((ms, number), 5, ms * 1_000_000)
    assert len(clocks._streams) == MAX_STREAMS
    assert clocks.late_ns("known", 5000, 5_800_000_000) > 700_000_000


@given(
    st.lists(st.tuples(st.integers(0, WRAP_MS - 1), st.integers(0, 20_000_000_000)), max_size=30)
)
def test_whatever_the_clocks_say_no_message_is_from_the_future(messages):
    clocks, now_ns = SenderClocks(), 0
    for boot_ms, elapsed_ns in messages:
        now_ns += elapsed_ns
        assert 0 <= clocks.late_ns("stream", boot_ms, now_ns) <= now_ns


def test_jitter_of_a_link_makes_no_set_point_late_by_more(bench):
    """Arrivals up to 50 ms apart from their even times: lateness is jitter and what was let go."""
    clocks = SenderClocks()
    jitter_ms = [0, 30, 10, 50, 20, 0, 40]
    for step in range(600):
        now_ns = (step * 100 + jitter_ms[step % 7]) * 1_000_000
        late_ns = clocks.late_ns("stream", 1_000 + step * 100, now_ns)
        assert late_ns <= 50_000_000


@pytest.mark.parametrize(
    ("rate_hz", "configured_s", "life_s"),
    [(50, 0.5, 0.3), (10, 0.5, 0.3), (5, 0.5, 0.3), (4.5, 0.5, 0.5), (2, 0.5, 0.5), (20, 0.2, 0.2)],
)
@pytest.mark.parametrize("tells_time", [True, False])
def test_who_sends_at_5_hz_or_more_is_missed_sooner(
    make_bench, rate_hz, configured_s, life_s, tells_time
):
    bench = make_bench(setpoint_timeout_s=configured_s)
    sender, lives_s = Sender(bench), []
    for _ in range(20):
        message = sender.message()
        message.time_boot_ms *= tells_time
        bench.receive(message)
        (request,) = bench.step(advance_s=1.0 / rate_hz)
        lives_s.append((request.expires_ns - request.stamp_ns + TRANSPORT_NS) / 1e9)
    assert lives_s[0] == pytest.approx(configured_s)
    assert lives_s[INTERVALS:] == pytest.approx([life_s] * (20 - INTERVALS))
    bench.step(advance_s=2.0)
    bench.receive(sender.message())
    (request,) = bench.step()  # after a pause it is not known how often it sends
    assert request.expires_ns - request.stamp_ns + TRANSPORT_NS == configured_s * 1e9


def test_each_sender_has_its_own_rhythm(bench):
    fast, slow = Sender(bench), Sender(bench, peer=Peer(0, 1))
    for number in range(30):
        bench.receive(fast.message(), peer=fast.peer)
        if number % 5 == 0:
            bench.receive(slow.message(), peer=slow.peer)
        requests = bench.step(advance_s=0.1)
    bench.receive(slow.message(), peer=slow.peer)
    (request,) = bench.step(advance_s=0.1)
    assert request.expires_ns - request.stamp_ns == 500_000_000 - TRANSPORT_NS
    assert requests[0].expires_ns - requests[0].stamp_ns == TIMEOUT_NS
