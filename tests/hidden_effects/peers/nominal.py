"""What the peers share: recordings on a uniform grid, a simulation learned from good valves, alarms at 1 %.

The simulation is a parallel Hammerstein model (Urysohn): the pressure is a sum of hat functions of the current behind
first-order lags, p = Σ c_kl · lag_k[hat_l(i)], linear in c and free-running. A valve's own c may lie as far from the mean
as those of the good valves do; it is fitted to the session. Nothing of the product is used.
"""
import json
import os
import pathlib
import pickle
import sys

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # the suite runs one program per core

import numpy as np  # noqa: E402

PERIOD_S = 0.005
KNOTS_A = np.concatenate([[0.9, 1.1], np.arange(1.2, 2.1001, 0.05)])
LAGS_S = (0.005, 0.02, 0.045, 0.08, 0.15)
NOISE_PSI = 0.35
SPREAD = 3.0        # a valve may lie this many times further out than those that were seen
OWN_WEIGHT = 1e-3   # of the mean valve in a good valve's own fit
FALSE_ALARM = 0.01


class Recording:
    def __init__(self, path):
        rows = [line.rstrip().split(",") for line in open(path) if not line.startswith("#")]
        at = [rows[0].index(name) for name in ("time_s", "current_A", "pressure_psi")]
        time_s, current_a, pressure_psi = np.array([[row[k] for k in at] for row in rows[1:]], float).T
        self.time_s = np.arange(time_s[0], time_s[-1], PERIOD_S)
        self.current_a = np.interp(self.time_s, time_s, current_a)
        self.pressure_psi = np.interp(self.time_s, time_s, pressure_psi)
        self.columns = columns_of(self.current_a)


def session_of(folder):
    return [Recording(path) for path in sorted(pathlib.Path(folder).glob("*.csv"))]


def hats(current_a):
    inside = np.clip(current_a, KNOTS_A[0], KNOTS_A[-1])
    return np.stack([np.interp(inside, KNOTS_A, unit) for unit in np.eye(len(KNOTS_A))], axis=-1)


def columns_of(current_a):
    """lag_k[hat_l(i)], one row per sample; steady before the first."""
    shares = 1 - np.exp(-PERIOD_S / np.array(LAGS_S))[:, None]
    inputs = hats(current_a)
    state = np.repeat(inputs[:1], len(LAGS_S), axis=0)
    rows = np.empty((len(inputs), state.size))
    for k, row in enumerate(inputs):
        rows[k] = state.ravel()
        state = state + shares * (row - state)
    return rows


class Simulation:
    """Learned from the sessions of good valves."""

    def __init__(self, sessions):
        normal = [sum(r.columns.T @ r.columns for r in session) for session in sessions]
        right = [sum(r.columns.T @ r.pressure_psi for r in session) for session in sessions]
        total = sum(normal)
        ridge = 1e-6 * np.trace(total) / len(total) * np.eye(len(total))
        self.mean = np.linalg.solve(total + ridge, sum(right))
        own = [np.linalg.solve(n + OWN_WEIGHT * total + ridge, r + (OWN_WEIGHT * total + ridge) @ self.mean)
               for n, r in zip(normal, right)]
        self.spread = SPREAD * np.stack([c - self.mean for c in own], axis=1) / np.sqrt(len(sessions) - 1)

    def outputs(self, session):
        """The pressure [psi] of each recording, simulated with the valve's own coefficients."""
        normal, right = np.eye(self.spread.shape[1]), 0
        for r in session:
            directions = r.columns @ self.spread / NOISE_PSI
            normal = normal + directions.T @ directions
            right = right + directions.T @ (r.pressure_psi - r.columns @ self.mean) / NOISE_PSI
        own = self.mean + self.spread @ np.linalg.solve(normal, right)
        return [r.columns @ own for r in session]


def student_quantile(share, freedom):
    x = np.linspace(-60, 60, 240001)
    density = (1 + x ** 2 / freedom) ** (-(freedom + 1) / 2)
    return float(np.interp(share, np.cumsum(density) / density.sum(), x))


class Alarm:
    """Statistics of good valves, each by what the others have taught; one good valve in a hundred has any of them beyond
    its limit, as far as they are normal."""

    def __init__(self, values):
        values = np.array(values)
        n, statistics = values.shape
        self.mean, self.sd = values.mean(axis=0), values.std(axis=0, ddof=1) + 1e-9
        self.limit = student_quantile(1 - FALSE_ALARM / statistics, n - 1) * np.sqrt(1 + 1 / n)

    def excess(self, value):
        """In limits: above 1 is an alarm."""
        return (np.array(value) - self.mean) / (self.sd * self.limit)


def learned(good, statistic):
    """(simulation, what `statistic(session, simulation)` is on good valves)."""
    sessions = [session_of(folder) for folder in sorted(pathlib.Path(good).iterdir()) if folder.is_dir()]
    values = [statistic(session, Simulation(sessions[:k] + sessions[k + 1:])) for k, session in enumerate(sessions)]
    return Simulation(sessions), Alarm(values)


def answer(conclusion, causes=(), findings=()):
    """As the contract wants it. A peer has no model of probability: among equals each is as likely."""
    entries = [{"cause": causes[0], "probability": 1 / len(causes), "alternatives": list(causes[1:])}] if causes else []
    candidates = [{"cause": cause, "probability": 1 / len(causes)} for cause in causes]
    if not causes:
        candidates = [{"cause": "none" if conclusion == "none" else "unknown", "probability": 1.0}]
    return {"discrepancy": {"conclusion": conclusion, "causes": entries, "candidates": candidates,
                            "findings": [{"what": what, "statistic": float(value)} for what, value in findings]}}


def main(statistic, conclude):
    """PEER --learn GOOD REFERENCE, or PEER FOLDER REFERENCE; `conclude(value, alarm)` makes the answer."""
    if sys.argv[1] == "--learn":
        with open(sys.argv[3], "wb") as file:
            pickle.dump(learned(sys.argv[2], statistic), file)
        return
    with open(sys.argv[2], "rb") as file:
        simulation, alarm = pickle.load(file)
    json.dump(conclude(statistic(session_of(sys.argv[1]), simulation), alarm), sys.stdout)
