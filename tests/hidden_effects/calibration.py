"""Whether a probability is what it says. A forecast is (probability, whether it came true)."""
import collections
import math

BINS = 10
DOUBTFUL = (0.5, 0.95)  # where a probability has to work: neither even nor settled


def brier(forecasts):
    """Mean squared distance of probability and truth (Brier 1950); None without forecasts."""
    return math.fsum((p - came) ** 2 for p, came in forecasts) / len(forecasts) if forecasts else None


def reliability(forecasts):
    """[(forecasts, mean probability, came true)] of the bins of equal width that hold any, by rising probability."""
    bins = collections.defaultdict(list)
    for probability, came in forecasts:
        bins[min(int(probability * BINS), BINS - 1)].append((probability, came))
    return [(len(held), math.fsum(p for p, _ in held) / len(held), sum(bool(came) for _, came in held))
            for _, held in sorted(bins.items())]


def expected_error(forecasts):
    """Distance of mean probability and share that came true, weighted by the forecasts of each bin (Naeini 2015)."""
    if not forecasts:
        return None
    return math.fsum(abs(n * mean - true) for n, mean, true in reliability(forecasts)) / len(forecasts)


def doubtful(forecasts):
    return [(p, came) for p, came in forecasts if DOUBTFUL[0] <= p < DOUBTFUL[1]]


def most_probable(outcome):
    """The forecast of a whole answer: its most probable candidate, and whether that is what was hidden."""
    if not outcome["top_candidates"]:
        return []
    name, probability = outcome["top_candidates"][0]
    hidden = {"unknown"} if outcome["kind"] == "outside" else set(outcome["hidden"]) or {"none"}
    return [(probability, set(name.split("+")) == hidden)]


def of_causes(outcome):
    """A forecast for each cause that the answer holds: that it is there."""
    hidden = [] if outcome["kind"] == "outside" else outcome["hidden"]
    return [(probability, cause in hidden) for cause, probability, _ in outcome["said"]]
