"""The control state in the world."""

import math

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotctl.messages.control import BusStatus, ControlState, LoopStatistics
from robotctl.messages.estimation import LocalisationState
from robotctl.messages.located import Locator, located
from robotctl.model.geometry.localisation import LocalisationStatus
from robotctl.model.geometry.se2 import SE2

LENGTHS = st.floats(-100.0, 100.0)
ANGLES = st.floats(-3.0, 3.0)
POSES = st.builds(SE2, LENGTHS, LENGTHS, ANGLES)

STATE = msgspec.convert(
    dict.fromkeys(ControlState.__struct_fields__, 0.0)
    | {"type": "ControlState", "stamp_ns": 7, "state": 1, "reason": "", "acks": (), "faults": 0}
    | {"fault": 0, "fault_part": ""}
    | dict.fromkeys(("wheel_rad_s", "wheel_ref_rad_s", "wheel_distance_m", "duty"), ())
    | dict.fromkeys(("current_a", "temperature_c", "sonar_m", "sonar_stamp_ns", "nodes"), ())
    | {"battery": None, "bus": BusStatus(), "loop": LoopStatistics()},
    ControlState,
    strict=False,
)


def control(pose, distance_m=0.0):
    return msgspec.structs.replace(
        STATE, x_m=pose.x_m, y_m=pose.y_m, theta_rad=pose.theta_rad, distance_m=distance_m
    )


def localised(T_world_odom):
    return LocalisationState(
        5, "mcl", LocalisationStatus.LOCALISED,
        T_world_odom.x_m, T_world_odom.y_m, T_world_odom.theta_rad, (0.0,) * 6,
    )  # fmt: skip


@given(POSES, POSES)
def test_the_pose_is_that_of_base_in_world_and_nothing_else_changes(T_world_odom, odometry):
    state = control(odometry)
    found = located(state, localised(T_world_odom))
    there = T_world_odom.apply(odometry.x_m, odometry.y_m)
    assert (found.x_m, found.y_m) == pytest.approx(there, abs=1e-9)
    turned = found.theta_rad - T_world_odom.theta_rad - odometry.theta_rad
    assert math.remainder(turned, math.tau) == pytest.approx(0.0, abs=1e-9)
    rest = msgspec.structs.replace(found, x_m=state.x_m, y_m=state.y_m, theta_rad=state.theta_rad)
    assert rest == state


def test_without_a_localiser_the_pose_is_the_odometrys():
    state = control(SE2(1.0, 2.0, 0.5))
    assert Locator().locate(state) is state


def test_what_was_said_of_one_control_process_is_void_for_the_next():
    locator = Locator()
    locator.localise(localised(SE2(10.0, 0.0, 0.0)))
    assert locator.locate(control(SE2(1.0, 0.0, 0.0), distance_m=5.0)).x_m == 11.0
    assert locator.locate(control(SE2(11.0, 0.0, 0.0), distance_m=0.0)).x_m == 11.0
    locator.localise(localised(SE2(0.5, 0.0, 0.0)))
    assert locator.locate(control(SE2(11.0, 0.0, 0.0), distance_m=0.1)).x_m == 11.5
