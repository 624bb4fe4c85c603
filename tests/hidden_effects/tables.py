"""The tables of RESULTS.md, each a text from the outcomes of cases; empty where there is nothing to tell."""
import collections
import math
import statistics

import calibration
import scoring
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


def shown(value, digits=3):
    return "-" if value is None else f"{value:.{digits}g}"


def healthy(outcomes):
    groups = collections.defaultdict(list)
    for outcome in within(outcomes, "healthy"):
        groups[outcome["decoy"] or "plain"].append(outcome)
        groups["all"].append(outcome)
    names = sorted(groups, key=lambda name: (name == "all", name))
    return table(["healthy valve with", "called none", "doubted", "named", "named at 0.95 or more"],
                 [[name, count(groups[name], is_right), sum(o["outcome"] == "doubted" for o in groups[name]),
                   sum(o["outcome"] == "wrong" for o in groups[name]),
                   sum(o["confident_wrong"] for o in groups[name])] for name in names])


def by_distance(outcomes, distance):
    rows = []
    for title, kinds in (("one cause", ("single",)), ("pair", ("pair",)), ("outside", ("outside",))):
        for low, high in zip(BINS, BINS[1:]):
            held = [o for o in within(outcomes, *kinds) if o[distance] is not None and low <= o[distance] < high]
            if held and (distance == "d" or kinds != ("outside",)):
                rows.append([title, f"{low:g} to {high:g}", count(held, detected), count(held, is_right),
                             "-" if kinds == ("outside",) else count(held, lambda o: o["truth_inside"]),
                             sum(o["outcome"] == "unexplained" for o in held),
                             count(held, lambda o: o["confident_wrong"])])
    if not rows:
        return ""
    return ("Right: the cause or both causes named and no other; for an effect outside the vocabulary, unexplained.\n\n"
            + table(["hidden", distance, "detected", "right", "truth inside the answer", "unexplained",
                     "a wrong name at 0.95 or more"], rows))


def by_cause(outcomes, effects):
    rows = []
    for name in effects:
        held = [o for o in outcomes if o["hidden"] == [name] and o["kind"] in ("single", "outside")]
        clear = [o for o in held if o["d"] is None or o["d"] >= SHOWS_D]
        nameable = [o for o in held if (o["d_name"] or 0) >= SHOWS_D]
        if held:
            rows.append([name, count(held, detected), count(clear, detected), count(clear, is_right),
                         count(nameable, is_right), sum(o["confident_wrong"] for o in held)])
    return table(["cause", "detected", "detected, d ≥ 8", "right, d ≥ 8", "right, d_name ≥ 8", "wrong names"], rows)


def confusion(rows, columns, cell):
    """`rows` and `columns` are names; empty cells are left blank, columns that nobody said are left out."""
    told = [column for column in columns if any(cell(row, column) for row in rows)]
    return table(["hidden \\ said", *told], [[row, *[cell(row, column) or "" for column in told]] for row in rows])


def first_said(outcome):
    """The first cause of the answer, or the conclusion where it holds none."""
    if outcome["conclusion"] in ("named", "ambiguous") and outcome["said"]:
        return outcome["said"][0][0]
    return outcome["conclusion"] or outcome["outcome"]


def said_columns(names):
    return [*names, "unexplained", "none", "no_answer", "failed"]


def cause_confusion(outcomes, effects):
    cells = collections.Counter(("healthy" if o["kind"] == "healthy" else o["hidden"][0], first_said(o))
                                for o in within(outcomes, "healthy", "single", "outside"))
    rows = [name for name in ["healthy", *effects] if any(row == name for row, _ in cells)]
    causes = [name for name, effect in effects.items() if not effect.outside]
    return ("The first cause of an answer, settled or not; none or one effect hidden.\n\n"
            + confusion(rows, said_columns(causes), lambda row, column: cells[row, column])) if rows else ""


def family_confusion(outcomes, effects):
    def family(name):
        return effects[name].family if name in effects else name

    cells = collections.Counter(("healthy" if o["kind"] == "healthy" else family(o["hidden"][0]), family(first_said(o)))
                                for o in within(outcomes, "healthy", "single", "outside"))
    families = list(dict.fromkeys(effect.family for effect in effects.values()))
    rows = [name for name in ["healthy", *families] if any(row == name for row, _ in cells)]
    return confusion(rows, said_columns(families), lambda row, column: cells[row, column]) if rows else ""


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
            + "\n\nThe most probable candidate, by its probability:\n\n" + diagram(of_answers)
            + "\n\nA cause of the answer, by its probability:\n\n" + diagram(of_causes))


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
    held = [o for o in outcomes if o["closed_share"] is not None]
    asked = sum(o["held_out"] is not None for o in outcomes)
    if not asked:
        return ""
    rows = [[o["case"], o["hidden"][0], shown(o["d"]), o["held_out"]["recording"], shown(o["held_out"]["baseline"]),
             shown(o["held_out"]["extended"]), f"{o['closed_share']:.3f}"]
            for o in sorted(held, key=lambda o: o["closed_share"])]
    middle = f"; median closed share {statistics.median(o['closed_share'] for o in held):.3f}" if held else ""
    return (f"One cause with d ≥ 30, a recording held out, both models fitted to the others: {asked} cases, in {len(held)} "
            f"of them the baseline leaves more than the stand's noise there{middle}. Errors in psi against the noise-free "
            "output.\n\n" + table(["case", "cause", "d", "held out", "baseline", "extended", "closed share"], rows))


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


def comparison(title, outcomes):
    clear = [o for o in outcomes if o["kind"] != "healthy" and (o["d"] or 0) >= SHOWS_D]
    return [title, count(within(outcomes, "healthy"), is_right), count(clear, detected),
            count(within(clear, "single"), is_right), count(within(clear, "outside"), is_right),
            count(outcomes, lambda o: o["confident_wrong"])]


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


def cost(outcomes):
    seconds = sorted(o["seconds"] for o in outcomes if o["seconds"] is not None)
    if not seconds:
        return ""
    def quantile(share):
        return seconds[min(int(share * len(seconds)), len(seconds) - 1)]
    return (f"Processor seconds of an analysis, one thread: median {quantile(0.5):.1f}, nine of ten below "
            f"{quantile(0.9):.1f}, most {seconds[-1]:.1f}; {math.fsum(seconds) / 3600:.2f} hours for {len(seconds)} "
            "sessions. A result does not say how many simulations it took, so they are not counted.")


TROUBLES = ("wrong", "extra", "wrong_set", "no_answer", "failed")


def troubles(outcomes):
    """Cases whose answer misleads, and how the stand plays them."""
    rows = []
    for o in outcomes:
        clear = (o["d"] or 0) >= 2 * SHOWS_D and o["outcome"] in ("missed", "unexplained", "half")
        if o["outcome"] in TROUBLES or clear or (o["kind"] == "healthy" and not is_right(o)):
            hidden = " ".join(f"{name}={size:.6g}" for name, size in zip(o["hidden"], o["sizes"])) or o["decoy"] or "plain"
            rows.append([o["case"], hidden, shown(o["d"]), shown(o["d_name"]), o["outcome"],
                         scoring.said_text(o), o["failure"] or ""])
    if not rows:
        return ""
    return ("Answers that mislead, and what is clear (d ≥ 16) and was missed. `tests/hidden_effects/full --play CASE "
            "--out DIR` writes the recordings of one.\n\n"
            + table(["case", "hidden", "d", "d_name", "outcome", "said", ""], rows))
