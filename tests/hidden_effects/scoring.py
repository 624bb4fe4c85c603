"""What an analysis of a case is worth, given the truth; and the figures of many.

An outcome in one word:
  right           what was asked: none; the cause or both causes and no other; unexplained for an effect of no cause
  right_set       the truth is inside {cause, alternatives} without being settled
  half            of a pair one cause is named, and nothing wrong beside it
  extra           the truth is named, and something that is not there
  wrong           named, and the truth is not among the names
  wrong_set       ambiguous, and the truth is not inside
  missed          none, though something is hidden
  unexplained     unexplained, though a cause explains it
  doubted         a healthy valve is called ambiguous or unexplained
  no_answer       the analysis has no discrepancy
  failed          the analysis ended with an error
"""
import collections
import math
import statistics

from engines import Failed

CONFIDENT = 0.95


CONCLUSIONS = ("none", "named", "ambiguous", "unexplained")


def trimmed(analysis):
    """What is scored of an answer; what another program leaves out is empty. Raises Failed where it is not of the
    contract's form."""
    try:
        found = analysis.get("discrepancy")
        return scored_part(found) if found else None
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise Failed(f"the answer is not of the contract's form: {error!r}") from None


def scored_part(found):
    if found["conclusion"] not in CONCLUSIONS:
        raise ValueError(f"conclusion '{found['conclusion']}'")
    next_test = found.get("next_test")
    return {
        "conclusion": found["conclusion"],
        "causes": [{"cause": cause["cause"], "probability": float(cause["probability"]),
                    "alternatives": list(cause.get("alternatives", [])),
                    "parameters": {name: {"value": one["value"], "ci95": list(one["ci95"])}
                                   for name, one in cause.get("parameters", {}).items()}}
                   for cause in found.get("causes", [])],
        "candidates": [{"cause": candidate["cause"], "probability": float(candidate["probability"])}
                       for candidate in found.get("candidates", []) if candidate["probability"] > 1e-4],
        "transfer": (found.get("gain") or found).get("transfer", []),  # a kept answer has it beside the causes
        "next_test": next_test and {name: next_test[name] for name in ("test", "expected_probability", "separates")},
    }


def judge(case, analysis, truth):
    """The outcome of one case; `analysis` is None where it failed."""
    hidden = [name for name, _ in case.effects]
    outcome = {"case": case.case, "kind": case.kind, "hidden": hidden, "sizes": [size for _, size in case.effects],
               "decoy": case.decoys[0][0] if case.decoys else "", "d": none_if_nan(case.d),
               "d_weaker": none_if_nan(case.d_weaker), "d_name": none_if_nan(case.d_name), "rival": case.rival,
               "oracle_set": none_if_nan(case.oracle_set),
               "conclusion": None, "said": [], "confident_wrong": False, "set_size": None, "truth_inside": False,
               "parameters": [], "top_candidates": [], "closed_share": None, "seconds": None, "failure": None}
    if analysis is None:
        return outcome | {"outcome": "failed"}
    found = trimmed(analysis)
    if not found:
        return outcome | {"outcome": "no_answer"}
    causes = found["causes"]
    named = [cause["cause"] for cause in causes]
    alternatives = {cause["cause"]: cause["alternatives"] for cause in causes}
    offered = set(named).union(*alternatives.values()) if causes else set()
    vocabulary = [] if case.kind == "outside" else hidden
    confident_wrong = [cause["cause"] for cause in causes
                       if cause["cause"] not in vocabulary and cause["probability"] >= CONFIDENT]
    outcome |= {
        "conclusion": found["conclusion"],
        "said": [[cause["cause"], cause["probability"], cause["alternatives"]] for cause in causes],
        "confident_wrong": bool(confident_wrong),
        "set_size": max([1 + len(rivals) for rivals in alternatives.values()], default=0),
        "truth_inside": bool(vocabulary) and set(vocabulary) <= offered,
        "parameters": parameter_lines(causes, truth),
        "top_candidates": [[c["cause"], c["probability"]] for c in
                           sorted(found["candidates"], key=lambda c: -c["probability"])[:4]],
    }
    return outcome | {"outcome": word(case.kind, found["conclusion"], set(named), set(vocabulary), outcome)}


def none_if_nan(value):
    return None if math.isnan(value) else value


def word(kind, conclusion, named, vocabulary, outcome):
    if kind == "healthy":
        return {"none": "right", "named": "wrong"}.get(conclusion, "doubted")
    if conclusion == "none":
        return "missed"
    if kind == "outside":
        return {"unexplained": "right", "named": "wrong"}.get(conclusion, "wrong_set")
    if conclusion == "unexplained":
        return "unexplained"
    if conclusion == "ambiguous":
        return "right_set" if outcome["truth_inside"] else "wrong_set"
    if named == vocabulary:
        return "right"
    if vocabulary < named:
        return "extra"
    return "half" if named and named < vocabulary else "wrong"


