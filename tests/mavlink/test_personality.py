"""What the robot claims to be, as ground stations understand that: by pymavlink's own tables."""

import math
import struct

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import common as m

from robotctl.config.robot_file import contradictions, find_file, load_robot
from robotctl.dialect import additions as d
from robotctl.mavlink.parameters.parameter_set import Configurations, ParameterSet
from robotctl.mavlink.personality import PERSONALITIES
from robotctl.mavlink.telemetry import Telemetry
from robotctl.messages.control import Mode, SetMode
from robotctl.messages.mission import JumpToItem
from tests.mavlink.conftest import Bench
from tests.mavlink.services.plans.test_missions import Navigation, download, item, numbers, upload

NAMES = tuple(PERSONALITIES)
CONFIG = load_robot(find_file("diff_drive"))
AUTOPILOTS = {
    "ardupilot": m.MAV_AUTOPILOT_ARDUPILOTMEGA,
    "px4": m.MAV_AUTOPILOT_PX4,
    "generic": m.MAV_AUTOPILOT_GENERIC,
}
PX4_NAMES = {
    Mode.MANUAL: "MANUAL", Mode.HOLD: "LOITER", Mode.AUTO: "MISSION",
    Mode.RTL: "RTL", Mode.GUIDED: "OFFBOARD",
}  # fmt: skip
CUSTOM = m.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED


@pytest.fixture(params=NAMES)
def named(request):
    """Return a personality's name, and a robot that has it."""
    bench = Bench(personality=request.param)
    parameters = ParameterSet(Configurations(CONFIG, CONFIG, contradictions), {})
    bench.telemetry = Telemetry(bench.config, bench.robot, bench.links, parameters=parameters)
    return request.param, bench


@pytest.mark.parametrize("mode", Mode)
def test_stations_know_the_mode_by_its_name(named, mode):
    name, bench = named
    bench.step(bench.control(), bench.navigation(mode=mode))
    beat = bench.messages("HEARTBEAT")[-1]
    assert (beat.autopilot, beat.type) == (AUTOPILOTS[name], m.MAV_TYPE_GROUND_ROVER)
    expected = {"px4": PX4_NAMES[mode], "ardupilot": mode.name}
    if name in expected:
        assert mavutil.mode_string_v10(beat) == expected[name]
    bench.command(m.MAV_CMD_REQUEST_MESSAGE, d.MAVLINK_MSG_ID_AVAILABLE_MODES)
    bench.step()
    listed = {each.mode_name: each.custom_mode for each in bench.messages("AVAILABLE_MODES")}
    assert listed[mode.name] == beat.custom_mode


@pytest.mark.parametrize("mode", Mode)
def test_a_mode_is_chosen_as_its_stations_do(named, mode):
    name, bench = named
    ways = [(m.MAVLink_set_mode_message(1, CUSTOM, PERSONALITIES[name].modes[mode]))]
    if name == "px4":
        _, main, sub = mavutil.px4_map[PX4_NAMES[mode]]
        ways.append(m.MAVLink_command_long_message(1, 1, 176, 0, CUSTOM, main, sub, 0, 0, 0, 0))
    else:
        ways.append(m.MAVLink_command_long_message(1, 1, 176, 0, CUSTOM, mode.value, 0, 0, 0, 0, 0))
    for system, message in enumerate(ways, 100):
        bench.receive(message, system=system)
        (request,) = bench.step(bench.control(), bench.navigation(mode=Mode.HOLD))
        assert isinstance(request, SetMode)
        assert request.mode is mode


def test_modes_that_it_has_not_are_denied(named):
    name, bench = named
    for second, third in ((7, 0), (3, 0), (math.nan, 0), (1e9, 1e9), *[(4, 9)] * (name == "px4")):
        bench.command(m.MAV_CMD_DO_SET_MODE, CUSTOM, second, third)
        assert bench.step(bench.control(), bench.navigation()) == []
        acks = [each.result for each in bench.messages("COMMAND_ACK")]
        assert acks == [m.MAV_RESULT_DENIED]


