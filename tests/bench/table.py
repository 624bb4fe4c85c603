"""Google Benchmark's JSON files as one Markdown page."""
import json
import os
import sys

# What Google Benchmark writes of its own accord; everything else in a row is a counter of the benchmark.
OWN_FIELDS = {
    "name", "family_index", "per_family_instance_index", "run_name", "run_type", "repetitions", "repetition_index",
    "threads", "iterations", "real_time", "cpu_time", "time_unit", "aggregate_name", "aggregate_unit", "label",
}


def short(value):
    return f"{value:.4g}" if isinstance(value, (int, float)) else str(value)


def counters_of(row):
    return ", ".join(f"{name} {short(value)}" for name, value in row.items() if name not in OWN_FIELDS)


def main(files):
    runs = [(os.path.basename(file).removesuffix(".json"), json.load(open(file, encoding="utf-8"))) for file in files]
    context = runs[0][1]["context"]
    print("# Benchmarks\n")
    print("Written by `tests/bench/run`; do not edit. A ratio to a floor is of the same run.\n")
    print(f"{context['num_cpus']} cores at {context['mhz_per_cpu']} MHz, {context['date'][:10]}.")
    loads = [run["context"]["load_avg"][0] for _, run in runs if run["context"].get("load_avg")]
    if loads:
        print(f"Load average while they ran: {min(loads):.1f} to {max(loads):.1f} (wall-clock rows suffer above the cores' number).")
    for name, run in runs:
        print(f"\n## {name}\n")
        print("| benchmark | time | counters |")
        print("|---|---|---|")
        for row in run["benchmarks"]:
            if "real_time" in row:
                print(f"| {row['name']} | {short(row['real_time'])} {row['time_unit']} | {counters_of(row)} |")


if __name__ == "__main__":
    main(sys.argv[1:])
