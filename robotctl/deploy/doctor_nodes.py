"""Checks of the nodes: which are on the bus, and whether they are the right ones.

Where another controller drives the nodes, or is about to, doctor only listens. Where none does, it
commissions them as the control process would, with commands that say "motors off".
"""

from __future__ import annotations

from contextlib import ExitStack
from typing import Final

from robotctl.app.processes.robot import make_codec, node_parameters
from robotctl.config.robot_file import RobotConfig
from robotctl.deploy.check_result import Finding, fail, none, ok, warn
from robotctl.deploy.doctor_imu import check_imu, watch_imu
from robotctl.drivers.can.nodes.can_node import CanNode
from robotctl.drivers.can.nodes.node import HEARTBEAT_BASE
from robotctl.drivers.can.nodes.registry import wanted_nodes
from robotctl.drivers.can.nodes.robot_can import CanRobot
from robotctl.drivers.can.port import SocketPort
from robotctl.errors import LinkError
from robotctl.messages.control import BusState, BusStatus, NodeStatus, WheelCommand
from robotctl.messages.faults import FaultCode
from robotctl.messages.ports import CanPort, Clock
from robotctl.runtime.ipc.process_lock import claim_bus

LISTEN_NS: Final = 600_000_000
"""Five heartbeats and more [ns]."""

COMMISSION_NS: Final = 3_000_000_000
_POLL_NS = 5_000_000
_OFF = WheelCommand(enable=False, brake=True)

_LOAD: Final = "load the firmware that belongs to this robotctl's configs/robot.dbc"
_FIXES: Final = {
    FaultCode.NODE_NO_ANSWER: "check its power and cable, and that no other node has its number",
    FaultCode.NODE_OTHER_DEVICE: "give each node its own number: two may be swapped",
    FaultCode.NODE_OTHER_FIRMWARE: _LOAD,
    FaultCode.NODE_OTHER_VALUE: "correct the robot's file, or the node's parameter",
    FaultCode.NODE_CHANGED: "find out who else on the bus writes to the nodes",
    FaultCode.NODE_PUT_OUT: "find out who else on the bus commands the nodes (NMT)",
}
"""Remedy for each kind of problem; for others, check power and cable."""


def check_nodes(config: RobotConfig, clock: Clock) -> list[Finding]:
    """Open the bus and check all nodes; takes up to 5 s."""
    codec, parameters = make_codec(), node_parameters(config)
    ids = {*codec.arbitration_ids, codec.sync_id, codec.command_id}
    try:
        port = SocketPort(config.buses[0], ids, clock)
    except LinkError as error:
        fix = "fix the CAN link, or start firmware_sim if the bus is simulated"
        return [fail("CAN nodes", str(error), fix)]
    masters = frozenset({codec.sync_id, codec.command_id})
    with ExitStack() as held:
        held.callback(port.close)
        heard = listen(port, clock)
        if heard & masters or not _claim(config, held):
            wanted = wanted_nodes(parameters)
            return [only_listened(heard, wanted), check_traffic(port.status())]
        robot = CanRobot(port, codec, parameters)
        nodes = commission(robot, clock, config.runtime.period_ns)
        version = codec.dbc.wire_version
        findings = [check_node(node, version) for node in nodes]
        if config.imu.enabled:
            said = watch_imu(robot, clock, config.runtime.period_ns, config.imu, _OFF)
            findings.append(check_imu(said, config.imu))
        return [*findings, check_traffic(port.status())]


def _claim(config: RobotConfig, held: ExitStack) -> bool:
    """Claim the bus for as long as `held` is open; return False if a controller has it."""
    try:
        for bus in config.buses:
            held.enter_context(claim_bus(bus.interface, bus.channel))
    except LinkError:
        return False
    return True


def listen(port: CanPort, clock: Clock) -> frozenset[int]:
    """Return the identifiers received in `LISTEN_NS`."""
    heard: set[int] = set()
    end_ns = clock.now_ns() + LISTEN_NS
    while (now_ns := clock.now_ns()) < end_ns:
        heard.update(frame.arbitration_id for frame in port.receive())
        clock.sleep_until(now_ns + _POLL_NS)
    return frozenset(heard)


def commission(robot: CanRobot, clock: Clock, period_ns: int) -> tuple[NodeStatus, ...]:
    """Tick with the motors off until all nodes are in service, for `COMMISSION_NS` at most."""
    deadline_ns = clock.now_ns()
    end_ns = deadline_ns + COMMISSION_NS
    while deadline_ns < end_ns and any(node.problem for node in robot.nodes):
        deadline_ns += period_ns
        clock.sleep_until(deadline_ns)
        now_ns = clock.now_ns()
        robot.receive(now_ns)
        robot.send(_OFF, now_ns)
    return robot.nodes


def check_node(node: NodeStatus, wire_version: int) -> Finding:
    """Check one node after its commissioning."""
    check = f"node {node.node_id} {node.name}"
    if not node.problem:
        return ok(check, f"identified, parameters confirmed, wire version 0x{wire_version:08X}")
    return fail(check, node.problem, _FIXES.get(node.fault, "check its power and cable"))


def check_traffic(bus: BusStatus) -> Finding:
    """Check the bus's errors with our frames meanwhile."""
    check = "CAN traffic"
    words = (
        f"{bus.state.name.lower().replace('_', ' ')}, {bus.received} frames received, "
        f"{bus.sent} sent, {bus.send_failures} refused, {bus.error_frames} error frames"
    )
    fix = "check termination (60 ohm between CAN-H and CAN-L, power off), wiring and bit rate"
    if bus.state is not BusState.ERROR_ACTIVE:
        return fail(check, words, fix)
    if bus.error_frames or bus.send_failures:
        return warn(check, words, fix)
    return ok(check, words)


def only_listened(heard: frozenset[int], wanted: tuple[CanNode, ...]) -> Finding:
    """Report the nodes present, when a running controller forbids queries."""
    there = [node.name for node in wanted if HEARTBEAT_BASE + node.node_id in heard]
    missing = [node.name for node in wanted if HEARTBEAT_BASE + node.node_id not in heard]
    names = ", ".join(there) or "no node"
    unheard = f", not of {', '.join(missing)}" if missing else ""
    return none(
        "CAN nodes",
        f"a controller is running and asks them itself; heartbeats of {names} were heard{unheard}",
    )
