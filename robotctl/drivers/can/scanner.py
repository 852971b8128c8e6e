"""Scan of a bus that moves nothing: listens, then asks what each kind of device answers.

Frames that a controller sends end the asking before it begins. A question is sent once no device
can be there that would take it, or its answer, for a command of another protocol: its own probe
has asked that device before, and nobody answered.
"""

from __future__ import annotations

import enum
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Final

from robotctl.drivers.can.bus_load import worst_case_bits
from robotctl.drivers.can.config import CanConfig, bring_up
from robotctl.drivers.can.drives.registry import DRIVES
from robotctl.drivers.can.nodes.registry import CAN_NODES
from robotctl.drivers.can.nodes.scan import own_probe
from robotctl.drivers.can.probe import ANSWER_NS, Found, Probe, Question
from robotctl.messages.control import BusState
from robotctl.messages.ports import FD_FLAG, CanPort, Clock
from robotctl.words import counted

LISTEN_NS: Final = 600_000_000
"""Time of listening before the first question [ns]: six heartbeats of most drives."""

POLL_NS: Final = 2_000_000
"""Period of reading the bus [ns]."""

SHARE: Final = 0.5
"""Share of the bus that questions take at most."""

_STUCK_NS: Final = 200_000_000
"""Time in which a bus that works has taken a frame [ns]."""

_MANY_ERRORS: Final = 8
"""Number of error frames that no random disturbance causes in so short a time."""

_BROKEN: Final = (BusState.ERROR_PASSIVE, BusState.BUS_OFF, BusState.DOWN)
_WORSE: Final = (BusState.ERROR_ACTIVE, BusState.ERROR_WARNING, *_BROKEN)
"""States, each worse than the one before."""

_WIRING: Final = (
    "check that the drives have power, CAN-H and CAN-L are not swapped, and two resistors of 120 "
    "ohm end the bus (60 ohm between CAN-H and CAN-L, power off)"
)


class Verdict(enum.Enum):
    """Result of a scan."""

    FOUND = "found"
    DRIVEN = "a controller is running"
    CLASH = "two devices have one number"
    CLASSIC = "a device knows no CAN FD"
    FULL = "the bus is full"
    BLOCKED = "the bus is blocked"
    WRONG_BITRATE = "error frames only"
    ALONE = "nobody acknowledges"
    DESTROYED = "own frames are destroyed"
    DOWN = "the interface is down"
    SILENT = "nobody answers"
    UNKNOWN = "unknown protocol"


@dataclass(frozen=True, slots=True)
class ScanReport:
    """Finding on one bus.

    Parameters
    ----------
    verdict
        In short.
    text, fix
        What was found, and what to do; empty where there is nothing to do.
    found
        All devices, by protocol and number.
    not_asked
        Devices that were not asked all, since a question or its answer could be a command for
        another device.
    duration_ms
        Time that it took [ms].
    frames, error_frames
        Received.
    """

    verdict: Verdict
    text: str
    fix: str
    found: tuple[Found, ...]
    not_asked: tuple[str, ...]
    duration_ms: float
    frames: int
    error_frames: int

    @property
    def is_good(self) -> bool:
        """Whether nothing has to be mended."""
        return self.verdict in (Verdict.FOUND, Verdict.DRIVEN)


def all_probes() -> tuple[Probe, ...]:
    """Return a new probe of each kind of drive, and that of our sensor nodes."""
    return (*(kind.probe() for kind in DRIVES), own_probe(CAN_NODES))


