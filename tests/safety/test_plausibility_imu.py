"""What the IMU's monitor calls a tilt, a lift, a contradiction or a stuck sensor: both sides."""

from __future__ import annotations

import math
from typing import Any

import msgspec
import pytest

from robotctl.messages.actuators import ActuatorCommand
from robotctl.messages.control import Feedback, ImuFeedback
from robotctl.messages.faults import Fault, FaultCode
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.imu import ImuConfig
from robotctl.safety.monitor import MonitorInputs
from robotctl.safety.plausibility_imu import RISE_M_S, SLIP_RAD, STUCK_READINGS, ImuMonitor

LEVEL = ImuFeedback(20_000_000, 20_000_000, (0.0, 0.0, 0.1), (0.0, 0.0, 9.8), (0.0, 0.0, 1.0))


class Motion:
    speeds_rad_s = (0.0, 0.0)
    jumps = 0
    pose_odom_base = SE2()

    def __init__(self, imu: ImuFeedback | None) -> None:
        self.imu = imu


def inputs(imu: ImuFeedback | None) -> MonitorInputs:
    return MonitorInputs(Feedback(), ActuatorCommand(), Motion(imu))


def found(tilt_max_deg: float = 20.0, **values: Any) -> FaultCode:
    monitor = ImuMonitor(ImuConfig(enabled=True, tilt_max_deg=tilt_max_deg))
    fault = monitor.update(inputs(msgspec.structs.replace(LEVEL, **values)))
    return FaultCode.NONE if fault is None else fault.code


def up(degrees: float, towards: float) -> tuple[float, float, float]:
    tilt = math.radians(degrees)
    return (
        math.sin(tilt) * math.cos(towards),
        math.sin(tilt) * math.sin(towards),
        math.cos(tilt),
    )


@pytest.mark.parametrize("towards", [0.0, 1.0, 2.5, -2.0])
@pytest.mark.parametrize("most", [5.0, 20.0, 60.0])
def test_a_tilt_beyond_the_configured_angle_to_any_side_stops(most: float, towards: float) -> None:
    assert found(most, up=up(most - 0.1, towards)) is FaultCode.NONE
    assert found(most, up=up(most + 0.1, towards)) is FaultCode.ROBOT_TILTED
    assert found(most, up=up(179.0, towards)) is FaultCode.ROBOT_TILTED


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_rising_and_falling_stop(sign: float) -> None:
    assert found(rise_m_s=sign * RISE_M_S) is FaultCode.NONE
    assert found(rise_m_s=sign * (RISE_M_S + 1e-6)) is FaultCode.PICKED_UP


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_gyro_against_its_wheels_stops(sign: float) -> None:
    assert found(slip_rad=sign * SLIP_RAD) is FaultCode.NONE
    assert found(slip_rad=sign * (SLIP_RAD + 1e-6)) is FaultCode.GYRO_CONTRADICTS


def readings(count: int, *, change: str = "") -> FaultCode:
    """Let so many readings come, each in several ticks; return what is said of the last."""
    monitor = ImuMonitor(ImuConfig(enabled=True))
    fault = None
    for n in range(count):
        imu = msgspec.structs.replace(LEVEL, stamp_ns=20_000_000 * (n + 1))
        if change:
            imu = msgspec.structs.replace(imu, **{change: (0.001 * (n % 2), 0.0, 9.8)})
        for _ in range(4):
            fault = monitor.update(inputs(imu)) or fault
    return FaultCode.NONE if fault is None else fault.code


def test_readings_that_stay_the_same_to_the_bit_are_not_measured() -> None:
    assert readings(STUCK_READINGS) is FaultCode.NONE
    assert readings(STUCK_READINGS + 1) is FaultCode.IMU_STUCK


@pytest.mark.parametrize("change", ["rate_rad_s", "force_m_s2"])
def test_where_either_sensor_flickers_the_imu_is_alive(change: str) -> None:
    assert readings(10 * STUCK_READINGS, change=change) is FaultCode.NONE


def test_a_robot_without_an_imu_is_not_judged_by_it() -> None:
    assert ImuMonitor(ImuConfig()).update(inputs(None)) is None


@pytest.mark.parametrize(
    ("values", "code", "text"),
    [
        (
            {"up": up(30.0, 1.0)},
            FaultCode.ROBOT_TILTED,
            "the robot is tilted by 30 degrees, 20 are allowed",
        ),
        (
            {"rise_m_s": 0.52},
            FaultCode.PICKED_UP,
            "the robot rises at 0.52 m/s: somebody lifts or drops it",
        ),
        (
            {"rise_m_s": -1.5},
            FaultCode.PICKED_UP,
            "the robot falls at 1.50 m/s: somebody lifts or drops it",
        ),
        (
            {"slip_rad": -0.7},
            FaultCode.GYRO_CONTRADICTS,
            (
                "gyro and wheels differ by 40 degrees: the wheels slip, somebody turns the robot, "
                "or the gyro is wrong"
            ),
        ),
    ],
)
def test_people_read_what_was_found(values: dict[str, Any], code: FaultCode, text: str) -> None:
    monitor = ImuMonitor(ImuConfig(enabled=True, tilt_max_deg=20.0))
    imu = msgspec.structs.replace(LEVEL, **values)
    assert monitor.judge(imu) == monitor.update(inputs(imu)) == Fault(code, text)


def repeat(monitor: ImuMonitor, count: int, begin: int = 1) -> Fault | None:
    """Let the same reading come so often, at new times; return what is said of the last."""
    fault = None
    for n in range(begin, begin + count):
        fault = monitor.update(inputs(msgspec.structs.replace(LEVEL, stamp_ns=n)))
    return fault


def test_a_stuck_imu_is_named() -> None:
    fault = repeat(ImuMonitor(ImuConfig(enabled=True)), STUCK_READINGS + 1)
    assert fault == Fault(FaultCode.IMU_STUCK, "the IMU repeats the same reading", "imu")


def test_arming_lets_the_count_of_equal_readings_begin_anew() -> None:
    monitor = ImuMonitor(ImuConfig(enabled=True))
    assert repeat(monitor, STUCK_READINGS) is None
    monitor.reset()
    assert repeat(monitor, STUCK_READINGS - 1, 100) is None
    assert repeat(monitor, 1, 200) is not None
