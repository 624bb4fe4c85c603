"""The README's picture: measured against the good valve's simulation, and the verdict, from real outputs.

  valvetriage simulate --model GOOD.json --input RECORDING.csv -o run.csv
  valvetriage analyze ... --json >analysis.json
  python3 deploy/picture.py run.csv analysis.json >deploy/verdict.svg
"""
import csv
import json
import sys

WIDTH, TOP, HEIGHT, LEFT = 860, 60, 250, 60
INK, MEASURED, GOOD = "#333333", "#c0392b", "#1f6fb2"


def read_run(path):
    with open(path, encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    return tuple([float(row[name]) for row in rows] for name in ("time_s", "output_measured", "output_simulated"))


def polyline(time, values, x, y, colour):
    # Every third sample is drawn: a pixel holds more than that, and the file stays small.
    points = " ".join(f"{x(t):.1f},{y(v):.1f}" for t, v in list(zip(time, values))[::3])
    return f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="1.3"/>'


def text(x, y, content, colour=INK, size=13, weight="normal"):
    return f'<text x="{x}" y="{y}" fill="{colour}" font-size="{size}" font-weight="{weight}">{content}</text>'


def main(run_csv, analysis_json):
    time, measured, simulated = read_run(run_csv)
    with open(analysis_json, encoding="utf-8") as file:
        analysis = json.load(file)
    classification = analysis["classification"]
    low, high = min(measured + simulated), max(measured + simulated)
    x = lambda t: LEFT + (t - time[0]) / (time[-1] - time[0]) * (WIDTH - LEFT - 20)
    y = lambda v: TOP + (high - v) / (high - low) * HEIGHT
    errors = ", ".join(f"{level['level_A']:.1f} A {level['error_eq20']:.1f}"
                       for level in analysis["simulation"]["by_level"] if level["error_eq20"] is not None)
    bottom = TOP + HEIGHT
    print(f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {bottom + 60}" font-family="sans-serif">')
    print(f'<rect width="{WIDTH}" height="{bottom + 60}" fill="#ffffff"/>')
    print(text(LEFT, 24, f"{classification['verdict']}: {classification['action']}", MEASURED, 18, "bold"))
    print(text(LEFT, 46, f"Eq 20 error by level, psi/s: {errors}"))
    print(text(WIDTH - 330, 24, "measured", MEASURED), text(WIDTH - 250, 24, "simulation of a good valve", GOOD))
    print(f'<path d="M{LEFT},{TOP} V{bottom} H{WIDTH - 20}" fill="none" stroke="{INK}"/>')
    for value in (round(low), round(high)):
        print(text(8, y(value) + 4, f"{value} psi", size=12))
    for t in (time[0], time[-1]):
        print(text(x(t) - 12, bottom + 18, f"{t:.0f} s", size=12))
    print(polyline(time, simulated, x, y, GOOD))
    print(polyline(time, measured, x, y, MEASURED))
    count = len(analysis["recordings"])
    print(text(LEFT, bottom + 44, f"Made by `valvetriage analyze` and `simulate` from {count} recordings of one valve", size=11))
    print("</svg>")


if __name__ == "__main__":
    main(*sys.argv[1:])
