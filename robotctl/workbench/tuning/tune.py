"""`robotctl tune`: measure the wheels, compute gains, measure again.

All on the simulated robot, in lockstep; see `docs/tuning.md`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from statistics import fmean
from typing import Final, Literal, TypeAlias

from robotctl.config.patch import round_figures
from robotctl.config.robot_file import RobotConfig, load_robot
from robotctl.control.identification.step_metrics import StepMetrics, step_metrics
from robotctl.control.pid import PidConfig
from robotctl.core.config import ControlConfig
from robotctl.errors import ConfigError
from robotctl.toml_source import nearest
from robotctl.workbench.tuning.fit import (
    WheelFit,
    relay_fit,
    step_gains,
    step_model,
    wheel_feedforward,
)
from robotctl.workbench.tuning.open_loop import OpenLoop, find_duty, relay_run, staircase
from robotctl.workbench.tuning.options import TuneOptions
from robotctl.workbench.tuning.patch import patch_text
from robotctl.workbench.tuning.track import (
    ExperimentError,
    ExperimentSetting,
    SpeedStep,
    speed_step,
)

Method: TypeAlias = Literal["step", "relay"]
METHODS: Final[tuple[Method, ...]] = ("step", "relay")

STEP_M_S: Final = 0.5
"""The step of the wanted speed that is judged, or the robot's top speed where that is less."""

CHARGES: Final = (1.0, 0.7)
"""Charges of the battery at which it is judged; the experiments are made at the first."""

BAND: Final = 0.02
"""Settling band, in parts of the step; an overshoot within it is no worse than none."""

_SETTLING_MARGIN_S: Final = 0.01
_OVERSHOOT_MARGIN: Final = 0.005
_OVERSHOOT_MAX: Final = 0.05
_STEADY_STATE_ERROR_MAX: Final = 0.01
_SETTLED_FOR_S: Final = 1.7
_TOP_SPEED: Final = 1.2
_RELAY_SPEED: Final = 0.7
_HOLDS_S: Final = (0.7, 1.4, 2.8)
_TIME_CONSTANTS: Final = 5.0


@dataclass(frozen=True, slots=True)
class StepResponse:
    """A step response of the true speed and its metrics, at one charge of the battery."""

    charge: float
    step: SpeedStep
    metrics: StepMetrics


@dataclass(frozen=True, slots=True)
class TuneResult:
    """All that a tuning brought.

    Parameters
    ----------
    options, config
        The options, and the robot before.
    fits
        What the experiments say, for each tuned wheel.
    gains
        The gains made of it, rounded, for each tuned wheel.
    before, after
        Responses with the present and with the new gains, one for each of `CHARGES`.
    """

    options: TuneOptions
    config: RobotConfig
    fits: Mapping[str, WheelFit]
    gains: Mapping[str, PidConfig]
    before: tuple[StepResponse, ...]
    after: tuple[StepResponse, ...]

    @property
    def objections(self) -> list[str]:
        """Remarks on what is worse with the new gains than with the present ones."""
        return [
            f"{problem} at {response.charge:.0%} battery"
            for before, response in zip(self.before, self.after, strict=True)
            for problem in _worse(before.metrics, response.metrics)
        ]

    @property
    def shortcomings(self) -> list[str]:
        """Remarks on what is not good even with the new gains."""
        return [
            f"{problem} at {response.charge:.0%} battery"
            for response in self.after
            for problem in _bad(response.metrics)
        ]

    def patch(self) -> str:
        """Return the configuration patch, with its origin in comments."""
        options = self.options
        settings = "".join(f" --set {override}" for override in options.overrides)
        command = (
            f"robotctl tune --robot {options.robot.name} --method {options.method} "
            f"--wheel {options.wheel} --seed {options.seed}{settings}"
        )
        comments = [
            f"Gains of {self.config.robot.name}, from: {command}",
            "Replace the keys in the robot's file with these.",
            "",
            *(f"{name}: {_fit_words(fit)}" for name, fit in self.fits.items()),
            *(_response_words("before", response) for response in self.before),
            *(_response_words("after", response) for response in self.after),
        ]
        return patch_text(self.gains, comments)


