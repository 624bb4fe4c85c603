"""One case from seed to outcome: the stand plays it, the product analyses the recordings, the scorer opens the truth.

The folder of a case holds its recordings; truth and noise-free outputs lie under another root, `sealed`, that is given
to the scorer alone. Both are removed when the case is scored; the analysis and the outcome stay, under a hash of the
product's binary, the stand's binary, the reference and the case, so that a rerun does only what has changed.
"""
import dataclasses
import hashlib
import json
import math
import os
import pathlib
import shutil
import subprocess

from scoring import judge

PARTS = pathlib.Path(__file__).parent
CLOSED_SHARE_D = 30.0
# In a recording that was not analysed these come with a phase or at an instant that nobody can know.
NOT_IN_OTHER_RECORDINGS = {"intermittent", "periodic_disturbance", "self_oscillation"}
SIDE_CHANNELS = ["--columns", "side=temperature_C,supply_psi"]
WARM_UP_SAMPLES = 200  # of a held-out recording: they set the initial state and are not scored


class Failed(Exception):
    pass


def run(*command, limit_s=600):
    """(standard output, processor seconds of this and no other child: one case at a time in a process); raises Failed
    with the messages."""
    before = os.times()
    try:
        done = subprocess.run([str(part) for part in command], capture_output=True, text=True, timeout=limit_s)
    except subprocess.TimeoutExpired:
        raise Failed(f"{pathlib.Path(command[0]).name} {command[1]} took more than {limit_s} s") from None
    after = os.times()
    if done.returncode != 0:
        raise Failed(f"{pathlib.Path(command[0]).name} {command[1]} ended with {done.returncode}: {done.stderr.strip()[-400:]}")
    return done.stdout, after.children_user + after.children_system - before.children_user - before.children_system


def hash_of(*parts):
    digest = hashlib.sha256()
    for part in parts:
        digest.update(part if isinstance(part, bytes) else str(part).encode())
        digest.update(b"\0")
    return digest.hexdigest()


@dataclasses.dataclass
class Bench:
    """The programs under test and where their work is kept."""
    valvetriage: pathlib.Path
    stand: pathlib.Path
    work: pathlib.Path
    reference_valves: int = 8
    population_seed: int = 1

    def __post_init__(self):
        self.binary_sha = hash_of(self.valvetriage.read_bytes())
        self.stand_sha = hash_of(self.stand.read_bytes())
        self.scorer_sha = hash_of(*[(PARTS / name).read_bytes() for name in ("playing.py", "scoring.py")])
        self.reference = None

    def learn_reference(self):
        """The population of good valves that every case is judged against, learned once."""
        key = hash_of(self.binary_sha, self.stand_sha, self.reference_valves, self.population_seed)[:16]
        self.reference = self.work / "references" / f"{self.reference_valves}-valves-{key}.json"
        if self.reference.exists():
            return 0.0
        self.reference.parent.mkdir(parents=True, exist_ok=True)
        good = self.work / f"good-{key}"
        try:
            run(self.stand, "population", "--out", good, "--valves", self.reference_valves, "--seed",
                self.population_seed, "--tests", "full")
            unfinished = self.reference.with_suffix(".unfinished")
            _, seconds = run(self.valvetriage, "reference", "learn", good, "--valve-type", "type-1", "-o", unfinished,
                             limit_s=3600)
            unfinished.rename(self.reference)
        finally:
            shutil.rmtree(good, ignore_errors=True)
        return seconds


