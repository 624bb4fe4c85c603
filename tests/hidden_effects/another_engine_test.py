"""The README's way for other programs: always_none.py on a handful of cases, by `run` and by `full`."""
import json
import pathlib
import shlex
import shutil
import subprocess
import sys
import tempfile
import unittest

HERE = pathlib.Path(__file__).resolve().parent
BUILD = pathlib.Path(sys.argv.pop(1)).resolve()
ENGINE = shlex.join([sys.executable, str(HERE / "always_none.py")]) + " {folder} {reference}"

# Ambiguous until the folder holds the test that it asks for.
ASKS_FOR_A_STEP = r"""
import json, os, sys
folder, seen = sys.argv[1:]
names = os.listdir(folder)
open(seen, "a").write(",".join(names) + "\n")
settled = any("next_test" in name for name in names)
rows = [f"{k / 200},{0.3 if k < 200 else 0.6}" for k in range(400)]
print(json.dumps({"discrepancy": {
    "conclusion": "named" if settled else "ambiguous", "candidates": [],
    "causes": [{"cause": "friction", "probability": 0.5, "alternatives": [] if settled else ["backlash"]}],
    "next_test": {"test": "step", "expected_probability": 0.7, "separates": ["friction", "backlash"],
                  "input_csv": "\n".join(["time_s,current_A", *rows, ""])}}}))
"""


class AnotherEngine(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)

    def called(self, program, *arguments):
        command = [sys.executable, HERE / program, "--build", BUILD, "--work", self.folder / "work", *arguments]
        return subprocess.run([str(word) for word in command], check=True, capture_output=True, text=True).stdout

    def test_none_is_right_of_healthy_valves_and_missed_of_faulty_ones(self):
        self.called("run", "--quick", "--only", "healthy-0003", "--only", "single-0007", "--only", "outside-0000",
                    "--engine", ENGINE, "--json", self.folder / "scores.json")
        words = {case["case"]: case["outcome"] for case in json.loads((self.folder / "scores.json").read_text())["cases"]}
        self.assertEqual(words, {"healthy-0003": "right", "single-0007": "missed", "outside-0000": "missed"})

    def test_a_program_that_fails_or_does_not_keep_the_contract_has_failed(self):
        no_conclusion = shlex.join(["printf", "%s", '{"discrepancy": {"causes": []}}'])
        for engine in ("false {folder}", "echo {folder} is no answer", no_conclusion):
            self.called("run", "--quick", "--only", "healthy-0000", "--engine", engine,
                        "--json", self.folder / "scores.json")
            case, = json.loads((self.folder / "scores.json").read_text())["cases"]
            self.assertEqual(case["outcome"], "failed")

    def test_the_full_suite_scores_it_and_a_second_call_asks_nothing_again(self):
        arguments = ["--healthy", "2", "--faulty", "0", "--engine", ENGINE]
        text = self.called("full", *arguments)
        self.assertIn("| all | 1.000 [0.158, 1.000] of 2 |", text)
        answers = (self.folder / "work" / "full" / "answers.jsonl").read_text()
        self.assertEqual(self.called("full", *arguments), text)
        self.assertEqual((self.folder / "work" / "full" / "answers.jsonl").read_text(), answers)

    def test_what_is_published_makes_the_same_tables_where_nothing_was_asked(self):
        drawn = ["--healthy", "1", "--faulty", "1", "--names", "0"]
        file = self.folder / "answers.jsonl.xz"
        text = self.called("full", *drawn, "--engine", ENGINE, "--publish", file)
        shutil.rmtree(self.folder / "work")
        self.assertEqual(self.called("full", *drawn, "--answers", file, "--report").split("```", 2)[2],
                         text.split("```", 2)[2])

    def test_a_run_that_is_taken_up_elsewhere_asks_only_what_is_new_and_only_the_same_program(self):
        seen = self.folder / "seen"
        spy = shlex.join(["sh", "-c", f"echo $0 >> {seen}; echo nothing"]) + " {folder}"
        file = self.folder / "answers.jsonl.xz"
        self.called("full", "--healthy", "1", "--faulty", "0", "--engine", spy, "--publish", file)
        shutil.rmtree(self.folder / "work")
        text = self.called("full", "--healthy", "2", "--faulty", "0", "--engine", spy, "--answers", file)
        self.assertIn("2 of 2 sessions are answered", text)
        self.assertEqual(len(seen.read_text().split()), 2)
        with self.assertRaises(subprocess.CalledProcessError) as refused:
            self.called("full", "--healthy", "2", "--faulty", "0", "--engine", ENGINE, "--answers", file)
        self.assertIn("other builds of engine", refused.exception.stderr)

    def test_the_loop_is_closed_with_the_test_that_was_asked_for_and_the_first_answer_is_not_asked_for_again(self):
        engine = self.folder / "asks_for_a_step.py"
        engine.write_text(ASKS_FOR_A_STEP)
        text = self.called("full", "--healthy", "0", "--faulty", "1", "--names", "0", "--close-loop",
                           "--engine", shlex.join([sys.executable, str(engine)]) + f" {{folder}} {self.folder / 'seen'}")
        self.assertIn("| right_set | right | 1 |", text)
        before, after = (self.folder / "seen").read_text().split()
        self.assertEqual(["next_test" in before, "next_test" in after], [False, True])
        self.assertEqual(list((self.folder / "work" / "next_tests").iterdir()), [])

    def test_the_valves_of_the_full_suite_are_put_through_the_tests_that_are_asked_for(self):
        seen = self.folder / "seen"
        spy = shlex.join(["sh", "-c", f"ls $0 >> {seen}; echo nothing"]) + " {folder}"
        self.called("full", "--healthy", "2", "--faulty", "0", "--tests", "step_up", "--engine", spy)
        self.assertEqual({name.split("_1")[0] for name in seen.read_text().split()}, {"step_up"})

    def test_neither_folder_nor_recording_tells_what_is_hidden(self):
        seen = self.folder / "seen"
        spy = shlex.join(["sh", "-c", f"echo $0 >> {seen}; grep -h '^#' $0/*.csv >> {seen}; echo nothing"]) + " {folder}"
        self.called("run", "--quick", "--only", "single-0000", "--engine", spy)
        text = seen.read_text()
        self.assertIn("# serial: V", text)
        for word in ("single", "friction"):
            self.assertNotIn(word, text)


if __name__ == "__main__":
    unittest.main()
