"""The configuration patch of a characterisation: tables of `[localisation]` in a robot's file."""

from __future__ import annotations

import shlex
from dataclasses import fields
from typing import Final

import numpy as np

from robotctl.config.patch import as_toml
from robotctl.workbench.sensors.characterise import PARTICLE_SPREAD_M, Characterisation

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


def patch_text(result: Characterisation) -> str:
    """Return the TOML, with comments on its origin."""
    told = (
        f"a reading tells the true place from others by {result.told_after:.2f} nat, with the "
        f"present settings by {result.told_before:.2f}"
    )
    comments = [
        f"The {result.source.sensor} of {result.config.robot.name}, from: {_command(result)}",
        "Replace the keys in the robot's file with these.",
        "",
        f"poses: {result.source.poses_by}; room: {result.source.map_by}",
        told,
        f"deviations are widened by {PARTICLE_SPREAD_M:g} m, the spread of particles",
        *result.hidden,
    ]
    return as_toml(patch_values(result), comments, lambda table, key: _words(result, table, key))


def _words(result: Characterisation, table: str, key: str) -> str:
    """Return the measurement of a key."""
    fit = result.fit
    if (table, key) in {("localisation.lidar", "sigma_m"), ("localisation.grid", "sonar_band_m")}:
        typical_m = fit.ranges.typical_m
        sigma_m = float(fit.ranges.mixture.sigma_at(np.array(typical_m)))
        return f"measured: {sigma_m:.3g} at the usual range, {typical_m:.2g} m"
    limit = fit.incidence.limit.in_degrees()
    interval, what = {
        "sigma_m": (fit.ranges.values["sigma_m"], "measured"),
        "sigma_per_m": (fit.ranges.values["sigma_per_m"], "95 %"),
        "random": (fit.ranges.values["garbage"], "measured"),
        "none": (fit.ranges.values["none"], "measured"),
        "robust_k": (fit.ranges.values["robust_k"], "measured"),
        "max_range_m": (fit.greatest_m, "95 %"),
        "max_incidence_deg": (limit, "95 %"),
    }[key]
    return f"{what}: {interval.low:.3g} to {interval.high:.3g}"


def _command(result: Characterisation) -> str:
    """Return the command line."""
    options = result.options
    words = ["robotctl", "characterise", "--robot", options.robot.name]
    words += ["--log", options.log.name] if options.log is not None else []
    words += ["--map", options.map] if options.map else []
    words += ["--sensor", result.source.sensor]
    words += ["--seed", str(options.seed)] if options.log is None else []
    words += [word for override in options.overrides for word in ("--set", override)]
    return shlex.join(words)
