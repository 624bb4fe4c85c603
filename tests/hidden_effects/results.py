"""RESULTS.md: what a full run has found, from the lines that it left."""
import dataclasses

import playing
import reporting
import scoring
import tables


@dataclasses.dataclass
class Found:
    command: str
    seed: int
    engine: str
    engine_sha: str
    stand_sha: str
    effects: dict   # the stand's repertoire by name
    outcomes: list
    loops: list     # of (case, line of the answer, line of the closed loop)
    studies: dict   # {part: {title: outcomes}}


def outcome_of(case, line):
    """The outcome of a case from its line; scored anew each time, so that the scorer may change without a new analysis."""
    analysis = None if line["failure"] else {"discrepancy": line["answer"]}
    outcome = scoring.judge(case, analysis, line["truth"])
    held_out = line["held_out"]
    return outcome | {
        "closed_share": playing.share_closed(held_out), "held_out": held_out,
        "seconds": line["seconds"], "failure": line["failure"], "truth": line["truth"],
        "transfer": (line["answer"] or {}).get("transfer", [])}


def markdown(found):
    outcomes = found.outcomes
    main = [
        ("Healthy", tables.healthy(outcomes)),
        ("Faulty, by d", tables.by_distance(outcomes, "d")),
        ("Faulty, by d_name", tables.by_distance(outcomes, "d_name")),
        ("The plane of the two distances", fenced(reporting.plane_table(outcomes))),
        ("By cause", tables.by_cause(outcomes, found.effects)),
        ("Confusion of families", tables.family_confusion(outcomes, found.effects)),
        ("Confusion of causes", tables.cause_confusion(outcomes, found.effects)),
        ("Calibration", tables.calibrated(outcomes)),
        ("Sets", tables.sets(outcomes)),
        ("Parameters", tables.parameters(outcomes)),
        ("Closed share", tables.closed(outcomes)),
        ("Transfer to another kind of test", tables.transfer(outcomes)),
        ("Closing the loop", tables.loops(found.loops)),
        ("Test and retest", tables.retest(outcomes, found.studies["retest"])),
        ("References", tables.references(outcomes, found.studies["references"])),
        ("Peers on the same cases", tables.peers(outcomes, found.studies["peers"])),
        ("Cost", tables.cost(outcomes)),
        ("What went wrong", tables.troubles(outcomes)),
    ]
    parts = [heading(found)] + [f"## {title}\n\n{text}\n" for title, text in main if text]
    return "\n".join(parts)


def heading(found):
    healthy = sum(outcome["kind"] == "healthy" for outcome in found.outcomes)
    return (f"# Hidden effects: what was found\n\n```\n{found.command}\n```\n\n"
            f"Seed {found.seed}; {healthy} healthy and {len(found.outcomes) - healthy} faulty sessions; engine "
            f"`{found.engine}`, sha256 `{found.engine_sha[:16]}`; stand `{found.stand_sha[:16]}`. Shares carry exact 95 % "
            f"bounds (Clopper and Pearson); `-` was not asked of any case.\n")


def fenced(lines):
    return "\n".join(["```", *lines, "```"])
