#include "core/discrepancy/machine_report.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>

#include "core/discrepancy/machine_shape.h"
#include "core/statistics/distributions.h"

namespace valvetriage {
namespace {

constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
constexpr double kNothing = 0.003;  // of the range: below, a width or a curve has no effect that a reader could see

const MachineBlock* find_block(const MachineFit& fit, MachineLaw law, std::size_t* index = nullptr) {
  for (std::size_t b = 0; b < fit.machine.blocks.size(); ++b) {
    if (fit.machine.blocks[b].law != law) continue;
    if (index) *index = b;
    return &fit.machine.blocks[b];
  }
  return nullptr;
}

/// Writes estimates: value = factor · parameter + offset, error alike.
class Writer {
 public:
  Writer(const MachineFit& fit, const Eigen::MatrixXd& covariance) : fit_(fit), covariance_(covariance) {}

  void add(const std::string& name, std::size_t block, std::size_t index, double factor, double offset,
           const std::string& unit) {
    const double value = fit_.machine.blocks[block].parameters[index];
    add_value(name, factor * value + offset, std::abs(factor) * error_of(block, index), unit);
  }

  void add_value(const std::string& name, double value, double error, const std::string& unit) {
    ParameterEstimate estimate{.value = value, .std_error = error, .unit = unit};
    estimate.ci95 = {value - kTwoSided95 * error, value + kTwoSided95 * error};
    estimate.population_mean = estimate.population_sd = kUnknown;
    estimates.emplace_back(name, estimate);
  }

  double error_of(std::size_t block, std::size_t index) const {
    for (std::size_t i = 0; i < fit_.free.size(); ++i) {
      const FreeParameter& p = fit_.free[i];
      if (p.block != block || p.field != MachineField::kParameter || p.index != index) continue;
      const auto at = static_cast<Eigen::Index>(i);
      return at < covariance_.rows() ? std::sqrt(std::max(0.0, covariance_(at, at))) : 0;
    }
    return 0;
  }

  /// Of a weighted sum of a block's feedback coefficients.
  double error_of_feedback(std::size_t block, const std::vector<double>& weights) const {
    Eigen::VectorXd direction = Eigen::VectorXd::Zero(covariance_.rows());
    for (std::size_t i = 0; i < fit_.free.size(); ++i) {
      const FreeParameter& p = fit_.free[i];
      if (p.block != block || p.field != MachineField::kFeedback || p.index >= weights.size()) continue;
      if (static_cast<Eigen::Index>(i) < direction.size()) direction[static_cast<Eigen::Index>(i)] = weights[p.index];
    }
    return std::sqrt(std::max(0.0, direction.dot(covariance_ * direction)));
  }

  std::vector<std::pair<std::string, ParameterEstimate>> estimates;

