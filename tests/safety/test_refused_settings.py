"""A setting out of its range is refused by name, with the value that was found."""

import math
from functools import partial

import pytest

from robotctl.errors import InvalidValue
from robotctl.safety.plausibility_config import PlausibilityConfig
from robotctl.safety.state_machine import SafetyConfig

plausibility = partial(PlausibilityConfig, resistance_ohm=1.0, back_emf_v_s_rad=1.0)


@pytest.mark.parametrize(
    ("config", "key", "value", "rule"),
    [
        (SafetyConfig, "command_timeout_ms", 9, "must be 10 to 1000, not 9"),
        (SafetyConfig, "warmup_ticks", 10_001, "must be 1 to 10000, not 10001"),
        (plausibility, "resistance_ohm", math.inf, "inf found, a finite number > 0 allowed"),
        (plausibility, "push_v", 0.0, "0.0 found, a finite number > 0 allowed"),
        (plausibility, "pair_share", 0.51, "0.51 found, at most 0.5 allowed"),
        (plausibility, "speed_ms", 501, "501 found, 5 to 500 allowed"),
    ],
)
def test_the_error_has_the_key_the_rule_and_the_value(
    config: type, key: str, value: float, rule: str
) -> None:
    with pytest.raises(InvalidValue) as found:
        config(**{key: value})
    assert (found.value.key, found.value.rule, found.value.value) == (key, rule, value)
