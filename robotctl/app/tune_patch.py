"""The configuration patch: tables of a robot's file, made of tuned gains."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

from robotctl.control.pid import PidConfig

KEYS = ("kp", "ki", "kd", "kv", "ks", "ka")

_UNITS = {
    "kp": "V per rad/s",
    "ki": "V per rad",
    "kd": "V per rad/s^2",
    "kv": "V per rad/s, feed-forward against back-EMF",
    "ks": "V, feed-forward against friction",
    "ka": "V per rad/s^2, feed-forward against inertia",
}


def round_figures(value: float, figures: int) -> float:
    """Return a value rounded to so many significant figures."""
    if value == 0.0 or not math.isfinite(value):
        return value
    return round(value, figures - 1 - math.floor(math.log10(abs(value))))


def patch_text(gains: Mapping[str, PidConfig], comments: Iterable[str]) -> str:
    """Return the TOML of `[control.<wheel>]` tables, under comments."""
    lines = [f"# {comment}".rstrip() for comment in comments]
    for wheel, config in gains.items():
        lines += ["", f"[control.{wheel}]"]
        for key in KEYS:
            lines.append(f"{f'{key} = {getattr(config, key)!r}':<32}# {_UNITS[key]}")
    return "\n".join(lines) + "\n"


def patch_overrides(gains: Mapping[str, PidConfig]) -> list[str]:
    """Return the same gains as `--set` takes them."""
    return [
        f"control.{wheel}.{key}={getattr(config, key)!r}"
        for wheel, config in gains.items()
        for key in KEYS
    ]
