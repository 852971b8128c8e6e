"""The microservice of docs/extending.md is served by the robot as it is started."""

from pymavlink.dialects.v20 import common
from robotctl.mavlink.services.vehicle.gimbal import Gimbal

from robotctl.mavlink.services.registry import SERVICES
from tests.mavlink.conftest import Bench

GIMBAL = common.MAV_PROTOCOL_CAPABILITY_COMPONENT_IMPLEMENTS_GIMBAL_MANAGER


def test_command_message_stream_and_capability():
    assert Gimbal in SERVICES
    bench = Bench()
    bench.run(1.0)
    assert len(bench.messages("GIMBAL_MANAGER_STATUS")) == 5
    for pitch, result in ((30.0, common.MAV_RESULT_ACCEPTED), (91.0, common.MAV_RESULT_DENIED)):
        bench.command(common.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW, pitch, system=7)
        bench.step()
        (ack,) = bench.messages("COMMAND_ACK")
        assert ack.result == result
    bench.run(1.0)
    assert bench.messages("GIMBAL_MANAGER_STATUS")[-1].primary_control_sysid == 7
    pitchyaw = common.MAVLink_gimbal_manager_set_pitchyaw_message(1, 1, 0, 1, 0.1, 0.0, 0.0, 0.0)
    bench.receive(pitchyaw, system=8)
    bench.run(1.0)
    assert bench.messages("GIMBAL_MANAGER_STATUS")[-1].primary_control_sysid == 8
    bench.command(common.MAV_CMD_REQUEST_MESSAGE, common.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
    bench.step()
    (version,) = bench.messages("AUTOPILOT_VERSION")
    assert version.capabilities & GIMBAL
