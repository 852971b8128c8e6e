"""The configuration patch of a characterisation: tables of `[localisation]` in a robot's file."""

from __future__ import annotations

import shlex
from dataclasses import fields
from typing import Final

from robotctl.app.characterise import PARTICLE_SPREAD_M, Characterisation

_TABLES: Final = ("sonar", "lidar", "grid")


def patch_values(result: Characterisation) -> dict[str, dict[str, float]]:
    """Return table, key and value of all that changes."""
    found: dict[str, dict[str, float]] = {}
    for name in _TABLES:
        before = getattr(result.config.localisation, name)
        after = getattr(result.patched, name)
        changed = {
            each.name: getattr(after, each.name)
            for each in fields(after)
            if getattr(after, each.name) != getattr(before, each.name)
        }
        if changed:
            found[f"localisation.{name}"] = changed
    return found


def patch_overrides(result: Characterisation) -> list[str]:
    """Return the same values as `--set` takes them."""
    return [
        f"{table}.{key}={value!r}"
        for table, values in patch_values(result).items()
        for key, value in values.items()
    ]


def patch_text(result: Characterisation) -> str:
    """Return the TOML, under comments that say where it comes from."""
    told = (
        f"a reading tells the true place from others by {result.told_after:.2f} nat, with the "
        f"present settings by {result.told_before:.2f}"
    )
    comments = [
        f"The {result.source.sensor} of {result.config.robot.name}, from: {_command(result)}",
        "Put these keys in place of those in the robot's file.",
        "",
        f"poses: {result.source.poses_by}; room: {result.source.map_by}",
        told,
        f"deviations are widened by {PARTICLE_SPREAD_M:g} m, the spread of particles",
        *result.hidden,
    ]
    lines = [f"# {comment}".rstrip() for comment in comments]
    for table, values in patch_values(result).items():
        lines += ["", f"[{table}]", *(_line(result, key, value) for key, value in values.items())]
    return "\n".join(lines) + "\n"


def _line(result: Characterisation, key: str, value: float) -> str:
    """Return one line, with what was measured."""
    fit = result.fit
    limit = fit.incidence.limit.in_degrees()
    measured = {
        "sigma_m": (fit.ranges.values["sigma_m"], "measured"),
        "sigma_per_m": (fit.ranges.values["sigma_per_m"], "95 %"),
        "random": (fit.ranges.values["garbage"], "measured"),
        "none": (fit.ranges.values["none"], "measured"),
        "robust_k": (fit.ranges.values["robust_k"], "measured"),
        "max_range_m": (fit.greatest_m, "95 %"),
        "max_incidence_deg": (limit, "95 %"),
    }.get(key)
    words = "the deviation at the usual range"
    if measured is not None:
        interval, what = measured
        words = f"{what}: {interval.low:.3g} to {interval.high:.3g}"
    return f"{f'{key} = {value!r}':<32}# {words}"


def _command(result: Characterisation) -> str:
    """Return what was typed."""
    options = result.options
    words = ["robotctl", "characterise", "--robot", options.robot.name]
    words += ["--log", options.log.name] if options.log is not None else []
    words += ["--map", options.map] if options.map else []
    words += ["--sensor", result.source.sensor]
    words += ["--seed", str(options.seed)] if options.log is None else []
    words += [word for override in options.overrides for word in ("--set", override)]
    return shlex.join(words)
