"""The scorer, on answers that are made up: each word of an outcome, and the figures."""
import math
import unittest

import cases
import playing
import scoring


def case(kind, *effects, **more):
    return cases.Case(f"{kind}-0001", kind, effects=list(effects), **more)


def entry(cause, probability, *alternatives, **parameters):
    return {"cause": cause, "probability": probability, "alternatives": list(alternatives), "parameters": parameters}


def answer(conclusion, *entries):
    return {"discrepancy": {"conclusion": conclusion, "causes": list(entries), "candidates": []}}


def judged(one, conclusion, *entries, truth=None):
    return scoring.judge(one, answer(conclusion, *entries), truth or {"effects": []})


FRICTION = case("single", ("friction", 0.02))
PAIR = case("pair", ("friction", 0.02), ("leakage", 0.1))
HEALTHY = case("healthy")
OUTSIDE = case("outside", ("creep", 0.1))


class Scoring(unittest.TestCase):
    def outcome(self, word, *args):
        self.assertEqual(judged(*args)["outcome"], word)

    def test_a_cause_is_right_only_alone_and_settled(self):
        self.outcome("right", FRICTION, "named", entry("friction", 0.99))
        self.outcome("extra", FRICTION, "named", entry("friction", 0.99), entry("leakage", 0.96))
        self.outcome("wrong", FRICTION, "named", entry("backlash", 0.99))
        self.outcome("right_set", FRICTION, "ambiguous", entry("backlash", 0.6, "friction"))
        self.outcome("wrong_set", FRICTION, "ambiguous", entry("backlash", 0.6, "hysteresis"))
        self.outcome("missed", FRICTION, "none")
        self.outcome("unexplained", FRICTION, "unexplained")

    def test_a_pair_needs_both_and_no_third(self):
        self.outcome("right", PAIR, "named", entry("friction", 0.99), entry("leakage", 0.97))
        self.outcome("half", PAIR, "named", entry("friction", 0.99))
        self.outcome("wrong", PAIR, "named", entry("friction", 0.99), entry("gain_loss", 0.97))
        self.outcome("extra", PAIR, "named", entry("friction", 0.99), entry("leakage", 0.97), entry("gain_loss", 0.97))

    def test_a_healthy_valve_is_right_only_as_none(self):
        self.outcome("right", HEALTHY, "none")
        self.outcome("doubted", HEALTHY, "unexplained")
        self.outcome("doubted", HEALTHY, "ambiguous", entry("friction", 0.5, "backlash"))
        self.outcome("wrong", HEALTHY, "named", entry("friction", 0.99))

    def test_what_no_cause_explains_is_right_as_unexplained(self):
        self.outcome("right", OUTSIDE, "unexplained")
        self.outcome("missed", OUTSIDE, "none")
        self.outcome("wrong", OUTSIDE, "named", entry("friction", 0.99))

    def test_a_wrong_name_is_confident_from_95_percent_on(self):
        self.assertTrue(judged(HEALTHY, "named", entry("friction", 0.95))["confident_wrong"])
        self.assertFalse(judged(HEALTHY, "ambiguous", entry("friction", 0.94, "backlash"))["confident_wrong"])
        self.assertFalse(judged(FRICTION, "named", entry("friction", 0.99))["confident_wrong"])
        self.assertTrue(judged(OUTSIDE, "unexplained", entry("friction", 0.99))["confident_wrong"])

    def test_no_discrepancy_is_no_answer_and_an_error_has_failed(self):
        self.assertEqual(scoring.judge(FRICTION, {"discrepancy": None}, {"effects": []})["outcome"], "no_answer")
        self.assertEqual(scoring.judge(FRICTION, None, None)["outcome"], "failed")

    def test_the_interval_of_a_parameter_holds_the_true_value_or_not(self):
        truth = {"effects": [{"effect": "friction", "parameters": {"breakaway_A": {"value": 0.02}}}]}
        for low, inside in ((0.019, True), (0.0205, False)):
            estimate = {"value": 0.0202, "ci95": [low, 0.022]}
            one = judged(FRICTION, "named", entry("friction", 0.99, breakaway_A=estimate), truth=truth)
            self.assertEqual(one["parameters"], [["friction", "breakaway_A", 0.02, 0.0202, inside]])

    def test_set_sizes_are_compared_where_the_truth_is_inside(self):
        one = judged(case("close", ("friction", 0.01), oracle_set=2.0), "ambiguous", entry("friction", 0.5, "a", "b"))
        other = judged(case("close", ("friction", 0.01), oracle_set=2.0), "ambiguous", entry("a", 0.5, "b"))
        reached = scoring.figures([one, other])
        self.assertEqual(reached["set_size_above_oracle"], 1)
        self.assertEqual(reached["set_holds_truth"], 0.5)

    def test_a_figure_worse_than_its_floor_is_complained_of_and_null_floors_hold_nothing(self):
        reached = {"healthy_none": 0.9, "wrong_name_confident": 0.02, "pair_right": None}
        self.assertEqual(len(scoring.worse_than({"healthy_none": 0.95, "wrong_name_confident": 0.01}, reached)), 2)
        self.assertEqual(scoring.worse_than({"healthy_none": 0.9, "wrong_name_confident": 0.02}, reached), [])
        self.assertEqual(scoring.worse_than({"pair_right": None}, reached), [])
        self.assertEqual(len(scoring.worse_than({"pair_right": 0.5}, reached)), 1)


