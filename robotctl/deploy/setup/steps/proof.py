"""Step: proof that each drive stops when the host falls silent, wheels on blocks.

All wheels turn slowly, then nothing more is sent. The unsolicited reports of a drive show when its
power went; one that only answers is asked once, after its time-out, and its wheel must be at rest
in that first answer.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from robotctl.config.file_edit import Change
from robotctl.deploy.setup.bench import Bench, Wheel
from robotctl.deploy.setup.dialogue import Script, Tell, UnfinishedError
from robotctl.deploy.setup.steps.asking import in_service, on_blocks
from robotctl.drivers.can.drives.motor_drive import MotorConfig
from robotctl.messages.actuators import DriveState

SPIN_S: Final = 2.0
"""Time for which the wheels turn before the silence [s]."""
MARGIN_MS: Final = 200
"""Time after the time-out within which the loss of power must show [ms].

A wheel has to slow down first, and a state comes with a heartbeat."""
ROLL_MS: Final = 500
"""Further time to observe whether the wheels are braked or coast [ms]."""

STANDS: Final = 0.2
"""Share of its speed below which a wheel has stopped."""
_RUNS_ON: Final = 0.95
"""Share of its speed above which a wheel may still be driven, whatever its drive reports."""
_TURNS: Final = 0.5
"""Share of the commanded speed at which a wheel turns well enough for the proof."""
_ANSWERS: Final = 20
"""Maximum ticks until a drive answers."""
_LATCHED: Final = (DriveState.STOPPED, DriveState.FAULT)


@dataclass(slots=True)
class _Witness:
    """A wheel during the silence."""

    wheel: Wheel
    before_rad_s: float
    lost_ms: float | None = None
    """Time after the last command at which its drive reported the loss of power [ms]."""
    ran_ms: float = 0.0
    """Time after the last command up to which it kept its speed [ms]."""
    share: float = 1.0
    """Newest speed as a share of that before the silence."""
    told: bool = False
    """Whether anything was reported during the silence."""

    @property
    def off_ms(self) -> float:
        """Time after the last command at which the loss of power showed [ms]."""
        return self.ran_ms if self.lost_ms is None else self.lost_ms


def run(bench: Bench) -> Script:
    """Test all drives; write the settings of those that stop."""
    yield from in_service(bench)
    yield from on_blocks()
    proofs = {motor.name: drive.proof for motor, drive, _ in bench.drives}
    yield Tell(
        "All wheels turn slowly; then this computer falls silent, and each drive must take the "
        f"power within {bench.config.safety.command_timeout_ms} ms by itself …"
    )
    _spin(bench)
    witnesses = _watch(bench)
    is_ready = bench.recover()
    changes: list[Change] = []
    failures = []
    for motor, drive, wheels in bench.drives:
        own = [each for each in witnesses if each.wheel in wheels]
        problem, words = _judge(bench, motor, own)
        if not problem and drive.proof != proofs[motor.name]:
            problem = f"its settings changed meanwhile ({proofs[motor.name]} → {drive.proof})"
        yield Tell(f"{motor.name}: {problem or words}")
        if problem:
            failures.append(f"{motor.name} {problem}")
        elif drive.proof:
            changes.append(Change(("proof", motor.name), drive.proof, f"seen: {words}"))
    if not is_ready:
        yield Tell("Not all drives came back into service: switch them off and on again.")
    if failures:
        raise UnfinishedError(f"NOT proven: {'; '.join(failures)}", tuple(changes))
    return tuple(changes)


def _spin(bench: Bench) -> None:
    """Turn all wheels, and leave them turning.

    Raises
    ------
    UnfinishedError
        If a wheel does not turn as commanded.
    """
    moved = bench.keep_spinning(bench.wheels, seconds=SPIN_S)
    if moved.stopped:
        raise UnfinishedError(f"not proven: {moved.stopped}")
    for wheel in bench.wheels:
        if bench.speed_rad_s(wheel) < _TURNS * bench.slow_m_s / wheel.radius_m:
            bench.rest()
            problem = f"{wheel.name} does not turn at {bench.slow_m_s} m/s as commanded"
            raise UnfinishedError(f"not proven: {problem}; wheels creep until `counts` is done")


def _timeout_ms(bench: Bench, motor: MotorConfig) -> int:
    """Return the time within which a drive has to react [ms].

    It is the robot's time-out, or a longer one accepted in the drive's table.
    """
    return motor.accept_timeout_ms or bench.config.safety.command_timeout_ms


def _watch(bench: Bench) -> list[_Witness]:
    """Fall silent after the last command, and return the reports of each wheel meanwhile."""
    begin_ns = bench.now_ns
    witnesses = [_Witness(wheel, bench.speed_rad_s(wheel)) for wheel in bench.wheels]
    longest_ms = max(_timeout_ms(bench, motor) for motor in bench.config.motors)
    margin_ns = begin_ns + (longest_ms + MARGIN_MS) * 1_000_000
    while bench.now_ns < margin_ns:
        bench.listen()
        for each in witnesses:
            _note(bench, each, begin_ns, margin_ns)
    if all(each.told for each in witnesses):
        end_ns = margin_ns + ROLL_MS * 1_000_000
        while bench.now_ns < end_ns:
            bench.listen()
            for each in witnesses:
                _note(bench, each, begin_ns, margin_ns)
    else:
        _ask_once(bench, witnesses, begin_ns)
    return witnesses


def _note(bench: Bench, witness: _Witness, begin_ns: int, margin_ns: int) -> None:
    """Record the newest unsolicited report."""
    wheel = witness.wheel
    report = bench.feedback.actuators[wheel.place]
    witness.told = report.motion_ns > margin_ns - MARGIN_MS * 1_000_000
    if report.motion_ns > begin_ns:
        witness.share = abs(bench.speed_rad_s(wheel)) / witness.before_rad_s
        if witness.share > _RUNS_ON:
            witness.ran_ms = (report.motion_ns - begin_ns) * 1e-6
    says_off = report.state is not DriveState.ENABLED and report.report_ns > begin_ns
    if says_off and witness.lost_ms is None:
        witness.lost_ms = (report.report_ns - begin_ns) * 1e-6


def _ask_once(bench: Bench, witnesses: list[_Witness], begin_ns: int) -> None:
    """End the silence; the first answers show whether the power was off before."""
    asked_ns = bench.now_ns
    waiting = [each for each in witnesses if not each.told]
    for _ in range(_ANSWERS):
        bench.rest()
        for each in waiting:
            if not each.told:
                _take_answer(bench, each, asked_ns)
                each.lost_ms = (asked_ns - begin_ns) * 1e-6


def _take_answer(bench: Bench, witness: _Witness, asked_ns: int) -> None:
    """Record the first answer of a drive that only answers."""
    report = bench.feedback.actuators[witness.wheel.place]
    if witness.wheel.actuator.abilities.tells_speed:
        witness.told = report.motion_ns > asked_ns
        witness.share = abs(bench.speed_rad_s(witness.wheel)) / witness.before_rad_s
    else:
        # Its latched state is its own; a speed takes several positions.
        witness.told = report.report_ns > asked_ns
        witness.share = 0.0 if report.state in _LATCHED else 1.0


def _judge(bench: Bench, motor: MotorConfig, witnesses: list[_Witness]) -> tuple[str, str]:
    """Return why a drive is not proven, or how it stopped."""
    timeout_ms = _timeout_ms(bench, motor)
    for each in witnesses:
        name, share = each.wheel.name, each.share
        if not each.told:
            return f"tells nothing of {name} any more", ""
        if share > _RUNS_ON:
            found = f"{name} has {share:.0%} of its speed without a command"
            return f"keeps running: {found} (documented: {motor.silence})", ""
        if each.off_ms > timeout_ms + MARGIN_MS:
            late = f"{each.off_ms:.0f} ms found, {timeout_ms + MARGIN_MS} allowed"
            return f"takes the power of {name} too late: {late}", ""
        coasts = share > STANDS
        if coasts and motor.abilities.brakes and not motor.accept_coasting:
            remedy = "let it brake, or accept it by accept_coasting = true"
            return f"coasts: {name} still has {share:.0%} of its speed; {remedy}", ""
    lost_ms = max((each.off_ms for each in witnesses), default=0.0)
    end = "coasts then" if any(each.share > STANDS for each in witnesses) else "wheel stands"
    return "", f"power gone after {lost_ms:.0f} ms at most, {end}"
