"""The peers' simulation and alarm on made-up valves, and each peer on a case of the quick suite."""
import json
import pathlib
import subprocess
import sys
import tempfile
import unittest

import numpy as np

import nominal

HERE = pathlib.Path(__file__).resolve().parent
BUILD = pathlib.Path(sys.argv.pop(1)).resolve()


class Plant(nominal.Recording):
    """A square-law map behind one of the lags that the simulation has."""

    def __init__(self, gain):
        self.current_a = 1.5 + 0.4 * np.sin(np.arange(2000) * 0.01)
        self.columns = nominal.columns_of(self.current_a)
        knots = gain * (nominal.KNOTS_A - 0.9) ** 2
        self.pressure_psi = self.columns[:, len(knots):2 * len(knots)] @ knots


class Nominal(unittest.TestCase):
    def test_a_quantile_of_student_is_that_of_the_tables(self):
        self.assertAlmostEqual(nominal.student_quantile(0.99, 7), 2.998, places=2)

    def test_a_valve_between_the_good_ones_leaves_nothing(self):
        simulation = nominal.Simulation([[Plant(gain)] for gain in (95, 100, 105)])
        output, = simulation.outputs([Plant(102)])
        self.assertLess(np.abs(output - Plant(102).pressure_psi).max(), nominal.NOISE_PSI / 5)

    def test_one_good_valve_in_a_hundred_raises_an_alarm_whatever_the_number_of_statistics(self):
        random = np.random.default_rng(3)
        alarms = [max(nominal.Alarm(random.normal(size=(8, 4))).excess(random.normal(size=4))) > 1 for _ in range(2000)]
        self.assertLess(abs(np.mean(alarms) - 0.01), 4 * np.sqrt(0.01 / 2000))


class Peers(unittest.TestCase):
    def test_each_sees_a_large_fault_of_the_kind_that_it_is_made_for(self):
        with tempfile.TemporaryDirectory() as folder:
            for peer, case in (("arx_whiteness", "single-0008"), ("sparse_polynomials", "single-0000"),
                               ("kernel_discrepancy", "single-0000")):
                scores = pathlib.Path(folder) / "scores.json"
                subprocess.run([sys.executable, HERE.parent / "run", "--quick", "--only", case, "--build", BUILD,
                                "--work", folder, "--engine", f"{HERE / peer} {{folder}} {{reference}}",
                                "--learn", f"{HERE / peer} --learn {{good}} {{reference}}", "--json", scores],
                               check=True, capture_output=True)
                scored, = json.loads(scores.read_text())["cases"]
                self.assertIn(scored["conclusion"], ("ambiguous", "unexplained"), peer)


if __name__ == "__main__":
    unittest.main()
