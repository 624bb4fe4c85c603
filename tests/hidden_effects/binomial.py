"""Exact bounds of a share: what k of n says about the chance behind it."""
import math


def tail(k, n, chance):
    """Probability of k or more of n."""
    if k <= 0:
        return 1.0
    if chance <= 0:
        return 0.0
    if chance >= 1:
        return 1.0
    whole = math.lgamma(n + 1)
    return min(1.0, math.fsum(
        math.exp(whole - math.lgamma(i + 1) - math.lgamma(n - i + 1) + i * math.log(chance) + (n - i) * math.log1p(-chance))
        for i in range(k, n + 1)))


def bounds(k, n, level=0.95):
    """(low, high) of Clopper and Pearson 1934: chances under which k or more, k or fewer of n come (1 - level) / 2 of the
    time. (0, 1) where nothing was counted."""
    rare = (1 - level) / 2
    low = 0.0 if k == 0 else root(lambda chance: tail(k, n, chance) - rare)
    high = 1.0 if k == n else root(lambda chance: tail(k + 1, n, chance) - (1 - rare))
    return low, high


def root(rising):
    low, high = 0.0, 1.0
    for _ in range(50):
        middle = (low + high) / 2
        low, high = (middle, high) if rising(middle) < 0 else (low, middle)
    return (low + high) / 2


def rate(k, n):
    """'0.950 [0.861, 0.990] of 60'; a dash where nothing was counted."""
    if n == 0:
        return "-"
    low, high = bounds(k, n)
    return f"{k / n:.3f} [{low:.3f}, {high:.3f}] of {n}"
