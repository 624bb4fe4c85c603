"""Tables of answers beside other answers: after the next test, on another day, by other references, by other programs."""
import collections
import statistics

import calibration
import scoring
from answer_tables import diagram
from binomial import rate
from tables import BINS, SHOWS_D, count, detected, first_said, is_right, shown, table, within


def loops(found):
    """`found`: (case, line of the answer, line of the closed loop)."""
    if not found:
        return ""
    settled, forecasts, rows = [], [], collections.Counter()
    for case, before, line in found:
        analysis = None if line["failure"] else {"discrepancy": line["answer"]}
        after = scoring.judge(case, analysis, {"effects": []})
        rows[scoring.judge(case, {"discrepancy": before["answer"]}, {"effects": []})["outcome"], after["outcome"]] += 1
        settled.append(is_right(after))
        if line["asked"]:
            forecasts.append((line["asked"]["expected_probability"], is_right(after)))
    return (f"Settled right: {rate(sum(settled), len(settled))}. `expected_probability`: Brier score "
            f"{shown(calibration.brier(forecasts))}, expected calibration error "
            f"{shown(calibration.expected_error(forecasts))}.\n\n" + diagram(forecasts) + "\n\n"
            + table(["before", "after", "cases"], [[*words, n] for words, n in sorted(rows.items())]))


def same_conclusion(one, other):
    return one["conclusion"] == other["conclusion"] and first_said(one) == first_said(other)


def retest(outcomes, studies):
    first = {outcome["case"]: outcome for outcome in outcomes}
    rows = []
    for title, others in studies.items():
        pairs = [(first[other["case"]], other) for other in others if other["case"] in first]
        for part, test in (("all", lambda o: True), ("d ≥ 8", lambda o: (o["d"] or 0) >= SHOWS_D),
                           ("d_name ≥ 8", lambda o: (o["d_name"] or 0) >= SHOWS_D)):
            held = [pair for pair in pairs if test(pair[0])]
            if held:
                rows.append([title, part, rate(sum(same_conclusion(*pair) for pair in held), len(held)),
                             rate(sum(is_right(one) and is_right(other) for one, other in held), len(held))])
    return table(["recorded again on", "valves", "same conclusion and first cause", "right both times"], rows)


def references(outcomes, studies):
    if not studies:
        return ""
    cases = {outcome["case"] for others in studies.values() for outcome in others}
    rows = [comparison(title, held) for title, held in
            [("8 good valves", [o for o in outcomes if o["case"] in cases]), *studies.items()] if held]
    return table(COMPARED, rows)


COMPARED = ["", "healthy called none", "detected, d ≥ 8", "one cause right, d ≥ 8", "outside unexplained, d ≥ 8",
            "a wrong name at 0.95 or more"]


def peers(outcomes, studies):
    """Detection by d, and what each can say of the cause, on the cases that all have answered."""
    if not studies:
        return ""
    together = set.intersection(*[{o["case"] for o in held} for held in [outcomes, *studies.values()]])
    programs = {title: [o for o in held if o["case"] in together]
                for title, held in [("valvetriage", outcomes), *studies.items()]}
    detection = []
    for low, high in zip(BINS, BINS[1:]):
        row = [f"{low:g} to {high:g}"]
        for held in programs.values():
            faulty = [o for o in held if o["kind"] != "healthy" and o["d"] is not None and low <= o["d"] < high]
            row.append(count(faulty, detected))
        if set(row[1:]) != {"-"}:
            detection.append(row)
    said = [[title, count(within(held, "healthy"), detected), count(named(held), is_right),
             count(named(held), lambda o: o["truth_inside"]),
             shown(mean_size(held)), shown(statistics.median([o["seconds"] for o in held if o["seconds"] is not None]))]
            for title, held in programs.items() if held]
    return ("Share that each calls anything but none, by d:\n\n" + table(["d", *programs], detection)
            + "\n\nWhat else it can say, where one cause is hidden with d ≥ 8:\n\n"
            + table(["", "false alarms", "cause named right, alone", "cause inside the answer", "mean size of the answer",
                     "processor seconds, median"], said))


def named(outcomes):
    return [o for o in within(outcomes, "single") if (o["d"] or 0) >= SHOWS_D]


def mean_size(outcomes):
    sizes = [o["set_size"] for o in named(outcomes) if o["set_size"]]
    return statistics.fmean(sizes) if sizes else None


def comparison(title, outcomes):
    clear = [o for o in outcomes if o["kind"] != "healthy" and (o["d"] or 0) >= SHOWS_D]
    return [title, count(within(outcomes, "healthy"), is_right), count(clear, detected),
            count(within(clear, "single"), is_right), count(within(clear, "outside"), is_right),
            count(outcomes, lambda o: o["confident_wrong"])]
