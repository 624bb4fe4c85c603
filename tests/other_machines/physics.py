"""What machines are made of. Signals are arrays of one value per sample, held from each sample to the next."""
import numpy as np


def lag(signal, period_s, time_constant_s, start=None):
    """First order, exact for a held input."""
    keep = np.exp(-period_s / time_constant_s)
    state = signal[0] if start is None else start
    output = np.zeros(len(signal))
    for i, value in enumerate(signal):
        output[i] = state
        state = keep * state + (1 - keep) * value
    return output


def integrated(derivative, start, command, period_s, steps=4):
    """States of x' = derivative(t, x, u) at the samples, by Runge and Kutta's fourth order; one row per sample."""
    state = np.array(start, float)
    states = np.zeros((len(command), len(state)))
    h = period_s / steps
    for i, u in enumerate(command):
        states[i] = state
        for step in range(steps):
            t = i * period_s + step * h
            k1 = derivative(t, state, u)
            k2 = derivative(t + h / 2, state + h / 2 * k1, u)
            k3 = derivative(t + h / 2, state + h / 2 * k2, u)
            k4 = derivative(t + h, state + h * k3, u)
            state = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return states


def second_order(signal, period_s, omega=6.0, zeta=0.7, start=None):
    """A mass on a spring, at rest at the first value of the signal unless told otherwise."""
    def derivative(_, x, u):
        return np.array([x[1], omega ** 2 * (u - x[0]) - 2 * zeta * omega * x[1]])
    return integrated(derivative, [signal[0] if start is None else start, 0], signal, period_s)[:, 0]


def play(signal, width):
    """Lost motion of full `width`."""
    output = np.zeros(len(signal))
    held = signal[0]
    for i, value in enumerate(signal):
        held = min(max(held, value - width / 2), value + width / 2)
        output[i] = held
    return output


def stick_slip(signal, breakaway, kinetic):
    """Holds until the distance passes breakaway, then jumps to the kinetic distance."""
    output = np.zeros(len(signal))
    held = signal[0]
    for i, value in enumerate(signal):
        if abs(value - held) > breakaway:
            held = value - np.copysign(kinetic, value - held)
        output[i] = held
    return output


def preisach(signal, relays=40, width=0.25, spread=0.35):
    """A magnet: relays with two thresholds each, their weights a bell around ±width (Preisach 1935)."""
    grid = np.linspace(-1.3, 1.3, relays)
    up, down = np.meshgrid(grid, grid)
    ordered = up >= down
    up, down = up[ordered], down[ordered]
    weight = np.exp(-((up - width) ** 2 + (down + width) ** 2) / 2 / spread ** 2)
    weight /= weight.sum()
    state = np.where(up + down > 0, -1.0, 1.0)
    output = np.zeros(len(signal))
    for i, value in enumerate(signal):
        state[value >= up] = 1
        state[value <= down] = -1
        output[i] = weight @ state
    return output


def rate_limited(signal, most_per_sample):
    output = np.zeros(len(signal))
    state = signal[0]
    for i, value in enumerate(signal):
        state += np.clip(value - state, -most_per_sample, most_per_sample)
        output[i] = state
    return output


def coloured(rng, samples, memory):
    """Noise of unit power that remembers for so many samples."""
    keep = np.exp(-1 / memory)
    noise = rng.standard_normal(samples)
    output = np.zeros(samples)
    state = noise[0]
    for i in range(samples):
        output[i] = state
        state = keep * state + np.sqrt(1 - keep ** 2) * noise[i]
    return output
