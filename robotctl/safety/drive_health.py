"""One motor drive as control sees it: the age of its reports, its faults, whether it obeys."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from robotctl.messages.actuators import NEVER_NS, ActuatorFeedback, DriveState
from robotctl.messages.faults import Fault, FaultCode
from robotctl.safety.ages import AgeLimit, are_fresh, span_ns

ACTUATOR_AGES: Final = ("motion", "report", "supply")
"""Fields of `AgeLimit` that a drive's actuators share."""

LATCHED: Final = frozenset({DriveState.STOPPED, DriveState.FAULT, DriveState.EMERGENCY_STOP})

_UNHEARD_NS: Final = 100_000_000
"""Time for which lost commands explain the wheels' motion [ns]: monitors use windows of 50 ms."""

_ENABLE_NS: Final = 100_000_000
"""Time for the drive to report enabled after arming: three commands and a status take 50 ms at 100
Hz; the rest allows for lost frames."""

_GAP_NS: Final = 100_000_000
"""A silence that is longer may leave old frames in the drive's queue [ns]."""

_LATE_NS: Final = 50_000_000
"""Time behind it in which those come, and say what was [ns]."""

_NOTHING: Final = ActuatorFeedback()
_ENABLED: Final = DriveState.ENABLED
"""Looking up a member of an enumeration is slow."""


