"""floors.json: what a small sample of cases has to reach, given what a full run has counted.

A share k of n says so much of the chance behind it that s of m come with

  P(s | k, n) = C(m, s) B(k + 1/2 + s, n - k + 1/2 + m - s) / B(k + 1/2, n - k + 1/2)

(beta-binomial, the prior of Jeffreys). A sample that is worse than all but one in two thousand of those that this chance
gives is worse than the full result: outside its 99.9 % bounds.
"""
import math

import cases as drawing
import scoring
from tables import is_right

RARE = 0.0005  # at the side that is worse


def likelihood(s, m, k, n):
    def log_beta(a, b):
        return math.lgamma(a) + math.lgamma(b) - math.lgamma(a + b)
    ways = math.lgamma(m + 1) - math.lgamma(s + 1) - math.lgamma(m - s + 1)
    return math.exp(ways + log_beta(k + 0.5 + s, n - k + 0.5 + m - s) - log_beta(k + 0.5, n - k + 0.5))


def fewest(m, k, n):
    """The least s of m that is not rare where k of n came."""
    below = 0.0
    for s in range(m + 1):
        below += likelihood(s, m, k, n)
        if below >= RARE:
            return s
    return m


def named(outcome):
    return (outcome["d_name"] or 0) >= drawing.NAMED_D


# figure: (which outcomes of a full run are like those of the sample, which came true, classes of the sample)
COUNTED = {
    "answered_share": (lambda o: True, lambda o: o["outcome"] not in ("no_answer", "failed"), None),
    "single_right": (lambda o: o["kind"] == "single" and named(o), is_right, {"single"}),
    "pair_right": (lambda o: o["kind"] == "pair" and named(o), is_right, {"pair"}),
    "wrong_name_confident": (lambda o: True, lambda o: o["confident_wrong"], None),
    "healthy_none": (lambda o: o["kind"] == "healthy", is_right, {"healthy"}),
    "outside_named_confident": (lambda o: o["kind"] == "outside" and (o["d"] or 0) >= drawing.SHOWS_D,
                                lambda o: o["confident_wrong"], {"outside"}),
}


def floors(outcomes, sample):
    """{figure: floor} for the cases of `sample`, of those figures of which the full run has cases like them."""
    found = {}
    for figure, (alike, true, kinds) in COUNTED.items():
        held = [outcome for outcome in outcomes if alike(outcome)]
        n, k = len(held), sum(bool(true(outcome)) for outcome in held)
        m = sum(kinds is None or case.kind in kinds for case in sample)
        if not n or not m:
            continue
        larger_is_better = scoring.MARKS.get(figure, (None, True))[1]
        found[figure] = fewest(m, k, n) / m if larger_is_better else (m - fewest(m, n - k, n)) / m
    return found
