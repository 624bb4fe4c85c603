#pragma once

#include <limits>
#include <span>
#include <vector>

namespace valvetriage {

/// A fluid volume between a variable supply orifice and a fixed drain orifice, written by the steady pressure m that
/// the spool's position asks for:
///
///   dp/dt = κ [ √((P_s − p) / (P_s − m)) φ(m) − φ(p) ],   φ(p) = (p + ε)^n − ε^n for p ≥ 0, its tangent below
///
/// At p = m nothing flows, whatever n. A spool meters over a sharp edge, which is Bernoulli's orifice whatever the
/// fluid (Merritt, section 3.2); n is the drain's, 1/2 where it is turbulent, 1 where it is laminar, and with P_s far
/// above the volume is then a plain first-order lag. κ is set so that the small-signal time constant at the reference
/// pressure is `time_constant_s`: settling is fast at low pressure and slow at mid pressure, and differs up and down.
/// ε = 0.1 psi: every orifice is laminar at small drops (Borutzky, Control Eng. Practice 10 (2002) 1253).
/// Source: Merritt, Hydraulic Control Systems (1967), chapters 3 and 5.
///
/// Air in the fluid gives way more the lower the pressure: free air that follows Boyle's law adds a capacity that falls
/// with the square of the absolute pressure, so dp/dt is divided by
///
///   C(p)/C(r) = (1 + a q²) / (1 + a),   q = (r + p_atm) / (p + p_atm), p ≥ 0,   p_atm = 14.7 psi
///
/// with a the air's share at the reference pressure r over that of fluid and walls.
/// Source: Manring, Hydraulic Control Systems (2005), section 2.4 (fluid bulk modulus with entrained air).
///
/// What may be wrong with it, neutral by default; the inflow and κ stay those of the healthy volume:
///
///   dp/dt = κ [ √((P_s − p) / (P_s − m)) φ_n(m) − φ_{n+Δ}(p) φ_n(r)/φ_{n+Δ}(r) − f φ_n(H) ψ(p)/ψ(H) ] / (fall ratio)
///
/// with Δ the drain's excess exponent, r the reference pressure, f the loss fraction, H the highest pressure,
/// ψ(p) = √(p + ε) − √ε, the fall ratio only while p falls, m never above the stop (of the spool) and p never above the
/// ceiling (a relief valve). It then settles at `settled_psi`, which is m only for the healthy one.
struct OrificeVolume {
  double time_constant_s = 0;  ///< > 0, at reference_psi [s]
  double exponent = 0.5;       ///< n of the drain's flow over its pressure drop, 0.2 to 1.5
  double supply_psi = 0;       ///< P_s, above every steady pressure [psi]
  double reference_psi = 0;    ///< where the time constant holds [psi]
  double air_share = 0;        ///< a ≥ 0, capacity of entrained air over that of fluid and walls at reference_psi

  double fall_to_rise_ratio = 1;     ///< time constant of falling over that of rising, > 0
  double loss_fraction = 0;          ///< f ≥ 0, loss over through-flow at highest_psi
  double highest_psi = 0;            ///< H, the reference's highest level; 0: twice reference_psi [psi]
  double drain_excess_exponent = 0;  ///< Δ; n + Δ is kept at 0.05 or more
  double ceiling_psi = std::numeric_limits<double>::infinity();  ///< of p [psi]
  double stop_psi = std::numeric_limits<double>::infinity();     ///< of m [psi]

  bool operator==(const OrificeVolume&) const = default;
};

/// How small changes travel from one sample to the next:
///
///   δp_{i+1} = keep[i] δp_i + begin[i] δm_{2i} + middle[i] δm_{2i+1} + end[i] δm_{2i+2}
struct VolumeTangent {
  std::vector<double> keep;
  std::vector<double> begin, middle, end;
};

/// Pressure in the volume at each sample, from `first_psi` on.
///
/// steady    m at each sample and half-way to the next, two values a sample: a spool turns within one, and a straight
///           line between its samples errs by several noises at every edge [psi]
/// pressure  one value a sample, may be the first half of steady's memory
/// tangent   filled where not null
/// Cost      O(n), flows from a table of a thousand powers made once; the inflow of a sample by Simpson's rule, the
///           pressure by an exponential midpoint rule, second order in the sampling period and stable for every time
///           constant
void run_volume(const OrificeVolume& volume, double sample_period_s, double first_psi, std::span<const double> steady,
                std::span<double> pressure, VolumeTangent* tangent = nullptr);

/// One of several volumes to be run.
struct VolumeRun {
  const OrificeVolume* volume = nullptr;
  double sample_period_s = 0, first_psi = 0;
  std::span<const double> steady;
  std::span<double> pressure;
  VolumeTangent* tangent = nullptr;
};

/// The same for several recordings, bit for bit, in less time: neighbours of one volume share its tables.
void run_volumes(std::span<const VolumeRun> runs);

/// The same without the spool's stop, for one that follows a mode: the spool comes to its stop ahead of it, and what
/// the mode makes of that may go beyond.
OrificeVolume without_stop(OrificeVolume volume);

/// The pressure at which the volume settles under a steady m: m itself where nothing is wrong, lower with a loss.
double settled_psi(const OrificeVolume& volume, double steady_psi);

}  // namespace valvetriage
