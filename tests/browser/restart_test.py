"""The page while its server is killed in the middle of a job and comes back.

usage: restart_test.py CHROMIUM SERVER      SERVER is contract_http
"""
import pathlib
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).parent))
from chromium import Chromium  # noqa: E402
from page_server import Server, recording  # noqa: E402

SILENT = "The server does not answer."


class Restart(unittest.TestCase):
    def setUp(self):
        self._folder = tempfile.TemporaryDirectory(prefix="valvetriage-")
        self.folder = pathlib.Path(self._folder.name)
        (self.folder / "data").mkdir()
        self.server = Server(SERVER, str(self.folder / "data"))
        self.file = self.folder / "steps.csv"
        # The analysis ends as soon as there is a file "go".
        self.file.write_text(recording("EFC-1", "2026-W31-B", complaint=f"wait {self.folder / 'go'}"))

    def tearDown(self):
        self.server.end()
        self._folder.cleanup()

    def upload(self, browser):
        browser.open(f"{self.server.url}/#/upload")
        browser.wait_for_text("Drop recordings here")
        browser.set_files("#choose-files", [self.file])
        browser.wait_for_text("Upload 1 valve")
        browser.run("document.querySelector('button.primary').click()")
        browser.wait_for_text("analysing")

    def kill_and_restart(self, browser):
        self.server.kill()
        browser.wait_for_text(SILENT)
        self.server.start()
        browser.wait(f"!document.body.innerText.includes('{SILENT}')")

    def test_the_upload_goes_on_and_ends_with_the_verdict(self):
        with Chromium(CHROMIUM) as browser:
            self.upload(browser)
            self.kill_and_restart(browser)
            self.assertNotIn("1 of 1", browser.text())
            (self.folder / "go").touch()
            browser.wait_for_text("1 of 1 valve has ended.")
            self.assertIn("● Good EFC-1", browser.text())

    def test_the_row_of_a_list_follows_its_session_to_the_verdict(self):
        with Chromium(CHROMIUM) as browser:
            self.upload(browser)
            browser.open("about:blank")
            browser.open(f"{self.server.url}/#/valves?sort=Serial")
            browser.wait_for_text("running")
            self.kill_and_restart(browser)
            (self.folder / "go").touch()
            browser.wait("document.querySelector('main tbody tr').innerText.includes('● Good')")
            self.assertEqual(browser.run("document.querySelector('main tbody tr').cells[5].textContent"), "1")
            self.assertIn("Serial", browser.run("document.querySelector('th[aria-sort]').textContent"))

    def test_the_valve_that_is_waited_for_shows_its_result(self):
        with Chromium(CHROMIUM) as browser:
            self.upload(browser)
            submission = self.server.get("/v1/submissions")["items"][0]["id"]
            browser.open("about:blank")
            browser.open(f"{self.server.url}/#/valve/{submission}")
            browser.wait_for_text("running")
            self.kill_and_restart(browser)
            (self.folder / "go").touch()
            browser.wait_for_text("The simulation is wrong because it lacks friction.")


if __name__ == "__main__":
    CHROMIUM, SERVER = sys.argv[1:3]
    unittest.main(argv=sys.argv[:1] + sys.argv[3:], verbosity=2)