Progress: TypeAlias = Callable[[str], None]


def tune(options: TuneOptions, progress: Progress = lambda _line: None) -> TuneResult:
    """Measure, identify, compute and measure again; `progress` is called with each step's name.

    Raises
    ------
    ConfigError
        If the robot, a setting, the method or the wheel is wrong.
    SimulatorError
        If the robot cannot be simulated.
    ExperimentError
        If an experiment was stopped or gives no result.
    """
    config = load_robot(options.robot, options.overrides)
    wheels = wheels_to_tune(config, options.wheel)
    if options.method not in METHODS:
        raise ConfigError(
            f"--method {options.method}: no such method{nearest(options.method, METHODS)}"
        )
    progress("present gains")
    before = responses(options, config)
    fits = identify(options, config, wheels, progress)
    gains = {name: new_gains(config, name, fit) for name, fit in fits.items()}
    progress("new gains")
    after = responses(options, with_gains(config, gains))
    return TuneResult(options, config, fits, gains, before, after)


def wheels_to_tune(config: RobotConfig, wanted: str) -> tuple[str, ...]:
    """Return the names of the wheels that `--wheel` means.

    Raises
    ------
    ConfigError
        If the robot has no such wheel.
    """
    names = config.drive.wheel_names
    if wanted == "all":
        return names
    if wanted in names:
        return (wanted,)
    raise ConfigError(
        f"--wheel {wanted}: {config.robot.name} has no such wheel{nearest(wanted, (*names, 'all'))}"
    )


def responses(options: TuneOptions, config: RobotConfig) -> tuple[StepResponse, ...]:
    """Return the step responses of a robot with the gains of `config`."""
    limits = config.limits
    wanted_m_s = min(STEP_M_S, limits.v_max_m_s)
    ramp_s = wanted_m_s / limits.a_max_m_s2 + limits.a_max_m_s2 / limits.jerk_max_m_s3
    result = []
    for charge in CHARGES:
        track = ExperimentSetting(options.robot, options.overrides, options.seed, charge)
        step = speed_step(track.stack(config), wanted_m_s, ramp_s + _SETTLED_FOR_S)
        metrics = step_metrics(step.time_s, step.true_m_s, wanted_m_s, band=BAND)
        result.append(StepResponse(charge, step, metrics))
    return tuple(result)


def identify(
    options: TuneOptions, config: RobotConfig, wheels: tuple[str, ...], progress: Progress
) -> dict[str, WheelFit]:
    """Identify each wheel by open-loop experiments; slow wheels get longer steps.

    Raises
    ------
    ExperimentError
        If an experiment was stopped or its record gives no result.
    """
    for hold_s in _HOLDS_S:
        progress(f"{options.method} experiment, {hold_s:g} s for each speed")
        try:
            fits = _experiment(options, config, wheels, hold_s)
        except ValueError as error:
            raise ExperimentError(f"the experiment gives no result: {error}") from error
        if all(_TIME_CONSTANTS * fit.model.time_constant_s < hold_s for fit in fits.values()):
            break
    return fits


