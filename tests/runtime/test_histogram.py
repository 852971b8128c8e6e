"""The histogram against sorting."""

from hypothesis import given
from hypothesis import strategies as st

from robotctl.runtime.histogram import Histogram


@given(
    st.lists(st.integers(0, 10_000_000), min_size=1, max_size=300),
    st.sampled_from([0.01, 0.5, 0.9, 0.99, 0.999, 1.0]),
)
def test_a_percentile_is_the_sorted_one_to_a_thirty_second(values: list[int], share: float) -> None:
    histogram = Histogram()
    for value in values:
        histogram.add(value)
    rank = max(1, -(-share * len(values) // 1))
    exact = sorted(values)[int(rank) - 1]
    (found,) = histogram.percentiles(share)
    assert exact <= found <= exact * (1 + 1 / 32) + 1


def test_an_empty_histogram_says_zero() -> None:
    assert Histogram().percentiles(0.5, 1.0) == (0, 0)


def test_values_beyond_the_last_bucket_keep_the_exact_maximum() -> None:
    histogram = Histogram()
    histogram.add(1 << 60)
    histogram.add(-5)
    assert histogram.maximum == 1 << 60
    assert histogram.total == 2
    assert histogram.percentiles(0.1) == (0,)
