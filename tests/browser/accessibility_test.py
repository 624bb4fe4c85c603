"""axe-core on every view of the page, light and dark; what the keyboard reaches; that nothing jumps while loading.

usage: accessibility_test.py CHROMIUM SERVER Axe|Keyboard      SERVER is contract_http. Axe: exit 77 (skipped) without
axe-core, which deploy/setup installs from npm.
"""
import pathlib
import sys
import tempfile
import unittest
import urllib.parse

sys.path.insert(0, str(pathlib.Path(__file__).parent))
from chromium import Chromium  # noqa: E402
from page_server import Server, recording  # noqa: E402

AXE = pathlib.Path(__file__).parent / "node_modules/axe-core/axe.min.js"

LOT = "2026-W31-B"


def views(submission, on_bad_stand):
    """Address and a text that tells that the view is there."""
    return {
        "valve on a stand with an alarm": (f"/valve/{on_bad_stand}", "Look at stand-3."),
        "valves": ("/valves", "Test sessions"),
        "valves without any": ("/valves?serial=nobody", "No valve fits these filters."),
        "valve": (f"/valve/{submission}", "time [s]"),
        "serial": ("/serial/EFC-1", "Sessions of this serial"),
        "lots": ("/lots", "Look at stand-3."),
        "lot": (f"/lot/{LOT}", "unexplained valves were compared"),
        "lot, some of its valves": (f"/lot/{LOT}?conclusion=unexplained", "2 of 5 analysed valves"),
        "compare": (f"/compare?lot={LOT}&with_stand=stand-3", "Error by level"),
        "teardown": ("/teardown", "Named and found"),
        "upload": ("/upload", "Drop recordings here"),
    }


