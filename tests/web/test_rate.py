"""The law of a limit: in no window is more allowed than the burst and what the rate gives."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from robotctl.web.rate import RateLimit


@given(
    st.integers(1, 50),
    st.integers(1, 50),
    st.lists(st.tuples(st.integers(0, 400_000_000), st.integers(1, 5)), max_size=100),
)
def test_no_window_has_more_than_the_burst_and_the_rate(per_s, burst, steps):
    limit, now_ns, allowed = RateLimit(per_s, burst), 0, []
    for wait_ns, count in steps:
        now_ns += wait_ns
        if limit.allows(now_ns, count):
            allowed.append((now_ns, count))
    for begin, (first_ns, _) in enumerate(allowed):
        total = 0
        for at_ns, count in allowed[begin:]:
            total += count
            assert total <= burst + per_s * (at_ns - first_ns) * 1e-9 + 1e-6


def test_who_stays_within_the_rate_is_never_refused():
    limit = RateLimit(20, 2)
    assert all(limit.allows(number * 50_000_000) for number in range(1000))
