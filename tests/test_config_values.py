"""Ranges of settings: what is refused, and the same words for all of them."""

import math
from dataclasses import dataclass, fields, is_dataclass

import pytest

from robotctl.config_values import ABOVE_0, check_ranges
from robotctl.errors import InvalidValue
from robotctl.estimation.mcl.tuning import MclTuning
from robotctl.estimation.slam_config import SlamConfig


@dataclass
class Setting:
    gain: float


@pytest.mark.parametrize("value", [0.5, 1, 2.0])
def test_both_ends_are_allowed(value):
    check_ranges(Setting(value), gain=(0.5, 2.0))


@pytest.mark.parametrize(
    ("value", "bounds", "words"),
    [
        (0.49, (0.5, 2.0), "0.49 found, 0.5 to 2 allowed"),
        (math.nan, (0.5, 2.0), "nan found, 0.5 to 2 allowed"),
        (0.0, (ABOVE_0, math.inf), "0.0 found, a finite number > 0 allowed"),
        (math.inf, (ABOVE_0, math.inf), "inf found, a finite number > 0 allowed"),
        (0, (1, math.inf), "0 found, 1 or more allowed"),
    ],
)
def test_what_is_outside_is_refused_with_what_is_allowed(value, bounds, words):
    with pytest.raises(InvalidValue) as refused:
        check_ranges(Setting(value), gain=bounds)
    assert (refused.value.key, refused.value.rule) == ("gain", words)


def numbers(kind):
    """Return each numeric setting of a group and of those in it, with the group's class."""
    default = kind()
    found = []
    for each in fields(kind):
        value = getattr(default, each.name)
        if is_dataclass(value):
            found += numbers(type(value))
        elif isinstance(value, int | float) and not isinstance(value, bool):
            found.append((kind, each.name))
    return found


@pytest.mark.parametrize(("kind", "key"), [*numbers(MclTuning), *numbers(SlamConfig)], ids=str)
def test_no_setting_of_an_estimator_takes_what_is_no_number(kind, key):
    for value in (math.nan, math.inf, -1e9):
        with pytest.raises(InvalidValue, match=f"^{key}: {value} found, .* allowed$"):
            kind(**{key: value})
