"""The control core's state for other processes: what it has measured, with what it wants."""

from __future__ import annotations

import math
from typing import Any, Final

from robotctl.control.wheels import WheelControl
from robotctl.core.motion import EncoderMotion
from robotctl.messages.control import ControlState
from robotctl.messages.faults import FaultCode
from robotctl.model.drives.drives import Drive
from robotctl.model.geometry.twist import Twist
from robotctl.safety.health import Health
from robotctl.safety.state_machine import SafetyMachine

_UNKNOWN_TWIST: Final = Twist(math.nan, math.nan, math.nan)


def control_state(
    machine: SafetyMachine,
    health: Health,
    motion: EncoderMotion,
    wheels: tuple[WheelControl, ...],
    drive: Drive,
    now_ns: int,
    **core: Any,
) -> ControlState:
    """Return the state; it is made in each tick, so at once.

    Parameters
    ----------
    machine, health, motion
        Of the core.
    wheels, drive
        The loops of the driven wheels, and the kinematics.
    now_ns
        The time [ns]: inputs that are too old by then are unknown.
    core
        Fields of what the core wants and answers.
    """
    pose, n = motion.pose_odom_base, len(wheels)
    reports = health.reports[:n] if health.reports_fresh(now_ns) else ()
    supplies_v = [drive.supply_v(now_ns) for drive in health.drives]
    measured = health.wheels_fresh(now_ns)
    twist = motion.twist if measured else _UNKNOWN_TWIST
    fault = machine.fault
    return ControlState(
        stamp_ns=now_ns,
        state=machine.state,
        reason=machine.reason,
        x_m=pose.x_m,
        y_m=pose.y_m,
        theta_rad=pose.theta_rad,
        v_m_s=twist.v_m_s,
        omega_rad_s=twist.omega_rad_s,
        vy_m_s=twist.vy_m_s,
        distance_m=motion.odometry.distance_m,
        wheel_rad_s=motion.speeds_rad_s if measured else (math.nan,) * n,
        wheel_ref_rad_s=tuple(w.reference_rad_s for w in wheels),
        wheel_distance_m=tuple(
            w.estimator.position_rad * radius_m
            for w, radius_m in zip(wheels, drive.wheel_radii_m, strict=True)
        ),
        current_a=tuple([_number(report.current_a) for report in reports]),
        temperature_c=tuple([_number(report.temperature_c) for report in reports]),
        steering_rad=motion.joints_rad[0] if motion.joints_rad else 0.0,
        bus_voltage_v=_number(next((v for v in supplies_v if v is not None), None)),
        battery=health.fresh_battery(now_ns),
        sonar_m=health.sonars.fresh_m(now_ns),
        sonar_stamp_ns=tuple(max(stamp_ns, 0) for stamp_ns in health.sonars.stamps_ns),
        nodes=health.nodes.nodes,
        bus=health.bus,
        fault=fault.code if fault else FaultCode.NONE,
        fault_part=fault.part if fault else "",
        odom_epoch_ns=motion.epoch_ns,
        imu=motion.imu if health.is_fresh("gyro", now_ns) else None,
        **core,
    )


def _number(value: float | None) -> float:
    """Return a value, nan for one that is not told."""
    return math.nan if value is None else value
