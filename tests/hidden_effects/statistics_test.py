"""Bounds of shares, calibration of probabilities, and the tables of RESULTS.md, on numbers that are made up."""
import math
import pathlib
import tempfile
import unittest

import answer_tables
import binomial
import calibration
import comparison_tables
import detection_tables
from kept import Kept


def outcome(kind="single", hidden=("friction",), said=(), **more):
    return {"case": "single-0001", "kind": kind, "hidden": list(hidden), "sizes": [0.01] * len(hidden), "decoy": "",
            "d": 20.0, "d_weaker": None, "d_name": 10.0, "oracle_set": 1.0, "conclusion": "named", "said": [list(one) for one in said],
            "confident_wrong": False, "set_size": 1, "truth_inside": True, "parameters": [], "top_candidates": [],
            "truth": {"effects": []}, "outcome": "right", "failure": None} | more


class Bounds(unittest.TestCase):
    def test_where_nothing_or_everything_came_true_the_bound_has_a_closed_form(self):
        low, high = binomial.bounds(0, 60)
        self.assertEqual(low, 0)
        self.assertAlmostEqual(high, 1 - 0.025 ** (1 / 60), places=12)
        low, high = binomial.bounds(60, 60)
        self.assertAlmostEqual(low, 0.025 ** (1 / 60), places=12)
        self.assertEqual(high, 1)

    def test_tails_beyond_the_bounds_have_the_asked_probability(self):
        for k, n, level in ((3, 10, 0.95), (57, 60, 0.999), (1500, 3000, 0.95)):
            low, high = binomial.bounds(k, n, level)
            self.assertAlmostEqual(binomial.tail(k, n, low), (1 - level) / 2, places=9)
            self.assertAlmostEqual(1 - binomial.tail(k + 1, n, high), (1 - level) / 2, places=9)

    def test_of_ten_chances_of_a_half_the_tail_is_counted(self):
        self.assertAlmostEqual(binomial.tail(8, 10, 0.5), (45 + 10 + 1) / 1024, places=12)

    def test_nothing_counted_says_nothing(self):
        self.assertEqual(binomial.bounds(0, 0), (0, 1))
        self.assertEqual(binomial.rate(0, 0), "-")


class Calibration(unittest.TestCase):
    def test_certainty_that_comes_true_costs_nothing_and_that_does_not_costs_one(self):
        self.assertEqual(calibration.brier([(1.0, True), (0.0, False)]), 0)
        self.assertEqual(calibration.brier([(1.0, False)]), 1)
        self.assertIsNone(calibration.brier([]))

    def test_the_expected_error_is_the_gap_of_each_bin_by_its_weight(self):
        calibrated = [(0.75, True)] * 3 + [(0.75, False)]
        self.assertAlmostEqual(calibration.expected_error(calibrated), 0)
        boastful = [(0.95, True), (0.95, False)]
        self.assertAlmostEqual(calibration.expected_error(boastful), 0.45)
        self.assertAlmostEqual(calibration.expected_error(calibrated + boastful), 2 * 0.45 / 6)

    def test_gaps_of_opposite_sign_do_not_cancel_across_bins(self):
        self.assertAlmostEqual(calibration.expected_error([(0.9, False), (0.1, True)]), 0.9)

    def test_probability_one_falls_into_the_last_bin(self):
        self.assertEqual(calibration.reliability([(1.0, True), (0.95, False)]), [(2, 0.975, 1)])

    def test_doubtful_is_from_a_half_to_below_settled(self):
        held = [(0.49, True), (0.5, True), (0.94, False), (0.95, True)]
        self.assertEqual(calibration.doubtful(held), held[1:3])

    def test_the_most_probable_candidate_is_held_against_what_was_hidden(self):
        for kind, hidden, name, true in (("single", ["friction"], "friction", True), ("single", ["friction"], "none", False),
                                         ("pair", ["leakage", "friction"], "friction+leakage", True),
                                         ("pair", ["leakage", "friction"], "friction", False),
                                         ("healthy", [], "none", True), ("outside", ["creep"], "unknown", True)):
            one = outcome(kind, hidden, top_candidates=[[name, 0.7], ["other", 0.3]])
            self.assertEqual(calibration.most_probable(one), [(0.7, true)])

    def test_no_cause_of_an_answer_is_true_where_no_cause_explains(self):
        self.assertEqual(calibration.of_causes(outcome("outside", ["creep"], [("friction", 0.6, [])])), [(0.6, False)])


class Effect:
    def __init__(self, family):
        self.family = family
        self.outside = family == "outside"


EFFECTS = {"friction": Effect("memory"), "backlash": Effect("memory"), "leakage": Effect("flow"), "creep": Effect("outside")}


