"""Detects unauthorised motion from outside: from the wire and the true robot.

The monitor knows nothing of the drive's own guards and states, and nothing of the host. Frames that
forbid power count once they have passed the bus; frames that allow it only once delivered to the
drive's controller, from any sender. It looks at the bridges and the body of the true robot. Unsafe
motions:

- power at the wheels later than the drive's time-out after the last command that allowed it. A
  command allows power if it is sound, new, and says "enable", and forbids it with a "no" if it is
  sound, new or not; after an emergency stop it allows only once the drive's latch has been cleared,
  over the bus or by the loss of its supply, and a command has said "no"; after a "no" only once the
  robot was armed again, if armings are reported;
- steering that moves while the wheels may have no power: it should stay;
- more speed than the robot is allowed, in whatever direction.

Power is torque-making voltage: a bridge that drives with a duty that is not zero. The time-out is
allowed after a "no" and an emergency stop as well, since the drive may have missed that frame.
"""

from __future__ import annotations

import enum
import math
from collections import deque
from collections.abc import Callable
from typing import Final, NamedTuple

import msgspec

from firmware_sim.bus.frame import REMOTE_FLAG, Frame
from firmware_sim.nodes import wire
from firmware_sim.nodes.e2e import COUNTER_INVALID, data_id_crc, frame_crc

PERIOD_NS: Final = 5_000_000
"""Interval between two checks of the robot [ns]."""

TIMEOUT_MARGIN_NS: Final = 10_000_000
"""Extra time-out for a drive with the slowest allowed clock [ns]."""

GRACE_NS: Final = 6_000_000
"""Grace period [ns]: the drive acts each millisecond, and the monitor checks each fifth."""

OVERSPEED: Final = 1.3
"""Multiple of the allowed speed that counts as unsafe; leaves room for overshoot and slip."""

SIDEWAYS_M_S: Final = 0.05
"""Lateral speed worth a mention [m/s]; less comes from slipping tyres."""

STEERED_RAD: Final = 0.05
"""Motion allowed to held steering while its servo settles [rad]."""

KEPT: Final = 100
"""Maximum findings kept; all are counted."""

FORBIDS: Final = (0x001, 0x001 | REMOTE_FLAG)
"""Identifiers of the emergency stop, which the monitor reads on the bus."""

_SDO_TO_DRIVE: Final = 0x601
_CLEAR_FAULTS: Final = bytes((0x2F, 0x10, 0x20, 0x00, 0x01))
_ENABLE: Final = 0x10


class Motion(msgspec.Struct, frozen=True, gc=False):
    """The true robot at one moment."""

    powered: bool
    v_m_s: float
    vy_m_s: float
    omega_rad_s: float
    steering_rad: float


class Allowed(NamedTuple):
    """Limits of the robot.

    `power_ns` is the time after a command that allows power for which wheels may have it [ns].
    """

    v_max_m_s: float
    omega_max_rad_s: float
    power_ns: int


class Kind(enum.Enum):
    """Kinds of unsafe motion."""

    POWER = enum.auto()
    STEERING = enum.auto()
    SPEED = enum.auto()
    TURN_RATE = enum.auto()


class Since(enum.Enum):
    """End of the permission to have power, in words that follow "behind"."""

    NOTHING = ""
    LAST_COMMAND = "the last command"
    ENABLE_0 = "Enable=0"
    EMERGENCY_STOP = "an emergency stop"
    NOT_ARMED = "a stop, without a new arming"

    def __str__(self) -> str:
        """Return the words."""
        return self.value


_LAST_COMMAND: Final = Since.LAST_COMMAND
"""Looking up a member of an enumeration is slow."""


class Unsafe(NamedTuple):
    """One unauthorised motion: start, kind, reason, and all that in words."""

    stamp_ns: int
    kind: Kind
    since: Since
    reason: str


class _Objection(NamedTuple):
    """A present objection: kind and size."""

    kind: Kind
    reason: str


