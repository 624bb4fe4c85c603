"""RESULTS.md: what a full run has found, from the lines that it left."""
import dataclasses

import answer_tables
import comparison_tables
import detection_tables
import playing
import power
import reporting
import scoring


@dataclasses.dataclass
class Found:
    command: str
    seed: int
    asked: int      # cases that were drawn
    engine: str
    engine_sha: str
    stand_sha: str
    effects: dict   # the stand's repertoire by name
    outcomes: list
    loops: list     # of (case, line of the answer, line of the closed loop)
    studies: dict   # {part: {title: outcomes}}


def outcome_of(case, line, held_out=None):
    """The outcome of a case from its line, and from that of a recording held out; scored anew each time, so that the
    scorer may change without a new analysis."""
    analysis = None if line["failure"] else {"discrepancy": line["answer"]}
    outcome = scoring.judge(case, analysis, line["truth"])
    held_out = held_out or {"errors": None, "failure": None}
    return outcome | {
        "closed_share": playing.share_closed(held_out["errors"]), "held_out": held_out["errors"],
        "seconds": line["seconds"], "failure": line["failure"] or held_out["failure"], "truth": line["truth"],
        "transfer": (line["answer"] or {}).get("transfer", [])}


def markdown(found):
    outcomes = found.outcomes
    main = [
        ("Healthy", detection_tables.healthy(outcomes)),
        ("Faulty, by d", detection_tables.by_distance(outcomes, "d")),
        ("Pairs, by d of the weaker cause", detection_tables.by_weaker(outcomes)),
        ("Faulty, by d_name", detection_tables.by_distance(outcomes, "d_name")),
        ("The plane of the two distances", fenced(reporting.plane_table(outcomes))),
        ("Beside the oracle", power.against_oracle(outcomes)),
        ("By cause", detection_tables.by_cause(outcomes, found.effects)),
        ("Confusion of families", detection_tables.family_confusion(outcomes, found.effects)),
        ("Confusion of causes", detection_tables.cause_confusion(outcomes, found.effects)),
        ("Calibration", answer_tables.calibrated(outcomes)),
        ("Sets", answer_tables.sets(outcomes)),
        ("Parameters", answer_tables.parameters(outcomes)),
        ("Closed share", answer_tables.closed(outcomes)),
        ("Transfer to another kind of test", answer_tables.transfer(outcomes)),
        ("Closing the loop", comparison_tables.loops(found.loops)),
        ("Test and retest", comparison_tables.retest(outcomes, found.studies["retest"])),
        ("References", comparison_tables.references(outcomes, found.studies["references"])),
        ("Peers on the same cases", comparison_tables.peers(outcomes, found.studies["peers"])),
        ("Cost", answer_tables.cost(outcomes)),
        ("What went wrong", detection_tables.troubles(outcomes)),
    ]
    parts = [heading(found)] + [f"## {title}\n\n{text}\n" for title, text in main if text]
    return "\n".join(parts)


def heading(found):
    healthy = sum(outcome["kind"] == "healthy" for outcome in found.outcomes)
    faulty = len(found.outcomes) - healthy
    return (f"# Hidden effects: what was found\n\n```\n{found.command}\n```\n\n"
            f"Seed {found.seed}; {len(found.outcomes)} of {found.asked} sessions are answered, {healthy} healthy and {faulty} "
            f"faulty, d_name is known of {sum(o['d_name'] is not None for o in found.outcomes)}; engine `{found.engine}`, sha256 `{found.engine_sha[:16]}`; stand `{found.stand_sha[:16]}`. Shares carry "
            "exact 95 % bounds (Clopper and Pearson); `-` was not asked of any case.\n")


def fenced(lines):
    return "\n".join(["```", *lines, "```"])
