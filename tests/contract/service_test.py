"""The real binary, server and client: documents uploaded, valves judged with them, retries, exit statuses, tokens.

usage: service_test.py VALVETRIAGE VALVETRIAGE_STAND
"""
import csv
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import time
import unittest

from lossy_relay import LossyRelay
from running_service import RunningService

BINARY, STAND = sys.argv[1:3]
TYPE = "type-1"


def run(*command):
    return subprocess.run([str(part) for part in command], capture_output=True, text=True, check=True).stdout


def recordings(valve):
    return sorted(pathlib.Path(valve).glob("*.csv"))


class Documents:
    """Three good valves, their reference, and a rule base: severe is ten times what a good valve leaves."""

    def __init__(self, folder):
        self.folder = pathlib.Path(folder)
        run(STAND, "population", "--out", self.folder / "good", "--valves", 3, "--tests", "step")
        self.good = sorted(path for path in (self.folder / "good").iterdir() if path.is_dir())
        self.reference, self.rules = self.folder / "reference.json", self.folder / "rules.json"
        run(BINARY, "reference", "learn", self.folder / "good", "--valve-type", TYPE, "-o", self.reference)
        run(BINARY, "rule-base", "learn", self._table(), "--reference", self.reference, "-o", self.rules)

    def analysis(self, valve, *options):
        return json.loads(run(BINARY, "analyze", *recordings(valve), "--reference", self.reference, *options, "--json"))

    def _table(self):
        levels = [{f"error_{level['level_A']:.1f}": level["error_eq20"]
                   for level in self.analysis(valve)["simulation"]["by_level"] if level["error_eq20"] is not None}
                  for valve in self.good]
        table = self.folder / "table.csv"
        with open(table, "w", newline="", encoding="utf-8") as file:
            out = csv.writer(file)
            out.writerow([*levels[0], "verdict"])
            for verdict, scale in (("Good", 1), ("Malfunctioned", 4), ("Severe", 10)):
                out.writerows([*(scale * error for error in valve.values()), verdict] for valve in levels)
        return table


