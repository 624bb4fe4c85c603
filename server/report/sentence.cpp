#include "server/report/sentence.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <set>
#include <utility>

#include "core/discrepancy/advise.h"
#include "core/mechanisms/mechanism.h"

namespace valvetriage::report {
namespace {

std::string capitalised(std::string text) {
  if (!text.empty()) text[0] = static_cast<char>(std::toupper(static_cast<unsigned char>(text[0])));
  return text;
}

/// "a", "a or b", "a, b or c".
std::string either(const std::vector<std::string>& words) {
  std::string text;
  for (std::size_t i = 0; i < words.size(); ++i) {
    if (i > 0) text += i + 1 == words.size() ? " or " : ", ";
    text += words[i];
  }
  return text;
}

std::string lower_spoken(std::string cause) {
  std::replace(cause.begin(), cause.end(), '_', ' ');
  for (std::size_t at = 0; (at = cause.find('+', at)) != std::string::npos; at += 3) cause.replace(at, 1, " + ");
  return cause;
}

/// The unit a person would use, and how many of it one of the contract's is.
struct Scale {
  double factor = 1;
  std::string unit;
};
Scale scale_for(double size, const std::string& unit) {
  const bool small = size != 0 && std::abs(size) < 0.1;
  if (small && (unit == "A" || unit == "s" || unit == "A/s")) return {1000, "m" + unit};
  return {1, unit};
}

std::string in_unit(const std::string& number, const Scale& scale) {
  return scale.unit.empty() ? number : number + " " + scale.unit;
}

std::string three_digits(double value) {
  const bool thousands = std::abs(value) >= 1000 && std::abs(value) < 1e6;
  return thousands ? fmt::format("{:.0f}", value) : fmt::format("{:.3g}", value);
}

/// As far as two digits of its uncertainty tell; three digits where it has none, or where that takes a power of ten.
std::string as_told(double value, double uncertainty) {
  if (!std::isfinite(value)) return "unknown";
  constexpr double kLeast = 1e-5, kMost = 1e6;
  const bool is_plain = uncertainty >= kLeast && uncertainty < kMost && std::abs(value) < kMost;
  if (!is_plain) return three_digits(value);
  const std::string text =
      fmt::format("{:.{}f}", value, std::max(0, 1 - static_cast<int>(std::floor(std::log10(uncertainty)))));
  return text.find_first_not_of("-0.") == std::string::npos && text.front() == '-' ? text.substr(1) : text;
}

/// Of a parameter "breakaway_A": its name without the unit that follows with the number, "breakaway".
std::string parameter_name(const std::string& name, const std::string& unit) {
  const std::string suffix = "_" + unit;
  std::string shown = !unit.empty() && name.ends_with(suffix) ? name.substr(0, name.size() - suffix.size()) : name;
  if (shown == name) {
    for (const char* ending : {"_A_per_s", "_psi_per_s", "_per_A", "_psi", "_hz", "_A", "_s"}) {
      if (!shown.ends_with(ending)) continue;
      shown.resize(shown.size() - std::string_view(ending).size());
      break;
    }
  }
  std::replace(shown.begin(), shown.end(), '_', ' ');
  return shown;
}

std::string verdict_sentence(const ClassificationResult& result) {
  constexpr std::array<std::pair<const char*, const char*>, 4> kActions{
      {{"accept", "Accept the valve."},
       {"reject", "Reject the valve."},
       {"retest", "Test the valve again."},
       {"engineer", "An engineer should look at it."}}};
  std::string text = result.verdict ? *result.verdict : "No verdict";
  if (!result.explanation.empty()) text += ": " + result.explanation;
  if (!text.ends_with('.')) text += '.';
  if (result.without_stand_causes && result.without_stand_causes != result.verdict) {
    text += fmt::format(" Without what is the stand's fault it would be {}.", *result.without_stand_causes);
  }
  for (const auto& [action, sentence] : kActions) {
    if (result.action == action) text += fmt::format(" {}", sentence);
  }
  return text;
}

std::string parameter_words(const std::string& name, const ParameterEstimate& estimate,
                            const std::vector<RecordingSummary>& recordings) {
  const std::string words = value_words(name, estimate, recordings);
  const std::string shown = parameter_name(name, estimate.unit);
  if (name == "recording") return words.empty() ? "" : "in " + words;
  if (!words.empty()) return estimate.text.empty() ? words : shown + " " + words;
  const auto [value, error, interval] = estimate_words(estimate);
  return interval.empty() ? fmt::format("{} {}", shown, value)
                          : fmt::format("{} {} (95 %: {})", shown, value, interval);
}

/// What every recording has its own of, where a loop begins or the phase of a tone, says nothing about the valve.
std::string parameters_words(const NamedCause& cause, const std::vector<RecordingSummary>& recordings) {
  const Mechanism* law = find_mechanism(cause.cause);
  const auto own = law ? law->parameters.last(law->own_per_recording) : std::span<const MechanismParameter>{};
  std::string words;
  for (const auto& [name, estimate] : cause.parameters) {
    const auto is_this = [&name = name](const MechanismParameter& parameter) { return parameter.name == name; };
    if (std::any_of(own.begin(), own.end(), is_this)) continue;
    const std::string said = parameter_words(name, estimate, recordings);
    if (!said.empty()) words += (words.empty() ? "" : "; ") + said;
  }
  return words;
}

std::string cause_sentence(const NamedCause& cause, const std::vector<RecordingSummary>& recordings) {
  std::string text = spoken(cause.cause);
  if (const Mechanism* law = find_mechanism(cause.cause)) text += fmt::format(": {}", law->wrong);
  if (!text.ends_with('.')) text += '.';
  if (std::isfinite(cause.probability)) text += fmt::format(" Probability {}.", percent(cause.probability));
  if (!cause.alternatives.empty()) {
    std::vector<std::string> rivals;
    for (const std::string& rival : cause.alternatives) rivals.push_back(lower_spoken(rival));
    text += fmt::format(" The recordings do not tell it from {}.", either(rivals));
  }
  const std::string parameters = parameters_words(cause, recordings);
  return parameters.empty() ? text : text + " " + capitalised(parameters) + ".";
}

/// What is left is told as noise up to this many times the noise floor, which is that of white noise.
constexpr double kDownToNoise = 1.5;

/// "1.99 psi where the noise is 0.31 psi"; empty where that is the noise, or not known.
std::string above_noise(double rmse, double noise, const std::string& unit) {
  if (!(rmse > kDownToNoise * noise)) return {};
  return fmt::format("{} where the noise is {}", quantity(rmse, unit), quantity(noise, unit));
}

/// No known cause, of recordings without good valves to compare them with.
std::string nothing_found(const Analysis& analysis) {
  const DiscrepancyGain& gain = analysis.discrepancy->gain;
  const std::string left = above_noise(gain.rmse_baseline, gain.noise_floor, analysis.baseline.model.output_unit);
  if (!left.empty()) {
    return fmt::format(
        "No known cause was found that makes a linear model of these recordings better. It leaves {}; what that is, "
        "the recordings do not tell.",
        left);
  }
  if (!std::isfinite(gain.rmse_baseline) || !std::isfinite(gain.noise_floor)) return "No known cause was found.";
  return "A linear model of these recordings follows them down to the noise: nothing is left to explain.";
}

/// Nothing beside what good valves leave. Where the steps are judged not good all the same, that is no contradiction: a
/// verdict is against the mean good valve, a cause against all that good valves do.
std::string nothing_left(const Analysis& analysis) {
  if (analysis.baseline.kind != BaselineKind::kReference) return nothing_found(analysis);
  const std::optional<std::string>& verdict = analysis.classification.verdict;
  const Simulation& simulation = analysis.simulation;
  const std::string left = above_noise(simulation.rmse, simulation.noise_floor, analysis.baseline.model.output_unit);
  if (!verdict || *verdict == "Good") {
    return fmt::format("The simulation leaves nothing that a good valve on this stand would not leave{}{}.",
                       left.empty() ? "" : ": ", left);
  }
  return fmt::format(
      "No single fault stands out: with every parameter as good valves have it, the simulation {}. The verdict {} "
      "rests on the steps, which lie too far from those of the mean good valve.",
      left.empty() ? "follows these recordings down to the noise" : "leaves no more than of good valves, " + left,
      *verdict);
}

/// What is listed with a conclusion that names nothing.
std::string no_answer(const Discrepancy& discrepancy) {
  if (discrepancy.causes.empty()) return {};
  return " What comes closest is listed, and is not the answer.";
}

/// What is seen of a fault that has no name.
std::string unexplained_but(const Finding& seen, const Discrepancy& discrepancy) {
  return fmt::format(
      "Something is wrong that no known cause explains: {}. It is not known why; do not read a cause into this "
      "result.{}",
      seen.what, no_answer(discrepancy));
}

std::string discrepancy_sentence(const Analysis& analysis) {
  const Discrepancy& discrepancy = *analysis.discrepancy;
  std::vector<std::string> names;
  bool rivals = false;
  for (const NamedCause& cause : discrepancy.causes) {
    // The one cause whose name is no thing that can be lacked.
    names.push_back(cause.cause == "intermittent" ? "an abrupt change of gain" : lower_spoken(cause.cause));
    rivals |= !cause.alternatives.empty();
  }
  switch (discrepancy.conclusion) {
    case Conclusion::kNone:
      return nothing_left(analysis);
    case Conclusion::kNamed:
      return fmt::format("The simulation is wrong because it lacks {}.", fmt::join(names, " and "));
    case Conclusion::kAmbiguous:
      return "Something is wrong, but these recordings do not settle what: " +
             std::string(rivals ? "more than one cause explains them." : "no cause stands out clearly enough.");
    case Conclusion::kUnexplained:
      if (const Finding* slip = discrepancy.slip()) {
        return fmt::format("These recordings allow no cause to be named: {}.", slip->what);
      }
      if (const Finding* own = discrepancy.taken_up()) {
        if (discrepancy.causes.empty()) {
          return fmt::format(
              "Something is wrong that the simulation follows only with parameters that no good valve has: {}. It is "
              "not known what makes them so; do not read a cause into this result.",
              own->what);
        }
        return unexplained_but(*own, discrepancy);
      }
      if (const Finding* change = discrepancy.unnamed_change()) return unexplained_but(*change, discrepancy);
      return "Something is wrong that no known cause explains. It is not known what; do not read a cause into this "
             "result." +
             no_answer(discrepancy);
  }
  return {};
}

/// Whose fault it can be where the causes that are left are known but not which of them it is.
std::string fault_of_rivals(const std::vector<NamedCause>& causes) {
  std::set<std::string> origins;
  for (const NamedCause& cause : causes) {
    if (cause.alternatives.empty()) return {};
    origins.insert(cause.origin);
    for (const std::string& rival : cause.alternatives) {
      const Mechanism* law = find_mechanism(rival);
      origins.insert(law ? std::string(law->origin) : "either");
    }
  }
  if (origins == std::set<std::string>{"valve"}) return "Each cause that is left would be the valve's fault.";
  if (origins == std::set<std::string>{"stand"}) return "Each cause that is left would be the stand's fault.";
  return origins.empty() ? "" : "Whether it is the valve's fault or the stand's is not settled either.";
}

std::string fault_sentence(const Discrepancy& discrepancy) {
  if (discrepancy.conclusion == Conclusion::kAmbiguous) return fault_of_rivals(discrepancy.causes);
  if (discrepancy.conclusion != Conclusion::kNamed) return {};
  std::set<std::string> origins;
  for (const NamedCause& cause : discrepancy.causes) origins.insert(cause.origin);
  if (origins == std::set<std::string>{"valve"}) return "It is the valve's fault.";
  if (origins == std::set<std::string>{"stand"}) return "It is the stand's fault, not the valve's.";
  if (origins.contains("either")) return "It can be the valve's fault or the stand's.";
  return origins.empty() ? "" : "Partly it is the valve's fault, partly the stand's.";
}

/// A cause beside a verdict that knows of none.
std::string beside_good_steps(const Discrepancy& discrepancy, const std::optional<std::string>& verdict) {
  if (verdict != "Good" || discrepancy.conclusion == Conclusion::kNone || discrepancy.slip()) return {};
  return "The verdict Good stands beside it: the steps that it rests on are as near to those of the mean good valve as "
         "a good valve's.";
}

std::string gain_sentence(const Discrepancy& discrepancy, const std::string& unit) {
  const DiscrepancyGain& gain = discrepancy.gain;
  if (discrepancy.causes.empty() || !std::isfinite(gain.rmse_extended)) return {};
  std::string text = fmt::format("On data it was not fitted to ({}), the simulation's error goes from {} to {}",
                                 gain.heldout, quantity(gain.rmse_baseline, unit), quantity(gain.rmse_extended, unit));
  if (std::isfinite(gain.noise_floor)) text += fmt::format("; noise alone is {}", quantity(gain.noise_floor, unit));
  return text + ".";
}

std::string next_test_sentence(const Analysis& analysis) {
  const Discrepancy& discrepancy = *analysis.discrepancy;
  if (!discrepancy.next_test) {
    if (discrepancy.conclusion != Conclusion::kAmbiguous) return {};
    if (analysis.baseline.on_known_tests) {
      return "No test is asked for: of other tests than these it is not known what good valves leave.";
    }
    return "No test that is known here is expected to settle it.";
  }
  const NextTest& test = *discrepancy.next_test;
  std::string text = fmt::format("Next test: {}.", test.test);
  if (!test.why.empty()) text += fmt::format(" {}", capitalised(test.why));
  if (!text.ends_with('.')) text += '.';
  if (test.expected_probability < kWorthAsking) {
    text += " It is not expected to settle the cause, but to leave fewer rivals.";
  } else if (std::isfinite(test.expected_probability)) {
    text += fmt::format(" It is expected to settle the cause with a probability of {}.",
                        percent(test.expected_probability));
  }
  return text;
}

std::vector<std::string> upper_limits(const Discrepancy& discrepancy) {
  std::vector<std::string> limits;
  for (const Candidate& candidate : discrepancy.candidates) {
    const Mechanism* law = find_mechanism(candidate.cause);
    for (const auto& [name, limit] : candidate.upper_limit95) {
      if (!std::isfinite(limit)) continue;
      std::string unit;
      for (const MechanismParameter& parameter : law ? law->parameters : std::span<const MechanismParameter>{}) {
        if (parameter.name == name) unit = parameter.unit;
      }
      // A limit excludes what lies beyond it, seen from no effect.
      const char* beyond = law && limit < law->neutral ? "below" : "above";
      limits.push_back(fmt::format("{} with {} {} {} is excluded", spoken(candidate.cause), parameter_name(name, unit),
                                   beyond, quantity(limit, unit)));
    }
  }
  return limits;
}

}  // namespace

std::string spoken(const std::string& cause) {
  return capitalised(lower_spoken(cause));
}

std::string quantity(double value, const std::string& unit) {
  if (!std::isfinite(value)) return "unknown";
  const Scale scale = scale_for(value, unit);
  return in_unit(three_digits(value * scale.factor), scale);
}

EstimateWords estimate_words(const ParameterEstimate& estimate) {
  const auto [low, high] = estimate.ci95;
  const Scale scale =
      scale_for(estimate.value != 0 ? estimate.value : std::max(std::abs(low), std::abs(high)), estimate.unit);
  const auto told = [&](double number) { return as_told(number * scale.factor, estimate.std_error * scale.factor); };
  EstimateWords words{in_unit(told(estimate.value), scale), in_unit(told(estimate.std_error), scale), {}};
  if (std::isfinite(low) && std::isfinite(high)) {
    words.interval = fmt::format("{} to {}", told(low), in_unit(told(high), scale));
  }
  return words;
}

std::string with_deviation(double mean, double sd, const std::string& unit) {
  const Scale scale = scale_for(std::max(std::abs(mean), sd), unit);
  return fmt::format("{} ± {}", as_told(mean * scale.factor, sd * scale.factor),
                     in_unit(as_told(sd * scale.factor, sd * scale.factor), scale));
}

std::string value_words(const std::string& parameter, const ParameterEstimate& estimate,
                        const std::vector<RecordingSummary>& recordings) {
  if (!estimate.text.empty()) return estimate.text;
  if (parameter == "ahead_of_map") {
    return estimate.value != 0 ? "ahead of the static map: coil or spool" : "behind the static map: pressure or gauge";
  }
  if (parameter == "spool_stops") {
    return estimate.value != 0 ? "the spool comes to a stop" : "a relief, or the reading is clipped";
  }
  if (parameter != "recording") return {};
  const auto at = static_cast<std::size_t>(std::max(0.0, std::round(estimate.value)));
  return at < recordings.size() ? recordings[at].name : std::string{};
}

std::string figure(double value) {
  if (!std::isfinite(value)) return "–";
  if (value == 0) return "0";
  const double size = std::abs(value);
  if (size >= 1e6 || size < 1e-4) return fmt::format("{:.2e}", value);
  // Of the rounded number: 9.999 has one digit before the point more.
  const std::string rounded = fmt::format("{:.2e}", size);
  const int exponent = std::stoi(rounded.substr(rounded.find('e') + 1));
  return fmt::format("{:.{}f}", value, std::max(0, 2 - exponent));
}

std::string percent(double probability) {
  if (!std::isfinite(probability)) return "unknown";
  if (probability > 0.99) return "over 99 %";
  if (probability < 0.01) return "under 1 %";
  return fmt::format("{:.0f} %", 100 * probability);
}

Summary summarise(const Analysis& analysis) {
  Summary summary{.verdict = verdict_sentence(analysis.classification)};
  if (!analysis.discrepancy) {
    summary.discrepancy = "What the simulation gets wrong was not looked for.";
    return summary;
  }
  const Discrepancy& discrepancy = *analysis.discrepancy;
  summary.discrepancy = discrepancy_sentence(analysis);
  for (const NamedCause& cause : discrepancy.causes)
    summary.causes.push_back(cause_sentence(cause, analysis.recordings));
  summary.fault = fault_sentence(discrepancy);
  const std::string beside = beside_good_steps(discrepancy, analysis.classification.verdict);
  if (!beside.empty()) summary.fault += (summary.fault.empty() ? "" : " ") + beside;
  summary.gain = gain_sentence(discrepancy, analysis.baseline.model.output_unit);
  summary.upper_limits = upper_limits(discrepancy);
  summary.next_test = next_test_sentence(analysis);
  return summary;
}

std::string counted(std::size_t count, const char* singular) {
  return fmt::format("{} {}{}", count, singular, count == 1 ? "" : "s");
}

}  // namespace valvetriage::report
