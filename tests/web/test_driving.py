"""Laws of the dead man, whatever comes in which order, and the stories of two drivers."""

from __future__ import annotations

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import Bundle, RuleBasedStateMachine, consumes, invariant, rule

from robotctl.web.driving import REST, Driving
from robotctl.web.wire import Sticks

MS = 1_000_000
OLDEST_NS, STANDING_NS, LIFE_NS = 250 * MS, 200 * MS, 300 * MS
"""As docs/web.md promises."""
CLIENTS = (1, 2)


def sticks(sample: int, at_ns: int, *, held: bool, forward: float = 0.5) -> Sticks:
    return Sticks(sample, at_ns / 1e6, held, forward, 0.25, 0.0)


class AnyOrder(RuleBasedStateMachine):
    """Clients come and go; their messages are late, lost, repeated and out of order.

    The oracle keeps what it needs for the promise alone: since the last thing that ends driving, a
    fresh sample with the key released must have come.
    """

    sent = Bundle("sent")

    def __init__(self) -> None:
        super().__init__()
        self.driving = Driving()
        self.now_ns = 1_000_000 * MS
        self.sample = 0
        self.released_since = False
        """A fresh and new sample with the key released came since the last ending."""
        self.newest: dict[int, int] = {}
        self.follows = False
        self.new_ns = 0
        for client in CLIENTS:
            self.driving.join(client, str(client))

    @rule(milliseconds=st.integers(0, 400))
    def time_passes(self, milliseconds: int) -> None:
        self.now_ns += milliseconds * MS

    @rule(target=sent, client=st.sampled_from(CLIENTS), held=st.booleans(), stands=st.booleans())
    def page_sends(self, client: int, held: bool, stands: bool) -> tuple[int, Sticks, int]:
        self.sample += not stands
        return client, sticks(self.sample, self.now_ns, held=held), self.now_ns

    @rule(message=consumes(sent))
    def arrives(self, message: tuple[int, Sticks, int]) -> None:
        self.take(*message)

    @rule(message=sent)
    def arrives_and_will_again(self, message: tuple[int, Sticks, int]) -> None:
        self.take(*message)

    @rule(client=st.sampled_from(CLIENTS), delay_ms=st.integers(0, 260), held=st.booleans())
    def arrives_after(self, client: int, delay_ms: int, held: bool) -> None:
        at_ns = self.now_ns
        self.sample += 1
        self.now_ns += delay_ms * MS
        self.take(client, sticks(self.sample, at_ns, held=held), at_ns)

    @rule(client=st.sampled_from(CLIENTS))
    def begins(self, client: int) -> None:
        self.takes(client)
        self.arrives_after(client, 0, False)
        self.arrives_after(client, 0, True)

    def take(self, client: int, message: Sticks, at_ns: int) -> None:
        was_driver = self.driving.driver == client
        is_new = message.sample > self.newest.get(client, -1)
        self.newest[client] = max(message.sample, self.newest.get(client, -1))
        age_ns = self.now_ns - at_ns
        if was_driver and (age_ns > OLDEST_NS or self.stood()):
            self.ends()
        self.driving.sticks(client, message, self.now_ns)
        if was_driver and age_ns <= OLDEST_NS and is_new and not message.held:
            self.released_since = True
        for drive in self.driving.take_drives():
            if drive == REST:
                self.follows = False
                continue
            assert was_driver
            assert message.held
            assert is_new
            assert age_ns <= OLDEST_NS
            assert self.released_since, "driving began without a fresh edge"
            assert self.now_ns + drive.life_ns <= at_ns + LIFE_NS
            assert drive.begins != self.follows
            self.follows, self.new_ns = True, self.now_ns

    def stood(self) -> bool:
        return self.follows and self.now_ns - self.new_ns > STANDING_NS

    def ends(self) -> None:
        self.released_since = False

    @rule(client=st.sampled_from(CLIENTS))
    def takes(self, client: int) -> None:
        before = self.driving.driver
        self.driving.take(client, 1, self.now_ns)
        self.changed(before)

    @rule(client=st.sampled_from(CLIENTS))
    def gives(self, client: int) -> None:
        before = self.driving.driver
        self.driving.give(client, self.now_ns)
        self.changed(before)

    @rule(client=st.sampled_from(CLIENTS))
    def reconnects(self, client: int) -> None:
        before = self.driving.driver
        self.driving.leave(client, self.now_ns)
        self.driving.join(client, str(client))
        self.newest.pop(client, None)
        self.changed(before)

    @rule()
    def robot_loses_power(self) -> None:
        self.driving.interrupt("not armed")
        self.ends()
        self.rests()

    @rule()
    def server_looks(self) -> None:
        before, stood = self.driving.driver, self.stood()
        self.driving.step(self.now_ns)
        if stood:
            self.ends()
            assert not self.driving.is_held
        self.changed(before)

    def changed(self, before: int | None) -> None:
        if self.driving.driver != before:
            self.ends()
        self.rests()

    def rests(self) -> None:
        """Nothing but a sample moves the robot; what was followed is ended by rest."""
        for drive in self.driving.take_drives():
            assert drive == REST
            self.follows = False

    @invariant()
    def follows_only_a_driver(self) -> None:
        assert self.driving.is_held == self.follows
        assert not self.follows or self.driving.driver is not None