def parameter_lines(causes, truth):
    """[cause, parameter, true value, estimate, inside the interval] of every true cause that stands in the answer."""
    lines = []
    for hidden in truth["effects"]:
        for cause in causes:
            if cause["cause"] != hidden["effect"]:
                continue
            for name, true in hidden["parameters"].items():
                estimate = cause["parameters"].get(name.split(" of ")[0])
                if estimate and isinstance(estimate["value"], (int, float)):
                    low, high = estimate["ci95"]
                    inside = low is not None and high is not None and low <= true["value"] <= high
                    lines.append([cause["cause"], name, true["value"], estimate["value"], inside])
    return lines


def figures(outcomes):
    """The marks' figures. Shares are null where no case asks for them; d_name is asked for only where it is known."""
    def of(*kinds):
        return [o for o in outcomes if o["kind"] in kinds]

    answered = [o for o in outcomes if o["outcome"] not in ("no_answer", "failed")]
    sets = of("close", "step_up")
    sized = [o for o in sets if o["truth_inside"] and o["oracle_set"] is not None]
    closed = [o["closed_share"] for o in outcomes if o["closed_share"] is not None and o["kind"] == "single"]
    covered = [line[4] for o in outcomes for line in o["parameters"]]
    seconds = [o["seconds"] for o in outcomes if o["seconds"] is not None]
    return {
        "cases": len(outcomes),
        "answered_share": share(answered, outcomes),
        "single_right": share_right(of("single")),
        "pair_right": share_right(of("pair")),
        "wrong_name_confident": share([o for o in outcomes if o["confident_wrong"]], outcomes),
        "healthy_none": share_right(of("healthy")),
        "outside_named_confident": share([o for o in of("outside") if o["confident_wrong"]], of("outside")),
        "outside_unexplained": share_right(of("outside")),
        "set_holds_truth": share([o for o in sets if o["truth_inside"]], sets),
        "set_size_above_oracle": (statistics.fmean(o["set_size"] - o["oracle_set"] for o in sized) if sized else None),
        "closed_share_median": statistics.median(closed) if closed else None,
        "parameter_coverage": share([c for c in covered if c], covered),
        "seconds_median": statistics.median(seconds) if seconds else None,
        "seconds_largest": max(seconds, default=None),
    }


def share(part, whole):
    return len(part) / len(whole) if whole else None


def share_right(outcomes):
    return share([o for o in outcomes if o["outcome"] == "right"], outcomes)


# figure: (mark, whether larger is better)
MARKS = {
    "single_right": (0.97, True),
    "pair_right": (0.85, True),
    "wrong_name_confident": (0.01, False),
    "healthy_none": (0.99, True),
    "outside_named_confident": (0.0, False),
    "set_holds_truth": (0.95, True),
    "set_size_above_oracle": (1.0, False),
    "closed_share_median": (0.95, True),
    "seconds_largest": (3.0, False),
}


def worse_than(floors, reached):
    """Sentences on every figure that is worse than its floor. A figure that no answer gives meets no floor but null."""
    complaints = []
    for name, floor in floors.items():
        larger_is_better = MARKS.get(name, (None, True))[1]
        value = reached.get(name)
        if floor is None:
            continue
        if value is None or (value < floor - 1e-9 if larger_is_better else value > floor + 1e-9):
            complaints.append(f"{name} is {value}, the floor is {floor}")
    return complaints


def confusion(outcomes):
    """{hidden effect or 'healthy': Counter of what was said}: names joined by +, a tilde marks an unsettled one."""
    table = collections.defaultdict(collections.Counter)
    for outcome in outcomes:
        table["+".join(outcome["hidden"]) or "healthy"][said_text(outcome)] += 1
    return table


def said_text(outcome):
    if outcome["outcome"] in ("no_answer", "failed"):
        return outcome["outcome"]
    if not outcome["said"]:
        return outcome["conclusion"]
    text = "+".join(sorted(cause + ("~" if rivals else "") for cause, _, rivals in outcome["said"]))
    return text if outcome["conclusion"] in ("named", "ambiguous") else f"{outcome['conclusion']}({text})"


D_BINS = (0, 2, 4, 8, 16, 32, 64, 128, math.inf)


def plane(outcomes):
    """{(bin of d, bin of d_name): [named right, truth inside, cases]} over cases of one hidden cause."""
    table = collections.defaultdict(lambda: [0, 0, 0])
    for outcome in outcomes:
        if len(outcome["hidden"]) != 1 or outcome["kind"] == "outside" or outcome["d_name"] is None:
            continue
        cell = table[bin_of(outcome["d"]), bin_of(outcome["d_name"])]
        cell[0] += outcome["outcome"] == "right"
        cell[1] += outcome["truth_inside"]
        cell[2] += 1
    return table


def bin_of(value):
    return max(i for i, low in enumerate(D_BINS[:-1]) if value >= low)
