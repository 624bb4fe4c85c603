import unittest

import judging
from machine import LINEAR, OUTSIDE


def answer(conclusion, *causes):
    return {"conclusion": conclusion,
            "causes": [{"cause": cause, "alternatives": list(others)} for cause, *others in causes]}


class Judging(unittest.TestCase):
    def test_a_name_with_confidence_is_right_only_if_it_is_the_truth_and_nothing_beside_it(self):
        self.assertEqual(judging.judged(("friction",), answer("named", ["friction"])), "right")
        self.assertEqual(judging.judged(("friction",), answer("named", ["saturation"])), "wrong")
        self.assertEqual(judging.judged(("friction",), answer("named", ["friction"], ["saturation"])), "wrong")
        self.assertEqual(judging.judged(LINEAR, answer("named", ["friction"])), "wrong")
        self.assertEqual(judging.judged(OUTSIDE, answer("named", ["friction"])), "wrong")

    def test_an_open_answer_is_right_where_the_truth_is_among_its_causes_or_their_rivals(self):
        self.assertEqual(judging.judged(("friction",), answer("ambiguous", ["backlash", "friction"])), "right_set")
        self.assertEqual(judging.judged(("friction",), answer("ambiguous", ["backlash", "hysteresis"])), "wrong_set")
        self.assertEqual(judging.judged(OUTSIDE, answer("ambiguous", ["backlash", "hysteresis"])), "open")
        self.assertEqual(judging.judged(LINEAR, answer("ambiguous", ["backlash", "hysteresis"])), "doubted")

    def test_nothing_is_right_of_a_linear_machine_alone_and_structure_of_what_has_no_name(self):
        self.assertEqual(judging.judged(LINEAR, answer("none")), "right")
        self.assertEqual(judging.judged(OUTSIDE, answer("none")), "missed")
        self.assertEqual(judging.judged(OUTSIDE, answer("unexplained")), "right")
        self.assertEqual(judging.judged(("friction",), answer("unexplained")), "unexplained")
        self.assertEqual(judging.judged(LINEAR, answer("unexplained")), "doubted")


if __name__ == "__main__":
    unittest.main()
