"""Warm-up: the whole path from rest through driving to a stop, before the real loop starts.

The interpreter specialises code as it runs, memory is mapped when it is first touched and caches
fill: the first ticks of any path take several times as long as the later ones. The rehearsal runs
a core of the same configuration, which is thrown away, so that the real one finds all of it warm.
"""

from __future__ import annotations

from typing import Final

from robotctl.core.control_core import ControlCore, Inputs
from robotctl.messages.actuators import ActuatorFeedback, DriveState
from robotctl.messages.control import (
    AccelerometerFeedback,
    Arm,
    BatteryFeedback,
    EmergencyStop,
    EmergencyStopSource,
    Feedback,
    GyroFeedback,
    LoopStatistics,
    NodeStatus,
    SafetyState,
    SonarFeedback,
    VelocityCommand,
)
from robotctl.safety.state_machine import POWERED

TICKS: Final = 200
"""Ticks of driving; the interpreter specialises a function after a few calls, a loop after tens."""

_BUS_V: Final = 12.0


def rehearse(core: ControlCore, period_ns: int) -> bool:
    """Drive a throw-away core on made-up inputs; return whether it armed.

    Parameters
    ----------
    core
        Newly made; useless afterwards.
    period_ns
        Control period [ns].
    """
    now_ns = 1_000_000_000
    armed = False
    while core.machine.state is not SafetyState.STANDBY or not core.warm:
        now_ns += period_ns
        core.step(Inputs(_feedback(core, now_ns, enabled=False)), now_ns)
    for tick in range(TICKS):
        now_ns += period_ns
        enabled = core.machine.state in POWERED
        armed = armed or enabled
        velocity = VelocityCommand(now_ns, now_ns + period_ns, 1e-3, 1e-3)
        ask = (Arm(now_ns, 1, arm=True),) if tick == 0 else ()
        core.step(Inputs(_feedback(core, now_ns, enabled=enabled), (velocity, *ask)), now_ns)
        core.snapshot(now_ns, LoopStatistics())
    core.step(
        Inputs(
            _feedback(core, now_ns + period_ns, enabled=True),
            (EmergencyStop(now_ns, EmergencyStopSource.TEST),),
        ),
        now_ns + period_ns,
    )
    return armed


def _feedback(core: ControlCore, now_ns: int, *, enabled: bool) -> Feedback:
    """Return the feedback of a healthy robot at rest."""
    report = ActuatorFeedback(
        motion_ns=now_ns,
        latch_us=now_ns // 1000 & 0xFFFFF,
        speed_rad_s=0.0,
        angle_rad=0.0,
        report_ns=now_ns,
        state=DriveState.ENABLED if enabled else DriveState.READY,
        current_a=0.0,
        temperature_c=25.0,
        supply_ns=now_ns,
        voltage_v=_BUS_V,
        command_age_ms=0,
    )
    return Feedback(
        actuators=(report,) * len(core.actuators),
        sonars=tuple(SonarFeedback(now_ns, first, (1.0,) * 4) for first in range(0, 16, 4)),
        battery=BatteryFeedback(now_ns, _BUS_V, 0.0, 1.0, 25.0, low=False, critical=False),
        gyro=GyroFeedback(now_ns, 0.0, 0.0, 1e-3 * (now_ns % 7)),
        accelerometer=AccelerometerFeedback(now_ns, 0.0, 0.0, 9.8 + 1e-3 * (now_ns % 7)),
        nodes=(NodeStatus(1, "drive", 5, now_ns, 1, ""),),
    )
