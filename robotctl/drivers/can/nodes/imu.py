"""Node 4, the inertial measurement unit: gyro and accelerometer, if `imu.enabled` is set."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from robotctl.drivers.can.config import NodeParameters
from robotctl.drivers.can.dbc import Dbc
from robotctl.drivers.can.nodes.can_node import CanNode, FrameReader, NodeFrame
from robotctl.drivers.can.nodes.commissioning import (
    HEARTBEAT,
    Product,
    Script,
    Setting,
    configure_and_start,
    identify,
    same_wire,
)
from robotctl.messages.control import AccelerometerFeedback, GyroFeedback
from robotctl.messages.faults import FaultCode
from robotctl.safety.ages import AgeLimit
from robotctl.safety.state_machine import SafetyConfig


def imu_script(dbc: Dbc, _: NodeParameters) -> Callable[[], Script]:
    """Return the script of the IMU: identity, sample period of the DBC, heartbeat."""
    period_ms = dbc.message("ImuGyro").cycle_ms
    sample_period = Setting(0x2400, 0, "sample period", period_ms, 2, " ms")

    def script() -> Script:
        return (
            (yield from identify(Product.IMU))
            or (yield from same_wire(dbc.wire_version))
            or (yield from configure_and_start(sample_period, HEARTBEAT))
        )

    return script


def _read_gyro(reader: FrameReader) -> Callable[[bytes, int], GyroFeedback]:
    decode = reader.decoder("ImuGyro", "RateX", "RateY", "RateZ")
    return lambda data, stamp_ns: GyroFeedback(stamp_ns, *decode(data))


def _read_accelerometer(reader: FrameReader) -> Callable[[bytes, int], AccelerometerFeedback]:
    decode = reader.decoder("ImuAccelerometer", "ForceX", "ForceY", "ForceZ")
    return lambda data, stamp_ns: AccelerometerFeedback(stamp_ns, *decode(data))


def _ages(safety: SafetyConfig, _: int) -> tuple[AgeLimit, ...]:
    limit_ns = safety.imu_timeout_ms * 1_000_000
    return (
        AgeLimit("gyro", FaultCode.IMU_STALE, "the gyro's report is", "imu", limit_ns),
        AgeLimit(
            "accelerometer", FaultCode.IMU_STALE, "the accelerometer's report is", "imu", limit_ns
        ),
    )


IMU: Final = CanNode(
    node_id=4,
    name="imu",
    script=imu_script,
    frames=(
        NodeFrame("ImuGyro", "gyro", _read_gyro),
        NodeFrame("ImuAccelerometer", "accelerometer", _read_accelerometer),
    ),
    ages=_ages,
    is_wanted=lambda parameters: parameters.imu,
)
