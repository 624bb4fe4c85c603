"""Tables of what is seen and named: healthy, by distance, by cause, confusion; empty where there is nothing to tell."""
import collections

import scoring
from tables import SHOWS_D, by_bin, count, detected, first_said, is_right, shown, table, within


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
        for span, held in by_bin(within(outcomes, *kinds), distance):
            if held and (distance == "d" or kinds != ("outside",)):
                rows.append([title, span, count(held, detected), count(held, is_right),
                             "-" if kinds == ("outside",) else count(held, lambda o: o["truth_inside"]),
                             sum(o["outcome"] == "unexplained" for o in held),
                             count(held, lambda o: o["confident_wrong"])])
    if not rows:
        return ""
    return ("Right: the cause or both causes named and no other; for an effect outside the vocabulary, unexplained.\n\n"
            + table(["hidden", distance, "detected", "right", "truth inside the answer", "unexplained",
                     "a wrong name at 0.95 or more"], rows))


def by_weaker(outcomes):
    """A pair can be named where both of its causes show."""
    rows = [[span, count(held, is_right), count(held, lambda o: o["outcome"] == "half"),
             count(held, lambda o: o["truth_inside"]), count(held, lambda o: o["confident_wrong"])]
            for span, held in by_bin(within(outcomes, "pair"), "d_weaker") if held]
    return table(["d of the weaker cause", "both named", "one named", "truth inside the answer",
                  "a wrong name at 0.95 or more"], rows)


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
