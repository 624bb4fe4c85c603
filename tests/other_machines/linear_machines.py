"""Machines with nothing wrong: linear, whatever their order, noise, clock and input."""
import numpy as np

import signals
from machine import LINEAR, Machine, Recording
from physics import coloured, lag, second_order


def two_modes(command, period_s):
    slow = second_order(command, period_s, 2 * np.pi * 2, 0.03)
    return slow + 0.4 * second_order(command, period_s, 2 * np.pi * 6.5, 0.02)


def against_itself_first(command, period_s):
    return 2 * 0.95 * lag(command, period_s, 0.5) - 0.9 * lag(command, period_s, 0.15)


def rod(command, period_s):
    """Heat along thirty cells, read at the fourth: a lag of every length."""
    cells = np.zeros(30)
    output = np.zeros(len(command))
    conductance, loss, steps = 0.8, 0.003, 4
    for i, u in enumerate(command):
        output[i] = cells[3]
        for _ in range(steps):
            flow = conductance * -np.diff(cells)
            change = -loss * cells
            change[:-1] -= flow
            change[1:] += flow
            change[0] += conductance * (u - cells[0])
            cells = cells + period_s / steps * change
    return output


def eight_lags(command, period_s):
    for _ in range(8):
        command = lag(command, period_s, 0.1)
    return command


def echo(command, period_s):
    direct = second_order(command, period_s)
    later = np.concatenate([np.full(130, direct[0]), direct[:-130]])
    return direct + 0.4 * later


def outliers(rng, _, __, output):
    output = output.copy()
    at = rng.choice(len(output), 20, False)
    output[at] += rng.choice([-1, 1], 20) * rng.uniform(1, 4, 20)
    return output


def rounded(step):
    return lambda rng, _, __, output: np.round((output + 0.002 * rng.standard_normal(len(output))) / step) * step


def with_rows_missing(rng):
    recordings = []
    for name, command in signals.session(rng, 4000, 0.01).items():
        output = second_order(command, 0.01)
        kept = rng.random(len(command)) > 0.2
        noise = 0.01 * np.std(output) * rng.standard_normal(len(output))
        recordings.append(Recording(name, command[kept], (output + noise)[kept],
                time=(np.arange(len(command)) * 0.01)[kept]))
    return recordings


def jittering(rng):
    """Stamps that are right and uneven by a third of the period."""
    recordings = []
    for name, command in signals.session(rng, 4000, 0.01).items():
        time = np.arange(len(command)) * 0.01 + rng.uniform(-0.3, 0.3, len(command)) * 0.01
        time -= time[0]
        fine = np.arange(len(command) * 10) * 0.001
        output = np.interp(time, fine, second_order(np.interp(fine, time, command), 0.001))
        recordings.append(Recording(name, command, output + 0.01 * np.std(output) * rng.standard_normal(len(output)),
                time=time))
    return recordings


def two_relays(rng):
    return {"slow": signals.two_levels(rng, 4000, 40), "fast": signals.two_levels(rng, 4000, 15)}


MACHINES = {
    "one_lag": Machine(LINEAR, "one lag", lambda u, dt: 2 * lag(u, dt, 0.2) + 3, samples=3000),
    "two_modes": Machine(LINEAR, "two lightly damped modes", two_modes, period_s=0.005),
    "against_itself_first": Machine(LINEAR, "non-minimum phase", against_itself_first, samples=3000, period_s=0.02),
    "rod": Machine(LINEAR, "heat along a rod of thirty cells", rod, samples=3000, period_s=0.5),
    "eight_lags": Machine(LINEAR, "eight lags in a row", eight_lags),
    "echo": Machine(LINEAR, "an echo after 1.3 s", echo),
    "integrator": Machine(LINEAR, "an integrator", lambda u, dt: np.cumsum(u) * dt,
        commands=lambda rng: {"relay": signals.two_levels(rng, 4000, 40),
        "sweep": signals.sweep(4000, 0.01, 0.1, 4.0)}),
    "washout": Machine(LINEAR, "a filtered differentiator", lambda u, dt: lag(u, dt, 0.05) - lag(u, dt, 0.5)),
    "gain_alone": Machine(LINEAR, "a gain and nothing else", lambda u, dt: 3 * u + 1),
    "as_loud_as_itself": Machine(LINEAR, "noise as large as the output", second_order, noise=1.0),
    "two_hundred_samples": Machine(LINEAR, "200 samples in all", second_order, period_s=0.05,
        commands=lambda rng: {"steps": signals.steps(rng, 200, 20)}),
    "fifty_thousand_samples": Machine(LINEAR, "50,000 samples in one recording",
        lambda u, dt: second_order(u, dt, 20), period_s=0.001,
        commands=lambda rng: {"steps": signals.steps(rng, 50_000, 900)}),
    "two_levels_alone": Machine(LINEAR, "an input of two levels alone", second_order, commands=two_relays),
    "outliers": Machine(LINEAR, "one sample in two hundred far off", second_order, outliers),
    "five_bits": Machine(LINEAR, "an output of five bits", second_order, rounded(2.6 / 32), noise=0),
    "rows_missing": Machine(LINEAR, "a fifth of the rows missing", recordings=with_rows_missing),
    "jittering_clock": Machine(LINEAR, "stamps uneven by 30 %", recordings=jittering),
    "noise_that_remembers": Machine(LINEAR, "noise with a memory of 2 s", second_order,
        lambda rng, t, _, y: y + 0.03 * coloured(rng, len(t), 200)),
    "noise_as_loud_as_its_level": Machine(LINEAR, "noise in proportion to the level", second_order,
        lambda rng, _, __, y: y * (1 + 0.3 * rng.standard_normal(len(y)))),
    "heavy_tails": Machine(LINEAR, "noise of Student's t with two freedoms", second_order,
        lambda rng, t, _, y: y + 0.03 * rng.standard_t(2, len(t))),
    "creeping": Machine(LINEAR, "a fast lag and one of 12 s beside it",
        lambda u, dt: 0.8 * lag(u, dt, 0.1) + 0.2 * lag(u, dt, 12.0, 0.0), period_s=0.02),
    "noisy_input": Machine(LINEAR, "a noisy record of the input", recordings=lambda rng: [
        Recording(name, command + 0.02 * rng.standard_normal(len(command)), second_order(command, 0.01)
        + 0.005 * rng.standard_normal(len(command)))
        for name, command in signals.session(rng, 4000, 0.01).items()]),
}