class Scanner:
    """One scan of one bus.

    Parameters
    ----------
    port
        The bus; it accepts all frames.
    config
        Its bit rates.
    clock
        The clock of the port.
    probes
        Kinds of devices to look for.
    """

    def __init__(
        self, port: CanPort, config: CanConfig, clock: Clock, probes: Sequence[Probe] | None = None
    ) -> None:
        self._port = port
        self._config = config
        self._clock = clock
        self._probes = all_probes() if probes is None else tuple(probes)
        self._begin_ns = clock.now_ns()
        self._frames = 0
        self._heard: set[int] = set()
        """Identifiers of all frames received."""
        self._worst = BusState.ERROR_ACTIVE
        self._credit_s = 0.0
        self._taken_ns = 0
        """When the bus last took a frame [ns], or the asking began."""
        self._is_stuck = False
        self._obedient: dict[tuple[str, int], list[tuple[Probe, Collection[int]]]] = {}
        self._awaited: dict[int, tuple[str, int]] = {}
        """Protocol and deadline [ns] of each pending answer, by its identifier."""
        self._classic_errors = 0
        """Error frames before that."""
        self._is_fd = False
        """Whether the questions of CAN FD are due, the last."""

    def run(self, *, only_listen: bool = False) -> ScanReport:
        """Scan, and return what was found.

        Parameters
        ----------
        only_listen
            Whether a controller is known to run.
        """
        self._wait(self._begin_ns + LISTEN_NS)
        heard_nothing = not self._frames and self._errors > 0
        if not (only_listen or self._is_driven() or heard_nothing):
            self._ask()
        return self._report(only_listen=only_listen, heard_nothing=heard_nothing)

    def _wait(self, end_ns: int) -> None:
        """Take what comes up to a time [ns]."""
        while self._clock.now_ns() < end_ns:
            self._poll()

    def _poll(self) -> int:
        """Let a little time pass, and take what came in it; return the present time [ns]."""
        self._clock.sleep_until(self._clock.now_ns() + POLL_NS)
        for frame in self._port.receive():
            self._frames += 1
            self._heard.add(frame.arbitration_id)
            for probe in self._probes:
                probe.take(frame)
        state = self._port.status().state
        if _WORSE.index(state) > _WORSE.index(self._worst):
            self._worst = state
        return self._clock.now_ns()

    @property
    def _errors(self) -> int:
        return self._port.status().error_frames

    def _is_driven(self) -> bool:
        return any(probe.command_heard for probe in self._probes)

    # Questions ----------------------------------------------------------------------------------

    def _ask(self) -> None:
        """Ask until no question is left that may be asked, or the bus is out of order."""
        now_ns = self._taken_ns = self._clock.now_ns()
        while not self._is_driven():
            if self._worst in _BROKEN:
                self._wait(now_ns + ANSWER_NS)  # a frame that is destroyed leads on to bus-off
                return
            if not self._send(now_ns) and not any(p.is_waiting(now_ns) for p in self._probes):
                if self._is_fd or not self._config.data_bitrate:
                    return
                # Last, since a device that knows no CAN FD destroys them.
                self._is_fd = True
                self._classic_errors = self._errors
            if now_ns - self._taken_ns > _STUCK_NS and self._is_stuck:
                return
            before_ns, now_ns = now_ns, self._poll()
            earned_s = SHARE * (now_ns - before_ns) * 1e-9
            self._credit_s = min(self._credit_s, 0.0) + earned_s

    def _send(self, now_ns: int) -> bool:
        """Send what may be sent now; return whether there was something."""
        wanted: dict[tuple[int, bytes], list[tuple[Probe, Question]]] = {}
        for probe in self._probes:
            for question in probe.questions(now_ns):
                if bool(question.arbitration_id & FD_FLAG) == self._is_fd:
                    frame = question.arbitration_id, question.data
                    wanted.setdefault(frame, []).append((probe, question))
        sent: set[tuple[int, int]] = set()
        there_is_one = False
        for frame, askers in wanted.items():
            probe, question = askers[0]
            if (id(probe), question.number) in sent or self._harms(probe, question, now_ns):
                continue
            there_is_one = True
            if self._credit_s < 0.0:
                break
            self._is_stuck = not self._port.send(*frame)
            if self._is_stuck:
                break
            self._taken_ns = now_ns
            self._credit_s -= worst_case_bits(frame[0], len(frame[1])).seconds(self._config)
            self._awaited[question.answer_id] = (probe.protocol, now_ns + ANSWER_NS)
            for each, same in askers:
                each.on_sent(same, now_ns)
                sent.add((id(each), same.number))
        return there_is_one

    def _harms(self, probe: Probe, question: Question, now_ns: int) -> bool:
        """Return whether a device may be there for which question or answer is a command.

        True, too, where somebody else sends frames with its identifier, which would destroy each
        other, and while an answer of another protocol with one of its identifiers may come.
        """
        if question.arbitration_id in self._heard:
            return True
        for identifier in (question.arbitration_id, question.answer_id):
            protocol, until_ns = self._awaited.get(identifier, (probe.protocol, 0))
            if protocol != probe.protocol and now_ns < until_ns:
                return True
        return any(
            not all(other.is_absent(number, now_ns) for number in numbers)
            for identifier in (question.arbitration_id, question.answer_id)
            for other, numbers in self._obedient_to(probe.protocol, identifier)
        )

    def _obedient_to(self, protocol: str, identifier: int) -> list[tuple[Probe, Collection[int]]]:
        """Return the devices of other protocols for which an identifier is a command."""
        known = self._obedient.get((protocol, identifier))
        if known is None:
            others = (each for each in self._probes if each.protocol != protocol)
            each_numbers = ((each, each.obeyed_by(identifier)) for each in others)
            known = [(each, numbers) for each, numbers in each_numbers if numbers]
            self._obedient[protocol, identifier] = known
        return known

    # Result -------------------------------------------------------------------------------------

    def _report(self, *, only_listen: bool, heard_nothing: bool) -> ScanReport:
        now_ns = self._clock.now_ns()
        found = tuple(each for probe in self._probes for each in probe.found())
        verdict, text, fix = self._judge(found, only_listen=only_listen, noise=heard_nothing)
        not_asked = () if verdict is not Verdict.FOUND else self._not_asked(now_ns)
        return ScanReport(
            verdict,
            text,
            fix,
            found,
            not_asked,
            (now_ns - self._begin_ns) * 1e-6,
            self._frames,
            self._errors,
        )

    def _not_asked(self, now_ns: int) -> tuple[str, ...]:
        """Return which devices have questions left, by protocol."""
        return tuple(
            f"{probe.protocol} {number}"
            for probe in self._probes
            for number in sorted({each.number for each in probe.questions(now_ns)} & probe.heard)
        )

    def _judge(
        self, found: tuple[Found, ...], *, only_listen: bool, noise: bool
    ) -> tuple[Verdict, str, str]:
        commands = [probe.command_heard for probe in self._probes if probe.command_heard]
        if only_listen or commands:
            what = f" ({commands[0]})" if commands else ""
            text = f"a controller is running{what}: only listened, asked nothing"
            return Verdict.DRIVEN, text, "end it to have all devices asked"
        if self._is_stuck:
            return self._of_no_gap()
        clashes = [each for each in found if each.clash]
        if clashes:
            names = "; ".join(f"{each.protocol} {each.number}: {each.clash}" for each in clashes)
            fix = "leave one of the two on the bus and give it another number"
            return Verdict.CLASH, names, fix
        if noise:
            return Verdict.WRONG_BITRATE, *self._noise()
        if self._is_fd and self._errors - self._classic_errors >= _MANY_ERRORS:
            text = "frames of CAN FD are destroyed: a device on the bus knows classic CAN only"
            fix = "give such devices a bus of their own, without data_bitrate"
            return Verdict.CLASSIC, text, fix
        if self._worst in _BROKEN:
            return self._of_state()
        if self._frames:
            return self._of_frames(found)
        text = "nobody answers, though own frames are not refused: no drive that is known"
        fix = "check that the drives have power, and that their CAN interface is on"
        return Verdict.SILENT, text, fix

    def _of_no_gap(self) -> tuple[Verdict, str, str]:
        """Judge a bus that takes no more of our frames."""
        if not self._frames:
            text = "no own frame gets onto the bus: something holds it dominant, as a short circuit"
            return Verdict.BLOCKED, text, _WIRING
        text = f"own frames find no gap between those of the devices ({self._frames} heard)"
        return Verdict.FULL, text, "have them send less often, or raise the bit rate"

    def _of_frames(self, found: tuple[Found, ...]) -> tuple[Verdict, str, str]:
        """Judge a bus on which there are frames."""
        if not found:
            ids = ", ".join(f"0x{each & 0x1FFF_FFFF:X}" for each in sorted(self._heard)[:8])
            text = f"frames come ({ids}), but of no protocol that robotctl knows"
            return Verdict.UNKNOWN, text, "see the README for the drives that it knows"
        errors = self._errors
        if not errors:
            return Verdict.FOUND, "", ""
        return Verdict.FOUND, f"{errors} error frames meanwhile", _WIRING

    def _noise(self) -> tuple[str, str]:
        text = (
            f"{self._errors} error frames and not one good frame: the devices have another bit "
            f"rate than {self._config.bitrate}, or the line is disturbed"
        )
        return text, f"set the drives' bit rate ({bring_up(self._config)}), or {_WIRING}"

    def _of_state(self) -> tuple[Verdict, str, str]:
        """Judge a bus by the state to which our controller has come."""
        rate, heard = self._config.bitrate, self._frames
        match self._worst:
            case BusState.DOWN:
                return Verdict.DOWN, "the interface is down", bring_up(self._config)
            case BusState.BUS_OFF:
                text = (
                    "own frames are destroyed until the controller leaves the bus: another bit "
                    f"rate than {rate}, a short circuit, or no terminator"
                )
                return Verdict.DESTROYED, text, f"compare bit rates, and {_WIRING}"
            case _:
                text = (
                    f"nobody acknowledges own frames, though {counted(heard, 'frame')} came: the "
                    "adapter's transmitter, or a bus without terminator"
                    if heard
                    else "nobody acknowledges own frames: this computer is alone on the bus, or "
                    "the bus has no terminator"
                )
                return Verdict.ALONE, text, _WIRING
