"""Machines with something wrong that the vocabulary has no name for."""
import numpy as np

import signals
from machine import OUTSIDE, Machine, Recording, at_once, short
from physics import coloured, integrated, lag, preisach, second_order


def state_of(derivative, start, state=0, **how):
    """One state of x' = derivative(t, x, u)."""
    return lambda u, dt: integrated(derivative, start(u[0]) if callable(start) else start, u, dt, **how)[:, state]


def radiating(command, period_s):
    def derivative(_, x, u):
        return np.array([(300 * u - 0.3 * (x[0] - 300) - 2e-8 * (x[0] ** 4 - 300 ** 4)) / 400])
    warm = integrated(derivative, [300.0], np.full(20_000, command[0]), period_s, 1)[-1]
    return integrated(derivative, warm, command, period_s, 1)[:, 0]


def dragging(_, x, u):
    return np.array([(x[1] - 0.05 * x[0] - 0.3 * x[0] * abs(x[0])) / 0.5, (4 * u - x[1]) / 0.05])


def reactor(_, x, u):
    rate = 0.072 * (1 - x[0]) * np.exp(x[1] / (1 + x[1] / 20))
    return np.array([-x[0] + rate, -x[1] + 8 * rate + 0.3 * (u - x[1])])


def moving_delay(command, period_s):
    time = np.arange(len(command)) * period_s
    return lag(np.interp(time - 0.15 - 0.1 * np.sin(2 * np.pi * time / 7), time, command), period_s, 0.1)


def changing_lag(command, period_s):
    output = np.zeros(len(command))
    state = 0.0
    for i, u in enumerate(command):
        output[i] = state
        state += period_s * (u - state) / (0.15 if i < len(command) / 2 else 0.4)
    return output


def later_delay(command, period_s):
    output = second_order(command, period_s)
    half = len(output) // 2
    return np.concatenate([output[:half], output[half - 20:-20]])


def thermostat(command, period_s):
    output = np.zeros(len(command))
    state = -1.0
    for i, u in enumerate(command):
        state = 1.0 if u > 0.3 else (-1.0 if u < -0.3 else state)
        output[i] = state
    return lag(output, period_s, 0.3)


def winding_up(command, period_s):
    """A loop whose actuator saturates; the set point is what is recorded."""
    output = np.zeros(len(command))
    state = integral = 0.0
    for i, u in enumerate(command):
        output[i] = state
        integral += 3 * period_s * (u - state)
        state += period_s * (1.2 * np.clip(2 * (u - state) + integral, -0.8, 0.8) - state) / 0.5
    return output


def slow_fall(command, period_s):
    output = np.zeros(len(command))
    state = command[0]
    for i, u in enumerate(command):
        state += max(u - state, -0.006)
        output[i] = state
    return lag(output, period_s, 0.1)


def freezing(rng, _, __, output):
    output = output.copy()
    for begin in rng.integers(300, 3400, 3):
        output[begin:begin + rng.integers(200, 400)] = output[begin]
    return output


def another_input(rng, _, command, output):
    return output + 0.3 * second_order(signals.steps(rng, len(command), 500), 0.01, 3.0)


def chattering(_, time, __, output):
    return output + 0.15 * np.tanh(np.abs(np.gradient(output, 0.01))) * np.sin(2 * np.pi * 5 * time)


def square_wave(rng):
    time = np.arange(1000) * 0.01
    output = np.sign(np.sin(2 * np.pi * 0.8 * time + 0.2)) + 0.01 * rng.standard_normal(1000)
    return [Recording("alone", signals.steps(rng, 1000, 200), output)]


def swapped(rng):
    recordings = []
    for name, command in signals.session(rng, 4000, 0.01).items():
        output = second_order(command, 0.01)
        recordings.append(Recording(name, output + 0.01 * rng.standard_normal(len(output)), command))
    return recordings


def second_gauge(rng, _, output):
    return output + 0.01 * rng.standard_normal(len(output))


