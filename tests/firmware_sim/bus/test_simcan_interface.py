"""The python-can interface `simcan`, on hubs that run in real time."""

import subprocess
import sys
import textwrap
import time

import can
import pytest

from firmware_sim.bus.errors import BusError
from firmware_sim.bus.faults import Destroy


def open_bus(channel="simcan0", **options):
    return can.Bus(interface="simcan", channel=channel, **options)


@pytest.fixture
def hub(running_hub):
    return running_hub()


@pytest.fixture
def pair(hub):
    with open_bus(node="a") as a, open_bus(node="b") as b:
        yield a, b


@pytest.fixture
def fd_pair(running_hub):
    running_hub(data_bitrate=5_000_000)
    with open_bus(node="a", fd=True) as a, open_bus(node="b", fd=True) as b:
        yield a, b


def frame(can_id, data=b"", **options):
    options.setdefault("is_extended_id", can_id > 0x7FF)
    return can.Message(arbitration_id=can_id, data=data, **options)


@pytest.mark.parametrize(
    "message",
    [
        frame(0x181, b"\x01\x02"),
        frame(0x000),
        frame(0x1FFFFFFF, bytes(8)),
        frame(0x5, b"x", is_extended_id=True),
        can.Message(arbitration_id=0x181, is_remote_frame=True, dlc=6, is_extended_id=False),
    ],
)
def test_messages_arrive_as_they_were_sent(pair, message):
    a, b = pair
    a.send(message)
    received = b.recv(5.0)
    assert received.equals(message, timestamp_delta=None, check_channel=False)
    assert received.channel == "simcan0"
    assert received.is_rx
    assert abs(received.timestamp - time.time()) < 5.0


@pytest.mark.parametrize("size", can.util.CAN_FD_DLC)
@pytest.mark.parametrize("extended", [False, True])
@pytest.mark.parametrize("switch", [False, True])
def test_messages_of_can_fd_arrive_as_they_were_sent(fd_pair, size, extended, switch):
    a, b = fd_pair
    message = frame(
        0x12345678 if extended else 0x181, bytes(range(size)), is_fd=True, bitrate_switch=switch
    )
    a.send(message)
    received = b.recv(5.0)
    assert received.equals(message, timestamp_delta=None, check_channel=False)
    assert not received.error_state_indicator


def test_classic_messages_go_over_a_bus_of_can_fd(fd_pair):
    a, b = fd_pair
    sent = [
        frame(0x181, bytes(8)),
        frame(0x181, is_remote_frame=True, dlc=3),
        frame(0x181, bytes(8), is_fd=True),
        frame(0x12345678, b"x"),
    ]
    for message in sent:
        a.send(message)
    for message in sent:
        assert b.recv(5.0).equals(message, timestamp_delta=None, check_channel=False)


def test_a_message_of_no_length_of_can_fd_is_filled_up_with_zeros(fd_pair):
    a, b = fd_pair
    a.send(can.Message(arbitration_id=1, is_fd=True, data=b"\xff" * 9, dlc=9, check=False))
    assert b.recv(5.0).data == b"\xff" * 9 + bytes(3)


def test_a_sender_may_say_that_it_is_error_passive(fd_pair):
    a, b = fd_pair
    a.send(frame(0x181, is_fd=True, error_state_indicator=True))
    assert b.recv(5.0).error_state_indicator


def test_a_classic_client_destroys_frames_of_can_fd_unless_it_is_tolerant(running_hub):
    running_hub(data_bitrate=2_000_000)
    message = frame(0x100, bytes(64), is_fd=True, bitrate_switch=True)
    with open_bus(fd=True) as a, open_bus(fd=True, ignore_rx_error_frames=True) as b:
        with open_bus(fd_tolerant=True) as other:
            a.send(message)
            assert b.recv(5.0).equals(message, timestamp_delta=None, check_channel=False)
            a.send(frame(0x200))
            assert other.recv(5.0).arbitration_id == 0x200
            assert b.recv(5.0).arbitration_id == 0x200
        with open_bus():
            a.send(message)
            error = a.recv(5.0)
            assert error.is_error_frame
            assert error.data[2] & 0x80  # seen as the transmitter
            assert b.recv(5.0) is not None  # once the classic node is error-passive


def test_receiving_waits_no_longer_than_asked(pair):
    begin = time.monotonic()
    assert pair[0].recv(0.05) is None
    assert 0.045 <= time.monotonic() - begin < 2.0
    assert pair[0].recv(0) is None


def test_own_messages_come_back_only_on_request(hub):
    with open_bus(receive_own_messages=True) as a, open_bus() as b:
        a.send(frame(0x100))
        own = a.recv(5.0)
        assert (own.arbitration_id, own.is_rx) == (0x100, False)
        b.send(frame(0x200))
        assert a.recv(5.0).is_rx
        assert b.recv(5.0).arbitration_id == 0x100
        assert b.recv(0.05) is None


def test_filters_hold_for_recv_and_for_the_raw_descriptor(hub):
    filters = [{"can_id": 0x180, "can_mask": 0x780, "extended": False}]
    with open_bus(can_filters=filters) as a, open_bus() as b:
        b.send(frame(0x201))
        b.send(frame(0x181, is_extended_id=True))
        b.send(frame(0x182))
        assert a.recv(5.0).arbitration_id == 0x182
        a.set_filters(None)
        b.send(frame(0x700))
        assert a.recv(5.0).arbitration_id == 0x700