def outcome_of(bench, case):
    """The scored outcome of a case, from the cache if nothing that it hangs on has changed."""
    arguments = case.stand_arguments()
    key = hash_of(bench.binary_sha, bench.stand_sha, bench.reference.read_bytes(), arguments, case.kind)[:20]
    kept = bench.work / "results" / case.case
    kept.mkdir(parents=True, exist_ok=True)
    outcome_file = kept / f"{key}.outcome.json"
    stamp = [bench.scorer_sha, case.d, case.d_name, case.oracle_set]
    if outcome_file.exists():
        stored = json.loads(outcome_file.read_text())
        if json.dumps(stored.pop("stamp")) == json.dumps(stamp):
            return stored
    for old in kept.iterdir():
        if not old.name.startswith(key):
            old.unlink()
    recordings, sealed = bench.work / "recordings" / case.case, bench.work / "sealed" / case.case
    try:
        run(bench.stand, *arguments, "--out", recordings, "--truth", sealed / "truth.json", "--clean", sealed / "clean")
        analysis, seconds = analysed(bench, case, recordings, kept / f"{key}.analysis.json")
        held_out = held_out_analysis(bench, case, recordings, kept / f"{key}.held_out.json")
        outcome = judge(case, analysis, json.loads((sealed / "truth.json").read_text()))
        outcome["closed_share"] = closed_share(bench, held_out, recordings, sealed / "clean") if held_out else None
        outcome["seconds"] = seconds
    except Failed as failure:
        outcome = judge(case, None, None)
        outcome["failure"] = str(failure)
    finally:
        shutil.rmtree(recordings, ignore_errors=True)
        shutil.rmtree(sealed, ignore_errors=True)
    outcome_file.write_text(json.dumps({"stamp": stamp, **outcome}))
    return outcome


def analysed(bench, case, recordings, kept):
    """(analysis, processor seconds) of the recordings of a folder; an analysis that is there is not made again."""
    if kept.exists():
        stored = json.loads(kept.read_text())
        return stored["analysis"], stored["seconds"]
    options = []
    if case.plant == "motion":
        options = ["--baseline", "self", "--columns", "time=time_s,input=u,output=y"]
    else:
        options = ["--reference", bench.reference, *SIDE_CHANNELS]
    text, seconds = run(bench.valvetriage, "analyze", *sorted(recordings.glob("*.csv")), *options, "--json")
    analysis = json.loads(text)
    kept.write_text(json.dumps({"seconds": seconds, "analysis": analysis}))
    return analysis, seconds


def held_out_recording(case):
    """The recording that a second analysis does not see; never the steps, which hold the levels."""
    return ("multisine", "staircase", "sweep", "triangle", "triangle_fast")[case.number % 5]


def held_out_analysis(bench, case, recordings, kept):
    """The models of an analysis without one recording, where the effect is large enough to ask what they close."""
    if case.kind != "single" or case.plant != "valve" or not case.d >= CLOSED_SHARE_D:
        return None
    if case.effects[0][0] in NOT_IN_OTHER_RECORDINGS:
        return None
    name = held_out_recording(case)
    aside = recordings.with_name(recordings.name + ".without")
    shutil.copytree(recordings, aside, ignore=shutil.ignore_patterns(f"{name}.csv"))
    try:
        analysis, _ = analysed(bench, case, aside, kept)
    finally:
        shutil.rmtree(aside, ignore_errors=True)
    return {"name": name, "baseline": analysis["baseline"]["model"], "extended": analysis["extended_model"]}


def closed_share(bench, held_out, recordings, clean):
    """1 - energy of (extended - truth) over energy of (baseline - truth), on the held-out recording, against the
    noise-free output; the first second is not counted, where the unknown state settles."""
    truth = column(clean / f"{held_out['name']}.csv", "pressure_psi")
    energy = {}
    for which in ("baseline", "extended"):
        model = recordings / f"{which}.model.json"
        model.write_text(json.dumps(held_out[which]))
        simulated = recordings / f"{which}.simulated.csv"
        run(bench.valvetriage, "simulate", "--model", model, "--input", recordings / f"{held_out['name']}.csv",
            *SIDE_CHANNELS, "--initial-samples", WARM_UP_SAMPLES, "-o", simulated)
        output = column(simulated, "output_simulated")
        energy[which] = math.fsum((a - b) ** 2 for a, b in list(zip(output, truth))[WARM_UP_SAMPLES:])
    return 1 - energy["extended"] / energy["baseline"]


def column(path, name):
    with open(path) as file:
        lines = [line.rstrip("\n").split(",") for line in file if not line.startswith("#")]
    place = lines[0].index(name)
    return [float(line[place]) for line in lines[1:]]
