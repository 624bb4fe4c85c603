"""Valves as a script would write them: a held command, a static map, linear dynamics behind it, white noise.

Euler steps of a millisecond, all valves at once. Nothing here is taken from the engine or from the other stands: play
by limiting, stick-slip by He's two parameters, a loop of six plays, a spool without mass.
"""
import dataclasses

import numpy as np

RATE_HZ = 200
SUBSTEPS = 5
STEP_S = 1 / RATE_HZ / SUBSTEPS
NOISE_PSI = 0.35
RANGE_PSI = 220.0
MEAN_TEMPERATURE_C = 25.0
PLAYS = 6
# A chamber behind a restrictor: the flow goes with this power of the drop, and in proportion to small ones.
RESTRICTOR_POWER = 0.65
RESTRICTOR_LAMINAR_PSI = 4.0
RESTRICTOR_TIME_S, RESTRICTOR_DROP_PSI = 0.05, 25.0
_WIDTHS = np.linspace(0.1, 1, PLAYS)


@dataclasses.dataclass
class Fault:
    """What is wrong with a valve, by the words of the contract; the defaults are nothing."""
    cause: str = ""
    breakaway_a: float = 0
    kinetic_a: float = 0
    backlash_a: float = 0
    hysteresis_a: float = 0
    dead_band_a: float = 0
    dead_band_centre_a: float = 1.5
    level_psi: float = np.inf
    ratio: float = 1
    curvature: float = 0
    delay_s: float = 0
    lag_s: float = 0
    resonance_hz: float = 0
    resonance_damping: float = 0.1
    limit_a_per_s: float = np.inf
    fall_to_rise: float = 1
    loss: float = 0
    cubic: float = 0
    hunting_hz: float = 0
    hunting_psi: float = 0
    tone_hz: float = 0
    tone_psi: float = 0
    warming: float = 0
    warming_s: float = 20
    offset_psi: float = 0
    drift_psi_per_s: float = 0
    breaks_at_s: float = np.inf  # in the triangle alone
    breaks_by: float = 0
    per_degree_psi: float = 0
    comb_psi: float = 0  # outside the vocabulary: the reading goes in waves along its own scale


FAULTS = {
    "friction 20 mA": Fault("friction", breakaway_a=0.02, kinetic_a=0.012),
    "friction 50 mA": Fault("friction", breakaway_a=0.05, kinetic_a=0.03),
    "backlash 15 mA": Fault("backlash", backlash_a=0.015),
    "backlash 50 mA": Fault("backlash", backlash_a=0.05),
    "hysteresis 20 mA": Fault("hysteresis", hysteresis_a=0.02),
    "hysteresis 60 mA": Fault("hysteresis", hysteresis_a=0.06),
    "dead band 30 mA": Fault("dead_band", dead_band_a=0.03),
    "dead band 80 mA": Fault("dead_band", dead_band_a=0.08, dead_band_centre_a=1.7),
    "saturation at 180 psi": Fault("saturation", level_psi=180),
    "saturation at 150 psi": Fault("saturation", level_psi=150),
    "gain 0.9": Fault("gain_loss", ratio=0.9),
    "gain 0.75": Fault("gain_loss", ratio=0.75),
    "curve 0.1": Fault("static_curve", curvature=0.1),
    "curve -0.15": Fault("static_curve", curvature=-0.15),
    "delay 8 ms": Fault("transport_delay", delay_s=0.008),
    "delay 20 ms": Fault("transport_delay", delay_s=0.02),
    "lag 20 ms": Fault("extra_lag", lag_s=0.02),
    "lag 80 ms": Fault("extra_lag", lag_s=0.08),
    "resonance 12 Hz": Fault("resonance", resonance_hz=12),
    "resonance 7 Hz": Fault("resonance", resonance_hz=7, resonance_damping=0.2),
    "rate 4 A/s": Fault("rate_limit", limit_a_per_s=4),
    "rate 1.5 A/s": Fault("rate_limit", limit_a_per_s=1.5),
    "falls 1.3 times slower": Fault("asymmetric_response", fall_to_rise=1.3),
    "falls twice slower": Fault("asymmetric_response", fall_to_rise=2),
    "leak 3 %": Fault("leakage", loss=0.03),
    "leak 10 %": Fault("leakage", loss=0.1),
    "cubic 0.05": Fault("stiffening_spring", cubic=0.05),
    "cubic 0.2": Fault("stiffening_spring", cubic=0.2),
    "hunting 9 Hz": Fault("self_oscillation", hunting_hz=9, hunting_psi=1),
    "hunting 6 Hz": Fault("self_oscillation", hunting_hz=6, hunting_psi=4),
    "mains 50 Hz": Fault("periodic_disturbance", tone_hz=50, tone_psi=1),
    "pump 17 Hz": Fault("periodic_disturbance", tone_hz=17, tone_psi=0.5),
    "warming 5 %": Fault("thermal_drift", warming=-0.05, warming_s=8),
    "warming 12 %": Fault("thermal_drift", warming=-0.12, warming_s=15),
    "offset 3 psi": Fault("sensor_offset", offset_psi=3),
    "offset -8 psi": Fault("sensor_offset", offset_psi=-8),
    "drift 0.1 psi/s": Fault("sensor_drift", drift_psi_per_s=0.1),
    "drift -0.03 psi/s": Fault("sensor_drift", drift_psi_per_s=-0.03),
    "breaks by 5 %": Fault("intermittent", breaks_at_s=10, breaks_by=-0.05),
    "breaks by 15 %": Fault("intermittent", breaks_at_s=26, breaks_by=-0.15),
    "0.5 psi a degree": Fault("side_input", per_degree_psi=0.5),
    "1.5 psi a degree": Fault("side_input", per_degree_psi=1.5),
    "comb of 2 psi": Fault("outside", comb_psi=2),
}


