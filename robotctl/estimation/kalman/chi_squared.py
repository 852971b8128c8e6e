"""Quantiles of chi-squared variables."""

from __future__ import annotations


def chi2_quantile(probability: float, dof: float) -> float:
    """Return below which value a chi-squared variable of `dof` degrees of freedom stays."""
    from scipy.special import gammaincinv  # type: ignore[import-untyped] # noqa: PLC0415 - slow

    return float(2.0 * gammaincinv(0.5 * dof, probability))


def chi2_bounds(dof: float, probability: float = 0.95) -> tuple[float, float]:
    """Return the two-sided bounds of a chi-squared variable for a probability."""
    tail = 0.5 * (1.0 - probability)
    return chi2_quantile(tail, dof), chi2_quantile(1.0 - tail, dof)