def test_error_messages_come_as_error_frames_and_set_the_state(hub, running_hub):
    with open_bus(node="alone") as bus:
        bus.send(frame(0x100, b"x"))
        message = bus.recv(5.0)
        assert message.is_error_frame
        assert message.arbitration_id & 0x20  # CAN_ERR_ACK
        while bus.state is can.BusState.ACTIVE:
            assert bus.recv(5.0).is_error_frame
        assert bus.state is can.BusState.PASSIVE
    with open_bus(ignore_rx_error_frames=True) as bus:
        bus.send(frame(0x100, b"x"))
        assert bus.recv(0.1) is None


def test_a_bus_off_node_shows_as_error_and_comes_back(pair, hub):
    a, b = pair
    hub.bus.inject(Destroy(error=BusError.BIT_ERROR, count=32))
    a.send(frame(0x100))
    while a.state is not can.BusState.ERROR:
        assert a.recv(5.0).is_error_frame
    while a.state is not can.BusState.ACTIVE:
        assert a.recv(5.0).is_error_frame
    a.send(frame(0x101))
    received = b.recv(5.0)
    while received.is_error_frame:
        received = b.recv(5.0)
    assert received.arbitration_id == 0x101


def test_a_passive_listener_does_not_acknowledge(hub):
    with open_bus() as sender, open_bus(node="listener") as listener:
        listener.state = can.BusState.PASSIVE
        assert listener.state is can.BusState.PASSIVE
        port = next(port for port in hub.bus.ports if port.name == "listener")
        deadline = time.monotonic() + 10.0
        while not port.listen_only:  # the hub has no way to confirm it
            assert time.monotonic() < deadline, "the hub has not heard that it only listens"
            time.sleep(0.005)
        sender.send(frame(0x100))
        assert sender.recv(5.0).arbitration_id & 0x20  # CAN_ERR_ACK
        listener.state = can.BusState.ACTIVE
        received = listener.recv(5.0)
        while received is not None and received.is_error_frame:
            received = listener.recv(5.0)
        assert received.arbitration_id == 0x100


def test_a_full_transmit_queue_is_an_error_at_once_or_after_the_time_given(hub):
    def flood(timeout):
        for _ in range(1000):
            alone.send(frame(0x100), timeout)

    with open_bus() as alone:
        with pytest.raises(can.CanOperationError, match="buffer full"):
            flood(None)
        begin = time.monotonic()
        with pytest.raises(can.CanOperationError, match="buffer full"):
            flood(0.1)
        assert time.monotonic() - begin >= 0.1


@pytest.mark.parametrize(
    "message",
    [
        can.Message(is_error_frame=True),
        can.Message(arbitration_id=1, is_fd=True, data=bytes(12), dlc=12),
    ],
)
def test_what_classic_can_has_not_is_not_sent(pair, message):
    with pytest.raises(can.CanOperationError, match="cannot be sent"):
        pair[0].send(message)


def test_without_a_hub_the_error_names_channel_places_and_alternatives(running_hub):
    running_hub("other1")
    with pytest.raises(can.CanInitializationError) as caught:
        open_bus("simcan9")
    text = str(caught.value)
    assert "'simcan9'" in text
    assert "robotctl/simcan9.sock" in text
    assert "other1" in text.split("Running channels: ")[1]


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"bitrate": 500_000}, "1000000"),
        ({"fd": True}, "classic CAN, not CAN FD"),
        ({"data_bitrate": 5_000_000}, "its data bit rate is 0, not 5000000"),
    ],
)
def test_options_the_bus_cannot_have_are_refused(hub, options, text):
    with pytest.raises(can.CanInitializationError, match=text):
        open_bus(**options)


def test_a_hub_that_goes_is_an_error_on_both_ways(hub):
    bus = open_bus()
    hub.stop()
    with pytest.raises(can.CanOperationError, match="hub is gone"):
        bus.recv(5.0)
    with pytest.raises(can.CanOperationError, match="hub is gone"):
        bus.send(frame(0x100))
    bus.shutdown()
    bus.shutdown()


def test_running_channels_are_detected(running_hub):
    running_hub("first9")
    running_hub("second9")
    found = can.detect_available_configs("simcan")
    assert {"first9", "second9"} <= {entry["channel"] for entry in found}
    assert {entry["interface"] for entry in found} == {"simcan"}


def test_a_notifier_hands_messages_to_its_listeners(pair):
    a, b = pair
    reader = can.BufferedReader()
    with can.Notifier(b, [reader], timeout=0.1):
        for number in range(20):
            a.send(frame(0x181, bytes([number])), timeout=1.0)
        received = [reader.get_message(5.0).data[0] for _ in range(20)]
    assert received == list(range(20))


def test_periodic_messages_keep_their_rate_on_the_bus(pair):
    a, b = pair
    begin_s = time.time()
    task = a.send_periodic(frame(0x80), 0.02)
    stamps = [b.recv(5.0).timestamp for _ in range(6)]
    task.stop()
    # Counted from the start: a first frame that is late is made up for by the next ones.
    assert 0.099 <= stamps[-1] - begin_s <= 1.0


def test_the_interface_needs_nothing_of_the_simulator():
    """A robot's control process must not load numpy tables or numba for its bus."""
    program = textwrap.dedent("""
        import sys
        import firmware_sim.bus.python_can
        loaded = [name for name in sys.modules if name.startswith("firmware_sim")]
        print(*sorted(loaded))
        print("numpy" in sys.modules, "numba" in sys.modules)
    """)
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True
    )
    names, heavy = done.stdout.splitlines()
    assert names.split() == [
        "firmware_sim",
        "firmware_sim.bus",
        "firmware_sim.bus.channels",
        "firmware_sim.bus.frame",
        "firmware_sim.bus.python_can",
        "firmware_sim.bus.wire",
    ]
    assert heavy == "False False"
