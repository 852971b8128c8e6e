"""The robot on a CAN bus: `RobotPort` over a `CanPort`.

One tick: `receive` drains the bus and hands each frame to its decoder; `send` puts MotorCommand
and SYNC on the bus, and at most one frame of node services after them: commissioning, clearing of
faults, and reading each node's settings in turn.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from robotctl.drivers.can.bus_load import transmission_type
from robotctl.drivers.can.config import NodeParameters
from robotctl.drivers.can.dbc import Message
from robotctl.drivers.can.e2e import (
    SURPLUS_ON_SYNC,
    SURPLUS_TIMED,
    AliveCounter,
    E2eCounters,
    E2eReceiver,
)
from robotctl.drivers.can.nodes.can_node import NodeFrame, Value
from robotctl.drivers.can.nodes.drive import CLEAR_FAULTS, DRIVE
from robotctl.drivers.can.nodes.node import HEARTBEAT_BASE, Node
from robotctl.drivers.can.nodes.registry import wanted_nodes
from robotctl.drivers.can.nodes.robot_codec import SYNC, RobotCodec
from robotctl.drivers.can.nodes.sdo import REQUEST_BASE, RESPONSE_BASE
from robotctl.drivers.can.nodes.stranger_book import StrangerBook
from robotctl.messages.control import (
    BusStatus,
    EmergencyMessage,
    EmergencyStopSource,
    Feedback,
    NodeStatus,
    StrangerKind,
    WheelCommand,
)
from robotctl.messages.ports import CanPort

EMERGENCY_BASE: Final = 0x080

READ_BACK_NS: Final = 100_000_000
"""Period of reading back one setting of each node [ns]: all seven of the drive take 0.7 s."""

DISABLE_FRAMES: Final = 3
"""How often `close` sends "motors off"."""

_LATE: Final = 1.2
"""Share of its period that a message with a timer of its own may take to come."""

_FIELDS: Final = Feedback.__struct_fields__
_NOTHING: Final[list[Any]] = [getattr(Feedback(), name) for name in _FIELDS]
_DRIVE_STATUS, _EMERGENCIES, _EMERGENCY_STOP, _NODES, _BUS, _STRANGERS = map(
    _FIELDS.index, ("drive", "emergencies", "emergency_stop", "nodes", "bus", "strangers")
)

_SOURCES = {source.value: source for source in EmergencyStopSource}

Handler = Callable[[bytes, int], None]


class CanRobot:
    """The nodes of a robot on one CAN port: those of `CAN_NODES` that its file enables.

    Parameters
    ----------
    port
        The bus; it accepts at least `codec.arbitration_ids`.
    codec
        Compiled from the DBC.
    parameters
        Required and configured settings of the nodes.
    """

    def __init__(self, port: CanPort, codec: RobotCodec, parameters: NodeParameters) -> None:
        self._port = port
        self._codec = codec
        self._alive = AliveCounter()
        self._counters = E2eCounters()
        self._strangers = StrangerBook()
        self._values = list(_NOTHING)
        """Feedback of the present tick, in the order of the fields of `Feedback`."""
        self._refused_commands = 0
        self._stop_source: EmergencyStopSource | None = None
        self._clear_wanted = False
        self._read_back_ns = 0
        self._closed = False
        self._steering_rad = 0.0
        """Last steering angle, within the range of commands: motors switched off leave it there."""
        timeout_ns = parameters.heartbeat_timeout_ms * 1_000_000
        wanted = wanted_nodes(parameters)
        self._nodes = [
            Node(
                each.node_id,
                each.name,
                each.script(codec.dbc, parameters),
                timeout_ns,
                self._strangers,
            )
            for each in wanted
        ]
        self._drive = next(node for node in self._nodes if node.node_id == DRIVE.node_id)
        self._waiting = list(self._nodes)
        """In turn, so that none has to wait until others are ready: whose frame is next."""
        self._node_status = tuple(node.status for node in self._nodes)
        self._handlers: dict[int, Handler] = {
            codec.emergency_stop_id: self._on_emergency_stop,
            **{number: self._on_host_frame(number) for number in codec.host_only},
        }
        for node in self._nodes:
            self._handle_services(node)
        for node, each in zip(self._nodes, wanted, strict=True):
            for frame in each.frames:
                self._handle_process_data(node, frame, parameters)

    # Receiving ----------------------------------------------------------------------------------

    def receive(self, now_ns: int) -> Feedback:
        """Return the data received since the last call, and the present state of nodes and bus."""
        values = self._values
        values[:] = _NOTHING
        handlers = self._handlers
        for arbitration_id, data, stamp_ns in self._port.receive():
            handler = handlers.get(arbitration_id)
            if handler is not None:
                handler(data, stamp_ns)
        for node in self._nodes:
            if node.check(now_ns):
                self._note_nodes()
        self._strangers.refresh()
        drive = values[_DRIVE_STATUS]
        if drive is not None:
            low_rad, high_rad = self._codec.steering_range_rad
            self._steering_rad = min(max(drive.steering_rad, low_rad), high_rad)
        values[_NODES] = self._node_status
        values[_BUS] = self._bus_status()
        values[_STRANGERS] = self._strangers.seen
        return Feedback(*values)

    def _bus_status(self) -> BusStatus:
        """Return the port's counters together with those of end-to-end protection."""
        port, e2e = self._port.status(), self._counters
        if not (self._refused_commands or e2e.crc_rejects or e2e.counter_rejects or e2e.lost):
            return port
        return BusStatus(
            port.state,
            port.received,
            port.sent,
            port.send_failures + self._refused_commands,
            port.error_frames,
            e2e.crc_rejects,
            e2e.counter_rejects,
            e2e.lost,
            port.load,
        )

    def _note_nodes(self) -> None:
        """Update changed nodes; unchanged ones stay the same object."""
        status = tuple([node.status for node in self._nodes])
        if status != self._node_status:
            self._node_status = status

    def _handle_services(self, node: Node) -> None:
        """Wire heartbeat, SDO and EMCY of a node to their handlers."""
        node_id = node.node_id

        def on_heartbeat(data: bytes, stamp_ns: int) -> None:
            node.on_heartbeat(data, stamp_ns)
            self._note_nodes()

        def on_sdo(data: bytes, _: int) -> None:
            node.on_sdo(data)
            self._note_nodes()

        def on_emergency(data: bytes, stamp_ns: int) -> None:
            if len(data) == 8:
                code = int.from_bytes(data[:2], "little")
                self._values[_EMERGENCIES] += (EmergencyMessage(stamp_ns, node_id, code, data[2]),)

        self._handlers[HEARTBEAT_BASE + node_id] = on_heartbeat
        self._handlers[REQUEST_BASE + node_id] = node.on_foreign_sdo
        self._handlers[RESPONSE_BASE + node_id] = on_sdo
        self._handlers[EMERGENCY_BASE + node_id] = on_emergency

    def _handle_process_data(
        self, node: Node, frame: NodeFrame, parameters: NodeParameters
    ) -> None:
        """Wire a protected message to its receiver and decoder."""
        message = self._codec.dbc.message(frame.message)
        arbitration_id = message.arbitration_id
        note, name = self._strangers.note, node.status.name
        period_ns, on_sync = self._period_ns(message, parameters)
        receiver = E2eReceiver(
            message,
            period_ns,
            self._counters,
            SURPLUS_ON_SYNC if on_sync else SURPLUS_TIMED,
            lambda stamp_ns: note(
                StrangerKind.SECOND_SENDER, message.name, arbitration_id, name, stamp_ns
            ),
        )
        node.watch(receiver, period_ns if on_sync else round(_LATE * period_ns))
        index = _FIELDS.index(frame.field)
        guarded = _guarded_all if isinstance(_NOTHING[index], tuple) else _guarded
        read = self._codec.readers[frame.message]
        self._handlers[arbitration_id] = guarded(receiver, read, self._values, index)

    def _period_ns(self, message: Message, parameters: NodeParameters) -> tuple[int, bool]:
        """Return how often a message is sent [ns], and whether by SYNC."""
        if message.send_type != "OnSync":
            return message.cycle_ms * 1_000_000, False
        sync, rate_hz = self._codec.dbc.message(SYNC), parameters.rate_hz
        every = transmission_type(message, sync, rate_hz, steered=parameters.steered)
        return every * 1_000_000_000 // rate_hz, True

    def _on_emergency_stop(self, data: bytes, _: int) -> None:
        self._leave_latches()
        source = _SOURCES.get(data[0]) if data else None
        self._values[_EMERGENCY_STOP] = EmergencyStopSource.UNKNOWN if source is None else source

    def _on_host_frame(self, arbitration_id: int) -> Handler:
        """Return the handler of a frame that only the host sends: the bus returns none of ours."""
        name, is_nmt = self._codec.host_only[arbitration_id], arbitration_id == self._codec.nmt_id
        note = self._strangers.note

        def handle(data: bytes, stamp_ns: int) -> None:
            note(StrangerKind.HOST_FRAME, name, arbitration_id, "", stamp_ns)
            if is_nmt:
                self._on_foreign_nmt(data)

        return handle

    def _on_foreign_nmt(self, data: bytes) -> None:
        """Handle another device's NMT command."""
        if len(data) == 2:
            for node in self._nodes:
                if data[1] in (0, node.node_id):
                    node.on_foreign_nmt(data[0])
            self._note_nodes()

    # Sending ------------------------------------------------------------------------------------

    def send(self, command: WheelCommand, now_ns: int) -> None:
        """Send one actuator command and SYNC, then at most one frame of node services.

        A command that the wire cannot carry (not finite, out of range) becomes "motors off" and
        counts as a failure to send. "Motors off" carries the measured steering, whatever the
        command.
        """
        if self._stop_source is not None:
            self.emergency_stop(self._stop_source)
        self._send_command(command)
        # SYNC last: the drive latches its encoders at it and answers in time for the next tick.
        self._port.send(self._codec.sync_id, b"")
        self._serve(now_ns)

    def _send_command(self, command: WheelCommand) -> None:
        """Send MotorCommand; its counter moves on only when the bus took it."""
        alive = self._alive
        encode = self._codec.encode_command
        steering_rad = command.steering_rad if command.enable else self._steering_rad
        try:
            data = encode(
                alive.value,
                command.enable,
                command.brake,
                command.duty1,
                command.duty2,
                steering_rad,
            )
        except (ValueError, OverflowError):
            self._refused_commands += 1
            data = encode(alive.value, 0, 1, 0.0, 0.0, self._steering_rad)
        # A counter that advanced without a frame would look like a lost frame to the drive.
        if self._port.send(self._codec.command_id, data):
            alive.advance()

    def _serve(self, now_ns: int) -> None:
        """Send the next frame of commissioning or of a wanted transfer, of one node."""
        if self._clear_wanted:
            self._clear_wanted = False
            self._drive.request(CLEAR_FAULTS)
        if now_ns >= self._read_back_ns:
            self._read_back_ns = now_ns + READ_BACK_NS
            for node in self._nodes:
                node.read_back(now_ns)
        for node in self._waiting:
            if node.busy:
                frame = node.poll(now_ns)
                self._note_nodes()
                if frame is not None:
                    if self._port.send(*frame):
                        node.sent(now_ns)
                        self._waiting.remove(node)
                        self._waiting.append(node)
                    return

    def emergency_stop(self, source: EmergencyStopSource) -> None:
        """Send the emergency stop at once; where the bus does not take it, again each tick."""
        self._leave_latches()
        taken = self._port.send(self._codec.emergency_stop_id, bytes((source,)))
        self._stop_source = None if taken else source

    def clear_faults(self) -> None:
        """Ask the drive, by its object 0x2010, to leave its latched state.

        The request goes out with the next `send`, or not at all where the drive is not in service:
        a waiting request could take effect unexpectedly.
        """
        self._clear_wanted = True

    def _leave_latches(self) -> None:
        """Drop a request to clear faults: it was made without knowledge of the emergency stop."""
        self._clear_wanted = False
        self._drive.withdraw()

    def close(self) -> None:
        """Say that the motors are off, then release the bus. Closing twice does nothing."""
        if self._closed:
            return
        self._closed = True
        stopped = WheelCommand(enable=False, brake=True, steering_rad=self._steering_rad)
        for _ in range(DISABLE_FRAMES):
            self._send_command(stopped)
        self._port.close()

    @property
    def nodes(self) -> tuple[NodeStatus, ...]:
        """Status of each node."""
        return self._node_status


def _guarded(
    receiver: E2eReceiver, read: Callable[[bytes, int], Value], values: list[Any], index: int
) -> Handler:
    """Return a handler that keeps the newest value that the receiver accepts."""
    accept = receiver.accept

    def handle(data: bytes, stamp_ns: int) -> None:
        if accept(data, stamp_ns):
            values[index] = read(data, stamp_ns)

    return handle


def _guarded_all(
    receiver: E2eReceiver, read: Callable[[bytes, int], Value], values: list[Any], index: int
) -> Handler:
    """Return a handler that keeps all values that the receiver accepts."""
    accept = receiver.accept

    def handle(data: bytes, stamp_ns: int) -> None:
        if accept(data, stamp_ns):
            values[index] += (read(data, stamp_ns),)

    return handle
