"""What doctor says of the IMU of a robot that stands."""

import math

import msgspec
import pytest

from robotctl.app.processes.robot import make_codec, make_parts
from robotctl.app.simulation.lockstep_stack import make_simulation
from robotctl.config.robot_file import find_file, load_robot
from robotctl.deploy.check_result import Verdict
from robotctl.deploy.doctor_imu import check_imu, watch_imu
from robotctl.deploy.doctor_nodes import commission
from robotctl.drivers.can.memory_port import MemoryPort
from robotctl.drivers.can.robot_can import CanRobot
from robotctl.messages.actuators import ActuatorCommand
from robotctl.messages.control import ImuFeedback
from robotctl.model.sensors.imu import ImuConfig

CONFIG = ImuConfig(enabled=True)
GOOD = ImuFeedback(5, 5, (0.01, -0.02, 0.01), (0.1, 0.0, 9.8), (0.01, 0.0, 0.999))
OFF = ActuatorCommand(enable=False, brake=True)


@pytest.mark.parametrize(
    ("values", "fix"),
    [
        ({"force_m_s2": (0.0, 0.0, 9.2)}, "replace the IMU"),
        ({"force_m_s2": (0.0, 0.0, 10.4)}, "replace the IMU"),
        ({"up": (math.sin(0.4), 0.0, math.cos(0.4))}, "upright"),
        ({"up": (0.0, 0.0, -1.0)}, "z axis up"),
        ({"rate_rad_s": (0.0, 0.2, 0.0)}, "leave the robot alone"),
    ],
)
def test_a_reading_that_no_robot_at_rest_has_is_a_failure_with_its_remedy(values, fix) -> None:
    finding = check_imu(msgspec.structs.replace(GOOD, **values), CONFIG)
    assert finding.verdict is Verdict.FAIL
    assert fix in finding.fix


def test_an_imu_that_is_silent_fails() -> None:
    assert check_imu(None, CONFIG).verdict is Verdict.FAIL


class SimulatedClock:
    """Lets the simulated firmware move on while somebody sleeps."""

    def __init__(self, simulation) -> None:
        self._simulation = simulation

    def now_ns(self) -> int:
        return self._simulation.now_ns

    def sleep_until(self, deadline_ns: int) -> None:
        if deadline_ns > self.now_ns():
            self._simulation.advance(deadline_ns)


@pytest.mark.parametrize(
    ("fault", "verdict"),
    [("", Verdict.OK), ("tilted pitch=90", Verdict.FAIL), ("gyro_biased rate=1", Verdict.FAIL)],
)
def test_the_simulated_imu_is_judged_by_what_it_sends(fault: str, verdict: Verdict) -> None:
    file, settings = find_file("diff_drive"), ("imu.enabled=true", "imu.yaw_deg=90")
    config = load_robot(file, settings)
    parts = make_parts(config, make_codec())
    simulation = make_simulation(
        file, find_file("empty_room", "worlds"), 1, (3.0, 2.0, 0.0), settings
    )
    clock = SimulatedClock(simulation)
    bus = config.buses[0]
    ids = parts.identifiers(bus.name)
    port = MemoryPort(lambda *_: False, ids, bus, clock)
    port.transmit = simulation.bus.attach("host", port.deliver, accept=ids).send
    robot = CanRobot({bus.name: port}, parts)
    nodes = commission(robot, clock, config.runtime.period_ns)
    assert [node.problem for node in nodes] == [""] * 4
    if fault:
        simulation.faults.inject(fault)
    said = watch_imu(robot, clock, config.runtime.period_ns, config.imu, OFF)
    assert check_imu(said, config.imu).verdict is verdict
