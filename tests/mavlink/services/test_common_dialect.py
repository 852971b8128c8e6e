"""What robotctl's own dialect adds, as a station sees it."""

import json
import math
import zlib

import pytest
from pymavlink.dialects.v20 import common as m

from robotctl.dialect import additions as d
from robotctl.messages.control import Ack, Arm, Mode, SetMode
from tests.mavlink.services.test_on_request import ACCEPTED, DENIED, ask

CANCELLED = d.MAV_RESULT_CANCELLED


def test_modes_are_listed_all_or_one_and_told_when_they_change(bench):
    bench.step(bench.control(), bench.navigation(mode=Mode.HOLD))
    bench.take()
    bench.command(m.MAV_CMD_REQUEST_MESSAGE, d.MAVLINK_MSG_ID_AVAILABLE_MODES)
    bench.step()
    modes = bench.messages("AVAILABLE_MODES")
    assert [each.mode_index for each in modes] == list(range(1, modes[0].number_modes + 1))
    by_name = {each.mode_name: each for each in modes}
    assert by_name.keys() == {mode.name for mode in Mode}
    assert {name: each.custom_mode for name, each in by_name.items()} == {
        "MANUAL": 0, "HOLD": 4, "AUTO": 10, "RTL": 11, "GUIDED": 15,
    }  # fmt: skip
    assert by_name["AUTO"].standard_mode == m.MAV_STANDARD_MODE_MISSION
    for wanted, names, result in ((2, ["HOLD"], ACCEPTED), (9, [], DENIED)):
        index = next((e.mode_index for e in modes if e.mode_name in names), wanted)
        bench.command(m.MAV_CMD_REQUEST_MESSAGE, d.MAVLINK_MSG_ID_AVAILABLE_MODES, index)
        bench.step()
        sent = [each for each, _ in bench.take()]
        assert [each.mode_name for each in sent if each.get_type() == "AVAILABLE_MODES"] == names
        assert [each.result for each in sent if each.get_type() == "COMMAND_ACK"] == [result]
    bench.command(m.MAV_CMD_SET_MESSAGE_INTERVAL, d.MAVLINK_MSG_ID_CURRENT_MODE, 1e9)
    bench.step(bench.navigation(mode=Mode.HOLD))
    bench.take()
    bench.step(bench.navigation(mode=Mode.RTL))
    (now,) = bench.messages("CURRENT_MODE")
    assert (now.custom_mode, now.standard_mode) == (11, m.MAV_STANDARD_MODE_SAFE_RECOVERY)


def test_a_standard_mode_is_one_of_ours_or_denied(bench):
    bench.command(m.MAV_CMD_DO_SET_STANDARD_MODE, m.MAV_STANDARD_MODE_MISSION)
    (request,) = bench.step()
    assert request.mode is Mode.AUTO
    bench.take()
    bench.command(m.MAV_CMD_DO_SET_STANDARD_MODE, m.MAV_STANDARD_MODE_LAND, system=9)
    assert bench.step() == []
    assert [each.result for each in bench.messages("COMMAND_ACK")] == [DENIED]


def test_a_request_to_arm_may_be_taken_back(bench):
    bench.command(m.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    (arm,) = bench.step(bench.control())
    cancel = d.MAVLink_command_cancel_message(1, 1, m.MAV_CMD_COMPONENT_ARM_DISARM)
    bench.receive(cancel, system=9)  # not its sender
    assert bench.step() == []
    bench.receive(cancel)
    (disarm,) = bench.step(bench.control())
    assert isinstance(disarm, Arm)
    assert not disarm.arm
    assert [each.result for each in bench.messages("COMMAND_ACK")] == [CANCELLED]
    bench.step(bench.control(acks=(Ack(arm.request_id, accepted=True),)))
    bench.receive(cancel)
    assert bench.step() == []
    assert bench.messages("COMMAND_ACK") == []


def test_a_request_for_a_mode_may_be_taken_back(bench):
    bench.command(m.MAV_CMD_NAV_RETURN_TO_LAUNCH)
    bench.step(bench.control())
    bench.receive(d.MAVLink_command_cancel_message(1, 1, m.MAV_CMD_NAV_RETURN_TO_LAUNCH))
    (request,) = bench.step()
    assert isinstance(request, SetMode)
    assert request.mode is Mode.HOLD
    assert [each.result for each in bench.messages("COMMAND_ACK")] == [CANCELLED]


def test_motor_controllers_tell_speed_voltage_current_and_who_is_heard(bench):
    state = bench.control(
        wheel_rad_s=(math.tau, math.nan),
        wheel_ref_rad_s=(7.0, 1.0),
        current_a=(1.5, 0.0),
        temperature_c=(31.5, math.nan),
        duty=(0.25, 0.0),
        bus_voltage_v=12.5,
    )
    (status,) = ask(bench, "ESC_STATUS", state)
    assert list(status.rpm) == [60, 0, 0, 0]
    assert status.voltage[0] == 12.5
    assert status.current[0] == 1.5
    (info,) = ask(bench, "ESC_INFO", state)
    assert (info.count, info.info, info.connection_type) == (2, 0b01, 4)
    assert list(info.temperature[:2]) == [3150, 32767]
    (loops,) = ask(bench, "DEBUG_FLOAT_ARRAY", state)
    assert list(loops.data[:3]) == pytest.approx([7.0, math.tau, 0.25])


def test_the_version_of_the_protocol_is_told_in_two_ways(bench):
    (version,) = ask(bench, "PROTOCOL_VERSION")
    assert (version.min_version, version.version, version.max_version) == (100, 200, 200)
    bench.command(m.MAV_CMD_REQUEST_PROTOCOL_VERSION, 1)
    bench.step()
    assert len(bench.messages("PROTOCOL_VERSION")) == 1


def test_metadata_are_where_and_what_the_message_says(bench):
    (where,) = ask(bench, "COMPONENT_METADATA")
    prefix = "mftp://"
    assert where.uri.startswith(prefix)
    path = where.uri.removeprefix(prefix).encode()
    opened = request(bench, 4, path)
    size = int.from_bytes(opened[12:16], "little")
    content = b""
    while len(content) < size:
        reply = request(bench, 5, session=opened[2], offset=len(content), size=239)
        content += reply[12 : 12 + reply[4]]
    assert json.loads(content)["metadataTypes"][0]["type"] == 1
    # CRC-32 without inversions: that of PX4's and QGroundControl's `crc32part(…, 0)`.
    assert where.file_crc == zlib.crc32(content, 0xFFFFFFFF) ^ 0xFFFFFFFF


def request(bench, opcode, data=b"", *, session=0, offset=0, size=None):
    """Send one request of MAVLink FTP; return the payload of the reply."""
    request.seq += 1
    head = request.seq.to_bytes(2, "little") + bytes(
        (session, opcode, len(data) if size is None else size, 0, 0, 0)
    )
    payload = (head + offset.to_bytes(4, "little") + data).ljust(251, b"\0")
    bench.receive(m.MAVLink_file_transfer_protocol_message(0, 1, 1, payload))
    bench.step()
    (reply,) = bench.messages("FILE_TRANSFER_PROTOCOL")
    assert reply.payload[3] == 128, list(reply.payload[:14])
    return bytes(reply.payload)


request.seq = 0