class ClosedShare(unittest.TestCase):
    def test_it_is_of_squared_errors_and_asked_only_where_the_baseline_leaves_more_than_a_good_valve(self):
        self.assertAlmostEqual(playing.share_closed({"baseline": 2.0, "extended": 1.0}), 0.75)
        self.assertIsNone(playing.share_closed({"baseline": 0.0, "extended": 0.0}))
        self.assertIsNone(playing.share_closed(None))

    def test_no_more_is_to_be_closed_than_a_good_valve_lets(self):
        self.assertAlmostEqual(playing.share_to_close({"baseline": 2.0, "extended": 1.5, "good": 1.0}), 0.75)
        self.assertIsNone(playing.share_to_close({"baseline": 1.0, "extended": 1.0, "good": 1.0}))
        self.assertIsNone(playing.share_to_close({"baseline": 1.0, "extended": 1.0}))
        self.assertIsNone(playing.share_to_close(None))


class Cases(unittest.TestCase):
    def test_at_least_half_of_any_number_of_cases_are_healthy(self):
        for stand in cases.STANDS.values():
            for number in (68, 120, 500, 6000):
                counts = cases.counts_for(number, stand)
                self.assertEqual(sum(counts.values()), number)
                self.assertGreaterEqual(2 * counts["healthy"], number)

    def test_a_larger_full_suite_holds_the_cases_of_a_smaller_one_and_classes_are_mixed(self):
        effects = {name: cases.Effect(name, "valve", family, 0.01, 0.1) for name, family in
                   (("friction", "memory"), ("leakage", "flow"), ("creep", "outside"))}
        small, large = (cases.drawn(2, n, n, effects, {"jitter": 0.001}) for n in (12, 60))
        self.assertEqual(len(large), 120)
        self.assertTrue({str(case) for case in small} <= {str(case) for case in large})
        self.assertEqual({case.kind for case in large[:12]}, {"healthy", "single", "pair", "outside"})

    def test_distances_decide_the_class(self):
        self.assertTrue(cases.belongs(case("single", d=9.0, d_name=8.0)))
        self.assertFalse(cases.belongs(case("single", d=9.0, d_name=7.9)))
        self.assertTrue(cases.belongs(case("single", d=15.0, d_name=math.nan)))
        self.assertFalse(cases.belongs(case("single", d=14.9, d_name=math.nan)))
        self.assertFalse(cases.belongs(case("close", d=5.0, d_name=1.0)))
        self.assertFalse(cases.belongs(case("close", d=math.nan, d_name=math.nan)))


if __name__ == "__main__":
    unittest.main()
