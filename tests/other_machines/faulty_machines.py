"""Machines with one thing wrong that the vocabulary has a name for, by laws that are not the engine's."""
import numpy as np

import signals
from machine import Machine, at_once, short, valve_session
from physics import integrated, lag, play, preisach, rate_limited, second_order, stick_slip


def at_input(law, **lag_of):
    return lambda u, dt: second_order(law(u), dt, **lag_of)


def at_output(law, **lag_of):
    return lambda u, dt: law(second_order(u, dt, **lag_of))


def dead_zone(u):
    return np.where(u > 0.25, u - 0.25, np.where(u < -0.1, u + 0.1, 0))


def tanks(areas):
    """Each empties into the next by the root of its level."""
    areas = np.array(areas)

    def run(command, period_s):
        levels = np.full(len(areas), command[0] ** 2)
        output = np.zeros(len(command))
        for i, u in enumerate(command):
            output[i] = levels[-1]
            for _ in range(4):
                flow = np.sqrt(np.maximum(levels, 0))
                levels = levels + period_s / 4 * (np.concatenate([[u], flow[:-1]]) - flow) / areas
        return output
    return run


def weir(command, period_s):
    def derivative(_, x, u):
        return np.array([4 * (u - max(x[0], 0) ** 1.5)])
    return integrated(derivative, [command[0] ** (2 / 3)], command, period_s)[:, 0]


def spring(cubic, bump=None):
    """x'' + 0.8 x' + 4 (x + cubic x³) = 4 u, or a stop of another spring beyond `bump`."""
    def run(command, period_s):
        def derivative(_, x, u):
            beyond = 5 * (x[0] - np.clip(x[0], -bump, bump)) if bump else cubic * x[0] ** 3
            return np.array([x[1], -0.8 * x[1] - 4 * (x[0] + beyond) + 4 * u])
        return integrated(derivative, [0, 0], command, period_s)[:, 0]
    return run


def bouc_wen(command, period_s):
    def derivative(_, x, u):
        _, speed, z = x
        return np.array([speed, -4 * speed - 10 * x[0] - 6 * z + 12 * u,
                         8 * (speed - 1.5 * abs(speed) * z - 1.5 * speed * abs(z))])
    return integrated(derivative, [0, 0, 0], command, period_s)[:, 0]


def dry_motor(command, period_s):
    """A motor's speed under dry friction."""
    output = np.zeros(len(command))
    speed, h = 0.0, period_s / 10
    for i, u in enumerate(command):
        output[i] = speed
        for _ in range(10):
            force = u - 0.1 * speed
            if speed == 0:
                speed = 10 * h * (force - 0.25 * np.sign(force)) if abs(force) > 0.3 else 0.0
            else:
                after = speed + 10 * h * (force - 0.25 * np.sign(speed))
                speed = 0.0 if after * speed < 0 else after
    return output


def dry_spring(command, period_s):
    """A spool on a spring that sticks, with next to no mass."""
    output = np.zeros(len(command))
    place, speed, h, mass = 0.0, 0.0, period_s / 4, 0.002
    for i, u in enumerate(command):
        output[i] = place
        for _ in range(4):
            force = u - place
            if speed == 0:
                speed = h / mass * (force - 0.08 * np.sign(force)) if abs(force) > 0.12 else 0.0
            else:
                after = speed + h * (force - 0.06 * speed - 0.08 * np.sign(speed)) / mass
                speed = 0.0 if after * speed < 0 else after
            place += h * speed
    return output


def slower_down(command, period_s):
    def derivative(_, x, u):
        return np.array([(u - x[0]) / (0.1 if u > x[0] else 0.3)])
    return integrated(derivative, [command[0]], command, period_s)[:, 0]


def changing(share):
    """A gain that follows `share` of the time, from 0 to 1."""
    return lambda rng, time, _, output: output * share(time / time[-1])


def tone(rng, time, _, output):
    return output + 0.08 * np.sin(2 * np.pi * 3.3 * time + rng.uniform(0, 6))


def valve(run, truth, told):
    """A valve in ampere and psi, without a reference."""
    return Machine(truth, told, run, commands=valve_session, period_s=0.005, noise=0.01,
                   columns=("time_s", "current_A", "pressure_psi"), units=True)


def spool(command, period_s):
    return second_order(command - command[0], period_s, 60, 0.6) + command[0]


