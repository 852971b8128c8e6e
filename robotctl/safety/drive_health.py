"""One motor drive as control sees it: the age of its reports, its faults, whether it obeys."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from robotctl.messages.actuators import NEVER_NS, ActuatorFeedback, DriveState
from robotctl.messages.faults import Fault, FaultCode
from robotctl.safety.ages import UNLIMITED_NS, AgeLimit, fresh_span_ns

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
        limits = [ages.get(field) for field in ACTUATOR_AGES]
        self._motion, self._report, self._supply = limits
        self._motion_limit_ns, self._report_limit_ns, self._supply_limit_ns = (
            UNLIMITED_NS if limit is None else limit.limit_ns for limit in limits
        )
        self._latches_us = [-1] * len(wheels)
        self._motions_ns = [NEVER_NS] * len(wheels)
        self._lost_ns = self._motion.limit_ns if self._motion is not None else 0
        """A command that is older is lost [ns]."""
        self._told_ns = [(NEVER_NS, NEVER_NS)] * len(self._all)
        """Times of report and supply of each [ns]."""
        self._newest_ns = self._reported_ns = NEVER_NS
        """Time of the newest of all reports, and of those of state [ns]."""
        self._moves_ns = fresh_span_ns(self._motions_ns, self._motion_limit_ns)
        """First and last moment at which all motions are fresh [ns],"""
        self._reports_ns: tuple[int, int]
        self._supplies_ns: tuple[int, int]
        """all reports of state, and all supplies."""
        self._note_reports()
        self._idle_ns = -NEVER_NS
        """When the drive was last enabled, or not commanded to be [ns]."""
        self._back_ns = NEVER_NS
        """End of the last `_GAP_NS` in which nothing came of it [ns]."""
        self._loss = _NOTHING
        """The last report that told of an old newest command."""

    def update(self, actuators: tuple[ActuatorFeedback, ...]) -> None:
        """Take the newest reports of all actuators of the robot."""
        self.reports = reports = tuple([actuators[index] for index in self._all])
        latches_us, motions_ns, told_ns = self._latches_us, self._motions_ns, self._told_ns
        wheels, is_told = len(latches_us), False
        for place, report in enumerate(reports):
            if place < wheels:  # joints follow them
                latch_us = report.latch_us
                # The same latch again is no new measurement, however recent its frame.
                if latch_us < 0 or latch_us != latches_us[place]:
                    latches_us[place] = latch_us
                    motions_ns[place] = report.motion_ns
            told = report.report_ns, report.supply_ns
            if told != told_ns[place]:
                told_ns[place], is_told = told, True
            if report.state is _ENABLED:
                self._idle_ns = told[0]
        self._moves_ns = fresh_span_ns(motions_ns, self._motion_limit_ns)
        if is_told:  # most ticks bring motions alone
            self._note_reports()
        before_ns = self._newest_ns
        self._newest_ns = newest_ns = max([self._reported_ns, *motions_ns])
        if newest_ns - before_ns > _GAP_NS and before_ns != NEVER_NS:
            self._back_ns = newest_ns

    def _note_reports(self) -> None:
        """Note when reports of state and of supply came, and what they tell."""
        told_ns = self._told_ns
        reports_ns = [report_ns for report_ns, _ in told_ns]
        self._reported_ns = max(reports_ns)
        supplies_ns = [supply_ns for _, supply_ns in told_ns]
        self._reports_ns = fresh_span_ns(reports_ns, self._report_limit_ns)
        self._supplies_ns = fresh_span_ns(supplies_ns, self._supply_limit_ns)
        for report in self.reports:
            if self._tells_loss(report):
                self._loss = report

    def armed(self, now_ns: int) -> None:
        """Take note that the robot is armed: from now on the drive is to be enabled."""
        self._idle_ns = now_ns

    def moves_fresh(self, now_ns: int) -> bool:
        """Return whether the motion of all its wheels is not too old."""
        first_ns, last_ns = self._moves_ns
        return first_ns <= now_ns <= last_ns

    def reports_fresh(self, now_ns: int) -> bool:
        """Return whether its reports of state, current and temperature are not too old."""
        first_ns, last_ns = self._reports_ns
        return first_ns <= now_ns <= last_ns

    def _supplies_fresh(self, now_ns: int) -> bool:
        """Return whether its reports of supply and commands are not too old."""
        first_ns, last_ns = self._supplies_ns
        return first_ns <= now_ns <= last_ns

    def supply_v(self, now_ns: int) -> float | None:
        """Return its supply [V]; None if that is too old, or not told."""
        return self.reports[0].voltage_v if self._supplies_fresh(now_ns) else None

    def faults(self, now_ns: int) -> list[Fault]:
        """Return all reasons to stop, the most telling first."""
        faults = []
        if self._motion is not None and not self.moves_fresh(now_ns):
            faults.append(self._motion.fault())
        if self._report is not None and not self.reports_fresh(now_ns):
            faults.append(self._report.fault())
        else:
            for report in self.reports:
                if report.fault is not None:
                    faults.append(report.fault)
                    break
        if self._supply is not None and not self._supplies_fresh(now_ns):
            faults.append(self._supply.fault())
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
        return self._lost() if self._supplies_fresh(now_ns) else None

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
