"""A machine with a known truth, and the recordings that it leaves."""
import dataclasses
import typing

import numpy as np

import signals

LINEAR, OUTSIDE = "linear", "outside"  # nothing is wrong; what is wrong has no name in the vocabulary


@dataclasses.dataclass
class Recording:
    name: str
    input: np.ndarray
    output: np.ndarray
    side: np.ndarray | None = None
    time: np.ndarray | None = None  # None: even


@dataclasses.dataclass
class Machine:
    """`run(command, period_s)` is what the machine makes of a command, `disturb(rng, time, command, output)` what is
    read of it. Noise is white, a share of the output's deviation."""
    truth: typing.Any  # LINEAR, OUTSIDE, or the causes of which any one is right
    told: str
    run: typing.Callable = None
    disturb: typing.Callable = None
    samples: int = 4000
    period_s: float = 0.01
    low: float = -1.0
    high: float = 1.0
    last_hz: float = None
    noise: float = 0.01
    commands: typing.Callable = None  # of rng, in place of the three of signals.session
    side: typing.Callable = None      # of rng, command, output
    recordings: typing.Callable = None  # of rng, in place of all the above
    columns: tuple = ("time", "u", "y")
    units: bool = False               # columns in the contract's names

    def play(self, rng):
        if self.recordings:
            return self.recordings(rng)
        commands = self.commands(rng) if self.commands else signals.session(
            rng, self.samples, self.period_s, self.low, self.high, self.last_hz)
        return [self.recorded(rng, name, command) for name, command in commands.items()]

    def recorded(self, rng, name, command):
        output = self.run(command, self.period_s)
        side = self.side(rng, command, output) if self.side else None
        time = np.arange(len(command)) * self.period_s
        if self.disturb:
            output = self.disturb(rng, time, command, output, *(() if side is None else (side,)))
        noise = self.noise * np.std(output) * rng.standard_normal(len(output))
        return Recording(name, command, output + noise, side)


def short(rng, low=-1.0, high=1.0):
    """Three recordings that together are no longer than what is searched."""
    commands = signals.session(rng, 1660, 0.01, low, high)
    return commands | {"steps": signals.steps(rng, 1660, 110, low, high)}


def at_once(rng, low=-1.0, high=1.0):
    """One recording of steps, a triangle and a sweep."""
    centre, amplitude = (low + high) / 2, (high - low) / 2
    return {"mixed": np.concatenate([signals.steps(rng, 2500, 120, low, high),
                                     signals.triangle(1250, 625, amplitude, centre),
                                     signals.sweep(1250, 0.01, 0.1, 4.0, amplitude, centre)])}


def valve_session(rng, samples=1240, period_s=0.005):
    """Steps, staircase, triangle and sweep of a coil [A]."""
    return {"steps": signals.steps(rng, samples, samples // 8, 0.2, 1.4),
            "staircase": signals.staircase(samples, 0.2, 1.4, 6),
            "triangle": signals.triangle(samples, samples // 2, 0.6, 0.8),
            "sweep": signals.sweep(samples, period_s, 0.4, 20.0, 0.25, 0.8)}
