"""The page on safety shows the machine that runs, and the limits that hold."""

import re

import pytest
from draw_states import BEGIN, END, TARGET, diagram, drawn_into

from robotctl.runtime.messages import SafetyState
from robotctl.runtime.plausibility import PlausibilityConfig
from robotctl.runtime.safety import TRANSITIONS, SafetyConfig

PAGE = TARGET.read_text(encoding="utf-8")


def test_the_page_shows_the_present_state_machine():
    assert drawn_into(PAGE) == PAGE, "run .venv/bin/python tools/draw_states.py"


def test_every_transition_is_an_arrow_and_every_arrow_a_transition():
    arrows = re.findall(r"^    (\w+) --> (\w+): (.*)$", diagram(), re.MULTILINE)
    drawn = {(state, event, new) for state, new, events in arrows for event in events.split(" / ")}
    wanted = {(old.name, event.value, new.name) for (old, event), new in TRANSITIONS.items()}
    assert drawn == wanted
    assert f"[*] --> {SafetyState.BOOT.name}\n" in diagram()


@pytest.mark.parametrize("text", ["no marks", f"{BEGIN}", f"{BEGIN}{END}{BEGIN}"])
def test_a_page_without_its_marks_is_refused(text):
    with pytest.raises(ValueError, match="once each"):
        drawn_into(text)


@pytest.mark.parametrize(
    ("section", "config"),
    [("safety", SafetyConfig()), ("plausibility", PlausibilityConfig(1.0, 1.0))],
)
def test_the_page_states_each_limit_with_its_default(section, config):
    rows = dict(re.findall(rf"^\| `{section}\.(\w+)` \| ([^|]*) \|", PAGE, re.MULTILINE))
    fields = type(config).__dataclass_fields__
    assert set(rows) == set(fields)
    for name in fields:
        if name in ("resistance_ohm", "back_emf_v_s_rad"):
            assert rows[name] == "none, measure"
        else:
            assert float(rows[name]) == getattr(config, name), name
