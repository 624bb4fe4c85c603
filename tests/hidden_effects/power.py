"""The distance d that is seen nine times in ten, and how far observers who know every law would have come: one who is
told the population of good valves, one who learns it from as many good valves as the answers have.

What is seen of a cause grows with d as Φ(slope · ln(d / d50)). Where few cases lie between the never and the always seen,
no slope is the likeliest one: so d at 90 % is the median of what all curves say, each by its likelihood, over a grid even
in the logarithms of d50 and slope; its interval holds 95 % of them.
"""
import collections
import csv
import math
import pathlib

from tables import detected, table, within

NINE_IN_TEN = 1.2815515655446004
D50 = (1.0, 400.0, 60)    # from, to, steps: sizes are drawn so that d spans 2 to 200
SLOPE = (0.5, 8.0, 24)
TOLD, LEARNING = "oracle.csv", "oracle_of_eight.csv"
ALARMS = ("1 %", "0.1 %")


def log_grid(low, high, steps):
    return [low * (high / low) ** (i / (steps - 1)) for i in range(steps)]


def curves(seen):
    """[(d at 90 %, log likelihood)] of all curves; `seen` is (d, whether it was)."""
    points = [(math.log(d), came) for d, came in seen]
    found = []
    for d50 in log_grid(*D50):
        for slope in log_grid(*SLOPE):
            at = [slope * (log_d - math.log(d50)) for log_d, _ in points]
            likelihood = math.fsum(
                math.log(max(0.5 * math.erfc((-z if came else z) / math.sqrt(2)), 1e-300))
                for z, (_, came) in zip(at, points))
            found.append((d50 * math.exp(NINE_IN_TEN / slope), likelihood))
    return found


def d90(seen):
    """(median, low, high); None where nothing was asked."""
    if not seen:
        return None
    found = sorted(curves(seen))
    best = max(likelihood for _, likelihood in found)
    weights = [math.exp(likelihood - best) for _, likelihood in found]
    whole = math.fsum(weights)

    def quantile(share):
        below = 0.0
        for (value, _), weight in zip(found, weights):
            below += weight
            if below >= share * whole:
                return value
        return found[-1][0]
    return quantile(0.5), quantile(0.025), quantile(0.975)


def oracle(of=TOLD):
    """{cause: (d at 90 % with 1 % false alarm, with 0.1 %)}"""
    with open(pathlib.Path(__file__).with_name(of), newline="") as file:
        rows = csv.DictReader(line for line in file if not line.startswith("#"))
        return {row["cause"]: (float(row["d90_1_percent"]), float(row["d90_0.1_percent"])) for row in rows}


def oracles():
    """{cause: d at 90 % of the told one at each alarm, then of the learning one}"""
    learning = oracle(LEARNING)
    return {cause: told + learning[cause] for cause, told in oracle().items()}


def seen_of(outcomes):
    return [(o["d"], detected(o)) for o in outcomes if o["d"]]


def efficiencies(outcomes):
    """Rows of cause, d at 90 % of answers and oracles, and their ratios; empty where no d is known."""
    known = oracles()
    singles = [o for o in within(outcomes, "single") if o["d"] and o["hidden"][0] in known]
    if not singles:
        return []
    rows = []
    for cause, at in known.items():
        held = [o for o in singles if o["hidden"] == [cause]]
        if held:
            rows.append(row(cause, held, at))
    of_all = [together(column) for column in zip(*(known[o["hidden"][0]] for o in singles))]
    return rows + [row("all", singles, of_all)]


def together(each):
    """d at which nine in ten are seen of cases that each are seen nine times in ten at a distance of its own: an oracle
    sees one at d with Φ(d - d90 + 1.28)."""
    counts = collections.Counter(each)
    low, high = min(counts), max(counts)
    for _ in range(60):
        middle = 0.5 * (low + high)
        seen = sum(count * 0.5 * math.erfc(-(middle - d90_of_one + NINE_IN_TEN) / math.sqrt(2))
                   for d90_of_one, count in counts.items())
        low, high = (middle, high) if seen < 0.9 * len(each) else (low, middle)
    return 0.5 * (low + high)


def row(title, outcomes, oracle_d90):
    middle, low, high = d90(seen_of(outcomes))
    most = D50[1]
    shown = f"{middle:.1f} [{low:.1f}, {high:.1f}]" if high < most else f"{middle:.1f} [{low:.1f}, -]"
    return [title, len(outcomes), shown, *(f"{at:.1f}" for at in oracle_d90), *(f"{at / middle:.2f}" for at in oracle_d90)]


def against_oracle(outcomes):
    rows = efficiencies(outcomes)
    if not rows:
        return ""
    healthy = within(outcomes, "healthy")
    alarms = sum(map(detected, healthy))
    return (f"d that is called anything but none nine times in ten, with its 95 % interval, at the false alarm that the "
            f"answers have ({alarms} of {len(healthy)} healthy), beside that of two observers who know noise and every "
            "law and pay for the same search, at false alarms of 1 % and 0.1 %: one is told the population of good valves "
            "(oracle.h), the other knows in which quantities they differ and learns how far from eight of them, as the "
            "answers do (learning_oracle.h). Efficiency is theirs over the answers'.\n\n"
            + table(["cause", "cases", "d at 90 %", *(f"{which}, {alarm}" for which in (
                "told", "learning", "efficiency, told", "efficiency, learning") for alarm in ALARMS)], rows))
