"""Severity proved on valves the rule base has not seen: learned from one labelled population of the stand, judged on
another, against a reference of good valves that belongs to neither.

usage: verdicts_on_unseen_valves.py VALVETRIAGE VALVETRIAGE_STAND DEPLOY_FOLDER
Bounds: a hard error confuses Good with not Good, a soft one Malfunctioned with Severe. 3 populations of 72 held-out
valves had 1 hard and 3 soft errors in 216 when this was written; 2 hard and 4 soft in 36 are beyond 99.9 % of binomial
draws at twice those rates.
"""
import collections
import csv
import json
import pathlib
import subprocess
import sys
import tempfile

valvetriage, stand, deploy = sys.argv[1:4]


def run(*command):
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"{' '.join(map(str, command))} ended with {done.returncode}: {done.stderr}")
    return done.stdout


def feature_table(folder, seed, reference):
    """Labelled valves of one seed, analysed one by one; the path of their table."""
    run(stand, "labelled", "--out", folder / "valves", "--seed", seed, "--tests", "step")
    (folder / "analyses").mkdir()
    for valve in sorted((folder / "valves").iterdir()):
        if valve.is_dir():
            analysis = run(valvetriage, "analyze", *sorted(valve.glob("*.csv")), "--reference", reference, "--json")
            (folder / "analyses" / f"{valve.name}.json").write_text(analysis)
    table = folder / "table.csv"
    table.write_text(run(sys.executable, pathlib.Path(deploy) / "demo_tables.py", "features",
                         folder / "valves" / "labels.csv", folder / "analyses"))
    return table


with tempfile.TemporaryDirectory() as name:
    work = pathlib.Path(name)
    run(stand, "population", "--out", work / "good", "--valves", 8, "--seed", 7)
    reference = work / "reference.json"
    run(valvetriage, "reference", "learn", work / "good", "--valve-type", "type-1", "-o", reference)
    tables = []
    for seed in (11, 12):
        (work / str(seed)).mkdir()
        tables.append(feature_table(work / str(seed), seed, reference))
    rules = work / "rules.json"
    run(valvetriage, "rule-base", "learn", tables[0], "--reference", reference, "-o", rules)
    judged = json.loads(run(valvetriage, "classify", tables[1], "--rule-base", rules, "--json"))["rows"]
    confusion = collections.Counter()
    with open(tables[1], newline="") as table:
        for truth, row in zip(csv.DictReader(table), judged):
            confusion[truth["verdict"], row["verdict"]] += 1

hard = sum(n for (truth, verdict), n in confusion.items() if (truth == "Good") != (verdict == "Good"))
soft = sum(n for (truth, verdict), n in confusion.items() if truth != verdict and "Good" not in (truth, verdict))
print(f"{sum(confusion.values())} valves, {hard} hard errors, {soft} soft errors: {dict(confusion)}")
sys.exit(0 if sum(confusion.values()) == 36 and hard <= 2 and soft <= 4 else 1)
