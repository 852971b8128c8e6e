"""SERVICES: what one microservice says of itself is all that it takes to add it."""

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import common

from robotctl.mavlink.command import ACCEPTED, DENIED
from robotctl.mavlink.config import MavlinkConfig
from robotctl.mavlink.context import TelemetryRobot
from robotctl.mavlink.service import Microservice
from robotctl.mavlink.services.registry import SERVICES
from robotctl.mavlink.services.telemetry.battery import Battery
from robotctl.mavlink.services.vehicle.arming import Arming
from robotctl.mavlink.telemetry import Telemetry
from tests.mavlink.conftest import FakeLinks
from tests.mavlink.real_links import hear
from tests.mavlink.services.gimbal import Gimbal

mavlink = mavutil.mavlink
POINT = common.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW
STATUS = common.MAVLINK_MSG_ID_GIMBAL_MANAGER_STATUS
GIMBAL_BIT = common.MAV_PROTOCOL_CAPABILITY_COMPONENT_IMPLEMENTS_GIMBAL_MANAGER


@pytest.fixture(params=["without", "with"])
def connected(request, start_robot, station, eventually):
    """Return a robot without or with the further service, and a ground station over TCP."""
    services = (*SERVICES, Gimbal) if request.param == "with" else SERVICES
    robot = start_robot("tcpin:127.0.0.1:0", services=services)
    gcs = station(f"tcp:127.0.0.1:{robot.port()}")
    hear(eventually, robot, gcs, "HEARTBEAT")
    return robot, gcs, request.param == "with"


def ask(eventually, robot, gcs, number, *params):
    """Send a command and return its result."""
    params = (*params, *[0.0] * (7 - len(params)))
    gcs.mav.command_long_send(1, 1, number, 0, *params)
    return hear(eventually, robot, gcs, "COMMAND_ACK", command=number).result


def test_one_line_adds_command_message_stream_and_capability(connected, eventually):
    robot, gcs, added = connected
    gcs.mav.srcSystem = 201
    expected = ACCEPTED if added else mavlink.MAV_RESULT_UNSUPPORTED
    assert ask(eventually, robot, gcs, POINT, 10.0) == expected
    assert ask(eventually, robot, gcs, 512, 148) == ACCEPTED
    version = gcs.messages["AUTOPILOT_VERSION"]
    assert bool(version.capabilities & GIMBAL_BIT) == added
    if not added:
        assert ask(eventually, robot, gcs, 512, STATUS) == DENIED
        assert ask(eventually, robot, gcs, 511, STATUS, 1e5) == DENIED
        return
    hear(eventually, robot, gcs, "GIMBAL_MANAGER_STATUS", primary_control_sysid=201)
    assert ask(eventually, robot, gcs, POINT, 91.0) == DENIED
    assert "allowed -90 to 90" in hear(eventually, robot, gcs, "STATUSTEXT", severity=4).text

    gcs.mav.srcSystem = 202
    gcs.mav.gimbal_manager_set_pitchyaw_send(1, 1, 0, 1, 0.1, 0.0, 0.0, 0.0)
    hear(eventually, robot, gcs, "GIMBAL_MANAGER_STATUS", primary_control_sysid=202)

    assert ask(eventually, robot, gcs, 510, STATUS) == ACCEPTED
    assert gcs.messages["MESSAGE_INTERVAL"].interval_us == 200_000
    assert ask(eventually, robot, gcs, 511, STATUS, -1) == ACCEPTED
    assert ask(eventually, robot, gcs, 512, STATUS) == ACCEPTED


def test_what_a_service_says_of_itself_is_what_is_dispatched(bench):
    """Every command and stream of every service is answered as its own; no list is kept by hand."""
    context = bench.telemetry._context
    members = [make(context) for make in SERVICES]
    capabilities = 0
    for member in members:
        capabilities |= member.capabilities
        for number in member.commands:
            owner = context.catalogue.commands[number].__self__
            assert type(owner) is type(member)
        for stream in member.streams():
            assert context.catalogue.streams[stream.message_id].rate_hz == stream.rate_hz
    assert context.catalogue.capabilities == capabilities
    assert capabilities == (
        common.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
        | common.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
        | common.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_GLOBAL_INT
        | common.MAV_PROTOCOL_CAPABILITY_FLIGHT_TERMINATION
        | common.MAV_PROTOCOL_CAPABILITY_MAVLINK2
        | common.MAV_PROTOCOL_CAPABILITY_MISSION_INT
        | common.MAV_PROTOCOL_CAPABILITY_MISSION_FENCE
        | common.MAV_PROTOCOL_CAPABILITY_MISSION_RALLY
        | common.MAV_PROTOCOL_CAPABILITY_FTP
    )


def test_a_service_takes_only_what_it_says():
    """Whoever lists commands carries them out, and the other way round."""
    for service in SERVICES:
        for said, name in ((service.commands, "on_command"), (service.handles, "on_message")):
            does = getattr(service, name) is not getattr(Microservice, name)
            assert bool(said) == does, service


@pytest.mark.parametrize(
    ("service", "said"),
    [
        (Battery, r"message 147 belongs to Battery; Battery claims it, too"),
        (Arming, r"MAV_CMD 185 belongs to Arming; Arming claims it, too"),
    ],
)
def test_two_services_for_one_thing_are_refused(service, said):
    with pytest.raises(ValueError, match=said):
        Telemetry(MavlinkConfig(), TelemetryRobot(), FakeLinks(), (*SERVICES, service))


def test_a_service_needs_to_write_only_what_it_does(bench):
    """The least service is an empty class."""
    telemetry = Telemetry(bench.config, bench.robot, bench.links, (Microservice,))
    assert telemetry.step(bench.now_ns, []) == []