 private:
  const MachineFit& fit_;
  const Eigen::MatrixXd& covariance_;
};

/// Where a signal that stands at `value` in front of block `from` leaves the reading: dynamics by the gain that the
/// records show, what has none by its own law, as the rounding of a second limit.
double at_reading(const MachineData& data, const MachineFit& fit, std::size_t from, double value) {
  for (std::size_t b = from; b < fit.machine.blocks.size(); ++b) {
    const MachineBlock& block = fit.machine.blocks[b];
    switch (block.law) {
      case MachineLaw::kLinear:
      case MachineLaw::kSpring:
      case MachineLaw::kRestoringLoop:
        value *= gain_seen(data, block.sections, block.numerator);
        break;
      case MachineLaw::kAffine:
      case MachineLaw::kUpperLimit:
      case MachineLaw::kLowerLimit:
      case MachineLaw::kDeadBand:
      case MachineLaw::kCurve:
      case MachineLaw::kMagnitude:
        run_block(block, fit.machine.sample_period_s, {}, {}, std::span(&value, 1), std::span(&value, 1));
        break;
      default:
        break;
    }
  }
  return value;
}

/// Whether the rims of tanks hold something back, often enough to be seen.
bool reaches_rim(const MachineData& data, const MachineFit& fit, std::size_t tanks) {
  constexpr double kSeen = 1e-6;
  std::size_t held = 0;
  for (std::size_t r = 0; r < data.records.size(); ++r) {
    const MachineRecord& record = data.records[r];
    Machine chain = fit.machine;
    chain.blocks.resize(tanks + 1);
    const auto level = run_machine(chain, around(record), fit.starts[r], record.input);
    chain.blocks[tanks].parameters[6] = chain.blocks[tanks].parameters[8] = kNoRim;
    const auto boundless = run_machine(chain, around(record), fit.starts[r], record.input);
    for (const std::size_t t : record.valid) held += std::abs(boundless[t] - level[t]) > kSeen ? 1 : 0;
  }
  return held >= 3;
}

/// The major loop of a restoring force along the output's range up and down, by the law's own equation.
struct MajorLoop {
  double width = 0;   ///< at mid range, in h
  double height = 0;  ///< in h
};

MajorLoop major_loop(const MachineBlock& block, double output_range) {
  constexpr int kPoints = 400;
  const double beta = block.parameters[0], delta = block.parameters[1];
  const double step = output_range / kPoints;
  double h = 0, up = 0, down = 0, low = INFINITY, high = -INFINITY;
  for (int i = 0; i < 4 * kPoints; ++i) {
    const int phase = i % (2 * kPoints);
    h = loop_after(h, phase < kPoints ? step : -step, beta, delta);
    if (phase == kPoints / 2) up = h;
    if (phase == kPoints + kPoints / 2) down = h;
    if (i < 2 * kPoints) continue;
    low = std::min(low, h);
    high = std::max(high, h);
  }
  return {std::abs(up - down), high - low};
}

/// Full width at mid range as an input [scaled units].
double loop_width(const MachineData& data, const MachineBlock& block, double output_range) {
  const double gain = gain_seen(data, block.sections, block.numerator);
  return std::abs(major_loop(block, output_range).width * gain_seen(data, block.sections, block.feedback) / gain);
}

/// Whether the way back lies apart from the way there. Without memory the law still bends the restoring force, and its
/// steps damp: what looks like a loop then is a spring or a damping of another kind.
bool has_memory(const MachineBlock& block, double output_range) {
  constexpr double kLeastOpening = 0.1;  // of the loop's height
  const MajorLoop loop = major_loop(block, output_range);
  return loop.width > kLeastOpening * loop.height;
}

/// Whether the readings may be said to stop at a level. Far from all of them it is where a curve would end that nobody
/// followed so far; a level that many of them pass by far, on both sides of it, is where nothing stops.
bool is_a_stop(const MachineData& data, double level) {
  constexpr double kFar = 0.1;        // of the range of the readings
  constexpr double kPassedBy = 0.15;  // of the readings: dynamics behind a stop overshoot it for shorter
  double low = INFINITY, high = -INFINITY;
  for (const MachineRecord& record : data.records) {
    for (const std::size_t t : record.valid) {
      low = std::min(low, record.output[t]);
      high = std::max(high, record.output[t]);
    }
  }
  const double far = kFar * (high - low);
  if (level < low - far || level > high + far) return false;
  double above = 0, below = 0, samples = 0;
  for (const MachineRecord& record : data.records) {
    for (const std::size_t t : record.valid) {
      above += record.output[t] > level + far ? 1 : 0;
      below += record.output[t] < level - far ? 1 : 0;
      samples += 1;
    }
  }
  return std::min(above, below) <= kPassedBy * samples;
}

/// Least and greatest reading [scaled units].
std::array<double, 2> range_of_readings(const MachineData& data) {
  std::array<double, 2> range{INFINITY, -INFINITY};
  for (const MachineRecord& record : data.records) {
    for (const std::size_t t : record.valid) {
      range = {std::min(range[0], record.output[t]), std::max(range[1], record.output[t])};
    }
  }
  return range;
}

/// A level that readings stand at, by an estimate whose error may know of no bound: it lies among the readings.
void add_level(Writer& writer, const std::string& name, double level, double error, const MachineData& data,
               const std::string& unit) {
  const auto [least, greatest] = range_of_readings(data);
  const auto in_unit = [&](double scaled) { return scaled * data.output_scale + data.output_mean; };
  writer.add_value(name, in_unit(level), std::min(error, greatest - least) * data.output_scale, unit);
  ParameterEstimate& added = writer.estimates.back().second;
  added.ci95[0] = std::max(added.ci95[0], std::min(added.value, in_unit(least)));
  added.ci95[1] = std::min(added.ci95[1], std::max(added.value, in_unit(greatest)));
}

void add_levels(Writer& writer, const MachineData& data, const MachineFit& fit, const std::string& unit) {
  for (std::size_t b = 0; b < fit.machine.blocks.size(); ++b) {
    const MachineBlock& block = fit.machine.blocks[b];
    if (block.law == MachineLaw::kTanks) {
      const auto& p = block.parameters;
      if (p[8] < kNoRim) {
        add_level(writer, "level_psi", p[8], writer.error_of(b, 8), data, unit);
      } else {
        // What the lower level comes to while the upper one stands at its rim.
        const double passed = p[3] / p[4];
        add_level(writer, "level_psi", p[9] + passed * p[6], passed * writer.error_of(b, 6), data, unit);
      }
    }
    if (block.law != MachineLaw::kUpperLimit && block.law != MachineLaw::kLowerLimit) continue;
    if (!is_reached(data, fit, b)) continue;
    const double level = at_reading(data, fit, b + 1, block.parameters[0]);
    const double step = 1e-4;
    const double factor = (at_reading(data, fit, b + 1, block.parameters[0] + step) - level) / step;
    if (!is_a_stop(data, level)) continue;
    const bool upper = (block.law == MachineLaw::kUpperLimit) == (factor > 0);
    add_level(writer, upper ? "level_psi" : "lower_level_psi", level, std::abs(factor) * writer.error_of(b, 0), data,
              unit);
  }
}

void add_friction(Writer& writer, const MachineData& data, const MachineFit& fit, const std::string& unit) {
  std::size_t b = 0;
  if (const MachineBlock* stick = find_block(fit, MachineLaw::kStickSlip, &b)) {
    writer.add("breakaway_A", b, 0, data.input_scale, 0, unit);
    if (stick->parameters[1] < stick->parameters[0]) {
      writer.add("kinetic_A", b, 1, data.input_scale, 0, unit);
    } else {
      writer.add("kinetic_A", b, 0, data.input_scale, 0, unit);
    }
  } else if (const MachineBlock* motion = find_block(fit, MachineLaw::kMotion, &b)) {
    const double to_input = data.input_scale / std::abs(motion->parameters[0] + motion->parameters[1]);
    const bool stribeck = motion->parameters[6] > motion->parameters[5];
    writer.add("breakaway_A", b, stribeck ? 6 : 5, to_input, 0, unit);
    writer.add("kinetic_A", b, 5, to_input, 0, unit);
  }
}

void add_loop(Writer& writer, const MachineData& data, const MachineFit& fit, const std::string& unit) {
  std::size_t b = 0;
  if (find_block(fit, MachineLaw::kLoop, &b)) {
    writer.add("width_A", b, 0, data.input_scale, 0, unit);
  } else if (const MachineBlock* loop = find_block(fit, MachineLaw::kRestoringLoop, &b)) {
    double range = 0;
    for (const MachineRecord& record : data.records) {
      const auto [low, high] = std::minmax_element(record.output.begin(), record.output.end());
      range = std::max(range, *high - *low);
    }
    const double width = loop_width(data, *loop, range) * data.input_scale;
    writer.add_value("width_A", width, width * writer.error_of(b, 0) / std::max(loop->parameters[0], 1e-9), unit);
  }
}

void add_side(Writer& writer, const MachineData& data, const MachineFit& fit, const std::string& unit) {
  std::size_t b = 0;
  const MachineBlock* side = find_block(fit, MachineLaw::kSide, &b);
  if (!side) return;
  ParameterEstimate channel{.text = side->channel};
  channel.population_mean = channel.population_sd = kUnknown;
  writer.estimates.emplace_back("channel", channel);
  writer.add("coefficient", b, 0, data.output_scale, 0, unit);
}

std::string per(const std::string& unit, const char* what) {
  return unit.empty() ? std::string() : unit + what;
}

/// Parameters that say how much of a cause there is, and what they are where there is none.
constexpr std::array<std::pair<const char*, double>, 10> kSizes{{{"breakaway_A", 0},
                                                                 {"width_A", 0},
                                                                 {"cubic_coefficient", 0},
                                                                 {"curvature", 0},
                                                                 {"exponent", 1},
                                                                 {"fall_to_rise_ratio", 1},
                                                                 {"drift_psi_per_s", 0},
                                                                 {"amplitude_psi", 0},
                                                                 {"coefficient", 0},
                                                                 {"gain_change", 0}}};

}  // namespace

std::vector<std::pair<std::string, ParameterEstimate>> cause_parameters(const std::string& cause,
                                                                        const MachineData& data, const MachineFit& fit,
                                                                        const Eigen::MatrixXd& covariance,
                                                                        const std::string& input_unit,
                                                                        const std::string& output_unit) {
  Writer writer(fit, covariance);
  std::size_t b = 0;
  const double su = data.input_scale, sy = data.output_scale;
  if (cause == "friction") add_friction(writer, data, fit, input_unit);
  if (cause == "hysteresis") add_loop(writer, data, fit, input_unit);
  if (cause == "saturation") add_levels(writer, data, fit, output_unit);
  if (cause == "side_input") add_side(writer, data, fit, output_unit);
  if (cause == "backlash" && find_block(fit, MachineLaw::kPlay, &b)) writer.add("width_A", b, 0, su, 0, input_unit);
  if (cause == "dead_band" && find_block(fit, MachineLaw::kDeadBand, &b)) {
    writer.add("centre_A", b, 0, su, data.input_mean, input_unit);
    writer.add("width_A", b, 1, su, 0, input_unit);
  }
  if (cause == "static_curve" && find_block(fit, MachineLaw::kCurve, &b)) writer.add("curvature", b, 0, 1, 0, "");
  if (cause == "rate_limit" && find_block(fit, MachineLaw::kRateLimit, &b)) {
    writer.add("limit_A_per_s", b, 0, su, 0, per(input_unit, "/s"));
  }
  if (cause == "asymmetric_response") {
    if (const MachineBlock* lag = find_block(fit, MachineLaw::kLag, &b)) {
      const double ratio = lag->parameters[1] / lag->parameters[0];
      const double relative =
          std::hypot(writer.error_of(b, 0) / lag->parameters[0], writer.error_of(b, 1) / lag->parameters[1]);
      writer.add_value("fall_to_rise_ratio", ratio, ratio * relative, "");
    }
  }
  if (cause == "orifice_flow" && find_block(fit, MachineLaw::kTanks, &b)) writer.add("exponent", b, 5, 1, 0, "");
  if (cause == "stiffening_spring") {
    if (const MachineBlock* spring = find_block(fit, MachineLaw::kSpring, &b)) {
      const double error = writer.error_of_feedback(b, seen_at_rest(data, spring->sections, spring->feedback.size()));
      writer.add_value("cubic_coefficient", -gain_seen(data, spring->sections, spring->feedback) / (sy * sy),
                       error / (sy * sy), output_unit.empty() ? "" : "1/" + output_unit + "2");
    }
  }
  if (cause == "periodic_disturbance") {
    if (const MachineBlock* tone = find_block(fit, MachineLaw::kTone, &b)) {
      writer.add("frequency_hz", b, 2, 1, 0, "Hz");
      writer.add_value("amplitude_psi", std::hypot(tone->parameters[0], tone->parameters[1]) * sy,
                       std::hypot(writer.error_of(b, 0), writer.error_of(b, 1)) * sy, output_unit);
    }
  }
  if (cause == "sensor_drift" && find_block(fit, MachineLaw::kDrift, &b)) {
    writer.add("drift_psi_per_s", b, 0, sy, 0, per(output_unit, "/s"));
  }
  if (cause == "thermal_drift" && find_block(fit, MachineLaw::kWarming, &b)) {
    writer.add("gain_change", b, 0, 1, 0, "");
    writer.add("time_constant_s", b, 1, 1, 0, "s");
  }
  if (cause == "intermittent" && find_block(fit, MachineLaw::kGainStep, &b)) {
    writer.add("time_s", b, 1, 1, 0, "s");
    writer.add("gain_change", b, 0, 1, 0, "");
  }
  return writer.estimates;
}

std::map<std::string, double> excluded_sizes(const MachineScore& score, const MachineScore& linear,
                                             const MachineData& data, const std::string& input_unit,
                                             const std::string& output_unit) {
  constexpr double kOneSided95 = 1.645;
  constexpr double kAsGood = 1.02;  // a fit that has ended farther from the best says nothing of a size
  std::map<std::string, double> excluded;
  if (score.causes.size() != 1 || score.fit.failed || score.fit.rms() > kAsGood * linear.fit.rms()) return excluded;
  double range = 0;
  for (const MachineRecord& record : data.records) {
    const auto [low, high] = std::minmax_element(record.input.begin(), record.input.end());
    range = std::max(range, (*high - *low) * data.input_scale);
  }
  const Eigen::MatrixXd covariance = parameter_covariance(data, data.all_rows(), score.fit);
  for (const auto& [name, estimate] :
       cause_parameters(score.causes.front(), data, score.fit, covariance, input_unit, output_unit)) {
    const auto size = std::find_if(kSizes.begin(), kSizes.end(), [&](const auto& s) { return name == s.first; });
    if (size == kSizes.end() || !(estimate.std_error > 0) || !std::isfinite(estimate.std_error)) continue;
    const double away = estimate.value < size->second ? -1 : 1;
    const double limit = estimate.value + away * kOneSided95 * estimate.std_error;
    const bool is_input = name == "width_A" || name == "breakaway_A";
    if (!is_input || limit < range) excluded.emplace(name, limit);
  }
  return excluded;
}

bool have_certain_sizes(const std::vector<std::string>& causes, const MachineData& data, const MachineFit& fit) {
  if (data.records.empty()) return true;
  const Eigen::MatrixXd covariance = parameter_covariance(data, data.all_rows(), fit);
  for (const std::string& cause : causes) {
    const auto estimates = cause_parameters(cause, data, fit, covariance, "", "");
    // Breakaway is at least what is felt in motion: a machine that hardly ever rests shows the one by the other.
    const bool felt_in_motion = std::any_of(estimates.begin(), estimates.end(), [](const auto& entry) {
      return entry.first == "kinetic_A" && entry.second.std_error > 0 && entry.second.ci95[0] > 0;
    });
    for (const auto& [name, estimate] : estimates) {
      if (name == "breakaway_A" && felt_in_motion) continue;
      for (const auto& [size, none] : kSizes) {
        if (name == size && estimate.ci95[0] <= none && none <= estimate.ci95[1]) return false;
      }
    }
  }
  return true;
}

bool has_effect(const MachineScore& score, const MachineData& data, const MachineGround& ground) {
  constexpr double kGainChange = 0.02;
  const double input = ground.input_range();
  const bool stops = std::find(score.causes.begin(), score.causes.end(), "saturation") != score.causes.end();
  bool limits = false, active = false;
  for (std::size_t b = 0; b < score.fit.machine.blocks.size(); ++b) {
    const MachineBlock& block = score.fit.machine.blocks[b];
    const auto& p = block.parameters;
    switch (block.law) {
      case MachineLaw::kPlay:
      case MachineLaw::kStickSlip:
      case MachineLaw::kLoop:
        if (p[0] < kNothing * input) return false;
        break;
      case MachineLaw::kDeadBand:
        if (p[1] < kNothing * input) return false;
        break;
      case MachineLaw::kUpperLimit:
      case MachineLaw::kLowerLimit:
        limits = true;
        active = active || is_reached(data, score.fit, b);
        break;
      case MachineLaw::kTanks:
        if (stops && !reaches_rim(data, score.fit, b)) return false;
        break;
      case MachineLaw::kCurve:
        if (std::abs(p[0]) < 0.02) return false;
        break;
      case MachineLaw::kRateLimit:
        // A step across the range that takes less than three samples is a matter of when the step came.
        if (p[0] * score.fit.machine.sample_period_s * 3 > input) return false;
        break;
      case MachineLaw::kLag:
        if (std::abs(std::log(p[1] / p[0])) < 0.05) return false;
        break;
      case MachineLaw::kSpring:
        if (-gain_seen(data, block.sections, block.feedback) < 1e-4) return false;
        break;
      case MachineLaw::kRestoringLoop:
        if (loop_width(data, block, ground.output_range()) < kNothing * input) return false;
        if (!has_memory(block, ground.output_range())) return false;
        break;
      case MachineLaw::kMotion:
        if (p[5] < kNothing * std::abs(p[0] + p[1]) * input) return false;
        break;
      case MachineLaw::kWarming:
        // A gain that rises is none that a coil loses as it warms.
        if (p[0] > -kGainChange) return false;
        break;
      case MachineLaw::kGainStep:
        if (std::abs(p[0]) < kGainChange) return false;
        break;
      case MachineLaw::kTone:
        if (std::hypot(p[0], p[1]) * std::sqrt(0.5) < 0.1 * score.fit.rms()) return false;
        break;
      default:
        break;
    }
  }
  return active || !limits;
}

Machine in_own_units(const MachineData& data, const MachineFit& fit) {
  Machine machine;
  machine.sample_period_s = data.period_s;
  machine.interval_means = data.interval_means;
  MachineBlock in, out;
  in.law = out.law = MachineLaw::kAffine;
  in.parameters = {1 / data.input_scale, -data.input_mean / data.input_scale};
  out.parameters = {data.output_scale, data.output_mean};
  machine.blocks.push_back(in);
  machine.blocks.insert(machine.blocks.end(), fit.machine.blocks.begin(), fit.machine.blocks.end());
  machine.blocks.push_back(out);
  return machine;
}

std::vector<Finding> residual_findings(const MachineData& data, const MachineScore& linear) {
  constexpr std::size_t kBins = 10;
  struct View {
    const char* what;
    std::function<double(const MachineRecord&, const std::vector<double>&, std::size_t)> of;
  };
  const std::vector<View> views{
      {"depends on the direction in which the input moves",
       [](const MachineRecord& r, const auto&, std::size_t t) {
         const double step = t > 0 ? r.input[t] - r.input[t - 1] : 0;
         return step > 0 ? 1.0 : (step < 0 ? -1.0 : 0.0);
       }},
      {"depends on the level of the simulated output",
       [](const MachineRecord&, const auto& y, std::size_t t) { return y[t]; }},
      {"depends on the level of the input",
       [](const MachineRecord& r, const auto&, std::size_t t) { return r.input[t]; }},
      {"depends on the time into the recording", [&](const MachineRecord& r, const auto&, std::size_t t) {
         return r.start_s + static_cast<double>(t) * data.period_s;
       }}};
  std::vector<double> residual;
  std::vector<std::vector<double>> seen(views.size());
  for (std::size_t r = 0; r < data.records.size(); ++r) {
    const auto y = run_record(data, r, linear.fit);
    for (const std::size_t t : data.records[r].valid) {
      residual.push_back(data.records[r].output[t] - y[t]);
      for (std::size_t v = 0; v < views.size(); ++v) seen[v].push_back(views[v].of(data.records[r], y, t));
    }
  }
  double mean = 0, power = 0, lagged = 0;
  for (const double e : residual) mean += e / static_cast<double>(residual.size());
  for (double& e : residual) e -= mean;
  for (std::size_t i = 0; i < residual.size(); ++i) {
    power += residual[i] * residual[i];
    if (i > 0) lagged += residual[i] * residual[i - 1];
  }
  // Samples that count: neighbours of a slow residual say the same thing.
  const double rho = std::clamp(lagged / std::max(power, 1e-300), 0.0, 0.999);
  const double effective = static_cast<double>(residual.size()) * (1 - rho) / (1 + rho);
  std::vector<Finding> findings;
  for (std::size_t v = 0; v < views.size(); ++v) {
    std::vector<double> sorted = seen[v];
    std::sort(sorted.begin(), sorted.end());
    std::vector<double> sums(kBins), counts(kBins);
    for (std::size_t i = 0; i < residual.size(); ++i) {
      const auto below = std::lower_bound(sorted.begin(), sorted.end(), seen[v][i]) - sorted.begin();
      const std::size_t bin = std::min(kBins - 1, static_cast<std::size_t>(below) * kBins / sorted.size());
      sums[bin] += residual[i];
      counts[bin] += 1;
    }
    double explained = 0, used = 0;
    for (std::size_t b = 0; b < kBins; ++b) {
      if (counts[b] == 0) continue;
      explained += sums[b] * sums[b] / counts[b];
      used += 1;
    }
    if (used < 2 || effective < used + 2 || power <= 0) continue;
    const double share = explained / power;
    const double statistic = share / (1 - std::min(share, 1 - 1e-12)) * (effective - used) / (used - 1);
    findings.push_back({views[v].what, "all recordings", statistic,
                        fisher_f_upper_tail(used - 1, effective - used, statistic), share});
  }
  std::stable_sort(findings.begin(), findings.end(), [](const Finding& a, const Finding& b) {
    return a.share_of_structured_residual > b.share_of_structured_residual;
  });
  return findings;
}

MachineTest next_machine_test(std::span<const Recording> recordings, const MachineGround& ground,
                              const std::vector<std::string>& separates) {
  constexpr double kFaster = 5;
  constexpr int kCycles = 3;
  const Recording& first = recordings.front();
  const auto [low, high] = std::minmax_element(first.input.values.begin(), first.input.values.end());
  const double duration = static_cast<double>(first.samples()) * first.sample_period_s;
  MachineTest planned;
  NextTest& test = planned.told;
  test.test = "triangle";
  test.separates = separates;
  const double period = ground.one_rate ? duration / kFaster : duration / (2 * kCycles);
  test.why = ground.one_rate
                 ? fmt::format(
                       "one sweep at one rate cannot tell a loop from a lag: the same triangle {} times as fast "
                       "widens the loop of a lag by that factor and leaves that of a memory alone",
                       kFaster)
                 : "reversals at several amplitudes show which memory or curve it is: play has flat tops, friction "
                   "jumps, a smooth loop has neither";
  const std::string name = first.input.name.empty() ? "u" : first.input.name;
  const double scale = first.input.file_unit_scale != 0 ? first.input.file_unit_scale : 1;
  test.input_csv = fmt::format("time_s,{}\n", name);
  const double middle = 0.5 * (*low + *high);
  constexpr int kPoints = 200;  // per cycle
  for (int i = 0; i <= kCycles * kPoints; ++i) {
    const double phase = static_cast<double>(i % kPoints) / kPoints;
    const double shape = phase < 0.25 ? 4 * phase : (phase < 0.75 ? 2 - 4 * phase : 4 * phase - 4);
    // Without rates to vary, the amplitude falls from cycle to cycle.
    const double amplitude = ground.one_rate ? 1 : std::pow(0.5, i / kPoints);
    const double u = middle + amplitude * 0.5 * (*high - *low) * shape;
    planned.time_s.push_back(period * i / kPoints);
    planned.input.push_back(u);
    test.input_csv += fmt::format("{:.6g},{:.6g}\n", planned.time_s.back(), u / scale);
  }
  return planned;
}

}  // namespace valvetriage
