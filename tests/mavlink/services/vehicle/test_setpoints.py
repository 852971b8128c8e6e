"""Set-points and sticks: what drives the robot, when it is void, and what is refused."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common

from robotctl.mavlink.context import TRANSPORT_NS
from robotctl.messages.control import (
    ManualControl,
    Mode,
    PositionTarget,
    SafetyState,
    VelocityTarget,
)
from robotctl.messages.requests import FARTHEST_M

BODY_NED, BODY_OFFSET_NED, BODY_FRD, LOCAL = 8, 9, 12, 1
# Bits of type_mask: 0-2 position, 3-5 velocity, 6-8 acceleration, 9 force, 10 yaw, 11 yaw rate.
POSITION, VELOCITY, ACCELERATION, YAW, YAW_RATE = 0x007, 0x038, 0x1C0, 0x400, 0x800
ALL = POSITION | VELOCITY | ACCELERATION | YAW | YAW_RATE


def setpoint(frame=BODY_NED, mask=ALL, target=(1, 1), **fields):
    names = ("x", "y", "z", "vx", "vy", "vz", "afx", "afy", "afz", "yaw", "yaw_rate")
    values = [fields.get(name, 0.0) for name in names]
    return common.MAVLink_set_position_target_local_ned_message(0, *target, frame, mask, *values)


def using(*parts):
    mask = ALL
    for part in parts:
        mask &= ~part
    return mask


@pytest.mark.parametrize("frame", [BODY_NED, BODY_FRD, BODY_OFFSET_NED])
def test_a_body_velocity_drives_forward_and_a_positive_yaw_rate_turns_right(bench, frame):
    bench.receive(setpoint(frame, using(VELOCITY, YAW_RATE), vx=0.5, yaw_rate=0.25))
    (request,) = bench.step()
    assert isinstance(request, VelocityTarget)
    assert (request.v_m_s, request.omega_rad_s) == (0.5, -0.25)


def test_velocities_are_void_after_the_configured_time(make_bench):
    bench = make_bench(setpoint_timeout_s=0.75)
    bench.receive(setpoint(mask=using(VELOCITY), vx=-0.5))
    (request,) = bench.step()
    assert request.stamp_ns == bench.now_ns
    assert request.expires_ns - request.stamp_ns == 750_000_000 - TRANSPORT_NS
    assert request.v_m_s == -0.5
    assert bench.run(1.0) == []  # and nothing renews them


def test_vx_alone_is_enough_in_the_body_frame(bench):
    bench.receive(setpoint(mask=ALL & ~0x008, vx=0.5, vy=math.nan))
    (request,) = bench.step()
    assert request.v_m_s == 0.5


def test_the_mask_0fc7_that_many_programs_use_is_a_velocity(bench):
    bench.receive(setpoint(LOCAL, 0x0FC7, vy=0.5))
    (request,) = bench.step(bench.control(theta_rad=0.0))
    assert request.v_m_s == pytest.approx(0.5)


def test_a_position_becomes_a_point_of_the_world(bench):
    bench.receive(setpoint(LOCAL, using(POSITION, YAW), x=3.0, y=1.0, z=-2.0, yaw=1.0))
    assert bench.step() == [PositionTarget(bench.now_ns, 1.0, 3.0)]  # 3 north, 1 east


def test_a_far_position_is_taken_as_long_as_the_navigator_goes_there(bench):
    far_m = float(np.nextafter(np.float32(FARTHEST_M), np.float32(0.0)))
    bench.receive(setpoint(LOCAL, using(POSITION), x=-far_m, y=far_m))
    assert bench.step() == [PositionTarget(bench.now_ns, far_m, -far_m)]
    assert bench.texts() == []


@pytest.mark.parametrize("theta", [0.0, 2.0, -3.1])
@pytest.mark.parametrize(
    ("north", "east", "heading"),
    [(0.0, 0.5, 0.0), (0.5, 0.0, math.pi / 2), (0.0, -0.5, math.pi), (-0.3, 0.4, -0.6435)],
)
def test_a_local_velocity_is_driven_along_its_direction(bench, theta, north, east, heading):
    """Whatever the heading now: how far that is off is seen where the robot is steered."""
    bench.receive(setpoint(LOCAL, using(VELOCITY), vx=north, vy=east))
    (request,) = bench.step(bench.control(theta_rad=theta))
    assert (request.v_m_s, request.omega_rad_s) == pytest.approx((0.5, 0.0))
    assert math.remainder(request.heading_rad - heading, math.tau) == pytest.approx(0.0, abs=1e-4)


def test_a_local_velocity_against_its_yaw_drives_backwards(bench):
    """Yaw east (90 degrees), velocity west."""
    mask = using(VELOCITY, YAW)
    bench.receive(setpoint(LOCAL, mask, vy=-0.5, yaw=math.pi / 2))
    (request,) = bench.step(bench.control(theta_rad=0.0))
    assert (request.v_m_s, request.heading_rad) == pytest.approx((-0.5, 0.0), abs=1e-6)


def test_a_local_velocity_with_yaw_rate_is_projected_on_the_heading(bench):
    bench.receive(setpoint(LOCAL, using(VELOCITY, YAW_RATE), vx=0.5, vy=0.5, yaw_rate=0.25))
    (request,) = bench.step(bench.control(theta_rad=math.pi / 2))  # heading north
    assert (request.v_m_s, request.omega_rad_s) == pytest.approx((0.5, -0.25))


def test_a_zero_local_velocity_stops(bench):
    bench.receive(setpoint(LOCAL, using(VELOCITY)))
    (request,) = bench.step(bench.control(theta_rad=2.0))
    assert (request.v_m_s, request.omega_rad_s) == (0.0, 0.0)


REFUSED = {
    "nothing": setpoint(mask=ALL),
    "position and velocity": setpoint(LOCAL, using(POSITION, VELOCITY)),
    "accelerations": setpoint(mask=using(ACCELERATION)),
    "velocity with accelerations": setpoint(mask=using(VELOCITY, ACCELERATION)),
    "one acceleration": setpoint(mask=ALL & ~VELOCITY & ~0x040),
    "force": setpoint(mask=using(VELOCITY, ACCELERATION) | 0x200),
    "yaw alone": setpoint(mask=using(YAW)),
    "yaw and yaw rate": setpoint(LOCAL, using(VELOCITY, YAW, YAW_RATE)),
    "yaw of a body velocity": setpoint(mask=using(VELOCITY, YAW)),
    "half a position": setpoint(LOCAL, ALL & ~0x001),
    "half a position and a velocity": setpoint(LOCAL, using(VELOCITY) & ~0x002),
    "sideways alone": setpoint(mask=ALL & ~0x010, vy=1.0),
    "sideways": setpoint(mask=using(VELOCITY), vx=1.0, vy=0.1),
    "half a local velocity": setpoint(LOCAL, ALL & ~0x008, vx=1.0),
    "ENU": setpoint(4, using(VELOCITY)),
    "position in a frame that ArduRover ignores": setpoint(BODY_FRD, using(POSITION)),
    "nan offset": setpoint(BODY_NED, using(POSITION), y=math.nan),
    "unknown frame": setpoint(255, using(VELOCITY)),
    "nan vx": setpoint(mask=using(VELOCITY), vx=math.nan),
    "nan vy": setpoint(mask=using(VELOCITY), vy=math.nan),
    "inf vx": setpoint(mask=using(VELOCITY), vx=math.inf),
    "nan yaw rate": setpoint(mask=using(VELOCITY, YAW_RATE), yaw_rate=math.nan),
    "nan x": setpoint(LOCAL, using(POSITION), x=math.nan),
    "far north": setpoint(LOCAL, using(POSITION), x=FARTHEST_M),
    "far west": setpoint(LOCAL, using(POSITION), y=-2e6),
    "inf y": setpoint(LOCAL, using(POSITION), y=-math.inf),
    "nan local vx": setpoint(LOCAL, using(VELOCITY), vx=math.nan),
    "nan yaw": setpoint(LOCAL, using(VELOCITY, YAW), yaw=math.nan),
}


@pytest.mark.parametrize("message", REFUSED.values(), ids=REFUSED.keys())
def test_what_cannot_be_followed_is_refused_and_said_once(bench, message):
    requests = []
    for _ in range(20):
        bench.receive(message)
        requests += bench.step(bench.control())
    assert requests == []
    texts = bench.texts()
    assert len(texts) == 1
    assert texts[0].startswith("Setpoint: ")


def test_an_attitude_is_refused_and_that_is_said(bench):
    bench.receive(common.MAVLink_set_attitude_target_message(0, 1, 1, 0, [1, 0, 0, 0], 0, 0, 0, 1))
    assert bench.step() == []
    text = "".join(bench.texts())
    assert text == "Setpoint: SET_ATTITUDE_TARGET: only SET_POSITION_TARGET counts"


def test_a_local_velocity_without_a_known_heading_is_refused(bench):
    bench.receive(setpoint(LOCAL, using(VELOCITY), vx=0.5))
    assert bench.step() == []
    assert "heading not known" in "".join(bench.texts())


def test_set_points_for_other_systems_are_not_taken(bench):
    bench.receive(setpoint(mask=using(VELOCITY), vx=0.5, target=(2, 1)))
    assert bench.step() == []


FLOAT32 = st.floats(width=32)
NUMBERS = st.floats(-9.0, 9.0, width=32) | st.sampled_from([0.0, math.nan, -math.inf, 3e38])
MASKS = [using(POSITION), using(VELOCITY), using(VELOCITY, YAW), using(VELOCITY, YAW_RATE)]


def requests_of(bench, frame, mask, values):
    """Return what a set-point leads to, checked: finite numbers of what the mask uses."""
    bench.receive(
        common.MAVLink_set_position_target_local_ned_message(0, 1, 1, frame, mask, *values)
    )
    requests = bench.step(bench.control(theta_rad=1.0))
    for request in requests:
        if isinstance(request, PositionTarget):
            assert max(abs(request.x_m), abs(request.y_m)) < FARTHEST_M
            assert mask & 3 == 0
        else:
            assert math.isfinite(request.v_m_s)
            assert math.isfinite(request.omega_rad_s)
            assert request.expires_ns > request.stamp_ns
            assert mask & 0x008 == 0
    return requests


@settings(max_examples=300, deadline=None)
@given(
    frame=st.sampled_from([LOCAL, BODY_NED, BODY_FRD]) | st.integers(0, 255),
    mask=st.integers(0, 0xFFFF),
    values=st.lists(FLOAT32, min_size=11, max_size=11),
)
def test_any_set_point_gives_finite_numbers_or_nothing(make_bench, frame, mask, values):
    assert len(requests_of(make_bench(), frame, mask, values)) <= 1


@pytest.mark.parametrize("mask", MASKS)
def test_a_set_point_that_is_whole_gives_finite_numbers_whatever_it_asks_for(make_bench, mask):
    taken = []

    @settings(max_examples=100, deadline=None)
    @given(values=st.lists(NUMBERS, min_size=11, max_size=11))
    def give(values):
        taken.extend(requests_of(make_bench(), LOCAL, mask, values))

    give()
    assert len(taken) > 5


def sticks(x=0, y=0, z=0, r=0, target=1):
    return common.MAVLink_manual_control_message(target, x, y, z, r, 0)


NONE = 0x7FFF


@pytest.mark.parametrize(
    ("message", "forward", "turn"),
    [
        (sticks(z=1000), 1.0, 0.0),
        (sticks(z=-250), -0.25, 0.0),
        (sticks(z=500), 0.5, 0.0),
        (sticks(y=500), 0.0, -0.5),  # right
        (sticks(z=300, y=-1000), 0.3, 1.0),
        (sticks(z=NONE, y=200), 0.0, -0.2),
        (sticks(z=300, y=NONE), 0.3, 0.0),
        (sticks(x=NONE, y=NONE, z=NONE, r=NONE), 0.0, 0.0),
        (sticks(x=1000, r=1000), 0.0, 0.0),  # ArduRover has no use for them
        (sticks(x=-32768, r=1001, z=100), 0.1, 0.0),
        (sticks(z=100, target=0), 0.1, 0.0),
    ],
)
def test_sticks_drive_and_turn_as_they_do_on_ardurover(bench, message, forward, turn):
    bench.receive(message)
    (request,) = bench.step()
    assert isinstance(request, ManualControl)
    assert (request.forward, request.turn) == (forward, turn)
    assert request.expires_ns - request.stamp_ns == 500_000_000 - TRANSPORT_NS
    assert bench.texts() == []


@pytest.mark.parametrize(
    "message",
    [
        sticks(z=1001),
        sticks(z=0x7FFE),
        sticks(y=-1001),
        sticks(y=-32768),
        sticks(z=1000, target=2),
    ],
    ids=["z too large", "z nearly absent", "y too small", "y smallest", "other target"],
)
def test_sticks_out_of_range_or_of_others_do_nothing(bench, message):
    bench.receive(message)
    assert bench.step() == []


def test_sticks_out_of_range_are_said_once_in_a_while(bench):
    for _ in range(3):
        bench.receive(sticks(z=1001))
        bench.step()
    assert "".join(bench.texts()) == "Sticks: z 1001, y 0: allowed -1000 to 1000"
    bench.step(advance_s=30.0)
    bench.receive(sticks(y=-1001))
    bench.step()
    assert "".join(bench.texts()) == "Sticks: z 0, y -1001: allowed -1000 to 1000"


def channels(steering=0, throttle=0, target=1):
    return common.MAVLink_rc_channels_override_message(
        target, 1, steering, 1900, throttle, 1900, 0, 0, 0, 0
    )


@pytest.mark.parametrize(
    ("message", "forward", "turn"),
    [
        (channels(1500, 1900), 1.0, 0.0),
        (channels(1500, 1100), -1.0, 0.0),
        (channels(1900, 1500), 0.0, -1.0),  # right
        (channels(1500, 2000), 1.0, 0.0),
        (channels(1530, 1470), 0.0, 0.0),
        (channels(0, 1715), 0.5, 0.0),
        (channels(65535, 1285), -0.5, 0.0),
        (channels(1285, 0), 0.0, 0.5),
    ],
)
def test_the_channels_of_a_remote_control_drive_and_turn_as_on_ardurover(
    bench, message, forward, turn
):
    bench.receive(message)
    (request,) = bench.step()
    assert (request.forward, request.turn) == pytest.approx((forward, turn))
    assert request.expires_ns - request.stamp_ns == 500_000_000 - TRANSPORT_NS


@pytest.mark.parametrize(
    "message",
    [channels(0, 0), channels(65535, 0), channels(1500, 1900, target=2)],
    ids=["released", "ignored and released", "other target"],
)
def test_channels_that_are_not_given_say_nothing(bench, message):
    bench.receive(message)
    assert bench.step() == []
    assert bench.texts() == []


@pytest.mark.parametrize(
    ("then", "forward", "turn"),
    [
        (channels(0, 0), 0.0, 0.0),
        (channels(0, 65535), 1.0, 0.0),
        (channels(65535, 0), 0.0, -1.0),
        (channels(1500, 65535), 1.0, 0.0),
        (channels(65535, 1300), pytest.approx(-0.46, abs=0.01), -1.0),
    ],
    ids=["both released", "steering", "throttle", "steering at rest", "throttle changed"],
)
def test_a_released_channel_is_at_rest_at_once_and_an_ignored_one_as_it_was(
    bench, then, forward, turn
):
    bench.receive(channels(1900, 1900))
    bench.step()
    bench.receive(then)
    (request,) = bench.step()
    assert (request.forward, request.turn) == (forward, turn)


def test_ignored_channels_say_nothing_and_do_not_last_longer_for_it(bench):
    bench.receive(channels(1900, 1900))
    (first,) = bench.step()
    for _ in range(20):
        bench.receive(channels(65535, 65535))
        assert bench.step() == []
    assert first.expires_ns > bench.now_ns
    for _ in range(20):
        bench.receive(channels(65535, 1900))
        requests = bench.step()
    assert [(each.forward, each.turn) for each in requests] == [(1.0, 0.0)]


def test_a_channel_that_is_void_leaves_the_other_to_drive_on(bench):
    bench.receive(channels(1900, 1500))
    bench.step()
    for _ in range(20):
        bench.step()
    bench.receive(channels(65535, 1900))
    (both,) = bench.step()
    assert (both.forward, both.turn) == (1.0, -1.0)
    assert both.expires_ns - bench.now_ns < 0.1e9
    (alone,) = [request for _ in range(5) for request in bench.step()]
    assert (alone.forward, alone.turn) == (1.0, 0.0)
    assert alone.stamp_ns - both.expires_ns < 0.03e9


def test_releasing_the_channels_ends_the_sticks_of_manual_control_too(bench):
    bench.receive(sticks(z=500))
    bench.step()
    bench.receive(channels(0, 0))
    (request,) = bench.step()
    assert (request.forward, request.turn) == (0.0, 0.0)
    state = {"state": SafetyState.DRIVING}
    for _ in range(50):
        bench.step(bench.control(**state), bench.navigation(mode=Mode.MANUAL))
    assert bench.texts() == []


def test_channels_out_of_range_are_refused(bench):
    bench.receive(channels(1500, 2201))
    bench.receive(channels(1, 1900))
    assert bench.step() == []
    assert "".join(bench.texts()) == "Sticks: channels 3 2201, 1 1500: allowed 800 to 2200"


@pytest.mark.parametrize(
    ("mode", "state", "said"),
    [
        (Mode.MANUAL, SafetyState.DRIVING, ["Sticks: lost, the robot brakes"]),
        (Mode.MANUAL, SafetyState.STANDBY, []),
        (Mode.HOLD, SafetyState.ARMED, []),
    ],
)
def test_the_loss_of_the_sticks_is_said_once_in_a_while_where_they_steer(bench, mode, state, said):
    def run(seconds):
        for _ in range(round(seconds * 50)):
            bench.step(bench.control(state=state), bench.navigation(mode=mode))
        return bench.texts()

    bench.receive(sticks(z=500))
    assert run(0.4) == []
    bench.receive(sticks(z=500))
    assert run(0.4) == []
    assert run(0.3) == said
    bench.receive(sticks(z=500))
    assert run(2.0) == []


OFFSET = 7
EAST, NORTH, SOUTH_WEST = 0.0, math.pi / 2, -3 * math.pi / 4


@pytest.mark.parametrize(
    ("frame", "theta", "x", "y", "point"),
    [
        (OFFSET, NORTH, 2.0, 0.5, (1.5, 4.0)),  # 2 m north, 0.5 m east, whatever the heading
        (OFFSET, EAST, 2.0, 0.5, (1.5, 4.0)),
        (BODY_NED, EAST, 2.0, 0.0, (3.0, 2.0)),
        (BODY_NED, EAST, 2.0, 0.5, (3.0, 1.5)),  # to the right is south
        (BODY_NED, NORTH, 2.0, 0.5, (1.5, 4.0)),  # to the right is east
        (BODY_OFFSET_NED, NORTH, -1.0, 0.0, (1.0, 1.0)),
        (BODY_OFFSET_NED, SOUTH_WEST, math.sqrt(2.0), 0.0, (0.0, 1.0)),
    ],
)
def test_an_offset_position_counts_from_where_the_robot_is(bench, frame, theta, x, y, point):
    bench.receive(setpoint(frame, using(POSITION), x=x, y=y))
    (request,) = bench.step(bench.control(x_m=1.0, y_m=2.0, theta_rad=theta))
    assert (request.x_m, request.y_m) == pytest.approx(point, abs=1e-6)


def test_an_offset_from_a_place_that_is_not_known_is_refused(bench):
    bench.receive(setpoint(BODY_NED, using(POSITION), x=1.0))
    assert bench.step() == []
    assert bench.texts() == ["Setpoint: an offset, but the place is not known"]


def test_a_velocity_in_the_offset_frame_is_one_of_the_world(bench):
    bench.receive(setpoint(OFFSET, using(VELOCITY), vx=0.5))
    (request,) = bench.step(bench.control(theta_rad=0.0))
    assert (request.v_m_s, request.heading_rad) == pytest.approx((0.5, NORTH))


@pytest.mark.parametrize(
    ("mode", "state", "text"),
    [
        (Mode.HOLD, SafetyState.ARMED, "not followed: mode HOLD, not GUIDED"),
        (Mode.GUIDED, SafetyState.STANDBY, "not followed: not armed (STANDBY)"),
        (Mode.GUIDED, SafetyState.FAULT, "not followed: not armed (FAULT)"),
        (Mode.GUIDED, SafetyState.ARMED, None),
        (Mode.GUIDED, SafetyState.DRIVING, None),
    ],
)
@pytest.mark.parametrize(("part", "fields"), [(VELOCITY, {"vx": 0.5}), (POSITION, {"x": 1.0})])
def test_why_set_points_move_nothing_is_said_once(bench, mode, state, text, part, fields):
    for _ in range(50):
        bench.receive(setpoint(mask=using(part), **fields))
        bench.step(bench.control(state=state), bench.navigation(mode=mode))
    said = "".join(bench.texts())
    assert said == ("" if text is None else f"Setpoint: {text}")


def test_a_set_point_sent_along_with_the_request_for_guided_is_no_mistake(bench):
    bench.receive(setpoint(mask=using(VELOCITY), vx=0.5))
    bench.step(bench.control(state=SafetyState.ARMED), bench.navigation(mode=Mode.HOLD))
    for _ in range(50):
        bench.receive(setpoint(mask=using(VELOCITY), vx=0.5))
        guided = bench.navigation(mode=Mode.GUIDED)
        bench.step(bench.control(state=SafetyState.ARMED), guided)
    assert bench.texts() == []


@pytest.fixture
def strafing(make_bench):
    """Return the bench of a robot that moves sideways, too."""
    return make_bench(holonomic=True)


def velocity_of(request, theta):
    """Return a request as velocity in `world` of a robot with a heading, and its turning rate."""
    c, s = (1.0, 0.0) if request.in_world else (math.cos(theta), math.sin(theta))
    v, vy = request.v_m_s, request.vy_m_s
    return c * v - s * vy, s * v + c * vy, request.omega_rad_s


@pytest.mark.parametrize("frame", [BODY_NED, BODY_FRD, BODY_OFFSET_NED])
def test_a_holonomic_robot_takes_a_sideways_velocity_of_its_body(strafing, frame):
    strafing.receive(setpoint(frame, using(VELOCITY, YAW_RATE), vx=0.5, vy=0.25, yaw_rate=0.125))
    (request,) = strafing.step()
    assert (request.v_m_s, request.vy_m_s, request.omega_rad_s) == (0.5, -0.25, -0.125)
    assert request.heading_rad is None
    assert not request.in_world


@pytest.mark.parametrize("theta", [0.0, 2.0, -3.1])
def test_a_holonomic_robot_drives_north_and_east_whatever_its_heading(strafing, theta):
    strafing.receive(setpoint(LOCAL, using(VELOCITY), vx=0.25, vy=-0.5))
    (request,) = strafing.step(strafing.control(theta_rad=theta))
    assert velocity_of(request, theta) == pytest.approx((-0.5, 0.25, 0.0))
    assert request.heading_rad is None


def test_a_holonomic_robot_turns_while_it_drives_on_in_a_direction(strafing):
    strafing.receive(setpoint(LOCAL, using(VELOCITY, YAW_RATE), vx=0.5, yaw_rate=0.25))
    (request,) = strafing.step(strafing.control(theta_rad=1.0))
    assert velocity_of(request, 1.0) == pytest.approx((0.0, 0.5, -0.25))
    strafing.receive(setpoint(LOCAL, using(VELOCITY, YAW), vx=0.5, yaw=0.0))
    (request,) = strafing.step(strafing.control(theta_rad=1.0))
    assert velocity_of(request, 1.0)[:2] == pytest.approx((0.0, 0.5))
    assert request.heading_rad == pytest.approx(math.pi / 2)


@pytest.mark.parametrize("vy", [math.nan, math.inf])
def test_a_sideways_velocity_that_is_no_number_is_refused(strafing, vy):
    strafing.receive(setpoint(mask=using(VELOCITY), vx=0.5, vy=vy))
    assert strafing.step() == []
    assert strafing.texts() == ["Setpoint: a number that is not finite"]


@pytest.mark.parametrize("frame", [BODY_NED, LOCAL])
@settings(max_examples=50)
@given(values=st.lists(NUMBERS, min_size=11, max_size=11), mask=st.integers(0, 0xFFFF))
def test_a_holonomic_robot_is_given_finite_numbers_or_nothing(make_bench, frame, values, mask):
    for request in requests_of(make_bench(holonomic=True), frame, mask, values):
        if isinstance(request, VelocityTarget):
            assert math.isfinite(request.v_m_s + request.vy_m_s + request.omega_rad_s)


def test_the_yaw_stick_moves_a_holonomic_robot_sideways_and_no_other(bench, strafing):
    for each, sideways in ((bench, 0.0), (strafing, -0.5)):
        each.receive(sticks(z=100, y=200, r=500))  # r positive: to the right
        (request,) = each.step()
        assert (request.forward, request.turn, request.sideways) == (0.1, -0.2, sideways)
    strafing.receive(sticks(r=1001))
    assert strafing.step() == []
    assert strafing.texts() == ["Sticks: z 0, y 0, r 1001: allowed -1000 to 1000"]


def test_channel_4_moves_a_holonomic_robot_sideways(strafing):
    message = common.MAVLink_rc_channels_override_message(1, 1, 1500, 0, 1900, 1285, 0, 0, 0, 0)
    strafing.receive(message)
    (request,) = strafing.step()
    assert (request.forward, request.turn, request.sideways) == pytest.approx((1.0, 0.0, 0.5))