class Views(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls._folder = tempfile.TemporaryDirectory(prefix="valvetriage-")
        cls.server = Server(SERVER, cls._folder.name)
        complaints = ["named friction", "named sensor_offset", "named sensor_offset", "unexplained", "unexplained"]
        for number, complaint in enumerate(complaints, 1):
            stand = "stand-3" if "sensor" in complaint else "stand-1"
            row = cls.server.send(recording(f"EFC-{number}", LOT, stuck=number == 1, stand=stand, complaint=complaint))
            cls.submission = row["submission_id"] if number == 1 else cls.submission
            cls.on_bad_stand = row["submission_id"] if number == 3 else None if number < 3 else cls.on_bad_stand
        cls.views = views(cls.submission, cls.on_bad_stand)
        cls.server.post("/v1/valves/EFC-1/findings", {"cause": "friction", "who": "kim"})
        cls.server.post("/v1/valves/EFC-4/findings", {"cause": "leakage", "who": "kim"})

    @classmethod
    def tearDownClass(cls):
        cls.server.end()
        cls._folder.cleanup()

    def open(self, browser, address, text):
        browser.open("about:blank")
        browser.open(f"{self.server.url}/#{address}")
        browser.wait_for_text(text)
        browser.wait("!document.body.hasAttribute('aria-busy')")
        browser.wait("!document.body.innerText.includes('Loading …')")


class Axe(Views):
    def violations(self, browser):
        browser.run(AXE.read_text(encoding="utf-8"))
        found = browser.run("""axe.run(document, {resultTypes: ['violations']}).then((r) => r.violations.map((v) =>
          `${v.impact} ${v.id}: ${v.nodes.slice(0, 5).map((n) => n.html.slice(0, 160) + ' ' + n.failureSummary.slice(0, 200)).join(' | ')}`))""")
        return found

    def test_axe_finds_nothing_on_any_view_light_or_dark_wide_or_narrow(self):
        for dark, width in ((False, 1280), (True, 1280), (False, 420), (True, 420)):
            with Chromium(CHROMIUM, width=width, dark=dark) as browser:
                browser.call("Emulation.setDeviceMetricsOverride", width=width, height=900, deviceScaleFactor=1, mobile=False)
                for name, (address, text) in self.views.items():
                    with self.subTest(view=name, dark=dark, width=width):
                        self.open(browser, address, text)
                        self.assertEqual(self.violations(browser), [])


    def test_axe_finds_nothing_on_an_upload_before_and_after(self):
        with tempfile.TemporaryDirectory() as folder, Chromium(CHROMIUM) as browser:
            (pathlib.Path(folder) / "data").mkdir()
            server = Server(SERVER, str(pathlib.Path(folder) / "data"))
            self.addCleanup(server.end)
            files = [pathlib.Path(folder) / name for name in ("one.csv", "two.csv", "three.mat")]
            for file in files:
                file.write_text(recording(file.stem, LOT, bad_line=9 if file.stem == "two" else None))
            browser.open(f"{server.url}/#/upload")
            browser.wait_for_text("Drop recordings here")
            browser.set_files("#choose-files", files)
            browser.wait_for_text("Upload 3 valves")
            browser.wait_for_text("three.mat")
            self.assertEqual(self.violations(browser), [])
            browser.run("document.querySelector('button.primary').click()")
            browser.wait_for_text("3 of 3 valves have ended.")
            self.assertEqual(self.violations(browser), [])
            rows = browser.call("Accessibility.getFullAXTree")["nodes"]
            self.assertEqual(sum(node.get("role", {}).get("value") == "row" for node in rows), 4)


class Keyboard(Views):
    def test_no_view_is_wider_than_a_narrow_window(self):
        with Chromium(CHROMIUM, width=420) as browser:
            browser.call("Emulation.setDeviceMetricsOverride", width=420, height=900, deviceScaleFactor=1, mobile=False)
            for name, (address, text) in self.views.items():
                with self.subTest(view=name):
                    self.open(browser, address, text)
                    self.assertLessEqual(browser.run("document.documentElement.scrollWidth"), 420)

    def press(self, browser, key, code):
        for kind in ("keyDown", "keyUp"):
            browser.call("Input.dispatchKeyEvent", type=kind, key=key, code=key, windowsVirtualKeyCode=code,
                         **({"text": "\r"} if key == "Enter" and kind == "keyDown" else {}))

    def test_the_keyboard_reaches_every_control_in_the_order_of_the_page(self):
        with Chromium(CHROMIUM) as browser:
            for name, (address, text) in self.views.items():
                with self.subTest(view=name):
                    self.open(browser, address, text)
                    controls = browser.run("""(() => {
                      const all = [...document.querySelectorAll('a[href], button, input, select, textarea, summary, [tabindex="0"]')]
                        .filter((e) => e.tabIndex >= 0 && !e.disabled && e.checkVisibility() && !(e.type === 'radio' && !e.checked));
                      all.forEach((e, i) => e.dataset.order = i);
                      return all.length;
                    })()""")
                    order = []
                    for _ in range(controls):
                        self.press(browser, "Tab", 9)
                        order.append(browser.run("Number(document.activeElement.dataset.order ?? -1)"))
                    dates = [order[i] for i in range(len(order)) if i == 0 or order[i] != order[i - 1]]
                    self.assertEqual(dates, sorted(dates))
                    self.assertNotIn(-1, order)

    def test_enter_on_a_link_opens_its_view_and_the_skip_link_comes_first(self):
        with Chromium(CHROMIUM) as browser:
            self.open(browser, "/valves", "Test sessions")
            self.press(browser, "Tab", 9)
            self.assertEqual(browser.run("document.activeElement.innerText"), "Skip to the content")
            self.press(browser, "Enter", 13)
            self.assertEqual(browser.run("document.activeElement.id"), "view")
            browser.run(f"document.querySelector('a[href$=\"{urllib.parse.quote(self.submission)}\"]').focus()")
            self.press(browser, "Enter", 13)
            browser.wait_for_text("What the simulation gets wrong")

    def test_nothing_jumps_while_a_view_loads(self):
        with Chromium(CHROMIUM) as browser:
            for name, (address, text) in self.views.items():
                with self.subTest(view=name):
                    self.open(browser, address, text)
                    shift = browser.run("""new Promise((resolve) => {
                      let sum = 0;
                      new PerformanceObserver((list) => list.getEntries().forEach((e) => sum += e.hadRecentInput ? 0 : e.value))
                        .observe({type: 'layout-shift', buffered: true});
                      setTimeout(() => resolve(sum), 300);
                    })""")
                    # The bound of a good page (web.dev, cumulative layout shift) is 0.1.
                    self.assertLess(shift, 0.1)


if __name__ == "__main__":
    CHROMIUM, SERVER = sys.argv[1:3]
    if "Axe" in sys.argv[3:] and not AXE.exists():
        print(f"skipped: {AXE} is not there; deploy/setup installs it where npm is")
        sys.exit(77)
    unittest.main(argv=sys.argv[:1] + sys.argv[3:], verbosity=2)