def commands():
    """Current of each test [A] and the contract's word for it, by file name."""
    tests = {f"step_{level}A": ("step", np.r_[np.full(200, 1.2), np.full(1000, level), np.full(600, 1.2)])
             for level in (1.4, 1.6, 1.8, 2.0)}
    tests["staircase"] = ("staircase", np.repeat([1.2, 1.4, 1.6, 1.8, 2.0, 1.8, 1.6, 1.4, 1.2], 500))
    wave = np.r_[np.linspace(1.2, 2.0, 2000), np.linspace(2.0, 1.2, 2000)]
    tests["triangle"] = ("triangle", np.r_[np.full(200, 1.2), wave, wave, np.full(100, 1.2)])
    time = np.arange(6000) / RATE_HZ
    growth = 80 ** (1 / time[-1])  # from 0.1 Hz to 8 Hz
    tests["sweep"] = ("sweep", 1.6 + 0.2 * np.sin(2 * np.pi * 0.1 * (growth ** time - 1) / np.log(growth)))
    return tests


def steady_map():
    """Pressure over current: straight lines through the published levels, rounded over a twentieth of an ampere."""
    current = np.linspace(0.9, 2.4, 3001)
    straight = np.interp(current, [1.0, 1.2, 1.4, 1.6, 1.8, 2.0, 2.2], [0, 3.1, 26, 120, 160, 210, 235])
    kernel = np.hanning(201)
    return current, np.convolve(np.pad(straight, 100, "edge"), kernel / kernel.sum(), "valid")


