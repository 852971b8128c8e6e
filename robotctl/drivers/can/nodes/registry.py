"""`CAN_NODES`: every kind of sensor node of ours that a robot may have on its buses.

Handlers, commissioning, age limits and the checks of `robotctl doctor` follow from it.
"""

from __future__ import annotations

from typing import Final

from robotctl.drivers.can.config import NodeParameters
from robotctl.drivers.can.nodes.can_node import CanNode
from robotctl.drivers.can.nodes.imu import IMU
from robotctl.drivers.can.nodes.power import POWER
from robotctl.drivers.can.nodes.sonar import SONAR
from robotctl.safety.ages import AgeLimit
from robotctl.safety.state_machine import SafetyConfig

CAN_NODES: Final[tuple[CanNode, ...]] = (SONAR, POWER, IMU)


def wanted_nodes(parameters: NodeParameters) -> tuple[CanNode, ...]:
    """Return the nodes that a robot must have."""
    return tuple(node for node in CAN_NODES if node.is_wanted(parameters))


def age_limits(
    parameters: NodeParameters, safety: SafetyConfig, period_ns: int
) -> tuple[AgeLimit, ...]:
    """Return the maximum ages of what a robot's sensor nodes report; control period [ns]."""
    limits = [limit for node in wanted_nodes(parameters) for limit in node.ages(safety, period_ns)]
    if parameters.power.source == "drives":
        limits += POWER.ages(safety, period_ns)
    return tuple(limits)
