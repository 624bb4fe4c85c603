"""What is done with a case: one small line of what was hidden, what was answered and what it cost."""
import dataclasses
import json
import math
import shutil

import cases as drawing
import playing
from engines import Failed, hash_of, run
from measuring import Distances
from scoring import trimmed

running = {}  # programs of distances by their command, of one worker process


def distance_key(program_sha, case, name_too):
    return hash_of(program_sha, case.tests, case.unit_seed, case.noise_seed, case.effects, name_too)[:20]


def distances_line(key, program, case, name_too):
    """d of a case, of a pair also that of its weaker cause, and d_name where it is asked for (it costs several times as
    much)."""
    if program not in running:
        running[program] = Distances(*program)
    found = running[program].measure(dataclasses.replace(case), "any" if name_too else "detect")
    line = {"key": key, "d": found.d}
    if len(case.effects) > 1:
        line["d_weaker"] = running[program].weaker(case)
    if name_too:
        line |= {"d_name": found.d_name, "rival": found.rival, "oracle_set": found.oracle_set}
    return line


def with_distances(case, line):
    """The case with what is known of its distances."""
    if not line:
        return case
    return dataclasses.replace(case, d=line["d"], d_weaker=line.get("d_weaker", math.nan),
                               d_name=line.get("d_name", math.nan), rival=line.get("rival", ""), oracle_set=line.get("oracle_set", math.nan))


def answer_line(key, bench, case):
    """The analysis of a case. The test that it asks for is kept: to close the loop nothing is asked a second time."""
    line = {"key": key, "case": case.case, "answer": None, "truth": {"effects": []}, "seconds": None, "failure": None}
    try:
        with bench.played(case) as (recordings, sealed):
            line["truth"] = truth_of(sealed)
            analysis, line["seconds"] = bench.engine.analyse(case, recordings, bench.reference)
            line["answer"] = trimmed(analysis)
            if line["answer"] and line["answer"]["next_test"]:
                bench.keep_next_test(case, analysis["discrepancy"]["next_test"])
    except Failed as failure:
        line["failure"] = str(failure)
    return line


def held_out_line(key, bench, case):
    """What the models of an analysis leave in a recording that they never saw."""
    line = {"key": key, "case": case.case, "errors": None, "failure": None}
    try:
        with bench.played(case) as (recordings, sealed):
            line["errors"] = playing.held_out_errors(bench, case, recordings, sealed / "clean")
    except Failed as failure:
        line["failure"] = str(failure)
    return line


def loop_line(key, bench, case):
    """The stand plays the test that an ambiguous answer asks for; the session is analysed again with it. The same valve
    on the same day; what happens once in a session may happen in this recording too."""
    line = {"key": key, "case": case.case, "answer": None, "asked": None, "failure": None}
    try:
        with bench.played(case) as (recordings, _):
            line["asked"] = bench.kept_next_test(case)
            if line["asked"] is None:
                before, _ = bench.engine.analyse(case, recordings, bench.reference)
                line["asked"] = before["discrepancy"]["next_test"]
            if "input_csv" not in (line["asked"] or {}):
                raise Failed("asked once more, the answer has no next test with an input_csv")
            wanted = recordings.with_name(recordings.name + ".next_test.csv")
            played = recordings.with_name(recordings.name + ".played")
            try:
                wanted.write_text(line["asked"].pop("input_csv"))
                once_more = dataclasses.replace(case, tests="none")
                run(bench.stand, *once_more.stand_arguments(), "--input", wanted, "--out", played)
                for recording in played.glob("*.csv"):
                    recording.rename(recordings / f"next_test-{recording.name}")
            finally:
                wanted.unlink(missing_ok=True)
                shutil.rmtree(played, ignore_errors=True)
            after, _ = bench.engine.analyse(case, recordings, bench.reference)
            line["answer"] = trimmed(after)
    except Failed as failure:
        line["failure"] = str(failure)
    bench.forget_next_test(case)
    return line


def another_day(case):
    """The same valve with the same fault recorded again: other noise, other history. What an effect draws beside its size
    (sign, frequency, instant) is drawn anew by the stand."""
    return dataclasses.replace(case, noise_seed=drawing.Draws(case.noise_seed, "another day").seed())


def truth_of(sealed):
    effects = json.loads((sealed / "truth.json").read_text())["effects"]
    return {"effects": [{"effect": one["effect"], "parameters": one["parameters"]} for one in effects]}