class Service(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.documents = Documents(cls.enterClassContext(tempfile.TemporaryDirectory(prefix="valvetriage-")))
        cls.service = cls.enterClassContext(RunningService(BINARY))

    def upload_documents(self, valve_type=TYPE):
        for route, file in (("references", self.documents.reference), ("rule-bases", self.documents.rules)):
            status, stored = self.service.request(f"/v1/valve-types/{valve_type}/{route}", file.read_text())
            self.assertEqual(status, 201, stored)
            self.assertGreaterEqual(stored["version"], 1)

    def unnamed_recording(self):
        """A recording of a good valve that does not say of which: no document serves it."""
        file = self.service.folder / "unnamed.csv"
        lines = recordings(self.documents.good[2])[0].read_text().splitlines(keepends=True)
        file.write_text("".join(line for line in lines if not line.startswith("#")))
        return file

    def test_a_submission_is_judged_with_uploaded_documents_as_the_verb_judges_it(self):
        self.upload_documents()
        valve = self.documents.good[0]
        status, [submission] = self.service.submit(valve, "--valve-type", TYPE)
        self.assertEqual((status, submission["verdict"]), (0, "Good"))
        over_http = self.service.get(submission["links"]["analysis"])
        by_the_verb = self.documents.analysis(valve, "--rule-base", self.documents.rules)
        self.assertEqual(over_http["engine"], by_the_verb["engine"])
        self.assertEqual(over_http["result_sha256"], by_the_verb["result_sha256"])
        stored = self.service.get(f"/v1/valve-types/{TYPE}/references")["items"]
        self.assertEqual(over_http["baseline"]["reference"]["version"], max(row["version"] for row in stored))
        for route, said in (("references", over_http["baseline"]["reference"]),
                            ("rule-bases", over_http["classification"]["rule_base"])):
            newest = self.service.get(f"/v1/valve-types/{TYPE}/{route}")["items"][0]
            self.assertEqual(newest["sha256"], said["sha256"], "list and analysis call a document by one hash")

        status, job = self.service.request(submission["links"]["self"] + "/reanalyze", "")
        self.assertEqual(status, 202, job)
        while self.service.get(f"/v1/jobs/{job['id']}")["state"] in ("queued", "running"):
            time.sleep(0.05)
        analyses = self.service.get(submission["links"]["analyses"])["items"]
        self.assertEqual([analysis["result_sha256"] for analysis in analyses], [by_the_verb["result_sha256"]] * 2)

    def learned_from(self, service, valves):
        sent = [service.submit(*recordings(valve))[1][0] for valve in valves]
        ids = [submission["links"]["self"].rpartition("/")[2] for submission in sent]
        return service.request(f"/v1/valve-types/{TYPE}/references", json.dumps({"submissions": ids}))

    def test_a_reference_learned_from_submissions_is_the_one_that_the_verb_learns(self):
        with RunningService(BINARY) as service:
            status, stored = self.learned_from(service, self.documents.good)
            self.assertEqual(status, 201, stored)
            learned, by_the_verb = service.get(stored["links"]["self"]), json.loads(self.documents.reference.read_text())
            for document in (learned, by_the_verb):
                document.pop("version", None)
            self.assertEqual(learned, by_the_verb)

    def test_two_good_valves_are_too_few_to_learn_from(self):
        with RunningService(BINARY) as service:
            status, problem = self.learned_from(service, self.documents.good[:2])
            self.assertEqual((status, problem["code"]), (422, "too_few_valves"))

    def test_the_exit_status_tells_good_from_rejected_from_undecided(self):
        self.upload_documents()
        good = self.documents.good[1]
        bad = self.service.folder / "bad.csv"
        bad.write_text("time_s,current_A,pressure_psi\n0,1,x\n")
        self.assertEqual(self.service.submit(good, "--valve-type", TYPE)[0], 0)
        self.assertEqual(self.service.submit(self.unnamed_recording())[0], 3)
        self.assertEqual(self.service.submit(bad)[0], 2)
        self.assertEqual(self.service.submit(good, bad, "--valve-type", TYPE)[0], 2, "some input was rejected")

    def test_a_lost_answer_is_asked_for_again_and_nothing_is_stored_twice(self):
        file = self.unnamed_recording()
        with LossyRelay(self.service.url, lost=2) as relay:
            done = self.service.run("submit", file, "--serial", "LOSSY-1", "--server", relay.url, "--json")
            self.assertGreaterEqual(relay.connections, 3)
        self.assertEqual(done.returncode, 0, done.stdout)
        [sent] = json.loads(done.stdout)["submissions"]
        self.assertEqual([item["id"] for item in self.service.get("/v1/recordings?serial=LOSSY-1")["items"]], [sent["id"]])


class Log(unittest.TestCase):
    def test_a_service_whose_log_nobody_reads_any_more_goes_on(self):
        with RunningService(BINARY, log=subprocess.PIPE) as service:
            service.read_no_log()
            for _ in range(3):
                self.assertEqual(service.request("/healthz")[0], 200)


class Files(unittest.TestCase):
    def test_a_folder_is_served_by_one_service_and_one_database(self):
        with RunningService(BINARY) as service:
            other = service.folder / "other.sqlite"
            serve = ("serve", "--listen", "127.0.0.1:0", "--data-dir", service.data, "--database", other)
            refused = service.run(*serve)
            self.assertEqual(refused.returncode, 1)
            self.assertIn("stop it first", refused.stderr)
            service.stop()
            refused = service.run(*serve)
            self.assertEqual(refused.returncode, 1)
            self.assertIn("there is no database", refused.stderr)
            self.assertFalse(other.exists(), "nothing is made where a disk may be missing")

    def test_a_service_that_starts_in_a_folder_that_is_there_keeps_its_files_from_others(self):
        with RunningService(BINARY, before=lambda service: service.data.mkdir()) as service:
            made = [*service.data.rglob("*")]
            self.assertTrue(made)
            self.assertEqual([str(path) for path in made if path.stat().st_mode & 0o007], [])


class Tokens(unittest.TestCase):
    def setUp(self):
        def first_token(service):
            self.admin = service.run("token", "create", "boss", "--scopes", "admin", "--data-dir",
                                     service.data).stdout.strip()

        self.service = self.enterContext(RunningService(BINARY, "--require-token", before=first_token))
        self.file = self.service.folder / "bad.csv"
        self.file.write_text("time_s,current_A,pressure_psi\n0,1,x\n")

    def token(self, *arguments, secret=None):
        environment = {**os.environ, "VALVETRIAGE_TOKEN": secret or self.admin}
        return self.service.run("token", *arguments, "--server", self.service.url, env=environment)

    def submit_status(self, secret):
        environment = {**os.environ, "VALVETRIAGE_TOKEN": secret}
        return self.service.run("submit", self.file, "--server", self.service.url, "--wait", env=environment).returncode

    def test_tokens_are_made_listed_and_revoked_while_the_server_runs(self):
        made = self.token("create", "upload", "--scopes", "submit,read")
        self.assertEqual(made.returncode, 0, made.stderr)
        secret = made.stdout.strip()
        self.assertEqual(self.submit_status(secret), 2, "the token is taken, the file is not")

        rows = [line.split("\t") for line in self.token("list").stdout.splitlines()]
        self.assertEqual({row[1]: (row[2], row[4]) for row in rows},
                         {"boss": ("admin", "valid"), "upload": ("submit,read", "valid")})
        self.assertNotIn(secret, self.token("list").stdout)

        [token_id] = [row[0] for row in rows if row[1] == "upload"]
        self.assertEqual(self.token("revoke", token_id).returncode, 0)
        self.assertEqual(self.submit_status(secret), 1, "a revoked token is the server's refusal, not bad input")
        self.assertEqual(self.token("revoke", token_id).returncode, 2, "it is revoked already")

    def test_only_an_admin_makes_tokens(self):
        secret = self.token("create", "upload", "--scopes", "submit,read").stdout.strip()
        refused = self.token("create", "more", "--scopes", "admin", secret=secret)
        self.assertEqual((refused.returncode, refused.stdout), (1, ""))
        self.assertIn("admin", refused.stderr)

    def test_an_unknown_scope_is_bad_usage(self):
        self.assertEqual(self.token("create", "x", "--scopes", "root").returncode, 2)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
