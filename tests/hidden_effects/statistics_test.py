"""Bounds of shares, calibration of probabilities, and the tables of RESULTS.md, on numbers that are made up."""
import math
import pathlib
import statistics
import tempfile
import unittest

import answer_tables
import binomial
import calibration
import comparison_tables
import detection_tables
import power
import sampled_floors
from cases import Case
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


class Floors(unittest.TestCase):
    def test_what_a_sample_can_count_has_probability_one_together(self):
        self.assertAlmostEqual(math.fsum(sampled_floors.likelihood(s, 9, 41, 60) for s in range(10)), 1, places=12)

    def test_of_very_many_the_floor_is_the_binomial_quantile_of_their_share(self):
        s = sampled_floors.fewest(60, 2_940_000, 3_000_000)
        self.assertLess(1 - binomial.tail(s, 60, 0.98), sampled_floors.RARE)
        self.assertGreater(1 - binomial.tail(s + 1, 60, 0.98), sampled_floors.RARE)

    def test_of_few_the_floor_is_lower(self):
        self.assertLess(sampled_floors.fewest(60, 49, 50), sampled_floors.fewest(60, 2940, 3000))

    def test_a_sample_is_held_against_cases_of_its_own_class_and_distance(self):
        plain = [outcome(d_name=9.0)] * 5000
        lost = [outcome(d_name=7.0, outcome="missed"), outcome("pair", ["friction", "leakage"], outcome="wrong", confident_wrong=True)]
        sample = [Case("single-0000", "single"), Case("single-0001", "single"), Case("pair-0000", "pair")]
        floors = sampled_floors.floors(plain + 2500 * lost, sample)
        self.assertEqual(floors["single_right"], 1)
        self.assertEqual(floors["pair_right"], 0)
        self.assertEqual(floors["wrong_name_confident"], 1)  # one in four, and three are few
        self.assertEqual(floors["answered_share"], 1)
        self.assertNotIn("healthy_none", floors)


class Power(unittest.TestCase):
    def test_many_cases_give_the_curve_that_they_were_drawn_from_and_few_a_wide_interval(self):
        def drawn(count):  # d even in its logarithm, each seen as often as Φ(2 ln(d / 10)) says
            cases = []
            for i in range(count):
                d = 2 * 100 ** ((i + 0.5) / count)
                chance = 0.5 * math.erfc(-2 * math.log(d / 10) / math.sqrt(2))
                cases.append((d, (i * 0.6180339887498949) % 1 < chance))
            return cases
        true = 10 * math.exp(power.NINE_IN_TEN / 2)
        middle, low, high = power.d90(drawn(2000))
        self.assertAlmostEqual(middle / true, 1, delta=0.08)
        self.assertTrue(low < true < high)
        _, low_of_few, high_of_few = power.d90(drawn(40))
        self.assertGreater(high_of_few / low_of_few, 2 * high / low)

    def test_what_is_always_seen_above_a_distance_needs_no_slope_to_have_been_likeliest(self):
        middle, low, high = power.d90([(d, d > 9) for d in (3, 4, 5, 6, 7, 8, 10, 11, 12, 14, 16, 20)])
        self.assertTrue(8 < low < 9 < middle < 16 < high)

    def test_the_drawn_oracle_of_a_cause_with_one_signature_is_that_of_the_closed_form(self):
        normal, causes = statistics.NormalDist(), len(power.oracle())
        for drawn, alarm in zip(power.oracle()["sensor_offset"], (0.01, 0.001)):
            exact = normal.inv_cdf(1 - alarm / causes / 2) + normal.inv_cdf(0.9)
            self.assertAlmostEqual(drawn / exact, 1, delta=0.02)

    def test_who_has_to_learn_the_population_sees_no_better_than_who_is_told_it(self):
        for cause, (told, fewer, learning, fewer_learning) in power.oracles().items():
            # Sixty drawn valves of each number of a law, and tolerances cut at three standard deviations: up to 4.1 %.
            self.assertGreater(learning, 0.95 * told, cause)
            self.assertGreater(fewer_learning, 0.95 * fewer, cause)

    def test_an_oracle_sees_nine_in_ten_of_many_causes_where_the_hard_ones_are_nearly_seen(self):
        self.assertAlmostEqual(power.together([5.0] * 7), 5.0)
        half = power.together([5.0, 9.0])
        self.assertTrue(8 < half < 9)  # at the mean, 7, one of them is seen and the other hardly
        share = sum(statistics.NormalDist().cdf(half - d + power.NINE_IN_TEN) for d in (5.0, 9.0)) / 2
        self.assertAlmostEqual(share, 0.9)

    def test_efficiency_is_the_oracles_distance_over_that_of_the_answers(self):
        held = [outcome(d=float(d), conclusion="named" if d > 10 else "none") for d in range(2, 40)]
        of_friction, of_all = power.efficiencies(held)
        self.assertEqual(of_friction[:2], ["friction", 38])
        middle = power.d90(power.seen_of(held))[0]
        self.assertEqual(float(of_friction[-4]), round(power.oracle()["friction"][0] / middle, 2))
        self.assertEqual(float(of_friction[-1]), round(power.oracle(power.LEARNING)["friction"][1] / middle, 2))
        self.assertEqual(of_all[0], "all")


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