def _experiment(
    options: TuneOptions, config: RobotConfig, wheels: tuple[str, ...], hold_s: float
) -> dict[str, WheelFit]:
    """Drive one open-loop experiment and evaluate it."""
    pwm, drive = config.control.pwm, config.drive
    track = ExperimentSetting(options.robot, options.overrides, options.seed, CHARGES[0])
    open_loop = OpenLoop(track.stack(config), config)
    top_m_s = min(_TOP_SPEED * STEP_M_S, config.limits.v_max_m_s)
    top_duty = find_duty(open_loop, top_m_s / drive.wheel_radius_m, pwm.max_duty)
    speed_rad_s = _RELAY_SPEED * open_loop.speed_rad_s
    staircase(open_loop, top_duty, hold_s)
    record = open_loop.record()
    indices = {name: drive.wheel_names.index(name) for name in wheels}
    feedforwards = {name: wheel_feedforward(record, i, pwm.deadband) for name, i in indices.items()}
    if options.method == "step":
        models = {name: step_model(record, i, pwm.deadband) for name, i in indices.items()}
        return {
            name: WheelFit(feedforwards[name], model, step_gains(model, open_loop.dt_s))
            for name, model in models.items()
        }
    holding_v = fmean(f.kv * speed_rad_s + f.ks for f in feedforwards.values())
    run = relay_run(open_loop, pwm, speed_rad_s, holding_v)
    record = open_loop.record()
    return {name: relay_fit(record, run, i, feedforwards[name]) for name, i in indices.items()}


def new_gains(config: RobotConfig, wheel: str, fit: WheelFit) -> PidConfig:
    """Return a wheel's configuration with the new gains, rounded: feedback to 2, rest to 3 figures.

    The other keys of the wheel's table are kept.
    """
    kp, ki, kd = (round_figures(gain, 2) for gain in fit.gains)
    kv, ks, ka = (
        round_figures(gain, 3)
        for gain in (fit.feedforward.kv, fit.feedforward.ks, fit.feedforward.ka)
    )
    present: PidConfig = getattr(config.control, wheel)
    return dataclasses.replace(present, kp=kp, ki=ki, kd=kd, kv=kv, ks=ks, ka=ka)


def with_gains(config: RobotConfig, gains: Mapping[str, PidConfig]) -> RobotConfig:
    """Return a robot with other wheel loops."""
    control = ControlConfig(
        config.control.pwm,
        *(gains.get(name, getattr(config.control, name)) for name in ("left", "right", "drive")),
    )
    return dataclasses.replace(config, control=control)


def _worse(before: StepMetrics, after: StepMetrics) -> list[str]:
    """Return as text where a response is worse than before."""
    words = []
    if before.settling_s is not None:
        if after.settling_s is None:
            words.append(f"does not settle, before within {before.settling_s:.3f} s")
        elif after.settling_s > before.settling_s + _SETTLING_MARGIN_S:
            words.append(
                f"settles within {after.settling_s:.3f} s, before within {before.settling_s:.3f} s"
            )
    if after.overshoot > max(before.overshoot + _OVERSHOOT_MARGIN, BAND):
        words.append(f"overshoots by {after.overshoot:.1%}, before by {before.overshoot:.1%}")
    return words


def _bad(metrics: StepMetrics) -> list[str]:
    """Return as text what no gains should leave."""
    words = []
    if metrics.settling_s is None:
        words.append("does not settle")
    if metrics.overshoot > _OVERSHOOT_MAX:
        words.append(f"overshoots by {metrics.overshoot:.1%}")
    if abs(metrics.steady_state_error) > _STEADY_STATE_ERROR_MAX:
        words.append(f"misses the speed by {metrics.steady_state_error:+.1%}")
    return words


def _fit_words(fit: WheelFit) -> str:
    model = fit.model
    return (
        f"K {model.gain:.3g} rad/s per V, tau {model.time_constant_s:.3g} s, "
        f"dead time {model.delay_s:.2g} s"
    )


def _response_words(when: str, response: StepResponse) -> str:
    metrics = response.metrics
    settling = "never" if metrics.settling_s is None else f"{metrics.settling_s:.3f} s"
    return (
        f"{when}, {response.charge:.0%} battery, 0 to {response.step.wanted_m_s:g} m/s: settling "
        f"{settling}, overshoot {metrics.overshoot:.1%}, "
        f"error {metrics.steady_state_error:+.2%}"
    )
