"""What the product makes of real recordings, as the table tests/REAL_DATA.md:

  python3 tests/real_data_table.py build/release/valvetriage ../shared/data >tests/REAL_DATA.md

Each file goes through `analyze --json` and, with the same mapping, through `submit --wait` to a server on loopback.
"""
import json
import pathlib
import sys
import time

sys.path.append(str(pathlib.Path(__file__).parent / "contract"))
from running_service import RunningService  # noqa: E402

UNITLESS = ("--columns", "time=t_s,input=u,output=y")
FLOW = ("--columns", "input=current_mA,output=flow_lpm")
# File and the options it needs; the contract's own column names need none.
RECORDINGS = {
    "servovalve/pressure_gain.csv": (),
    "servovalve/flow_gain.csv": FLOW,
    "servovalve/leakage_period_020.csv": FLOW,
    "servovalve/leakage_period_050.csv": FLOW,
    "servovalve/leakage_period_100.csv": FLOW,
    "servovalve/leakage_period_200.csv": FLOW,
    "servovalve/leakage_period_500.csv": FLOW,
    "cascaded_tanks/estimation.csv": UNITLESS,
    "cascaded_tanks/validation.csv": UNITLESS,
    "robot_arm/robot_arm.csv": UNITLESS,
}

HEAD = """# Real recordings

Measured by other people, kept outside the project (`VALVETRIAGE_REAL_DATA`, default `../shared/data`). One line per
file: the analysis of `analyze --json`, seconds of that process, and what `submit --wait` to a running server gave.
rmse is of the free-run simulation, in the output's unit (psi for pressures); a file alone has no reference, so it is
compared with itself (`self`) and has no verdict. Conclusion, causes (what could stand in their place in brackets) and
how much closer the extended model is on samples that it has not seen. Made by

```
python3 tests/real_data_table.py build/release/valvetriage ../shared/data >tests/REAL_DATA.md
```

| file | samples | kind | quality items | baseline | rmse | fit % | conclusion: causes | held-out gain | verdict: reason | seconds | over HTTP |
|---|--:|---|---|---|--:|--:|---|--:|---|--:|---|"""


def causes_of(discrepancy):
    """What was found, each cause with its parameters and with what the data cannot tell it from."""
    texts = []
    for cause in discrepancy["causes"]:
        values = ", ".join(f"{name} {estimate['value']:.4g}" if isinstance(estimate["value"], float) else estimate["value"]
                           for name, estimate in cause["parameters"].items())
        rivals = f" [or {', '.join(cause['alternatives'])}]" if cause["alternatives"] else ""
        texts.append(f"{cause['cause']} ({values}){rivals}")
    return f"{discrepancy['conclusion']}: {'; '.join(texts)}" if texts else discrepancy["conclusion"]


def row(service, data, name, options):
    begin = time.monotonic()
    done = service.run("analyze", data / name, *options, "--json")
    seconds = time.monotonic() - begin
    if done.returncode != 0:
        sys.exit(f"{name}: {done.stderr}")
    analysis = json.loads(done.stdout)
    status, [submission] = service.submit(data / name, *options)
    stored = service.get(submission["links"]["analysis"])
    same = "same result" if stored["result_sha256"] == analysis["result_sha256"] else "another result"
    recording, simulation = analysis["recordings"][0], analysis["simulation"]
    quality = "; ".join(f"`{item['code']}` {item['count']}: {item['detail']}" for item in recording["quality"])
    classification = analysis["classification"]
    discrepancy = analysis["discrepancy"]
    gain = discrepancy["gain"]
    factor = f"{gain['rmse_baseline'] / gain['rmse_extended']:.3g}" if discrepancy["causes"] else ""
    cells = [name, f"{recording['samples']:,}", recording["test"], quality, analysis["baseline"]["kind"],
             f"{simulation['rmse']:.4g}", f"{simulation['fit_percent']:.1f}",
             causes_of(discrepancy), factor,
             f"{classification['verdict'] or 'null'}: {classification['reason']}", f"{seconds:.1f}",
             f"{submission['state']}, exit {status}, {same}"]
    return "| " + " | ".join(cells) + " |"


def main(binary, folder):
    with RunningService(binary) as service:
        print(HEAD)
        for name, options in RECORDINGS.items():
            print(row(service, pathlib.Path(folder), name, options), flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
