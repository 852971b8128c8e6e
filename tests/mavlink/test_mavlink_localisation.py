"""What ground stations see of the localiser, and what they may tell it."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common

from robotctl.mavlink import frames
from robotctl.mavlink.context import TelemetryRobot
from robotctl.mavlink.telemetry import Telemetry
from robotctl.messages.control import Arm, ExternalPose
from robotctl.messages.estimation import LocalisationState
from robotctl.model.geometry.localisation import LocalisationStatus

COVARIANCE = (0.04, 0.01, 0.002, 0.09, -0.003, 0.0025)
ARM_DISARM = common.MAV_CMD_COMPONENT_ARM_DISARM


def localised(now_ns, **changes):
    values = {
        "stamp_ns": now_ns,
        "method": "mcl",
        "status": LocalisationStatus.LOCALISED,
        "x_m": 0.0,
        "y_m": 0.0,
        "theta_rad": 0.0,
        "covariance": COVARIANCE,
    }
    return LocalisationState(**(values | changes))


def last(bench, name):
    return bench.messages(name)[-1]


def test_positions_are_those_of_the_localiser(bench):
    # The odometry's frame is turned by 90 degrees and lies at (10, 20): base at (1, 2) in it is
    # at (10 - 2, 20 + 1) in world, heading 90 degrees: north 21, east 8, yaw 0.
    there = localised(bench.now_ns + 20_000_000, x_m=10.0, y_m=20.0, theta_rad=math.pi / 2)
    bench.step(there, bench.control(x_m=1.0, y_m=2.0, theta_rad=0.0))
    bench.take()
    bench.run(1.0, x_m=1.0, y_m=2.0, theta_rad=0.0)
    sent = bench.take()
    (position,) = {
        (message.x, message.y) for message, _ in sent if message.get_type() == "LOCAL_POSITION_NED"
    }
    assert position == pytest.approx((21.0, 8.0), abs=1e-5)
    (yaw,) = {message.yaw for message, _ in sent if message.get_type() == "ATTITUDE"}
    assert yaw == pytest.approx(0.0, abs=1e-6)


def test_odometry_carries_the_covariance_in_ned_and_says_whose_estimate_it_is(bench):
    bench.step(localised(bench.now_ns + 20_000_000), bench.control())
    bench.take()
    bench.run(0.5)
    message = last(bench, "ODOMETRY")
    assert message.estimator_type == common.MAV_ESTIMATOR_TYPE_AUTOPILOT
    # Upper triangle of a 6 x 6: x north = our y, y east = our x, yaw the other way round.
    values = message.pose_covariance
    found = [values[0], values[1], values[5], values[6], values[10], values[20]]
    assert found == pytest.approx([0.09, 0.01, 0.003, 0.04, -0.002, 0.0025], rel=1e-6)
    assert all(math.isnan(values[place]) for place in (2, 3, 4, 7, 8, 9, 11, 15, 18, 19))


def test_without_a_localiser_the_covariance_is_unknown(bench):
    bench.run(0.5)
    message = last(bench, "ODOMETRY")
    assert message.estimator_type == common.MAV_ESTIMATOR_TYPE_NAIVE
    assert all(math.isnan(value) for value in message.pose_covariance)


@given(st.lists(st.floats(-1.0, 1.0), min_size=9, max_size=9))
def test_covariances_survive_the_way_to_ned_and_back(numbers):
    A = np.array(numbers).reshape(3, 3)
    P = A @ A.T + 0.01 * np.eye(3)
    upper = tuple(P[np.triu_indices(3)])
    assert frames.pose_covariance_enu(frames.pose_covariance_ned(upper)) == pytest.approx(upper)


def test_the_covariance_is_turned_as_the_pose_is():
    # Law: with J the Jacobian of (north, east, yaw) by (x, y, theta), the covariance is J P J^T.
    J = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    P = np.array([[0.04, 0.01, 0.002], [0.01, 0.09, -0.003], [0.002, -0.003, 0.0025]])
    values = frames.pose_covariance_ned(COVARIANCE)
    ned = np.array(
        [
            [values[0], values[1], values[5]],
            [values[1], values[6], values[10]],
            [values[5], values[10], values[20]],
        ]
    )
    assert ned == pytest.approx(J @ P @ J.T)


def vision(now_ns, north=3.0, east=4.0, yaw=0.25, covariance=None):
    return common.MAVLink_vision_position_estimate_message(
        now_ns // 1000, north, east, 0.0, 0.0, 0.0, yaw, covariance or [math.nan] * 21, 0
    )


def odometry(now_ns, frame=common.MAV_FRAME_LOCAL_NED, q=(1.0, 0.0, 0.0, 0.0), north=3.0):
    unknown = [math.nan] * 21
    return common.MAVLink_odometry_message(
        now_ns // 1000, frame, common.MAV_FRAME_BODY_FRD, north, 4.0, 0.0, q,
        0.0, 0.0, 0.0, 0.0, 0.0, 0.0, unknown, unknown, 0, 0, 0,
    )  # fmt: skip


def test_a_vision_estimate_is_a_pose_in_world_at_its_time(bench):
    bench.receive(vision(bench.now_ns - 80_000_000))
    (request,) = bench.step()
    assert isinstance(request, ExternalPose)
    assert (request.x_m, request.y_m) == (4.0, 3.0)
    assert request.theta_rad == pytest.approx(math.pi / 2 - 0.25)
    assert request.covariance == ()
    assert request.stamp_ns == bench.now_ns - 20_000_000 - 80_000_000


def test_a_covariance_comes_along(bench):
    bench.receive(vision(bench.now_ns, covariance=frames.pose_covariance_ned(COVARIANCE)))
    (request,) = bench.step()
    assert request.covariance == pytest.approx(COVARIANCE, rel=1e-6)


@pytest.mark.parametrize("off_s", [-30.0, 5.0, 1.7e9])
def test_the_time_of_another_clock_counts_from_arrival(bench, off_s):
    bench.receive(vision(bench.now_ns + round(off_s * 1e9)))
    (request,) = bench.step()
    assert request.stamp_ns == bench.now_ns


def test_an_odometry_message_turns_by_its_quaternion(bench):
    yaw = -1.1
    bench.receive(odometry(bench.now_ns, q=(math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2))))
    (request,) = bench.step()
    assert request.theta_rad == pytest.approx(math.pi / 2 + 1.1)


@pytest.mark.parametrize(
    "message",
    [
        lambda now_ns: vision(now_ns, north=math.nan),
        lambda now_ns: vision(now_ns, east=math.inf),
        lambda now_ns: vision(now_ns, yaw=math.nan),
        lambda now_ns: vision(now_ns, north=2.0e6),
        lambda now_ns: odometry(now_ns, q=(0.0, 0.0, 0.0, 0.0)),
        lambda now_ns: odometry(now_ns, q=(math.nan,) * 4),
        lambda now_ns: odometry(now_ns, frame=common.MAV_FRAME_BODY_FRD),
    ],
)
def test_what_is_no_pose_in_the_world_is_dropped(bench, message):
    bench.receive(message(bench.now_ns))
    assert bench.step() == []


def test_a_robot_with_a_localiser_is_armed_when_that_is_ready(make_bench):
    bench = make_bench()
    robot = TelemetryRobot("tester", "1.2.3", (), has_localiser=True)
    bench.telemetry = Telemetry(bench.config, robot, bench.links)
    bench.run(0.2)
    bench.command(ARM_DISARM, 1.0)
    assert bench.step(bench.control()) == []
    (ack,) = bench.messages("COMMAND_ACK")
    assert ack.result == common.MAV_RESULT_TEMPORARILY_REJECTED
    bench.step(localised(bench.now_ns + 20_000_000), bench.control())
    bench.command(ARM_DISARM, 1.0, confirmation=1)
    (request,) = bench.step(localised(bench.now_ns + 20_000_000), bench.control())
    assert isinstance(request, Arm)
    assert request.arm


def test_disarming_needs_no_localiser(make_bench):
    bench = make_bench()
    robot = TelemetryRobot("tester", "1.2.3", (), has_localiser=True)
    bench.telemetry = Telemetry(bench.config, robot, bench.links)
    bench.command(ARM_DISARM, 0.0)
    (request,) = bench.step(bench.control())
    assert isinstance(request, Arm)
    assert not request.arm


def seeking_bench(make_bench):
    """Return the bench of a robot that has a localiser."""
    bench = make_bench()
    robot = TelemetryRobot("tester", "1.2.3", (), has_localiser=True)
    bench.telemetry = Telemetry(bench.config, robot, bench.links)
    return bench


def local_velocity(vx=0.0, vy=0.0, mask=0x0FC7):
    return common.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, common.MAV_FRAME_LOCAL_NED, mask, 0.0, 0.0, 0.0, vx, vy, *[0.0] * 6
    )


@pytest.mark.parametrize("status", [None, *LocalisationStatus])
def test_a_local_velocity_needs_a_heading_that_is_known(make_bench, status):
    bench = seeking_bench(make_bench)
    bench.receive(local_velocity(vy=0.5))
    believed = () if status is None else (localised(bench.now_ns + 20_000_000, status=status),)
    requests = bench.step(*believed, bench.control(theta_rad=0.0))
    if status is LocalisationStatus.LOCALISED:
        (request,) = requests
        assert (request.v_m_s, request.omega_rad_s) == pytest.approx((0.5, 0.0))
    else:
        assert requests == []
        assert "Setpoint: local velocity, but heading not known" in bench.texts()


def test_a_local_velocity_of_zero_stops_a_robot_that_does_not_know_its_heading(make_bench):
    bench = seeking_bench(make_bench)
    bench.receive(local_velocity())
    (request,) = bench.step(bench.control(theta_rad=0.0))
    assert (request.v_m_s, request.omega_rad_s) == (0.0, 0.0)


def test_what_the_localiser_said_a_while_ago_is_no_heading(make_bench):
    bench = seeking_bench(make_bench)
    bench.step(localised(bench.now_ns), bench.control())
    bench.run(1.1)
    bench.receive(local_velocity(vy=0.5))
    assert bench.step(bench.control(theta_rad=0.0)) == []
