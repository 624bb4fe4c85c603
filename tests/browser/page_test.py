"""The page in a real Chromium, against a real server whose analyser answers at once with the schema's example.

usage: page_test.py CHROMIUM SERVER [PICTURES]      SERVER is contract_http; PICTURES a folder for screenshots
"""
import datetime
import gzip
import json
import pathlib
import sys
import tempfile
import time
import unittest
import urllib.parse

sys.path.insert(0, str(pathlib.Path(__file__).parent))
from chromium import Chromium  # noqa: E402
from page_server import HOSTILE, Server, mat_file, recording, zstd_frame  # noqa: E402


class Page(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls._folder = tempfile.TemporaryDirectory(prefix="valvetriage-")
        cls.addClassCleanup(cls._folder.cleanup)
        cls.folder = pathlib.Path(cls._folder.name)
        (cls.folder / "data").mkdir()
        if PICTURES:
            pathlib.Path(PICTURES).mkdir(parents=True, exist_ok=True)
        cls.server = Server(SERVER, str(cls.folder / "data"))
        cls.addClassCleanup(cls.server.end)
        cls.browser = Chromium(CHROMIUM)
        cls.browser.__enter__()
        cls.addClassCleanup(cls.browser.__exit__)
        cls.files = [cls.folder / name for name in ("good.csv", "bad.csv", f"{HOSTILE.replace('/', '')}.csv")]
        cls.files[0].write_text(recording("EFC-104233", "2026-W31-B", stuck=True))
        cls.files[1].write_text(recording("EFC-104234", "2026-W31-B", bad_line=9))
        cls.files[2].write_text(recording(HOSTILE, HOSTILE))
        cls.upload()

    @classmethod
    def upload(cls):
        cls.open("/upload", "Drop recordings here")
        cls.browser.set_files("#choose-files", cls.files)
        cls.browser.wait_for_text("Upload 3 valves")
        cls.browser.run("document.querySelector('button.primary').click()")
        cls.browser.wait_for_text("3 of 3 valves have ended.")
        cls.uploaded = cls.browser.text()
        cls.picture("upload")

    @classmethod
    def open(cls, address, text):
        cls.browser.open("about:blank")
        cls.browser.open(f"{cls.server.url}/#{address}")
        cls.browser.wait_for_text(text)

    @classmethod
    def picture(cls, name):
        if PICTURES:
            cls.browser.screenshot(f"{PICTURES}/{name}.png")

    def tearDown(self):
        self.assertEqual(self.browser.errors, [])

    def own_server(self):
        """Another one for this test alone: the lists of the other tests stay as they are."""
        folder = tempfile.TemporaryDirectory(prefix="valvetriage-")
        self.addCleanup(folder.cleanup)
        server = Server(SERVER, folder.name)
        self.addCleanup(server.end)
        self.addCleanup(self.browser.open, "about:blank")
        return server

    def session(self, serial):
        return self.server.get(f"/v1/submissions?serial={urllib.parse.quote(serial, safe='')}")["items"][0]

    def open_valve(self, serial, parameters=""):
        self.open(f"/valve/{self.session(serial)['id']}{parameters}", "What the simulation gets wrong")
        self.browser.wait("document.querySelectorAll('.plots canvas').length >= 3")
        self.browser.wait("!document.querySelector('.plots').innerText.includes('Loading')")

    def test_an_upload_ends_with_the_verdict_or_with_the_place_of_the_mistake(self):
        self.assertIn("● Good EFC-104233", self.uploaded)
        self.assertRegex(self.uploaded, r"rejected .*line 9")
        self.assertIn("n/a", self.uploaded)

    def test_a_rejected_session_blames_the_one_file_that_is_wrong(self):
        server = self.own_server()
        folder = self.folder / "EFC-BLAME"
        folder.mkdir()
        (folder / "sound.csv").write_text(recording("EFC-BLAME", "2026-W44"))
        (folder / "spoilt.csv").write_text(recording("EFC-BLAME", "2026-W44", bad_line=9))
        self.browser.open(f"{server.url}/#/upload")
        self.browser.wait_for_text("Drop recordings here")
        self.browser.drop_files(".drop", [folder])
        self.browser.wait_for_text("Upload 1 valve")
        self.browser.run("document.querySelector('button.primary').click()")
        self.browser.wait_for_text("rejected spoilt.csv: line 9")
        session = server.get("/v1/submissions")["items"][0]["id"]
        self.browser.open(f"{server.url}/#/valve/{session}")
        self.browser.wait_for_text("Rejected spoilt.csv: line 9")
        self.assertEqual(self.browser.text().count("is not a number"), 1)
        self.assertNotIn("sound.csv: line", self.browser.text())

    def test_the_list_filters_and_its_address_can_be_sent(self):
        self.open("/valves", "Test sessions")
        self.assertEqual(self.browser.run("document.querySelectorAll('tbody tr').length"), 3)
        self.browser.run("document.getElementById('f-lot').value = '2026-W31-B'")
        self.browser.run("document.querySelector('form.filters').requestSubmit()")
        self.browser.wait("document.querySelectorAll('tbody tr').length === 2")
        address = self.browser.run("location.hash")
        self.assertIn("lot=2026-W31-B", address)
        self.open(address.removeprefix("#"), "EFC-104234")
        self.assertEqual(self.browser.run("document.querySelectorAll('tbody tr').length"), 2)
        self.picture("list")

    def test_the_list_is_searched_by_serial_verdict_cause_and_date(self):
        day = datetime.date.today()
        before, after = day - datetime.timedelta(days=2), day + datetime.timedelta(days=2)  # whatever the time zone
        for filters, rows in (("serial=EFC-104233", 1), ("verdict=Good", 2), ("verdict=Severe", 0), ("cause=friction", 2), ("cause=backlash", 0),
                              (f"since={before}&until={after}", 3), (f"since={after}", 0), (f"until={before}", 0), ("lot=2026-W31-B&verdict=Good&cause=friction", 1)):
            with self.subTest(filters=filters):
                self.open(f"/valves?{filters}", "Received from")
                self.browser.wait("!document.body.hasAttribute('aria-busy')")
                self.assertEqual(self.browser.run("document.querySelectorAll('tbody tr').length"), rows)
                self.assertEqual("No valve fits these filters." in self.browser.text(), rows == 0)

    def test_a_table_sorts_by_its_heads(self):
        self.open("/valves", "Test sessions")
        serials = "[...document.querySelectorAll('tbody tr td:nth-child(2)')].map((cell) => cell.innerText)"
        click = "[...document.querySelectorAll('thead button')].find((b) => b.innerText.startsWith('Serial')).click()"
        self.browser.run(click)
        rising = self.browser.run(serials)
        self.browser.run(click)
        self.assertEqual(self.browser.run(serials), rising[::-1])
        self.assertEqual(self.browser.run("document.querySelector('[aria-sort]').getAttribute('aria-sort')"), "descending")
        self.assertIn("sort=-Serial", self.browser.run("location.hash"))

    def test_a_long_table_draws_its_first_rows_and_sorts_over_all(self):
        self.open("/lots", "2026-W31-B")
        self.browser.run("""import('/web/table.js').then((m) => document.querySelector('main').replaceChildren(
          m.table([{title: 'Number', value: (row) => row}], [...Array(1500).keys()], {caption: 'Numbers'})))""")
        rows = "document.querySelectorAll('tbody tr').length"
        self.browser.wait(f"{rows} === 200")
        self.assertIn("200 of 1500 rows", self.browser.text())
        sort = "document.querySelector('thead button').click()"
        self.browser.run(f"{sort}; {sort}")
        self.assertEqual(self.browser.run("document.querySelector('tbody td').innerText"), "1499")
        more = "document.querySelector('.pager button').click()"
        self.browser.run(more)
        self.assertEqual(self.browser.run(rows), 1200)
        self.browser.run(more)
        self.assertEqual(self.browser.run(rows), 1500)
        self.assertTrue(self.browser.run("document.querySelector('main .pager').hidden"))

    def test_a_valve_shows_its_cause_with_interval_and_unit(self):
        self.open_valve("EFC-104233")
        text = self.browser.text()
        self.assertIn("The simulation is wrong because it lacks friction.", text)
        self.assertIn("It is the valve's fault.", text)
        self.assertIn("Breakaway 20.0 mA (95 %: 18.0 to 22.0 mA)", text)
        self.assertIn("20.0\u00a0mA (95\u00a0%: 18.0 to 22.0\u00a0mA)", self.browser.run("document.body.innerText"))  # no line ends before a unit
        self.assertIn("holds until the current has moved 20 mA", self.browser.run("document.body.textContent"))
        self.picture("valve")

    def test_a_parameter_that_is_an_index_is_shown_as_what_it_means(self):
        server = self.own_server()
        row = server.send(recording("EFC-ONCE", "2026-W46", complaint="named intermittent"))
        self.browser.open(f"{server.url}/#/valve/{row['submission_id']}")
        self.browser.wait_for_text("Parameters of intermittent")
        cells = self.browser.run("[...document.querySelectorAll('.cause tbody tr')].map((row) => [row.cells[0].innerText, row.cells[1].innerText])")
        self.assertIn(["recording", "steps.csv"], cells)
        self.assertIn("in steps.csv", self.browser.text())

    def test_of_a_valve_that_is_not_good_nothing_wrong_is_not_said(self):
        self.open("/valves", "Test sessions")
        said = self.browser.run("""import('/web/format.js').then((m) => ['Good', 'Malfunctioned', 'Severe', null].map((verdict) =>
          [m.conclusionBeside('none', verdict), m.causeCell({ conclusion: 'none', verdict })]))""")
        self.assertEqual(said, [["Nothing wrong", "none"], ["No cause found", "no cause found"], ["No cause found", "no cause found"], ["Nothing wrong", "none"]])

    def test_on_a_telephone_the_list_shows_the_verdict_beside_the_serial(self):
        self.browser.call("Emulation.setDeviceMetricsOverride", width=390, height=844, deviceScaleFactor=1, mobile=True)
        self.addCleanup(self.browser.call, "Emulation.clearDeviceMetricsOverride")
        self.open("/valves", "Test sessions")
        right = self.browser.run("document.querySelector('td .verdict.good').getBoundingClientRect().right")
        self.assertLessEqual(right, 390)

    def test_a_percent_sign_in_the_address_means_itself(self):
        self.browser.open("about:blank")
        self.browser.open(f"{self.server.url}/#/serial/100%")
        self.browser.wait_for_text("no recording and no finding names the serial '100%'")
        self.browser.errors.clear()  # the console notes the 404

    def test_a_mean_is_written_as_far_as_its_deviation_tells(self):
        self.open("/lots", "2026-W31-B")
        said = self.browser.run("""import('/web/format.js').then((m) =>
          [[0.00015, 0.16], [-0.0001, 0.16], [12.3456, 1.5], [1234.5, 42], [3, 0]].map(([mean, sd]) => m.withDeviation(mean, sd)))""")
        self.assertEqual(said, ["0.00 ± 0.16", "0.00 ± 0.16", "12.3 ± 1.5", "1235 ± 42", "3.00 ± 0"])

    def test_zooming_by_buttons_stays_in_the_address(self):
        self.open_valve("EFC-104233")
        self.browser.run("document.querySelector('[aria-label=\"zoom in\"]').click()")
        self.browser.wait("location.hash.includes('from=')")
        address = self.browser.run("location.hash")
        self.open_valve("EFC-104233", address[address.index("?"):])
        self.assertEqual(self.browser.run("location.hash"), address)

    def test_dragging_over_one_chart_zooms_all_of_them(self):
        self.open_valve("EFC-104233")
        labels = "[...document.querySelectorAll('.chart')].map((chart) => [...chart.querySelectorAll('.dygraph-axis-label-x')].map((l) => l.textContent).join(' '))"
        before = self.browser.run(labels)
        self.assertEqual(len(before), 3)
        self.assertEqual(len(set(before)), 1)
        # The residual, below the output.
        left, top, width = self.browser.run("""(() => {
          const chart = document.querySelectorAll('.chart')[1];
          chart.scrollIntoView({block: 'center'});
          const box = chart.getBoundingClientRect();
          return [box.x, box.y + box.height / 2, box.width];
        })()""")
        for kind, share, pressed in (("mousePressed", 0.4, 1), ("mouseMoved", 0.5, 1), ("mouseMoved", 0.6, 1), ("mouseReleased", 0.6, 0)):
            self.browser.call("Input.dispatchMouseEvent", type=kind, x=left + share * width, y=top, button="left", buttons=pressed, clickCount=1)
        self.browser.wait("location.hash.includes('from=')")
        after = self.browser.run(labels)
        self.assertEqual(len(set(after)), 1)
        self.assertNotEqual(before, after)

    def test_times_are_local_with_utc_on_hover(self):
        received = self.session("EFC-104233")["received_at"]
        self.browser.call("Emulation.setTimezoneOverride", timezoneId="Asia/Kolkata")
        self.addCleanup(self.browser.call, "Emulation.setTimezoneOverride", timezoneId="")
        self.open("/valves?serial=EFC-104233", "Test sessions")
        shown, title = self.browser.run("(() => { const time = document.querySelector('td time'); return [time.textContent, time.title]; })()")
        self.assertEqual(title, received.replace("T", " ").replace("Z", "") + " UTC")
        local = datetime.datetime.fromisoformat(received.replace("Z", "+00:00")) + datetime.timedelta(hours=5, minutes=30)
        self.assertIn(f":{local.minute:02}", shown)  # half an hour beside UTC

    def test_segments_and_quality_items_are_marked_where_they_are(self):
        self.open_valve("EFC-104233")
        self.browser.wait_for_text("Marked in the plots:")
        self.assertIn("stuck, 1.5 to 1.6 s", self.browser.text())
        self.assertIn("step 1.60 A, 0.5 to 1.25 s", self.browser.run("document.querySelector('.plots').textContent"))
        self.browser.run("document.querySelector('.marks button').click()")
        self.browser.wait("location.hash.includes('from=1.45')")

    def test_a_dropped_folder_is_one_session_for_each_folder_in_it(self):
        for serial in ("EFC-A", "EFC-B"):
            (self.folder / "returned" / serial).mkdir(parents=True)
            for name in ("one.csv", "two.csv", "notes.docx"):
                (self.folder / "returned" / serial / name).write_text(recording(serial, "2026-W40"))
        self.open("/upload", "Drop recordings here")
        self.browser.drop_files(".drop", [self.folder / "returned"])
        self.browser.wait_for_text("Upload 2 valves")
        self.browser.wait_for_text("returned/EFC-A: 2 files")  # rows are drawn when they are seen
        text = self.browser.text()
        self.assertIn("2 files are no recordings (CSV, JSON or MAT) and were left out.", text)
        read = "[...document.querySelectorAll('input[aria-label^=\"{} of \"]')].map((input) => input.value).sort()"
        self.assertEqual(self.browser.run(read.format("serial")), ["EFC-A", "EFC-B"])
        self.assertEqual(self.browser.run(read.format("lot")), ["2026-W40", "2026-W40"])

    def test_what_a_file_says_of_itself_is_read_from_json_and_from_gzip_too(self):
        packed = self.folder / "packed.csv.gz"
        packed.write_bytes(gzip.compress(recording("EFC-GZ", "2026-W40").encode()))
        document = self.folder / "document.json"
        document.write_text(json.dumps({"metadata": {"serial": "EFC-JSON", "lot": "2026-W41"}, "columns": {"time_s": [0, 1]}}))
        broken = self.folder / "broken.json"
        broken.write_text("{")
        self.open("/upload", "Drop recordings here")
        self.browser.set_files("#choose-files", [packed, document, broken])
        self.browser.wait_for_text("Upload 3 valves")
        values = {name: self.browser.run(f"document.querySelector('input[aria-label=\"serial of {name}\"]').value")
                  for name in ("packed.csv.gz", "document.json", "broken.json")}
        self.assertEqual(values, {"packed.csv.gz": "EFC-GZ", "document.json": "EFC-JSON", "broken.json": ""})

    def test_the_head_of_a_csv_is_read_by_the_servers_rule(self):
        self.open("/upload", "Drop recordings here")
        head = ("# Serial: EFC-1\n\n# condition: returned    (as sent in)\n# stand: stand-3       # tested_at: 2026-08-03T09:12:44Z    # claim: #7\n"
                "# a remark\n# lot:\n# lot: A # B\ntime_s,current_A\n# valve_type: no\n")
        said = self.browser.run(f"import('/web/file_labels.js').then((m) => m.headLabels({json.dumps(head)}))")
        self.assertEqual(said, {"serial": "EFC-1", "condition": "returned", "stand": "stand-3", "tested_at": "2026-08-03T09:12:44Z", "claim": "#7", "lot": "A"})
        stored = self.own_server().send(head.split("time_s")[0].replace("EFC-1", "EFC-RULE").replace("# lot: A # B", "# lot: by-rule # B")
                                  + recording("x", "y").split("# test: step\n")[1])
        self.assertEqual((stored["serial"], stored["stand"], stored["lot"], stored["condition"]), ("EFC-RULE", "stand-3", "by-rule", "returned"))

    def test_a_file_of_other_column_names_is_uploaded_by_saying_which_is_which(self):
        server = self.own_server()
        other = self.folder / "other.csv"
        other.write_text(recording("EFC-OTHER", "2026-W45").replace("time_s,current_A,pressure_psi", "t_s,coil_A,outlet_psi"))
        self.browser.open(f"{server.url}/#/upload")
        self.browser.wait_for_text("Drop recordings here")
        self.browser.run("document.querySelector('input[placeholder^=\"time=\"]').value = ' time=t_s,input=coil_A,output=outlet_psi '")
        self.browser.set_files("#choose-files", [other])
        self.browser.wait_for_text("Upload 1 valve")
        self.browser.run("document.querySelector('button.primary').click()")
        self.browser.wait_for_text("1 of 1 valve has ended.")
        self.assertIn("● Good EFC-OTHER", self.browser.text())

    def test_mat_files_are_grouped_by_the_labels_inside_them_and_end_like_any_other(self):
        csv = recording("x", "y")
        files = {"one.mat": mat_file(csv, serial="EFC-M1", lot="2026-W44"), "two.mat": mat_file(csv, packed=True, serial="EFC-M2", lot="2026-W44", stand="s3"),
                 "more.mat": mat_file(csv, packed=True, lot="2026-W44", serial="EFC-M1", note="\u00e4" * 5000)}
        for name, content in files.items():
            (self.folder / name).write_bytes(content)
        server = self.own_server()
        self.browser.open(f"{server.url}/#/upload")
        self.browser.wait_for_text("Drop recordings here")
        self.browser.set_files("#choose-files", [self.folder / name for name in files])
        self.browser.wait_for_text("Upload 2 valves")
        value = "document.querySelector('input[aria-label=\"{} of {}\"]').value"
        for name, labels in (("one.mat", ("EFC-M1", "2026-W44", "")), ("two.mat", ("EFC-M2", "2026-W44", "s3"))):
            self.assertEqual(tuple(self.browser.run(value.format(label, name)) for label in ("serial", "lot", "stand")), labels)
        self.browser.run("document.querySelector('button.primary').click()")
        self.browser.wait_for_text("2 of 2 valves have ended.")
        self.assertIn("● Good EFC-M1", self.browser.text())
        rows = server.get("/v1/submissions?lot=2026-W44")["items"]
        self.assertEqual({row["serial"]: row["recordings"] for row in rows}, {"EFC-M1": 2, "EFC-M2": 1})
        self.browser.open(f"{server.url}/#/valve/{rows[0]['id']}")
        self.browser.wait("document.querySelectorAll('.plots canvas').length >= 3")

    def test_a_file_that_the_browser_cannot_open_says_so_and_shows_what_the_server_read_in_it(self):
        plain = self.folder / "plain.csv"
        plain.write_text(recording("EFC-ZST", "2026-W42"))
        packed = self.folder / "packed.csv.zst"
        packed.write_bytes(zstd_frame(plain.read_bytes()))
        damaged = self.folder / "damaged.mat"
        damaged.write_bytes(b"MATLAB 5.0 MAT-file")
        server = self.own_server()
        self.browser.open(f"{server.url}/#/upload")
        self.browser.wait_for_text("Drop recordings here")
        self.browser.set_files("#choose-files", [packed, damaged])
        self.browser.wait_for_text("Upload 2 valves")
        self.browser.wait_for_text("the server reads what this file says of itself")
        serial = "document.querySelector('input[aria-label=\"serial of packed.csv.zst\"]')"
        self.assertEqual(self.browser.run(f"{serial}.value"), "")
        self.browser.run("document.querySelector('button.primary').click()")
        self.browser.wait_for_text("2 of 2 valves have ended.")
        self.assertRegex(self.browser.text(), r"rejected .*MAT file: found a damaged head")
        self.assertEqual(self.browser.run(f"[{serial}.value, {serial}.readOnly]"), ["EFC-ZST", True])

    def test_an_analysis_that_ended_without_its_files_fault_may_be_started_again(self):
        go = self.folder / "go"
        file = self.folder / "held.csv"
        file.write_text(recording("EFC-HELD", "2026-W43", complaint=f"wait {go}"))
        server = self.own_server()
        self.browser.open(f"{server.url}/#/upload")
        self.browser.wait_for_text("Drop recordings here")
        self.browser.set_files("#choose-files", [file])
        self.browser.wait_for_text("Upload 1 valve")
        self.browser.run("document.querySelector('button.primary').click()")
        self.browser.wait_for_text("analysing")
        server.post(f"/v1/jobs/{server.get('/v1/submissions')['items'][0]['job_id']}/cancel", {})
        self.browser.wait_for_text("1 of 1 valve has ended.")
        self.browser.wait_for_text("cancelled")
        go.touch()
        self.browser.run("document.querySelector('main table button').click()")
        self.browser.wait_for_text("● Good EFC-HELD")
        self.browser.wait_for_text("1 of 1 valve has ended.")
        self.assertEqual(len(server.get("/v1/submissions")["items"]), 1)
        # A later analysis that gives nothing leaves the result standing, and the page says so.
        go.unlink()
        session = server.get("/v1/submissions")["items"][0]["id"]
        job = server.post(f"/v1/submissions/{session}/reanalyze", {})
        server.post(f"/v1/jobs/{job['id']}/cancel", {})
        self.browser.open("about:blank")
        self.browser.open(f"{server.url}/#/valve/{session}")
        self.browser.wait_for_text("The newest analysis: cancelled. Shown is the result before it.")
        self.assertIn("● Good", self.browser.text())

    def test_a_label_that_contradicts_its_file_is_refused_in_words_and_may_be_sent_again(self):
        file = self.folder / "contradicted.csv"
        file.write_text(recording("EFC-77", "2026-W40"))
        self.open("/upload", "Drop recordings here")
        self.browser.set_files("#choose-files", [file])
        self.browser.wait_for_text("Upload 1 valve")
        serial = "document.querySelector('input[aria-label=\"serial of contradicted.csv\"]')"
        self.browser.run(f"{serial}.value = 'EFC-78'")
        self.browser.run("document.querySelector('button.primary').click()")
        self.browser.wait_for_text("EFC-77")
        self.assertIn("EFC-78", self.browser.text())
        self.assertFalse(self.browser.run("document.querySelector('main table button').hidden"))
        self.browser.errors.clear()  # the console notes the 422

    def saved(self, button, name, folder):
        """What a click on the button with this text saves under this name."""
        self.browser.run(f"[...document.querySelectorAll('button')].find((b) => b.textContent.startsWith({json.dumps(button)})).click()")
        deadline = time.monotonic() + 20
        while not (folder / name).exists():
            self.assertLess(time.monotonic(), deadline, f"{button}: {[file.name for file in folder.iterdir()]}")
            time.sleep(0.05)
        return (folder / name).read_bytes()

    def test_what_is_downloaded_has_its_name_and_its_content(self):
        folder = self.folder / "saved"
        folder.mkdir()
        self.browser.save_to(folder)
        self.open_valve("EFC-104233")
        session = self.session("EFC-104233")
        analysis = self.server.get(f"{session['links']['self']}/analysis")
        self.assertEqual(self.saved("raw file", "good.csv", folder), self.files[0].read_bytes())
        self.assertEqual(json.loads(self.saved("analysis (JSON)", "EFC-104233.json", folder)), analysis)
        for what in ("measured", "simulated", "residual"):
            rows = self.saved(f"{what} (CSV)", f"good.csv-{what}.csv", folder).decode().splitlines()
            self.assertEqual((rows[0].split(",")[0], len(rows)), ("time_s", 401), what)
        measured = [row.split(",") for row in (folder / "good.csv-measured.csv").read_text().splitlines()[1:]]
        self.assertEqual(float(measured[0][1]), float(self.files[0].read_text().splitlines()[4].split(",")[2]))
        self.open("/valves?serial=EFC-104233", "Test sessions")
        rows = self.saved("these as CSV", "valves.csv", folder).decode().splitlines()
        self.assertIn(session["id"], rows[1])
        self.assertEqual(len(rows), 2)

    def test_a_valve_whose_analysis_runs_claims_nothing_of_its_result(self):
        server, go = self.own_server(), self.folder / "go on"
        self.addCleanup(go.touch)
        row = server.post("/v1/recordings?name=held.csv", recording("EFC-WAITS", "2026-W43", complaint=f"wait {go}"))
        self.browser.open(f"{server.url}/#/valve/{row['submission_id']}")
        self.browser.wait_for_text("measured (CSV)")
        text = self.browser.text()
        for claim in ("Nothing odd", "simulated (CSV)", "residual (CSV)", "Verdict"):
            self.assertNotIn(claim, text)
        go.touch()
        self.browser.wait_for_text("simulated (CSV)")
        self.assertIn("Verdict", self.browser.text())

    def test_a_lot_tells_when_more_of_it_has_been_analysed(self):
        server, go = self.own_server(), self.folder / "go at last"
        self.addCleanup(go.touch)
        server.send(recording("EFC-1", "2026-W45"))
        server.post("/v1/recordings?name=held.csv", recording("EFC-2", "2026-W45", complaint=f"wait {go}"))
        self.browser.open(f"{server.url}/#/lot/2026-W45")
        self.browser.wait_for_text("2 valves in 2 sessions, 1 analysed")
        self.assertNotIn("more valve", self.browser.text())
        place = "document.querySelector('h2').getBoundingClientRect().top"
        before = self.browser.run(place)
        go.touch()
        self.browser.wait_for_text("1 more valve has been analysed since.")
        self.assertIn("1 analysed", self.browser.text())
        self.assertEqual(self.browser.run(place), before)
        self.browser.run("[...document.querySelectorAll('main button')].find((b) => b.textContent === 'Show').click()")
        self.browser.wait_for_text("2 valves in 2 sessions, 2 analysed")
        self.assertNotIn("more valve", self.browser.text())

    def test_a_verdict_column_carries_the_sign_of_its_verdict(self):
        self.open("/lots", "2026-W31-B")
        self.browser.run("""import('/web/chart.js').then((m) => document.querySelector('main').replaceChildren(m.verdictColumns(
          ['Good', 'Malfunctioned', 'Severe', null].map((verdict) => ({verdict, received_at: ''})), () => '')))""")
        self.assertEqual(self.browser.run("[...document.querySelectorAll('.sign .mark')].map((mark) => mark.tagName)"), ["circle", "path", "rect"])

    def test_the_input_of_the_next_test_is_downloaded_under_the_valves_name(self):
        server = self.own_server()
        row = server.send(recording("EFC-NEXT", "2026-W31-B", complaint="ambiguous"))
        folder = self.folder / "next"
        folder.mkdir()
        self.browser.save_to(folder)
        self.browser.open(f"{server.url}/#/valve/{row['submission_id']}")
        self.browser.wait_for_text("Download its current")
        self.assertEqual(self.saved("Download its current", "EFC-NEXT-next-test.csv", folder), b"time_s,current_A\n0,1.2\n0.005,1.21\n")

    def test_a_download_that_fails_says_so(self):
        self.open_valve("EFC-104233")
        self.browser.run("window.fetch = () => Promise.reject(new TypeError('no connection'))")
        self.browser.run("[...document.querySelectorAll('button')].find((b) => b.textContent === 'analysis (JSON)').click()")
        self.browser.wait_for_text("EFC-104233.json could not be fetched: no connection")

    def test_a_finding_is_stored(self):
        self.open_valve("EFC-104233")
        self.browser.run("""{
          const form = document.querySelector('form.finding');
          form.querySelector('select').value = 'friction';
          form.querySelector('input').value = 'J. Meyer';
          form.querySelector('textarea').value = '<b>scored</b> spool';
          form.querySelector('button').click();
        }""")
        self.browser.wait_for_text("Stored.")
        self.assertIn("<b>scored</b> spool", self.browser.text())
        self.assertEqual(self.server.get("/v1/valves/EFC-104233")["findings"][0]["cause"], "friction")

    def test_what_a_user_wrote_stays_text(self):
        self.open("/valves", HOSTILE)
        self.open_valve(HOSTILE)
        self.assertIn(HOSTILE, self.browser.text())
        quoted = urllib.parse.quote(HOSTILE, safe="")
        self.open(f"/serial/{quoted}", HOSTILE)
        self.open(f"/lot/{quoted}", HOSTILE)
        self.browser.wait_for_text("Valves by verdict")
        self.assertIsNone(self.browser.run("document.querySelector('main img')"))
        self.assertIsNone(self.browser.run("window.hacked ?? null"))

    def test_teardown_stands_beside_what_was_named(self):
        self.server.post(f"/v1/valves/{urllib.parse.quote(HOSTILE, safe='')}/findings", {"cause": HOSTILE, "who": "kim"})
        self.open("/teardown", "Named and found")
        self.assertEqual(self.browser.run("document.querySelector('thead th:last-child').innerText"), "All")
        self.assertIn("teardown found that cause in", self.browser.text())
        self.assertIn(HOSTILE, self.browser.run("document.querySelector('table.confusion').textContent"))
        self.assertIsNone(self.browser.run("document.querySelector('main img')"))
        self.picture("teardown")
        self.browser.call("Emulation.setDeviceMetricsOverride", width=390, height=844, deviceScaleFactor=1, mobile=True)
        self.addCleanup(self.browser.call, "Emulation.clearDeviceMetricsOverride")
        self.assertLessEqual(self.browser.run("document.documentElement.scrollWidth"), 390)

    def test_two_lots_stand_beside_each_other(self):
        self.open(f"/compare?lot=2026-W31-B&with_lot={urllib.parse.quote(HOSTILE, safe='')}", "Error by level")
        text = self.browser.text()
        self.assertIn(f"lot 2026-W31-B: 1 valve; lot {HOSTILE}: 1 valve.", text)
        self.assertIn("too few", text)
        good = [f"#/lot/{lot}?verdict=Good" for lot in ("2026-W31-B", HOSTILE)]
        self.assertEqual(self.browser.run("[...document.querySelectorAll('main section td a')].slice(0, 2).map((a) => decodeURIComponent(a.hash))"), good)
        self.assertIsNone(self.browser.run("document.querySelector('main img')"))
        self.picture("compare")

    def test_an_alarm_names_the_stand_its_cause_and_the_valves_to_look_at(self):
        self.open("/lots", "2026-W31-B")
        self.browser.run("""import('/web/compare_view.js').then((m) => document.querySelector('main').replaceChildren(m.alarmList([
          {stand: '<b>stand-3', cause: 'sensor_offset', current: true, valves: [1, 2].map((i) => ({submission_id: `sub_${i}`, serial: `S${i}`}))}])))""")
        self.browser.wait_for_text("Look at <b>stand-3. 2 valves in a row show sensor offset, which is the stand's: S1, S2.")

    def test_a_lot_counts_its_valves(self):
        self.open("/lots", "2026-W31-B")
        self.open("/lot/2026-W31-B", "Valves by verdict")
        self.assertIn("2 valves in 2 sessions, 1 analysed", self.browser.text())
        self.picture("lot")

    def test_every_bar_column_and_number_of_a_lot_leads_to_the_valves_it_counts(self):
        server = self.own_server()
        # Three causes; no verdict is asked for, so that all are Good. One serial comes twice and counts once.
        for serial, stand, complaint in (("A", "s1", "named friction"), ("A", "s1", "named friction leakage"), ("B", "s2", "named friction"), ("C", "s1", "unexplained"),
                                         ("D", "s2", "unexplained"), ("E", "s1", "ambiguous"), ("F", "s1", "none")):
            server.send(recording(serial, HOSTILE, stand=stand, complaint=complaint))
        lot = f"{server.url}/#/lot/{urllib.parse.quote(HOSTILE, safe='')}"
        self.browser.open(lot)
        self.browser.wait_for_text("Pattern 1: 2 valves")
        bars = self.browser.run("[...document.querySelectorAll('.bars tr')].map((row) => [row.cells[0].innerText, row.querySelector('a')?.hash, parseInt(row.cells[2].innerText)])")
        self.assertEqual([(name, count) for name, _, count in bars],
                         [("Good", 6), ("Malfunctioned", 0), ("Severe", 0), ("Friction", 2), ("Leakage", 1), ("Not settled", 1), ("Unexplained", 2)])
        numbers = self.browser.run("""[...document.querySelectorAll('section[aria-labelledby=h-stands] td a')].filter((a) => /^[0-9]+$/.test(a.innerText))
          .map((a) => [a.innerText, a.hash, Number(a.innerText)])""")
        self.assertEqual(len(numbers), 6)  # Good, named and unexplained of two stands
        self.browser.run("document.querySelector('svg[aria-label^=\"Verdicts of 6 valves\"] .opens').dispatchEvent(new MouseEvent('click', {bubbles: true}))")
        self.browser.wait("document.querySelectorAll('tbody tr').length === 1")
        self.assertIn("verdict=Good&first=", self.browser.run("location.hash"))
        for name, address, count in bars + numbers:
            with self.subTest(bar=name, address=address):
                self.browser.open("about:blank")
                self.browser.open(f"{server.url}/{address}")
                self.browser.wait_for_text(f"{count} of 6 analysed valves: ")
                self.assertEqual(self.browser.run("document.querySelectorAll('tbody tr').length"), count)
        self.assertIsNone(self.browser.run("document.querySelector('main img')"))
        self.browser.run("[...document.querySelectorAll('main a')].find((a) => a.innerText === 'The whole lot').click()")
        self.browser.wait_for_text("Verdicts over time")

    def test_a_lot_shows_how_large_its_causes_are_and_how_many_names_may_be_false(self):
        self.open("/lot/2026-W31-B", "Sizes of the causes")
        self.browser.wait_for_text("breakaway_A")
        text = self.browser.text()
        self.assertIn("Of 1 name, fewer than 0.1 are expected to be false", text)
        self.assertIn("1 valve: 20.0 mA; lines are 95 % intervals, the band is good valves (4.0 ± 2.0 mA).", text)
        self.assertEqual(self.browser.run("import('/web/lot_parameters.js').then((m) => m.quantile([1, 2, 4], 0.75))"), 3)

    def test_a_pattern_shows_its_members_and_its_mean_residual(self):
        self.open("/lot/2026-W31-B", "No valve of this lot is unexplained.")
        self.browser.run("""import('/web/lot_patterns.js').then((m) => {
          const time_s = [...Array(64).keys()].map((i) => (i + 0.5) / 3.2);
          const mean = time_s.map((t, i) => (i === 9 ? null : Math.exp(-((t - 8) ** 2))));
          const group = {members: [1, 2, 3].map((i) => ({submission_id: `sub_${i}`, serial: `S${i}`, stand: '<i>stand-3', typicality: 0.9})),
            residuals: [{test: 'step, 20.0 s', time_s, mean, sd: mean.map(() => 0.1), good: mean.map(() => 0.02)}]};
          document.querySelector('main').replaceChildren(m.patternGroup(group, 1));
        })""")
        self.browser.wait_for_text("Pattern 1: 3 valves")
        self.assertIn("S1 (0.90), S2 (0.90), S3 (0.90).\n\nAll were tested on <i>stand-3.", self.browser.text())
        self.assertEqual(self.browser.run("document.querySelectorAll('svg .response').length"), 2)
        self.assertNotIn("NaN", self.browser.run("document.querySelector('svg').outerHTML"))

    def test_a_lot_names_the_rules_that_fired(self):
        self.open("/lot/2026-W31-B", "Figures over time")
        self.assertEqual(self.browser.run("import('/web/lot_view.js').then((m) => m.runs([1, 5, 5, 5, 5, 5, 5, 5, 5, 1, 5], 3))"), [[1, 8]])
        self.assertEqual(self.browser.run("import('/web/lot_view.js').then((m) => m.runs([5, 5, 5, 5, 5, 5, 5, 1], 3))"), [])
        self.assertEqual(self.browser.run("import('/web/lot_view.js').then((m) => m.runs(Array(12).fill(3), 3))"), [])  # on the mean is on no side
        self.assertEqual(self.browser.run("import('/web/chart.js').then((m) => m.ticks(0, 0.35))"), [0, 0.1, 0.2, 0.3])
        self.browser.run("""import('/web/lot_view.js').then((m) => {
          const errors = [10, 11, 10, 11, 10, 11, 10, 11, 10, 90];
          const valves = errors.map((error, i) => ({submission_id: `sub_${i}`, serial: `S${i}`, verdict: 'Good', causes: [], errors: [{level_A: 1.4, error_eq20: error}]}));
          const level = {level_A: 1.4, centre: 18.4, upper_limit: 45, lower_limit: 0, outside: ['sub_9']};
          const [error] = m.figuresOf({levels: [level], features: []});
          document.querySelector('main').replaceChildren(m.controlCharts(error, valves));
        })""")
        text = self.browser.text()
        self.assertIn("Outside the limits: S9: 90.0", text)
        self.assertIn("Run of 8 or more: 9 valves in a row on one side of the mean, from S0 to S8", text)
        self.assertIn("Moving range: the step to S9 is larger than the moving range allows: 80.0", text)
        self.assertEqual(self.browser.run("document.querySelectorAll('.lot-chart .ring').length"), 2)

    def test_a_lot_charts_the_figures_of_its_frequency_responses(self):
        self.open("/lot/2026-W31-B", "Figures over time")
        self.browser.run("""import('/web/lot_view.js').then((m) => {
          const valves = [-24, -26].map((slope, i) => ({submission_id: `sub_${i}`, serial: `S${i}`, verdict: 'Good', causes: [], errors: [], features: {rolloff_db_per_decade: slope}}));
          const feature = {name: 'rolloff_db_per_decade', centre: -25, upper_limit: -20, lower_limit: -30, outside: []};
          const [rolloff] = m.figuresOf({levels: [], features: [feature]});
          document.querySelector('main').replaceChildren(m.controlCharts(rolloff, valves));
        })""")
        text = self.browser.text()
        self.assertIn("Rolloff [dB/decade]", text)
        self.assertIn("lower limit -30", text)

    def test_a_report_opens_and_runs_nothing(self):
        self.open_valve("EFC-104233")
        self.browser.open(self.browser.run("document.querySelector('a.report').href"))
        self.browser.wait_for_text("How it was made")
        text = self.browser.text()
        self.assertIn("Valve EFC-104233", text)
        self.assertIn("Settings (sha256)", text)
        self.assertEqual(self.browser.run("document.scripts.length"), 0)
        self.picture("report")
        lot = urllib.parse.quote(HOSTILE, safe="")
        self.browser.open(f"{self.server.url}/v1/lots/{lot}/report")
        self.browser.wait_for_text(f"Lot {HOSTILE}")
        self.assertIsNone(self.browser.run("document.querySelector('img')"))

    def test_a_sweep_shows_gain_and_phase_over_frequency(self):
        self.open("/lots", "2026-W31-B")
        self.assertEqual(self.browser.run("import('/web/bode_chart.js').then((m) => m.decades(0.09, 21))"), [0.1, 0.2, 0.5, 1, 2, 5, 10, 20])
        self.assertEqual(self.browser.run("import('/web/bode_chart.js').then((m) => m.decades(0.01, 100))"), [0.01, 0.1, 1, 10, 100])
        self.browser.run("""import('/web/bode_chart.js').then((m) => {
          const frequency_hz = [...Array(40).keys()].map((i) => 0.1 * 1.15 ** i);
          const gain = frequency_hz.map((f) => 120 / Math.hypot(1, f / 3));
          const entry = {frequency_hz, gain, band95: gain.map((g) => [0.9 * g, 1.1 * g]), phase_deg: frequency_hz.map((f) => -57.3 * Math.atan(f / 3))};
          document.querySelector('main').replaceChildren(m.bodeChart(entry, 'psi/A'));
        })""")
        text = self.browser.run("document.querySelector('svg').textContent")
        self.assertIn("gain [psi/A]", text)
        self.assertIn("phase [°]", text)
        self.assertIn("frequency [Hz]", text)
        self.assertEqual(self.browser.run("document.querySelectorAll('svg .response').length"), 2)
        self.assertNotIn("NaN", self.browser.run("document.querySelector('svg').outerHTML"))
        self.assertIsNone(self.browser.run("import('/web/bode_chart.js').then((m) => m.bodeChart({frequency_hz: [], gain: [], band95: [], phase_deg: []}, ''))"))
        self.picture("bode")

    def test_a_missing_valve_says_so(self):
        self.browser.open("about:blank")
        self.browser.open(f"{self.server.url}/#/valve/sub_none")
        self.browser.wait_for_text("there is no submission 'sub_none'")
        self.browser.errors.clear()  # the console notes the 404


if __name__ == "__main__":
    CHROMIUM, SERVER = sys.argv[1:3]
    PICTURES = sys.argv[3] if len(sys.argv) > 3 else None
    unittest.main(argv=sys.argv[:1], verbosity=2)
