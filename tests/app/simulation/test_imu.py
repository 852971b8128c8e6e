"""A simulated robot with an IMU: what it stops for, what it does not, and where it thinks it is."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest

from robotctl.app.simulation.lockstep import LockstepRun
from robotctl.app.simulation.lockstep_stack import LockstepStack, make_simulation
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import find_file, load_robot
from robotctl.messages.control import Arm, SafetyState, VelocityCommand
from robotctl.messages.faults import FaultCode

ON = "imu.enabled=true"
HZ = 200
MIDDLE = (3.0, 2.0, 0.0)


class Bench:
    """The default robot in the middle of an empty room, armed."""

    def __init__(self, *settings: str, at_rest_s: float = 1.5) -> None:
        file = find_file("diff_drive")
        self.simulation = make_simulation(
            file, find_file("empty_room", "worlds"), 1, MIDDLE, settings
        )
        options = StackOptions("x", str(file), x_m=MIDDLE[0], y_m=MIDDLE[1])
        self.stack = LockstepStack(load_robot(file, settings), options, self.simulation)
        for _ in range(round(at_rest_s * HZ)):
            self.stack.tick()
        self.stack.tick((Arm(self.stack.clock.now_ns(), 1, arm=True),))

    def drive(self, seconds: float, law: Callable[[float], tuple[float, float]]) -> FaultCode:
        """Drive by a law of time until a fault, which is returned."""
        for n in range(round(seconds * HZ)):
            now_ns = self.stack.clock.now_ns()
            self.stack.tick((VelocityCommand(now_ns, now_ns + 100_000_000, *law(n / HZ)),))
            if fault := self.stack.snapshot().fault:
                return fault
        return FaultCode.NONE

    def heading_error_rad(self) -> float:
        return abs(
            math.remainder(self.stack.snapshot().theta_rad - self.simulation.pose()[2], math.tau)
        )


def circle(_: float) -> tuple[float, float]:
    return 0.2, 0.5


@pytest.mark.parametrize(
    ("fault", "code"),
    [
        ("tilted pitch=30", FaultCode.ROBOT_TILTED),
        ("tilted pitch=0 roll=-25 within=2", FaultCode.ROBOT_TILTED),
        ("carried", FaultCode.PICKED_UP),
        ("imu_stuck", FaultCode.IMU_STUCK),
        ("gyro_biased", FaultCode.GYRO_CONTRADICTS),
        ("gyro_biased rate=-1", FaultCode.GYRO_CONTRADICTS),
        ("node_silent node=imu duration=1", FaultCode.IMU_STALE),
        ("node_reset node=imu", FaultCode.NODE_RESTARTED),
    ],
)
def test_each_fault_of_the_imu_stops_the_robot_by_its_code(fault: str, code: FaultCode) -> None:
    bench = Bench(ON)
    assert bench.drive(0.5, circle) is FaultCode.NONE
    bench.simulation.faults.inject(fault)
    assert bench.drive(4.0, circle) is code
    assert bench.stack.snapshot().state is SafetyState.FAULT


@pytest.mark.parametrize("fault", ["tilted pitch=15", "gyro_biased rate=0.05"])
def test_what_is_allowed_stops_nobody(fault: str) -> None:
    bench = Bench(ON)
    bench.simulation.faults.inject(fault)
    assert bench.drive(6.0, circle) is FaultCode.NONE


def test_a_robot_that_lies_on_its_side_does_not_arm() -> None:
    bench = Bench(ON)
    bench.stack.tick((Arm(bench.stack.clock.now_ns(), 2, arm=False),))
    bench.simulation.faults.inject("tilted pitch=0 roll=80")
    for _ in range(2 * HZ):
        bench.stack.tick()
    bench.stack.tick((Arm(bench.stack.clock.now_ns(), 3, arm=True),))
    for _ in range(2 * HZ):
        bench.stack.tick()
    ack = bench.stack.snapshot().acks[-1]
    assert (ack.request_id, ack.accepted) == (3, False)
    assert [(reason.code, reason.part) for reason in ack.reasons] == [(FaultCode.ROBOT_TILTED, "")]


@pytest.mark.parametrize("robot", ["diff_drive", "tricycle"])
def test_no_monitor_of_the_imu_stops_a_mission(robot: str) -> None:
    """With braking, bends on the spot, and floors that shake it twice as much as usual."""
    shaking = "simulation.imu.vibration_m_s2_per_m_s=1.0"
    options = SimOptions(
        find_file(robot), find_file("patrol", "missions"), seed=4, overrides=(ON, shaking)
    )
    report = LockstepRun(options).run()
    assert report.mission_completed, report.message
    assert report.unsafe_motions == 0


@pytest.mark.parametrize("friction", [0.1, 0.07])
def test_on_ice_the_gyro_keeps_the_heading_that_the_wheels_lose(friction: float) -> None:
    def zigzag(t: float) -> tuple[float, float]:
        return (0.4 if int(t) % 2 else -0.4), (2.0 if int(0.7 * t) % 2 else -2.0)

    errors = {}
    for setting in ("imu.enabled=false", ON):
        bench = Bench(f"simulation.wheels.friction={friction}", setting)
        bench.drive(2.4, zigzag)
        errors[setting] = bench.heading_error_rad()
    assert errors["imu.enabled=false"] > 0.2
    assert errors[ON] < 0.04


def test_wheels_of_another_size_than_configured_turn_the_pose_less() -> None:
    errors = {}
    for setting in ("imu.enabled=false", ON):
        bench = Bench("simulation.errors.wheel_radius=[0.02, -0.02]", setting)
        bench.drive(1.9, lambda _: (0.4, 0.0))
        errors[setting] = bench.heading_error_rad()
    assert errors[ON] < 0.5 * errors["imu.enabled=false"]


def test_the_localiser_turns_by_the_gyro_where_the_wheels_are_wrong() -> None:
    found = []
    for setting in ("imu.enabled=false", ON):
        options = SimOptions(
            find_file("diff_drive"),
            find_file("patrol", "missions"),
            seed=1,
            overrides=(setting, "simulation.errors.wheel_radius=[0.02, -0.02]"),
            localisation=('localisation.method="ekf"',),
            max_seconds=20.0,
        )
        report = LockstepRun(options).run()
        assert report.localisation is not None
        found.append(report.localisation)
    without, with_imu = found
    assert with_imu.error.heading_rmse_rad < 0.3 * without.error.heading_rmse_rad
    assert with_imu.error.rmse_m < 0.6 * without.error.rmse_m
    assert with_imu.odometry_rmse_m < 0.3 * without.odometry_rmse_m
