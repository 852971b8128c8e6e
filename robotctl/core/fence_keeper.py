"""The fence in the path of every velocity command, whatever mode it comes from."""

from __future__ import annotations

from typing import Final

from robotctl.control.limiter import LimitsConfig
from robotctl.messages.control import ControlState
from robotctl.messages.fence import EnableFence, FenceRequest, FenceState, SetFence
from robotctl.model.fence import Fence
from robotctl.model.footprint import Footprint
from robotctl.model.geometry.se2 import SE2
from robotctl.model.geometry.twist import Twist
from robotctl.safety.fence.fence_guard import FenceGuard
from robotctl.safety.fence.prediction import MotionNow

LATENCY_NS: Final = 20_000_000
"""Delay from a step of navigation until control follows its command [ns]."""
_CLEAR_NS: Final = 1_000_000_000
"""Time after being held back within which no new notice is given [ns]."""
_STANDS: Final = Twist(0.0, 0.0)
LOST: Final = "fence: the robot does not know where it is, and stands"
DAMAGED: Final = (
    "fence: its file cannot be read; the robot stands until a fence is uploaded or cleared"
)


class FenceKeeper:
    """Keeps the robot's body within its fence.

    Parameters
    ----------
    limits
        Of the set-point limiter.
    body
        Of the robot.
    period_ns, life_ns
        Of navigation's steps, and after which a command expires [ns].
    steered
        Whether the robot steers.

    Attributes
    ----------
    fence
        The present one.
    state
        How it is kept.
    is_damaged
        Whether there is a fence that cannot be read: until the next one is taken, the robot stands.
    message
        Why the robot is held back now; empty: it is not.
    """

    def __init__(
        self, limits: LimitsConfig, body: Footprint, period_ns: int, life_ns: int, *, steered: bool
    ) -> None:
        # A command is followed until the next one, or its end, has reached control.
        self._period_s = (period_ns + LATENCY_NS) * 1e-9
        self._life_s = (life_ns + LATENCY_NS) * 1e-9
        self._steered = steered
        self.retune(limits, body)
        self.fence = Fence()
        self.state = FenceState()
        self.is_damaged = False
        self.message = ""
        self._before = _STANDS
        """The last command."""
        self._control: ControlState | None = None
        self._acceleration = _STANDS
        self._said: dict[str, int] = {}
        """When each kind of notice was last true [ns]."""
        self._notices: list[str] = []

    def retune(self, limits: LimitsConfig, body: Footprint) -> None:
        """Take other limits, and the body in another state."""
        self._guard = FenceGuard(limits, body, self._period_s, self._life_s, steered=self._steered)
        self._limits = limits

    @property
    def planned(self) -> Fence:
        """Fence that planning keeps to: none while it is disabled."""
        return self.fence if self.state.enabled else Fence()

    def take(self, request: FenceRequest) -> None:
        """Take another fence, or switch it."""
        state = self.state
        if isinstance(request, SetFence):
            self.is_damaged = False
            self.fence = request.fence
            self.state = FenceState(
                crc=request.crc, enabled=not request.fence.is_empty, breaches=state.breaches
            )
            self._notices.append("fence: none any more" if request.fence.is_empty else "fence: set")
        elif isinstance(request, EnableFence) and state.crc:
            self.state = FenceState(crc=state.crc, enabled=request.enabled, breaches=state.breaches)
            self._notices.append(f"fence: {'enabled' if request.enabled else 'disabled'}")

    def keep(self, control: ControlState, pose: SE2 | None, wanted: Twist, now_ns: int) -> Twist:
        """Return what of a velocity keeps to the fence.

        Parameters
        ----------
        control
            The newest state of control.
        pose
            `base` in `world` at its time; None: it is not known for sure.
        """
        self._note_acceleration(control)
        self.message = ""
        if self.is_damaged:
            twist = _STANDS
            self._explain(DAMAGED, now_ns)
        elif not self.state.enabled:
            twist = wanted
        elif pose is None:
            twist = _STANDS
            self._tell(limits=wanted != twist, breached=self.state.breached, now_ns=now_ns)
            self._explain(LOST, now_ns)
        else:
            twist = self._hold(control, pose, wanted, now_ns)
        self._before = twist
        return twist

    def take_notices(self) -> list[str]:
        """Return sentences for people since the last call."""
        notices, self._notices = self._notices, []
        return notices

    def _hold(self, control: ControlState, pose: SE2, wanted: Twist, now_ns: int) -> Twist:
        """Return what of a velocity keeps to the fence, and say what it does."""
        lag_s = (max(now_ns - control.stamp_ns, 0) + LATENCY_NS) * 1e-9
        now = MotionNow(pose, _faster(control), self._acceleration, self._before, lag_s)
        held = self._guard.hold(self.fence, now, wanted)
        breached = held.clearance_m < 0.0
        self._tell(limits=held.limits, breached=breached, now_ns=now_ns)
        if breached:
            self._explain("fence: the robot is beyond it; only motions back are followed", now_ns)
        elif held.limits and held.twist.v_m_s == 0.0:
            self._explain("fence: the robot stops before it; drive it away from there", now_ns)
        elif held.limits:
            self._explain("fence: near, the robot slows down", now_ns)
        return held.twist

    def _tell(self, *, limits: bool, breached: bool, now_ns: int) -> None:
        """Note how the fence is kept."""
        before = self.state
        begins = breached and not before.breached
        self.state = FenceState(
            crc=before.crc,
            enabled=True,
            limits=limits,
            breached=breached,
            breaches=before.breaches + begins,
            breached_ns=now_ns if begins else before.breached_ns,
        )

    def _explain(self, message: str, now_ns: int) -> None:
        """Say why the robot is held back, once until it has been free for a while."""
        self.message = message
        if now_ns - self._said.get(message, -_CLEAR_NS) >= _CLEAR_NS:
            self._notices.append(message)
        self._said[message] = now_ns

    def _note_acceleration(self, control: ControlState) -> None:
        """Find the acceleration between two states of control."""
        before, self._control = self._control, control
        if before is None or control.stamp_ns == before.stamp_ns:
            return
        dt_s = (control.stamp_ns - before.stamp_ns) * 1e-9
        limits = self._limits
        bounds = limits.a_max_m_s2, limits.alpha_max_rad_s2, limits.a_max_m_s2
        changes = zip(control.twist_ref, before.twist_ref, bounds, strict=True)
        self._acceleration = Twist(
            *(min(max((now - then) / dt_s, -most), most) for now, then, most in changes)
        )


def _faster(control: ControlState) -> Twist:
    """Return the greater of set-point and measured velocity: wheels lag behind as they brake."""
    both = zip(control.twist_ref, control.twist, strict=True)
    return Twist(*(measured if abs(measured) > abs(ref) else ref for ref, measured in both))
