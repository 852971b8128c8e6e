"""Words and process data of CiA 402 against the canopen package and documented bytes."""

import struct
from pathlib import Path

import canopen
import pytest
from canopen.profiles.p402 import State402

from robotctl.drivers.can.drives.cia402 import wire
from robotctl.drivers.can.drives.cia402.device import PROFILE_VELOCITY, VELOCITY, Device
from robotctl.drivers.can.drives.cia402.dialects import DIALECTS
from robotctl.drivers.can.drives.cia402.eds import find_eds, load_eds
from robotctl.drivers.can.drives.cia402.state import PowerSwitch
from tests.drivers.can.drives.cia402.rig import FAKE_EDS

NAMES = {name.upper(): state for state, name in wire.STATE_NAMES.items() if state >= 0}


def device(dialect="generic", eds="drives/cia402.eds", numbers=(1, 2), mode=PROFILE_VELOCITY):
    loaded = load_eds(find_eds(eds)) if eds else None
    return Device(DIALECTS[dialect], loaded, numbers, mode)


def test_every_status_word_means_the_state_that_canopen_finds():
    for word in range(1 << 16):
        theirs = [
            NAMES[name] for name, (mask, value) in State402.SW_MASK.items() if word & mask == value
        ]
        assert wire.STATES[word & wire.STATUS_MASK] == (theirs[0] if theirs else wire.UNKNOWN), word


def test_control_words_on_the_way_to_power_are_those_of_the_standard():
    switch = PowerSwitch("drive", 0, 100)
    switch.wants(False, True)
    words = {}
    for state in range(wire.SWITCH_ON_DISABLED, wire.OPERATION_ENABLED + 1):
        switch.observe(state)
        assert switch.wants(True, True)
        words[state] = switch.word(False)
    assert words == {
        wire.SWITCH_ON_DISABLED: State402.CW_SHUTDOWN,
        wire.READY_TO_SWITCH_ON: State402.CW_SWITCH_ON,
        wire.SWITCHED_ON: State402.CW_OPERATION_ENABLED,
        wire.OPERATION_ENABLED: State402.CW_OPERATION_ENABLED,
    }
    assert switch.wants(False, True) is False
    assert switch.word(True) == State402.CW_QUICK_STOP
    assert switch.word(False) == State402.CW_DISABLE_VOLTAGE


def their_map(node, direction, pdo):
    """The same PDO of the canopen package."""
    their = (node.rpdo if direction == "receive" else node.tpdo)[pdo.number]
    their.clear()
    for each in pdo.objects:
        their.add_variable(each.index, each.subindex, each.bits)
    return their


@pytest.mark.parametrize("mode", [PROFILE_VELOCITY, VELOCITY])
def test_frames_of_the_standard_layout_are_those_that_canopen_packs(mode):
    ours = device(mode=mode)
    node = canopen.RemoteNode(5, str(find_eds("drives/cia402.eds")))
    layout = ours.layout()
    targets = (-12345, 6789) if mode == PROFILE_VELOCITY else (-345, 678)
    frames = dict(wire.Command(layout.receive, 5, mode).frames(0x0F, targets))
    for pdo, target in zip(layout.receive, targets, strict=True):
        their = their_map(node, "receive", pdo)
        their[0].raw, their[1].raw = 0x0F, target
        assert frames[0x200 + 0x100 * (pdo.number - 1) + 5] == bytes(their.data)


def test_canopen_reads_what_we_read_of_a_tpdo():
    layout = device().layout()
    node = canopen.RemoteNode(5, str(find_eds("drives/cia402.eds")))
    received = wire.Received(layout.transmit)
    values = {wire.Role.STATUS: 0x1637, wire.Role.SPEED: -70_000, wire.Role.ERROR: 0x8130,
              wire.Role.POSITION: -(1 << 31), wire.Role.CURRENT: -321}  # fmt: skip
    for (packer, span), pdo in zip(received.spans, layout.transmit, strict=True):
        their = their_map(node, "transmit", pdo)
        for number, (role, _) in enumerate(pdo.parts):
            their[number].raw = values[role]
        received.values[span] = packer.unpack(bytes(their.data))
    for axis in (0, 1):
        for role, value in values.items():
            assert received.values[received.place(role, axis)] == value


def test_a_zlac8015d_gets_both_wheels_in_one_frame_left_in_the_low_half():
    layout = device("zlac8015d", "").layout()
    [(identifier, data)] = wire.Command(layout.receive, 1, 3).frames(0x0F, (100, -100))
    assert (identifier, data.hex(" ")) == (0x201, "0f 00 64 00 9c ff")
    assert layout.receive[0].objects[1].entry == 0x60FF0320
    assert wire.Received(layout.transmit).spans[0][0].unpack(
        struct.pack("<II", 0x0637_0627, 0x0000_0004)
    ) == (0x0627, 0x0637, 4, 0)


class TestDrivesWithAMappingOfTheirOwn:
    @pytest.fixture
    def fixed(self, tmp_path):
        """The stranger's EDS with mappings that cannot be written."""
        text = Path(FAKE_EDS).read_text()
        head, *records = text.split("\n[")
        fixed = [
            each.replace("AccessType=rw", "AccessType=ro")
            if each.startswith(("160", "1A0"))
            else each
            for each in records
        ]
        path = tmp_path / "fixed.eds"
        path.write_text("\n[".join([head, *fixed]))
        return str(path)

    def test_the_pdos_with_what_is_needed_are_taken_as_they_are(self, fixed):
        layout = device(eds=fixed, numbers=(1,)).layout()
        assert not layout.is_ours
        assert [pdo.number for pdo in layout.receive] == [4]
        assert [pdo.number for pdo in layout.transmit] == [3, 4]
        assert dict(wire.Command(layout.receive, 5, 3).frames(0x0F, (-2,))) == {
            0x505: bytes.fromhex("0f00feffffff")
        }

    def test_one_without_what_is_needed_is_refused(self, fixed):
        with pytest.raises(ValueError, match="receives no target velocity of axis 1"):
            device(eds=fixed, numbers=(1,), mode=VELOCITY).layout()
