"""Tables of what an answer holds: probabilities, sets, parameters, models, cost; empty where there is nothing to tell."""
import collections
import math
import statistics

import calibration
import playing
from binomial import rate
from scoring import MARKS
from tables import count, is_right, shown, table, within


def calibrated(outcomes):
    of_answers = [forecast for outcome in outcomes for forecast in calibration.most_probable(outcome)]
    of_causes = [forecast for outcome in outcomes for forecast in calibration.of_causes(outcome)]
    rows = []
    for title, forecasts in (("the most probable candidate", of_answers), ("a cause of the answer", of_causes)):
        for part, held in (("all", forecasts), ("0.5 to 0.95", calibration.doubtful(forecasts))):
            if held:
                rows.append([title, part, len(held), shown(calibration.brier(held)),
                             shown(calibration.expected_error(held))])
    if not rows:
        return ""
    return (table(["probability of", "range", "forecasts", "Brier score", "expected calibration error"], rows)
            + "".join(f"\n\n{title}, by its probability:\n\n{diagram(forecasts)}" for title, forecasts in
                      (("The most probable candidate", of_answers), ("A cause of the answer", of_causes)) if forecasts))


def diagram(forecasts):
    """Share that came true over mean probability: `#` up to the share, `|` where the probability stands."""
    rows = []
    for n, mean, true in calibration.reliability(forecasts):
        bar = ["#" if place < round(40 * true / n) else "·" for place in range(41)]
        bar[round(40 * mean)] = "|"
        rows.append([f"{mean:.3f}", rate(true, n), f"`{''.join(bar)}`"])
    return table(["mean probability", "came true", "0 to 1"], rows)


def sets(outcomes):
    rows = []
    for title, held in (("ambiguous", [o for o in outcomes if o["conclusion"] == "ambiguous"]),
                        ("ambiguous, one cause hidden, d_name < 4", [
                            o for o in within(outcomes, "single") if o["conclusion"] == "ambiguous"
                            and o["d_name"] is not None and o["d_name"] < 4])):
        if held:
            known = [o for o in held if o["oracle_set"] is not None]
            rows.append([title, len(held), shown(statistics.fmean(o["set_size"] for o in held)),
                         max(o["set_size"] for o in held),
                         shown(statistics.fmean(o["oracle_set"] for o in known)) if known else "-",
                         count(held, lambda o: o["truth_inside"])])
    return table(["answers", "number", "mean size", "largest", "mean size of the oracle's", "truth inside"], rows)


def parameters(outcomes):
    """Without conditioning on the name: every hidden number of a cause, whatever was concluded."""
    stated = collections.defaultdict(list)
    hidden = collections.Counter()
    for outcome in within(outcomes, "single", "pair"):
        for effect in outcome["truth"]["effects"]:
            for name in effect["parameters"]:
                hidden[f"{effect['effect']} {name}"] += 1
        for cause, name, true, estimate, inside in outcome["parameters"]:
            stated[f"{cause} {name}"].append((estimate / true - 1 if true else estimate, inside))
    rows = []
    for name in [*sorted(stated), "all"]:
        held = stated[name] if name != "all" else sum((stated[other] for other in sorted(stated)), [])
        total = hidden[name] if name != "all" else sum(hidden.values())
        if held:
            rows.append([name, total, len(held), "" if name == "all" else f"{statistics.median(e for e, _ in held):+.3f}",
                         rate(sum(inside for _, inside in held), len(held))])
    return table(["parameter", "hidden", "interval stated", "median relative error", "true value in the 95 % interval"],
                 rows)


def closed(outcomes):
    asked = [o for o in outcomes if o["held_out"] is not None]
    if not asked:
        return ""
    shares = [o["closed_share"] for o in asked if o["closed_share"] is not None]
    to_close = [playing.share_to_close(o["held_out"]) for o in asked]
    rows = [[o["case"], o["hidden"][0], shown(o["d"]), o["held_out"]["recording"],
             *(shown(o["held_out"].get(which)) for which in ("baseline", "extended", "good")),
             shown(o["closed_share"]), shown(most)] for o, most in zip(asked, to_close)]
    middle = f"; median closed share {statistics.median(shares):.3f}" if shares else ""
    known, mark = [most for most in to_close if most is not None], MARKS["closed_share_median"][0]
    if known:
        reached = sum(most >= mark for most in known)
        of_that = statistics.median(o["closed_share"] / most for o, most in zip(asked, to_close) if most)
        middle += (f". A model that left only what the baseline leaves of the same valve without the effect would close "
                   f"{statistics.median(known):.3f} in the median, {mark} or more in {reached} of "
                   f"{len(asked)}; of that the extension closes {of_that:.3f} in the median; in "
                   f"{len(asked) - len(known)} a good valve leaves as much as this one")
    return (f"One cause with d ≥ 30, a recording held out, both models fitted to the others: {len(asked)} cases, in "
            f"{len(shares)} of them the baseline leaves more than the stand's noise there{middle}. Errors in psi against "
            "the noise-free output.\n\n"
            + table(["case", "cause", "d", "held out", "baseline", "extended", "without the effect", "closed share",
                     "to be closed"], rows))


def transfer(outcomes):
    reductions = collections.defaultdict(list)
    for outcome in within(outcomes, "single", "pair"):
        for one in outcome["transfer"] if is_right(outcome) else ():
            if one["rmse_baseline"]:
                reductions[one["to"]].append(1 - one["rmse_extended"] / one["rmse_baseline"])
    rows = [[kind, len(held), f"{statistics.median(held):.3f}", f"{min(held):.3f}",
             rate(sum(value > 0 for value in held), len(held))] for kind, held in sorted(reductions.items())]
    if not rows:
        return ""
    return ("As the result states it, of answers that are right: fitted to the other kinds of test.\n\n"
            + table(["to", "answers", "median reduction of the error", "least", "reduced at all"], rows))


def cost(outcomes):
    seconds = sorted(o["seconds"] for o in outcomes if o["seconds"] is not None)
    if not seconds:
        return ""
    def quantile(share):
        return seconds[min(int(share * len(seconds)), len(seconds) - 1)]
    return (f"Processor seconds of an analysis, one thread: median {quantile(0.5):.1f}, nine of ten below "
            f"{quantile(0.9):.1f}, most {seconds[-1]:.1f}; {math.fsum(seconds) / 3600:.2f} hours for {len(seconds)} "
            "sessions. A result does not say how many simulations it took, so they are not counted.")
