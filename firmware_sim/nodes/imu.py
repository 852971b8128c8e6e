"""CANopen node 4: an inertial measurement unit with three-axis gyro and accelerometer."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, NamedTuple, TypeAlias

from firmware_sim.nodes import wire
from firmware_sim.nodes.e2e import Protector
from firmware_sim.nodes.node import MILLISECOND_NS, NEVER_NS, NmtState, Node
from firmware_sim.nodes.object_dictionary import ObjectDictionary
from firmware_sim.nodes.parameter_store import ParameterStore
from firmware_sim.nodes.standard_objects import (
    pdo_communication,
    pdo_image,
    pdo_mapping,
    standard_objects,
)
from firmware_sim.nodes.variables import Access, DataType, Object, variable

NODE_ID: Final = 4
SAMPLE_PERIOD: Final = 0x2400
GYRO_IMAGE: Final = 0x2410
ACCELEROMETER_IMAGE: Final = 0x2411
EVENT_DRIVEN: Final = 254

Vector: TypeAlias = tuple[float, float, float]


class ImuSample(NamedTuple):
    """Means since the last sample, about and along the sensor's axes: [rad/s], [m/s^2]."""

    rate_rad_s: Vector
    force_m_s2: Vector


def imu_objects() -> list[Object]:
    """Return all objects of the IMU."""
    return [
        *standard_objects(NODE_ID, "robotctl imu", 4),
        pdo_communication(0x1800, "TPDO 1 communication", wire.IMU_GYRO, EVENT_DRIVEN),
        pdo_communication(0x1801, "TPDO 2 communication", wire.IMU_ACCELEROMETER, EVENT_DRIVEN),
        pdo_mapping(0x1A00, "TPDO 1 mapping", GYRO_IMAGE),
        pdo_mapping(0x1A01, "TPDO 2 mapping", ACCELEROMETER_IMAGE),
        variable(
            0x2001, "Wire-protocol version", DataType.UNSIGNED32, Access.RO, wire.PROTOCOL_VERSION
        ),
        variable(
            SAMPLE_PERIOD, "Sample period [ms]", DataType.UNSIGNED16, Access.RW, 20,
            low=5, high=100, stored=True,
        ),
        pdo_image(GYRO_IMAGE, "Gyro"),
        pdo_image(ACCELEROMETER_IMAGE, "Accelerometer"),
    ]  # fmt: skip


class ImuNode(Node):
    """The IMU: in operational it sends the means of each sample period.

    Parameters
    ----------
    measure
        Function that takes a sample at a time [ns].
    store
        Non-volatile memory.
    """

    def __init__(
        self, measure: Callable[[int], ImuSample], store: ParameterStore | None = None
    ) -> None:
        self._measure = measure
        self._gyro = Protector(wire.data_id(wire.IMU_GYRO))
        self._accelerometer = Protector(wire.data_id(wire.IMU_ACCELEROMETER))
        self._measure_ns = NEVER_NS
        super().__init__(NODE_ID, "imu", ObjectDictionary(imu_objects()), store)

    def _on_power_up(self) -> None:
        self._gyro.reset()
        self._accelerometer.reset()
        self._measure_ns = NEVER_NS

    def _on_nmt_change(self) -> None:
        operational = self.state is NmtState.OPERATIONAL
        self._measure_ns = self._now_ns + self._period_ns() if operational else NEVER_NS

    def _due_ns(self) -> int:
        return self._measure_ns

    def _step(self, now_ns: int) -> None:
        if now_ns < self._measure_ns:
            return
        self._measure_ns += self._period_ns()
        sample = self._measure(now_ns)
        gyro = self._gyro.protect(wire.imu_gyro(sample.rate_rad_s))
        self.send_image(wire.IMU_GYRO, GYRO_IMAGE, gyro)
        force = self._accelerometer.protect(wire.imu_accelerometer(sample.force_m_s2))
        self.send_image(wire.IMU_ACCELEROMETER, ACCELEROMETER_IMAGE, force)

    def _period_ns(self) -> int:
        return self.clock.span_ns(self.dictionary.number(SAMPLE_PERIOD) * MILLISECOND_NS)
