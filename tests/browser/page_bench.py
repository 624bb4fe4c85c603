"""How fast the page is in a Chromium without a window, on loopback; prints the table of tests/browser/README.md.

usage: page_bench.py CHROMIUM SERVER      SERVER is contract_http: its analyser answers at once, everything else is real
"""
import math
import os
import pathlib
import platform
import sqlite3
import statistics
import sys
import tempfile
from random import Random

sys.path.insert(0, str(pathlib.Path(__file__).parent))
from chromium import Chromium  # noqa: E402
from page_server import Server, recording  # noqa: E402

VALVES = 10_000
FILES = 500
SAMPLES = 100_000
RUNS = 5

# When the first of `selector` was in the page and drawn, counted from the start of the navigation.
SEEN = """
window.seen = null;
const look = () => {
  if (document.querySelector(SELECTOR)) requestAnimationFrame(() => requestAnimationFrame(() => { window.seen = performance.now(); }));
  else requestAnimationFrame(look);
};
requestAnimationFrame(look);
"""
# Distances of the frames while something goes on, and the tasks of the page's thread that took longer than 50 ms, which
# is what a browser calls long.
FRAMES = """
window.frames_ms = [];
window.long_ms = [];
window.long_tasks ??= new PerformanceObserver((list) => list.getEntries().forEach((task) => window.long_ms.push(task.duration)));
window.long_tasks.observe({ type: 'longtask' });
{ let last = performance.now();
  const tick = (now) => { window.frames_ms.push(now - last); last = now; window.frames_timer = requestAnimationFrame(tick); };
  window.frames_timer = requestAnimationFrame(tick); }
"""


def fill(database):
    """A lot of 10,000 valves as a year leaves it; the triggers count as they do in service."""
    rows = sqlite3.connect(database)
    random = Random(7)
    rows.create_function("error", 0, lambda: round(random.lognormvariate(2, 0.4), 3))
    numbers = f"WITH RECURSIVE n (i) AS (SELECT 0 UNION ALL SELECT i + 1 FROM n WHERE i + 1 < {VALVES}) "
    rows.executescript(
        "PRAGMA synchronous = OFF; BEGIN;" + numbers +
        """INSERT INTO submissions (seq, id, job_id, state, received_at, lot, serial, valve_type, condition, stand, recordings,
             verdict, conclusion, top_cause, top_cause_probability, errors)
           SELECT i + 1, 'sub_' || i, 'job_' || i, 'done', 1700000000000 + i * 30000, 'lot-1', 'EFC-' || i, 'type-1', 'returned',
             'stand-' || (i % 7), 6,
             CASE i % 10 WHEN 0 THEN 'Severe' WHEN 1 THEN 'Malfunctioned' ELSE 'Good' END,
             CASE WHEN i % 10 < 2 THEN 'ambiguous' ELSE 'none' END,
             CASE i % 10 WHEN 0 THEN 'friction' WHEN 1 THEN 'leakage' END, 0.97,
             json_array(json_array(1.2, error()), json_array(1.4, error()), json_array(1.6, error()), json_array(1.8, error()),
               json_array(2.0, error())) FROM n;
           INSERT INTO lots (lot, first_received_at, last_received_at, recordings, submissions)
           SELECT lot, min(received_at), max(received_at), count(*), count(*) FROM submissions GROUP BY lot;
           INSERT INTO lot_valves SELECT lot, 'serial ' || serial, seq, verdict FROM submissions;
           INSERT INTO submission_causes SELECT top_cause, received_at, seq FROM submissions WHERE top_cause IS NOT NULL;
           COMMIT;""")
    rows.close()


