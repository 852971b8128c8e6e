"""Back-off and crash budget, by hand-computed delays and by laws."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotctl.app.supervision.restart import CrashBudget, RestartPolicy


def test_the_pause_doubles_up_to_its_limit_and_then_the_budget_is_spent() -> None:
    budget = CrashBudget(RestartPolicy(crashes=6))
    assert [budget.spend(float(i)) for i in range(7)] == [0.25, 0.5, 1.0, 2.0, 4.0, 4.0, None]


def test_ends_outside_the_window_are_forgotten() -> None:
    budget = CrashBudget(RestartPolicy(crashes=1, window_s=10.0))
    assert budget.spend(0.0) == 0.25
    assert budget.spend(10.5) == 0.25
    assert budget.spend(20.0) is None


@given(
    gaps_s=st.lists(st.floats(0.0, 100.0), min_size=1, max_size=40),
    crashes=st.integers(1, 8),
)
def test_no_window_ever_holds_more_new_starts_than_the_budget(
    gaps_s: list[float], crashes: int
) -> None:
    policy = RestartPolicy(crashes=crashes)
    budget = CrashBudget(policy)
    now_s, granted_s = 0.0, []
    for gap_s in gaps_s:
        now_s += gap_s
        delay_s = budget.spend(now_s)
        if delay_s is None:
            break
        assert policy.first_delay_s <= delay_s <= policy.longest_delay_s
        granted_s.append(now_s)
    for first_s in granted_s:
        assert sum(first_s <= each <= first_s + policy.window_s for each in granted_s) <= crashes


@pytest.mark.parametrize("wrong", [{"crashes": 0}, {"crashes": 1, "first_delay_s": 0.0}])
def test_a_policy_that_would_restart_for_ever_or_at_once_is_refused(wrong: dict) -> None:
    with pytest.raises(ValueError, match="must be"):
        RestartPolicy(**wrong)
