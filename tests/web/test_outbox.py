"""Laws of what one client is sent: nothing that must arrive is lost, no picture comes late."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from robotctl.web.outbox import MAX_KEPT, Outbox

MS = 1_000_000
TOPICS = ("ControlState", "LidarScan", "ParticleCloud")

actions = st.lists(
    st.one_of(
        st.tuples(st.just("keep"), st.sampled_from(TOPICS)),
        st.tuples(st.just("show"), st.sampled_from(TOPICS)),
        st.tuples(st.just("wait"), st.integers(0, 80)),
        st.tuples(st.just("next"), st.none()),
    ),
    max_size=MAX_KEPT,
)


@given(actions)
def test_kept_messages_all_arrive_in_order_and_pictures_are_the_newest(plan):
    outbox, now_ns, number = Outbox(), 0, 0
    kept, sent, newest = [], [], {}
    for action, value in plan:
        if action == "wait":
            now_ns += value * MS
        elif action == "next":
            data = outbox.next(now_ns)
            if data is not None:
                sent.append((now_ns, *data.decode().split()))
                if sent[-1][1] == "show":
                    assert newest[sent[-1][2]] == int(sent[-1][3]), "an old picture"
        else:
            number += 1
            data = f"{action} {value} {number}".encode()
            newest[value] = number
            if action == "keep":
                kept.append(data)
                outbox.keep(value, data)
            else:
                outbox.show(value, data)
    while (data := outbox.next(now_ns)) is not None or now_ns % (50 * MS):
        if data is None:
            now_ns += 50 * MS - now_ns % (50 * MS)
            continue
        sent.append((now_ns, *data.decode().split()))
    assert [f"keep {topic} {n}".encode() for _, how, topic, n in sent if how == "keep"] == kept
    for topic in TOPICS:
        numbers = [int(n) for _, _, of, n in sent if of == topic]
        assert numbers == sorted(numbers), "a topic went back in time"


@given(st.lists(st.integers(1, 40), min_size=50, max_size=300))
def test_no_topic_has_more_than_20_pictures_a_second(waits):
    outbox, now_ns, times = Outbox(), 0, []
    for wait in waits:
        now_ns += wait * MS
        outbox.show("LidarScan", b"")
        while outbox.next(now_ns) is not None:
            times.append(now_ns)
    for start in times:
        assert sum(start <= each < start + 1000 * MS for each in times) <= 21


def test_a_fast_client_gets_20_pictures_a_second_of_50():
    outbox, count = Outbox(), 0
    for ms in range(0, 10_000, 20):
        outbox.show("ControlState", b"")
        count += outbox.next(ms * MS) is not None
    assert 199 <= count <= 202


def test_no_topic_starves_another():
    outbox, sent = Outbox(), []
    for ms in range(0, 3000, 10):
        for topic in TOPICS:
            outbox.show(topic, topic.encode())
        sent.append(outbox.next(ms * MS))
    counts = {topic: sent.count(topic.encode()) for topic in TOPICS}
    assert min(counts.values()) > 50, counts


def test_a_client_that_never_reads_is_hopeless_and_costs_bounded_memory():
    outbox = Outbox()
    for _ in range(10_000):
        outbox.show("LiveMap", b"x" * 10_000)
    assert not outbox.is_hopeless
    for _ in range(MAX_KEPT):
        outbox.keep("Notice", b"x")
    assert not outbox.is_hopeless
    outbox.keep("Notice", b"x")
    assert outbox.is_hopeless


def test_few_but_very_long_messages_are_too_many_as_well():
    outbox = Outbox()
    for _ in range(12):
        outbox.keep("Notice", b"x" * 100_000)
    assert outbox.is_hopeless