def chamber(command, period_s):
    """p' = C u - c √p: filled by the spool, emptied by an orifice."""
    pressure = (command[0] * 9) ** 2
    output = np.zeros(len(command))
    for i, u in enumerate(command):
        output[i] = pressure
        for _ in range(4):
            pressure = max(pressure + period_s / 4 * 60 * (u * 9 - np.sqrt(max(pressure, 0))), 0)
    return output


def warm_room(rng, command, _):
    return 20 + 8 * lag(rng.standard_normal(len(command)), 0.01, 3.0, 0)


CURVE = ("static_curve",)
LOOP = ("hysteresis", "backlash", "friction")

MACHINES = {
    "dead_zone": Machine(("dead_band",), "a dead zone", at_input(dead_zone)),
    "limited_input": Machine(("saturation",), "an actuator that stops on both sides",
        at_input(lambda u: np.clip(u, -0.6, 0.6), zeta=0.4)),
    "limited_output": Machine(("saturation",), "a gauge that stops at one level",
        at_output(lambda x: np.minimum(x, 0.5), zeta=0.4)),
    "limited_output_short": Machine(("saturation",), "the same, all of it searched",
        at_output(lambda x: np.minimum(x, 0.5), zeta=0.6), commands=short),
    "magnitude": Machine(("rectified_sensor",), "a gauge of magnitudes", at_output(np.abs)),
    "square_ahead": Machine(CURVE, "u + 0.4 u² ahead of the lags", at_input(lambda u: u + 0.4 * u ** 2, zeta=0.8)),
    "square_behind": Machine(CURVE, "x + 0.3 x² behind them, relay input",
        at_output(lambda x: x + 0.3 * x ** 2, zeta=0.25),
        commands=lambda rng: {"slow": signals.two_levels(rng, 4000, 60), "fast": signals.two_levels(rng, 4000, 30)}),
    "cubic_ahead": Machine(CURVE, "u - 0.5 u³ + 0.2 u² ahead of a lag",
        lambda u, dt: lag(u - 0.5 * u ** 3 + 0.2 * u ** 2, dt, 0.15)),
    "s_curve": Machine(CURVE, "u - 0.3 u³ ahead of a lag", lambda u, dt: lag(u - 0.3 * u ** 3, dt, 0.15),
        commands=short),
    "s_curve_in_noise": Machine(CURVE, "u / (1 + 2 |u|), noise of a twentieth",
        lambda u, dt: lag(u / (1 + 2 * abs(u)), dt, 0.15), commands=short, noise=0.05),
    "root_of_both_signs": Machine(CURVE + ("orifice_flow",), "sign(u) √|u| ahead of the lags",
        at_input(lambda u: np.sign(u) * np.sqrt(abs(u))), commands=short),
    "exponential_ahead": Machine(CURVE, "e^2u ahead of the lags", at_input(lambda u: np.exp(2 * u) / 3)),
    "logarithm_behind": Machine(CURVE, "log(1.35 + x) behind them", at_output(lambda x: np.log(1.35 + x), zeta=0.5)),
    "parabola": Machine(CURVE, "-u² ahead of the lags", at_input(lambda u: -u * u)),
    "titration": Machine(CURVE, "a titration curve behind a lag",
        lambda u, dt: 7 + 2.5 * np.arcsinh(lag(u, dt, 8) / 0.04) / np.arcsinh(50), period_s=0.5),
    "magnet": Machine(("hysteresis",), "a magnet (Preisach) ahead of a lag",
        lambda u, dt: lag(preisach(u) + 0.3 * u, dt, 0.08)),
    "magnet_short": Machine(("hysteresis",), "the same, all of it searched",
        lambda u, dt: lag(preisach(u) + 0.3 * u, dt, 0.08), commands=short),
    "bouc_wen": Machine(("hysteresis", "friction"), "a loop in the spring (Bouc and Wen)", bouc_wen, period_s=0.02,
        last_hz=1),
    "play_behind": Machine(LOOP, "play behind a lag", lambda u, dt: play(lag(u, dt, 0.1), 0.2)),
    "play_of_few_samples": Machine(LOOP, "play ahead of a lag, 200 samples", lambda u, dt: lag(play(u, 0.4), dt, 0.1),
        period_s=0.05, commands=lambda rng: {"steps": signals.steps(rng, 200, 10)}),
    "play_in_noise": Machine(LOOP, "play of a tenth, noise of a third", lambda u, dt: second_order(play(u, 0.2), dt),
        noise=0.33),
    "dry_motor": Machine(("friction", "dead_band"), "dry friction of a motor's speed", dry_motor, period_s=0.02),
    "dry_spring": Machine(("friction",), "a spool that sticks, 50,000 samples", dry_spring, period_s=0.002,
        commands=lambda rng: {
            "all": np.concatenate([signals.steps(rng, 25_000, 700), signals.triangle(25_000, 6000)])}),
    "slew": Machine(("rate_limit",), "an actuator of limited speed", lambda u, dt: lag(rate_limited(u, 0.04), dt, 0.1)),
    "slower_down": Machine(("asymmetric_response",), "slower down than up", slower_down),
    "tank": Machine(("orifice_flow",), "a tank", tanks([1.5]), period_s=0.2, low=0.4, high=2),
    "three_tanks": Machine(("orifice_flow",), "three tanks in a row", tanks([1, 1.3, 0.8]), period_s=0.2,
        low=0.4, high=2, last_hz=0.2),
    "weir": Machine(("orifice_flow",), "a tank with a weir", weir, commands=lambda rng: short(rng, 0.3, 2)),
    "hard_spring": Machine(("stiffening_spring",), "a hardening spring", spring(0.5), period_s=0.05, last_hz=1),
    "bump_stop": Machine(("stiffening_spring",), "a spring with bump stops", spring(0, 0.5), period_s=0.05, last_hz=1),
    "tone": Machine(("periodic_disturbance",), "a tone of 3.3 Hz, one recording", second_order, tone, commands=at_once),
    "tone_in_three": Machine(("periodic_disturbance",), "the same in three recordings", second_order, tone),
    "warming": Machine(("thermal_drift",), "a gain that warms by a fifth", second_order,
        changing(lambda s: 1 - 0.2 * (1 - np.exp(-4 * s))), commands=lambda rng: at_once(rng, 0.5, 2)),
    "losing_gain": Machine(("intermittent",), "a gain that drops by a quarter, one recording", second_order,
        changing(lambda s: np.where(s < 0.55, 1, 0.75)), commands=lambda rng: at_once(rng, 0.5, 2)),
    "losing_gain_in_three": Machine(("intermittent",), "the same in three recordings", second_order,
        changing(lambda s: np.where(s < 0.6, 1, 0.75))),
    "drifting_gauge": Machine(("sensor_drift",), "a gauge that drifts, one recording", second_order,
        lambda rng, t, _, y: y + 0.008 * t, commands=lambda rng: at_once(rng, 0.5, 2)),
    "room": Machine(("side_input",), "a gauge that feels the room", second_order,
        lambda rng, t, u, y, side: y + 0.1 * (side - 20), side=warm_room),
    "valve_with_a_curve": valve(lambda u, dt: 60 * lag(u, dt, 0.05) + 40 * lag(u, dt, 0.05) ** 2, CURVE,
        "a curved map"),
    "valve_with_a_stop": valve(lambda u, dt: np.minimum(120 * spool(u, dt) - 10, 130), ("saturation",),
        "a stop at 130 psi"),
    "valve_with_a_magnet": valve(
        lambda u, dt: 90 + 45 * spool(0.8 * (u - 0.8) / 0.6 + 0.25 * preisach((u - 0.8) / 0.6), dt), ("hysteresis",),
        "a loop of 5 %"),
    "valve_with_an_s_curve": valve(
        lambda u, dt: 86 + 60 * lag((u - 0.8) / 0.6 - 0.3 * ((u - 0.8) / 0.6) ** 3, dt, 0.05), CURVE,
        "a map that flattens"),
    "valve_with_a_chamber": valve(chamber, ("orifice_flow", "leakage"), "a chamber that empties by an orifice"),
    "sticking_valve": valve(lambda u, dt: 110 * spool(stick_slip(u, 0.05, 0.02), dt), ("friction",),
        "a spool that sticks"),
    "long_valve_with_a_stop": Machine(("saturation",), "a stop at 130 psi, 16,000 samples in four recordings",
        lambda u, dt: np.minimum(120 * spool(u, dt) - 10, 130), period_s=0.005,
        commands=lambda rng: valve_session(rng, 4000),
        columns=("time_s", "current_A", "pressure_psi"), units=True),
}
