"""Tables of deploy/demo: features of labelled valves, verdicts beside the truth."""
import csv
import json
import os
import sys


def load(path):
    with open(path, encoding="utf-8") as file:
        return json.load(file)


# Figures of a level in an analysis, and what `rule-base learn` calls their columns.
FIGURES = {"error_eq20": "error", "settling_error": "settling_error", "rise_time_s": "rise_time", "bandwidth_hz": "bandwidth"}


def features(labels_csv, analyses):
    """One row per labelled valve; a figure that was not measured is an empty field."""
    with open(labels_csv, encoding="utf-8", newline="") as file:
        labels = [(row["serial"], row["verdict"]) for row in csv.DictReader(file)]
    rows = []
    for serial, verdict in labels:
        row = {"verdict": verdict}
        for level in load(os.path.join(analyses, serial + ".json"))["simulation"]["by_level"]:
            for figure, name in FIGURES.items():
                if level[figure] is not None:
                    row[f"{name}_{level['level_A']:.1f}"] = level[figure]
        rows.append(row)
    columns = sorted(set().union(*rows) - {"verdict"}) + ["verdict"]
    out = csv.DictWriter(sys.stdout, columns, restval="", lineterminator="\n")
    out.writeheader()
    out.writerows(rows)


def verdicts(submissions_json, truth_json):
    truth = {unit["session"]["serial"]: unit for unit in load(truth_json)}
    results = {row["serial"]: row for row in load(submissions_json)["items"]}
    print(f"{'serial':<12} {'truth':<10} {'true verdict':<14} {'verdict':<14}")
    right = 0
    for serial, unit in sorted(truth.items()):
        verdict = (results.get(serial) or {}).get("verdict") or "none"
        right += verdict == unit["verdict"]
        print(f"{serial:<12} {unit['kind']:<10} {unit['verdict']:<14} {verdict:<14} {'' if verdict == unit['verdict'] else '<'}")
    print(f"{right} of {len(truth)} verdicts are the true ones")


if __name__ == "__main__":
    {"features": features, "verdicts": verdicts}[sys.argv[1]](*sys.argv[2:])