class DriveHealth:
    """Keeps the newest reports of a drive and judges them.

    Parameters
    ----------
    name
        Its name, the `part` of its faults.
    wheels, joints
        Which of the robot's actuators are its wheels, and its joints.
    ages
        Maximum ages of what it tells, by `ACTUATOR_AGES`: "motion" of its wheels, "report" and
        "supply" of all.
    """

    def __init__(
        self,
        name: str,
        wheels: tuple[int, ...],
        joints: tuple[int, ...],
        ages: Mapping[str, AgeLimit],
    ) -> None:
        self.name = name
        self.reports: tuple[ActuatorFeedback, ...] = (_NOTHING,) * (len(wheels) + len(joints))
        """The newest of wheels and joints."""
        self._wheels = wheels
        self._all = wheels + joints
        self._motion, self._report, self._supply = (ages.get(field) for field in ACTUATOR_AGES)
        self._latches_us = [-1] * len(wheels)
        self._motions_ns = [NEVER_NS] * len(wheels)
        self._lost_ns = self._motion.limit_ns if self._motion is not None else 0
        """A command that is older is lost [ns]."""
        self._told_ns: tuple[list[int], list[int]] | None = None
        """Times of all reports and of all supplies [ns]."""
        self._note_ages()
        self._idle_ns = -NEVER_NS
        """When the drive was last enabled, or not commanded to be [ns]."""
        self._back_ns = NEVER_NS
        """End of the last `_GAP_NS` in which nothing came of it [ns]."""
        self._loss = _NOTHING
        """The last report that told of an old newest command."""

    def update(self, actuators: tuple[ActuatorFeedback, ...]) -> None:
        """Take the newest reports of all actuators of the robot."""
        self.reports = reports = tuple([actuators[index] for index in self._all])
        latches_us, motions_ns = self._latches_us, self._motions_ns
        # Joints, which follow the wheels, have no place in these lists.
        for place, (report, before_us) in enumerate(zip(reports, latches_us, strict=False)):
            latch_us = report.latch_us
            # The same latch again is no new measurement, however recent its frame.
            if latch_us < 0 or latch_us != before_us:
                latches_us[place] = latch_us
                motions_ns[place] = report.motion_ns
        before_ns = self._newest_ns
        self._note_ages()
        if self._newest_ns - before_ns > _GAP_NS and before_ns != NEVER_NS:
            self._back_ns = self._newest_ns
        for report in reports:
            if report.state is _ENABLED:
                self._idle_ns = report.report_ns
            if self._tells_loss(report):
                self._loss = report

    def _note_ages(self) -> None:
        """Note the oldest and newest of each kind of report."""
        reports = self.reports
        self._motion_span = span_ns(self._motions_ns)
        reports_ns = [report.report_ns for report in reports]
        supplies_ns = [report.supply_ns for report in reports]
        if (reports_ns, supplies_ns) != self._told_ns:  # most ticks bring motions alone
            self._told_ns = reports_ns, supplies_ns
            self._report_span, self._supply_span = span_ns(reports_ns), span_ns(supplies_ns)
        self._newest_ns = max(self._motion_span[1], self._report_span[1])

    def armed(self, now_ns: int) -> None:
        """Take note that the robot is armed: from now on the drive is to be enabled."""
        self._idle_ns = now_ns

    def moves_fresh(self, now_ns: int) -> bool:
        """Return whether the motion of all its wheels is not too old."""
        return _are_fresh(self._motion_span, now_ns, self._motion)

    def reports_fresh(self, now_ns: int) -> bool:
        """Return whether its reports of state, current and temperature are not too old."""
        return _are_fresh(self._report_span, now_ns, self._report)

    def supply_v(self, now_ns: int) -> float | None:
        """Return its supply [V]; None if that is too old, or not told."""
        fresh = _are_fresh(self._supply_span, now_ns, self._supply)
        return self.reports[0].voltage_v if fresh else None

    def faults(self, now_ns: int) -> list[Fault]:
        """Return all reasons to stop, the most telling first."""
        faults = []
        if self._motion is not None and not self.moves_fresh(now_ns):
            faults.append(self._motion.fault())
        if self._report is not None and not self.reports_fresh(now_ns):
            faults.append(self._report.fault())
        else:
            faults += [report.fault for report in self.reports if report.fault is not None][:1]
        supply = self._supply
        if supply is not None and not _are_fresh(self._supply_span, now_ns, supply):
            faults.append(supply.fault())
        return faults

    def disobeys(self) -> Fault | None:
        """Return a fault if the drive has not been enabled for too long since it should be."""
        for report in self.reports:
            if report.report_ns - self._idle_ns > _ENABLE_NS:
                state = report.state.name.lower().replace("_", " ")
                stays = f"the motor controller stays in {state} although commanded to drive"
                return Fault(FaultCode.DRIVE_NOT_ENABLED, stays, self.name)
        return None

    def command_loss(self, now_ns: int) -> Fault | None:
        """Return a fault if the drive has told within a while that no command reached it."""
        if now_ns - self._loss.supply_ns > _UNHEARD_NS:
            return None
        return self._lost()

    def loses_commands(self, now_ns: int) -> Fault | None:
        """Return a fault if its present report tells so."""
        if not any(map(self._tells_loss, self.reports)):
            return None
        return self._lost() if _are_fresh(self._supply_span, now_ns, self._supply) else None

    def _tells_loss(self, report: ActuatorFeedback) -> bool:
        """Return whether a report tells of an old newest command."""
        age_ms = report.command_age_ms
        return age_ms is not None and age_ms * 1_000_000 > self._lost_ns

    def _lost(self) -> Fault:
        """Say how long the drive received nothing."""
        text = f"the motor controller had no valid command for {self._loss.command_age_ms} ms"
        return Fault(FaultCode.COMMAND_LOSS, text, self.name)

    @property
    def latched(self) -> bool:
        """Whether the drive waits for its faults to be cleared."""
        return any(report.state in LATCHED for report in self.reports)

    @property
    def enabled_ns(self) -> int | None:
        """When it reported that it gives power [ns]; None: its newest report says it does not.

        None also right behind a silence, whose reports may be old.
        """
        late_ns = self._back_ns + _LATE_NS
        stamps = [
            each.report_ns
            for each in self.reports
            if each.state is _ENABLED and each.report_ns > late_ns
        ]
        return max(stamps) if stamps else None


def _are_fresh(span: tuple[int, int], now_ns: int, limit: AgeLimit | None) -> bool:
    """Return whether all stamps of a `span_ns` are within a limit; without one they always are."""
    return limit is None or are_fresh(span, now_ns, limit.limit_ns)