class Tables(unittest.TestCase):
    def test_confusion_counts_the_first_cause_by_what_was_hidden(self):
        held = [outcome(said=[("friction", 0.99, [])]), outcome(said=[("backlash", 0.6, ["friction"])], conclusion="ambiguous"),
                outcome("healthy", [], conclusion="none"), outcome("outside", ["creep"], conclusion="unexplained"),
                outcome("pair", ["friction", "leakage"], said=[("leakage", 0.99, [])])]
        self.assertIn("| friction | 1 | 1 |", detection_tables.cause_confusion(held, EFFECTS))
        text = detection_tables.family_confusion(held, EFFECTS)
        self.assertIn("| hidden \\ said | memory | unexplained | none |", text)
        self.assertIn("| memory | 2 |  |  |", text)
        self.assertIn("| healthy |  |  | 1 |", text)

    def test_coverage_counts_intervals_of_wrong_conclusions_too(self):
        truth = {"effects": [{"effect": "friction", "parameters": {"breakaway_A": {"value": 0.01}}}]}
        held = [outcome(truth=truth, parameters=[["friction", "breakaway_A", 0.01, 0.011, True]]),
                outcome(truth=truth, outcome="right_set", parameters=[["friction", "breakaway_A", 0.01, 0.013, False]]),
                outcome(truth=truth, outcome="missed")]
        self.assertIn("| friction breakaway_A | 3 | 2 | +0.200 | 0.500 [0.013, 0.987] of 2 |", answer_tables.parameters(held))

    def test_the_share_that_is_closed_stands_beside_the_share_to_be_closed(self):
        held = [{"case": "single-0001", "hidden": ["extra_lag"], "d": 40.0, "closed_share": 0.51,
                 "held_out": {"recording": "sweep", "baseline": 0.2, "extended": 0.14, "good": 0.1}},
                {"case": "single-0002", "hidden": ["leakage"], "d": 31.0, "closed_share": 0.0,
                 "held_out": {"recording": "steps", "baseline": 0.1, "extended": 0.1, "good": 0.11}}]
        told = answer_tables.closed(held)
        self.assertIn("would close 0.750 in the median, 0.95 or more in 0 of 2; of that the extension "
                      "closes 0.680 in the median; in 1 a good valve leaves as much", told)
        self.assertIn("| single-0001 | extra_lag | 40 | sweep | 0.2 | 0.14 | 0.1 | 0.51 | 0.75 |", told)
        self.assertIn("| single-0002 | leakage | 31 | steps | 0.1 | 0.1 | 0.11 | 0 | - |", told)

    def test_a_conclusion_is_the_same_with_the_same_first_cause(self):
        one, other = outcome(said=[("friction", 0.99, [])]), outcome(said=[("backlash", 0.99, [])])
        self.assertTrue(comparison_tables.same_conclusion(one, one))
        self.assertFalse(comparison_tables.same_conclusion(one, other))
        self.assertFalse(comparison_tables.same_conclusion(one, outcome(said=[("friction", 0.5, [])], conclusion="ambiguous")))

    def test_cases_fall_into_bins_of_distance(self):
        text = detection_tables.by_distance([outcome(d=3.0), outcome(d=20.0), outcome(d=20.0, outcome="missed", conclusion="none")], "d")
        self.assertIn("| one cause | 2 to 4 | 1.000 [0.025, 1.000] of 1 |", text)
        self.assertIn("| one cause | 16 to 32 | 0.500 [0.013, 0.987] of 2 |", text)

    def test_a_pair_is_judged_by_the_cause_that_shows_less(self):
        held = [outcome("pair", ["friction", "leakage"], d=200.0, d_weaker=3.0, outcome="half"),
                outcome("pair", ["friction", "leakage"], d=40.0, d_weaker=20.0), outcome(d=20.0)]
        text = detection_tables.by_weaker(held)
        self.assertIn("| 2 to 4 | 0.000 [0.000, 0.975] of 1 | 1.000 [0.025, 1.000] of 1 |", text)
        self.assertIn("| 16 to 32 | 1.000 [0.025, 1.000] of 1 |", text)
        self.assertNotIn("of 2", text)


class Lines(unittest.TestCase):
    def test_a_run_is_taken_up_after_a_line_that_was_cut_short(self):
        with tempfile.TemporaryDirectory() as folder:
            path = pathlib.Path(folder) / "lines.jsonl"
            Kept(path).add({"key": "a", "d": math.pi})
            with open(path, "a") as file:
                file.write('\n{"key": "b", "d"')
            again = Kept(path)
            self.assertEqual(list(again.lines), ["a"])
            again.add({"key": "b", "d": 2})
            self.assertEqual(list(Kept(path).lines), ["a", "b"])


if __name__ == "__main__":
    unittest.main()