AnyOrder.TestCase.settings = settings(max_examples=150, stateful_step_count=40, deadline=None)
test_no_order_of_messages_drives_without_a_fresh_edge = AnyOrder.TestCase


@pytest.fixture
def driving() -> Driving:
    driving = Driving()
    for client in CLIENTS:
        driving.join(client, f"client {client}")
    return driving


def begin(driving: Driving, client: int, now_ns: int, sample: int = 0) -> None:
    """Let a client that is the driver release and hold the key."""
    driving.sticks(client, sticks(sample, now_ns, held=False), now_ns)
    driving.sticks(client, sticks(sample + 1, now_ns, held=True), now_ns)


def test_the_robot_follows_a_driver_who_holds_the_key_and_rests_at_once_when_it_is_released(
    driving,
):
    driving.take(1, 1, 0)
    begin(driving, 1, 10 * MS)
    (drive,) = driving.take_drives()
    assert (drive.forward, drive.turn, drive.begins) == (0.5, 0.25, True)
    driving.sticks(1, sticks(2, 60 * MS, held=True, forward=-1.0), 60 * MS)
    (drive,) = driving.take_drives()
    assert (drive.forward, drive.begins) == (-1.0, False)
    driving.sticks(1, sticks(3, 110 * MS, held=False), 110 * MS)
    assert driving.take_drives() == [REST]
    driving.sticks(1, sticks(4, 160 * MS, held=True), 160 * MS)
    assert [each.begins for each in driving.take_drives()] == [True]


def test_a_key_that_was_held_before_becoming_the_driver_does_not_count(driving):
    driving.sticks(1, sticks(0, 0, held=False), 0)
    driving.take(1, 1, 0)
    for sample in range(1, 20):
        driving.sticks(1, sticks(sample, sample * 50 * MS, held=True), sample * 50 * MS)
    assert driving.take_drives() == []
    assert "released" in driving.state.locked


def test_a_pad_that_repeats_its_last_sample_is_let_go_after_200_ms(driving):
    driving.take(1, 1, 0)
    begin(driving, 1, 0)
    driving.take_drives()
    for ms in range(20, 1000, 20):
        driving.sticks(1, sticks(1, ms * MS, held=True), ms * MS)
        driving.step(ms * MS)
        if driving.take_drives() == [REST]:
            assert 200 < ms <= 220
            break
    else:
        pytest.fail("the robot was not let go")
    assert "stood still" in driving.state.locked
    driving.sticks(1, sticks(2, 1000 * MS, held=True), 1000 * MS)
    assert driving.take_drives() == [], "holding on is not enough"


def test_a_sample_of_251_ms_stops_and_one_of_250_drives(driving):
    driving.take(1, 1, 0)
    begin(driving, 1, 0)
    driving.take_drives()
    driving.sticks(1, sticks(2, 100 * MS, held=True), 150 * MS)
    driving.sticks(1, sticks(3, 100 * MS, held=True), 350 * MS)
    driven = driving.take_drives()
    assert [each.life_ns for each in driven] == [250 * MS, 50 * MS]
    driving.sticks(1, sticks(4, 200 * MS, held=True), 451 * MS)
    assert driving.take_drives() == [REST]
    assert "late" in driving.state.locked


def test_a_driver_who_drives_is_asked_and_keeps_by_silence_for_10_s(driving):
    driving.take(1, 1, 0)
    begin(driving, 1, 0)
    driving.take(2, 77, 0)
    state = driving.state
    assert (state.client, state.asking, state.asking_name) == (1, 2, "client 2")
    for sample, ms in enumerate(range(50, 10_100, 50), 2):
        driving.sticks(1, sticks(sample, ms * MS, held=True), ms * MS)
        driving.step(ms * MS)
    assert driving.driver == 1
    (denial,) = driving.take_denials()
    assert (denial.client, denial.number) == (2, 77)
    assert driving.state.asking is None


def test_a_driver_who_gives_stops_the_robot_and_the_asker_needs_a_fresh_edge(driving):
    driving.take(1, 1, 0)
    begin(driving, 1, 0)
    driving.take(2, 1, 0)
    driving.sticks(2, sticks(9, 10 * MS, held=False), 10 * MS)
    driving.take_drives()
    driving.give(1, 10 * MS)
    assert driving.take_drives() == [REST]
    assert driving.driver == 2
    driving.sticks(2, sticks(10, 10 * MS, held=True), 10 * MS)
    assert driving.take_drives() == []


def test_an_idle_driver_is_replaced_at_once_after_5_s(driving):
    driving.take(1, 1, 0)
    driving.take(2, 1, 5000 * MS)
    assert driving.driver == 1
    driving.step(5001 * MS)
    assert driving.driver == 2
    assert "idle" in driving.state.why


def test_the_end_of_the_drivers_connection_stops_the_robot(driving):
    driving.take(1, 1, 0)
    begin(driving, 1, 0)
    driving.take_drives()
    driving.leave(1, 50 * MS)
    assert driving.take_drives() == [REST]
    assert driving.driver is None
    assert "connection" in driving.state.why


def test_sticks_of_who_is_not_the_driver_do_nothing(driving):
    driving.take(1, 1, 0)
    begin(driving, 2, 0)
    assert driving.take_drives() == []
