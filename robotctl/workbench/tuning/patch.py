"""The configuration patch: tables of a robot's file, made of tuned gains."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from robotctl.config.patch import Tables, as_toml
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


def patch_values(gains: Mapping[str, PidConfig]) -> Tables:
    """Return the tables `[control.<wheel>]`."""
    return {
        f"control.{wheel}": {key: getattr(config, key) for key in KEYS}
        for wheel, config in gains.items()
    }


def patch_text(gains: Mapping[str, PidConfig], comments: Iterable[str]) -> str:
    """Return the TOML of these, under comments."""
    return as_toml(patch_values(gains), comments, lambda _table, key: _UNITS[key])
