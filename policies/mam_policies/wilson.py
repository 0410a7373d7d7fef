"""The interval that stands beside every success rate."""

from __future__ import annotations

from scipy.stats import binomtest


def wilson(successes: int, count: int) -> tuple[float, float]:
    """Wilson's 95 % interval of a success rate (Wilson 1927); (0, 1) of no episode."""
    if count == 0:
        return 0.0, 1.0
    low, high = binomtest(successes, count).proportion_ci(0.95, "wilson")
    return float(low), float(high)
