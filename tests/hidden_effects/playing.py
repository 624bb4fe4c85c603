"""One case from seed to outcome: the stand plays it, the product analyses the recordings, the scorer opens the truth.

The folder of a case holds its recordings; truth and noise-free outputs lie under another root, `sealed`, that is given
to the scorer alone. Both are removed when the case is scored; the analysis and the outcome stay, under a hash of the
product's binary, the stand's binary, the reference and the case, so that a rerun does only what has changed.
"""
import contextlib
import dataclasses
import json
import math
import pathlib
import shutil

from engines import Command, Failed, Product, hash_of, run
from scoring import judge

PARTS = pathlib.Path(__file__).parent
CLOSED_SHARE_D = 30.0
# In a recording that was not analysed these come with a phase or at an instant that nobody can know.
NOT_IN_OTHER_RECORDINGS = {"intermittent", "periodic_disturbance", "self_oscillation"}
WARM_UP_SAMPLES = 200  # of a held-out recording: they set the unknown start, memories included, and are not scored


@dataclasses.dataclass
class Bench:
    """The programs under test and where their work is kept."""
    valvetriage: pathlib.Path
    stand: pathlib.Path
    work: pathlib.Path
    reference_valves: int = 8
    population_seed: int = 1
    engine: Product | Command = None  # the product, unless another is given
    bad_valve: tuple = ()  # (effect, size) that hides in one of the reference's valves
    stand_sha: str = ""    # of the stand's program, unless its cases were played elsewhere

    def __post_init__(self):
        self.engine = self.engine or Product(self.valvetriage)
        self.stand_sha = self.stand_sha or hash_of(self.stand.read_bytes())
        self.scorer_sha = hash_of(*[(PARTS / name).read_bytes() for name in ("playing.py", "scoring.py")])
        self.reference = None
        self.reference_sha = hash_of(self.engine.sha, self.stand_sha, self.reference_valves, self.population_seed,
                                     self.bad_valve)

    def learn_reference(self):
        """The population of good valves that every case is judged against, learned once."""
        self.reference = self.work / "references" / f"{self.reference_valves}-valves-{self.reference_sha[:16]}"
        if self.reference.exists():
            return 0.0
        self.reference.parent.mkdir(parents=True, exist_ok=True)
        good = self.work / f"good-{self.reference_sha[:16]}"
        try:
            self.play_population(good)
            unfinished = self.reference.with_suffix(".unfinished")
            seconds = self.engine.learn(good, unfinished)
            unfinished.rename(self.reference)
        finally:
            shutil.rmtree(good, ignore_errors=True)
        return seconds

    def play_population(self, folder):
        run(self.stand, "population", "--out", folder, "--valves", self.reference_valves, "--seed",
            self.population_seed, "--tests", "full")
        if self.bad_valve:
            effect, size = self.bad_valve
            first = min(path for path in folder.iterdir() if path.is_dir())
            shutil.rmtree(first)
            run(self.stand, "session", "--out", first, "--serial", first.name, "--lot", "reference", "--effect",
                f"{effect}={size}", "--tests", "full")

    def key(self, case):
        """What the answer to a case hangs on."""
        return hash_of(self.engine.sha, self.stand_sha, self.reference_sha, case.stand_arguments(), case.kind)[:20]

    def next_test_file(self, case):
        return self.work / "next_tests" / f"{self.key(case)}.json"

    def keep_next_test(self, case, asked):
        """With its input, which is a hundred times as long as the line of an answer."""
        self.next_test_file(case).parent.mkdir(parents=True, exist_ok=True)
        self.next_test_file(case).write_text(json.dumps(asked))

    def kept_next_test(self, case):
        """None where it is gone, or the run was ended while it was written."""
        with contextlib.suppress(FileNotFoundError, ValueError):
            return json.loads(self.next_test_file(case).read_text())

    def forget_next_test(self, case):
        self.next_test_file(case).unlink(missing_ok=True)

    @contextlib.contextmanager
    def played(self, case):
        """(recordings, sealed) of a case: two folders that are gone afterwards."""
        place = f"{case.serial}-{self.key(case)}"
        recordings, sealed = self.work / "recordings" / place, self.work / "sealed" / place
        try:
            run(self.stand, *case.stand_arguments(), "--out", recordings, "--truth", sealed / "truth.json",
                "--clean", sealed / "clean")
            yield recordings, sealed
        finally:
            shutil.rmtree(recordings, ignore_errors=True)
            shutil.rmtree(sealed, ignore_errors=True)


