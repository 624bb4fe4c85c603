"""The demonstration's lot through the page, as a quality engineer meets it: a real server with the real analyser, a
reference learned from good valves of the virtual stand, a rule base, and a lot of its returned valves.

usage: demo_walk_test.py CHROMIUM VALVETRIAGE STAND [PICTURES]      PICTURES a folder for screenshots, and for
page.png, which the README shows
"""
import base64
import json
import os
import pathlib
import re
import subprocess
import sys
import tempfile
import unittest
import urllib.parse
import urllib.request

sys.path[:0] = [str(pathlib.Path(__file__).parent), str(pathlib.Path(__file__).parents[2] / "deploy")]
import chromium  # noqa: E402
import page_picture  # noqa: E402

HERE = pathlib.Path(__file__).parent
AXE = HERE / "node_modules/axe-core/axe.min.js"
LOT = "2026-W31-B"
HOSTILE = '<img src=x onerror="window.hacked=1">'
LABELLED = HERE / "demo_labelled.csv"  # figures of the demonstration's labelled valves; README.md tells how it was made
GOOD_VALVES = 8  # as in the demonstration
RETURNED = ("EFC-104201", "EFC-104202", "EFC-104204", "EFC-104205", "EFC-104206", "EFC-104208")  # of the demonstration's
# fifteen: two good, a slow and a drifting one, and two that stick, one of them much
ANALYSES_S = 1500  # eight sessions on a busy machine


class RealServer:
    def __init__(self, binary, folder):
        self._binary, self._folder, self._address = str(binary), folder, "127.0.0.1:0"
        self.start()

    def start(self):
        """On a port of the system's choice; after kill() on the same one again."""
        self._log = open(self._folder / "server.log", "ab")
        self._process = subprocess.Popen([self._binary, "serve", "--listen", self._address, "--data-dir", self._folder / "data"],
                                         stdout=subprocess.PIPE, stderr=self._log, text=True)
        said = self._process.stdout.readline()
        if not said.startswith("listening on "):
            raise RuntimeError((self._folder / "server.log").read_text())
        self.url = said.removeprefix("listening on ").strip()
        self._address = self.url.removeprefix("http://")

    def kill(self):
        self._process.kill()
        self.end()

    def end(self):
        self._process.terminate()
        self._process.wait()
        self._process.stdout.close()
        self._log.close()

    def post(self, path, file):
        asked = urllib.request.Request(self.url + path, data=file.read_bytes(), method="POST", headers={"Content-Type": "application/json"})
        urllib.request.urlopen(asked).close()

    def get(self, path):
        with urllib.request.urlopen(self.url + path) as answer:
            return json.loads(answer.read())