def long_recording():
    """100,000 samples at 1 kHz: steps with a first-order response."""
    lines = ["# serial: EFC-LONG", "# lot: lot-long", "# test: step", "time_s,current_A,pressure_psi"]
    pressure = 26.0
    for i in range(SAMPLES):
        current = 1.2 + 0.2 * (i // 5000 % 5)
        pressure += 0.015 * (26 + 150 * (current - 1.2) - pressure)
        lines.append(f"{0.001 * i:.3f},{current:.3f},{pressure + 0.3 * math.sin(i * i):.3f}")
    return "\n".join(lines) + "\n"


def opened(browser, url, selector):
    """Milliseconds to the first paint and to `selector`, from a page of nothing."""
    browser.open("about:blank")
    name = browser.call("Page.addScriptToEvaluateOnNewDocument", source=SEEN.replace("SELECTOR", repr(selector)))["identifier"]
    browser.open(url)
    seen = browser.wait("window.seen")
    browser.call("Page.removeScriptToEvaluateOnNewDocument", identifier=name)
    return browser.run("performance.getEntriesByName('first-contentful-paint')[0]?.startTime"), seen


def processor_ms(browser, server):
    """Processor time so far: of the page's main thread and of the server."""
    metrics = {entry["name"]: entry["value"] for entry in browser.call("Performance.getMetrics")["metrics"]}
    fields = pathlib.Path(f"/proc/{server.pid()}/stat").read_text().rsplit(")", 1)[1].split()
    return 1000 * metrics["TaskDuration"], 1000 * (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def frames(browser, action, end):
    """Distances of frames, and durations of long tasks, in ms from an action to its end."""
    browser.run(FRAMES)
    browser.run(action)
    browser.wait(end)
    frames_ms, long_ms = browser.run("cancelAnimationFrame(window.frames_timer), [window.frames_ms, window.long_ms]")
    return sorted(frames_ms), sorted(long_ms)


def long_tasks(long_ms):
    return f"{len(long_ms)}, longest {long_ms[-1]:.0f} ms" if long_ms else "none"


def share(values, of):
    return values[min(len(values) - 1, int(of * len(values)))]


def main():
    table = []
    with tempfile.TemporaryDirectory(prefix="valvetriage-") as folder, Chromium(CHROMIUM) as browser:
        data = pathlib.Path(folder) / "data"
        data.mkdir()
        server = Server(SERVER, str(data))
        server.kill()
        fill(data / "valvetriage.sqlite")
        server.start()
        try:
            runs = [opened(browser, f"{server.url}/#/valves", "main table") for _ in range(RUNS)]
            table.append(("first paint of the page, nothing in the cache of the tab", f"{statistics.median(r[0] for r in runs):.0f} ms"))
            table.append(("newest 50 of 10,000 sessions in the list", f"{statistics.median(r[1] for r in runs):.0f} ms"))
            runs = [opened(browser, f"{server.url}/#/lot/lot-1", "main .lot-chart") for _ in range(RUNS)]
            table.append(("a lot of 10,000 valves, drawn with charts and table", f"{statistics.median(r[1] for r in runs):.0f} ms"))

            opened(browser, f"{server.url}/#/lots", "main table")
            browser.call("Performance.setTimeDomain", timeDomain="threadTicks")
            browser.call("Performance.enable")
            before = processor_ms(browser, server)
            browser.run("location.hash = '#/lot/lot-1'")
            browser.wait("document.querySelectorAll('main .lot-chart').length > 0")
            page, served = (after - begun for after, begun in zip(processor_ms(browser, server), before))
            browser.call("Performance.disable")
            table.append(("the same: processor time of the page's thread, of the server", f"{page:.0f} ms, {served:.0f} ms"))

            row = server.send(long_recording())
            opened(browser, f"{server.url}/#/valve/{row['submission_id']}", ".chart canvas")
            browser.wait("!document.querySelector('.plots').innerText.includes('Loading')")
            zoom = """(async () => {
              const frame = () => new Promise((next) => requestAnimationFrame(next));
              for (let i = 0; i < 120; ++i) {
                document.querySelector(`[aria-label="${i % 60 < 30 ? 'zoom in' : 'zoom out'}"]`).click();
                await frame();
              }
              window.zoomed = true;
            })()"""
            times, long_ms = frames(browser, zoom, "window.zoomed")
            table.append((f"zooming in {SAMPLES:,} samples a step a frame: time between frames", f"median {statistics.median(times):.1f} ms, 95 % below {share(times, 0.95):.1f} ms, longest {times[-1]:.1f} ms"))
            table.append(("the same: tasks of the page's thread longer than 50 ms", long_tasks(long_ms)))

            files = pathlib.Path(folder) / "files"
            files.mkdir()
            for i in range(FILES):
                (files / f"{i:03}.csv").write_text(recording(f"U-{i}", "lot-up"))
            browser.open("about:blank")
            browser.open(f"{server.url}/#/upload")
            browser.wait_for_text("Drop recordings here")
            # What chooses files for this browser is the test's tool: it asks the disk for each while the page's thread waits.
            # So it chooses them in an input of the test's own, and the page's input is given them after that.
            browser.run("document.body.insertAdjacentHTML('beforeend', '<input type=file id=of-the-bench multiple aria-label=files>')")
            browser.set_files("#of-the-bench", sorted(files.iterdir()))
            choose = """{
              const input = document.querySelector('#choose-files');
              input.files = document.querySelector('#of-the-bench').files;
              setTimeout(() => input.dispatchEvent(new Event('change')));
            }"""
            listed_ms, long_ms = frames(browser, choose, f"document.querySelector('button.primary').textContent === 'Upload {FILES} valves'")
            table.append((f"{FILES} files chosen at once: until each is listed with its labels; longest between frames; tasks longer than 50 ms",
                          f"{sum(listed_ms) / 1000:.1f} s; {listed_ms[-1]:.0f} ms; {long_tasks(long_ms)}"))
            times, long_ms = frames(browser, "document.querySelector('button.primary').click()", f"document.querySelector('main').innerText.includes('{FILES} of {FILES} valves have ended.')")
            table.append((f"{FILES} files uploaded at once, until every one has ended", f"{sum(times) / 1000:.0f} s"))
            table.append(("meanwhile: time between frames", f"median {statistics.median(times):.1f} ms, 95 % below {share(times, 0.95):.1f} ms, longest {times[-1]:.0f} ms"))
            table.append(("meanwhile: tasks of the page's thread longer than 50 ms", long_tasks(long_ms)))
        finally:
            server.end()
    print(f"{os.cpu_count()} cores, {platform.machine()}, load average before it ended {os.getloadavg()[0]:.1f}.\n")
    print("| what | measured |\n|---|---|")
    for what, measured in table:
        print(f"| {what} | {measured} |")


if __name__ == "__main__":
    CHROMIUM, SERVER = sys.argv[1:3]
    main()
