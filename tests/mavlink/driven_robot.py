"""A simulated robot in lockstep whose only operator is a MAVLink ground station."""

from dataclasses import replace

from pymavlink.dialects.v20 import common

from robotctl.app.processes.navigator import make_navigation
from robotctl.app.processes.telemetry import described, parameters_of
from robotctl.app.simulation.lockstep_stack import LockstepStack, make_simulation
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import find_file
from robotctl.core.navigation_tick import NavigationTick
from robotctl.core.operator import Operator
from robotctl.mavlink.config import StreamRates
from robotctl.mavlink.telemetry import Telemetry
from robotctl.messages.control import ControlRequest, NavigationRequest, SafetyState
from robotctl.messages.mavlink_port import Peer, Received
from robotctl.safety.state_machine import POWERED

ARM, SET_MODE = common.MAV_CMD_COMPONENT_ARM_DISARM, common.MAV_CMD_DO_SET_MODE
SILENT = dict.fromkeys(StreamRates.__dataclass_fields__, 0.0)
TELEMETRY_TICKS = 2
"""Telemetry steps at 100 Hz, control at 200 Hz."""


class DrivenRobot:
    """Firmware, control, navigation and telemetry tick by tick; `start` is (x, y, heading)."""

    def __init__(
        self, links, robot="diff_drive", start=(6.0, 5.0, 0.0), mission="", overrides=(),
        world="hall", **rates,
    ):  # fmt: skip
        path = find_file(robot)
        options = StackOptions(
            "lockstep",
            str(path),
            overrides,
            mission=mission,
            x_m=start[0],
            y_m=start[1],
            theta_rad=start[2],
            epoch_ns=0,
        )
        self.config = options.load()
        simulation = make_simulation(path, find_file(world, "worlds"), 1, start, overrides)
        self.stack = LockstepStack(self.config, options, simulation, lambda _: None)
        self.navigation = make_navigation(self.config, options)
        self.links = links
        mavlink = replace(self.config.mavlink, rates=StreamRates(**{**SILENT, **rates}))
        self._tick = NavigationTick(
            self.navigation, None, Operator(lambda: self._asked, lambda _: None)
        )
        self._asked = ()
        self.telemetry = Telemetry(
            mavlink,
            described(self.config, options),
            links,
            parameters=parameters_of(self.config, options),
        )
        self._every = round(self.navigation.period_ns / self.stack.period_ns)
        self._to_control: list[ControlRequest] = []
        self._to_navigation = []
        self._states = []
        self._codecs = {}
        self.state = None

    @property
    def now_ns(self):
        return self.stack.clock.now_ns()

    def pose(self):
        """Return where the robot truly is: x, y [m], heading [rad]."""
        return self.stack.simulation.pose()

    def send(self, message, system=255, component=190):
        """Let a message of the ground station arrive."""
        codec = self._codecs.setdefault(
            (system, component), common.MAVLink(None, system, component)
        )
        decoded = codec.decode(bytearray(message.pack(codec)))
        codec.seq = (codec.seq + 1) % 256
        self.links.incoming.append(Received(decoded, Peer(0, 0)))

    def tell_telemetry(self, request):
        """Let a request of another process of the robot arrive."""
        self._states.append(request)

    def tell_navigation(self, request):
        """Let a request to navigation arrive."""
        self._to_navigation.append(request)

    def tick(self):
        """Let one period of control pass."""
        requests, self._to_control = tuple(self._to_control), []
        self.stack.tick(requests)
        control = self.stack.snapshot()
        if self.stack.ticks % self._every == 0:
            self._asked, self._to_navigation = self._to_navigation, []
            self._tick.receive(control, ())
            command, self.state = self._tick.navigate(self.now_ns)
            self._to_control.append(command)
            self._states.append(self.state)
        if self.stack.ticks % TELEMETRY_TICKS == 0:
            states, self._states = [control, *self._states], []
            for request in self.telemetry.step(self.now_ns, states):
                if isinstance(request, ControlRequest):
                    self._to_control.append(request)
                if isinstance(request, NavigationRequest):
                    self._to_navigation.append(request)
        return control

    def run(self, seconds, message=None, every_s=0.1):
        """Let time pass while the ground station repeats `message`."""
        ticks, pause = round(seconds * 200), round(every_s * 200)
        for number in range(ticks):
            if message is not None and number % pause == 0:
                self.send(message)
            control = self.tick()
        return control

    def command(self, number, *params):
        """Let a command arrive, and its answer leave."""
        params = (*params, *[0.0] * (7 - len(params)))
        self.send(common.MAVLink_command_long_message(1, 1, number, 0, *params))

    def arm(self, mode):
        """Arm the robot in a mode, as a ground station does."""
        while self.tick().state is SafetyState.BOOT:
            pass
        self.run(0.5)
        self.command(SET_MODE, common.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, mode)
        self.run(0.2)
        self.command(ARM, 1)
        control = self.run(1.0)
        assert control.state in POWERED, control.reason
        assert self.state.mode == mode
