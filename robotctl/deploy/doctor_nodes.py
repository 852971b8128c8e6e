"""Checks of the nodes: presence on the bus, and identity.

Doctor only listens while another controller drives the nodes, or is about to. Without one, it
commissions them like the control process, with commands that keep the motors off.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from typing import Final

from robotctl.app.processes.robot import make_codec, make_parts, open_ports
from robotctl.config.robot_file import RobotConfig
from robotctl.deploy.check_result import Finding, fail, none, ok, risk, warn
from robotctl.deploy.doctor_imu import check_imu, watch_imu
from robotctl.drivers.can.robot_can import CanRobot
from robotctl.errors import LinkError
from robotctl.messages.actuators import ActuatorCommand
from robotctl.messages.control import BusState, BusStatus, NodeStatus, Stranger, StrangerKind
from robotctl.messages.faults import FaultCode
from robotctl.messages.ports import Clock
from robotctl.runtime.ipc.process_lock import claim_bus

LISTEN_NS: Final = 600_000_000
"""Listening time, more than five heartbeats [ns]."""

COMMISSION_NS: Final = 3_000_000_000
_POLL_NS = 5_000_000
_OFF = ActuatorCommand(enable=False, brake=True)

_LOAD: Final = "load the firmware that belongs to this robotctl's configs/robot.dbc"
_FIXES: Final = {
    FaultCode.NODE_NO_ANSWER: "check its power and cable, and that no other node has its number",
    FaultCode.NODE_OTHER_DEVICE: "give each node its own number: two may be swapped",
    FaultCode.NODE_OTHER_FIRMWARE: _LOAD,
    FaultCode.NODE_OTHER_VALUE: "correct the robot's file, or the node's parameter",
    FaultCode.NODE_CHANGED: "find out who else on the bus writes to the nodes",
    FaultCode.NODE_PUT_OUT: "find out who else on the bus commands the nodes (NMT)",
}
"""Remedy for each kind of problem; for others: check power and cable."""


def check_drives(config: RobotConfig) -> Iterator[Finding]:
    """Yield each drive's reaction to a silent computer, and the settings that accept it."""
    for motor in config.motors:
        accepted = []
        if motor.accept_coasting:
            accepted.append("coasting")
        if motor.accept_timeout_ms:
            accepted.append(f"{motor.accept_timeout_ms} ms without a command")
        check = f"drive {motor.name}"
        if accepted:
            yield risk(check, f"the robot's file accepts {' and '.join(accepted)}: {motor.silence}")
        else:
            yield ok(check, motor.silence)


def check_nodes(config: RobotConfig, clock: Clock) -> list[Finding]:
    """Open the buses and check all drives and nodes; takes up to 5 s."""
    parts = make_parts(config, make_codec())
    with ExitStack() as held:
        try:
            ports = open_ports(config, parts.identifiers, clock)
        except LinkError as error:
            fix = "fix the CAN link, or start firmware_sim if the bus is simulated"
            return [fail("CAN nodes", str(error), fix)]
        for port in ports.values():
            held.callback(port.close)
        robot = CanRobot(ports, parts)
        if is_driven(robot, clock) or not _claim(config, held):
            return [only_listened(robot.nodes), check_traffic(robot.bus_status())]
        nodes = commission(robot, clock, config.runtime.period_ns)
        ours = {part.status.name for part in parts.ours}
        version = parts.codec.dbc.wire_version
        findings = [check_node(node, version if node.name in ours else None) for node in nodes]
        if config.imu.enabled:
            said = watch_imu(robot, clock, config.runtime.period_ns, config.imu, _OFF)
            findings.append(check_imu(said, config.imu))
        return [*findings, check_traffic(robot.bus_status())]


def _claim(config: RobotConfig, held: ExitStack) -> bool:
    """Claim the buses while `held` is open; return False if a controller has one."""
    try:
        for bus in config.buses:
            held.enter_context(claim_bus(bus.interface, bus.channel))
    except LinkError:
        return False
    return True


def is_driven(robot: CanRobot, clock: Clock) -> bool:
    """Listen for `LISTEN_NS`; return whether another controller sends commands."""
    end_ns = clock.now_ns() + LISTEN_NS
    strangers: tuple[Stranger, ...] = ()
    while (now_ns := clock.now_ns()) < end_ns:
        strangers = robot.receive(now_ns).strangers
        clock.sleep_until(now_ns + _POLL_NS)
    return any(each.kind is StrangerKind.HOST_FRAME for each in strangers)


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


def check_node(node: NodeStatus, wire_version: int | None) -> Finding:
    """Check one drive or node after its commissioning; ours have a protocol version."""
    check = f"node {node.node_id} {node.name}"
    if not node.problem:
        version = "" if wire_version is None else f", wire version 0x{wire_version:08X}"
        return ok(check, f"identified, parameters confirmed{version}")
    return fail(check, node.problem, _FIXES.get(node.fault, "check its power and cable"))


def check_traffic(bus: BusStatus) -> Finding:
    """Check the bus errors during our traffic."""
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


def only_listened(nodes: tuple[NodeStatus, ...]) -> Finding:
    """Report the nodes that were received, when a running controller forbids queries."""
    names = ", ".join(node.name for node in nodes if node.boots) or "no node"
    missing = ", ".join(node.name for node in nodes if not node.boots)
    unheard = f", not of {missing}" if missing else ""
    return none(
        "CAN nodes",
        f"a controller is running and asks them itself; heartbeats of {names} were heard{unheard}",
    )
