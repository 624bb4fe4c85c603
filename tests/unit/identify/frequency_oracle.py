#!/usr/bin/env python3
"""Reference numbers for the frequency domain, by SciPy instead of the product: writes frequency_oracle_numbers.h.

    python3 tests/unit/identify/frequency_oracle.py > tests/unit/identify/frequency_oracle_numbers.h

Run by hand where SciPy is installed (1.10.1 made the committed numbers); the tests need only its output.

responses   transfer functions at frequencies, scipy.signal.freqs_zpk
fits        noisy responses with their best rational function: scipy.optimize.least_squares from the true one, over
            logarithms of corner frequencies and damping ratios
corners     noisy gains with their best real corners: the same for V of Eq 1
sweep       what a continuous plant makes of a swept sine that goes straight between its samples, scipy.signal.lsim
"""

import numpy
from scipy import optimize, signal

TWO_PI = 2 * numpy.pi

# name, real poles [Hz], modes [(Hz, damping)], real zeros [Hz], delay [s]; static gain 470
SYSTEMS = {
    3: ([2.4], [(25, 0.75)], [], 0.004),
    5: ([2.4], [(25, 0.7), (40, 0.2)], [13], 0.004),
    7: ([2.4], [(9, 0.3), (25, 0.7), (40, 0.2)], [6, 30], 0.004),
    9: ([0.8], [(3, 0.4), (9, 0.3), (25, 0.3), (40, 0.2)], [2, 6, 30], 0.004),
}


def zeros_poles(real, modes, zeros):
    poles = [-TWO_PI * hz + 0j for hz in real]
    for hz, damping in modes:
        pair = TWO_PI * hz * (-damping + 1j * numpy.sqrt(1 - damping**2))
        poles += [pair, pair.conjugate()]
    return numpy.array([-TWO_PI * hz + 0j for hz in zeros]), numpy.array(poles)


def response(static_gain, real, modes, zeros, delay, f):
    z, p = zeros_poles(real, modes, zeros)
    gain = static_gain * (numpy.prod(-p) / numpy.prod(-z)).real
    _, h = signal.freqs_zpk(z, p, gain, worN=TWO_PI * f)
    return h * numpy.exp(-1j * TWO_PI * f * delay)


def unpacked(x, counts):
    """ln static gain, ln corners of poles, (ln corner, ln damping) of modes, ln corners of zeros, delay."""
    reals, modes, zeros = counts
    at = 1
    real = numpy.exp(x[at:at + reals])
    at += reals
    pairs = numpy.exp(x[at:at + 2 * modes]).reshape(-1, 2)
    at += 2 * modes
    return numpy.exp(x[0]), real, pairs, numpy.exp(x[at:at + zeros]), x[at + zeros] * 1e-2


def best_rational(system, f, h, sd):
    real, modes, zeros, delay = system
    counts = (len(real), len(modes), len(zeros))
    start = numpy.log([470] + real + [v for mode in modes for v in mode] + zeros).tolist() + [delay * 1e2]

    def residual(x):
        gap = (response(*unpacked(x, counts), f) - h) / sd * numpy.sqrt(2)
        return numpy.concatenate([gap.real, gap.imag])

    found = optimize.least_squares(residual, start, method="lm", xtol=1e-14, ftol=1e-14, gtol=1e-14)
    return unpacked(found.x, counts), 2 * found.cost


def best_corners(poles, zeros, f, gain):
    """V = 1/2 sum (ln |Y| - ln |G|)^2 (Eq 1), from the true corners."""
    counts = (len(poles), 0, len(zeros))
    start = numpy.log([1] + poles + zeros).tolist()

    def residual(x):
        g = response(*unpacked(numpy.append(x, 0), counts), f)
        return numpy.log(gain) - numpy.log(numpy.abs(g))

    found = optimize.least_squares(residual, start, method="lm", xtol=1e-14, ftol=1e-14, gtol=1e-14)
    _, p, _, z, _ = unpacked(numpy.append(found.x, 0), counts)
    return p, z, found.cost


def numbers(values):
    return "{" + ", ".join(f"{v:.12g}" for v in values) + "}"