MACHINES = {
    "radiation": Machine(OUTSIDE, "heat lost by the fourth power", radiating, noise=0.003, period_s=1.0,
        commands=lambda rng: {"steps": signals.steps(rng, 6000, 600, 0.2, 3),
        "staircase": signals.staircase(9000, 0.2, 3, 6),
        "triangle": signals.triangle(6000, 3000, 1.3, 1.6)}),
    "drag": Machine(OUTSIDE, "a motor with drag by the square of its speed", state_of(dragging, [0, 0]), period_s=0.02),
    "drag_one_way": Machine(OUTSIDE, "the same, always forwards", state_of(
        lambda _, x, u: np.array([2 * u - 0.15 * x[0] * abs(x[0])]), lambda u: [np.sqrt(4 * u / 0.3)]),
        period_s=0.02, low=0.3, high=2),
    "damped_by_the_square": Machine(OUTSIDE, "a mass with damping by the square", state_of(
        lambda _, x, u: np.array([x[1], -1.5 * x[1] * abs(x[1]) - 0.4 * x[1] - 16 * x[0] + 16 * u]), [0, 0]),
        period_s=0.02, last_hz=2),
    "soft_spring": Machine(OUTSIDE, "a spring that gives way", state_of(
        lambda _, x, u: np.array([x[1], -0.8 * x[1] - 4 * (x[0] - 0.2 * x[0] ** 3) + 2.4 * u]), [0, 0]),
        period_s=0.05, last_hz=1),
    "pendulum": Machine(OUTSIDE, "a pendulum", state_of(
        lambda _, x, u: np.array([x[1], -2.5 * x[1] - 9.8 * np.sin(x[0]) + 8 * u]), [0, 0]), period_s=0.02, last_hz=2),
    "parametric": Machine(OUTSIDE, "a spring that swings by itself", state_of(
        lambda t, x, u: np.array([x[1], -0.8 * x[1] - 4 * (1 + 0.4 * np.cos(3 * t)) * x[0] + 4 * u]), [0, 0]),
        period_s=0.05, last_hz=0.6),
    "van_der_pol": Machine(OUTSIDE, "a limit cycle", state_of(
        lambda _, x, u: np.array([x[1], (1 - x[0] ** 2) * x[1] - x[0] + 0.5 * u]), [0.1, 0]), period_s=0.05,
        commands=lambda rng: {"steps": signals.steps(rng, 4000, 400), "triangle": signals.triangle(4000, 2000)}),
    "bilinear": Machine(OUTSIDE, "a gain that follows the input", state_of(
        lambda _, x, u: np.array([3 * (-x[0] + 0.5 * x[0] * u + u)]), lambda u: [u / (1 - 0.5 * u)]), period_s=0.02),
    "reactor": Machine(OUTSIDE, "an exothermic reactor", state_of(reactor, [0.14, 0.88], 1), period_s=0.05, last_hz=1),
    "frequency_by_level": Machine(OUTSIDE, "a natural frequency that rises with the level", state_of(
        lambda _, x, u: np.array([x[1], -0.5 * (5 + 2 * x[0]) * x[1] - (5 + 2 * x[0]) ** 2 * (x[0] - u)]),
        lambda u: [u, 0]), period_s=0.02, last_hz=3),
    "damping_by_level": Machine(OUTSIDE, "a damping that rises with the level", state_of(
        lambda _, x, u: np.array([x[1], -12 * (0.5 + 0.4 * np.tanh(2 * x[0])) * x[1] - 36 * (x[0] - u)]),
        lambda u: [u, 0]), period_s=0.02, last_hz=3),
    "lag_by_level": Machine(OUTSIDE, "a time constant that rises with the level", state_of(
        lambda _, x, u: np.array([(u - x[0]) / (0.3 + 0.2 * np.tanh(2 * x[0]))]), [0])),
    "two_paths": Machine(OUTSIDE, "a lag, and beside it the square of a slower one",
        lambda u, dt: lag(u, dt, 0.1) + 0.4 * lag(u, dt, 0.6) ** 2),
    "moving_delay": Machine(OUTSIDE, "a delay that swings", moving_delay),
    "later_delay": Machine(OUTSIDE, "a delay from half time on", later_delay),
    "changing_lag": Machine(OUTSIDE, "a time constant that changes at half time", changing_lag),
    "swinging_gain": Machine(OUTSIDE, "a gain that swings by a fifth", second_order,
        lambda rng, t, _, y: y * (1 + 0.2 * np.sin(2 * np.pi * t / 9))),
    "worn_gain": Machine(OUTSIDE, "a gain that wanders", second_order,
        lambda rng, t, _, y: y * (1 + 0.0025 * np.cumsum(rng.standard_normal(len(t)))), low=0.5,
        high=2),
    "adapting": Machine(OUTSIDE, "a gain that follows the mean of the past", lambda u, dt: second_order(u,
        dt) * (1 + 0.4 * lag(u, dt, 6.0, 0.0))),
    "drifting_clock": Machine(OUTSIDE, "clocks that drift apart by 0.3 %", lambda u, dt: np.interp(
        np.arange(len(u)) * 0.997, np.arange(len(u)), lag(u, dt, 0.1)), samples=8000),
    "nine_positions": Machine(OUTSIDE, "an actuator of nine positions", lambda u,
        dt: second_order(np.round(u * 4) / 4, dt)),
    "wavy": Machine(OUTSIDE, "a wavy map", lambda u, dt: second_order(u + 0.15 * np.sin(6 * u), dt)),
    "two_gains": Machine(OUTSIDE, "twice the gain about the middle", lambda u, dt: second_order(u + np.clip(u, -0.3,
        0.3), dt)),
    "turning_angle": Machine(OUTSIDE, "a reading that wraps", lambda u, dt: (second_order(u, dt) + 0.6) % 1.2 - 0.6),
    "folding_sine": Machine(OUTSIDE, "sin 2.2x behind a lag, noise of a twentieth", lambda u, dt: np.sin(2.2 * lag(u,
        dt, 0.15)),
        commands=short, noise=0.05),
    "slow_fall": Machine(OUTSIDE, "a speed limit downwards alone", slow_fall),
    "winding_up": Machine(OUTSIDE, "a loop that winds up", winding_up, period_s=0.02),
    "thermostat": Machine(OUTSIDE, "a relay with a gap", thermostat),
    "freezing_gauge": Machine(OUTSIDE, "a gauge that freezes for seconds", second_order, freezing),
    "wandering_tone": Machine(OUTSIDE, "a tone that wanders", second_order, lambda rng, t, _, y: y + 0.08 * np.sin(
        np.cumsum(2 * np.pi * 0.01 * (3.3 + 0.5 * np.sin(t / 4) + 0.5 * coloured(rng, len(t), 400))))),
    "chatter": Machine(OUTSIDE, "a tone where it moves", second_order, chattering),
    "another_input": Machine(OUTSIDE, "a second input that is not recorded", second_order, another_input),
    "second_gauge": Machine(OUTSIDE, "a magnet, and a second gauge as side channel",
        lambda u, dt: second_order(preisach(u) + 0.3 * u, dt), side=second_gauge, commands=short),
    "on_its_own": Machine(OUTSIDE, "an output that goes up and down by itself", recordings=square_wave),
    "swapped": Machine(OUTSIDE, "input and output swapped", recordings=swapped),
    "jump_of_the_reading": Machine(OUTSIDE, "a reading that jumps, one recording", second_order,
        lambda rng, t, _, y: y + 0.3 * (t > 0.55 * t[-1]),
        commands=lambda rng: at_once(rng, 0.5, 2)),
    "falling_gain": Machine(OUTSIDE, "a gain that falls steadily, three recordings", second_order,
        lambda rng, t, _, y: y * (1 - 0.2 * t / t[-1]), low=0.5, high=2),
    "slew_of_the_loop": Machine(OUTSIDE, "a speed by the root of the distance", state_of(
        lambda _, x, u: 3 * np.sign(u - x) * np.sqrt(np.abs(u - x)), lambda u: [u]), commands=short),
}
