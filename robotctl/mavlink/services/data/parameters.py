"""Parameters: list, read and set. https://mavlink.io/en/services/parameter.html.

Integers are packed as the robot's personality says. Other processes of the robot, such as that of
its web page, set them by the same rules.
"""

from __future__ import annotations

import difflib
import json
import zlib
from collections import Counter, deque
from typing import Final

from pymavlink.dialects.v20 import common

from robotctl.config_values import Value
from robotctl.mavlink.command import (
    ACCEPTED,
    DENIED,
    FAILED,
    TEMPORARILY_REJECTED,
    UNSUPPORTED,
    Command,
)
from robotctl.mavlink.context import Context
from robotctl.mavlink.parameters.parameter import MOST_LETTERS, REAL32, Parameter, kind_of
from robotctl.mavlink.parameters.parameter_set import ParamError, ParameterRefused
from robotctl.mavlink.parameters.published import values_of
from robotctl.mavlink.service import Microservice
from robotctl.messages.control import Severity
from robotctl.messages.mavlink_port import Message, Peer, source
from robotctl.messages.requests import REQUEST_LIFE_NS
from robotctl.messages.tuning import (
    ParameterAnswer,
    ParameterRequest,
    ResetParameters,
    SetParameter,
    Tuning,
)

PER_STEP: Final = 4
"""Parameters of a list sent in a step: 400 in a second, 15 kB/s."""
MOST_SETS: Final = 16
"""Maximum PARAM_SET of one connection in a step; a station that sends more has to repeat them."""
SAVES: Final = 10
"""Most saves within `SAVES_NS`: telemetry waits for the disk, which may take milliseconds."""
SAVES_NS: Final = 500_000_000
FRESH_NS: Final = 1_000_000_000
"""Time after a value was sent to all in which setting it again is answered to the sender alone
[ns]."""
AGAIN_NS: Final = 500_000_000
"""Interval after which values that control or navigation has not taken are sent again [ns]."""
LATE_NS: Final = 1_200_000_000
"""Delay after which people are told [ns]."""
PUBLISHED_NS: Final = 1_000_000_000
"""Period at which the values are published again for late subscribers [ns]."""
NO_INDEX: Final = -1
STORAGE: Final[int] = common.MAV_CMD_PREFLIGHT_STORAGE
CHANGE_SPEED: Final[int] = common.MAV_CMD_DO_CHANGE_SPEED
SPEED: Final = "CRUISE_SPEED"
_WRITE, _RESET = 1, 2
"""PARAMETERS of PREFLIGHT_STORAGE: keep them, or take those of the robot's file."""
_OWN_SPEED, _SAME_SPEED = -1.0, -2.0