def outcome_of(bench, case):
    """The scored outcome of a case, from the cache if nothing that it hangs on has changed."""
    key = bench.key(case)
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
    try:
        with bench.played(case) as (recordings, sealed):
            analysis, seconds = kept_analysis(bench, case, recordings, kept / f"{key}.analysis.json")
            outcome = judge(case, analysis, json.loads((sealed / "truth.json").read_text()))
            outcome["closed_share"] = share_closed(held_out_errors(bench, case, recordings, sealed / "clean"))
            outcome["seconds"] = seconds
    except Failed as failure:
        outcome = judge(case, None, None)
        outcome["failure"] = str(failure)
    outcome_file.write_text(json.dumps({"stamp": stamp, **outcome}))
    return outcome


def kept_analysis(bench, case, recordings, kept):
    """(analysis, processor seconds) of the recordings of a folder; an analysis that is there is not made again."""
    if kept.exists():
        stored = json.loads(kept.read_text())
        return stored["analysis"], stored["seconds"]
    analysis, seconds = bench.engine.analyse(case, recordings, bench.reference)
    kept.write_text(json.dumps({"seconds": seconds, "analysis": analysis}))
    return analysis, seconds


def held_out_recording(case):
    """The recording that a second analysis does not see; never the steps, which hold the levels."""
    return ("multisine", "staircase", "sweep", "triangle", "triangle_fast")[case.number % 5]


def has_recording_to_hold_out(case):
    """One cause that is large enough to ask, of a valve that was put through the whole repertoire."""
    return (case.kind == "single" and case.plant == "valve" and case.d >= CLOSED_SHARE_D and case.tests == "full"
            and case.effects[0][0] not in NOT_IN_OTHER_RECORDINGS)


def held_out_errors(bench, case, recordings, clean):
    """What baseline and extended model of an analysis without one recording leave there, root mean square [psi] against
    the noise-free output, and what the baseline of the same valve leaves of it without the effect; None where there is
    nothing to hold out, or the engine simulates nothing."""
    if not has_recording_to_hold_out(case) or not bench.engine.simulate:
        return None
    errors = errors_without_recording(bench, case, recordings, clean, {"baseline", "extended"})
    good = dataclasses.replace(case, effects=[])
    with bench.played(good) as (recordings_of_good, sealed):
        of_good = errors_without_recording(bench, good, recordings_of_good, sealed / "clean", {"baseline"})
    return errors | {"recording": held_out_recording(case), "good": of_good["baseline"]}


def errors_without_recording(bench, case, recordings, clean, wanted):
    name = held_out_recording(case)
    aside = recordings.with_name(recordings.name + ".without")
    shutil.rmtree(aside, ignore_errors=True)  # of a run that was ended here
    shutil.copytree(recordings, aside, ignore=shutil.ignore_patterns(f"{name}.csv"))
    try:
        analysis, _ = bench.engine.analyse(case, aside, bench.reference)
        models = {"baseline": analysis["baseline"]["model"], "extended": analysis["extended_model"]}
        return {which: error_of_model(bench, models[which], recordings / f"{name}.csv", clean / f"{name}.csv", aside)
                for which in sorted(wanted)}
    finally:
        shutil.rmtree(aside, ignore_errors=True)


def error_of_model(bench, model, recording, clean, folder):
    """Simulated from the start that the first second of the recording tells."""
    (folder / "model.json").write_text(json.dumps(model))
    bench.engine.simulate(folder / "model.json", recording, folder / "simulated.csv", WARM_UP_SAMPLES)
    pairs = list(zip(column(folder / "simulated.csv", "output_simulated"), column(clean, "pressure_psi")))
    scored = pairs[WARM_UP_SAMPLES:]
    return math.sqrt(math.fsum((a - b) ** 2 for a, b in scored) / len(scored))


def share_closed(errors):
    """1 - squared error of the extended model over that of the baseline, what both leave of a good valve in it."""
    if not errors or errors["baseline"] == 0:
        return None
    return 1 - (errors["extended"] / errors["baseline"]) ** 2


def share_to_close(errors):
    """The same of a model that leaves no more than the same valve's baseline does without the effect: an extension that
    knew all of it; None where a good valve leaves as much."""
    if not errors or errors.get("good") is None or errors["good"] >= errors["baseline"]:
        return None
    return 1 - (errors["good"] / errors["baseline"]) ** 2


def column(path, name):
    with open(path) as file:
        lines = [line.rstrip("\n").split(",") for line in file if not line.startswith("#")]
    place = lines[0].index(name)
    return [float(line[place]) for line in lines[1:]]