class Valves:
    """Valves of one type with their faults, each with parameters of its own.

    restrictor  the reading fills through one, where it else follows linear dynamics of second order
    """

    def __init__(self, faults, rng, restrictor=False):
        self.rng, self.count, self.restrictor = rng, len(faults), restrictor
        for field in dataclasses.fields(Fault):
            if field.name != "cause":
                setattr(self, field.name, np.array([getattr(fault, field.name) for fault in faults], float))
        normal = rng.standard_normal
        n = self.count
        self.gain = 1 + 0.02 * normal(n)
        self.natural_rad_s = 2 * np.pi * 5 * np.exp(0.04 * normal(n))
        self.damping = 0.9 * np.exp(0.04 * normal(n))
        self.loop_a = 0.004 * np.exp(0.2 * normal(n)) + self.hysteresis_a
        self.shift_a = 0.004 * normal(n)
        self.late = (0.012 + 0.0005 * normal(n) + self.delay_s) / STEP_S
        good_friction = 0.002 * np.exp(0.2 * normal(n))
        self.breakaway_a += good_friction
        self.kinetic_a += 0.7 * good_friction
        self.map_a, self.map_psi = steady_map()

    def spool(self, state, x):
        """What the map is asked for by a current x, in A."""
        state.limited += np.clip(x - state.limited, -self.limit_a_per_s * STEP_S, self.limit_a_per_s * STEP_S)
        force = state.limited - state.stuck
        slips = np.abs(force) > self.breakaway_a
        state.stuck = np.where(slips, state.limited - np.sign(force) * self.kinetic_a, state.stuck)
        state.lost = np.clip(state.lost, state.stuck - self.backlash_a / 2, state.stuck + self.backlash_a / 2)
        half = 0.5 * self.loop_a * _WIDTHS[:, None]
        state.loops = np.clip(state.loops, state.lost - half, state.lost + half)
        opening = state.loops.mean(0)
        low, high = (self.dead_band_centre_a + side * self.dead_band_a / 2 for side in (-1, 1))
        opening = np.where(opening < low, opening + self.dead_band_a / 2,
                           np.where(opening > high, opening - self.dead_band_a / 2, self.dead_band_centre_a))
        state.lagging += np.where(self.lag_s > 0, STEP_S / np.maximum(self.lag_s, STEP_S), 1) * (opening - state.lagging)
        return state.lagging

    def steady(self, opening, heat, time_s, is_triangle):
        psi = self.gain * np.interp(opening, self.map_a, self.map_psi)
        share = psi / RANGE_PSI
        psi = psi * self.ratio + self.curvature * RANGE_PSI * share * (1 - share)
        breaks = is_triangle & (time_s > self.breaks_at_s)
        return psi * (1 + self.warming * heat) * np.where(breaks, 1 + self.breaks_by, 1)

    def play(self, name, current):
        """Pressure of every valve [samples × valves] and the temperature beside it [samples]."""
        samples, n = len(current), self.count
        state = _State(current[0] + self.shift_a)
        heat = np.zeros(n)
        hunting_phase, tone_phase = self.rng.uniform(0, 2 * np.pi, (2, n))
        pressure = np.zeros((samples, n))
        psi = rate = mode = mode_rate = None
        time = np.arange(samples) / RATE_HZ
        temperature = MEAN_TEMPERATURE_C + 2 * np.sin(2 * np.pi * time / 37 + self.rng.uniform(0, 2 * np.pi))
        temperature += 0.02 * np.cumsum(self.rng.standard_normal(samples)) / np.sqrt(RATE_HZ)
        held = np.repeat(current, SUBSTEPS)
        steps = np.arange(len(held))
        for k in steps:
            x = np.interp(k - self.late, steps, held) + self.shift_a
            heat += STEP_S / self.warming_s * ((held[k] / 2) ** 2 - heat)
            asked = self.steady(self.spool(state, x), heat, k * STEP_S, name == "triangle")
            if k == 0:
                psi, mode, rate, mode_rate = asked.copy(), asked.copy(), np.zeros(n), np.zeros(n)
            force = asked - psi - self.cubic * (psi / RANGE_PSI) ** 3 * RANGE_PSI
            force -= self.loss * np.sqrt(np.maximum(psi, 0) * RANGE_PSI)
            if self.restrictor:
                drop = np.hypot(force, RESTRICTOR_LAMINAR_PSI) / RESTRICTOR_DROP_PSI
                rate = force / RESTRICTOR_TIME_S * drop ** (RESTRICTOR_POWER - 1)
                rate *= self.natural_rad_s / (2 * np.pi * 5) / np.where(asked < psi, self.fall_to_rise, 1)
            else:
                natural = self.natural_rad_s / np.where(asked < psi, self.fall_to_rise, 1)
                rate += STEP_S * (natural ** 2 * force - 2 * self.damping * natural * rate)
            psi = psi + STEP_S * rate
            omega = 2 * np.pi * self.resonance_hz
            mode_rate += STEP_S * (omega ** 2 * (psi - mode) - 2 * self.resonance_damping * omega * mode_rate)
            mode = mode + STEP_S * mode_rate
            hunting_phase += 2 * np.pi * STEP_S * self.hunting_hz * (1 + 0.1 * (psi - 120) / 120)
            if k % SUBSTEPS == 0:
                at, seconds = k // SUBSTEPS, k * STEP_S
                read = np.minimum(np.where(self.resonance_hz > 0, mode, psi), self.level_psi)
                read = read + self.hunting_psi * np.exp(-((psi - 120) / 60) ** 2) * np.sin(hunting_phase)
                read += self.tone_psi * np.sin(2 * np.pi * self.tone_hz * seconds + tone_phase)
                read += self.offset_psi + self.drift_psi_per_s * seconds
                read += self.per_degree_psi * (temperature[at] - MEAN_TEMPERATURE_C)
                pressure[at] = read + self.comb_psi * np.sin(read / 9)
        return pressure + NOISE_PSI * self.rng.standard_normal(pressure.shape), temperature


class _State:
    """Where everything between current and map stands, at rest under a current."""

    def __init__(self, rest_a):
        self.limited, self.stuck, self.lost, self.lagging = (rest_a.copy() for _ in range(4))
        self.loops = np.tile(rest_a, (PLAYS, 1))


def write(folder, serials, faults, rng, restrictor=False):
    """One folder of recordings for each valve."""
    valves = Valves(faults, rng, restrictor)
    for name, (test, current) in commands().items():
        pressure, temperature = valves.play(name, current)
        time = np.arange(len(current)) / RATE_HZ
        for n, serial in enumerate(serials):
            (folder / serial).mkdir(parents=True, exist_ok=True)
            header = (f"# serial: {serial}\n# valve_type: plain\n# test: {test}\n"
                      "time_s,current_A,pressure_psi,temperature_C")
            np.savetxt(folder / serial / f"{name}.csv", np.c_[time, current, pressure[:, n], temperature],
                       fmt="%.3f,%.4f,%.3f,%.3f", header=header, comments="")