def complexes(values):
    return "{" + ", ".join(f"{{{v.real:.12g}, {v.imag:.12g}}}" for v in values) + "}"


def print_fits():
    print("/// Noisy responses: error of 1 % (rms of the complex gain), and the best rational function.")
    print("inline const std::vector<OracleFit> kOracleFits{")
    f = numpy.geomspace(0.2, 80, 60)
    for order, system in SYSTEMS.items():
        rng = numpy.random.default_rng(order)
        true = response(470, *system, f)
        sd = 0.01 * numpy.abs(true)
        h = true + sd / numpy.sqrt(2) * (rng.standard_normal(60) + 1j * rng.standard_normal(60))
        h = numpy.array([complex(f"{v.real:.9g}{v.imag:+.9g}j") for v in h])  # as printed
        sd = numpy.array([float(f"{v:.9g}") for v in sd])
        (static_gain, real, pairs, zeros, delay), chi_square = best_rational(system, f, h, sd)
        z, p = zeros_poles(real, pairs, zeros)
        print(f"    {{.order = {order}, .zeros = {len(zeros)},")
        print(f"     .frequency_hz = {numbers(f)},")
        print(f"     .exact = {complexes(true)},")
        print(f"     .measured = {complexes(h)},")
        print(f"     .std_error = {numbers(sd)},")
        print(f"     .chi_square = {chi_square:.12g}, .static_gain = {static_gain:.12g}, .delay_s = {delay:.12g},")
        print(f"     .poles = {complexes(p)},")
        print(f"     .fitted_zeros = {complexes(z)}}},")
    print("};\n")


def print_corners():
    print("/// Noisy gains (2 %), and the real corners that minimise V of Eq 1.")
    print("inline const std::vector<OracleCorners> kOracleCorners{")
    f = numpy.geomspace(0.02, 200, 50)
    for seed, (poles, zeros) in enumerate([([0.5, 12], [3]), ([0.3, 4, 60], [1.5])]):
        rng = numpy.random.default_rng(seed)
        gain = numpy.abs(response(1, poles, [], zeros, 0, f)) * numpy.exp(0.02 * rng.standard_normal(50))
        gain = numpy.array([float(f"{v:.9g}") for v in gain])
        p, z, v = best_corners(poles, zeros, f, gain)
        print(f"    {{.frequency_hz = {numbers(f)},")
        print(f"     .gain = {numbers(gain)},")
        print(f"     .v = {v:.12g}, .pole_hz = {numbers(sorted(p))}, .zero_hz = {numbers(sorted(z))}}},")
    print("};\n")


def print_sweep():
    rate, n, low, high = 200, 4000, 0.2, 20
    t = numpy.arange(n) / rate
    length = n / rate / numpy.log(high / low)
    u = 0.1 * numpy.sin(TWO_PI * low * length * numpy.expm1(t / length))
    z, p = zeros_poles([2.4], [(25, 0.75)], [])
    _, y, _ = signal.lsim((z, p, 470 * numpy.prod(-p).real), u, t, interp=True)
    print("/// Every hundredth sample of the output about its steady value: 0.1 A from 0.2 to 20 Hz in 20 s at 200 Hz.")
    print("inline const std::vector<double> kOracleSweepOutput" + numbers(y[::100]) + ";\n")


def main():
    print("#pragma once\n")
    print("// Made by tests/unit/identify/frequency_oracle.py with SciPy; see there.\n")
    print("// clang-format off\n#include <complex>\n#include <vector>\n")
    print("namespace valvetriage::test {\n")
    print("struct OracleFit {\n  int order, zeros;\n  std::vector<double> frequency_hz;\n"
          "  std::vector<std::complex<double>> exact, measured;\n  std::vector<double> std_error;\n"
          "  double chi_square, static_gain, delay_s;\n  std::vector<std::complex<double>> poles, fitted_zeros;\n};\n")
    print("struct OracleCorners {\n  std::vector<double> frequency_hz, gain;\n  double v;\n"
          "  std::vector<double> pole_hz, zero_hz;\n};\n")
    print_fits()
    print_corners()
    print_sweep()
    print("}  // namespace valvetriage::test")


if __name__ == "__main__":
    main()
