"""Commands that machines are driven with: arrays of samples, most of them within [-1, 1]."""
import numpy as np


def steps(rng, samples, hold, low=-1.0, high=1.0):
    """Levels drawn evenly, each held for about `hold` samples."""
    command = np.zeros(samples)
    begin = 0
    while begin < samples:
        length = int(hold * rng.uniform(0.6, 1.4))
        command[begin:begin + length] = rng.uniform(low, high)
        begin += length
    return command


def two_levels(rng, samples, hold):
    """-1 and 1, each for one to five holds."""
    command = np.zeros(samples)
    begin = 0
    while begin < samples:
        length = hold * rng.integers(1, 6)
        command[begin:begin + length] = rng.choice([-1, 1])
        begin += length
    return command


def sweep(samples, period_s, first_hz, last_hz, amplitude=1.0, centre=0.0):
    """A sine whose frequency rises in proportion to itself."""
    time = np.arange(samples) * period_s
    growth = np.log(last_hz / first_hz)
    duration = samples * period_s
    phase = 2 * np.pi * first_hz * duration / growth * (np.exp(growth * time / duration) - 1)
    return centre + amplitude * np.sin(phase)


def triangle(samples, cycle, amplitude=1.0, centre=0.0):
    phase = (np.arange(samples) / cycle + 0.25) % 1
    return centre + amplitude * (1 - 2 * np.abs(2 * phase - 1))


def staircase(samples, low, high, levels):
    up = np.linspace(low, high, levels)
    both = np.concatenate([up, up[-2::-1]])
    return np.repeat(both, samples // len(both) + 1)[:samples]


def session(rng, samples, period_s, low=-1.0, high=1.0, last_hz=None):
    """Three recordings of one machine: {name: command}."""
    centre, amplitude = (low + high) / 2, (high - low) / 2
    duration = samples * period_s
    return {
        "steps": steps(rng, samples, samples // 12, low, high),
        "triangle": triangle(samples, samples // 3, amplitude, centre),
        "sweep": sweep(samples, period_s, 2 / duration, last_hz or 0.05 / period_s, amplitude, centre),
    }