class DemoWalk(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        chromium.PATIENCE_S = ANALYSES_S
        if PICTURES:
            PICTURES.mkdir(parents=True, exist_ok=True)
        folder = tempfile.TemporaryDirectory(prefix="valvetriage-")
        cls.addClassCleanup(folder.cleanup)
        cls.folder = pathlib.Path(folder.name)
        cls.make_recordings()
        cls.server = RealServer(VALVETRIAGE, cls.folder)
        cls.addClassCleanup(cls.server.end)
        cls.server.post("/v1/valve-types/type-1/references", cls.folder / "reference.json")
        cls.server.post("/v1/valve-types/type-1/rule-bases", cls.folder / "rules.json")
        cls.browser = chromium.Chromium(CHROMIUM)
        cls.browser.__enter__()
        cls.addClassCleanup(cls.browser.__exit__)
        cls.upload_through_a_restart()

    @classmethod
    def make_recordings(cls):
        def run(*command):
            subprocess.run([str(part) for part in command], check=True, stdout=subprocess.DEVNULL)

        run(STAND, "population", "--out", cls.folder / "good", "--valves", GOOD_VALVES)
        run(VALVETRIAGE, "reference", "learn", cls.folder / "good", "--valve-type", "type-1", "-o", cls.folder / "reference.json")
        run(VALVETRIAGE, "rule-base", "learn", LABELLED, "--name", "demo", "--reference", cls.folder / "reference.json",
            "-o", cls.folder / "rules.json")
        run(STAND, "lot", "--out", cls.folder / "lot", "--lot", LOT, "--valves", 8, "--truth", cls.folder / "truth.json")
        units = json.loads((cls.folder / "truth.json").read_text())
        cls.truth = {unit["session"]["serial"]: unit for unit in units if unit["session"]["serial"] in RETURNED}
        steps = (cls.folder / "lot" / next(iter(cls.truth)) / "step_1.4A.csv").read_text()
        cls.hostile = cls.folder / "<img onerror>.csv"
        cls.hostile.write_text(re.sub(r"# serial: .*", f"# serial: {HOSTILE}", re.sub(r"# lot: .*", f"# lot: {HOSTILE}", steps)))
        lines = re.sub(r"# serial: .*", "# serial: EFC-BAD", steps).splitlines()
        lines[199] = "0.9,n/a,12"
        cls.bad = cls.folder / "bad.csv"
        cls.bad.write_text("\n".join(lines) + "\n")

    @classmethod
    def upload_through_a_restart(cls):
        """Good files, a bad one and one with hostile names; the server is killed while the first are analysed."""
        files = [file for serial in RETURNED for file in sorted((cls.folder / "lot" / serial).glob("*.csv"))]
        cls.browser.open(f"{cls.server.url}/#/upload")
        cls.browser.wait_for_text("Drop recordings here")
        cls.browser.set_files("#choose-files", [*files, cls.bad, cls.hostile])
        cls.sessions = len(cls.truth) + 2
        cls.browser.wait_for_text(f"Upload {cls.sessions} valves")
        cls.browser.run("document.querySelector('button.primary').click()")
        cls.browser.wait_for_text("analysing")
        cls.server.kill()
        cls.browser.wait_for_text("The server does not answer.")
        cls.server.start()
        cls.browser.wait("!document.body.innerText.includes('The server does not answer.')")
        # What was being sent when the server went is not lost: the page offers it again.
        cls.browser.wait(f"""(() => {{
          for (const button of document.querySelectorAll('main table button')) if (!button.hidden) button.click();
          return document.body.innerText.includes('{cls.sessions} of {cls.sessions} valves have ended.');
        }})()""")
        cls.uploaded = cls.browser.text()
        cls.picture("walk-upload")
        cls.browser.errors.clear()  # the console notes the requests that met no server

    @classmethod
    def picture(cls, name):
        if PICTURES:
            cls.browser.screenshot(str(PICTURES / f"{name}.png"))

    def tearDown(self):
        self.assertEqual(self.browser.errors, [])

    def open(self, address, text):
        self.browser.open("about:blank")
        self.browser.open(f"{self.server.url}/#{address}")
        self.browser.wait_for_text(text)
        self.browser.wait("!document.body.hasAttribute('aria-busy')")

    def sticking(self):
        """A valve that does stick and of which the page says so, settled or beside its rivals."""
        rows = self.server.get(f"/v1/submissions?lot={LOT}&cause=friction&limit=100")["items"]
        return next(row for row in rows if self.truth[row["serial"]]["kind"] == "sticking")

    def test_the_upload_tells_how_each_valve_ended_and_where_the_bad_file_is_wrong(self):
        self.assertIn("● Good EFC-104201", self.uploaded)
        self.assertIn("■ Severe EFC-104208", self.uploaded)
        self.assertIn("line 200, column 2 (current_A): 'n/a' is not a number", self.uploaded)
        self.assertEqual(self.server.get(f"/v1/lots/{LOT}")["analysed_valves"], len(self.truth))

    def test_a_sticking_valve_is_found_in_the_list_and_tells_its_cause(self):
        valve = self.sticking()
        self.open(f"/valves?lot={LOT}&cause=friction", valve["serial"])
        self.browser.run(f"document.querySelector('a[href$=\"{valve['id']}\"]').click()")
        self.browser.wait_for_text("What the simulation gets wrong")
        self.browser.wait_for_text("time [s]")
        text = self.browser.text()
        self.assertIn("Friction", text)
        self.assertIn("breakaway_A", text)
        self.picture("walk-valve")
        if PICTURES:
            page_picture.main(CHROMIUM, self.browser.run("location.href") + "?from=1&to=7", PICTURES / "page.png")

    def test_a_verdict_shows_its_memberships_and_the_rules_that_fired(self):
        # The large one of the two that stick.
        self.open("/serial/EFC-104208", "Sessions of this serial")
        self.browser.run("document.querySelector('main table a[href*=\"/valve/\"]').click()")
        self.browser.wait_for_text("What the simulation gets wrong")
        self.assertIn("■ Severe", self.browser.text())
        bars = self.browser.run("""Object.fromEntries([...document.querySelectorAll('table.bars')].find((t) => t.caption.textContent.startsWith('Membership'))
          .querySelectorAll('tr').values().map((row) => [row.cells[0].textContent, Number(row.cells[2].textContent)]))""")
        self.assertEqual(list(bars), ["Good", "Malfunctioned", "Severe"])
        self.assertEqual(max(bars, key=bars.get), "Severe")
        self.browser.run("[...document.querySelectorAll('summary')].find((s) => s.textContent === 'Rules that fired').click()")
        self.browser.wait_for_text("Rule base demo, version 1")
        levels = self.browser.run("[...document.querySelectorAll('details[open] h3')].map((h) => h.textContent.split(':')[0])")
        self.assertEqual(levels, ["1.2 A", "1.4 A (low)", "1.6 A (high)", "1.8 A", "2.0 A"])
        self.assertRegex(self.browser.text(), r"error is severe -> Severe – strength (0\.\d+|1\.0)")
        self.picture("walk-verdict")

    def test_the_lot_leads_to_its_valves_and_tells_what_they_share(self):
        self.open(f"/lot/{LOT}", "What all valves share")
        self.browser.wait_for_text("without a settled cause, with")
        self.browser.wait("!document.body.innerText.includes('Comparing the residuals')")
        text = self.browser.text()
        self.assertIn(f"{len(RETURNED) + 1} valves in {len(RETURNED) + 1} sessions, {len(RETURNED)} analysed", text)
        self.assertRegex(text, r"q[ <0-9.]+\)")
        self.picture("walk-lot")
        self.browser.run("[...document.querySelectorAll('a')].find((a) => a.textContent === 'EFC-104208').click()")
        self.browser.wait_for_text("What the simulation gets wrong")
        self.assertEqual(self.browser.run("document.querySelector('h1').textContent"), "EFC-104208")

    def test_reports_of_a_valve_and_of_the_lot_print(self):
        for address in (f"/v1/submissions/{self.sticking()['id']}/report", f"/v1/lots/{LOT}/report"):
            self.browser.open(self.server.url + address)
            self.browser.wait_for_text("How it was made")
            self.picture("walk-report" + ("-lot" if "/lots/" in address else ""))
            pdf = base64.b64decode(self.browser.call("Page.printToPDF", printBackground=True)["data"])
            self.assertTrue(pdf.startswith(b"%PDF"))
            self.assertGreater(len(pdf), 20_000)

    def report(self, *arguments, path=None):
        """The verb `report` where Chromium is; `path` in place of it."""
        here = f"{pathlib.Path(CHROMIUM).parent}{os.pathsep}{os.environ['PATH']}" if path is None else path
        return subprocess.run([VALVETRIAGE, "report", *arguments, "--server", self.server.url], env={**os.environ, "PATH": here},
                              stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, check=False)

    def test_the_command_prints_reports_to_pdf_where_there_is_a_chromium_and_says_so_where_there_is_none(self):
        file = self.folder / "report.pdf"
        for subject in ((self.sticking()["id"],), ("--lot", LOT)):
            said = self.report(*subject, "--pdf", "-o", file)
            self.assertEqual((said.returncode, said.stderr), (0, ""))
            self.assertTrue(file.read_bytes().startswith(b"%PDF"))
            file.unlink()
        said = self.report("--lot", LOT, "--pdf", "-o", file, path=str(self.folder))
        self.assertNotEqual(said.returncode, 0)
        self.assertIn("--pdf needs Chromium", said.stderr)
        self.assertFalse(file.exists())

    def test_hostile_names_stay_text_on_every_page_that_shows_them(self):
        quoted = urllib.parse.quote(HOSTILE, safe="")
        for address in ("/valves", "/lots", f"/lot/{quoted}", f"/serial/{quoted}"):
            self.open(address, HOSTILE)
            self.assertIsNone(self.browser.run("document.querySelector('img')"), address)
        self.assertFalse(self.browser.run("'hacked' in window"))

    def test_axe_finds_nothing_on_the_pages_of_the_walk(self):
        if not AXE.exists():
            self.skipTest("axe-core is not there; deploy/setup installs it where npm is")
        valve = self.sticking()["id"]
        for address, text in ((f"/valve/{valve}", "time [s]"), (f"/lot/{LOT}", "without a settled cause, with"),
                              ("/valves", "Test sessions"), ("/lots", LOT), ("/upload", "Drop recordings here")):
            self.open(address, text)
            self.browser.run(AXE.read_text(encoding="utf-8"))
            found = self.browser.run("axe.run(document, {resultTypes: ['violations']}).then((r) => r.violations.map((v) => v.id + ' ' + v.nodes[0].html.slice(0, 200)))")
            self.assertEqual(found, [], address)


if __name__ == "__main__":
    CHROMIUM, VALVETRIAGE, STAND = sys.argv[1], *(pathlib.Path(name).resolve() for name in sys.argv[2:4])
    PICTURES = pathlib.Path(sys.argv[4]) if len(sys.argv) > 4 else None
    unittest.main(argv=sys.argv[:1], verbosity=2)