def test_integers_are_packed_as_stations_of_that_claim_unpack_them(named):
    name, bench = named
    bytewise = name != "ardupilot"
    bench.command(m.MAV_CMD_REQUEST_MESSAGE, m.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
    bench.step()
    capabilities = bench.messages("AUTOPILOT_VERSION")[0].capabilities
    assert bool(capabilities & m.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE) == bytewise
    assert bool(capabilities & m.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST) != bytewise
    bench.receive(m.MAVLink_param_request_list_message(1, 1))
    values = []
    for _ in range(100):
        bench.step()
        values += bench.messages("PARAM_VALUE")
    whole = next(each for each in values if each.param_type == m.MAV_PARAM_TYPE_INT32)

    def unpacked(number):
        return struct.unpack("<i", struct.pack("<f", number))[0] if bytewise else int(number)

    def packed(number):
        return struct.unpack("<f", struct.pack("<i", number))[0] if bytewise else float(number)

    before = unpacked(whole.param_value)
    assert 0 <= before < 100_000
    kind = m.MAV_PARAM_TYPE_INT32
    for wanted in (before + 1, before):
        bench.receive(
            m.MAVLink_param_set_message(1, 1, whole.param_id.encode(), packed(wanted), kind)
        )
        bench.step(bench.control())
        (now,) = bench.messages("PARAM_VALUE")
        assert unpacked(now.param_value) == wanted
    real = next(each for each in values if each.param_id == "CRUISE_SPEED")
    assert real.param_value == pytest.approx(CONFIG.navigation.guided_speed_m_s)


def test_item_0_is_home_for_ardupilot_only_and_numbers_agree_everywhere(named):
    name, bench = named
    navigation = Navigation(bench)
    navigation.step()
    bench.take()
    first = 1 if name == "ardupilot" else 0
    own = [
        item(first, x=3.0, y=1.5),
        item(first + 1, x=2.0, y=1.5),
        item(first + 2, m.MAV_CMD_DO_JUMP, (first + 1, 2)),
    ]
    plan = [item(0)] * first + own
    assert upload(navigation, plan) == m.MAV_MISSION_ACCEPTED
    assert [each["kind"] for each in navigation.mission["item"]] == ["goto", "goto", "jump"]
    assert navigation.mission["item"][2]["to"] == 2
    back = download(navigation)
    assert [numbers(each) for each in back[first:]] == [numbers(each) for each in own]
    bench.command(m.MAV_CMD_DO_SET_MISSION_CURRENT, first + 1)
    assert [each.item for each in navigation.step() if isinstance(each, JumpToItem)] == [2]
    bench.take()
    navigation.step(advance_s=1.0, item=1, mode=Mode.AUTO)
    sent = [each for each, _ in bench.take()]
    assert [e.seq for e in sent if e.get_type() == "MISSION_ITEM_REACHED"] == [first]
    current = [e for e in sent if e.get_type() == "MISSION_CURRENT"][-1]
    assert (current.seq, current.total) == (first + 1, 3)
    bad = [*plan[:-1], item(first + 2, m.MAV_CMD_DO_JUMP, (first + 7, 2))]
    navigation.state["mode"] = Mode.HOLD
    bench.take()
    bench.receive(m.MAVLink_mission_count_message(1, 1, len(bad)))
    said = []
    for _ in range(10):
        navigation.step()
        for message in [each for each, _ in bench.take()]:
            if message.get_type() == "MISSION_REQUEST_INT":
                bench.receive(bad[message.seq])
            if message.get_type() == "STATUSTEXT":
                said.append(message.text)
    (text,) = [each for each in said if "jumps" in each]
    assert f"item {first + 2}: jumps to {first + 7}, {first} to {first + 2} allowed" in text
    for empty in (m.MAVLink_mission_count_message(1, 1, 0),):
        bench.receive(empty)
        for _ in range(3):
            navigation.step()
        assert [e.type for e in bench.messages("MISSION_ACK")] == [m.MAV_MISSION_ACCEPTED]
    assert download(navigation) == []


def test_fields_without_a_value_hold_what_the_claim_says(named):
    name, bench = named
    bench.step(bench.control(v_m_s=0.25))
    bench.command(m.MAV_CMD_REQUEST_MESSAGE, m.MAVLINK_MSG_ID_VFR_HUD)
    bench.step()
    (hud,) = bench.messages("VFR_HUD")
    assert hud.groundspeed == 0.25
    assert hud.airspeed == 0.25 if name == "ardupilot" else math.isnan(hud.airspeed)