class Parameters(Microservice):
    """Gives and takes parameters; what changes is kept, and brought into force where it may be."""

    handles = frozenset(
        {
            common.MAVLINK_MSG_ID_PARAM_REQUEST_LIST,
            common.MAVLINK_MSG_ID_PARAM_REQUEST_READ,
            common.MAVLINK_MSG_ID_PARAM_SET,
        }
    )
    commands = frozenset({STORAGE, CHANGE_SPEED})

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._set = context.parameters
        self._lists: dict[Peer, int] = {}
        """Peers that are being sent the list, and the next index of each."""
        self._taken: list[Parameter] = []
        self._said: list[str] = []
        """Parameters that were set since the last save, and what is to be said of them."""
        self._puts: Counter[Peer] = Counter()
        """PARAM_SET of this step."""
        self._saves_ns: deque[int] = deque([-SAVES_NS] * SAVES, SAVES)
        """When the last saves were [ns]."""
        self._told_ns: dict[str, int] = {}
        """When all were told the value of each parameter [ns]."""
        self._live = Tuning(0, {}, 0)
        """Settings that control and navigation are to have."""
        self._speed: dict[str, Value] = {}
        """The speed of DO_CHANGE_SPEED, by its key: it is not kept."""
        self._sent_ns = self._changed_ns = 0
        self._is_late = False
        self._published_ns: int | None = None
        self._bring_into_force(0)

    def on_message(self, message: Message, peer: Peer, now_ns: int) -> None:
        """Take a message of the protocol."""
        match message.get_msgId():
            case common.MAVLINK_MSG_ID_PARAM_REQUEST_LIST:
                self._lists[peer] = 0
            case common.MAVLINK_MSG_ID_PARAM_REQUEST_READ:
                self._read(message, peer)
            case _:
                self._put(message, peer, now_ns)

    def on_command(self, command: Command, now_ns: int) -> int:
        """Take PREFLIGHT_STORAGE: param1 1 keeps the parameters, 2 forgets what was set.

        DO_CHANGE_SPEED: param2 is the speed [m/s], -1 the robot's own, -2 the present one.
        """
        if command.number == CHANGE_SPEED:
            return self._change_speed(command.params[1], now_ns)
        if command.params[0] == _WRITE:
            saved = self._context.parameter_store.save(self._set.changes())
            return ACCEPTED if saved else FAILED
        if command.params[0] == _RESET:
            objection = self._reset(now_ns)
            if objection:
                self._context.say(now_ns, f"Storage: {objection}")
            return TEMPORARILY_REJECTED if objection else ACCEPTED
        self._context.say(now_ns, "Storage: param1 1 keeps the parameters, 2 forgets what was set")
        return DENIED

    def _reset(self, now_ns: int) -> str:
        """Take the values of the robot's file; return why not, empty: they are taken."""
        if self._context.is_armed(now_ns):
            return "not while armed"
        changed = self._set.reset()
        said = [f"Parameter {parameter.name}: {change}" for parameter, change in changed]
        self._taken += [parameter for parameter, _ in changed]
        self._said += said
        self._keep(now_ns)
        return ""

    def _change_speed(self, speed_m_s: float, now_ns: int) -> int:
        """Drive to the coming places at another speed, until a restart or `SPEED` is set."""
        index = self._set.index_of(SPEED)
        if speed_m_s == _SAME_SPEED:
            return ACCEPTED
        if index is None:
            return UNSUPPORTED
        parameter = self._set.parameters[index]
        try:
            self._speed = (
                {}
                if speed_m_s == _OWN_SPEED
                else {parameter.key: self._set.allowed(parameter, speed_m_s)}
            )
        except ParameterRefused as refusal:
            self._context.say(now_ns, f"Speed: {refusal}")
            return DENIED
        self._bring_into_force(now_ns)
        return ACCEPTED

    def step(self, now_ns: int) -> None:
        """Send the next of each list; set what was asked for; see that it comes into force."""
        for peer in list(self._lists):
            self._send_next(peer)
        self._puts.clear()
        for number, request in enumerate(self._context.parameter_requests):
            refusal = self._carry_out(request, now_ns) if number < MOST_SETS else "too many at once"
            self._context.news.append(ParameterAnswer(request.request_id, refusal))
        self._context.parameter_requests.clear()
        if self._taken and now_ns - self._saves_ns[0] >= SAVES_NS:
            self._keep(now_ns)
        if now_ns - self._sent_ns >= AGAIN_NS:
            self._follow(now_ns)
        if self._published_ns is None or now_ns - self._published_ns >= PUBLISHED_NS:
            self._publish(now_ns)

    def _publish(self, now_ns: int) -> None:
        """Let the other processes see the values."""
        self._published_ns = now_ns
        self._context.news.append(values_of(self._set, now_ns))

    def _carry_out(self, request: ParameterRequest, now_ns: int) -> str:
        """Carry out a request of another process; return why not, empty: it is carried out."""
        if not 0 <= now_ns - request.stamp_ns <= REQUEST_LIFE_NS:
            return "the request is too old, or of the future"
        if isinstance(request, ResetParameters):
            return self._reset(now_ns)
        index = self._set.index_of(request.name)
        if index is None:
            return f"{request.name[:MOST_LETTERS]}: no such parameter"
        try:
            self._set_one(self._set.parameters[index], request)
        except ParameterRefused as refusal:
            return str(refusal)
        return ""

    def _set_one(self, parameter: Parameter, request: SetParameter) -> None:
        """Set a parameter for another process; raises as `ParameterSet.set`."""
        value = request.value
        raw = float(self._set.default(parameter)) if value is None else value
        if change := self._set.set(parameter, raw, REAL32):
            self._note(parameter, change)

    def _note(self, parameter: Parameter, change: str) -> None:
        """Have a change kept, brought into force and told with the next save."""
        self._taken.append(parameter)
        self._speed.pop(parameter.key, None)
        self._said.append(f"Parameter {parameter.name}: {change}")

    def _send_next(self, peer: Peer) -> None:
        """Send a part of the list; end it where it, or the peer, has ended."""
        begin = self._lists[peer]
        part = self._set.parameters[begin : begin + PER_STEP]
        if not part or peer not in self._context.peers:
            del self._lists[peer]
            return
        self._lists[peer] += len(part)
        for parameter in part:
            self._context.links.reply(self._message(parameter), peer)

    def _read(self, message: Message, peer: Peer) -> None:
        """Send one parameter, by its index, or by its name where that is -1."""
        index: int | None = message.param_index
        if index == NO_INDEX:
            index = self._set.index_of(message.param_id)
        if index is not None and 0 <= index < len(self._set.parameters):
            self._context.links.reply(self._message(self._set.parameters[index]), peer)
        else:
            self._refuse(ParamError.DOES_NOT_EXIST, message, peer, message.param_index)

    def _put(self, message: Message, peer: Peer, now_ns: int) -> None:
        """Set a parameter; the answer follows once the new value is kept."""
        index = self._set.index_of(message.param_id)
        if index is None:
            if self._context.may_speak(now_ns):  # the nearest of 100 names takes 2 ms
                near = difflib.get_close_matches(message.param_id, self._names, n=1)
                hint = f"; did you mean {near[0]}?" if near else ""
                self._context.tell_asker(now_ns, f"Parameter {message.param_id}: unknown{hint}")
            self._refuse(ParamError.DOES_NOT_EXIST, message, peer, NO_INDEX)
            return
        self._puts[peer] += 1
        if self._puts[peer] > MOST_SETS:
            return
        parameter = self._set.parameters[index]
        try:
            kind = message.param_type
            raw = self._context.personality.value_of(message.param_value, kind)
            change = self._set.set(parameter, raw, kind)
        except ParameterRefused as refusal:
            self._context.tell_asker(now_ns, f"Parameter {refusal}")
            self._refuse(refusal.problem, message, peer, index)
            self._context.links.reply(self._message(parameter), peer)
            return
        if change:
            self._note(parameter, change)
        elif parameter not in self._taken:
            if now_ns - self._told_ns.get(parameter.name, 0) < FRESH_NS:
                self._context.links.reply(self._message(parameter), peer)
            else:
                self._tell_all(parameter, now_ns)

    @property
    def _names(self) -> list[str]:
        return [each.name for each in self._set.parameters]

    def _keep(self, now_ns: int) -> None:
        """Save changes, bring them into force, and tell everybody."""
        self._saves_ns.append(now_ns)
        taken, said = self._taken, self._said
        self._taken, self._said = [], []
        if not self._context.parameter_store.save(self._set.changes()):
            said.append("Parameters cannot be saved, a restart will lose them")
        for text in said:
            self._context.say(now_ns, text, Severity.NOTICE)
        self._bring_into_force(now_ns)
        for parameter in dict.fromkeys(taken):
            self._tell_all(parameter, now_ns)
        self._publish(now_ns)

    def _tell_all(self, parameter: Parameter, now_ns: int) -> None:
        """Send PARAM_VALUE to everybody."""
        self._told_ns[parameter.name] = now_ns
        message = self._message(parameter)
        for peer in self._context.peers:
            self._context.links.reply(message, peer)

    def _bring_into_force(self, now_ns: int) -> None:
        """Take what concerns this process; have the rest sent to the others."""
        values = self._set.live() | self._speed
        if values == self._live.values:
            return
        number = zlib.crc32(json.dumps(values, sort_keys=True).encode()) if values else 0
        self._live = Tuning(now_ns, values, number)
        self._context.config = self._set.now.mavlink
        self._sent_ns, self._changed_ns, self._is_late = now_ns - AGAIN_NS, now_ns, False

    def _follow(self, now_ns: int) -> None:
        """Send what control or navigation have not taken yet, or not any more: they may restart."""
        states = {
            "control": self._context.fresh_control(now_ns),
            "navigation": self._context.fresh_navigation(now_ns),
        }
        behind = [
            name
            for name, state in states.items()
            if state is not None and state.tuning != self._live.number
        ]
        if not behind:
            self._changed_ns, self._is_late = now_ns, False
            return
        live = self._live
        self._context.requests.append(Tuning(now_ns, live.values, live.number))
        self._sent_ns = now_ns
        if now_ns - self._changed_ns > LATE_NS and not self._is_late:
            self._is_late = True
            self._context.say(now_ns, f"Parameters: not taken yet by {', '.join(behind)}")

    def _message(self, parameter: Parameter) -> Message:
        """Return PARAM_VALUE."""
        value, index = self._set.value(parameter), self._set.index_of(parameter.name)
        return common.MAVLink_param_value_message(
            parameter.name.encode(),
            self._context.personality.param_value(value),
            kind_of(value),
            len(self._set.parameters),
            index,
        )

    def _refuse(self, problem: ParamError, message: Message, peer: Peer, index: int | None) -> None:
        """Send PARAM_ERROR."""
        index = NO_INDEX if index is None else index
        name = message.param_id.encode("ascii", "replace")[:MOST_LETTERS]
        error = common.MAVLink_param_error_message(*source(message), name, index, problem)
        self._context.links.reply(error, peer)
