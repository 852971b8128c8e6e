import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_sim.bus.channels import socket_paths
from robotctl.drivers.can.config import CanConfig, NodeParameters
from robotctl.drivers.can.errors import bus_state
from robotctl.messages.control import BusState

A, W, P, OFF = (
    BusState.ERROR_ACTIVE,
    BusState.ERROR_WARNING,
    BusState.ERROR_PASSIVE,
    BusState.BUS_OFF,
)


def data(crtl=0, tx=0, rx=0):
    return bytes((0, crtl, 0, 0, 0, 0, tx, rx))


@pytest.mark.parametrize(
    ("error_class", "payload", "before", "after"),
    [
        (0x004, data(0x04), A, W),
        (0x004, data(0x08), A, W),
        (0x004, data(0x10), W, P),
        (0x004, data(0x20), W, P),
        (0x004, data(0x30), A, P),
        (0x004, data(0x40), P, A),
        (0x004, data(0x01), P, P),
        (0x040, data(), P, OFF),
        (0x040 | 0x004, data(0x20), P, OFF),
        (0x100, data(), OFF, A),
        (0x020, data(), A, A),
        (0x008 | 0x080, data(), W, W),
        (0x208, data(tx=95, rx=3), W, A),
        (0x208, data(tx=96), A, W),
        (0x208, data(rx=127), A, W),
        (0x208, data(tx=128), A, P),
        (0x220, data(tx=128), OFF, OFF),
        (0x204, data(0x08, tx=100), A, W),
    ],
)
def test_an_error_frame_moves_the_state_as_linux_describes_it(error_class, payload, before, after):
    assert bus_state(error_class, payload, before) is after


@pytest.mark.parametrize(
    ("fields", "said"),
    [({"channel": ""}, "channel must not be empty"), ({"bitrate": 123}, "bitrate must be one of")],
)
def test_a_bus_that_cannot_be_is_refused(fields, said):
    with pytest.raises(ValueError, match=said):
        CanConfig(**fields)


@pytest.mark.parametrize(
    "channel",
    ["can 0", "can0\n", "can0\xa0", "a/b", "can:0", ".", "..", "c" * 16, "ü" * 8, "can\x000", " "],
)
def test_a_name_that_linux_gives_no_network_device_is_refused_with_what_is_allowed(channel):
    said = "channel must be the name of a network device, such as can0: at most 15 bytes"
    with pytest.raises(ValueError, match=said) as refused:
        CanConfig(channel=channel)
    assert str(refused.value).endswith(f"not {channel!r}")


@pytest.mark.parametrize(
    "channel", ["can0", "vcan-1.b", "c" * 15, "ü" * 7, "...", "0", "a%d", "can@"]
)
def test_a_name_that_linux_gives_a_network_device_is_taken(channel):
    assert CanConfig(channel=channel).channel == channel


@given(st.text(st.sampled_from("aZ09_.-/ :ü\n\xa0"), min_size=1, max_size=20))
def test_a_simulated_bus_may_be_named_as_its_hub_allows(channel):
    try:
        socket_paths(channel)
    except ValueError:
        with pytest.raises(ValueError, match="channel must be the name of a simulated bus"):
            CanConfig("simcan", channel)
    else:
        assert CanConfig("simcan", channel).channel == channel


def test_no_path_of_a_socket_has_a_nul_in_it():
    with pytest.raises(ValueError, match="or the path of its socket, not '/run/"):
        CanConfig("simcan", "/run/\0hub")


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"rate_hz": 0}, "rate_hz must be 1 to 10000"),
        ({"command_timeout_ms": 0}, "command_timeout_ms must be 10 to 1000"),
        ({"rate_hz": 100, "command_timeout_ms": 19}, r"at least two control periods \(20 ms\)"),
        ({"heartbeat_timeout_ms": 0}, "heartbeat_timeout_ms must be positive"),
        ({"sonars": 17}, "sonars must be 0 to 16"),
    ],
)
def test_parameters_that_no_robot_can_have_are_refused(fields, said):
    good = {
        "rate_hz": 200,
        "command_timeout_ms": 100,
        "heartbeat_timeout_ms": 350,
        "sonars": 8,
    }
    NodeParameters(**good)
    with pytest.raises(ValueError, match=said):
        NodeParameters(**{**good, **fields})