class SafetyMonitor:
    """Judges a robot each 5 ms of simulated time.

    Parameters
    ----------
    look
        Returns the true robot at the present time.
    allowed
        Limits of the robot.
    """

    def __init__(self, look: Callable[[], Motion], allowed: Allowed) -> None:
        self.count = 0
        """Unsafe motions so far; a lasting one counts once for each kind of reason."""
        self.findings: deque[Unsafe] = deque(maxlen=KEPT)
        self.power_off_ns = 0
        """Time at which the wheels last lost their power [ns]."""
        self._powered = False
        self._look = look
        self._allowed = allowed
        self._crc_start = data_id_crc(wire.data_id(wire.MOTOR_COMMAND))
        self._counter = -1
        self._allowed_ns: int | None = None
        self._since = Since.NOTHING
        self._held_rad: float | None = None
        """Steering angle when the wheels lost their permission."""
        self._said_yes = False
        self._cleared = self._said_no = True
        self._now_ns = 0
        self._armings: dict[int, int] | None = None
        """Time of each reported arming, by number [ns]; None: armings are not reported."""
        self._present: Kind | None = None

    def on_arming(self, number: int) -> None:
        """Note a deliberate arming, by a number of its own."""
        self._armings = (self._armings or {}) | {number: self._now_ns}

    def on_refusal(self, number: int) -> None:
        """Note that the robot refused an arming, which then does not allow driving."""
        if self._armings is not None:
            self._armings.pop(number, None)

    def on_bus(self, frame: Frame) -> None:
        """Process a frame that has passed the bus, whoever received it."""
        if frame.arbitration_id in FORBIDS:
            self._cleared = self._said_no = False
            self._since = Since.EMERGENCY_STOP

    def on_delivery(self, frame: Frame) -> None:
        """Process a frame that was delivered to the drive's controller."""
        arbitration_id, data, stamp_ns = frame
        if arbitration_id == wire.MOTOR_COMMAND:
            self._on_command(data, stamp_ns)
        elif arbitration_id == _SDO_TO_DRIVE and data.startswith(_CLEAR_FAULTS):
            self._cleared = True

    def on_foreign_frame(self, stamp_ns: int) -> None:
        """Note a frame of the host for a drive that is not ours, whatever it says [ns].

        Its protocol is not read here, so only power that outlasts the host's silence is found.
        """
        self._allowed_ns, self._since = stamp_ns, Since.LAST_COMMAND

    def on_power_up(self) -> None:
        """Note a restart of the drive, which clears its latches."""
        self._cleared = True

    def _on_command(self, data: bytes, stamp_ns: int) -> None:
        """Take a command that is sound; one that is not new allows nothing."""
        if len(data) != 8 or frame_crc(data, self._crc_start) != data[0]:
            return
        counter = data[1] & 0x0F
        new = counter not in (COUNTER_INVALID, self._counter)
        if counter != COUNTER_INVALID:
            self._counter = counter
        if not data[1] & _ENABLE:
            self._said_no = self._said_no or self._cleared
            if self._said_yes and self._armings is not None:
                # A frame delivered now may have waited since before the last arming.
                since_ns = stamp_ns - self._allowed.power_ns
                self._armings = {n: ns for n, ns in self._armings.items() if ns > since_ns}
            self._said_yes, self._since = False, Since.ENABLE_0
            return
        if not new:
            return
        self._said_yes = True
        if not (self._cleared and self._said_no):
            self._since = Since.EMERGENCY_STOP
        elif self._armings is not None and not self._armings:
            self._since = Since.NOT_ARMED
        else:
            self._allowed_ns, self._since = stamp_ns, _LAST_COMMAND

    def look(self, now_ns: int) -> None:
        """Judge the robot at the present time [ns]."""
        self._now_ns = now_ns
        motion = self._look()
        if self._powered and not motion.powered:
            self.power_off_ns = now_ns
        self._powered = motion.powered
        objection = self._objection(motion, now_ns)
        kind = None if objection is None else objection.kind
        if objection is not None and kind != self._present:
            self.count += 1
            self.findings.append(Unsafe(now_ns, objection.kind, self._since, objection.reason))
        self._present = kind

    def _objection(self, motion: Motion, now_ns: int) -> _Objection | None:
        """Return the present objections to the robot, the worst first."""
        allowed, omega_rad_s = self._allowed, motion.omega_rad_s
        forbidden = self._objection_to_power(now_ns)
        if forbidden and motion.powered:
            return _Objection(Kind.POWER, forbidden)
        if not forbidden:
            self._held_rad = None
        elif self._held_rad is None:
            self._held_rad = motion.steering_rad
        elif abs(moved_rad := motion.steering_rad - self._held_rad) > STEERED_RAD:
            return _Objection(Kind.STEERING, f"steering moved by {moved_rad:.2f} rad in a stop")
        if math.hypot(motion.v_m_s, motion.vy_m_s) > OVERSPEED * allowed.v_max_m_s:
            speed = f"speed {motion.v_m_s:.2f} m/s"
            if abs(motion.vy_m_s) > SIDEWAYS_M_S:
                speed += f" and {motion.vy_m_s:.2f} m/s to the left"
            return _Objection(Kind.SPEED, f"{speed}, allowed {allowed.v_max_m_s:g}")
        if abs(omega_rad_s) > OVERSPEED * allowed.omega_max_rad_s:
            reason = f"turn rate {omega_rad_s:.2f} rad/s, allowed {allowed.omega_max_rad_s:g}"
            return _Objection(Kind.TURN_RATE, reason)
        return None

    def _objection_to_power(self, now_ns: int) -> str:
        """Return why the wheels should have no power; empty if they may."""
        if self._allowed_ns is None:
            if self._since is Since.NOTHING:
                return "power without any command"
            return f"power that was never allowed, behind {self._since}"
        after_ns = now_ns - self._allowed_ns
        if after_ns <= self._allowed.power_ns + GRACE_NS:
            return ""
        return f"power {after_ns / 1e6:.0f} ms after it was last allowed, behind {self._since}"
