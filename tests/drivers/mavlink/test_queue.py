"""The bounded output queue of a stream."""

from hypothesis import given
from hypothesis import strategies as st

from robotctl.drivers.mavlink.queue import OutputQueue


def blocked(_chunk):
    raise BlockingIOError


def test_frames_leave_in_the_order_in_which_they_came():
    queue, out = OutputQueue(1000), []
    for number, answer in enumerate([False, True, False, True]):
        queue.push(bytes([number]), answer=answer)
    queue.write(lambda chunk: out.append(chunk) or len(chunk))
    assert b"".join(out) == bytes([0, 1, 2, 3])
    assert not queue


def test_the_oldest_telemetry_is_dropped_and_answers_are_kept():
    queue, out = OutputQueue(40), []
    queue.push(b"answer----", answer=True)
    for number in range(10):
        queue.push(b"telemetry%d" % number, answer=False)
    queue.write(lambda chunk: out.append(chunk) or len(chunk))
    assert b"".join(out) == b"answer----telemetry7telemetry8telemetry9"
    assert queue.dropped == 7


def test_answers_are_bounded_too():
    queue = OutputQueue(30)
    for _ in range(10):
        queue.push(b"0123456789", answer=True)
    assert queue.dropped == 7


@given(
    st.lists(st.tuples(st.binary(min_size=1, max_size=30), st.booleans()), max_size=60),
    st.lists(st.integers(0, 50), max_size=60),
)
def test_frames_are_never_cut_whatever_the_writer_takes(frames, takes):
    queue, out, offered = OutputQueue(200), bytearray(), iter(takes)

    def write(chunk):
        taken = min(next(offered, len(chunk)), len(chunk))
        out.extend(chunk[:taken])
        return taken

    sent = []
    for number, (body, answer) in enumerate(frames):
        frame = bytes([255, number, len(body)]) + body
        sent.append(frame)
        queue.push(frame, answer=answer)
        queue.write(write)
    while queue:
        queue.write(write)
    rest, position = bytes(out), 0
    for frame in sent:  # what came out is a subsequence of whole frames
        if rest[position:].startswith(frame):
            position += len(frame)
    assert position == len(rest)


def test_a_blocked_writer_keeps_everything():
    queue = OutputQueue(100)
    queue.push(b"frame", answer=False)
    queue.write(blocked)
    out = []
    queue.write(lambda chunk: out.append(chunk) or len(chunk))
    assert out == [b"frame"]
