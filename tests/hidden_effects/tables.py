"""What the tables of RESULTS.md are made of: rows, shares of outcomes, what an answer says first."""
import math

from binomial import rate

SHOWS_D = 8.0  # from here on detection and naming are asked for
BINS = (0, 2, 4, 8, 16, 32, 64, 128, math.inf)


def table(header, rows):
    if not rows:
        return ""
    lines = ["| " + " | ".join(header) + " |", "|" + " --- |" * len(header)]
    return "\n".join(lines + ["| " + " | ".join(str(cell) for cell in row) + " |" for row in rows])


def count(outcomes, test):
    return rate(sum(bool(test(outcome)) for outcome in outcomes), len(outcomes))


def is_right(outcome):
    return outcome["outcome"] == "right"


def detected(outcome):
    return outcome["conclusion"] not in (None, "none")


def within(outcomes, *kinds):
    return [outcome for outcome in outcomes if outcome["kind"] in kinds]


def by_bin(outcomes, distance):
    """(title, outcomes) of every bin of a distance, those whose distance is not known left out."""
    for low, high in zip(BINS, BINS[1:]):
        yield f"{low:g} to {high:g}", [o for o in outcomes if o[distance] is not None and low <= o[distance] < high]


def shown(value, digits=3):
    return "-" if value is None else f"{value:.{digits}g}"


def first_said(outcome):
    """The first cause of the answer, or the conclusion where it holds none."""
    if outcome["conclusion"] in ("named", "ambiguous") and outcome["said"]:
        return outcome["said"][0][0]
    return outcome["conclusion"] or outcome["outcome"]
