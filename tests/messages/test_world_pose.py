"""The one policy on what counts as a pose in the world."""

import math

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotctl.messages.control import BusStatus, ControlState, LoopStatistics
from robotctl.messages.estimation import LocalisationState
from robotctl.messages.procedures import Procedure
from robotctl.messages.world_pose import WorldPose
from robotctl.model.geometry.localisation import LocalisationStatus
from robotctl.model.geometry.se2 import SE2

LENGTHS = st.floats(-100.0, 100.0)
ANGLES = st.floats(-3.0, 3.0)
POSES = st.builds(SE2, LENGTHS, LENGTHS, ANGLES)

STATE = msgspec.convert(
    dict.fromkeys(ControlState.__struct_fields__, 0.0)
    | {"type": "ControlState", "stamp_ns": 7, "state": 1, "reason": "", "acks": (), "faults": 0}
    | {"fault": 0, "fault_part": "", "against_arming": ()}
    | dict.fromkeys(("wheel_rad_s", "wheel_ref_rad_s", "wheel_distance_m", "duty"), ())
    | dict.fromkeys(("current_a", "temperature_c", "sonar_m", "sonar_stamp_ns", "nodes"), ())
    | {"battery": None, "imu": None, "bus": BusStatus(), "loop": LoopStatistics()}
    | {"procedure": Procedure()},
    ControlState,
    strict=False,
)


LOCALISED, SEARCHING, LOST = (
    LocalisationStatus.LOCALISED, LocalisationStatus.SEARCHING, LocalisationStatus.LOST
)  # fmt: skip


def control(pose, odom_epoch_ns=0):
    return msgspec.structs.replace(
        STATE, x_m=pose.x_m, y_m=pose.y_m, theta_rad=pose.theta_rad, odom_epoch_ns=odom_epoch_ns
    )


def belief(T_world_odom, status=LOCALISED, odom_epoch_ns=0):
    return LocalisationState(
        5, "mcl", status,
        T_world_odom.x_m, T_world_odom.y_m, T_world_odom.theta_rad, (0.0,) * 6,
        odom_epoch_ns=odom_epoch_ns,
    )  # fmt: skip


@given(POSES, POSES)
def test_the_pose_is_that_of_odom_in_world_times_that_of_base_in_odom(T_world_odom, odometry):
    world = WorldPose(has_localiser=True)
    world.localise(belief(T_world_odom))
    found = world.pose(control(odometry))
    there = T_world_odom.apply(odometry.x_m, odometry.y_m)
    assert (found.x_m, found.y_m) == pytest.approx(there, abs=1e-9)
    turned = found.theta_rad - T_world_odom.theta_rad - odometry.theta_rad
    assert math.remainder(turned, math.tau) == pytest.approx(0.0, abs=1e-9)


@given(POSES)
def test_without_a_localiser_odom_is_world_to_the_bit(odometry):
    world = WorldPose(has_localiser=False)
    assert world.pose(control(odometry)) == odometry
    assert world.T_world_odom(control(odometry)) == SE2()
    assert world.is_sure(control(odometry))


@pytest.mark.parametrize("status", [SEARCHING, LOST])
def test_a_guess_is_no_place_and_moves_none(status):
    world = WorldPose(has_localiser=True)
    state = control(SE2(1.0, 2.0, 0.5))
    assert world.pose(state) is None
    world.localise(belief(SE2(30.0, 0.0, 1.0), status))
    assert world.pose(state) is None
    assert not world.is_sure(state)
    world.localise(belief(SE2(10.0, 0.0, 0.0)))
    assert world.pose(state) == SE2(11.0, 2.0, 0.5)
    assert world.is_sure(state)
    world.localise(belief(SE2(30.0, 0.0, 1.0), status))
    assert world.pose(control(SE2(1.5, 2.0, 0.5))) == SE2(11.5, 2.0, 0.5)
    assert not world.is_sure(state)


def test_a_place_that_is_tracked_is_good_enough_to_drive_by_but_not_sure():
    """Odometry goes on from the last place that was sure."""
    world = WorldPose(has_localiser=True)
    tracked = msgspec.structs.replace(belief(SE2(10.4, 0.0, 0.0), SEARCHING), tracked=True)
    world.localise(tracked)
    assert not world.is_tracked(control(SE2()))  # nothing was sure yet
    world.localise(belief(SE2(10.0, 0.0, 0.0)))
    assert world.is_tracked(control(SE2()))
    world.localise(tracked)
    assert world.is_tracked(control(SE2()))
    assert not world.is_sure(control(SE2()))
    assert world.pose(control(SE2(1.0, 0.0, 0.0))) == SE2(11.0, 0.0, 0.0)
    assert not world.is_tracked(control(SE2(), odom_epoch_ns=3))
    world.localise(belief(SE2(10.4, 0.0, 0.0), SEARCHING))
    assert not world.is_tracked(control(SE2()))


@pytest.mark.parametrize("epochs", [(0, 7), (7, 0), (7, 9)])
def test_what_was_said_of_one_odometry_is_void_for_another(epochs):
    before, after = epochs
    world = WorldPose(has_localiser=True)
    world.localise(belief(SE2(10.0, 0.0, 0.0), odom_epoch_ns=before))
    assert world.pose(control(SE2(1.0, 0.0, 0.0), before)) == SE2(11.0, 0.0, 0.0)
    assert world.pose(control(SE2(11.0, 0.0, 0.0), after)) is None
    assert not world.is_sure(control(SE2(), after))
    world.localise(belief(SE2(0.5, 0.0, 0.0), odom_epoch_ns=after))
    assert world.pose(control(SE2(11.0, 0.0, 0.0), after)) == SE2(11.5, 0.0, 0.0)


def test_a_localiser_that_nobody_waited_for_counts():
    world = WorldPose(has_localiser=False)
    world.localise(belief(SE2(10.0, 0.0, 0.0), SEARCHING))
    assert world.pose(control(SE2())) is None
