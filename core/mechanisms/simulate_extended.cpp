#include "core/mechanisms/simulate_extended.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "core/model/free_run.h"

namespace valvetriage {
namespace {

/// A law of the model with its parameters ready to use.
struct Law {
  const Mechanism* mechanism;
  std::vector<double> parameters;
};

/// What a recording has that an input alone has not.
struct Surroundings {
  std::span<const Channel> side;
  std::string_view recording;
};

Result<void> check_parameters(const Mechanism& law, const MechanismUse& use) {
  if (use.parameters.size() != law.parameters.size()) {
    return fail("bad_parameter", fmt::format("{} has {} parameters, {} were given", law.cause, law.parameters.size(),
                                             use.parameters.size()));
  }
  for (std::size_t j = 0; j < use.parameters.size(); ++j) {
    // Only a size may be infinite, for it may be its neutral value, and the lower level that there is none.
    const bool may = j == law.size_parameter || law.cause == "saturation";
    const double value = use.parameters[j];
    if (std::isnan(value) || (std::isinf(value) && !may)) {
      return fail("bad_parameter", fmt::format("{} of {} is not a finite number", law.parameters[j].name, law.cause));
    }
  }
  return {};
}

/// Index of the channel that a law names, put where the law reads it.
Result<void> find_channel(const MechanismUse& use, std::span<const Channel> side, Law& law) {
  if (use.cause != "side_input" || use.channel.empty()) return {};
  const auto found = std::find_if(side.begin(), side.end(), [&](const Channel& c) { return c.name == use.channel; });
  if (found == side.end()) {
    return fail("missing_channel", fmt::format("the model's side_input needs the channel '{}'", use.channel));
  }
  law.parameters.back() = static_cast<double>(found - side.begin());
  return {};
}

/// Whether a law that belongs to one recording is to act in this one, and then as index 0.
bool is_elsewhere(const MechanismUse& use, const Surroundings& around, Law& law) {
  if (use.cause != "intermittent") return false;
  law.parameters[2] = 0;
  return !use.channel.empty() && use.channel != around.recording;
}

Result<std::vector<Law>> laws_of(const Model& model, const Surroundings& around) {
  std::vector<Law> laws;
  for (const MechanismUse& use : model.mechanisms) {
    const Mechanism* mechanism = find_mechanism(use.cause);
    if (!mechanism) return fail("unknown_cause", fmt::format("there is no cause '{}'", use.cause));
    if (auto checked = check_parameters(*mechanism, use); !checked) return tl::unexpected(checked.error());
    Law law{mechanism, use.parameters};
    if (auto found = find_channel(use, around.side, law); !found) return tl::unexpected(found.error());
    if (!is_elsewhere(use, around, law)) laws.push_back(std::move(law));
  }
  return laws;
}

/// The model with its blocks changed by the laws inside the valve.
Result<Model> reshaped(Model model, std::span<const Law> laws) {
  for (const Law& law : laws) {
    const Mechanism& mechanism = *law.mechanism;
    if (!mechanism.reshape || (!model.map && mechanism.acts_in_blocks_alone(law.parameters))) continue;
    ValveDynamics spool{.delay_s = model.dynamics.delay_s};
    OrificeVolume volume = model.volume.value_or(OrificeVolume{});
    if (volume.highest_psi == 0 && model.map) volume.highest_psi = model.map->output.back();
    const OrificeVolume before = volume;
    SpoolFriction friction = model.friction.value_or(SpoolFriction{});
    if (model.map) friction.growth.middle_a = 0.5 * (model.map->input.front() + model.map->input.back());
    mechanism.reshape(law.parameters, {spool, volume, friction});
    if (friction.breakaway_a > 0) model.friction = friction;
    const bool needs_volume = mechanism.place == Place::kPhysics && !(volume == before);
    if (needs_volume && !model.volume) {
      return fail("needs_volume", fmt::format("{} acts on a fluid volume, and the model has none", mechanism.cause));
    }
    if (model.volume) model.volume = volume;
    model.dynamics.delay_s = spool.delay_s;
    for (const double lag_s : spool.lag_s) {
      model.dynamics.poles.emplace_back(-1 / lag_s);
      model.dynamics.gain /= lag_s;
    }
  }
  return model;
}

double range_of(std::span<const double> values) {
  if (values.empty()) return 0;
  const auto [low, high] = std::minmax_element(values.begin(), values.end());
  return *high - *low;
}

/// What every law of this run sees, wherever it acts.
LawContext common_context(const Model& model, const Surroundings& around) {
  LawContext context{.side = around.side};
  if (model.map) {
    const StaticMap& map = *model.map;
    const double span_a = map.input.back() - map.input.front();
    context.output_range = range_of(map.output);
    context.input_middle = 0.5 * (map.input.front() + map.input.back());
    context.rest_input = map.input.front();
    context.secant = (map.output.back() - map.output.front()) / span_a;
  }
  return context;
}

/// Where in a law's parameters its memory at the start of a recording stands.
std::optional<std::size_t> memory_at(const Law& law) {
  const auto& parameters = law.mechanism->parameters;
  const auto found =
      std::find_if(parameters.begin(), parameters.end(), [](const auto& p) { return p.name == "memory"; });
  if (found == parameters.end()) return std::nullopt;
  return static_cast<std::size_t>(found - parameters.begin());
}

LawMemories memories_of(std::span<const Law> laws) {
  LawMemories memories;
  for (const Law& law : laws) {
    if (const auto at = memory_at(law)) memories.push_back(law.parameters[*at]);
  }
  return memories;
}

std::vector<Law> with_memories(std::span<const Law> laws, const LawMemories& memories) {
  std::vector<Law> changed(laws.begin(), laws.end());
  auto memory = memories.begin();
  for (Law& law : changed) {
    if (const auto at = memory_at(law)) law.parameters[*at] = *memory++;
  }
  return changed;
}

void run_laws(std::span<const Law> laws, Place place, const LawContext& context, std::span<double> signal) {
  for (const Law& law : laws) {
    if (law.mechanism->place == place && law.mechanism->apply) {
      law.mechanism->apply(law.parameters, context, signal);
    }
  }
}

bool any_at(std::span<const Law> laws, Place place) {
  return std::any_of(laws.begin(), laws.end(), [&](const Law& law) { return law.mechanism->place == place; });
}

/// Those that act on signals of this model: in a valve, without the ones that act on its blocks alone.
std::vector<Law> signal_laws_of(const Model& model, std::vector<Law> laws) {
  std::erase_if(laws, [&](const Law& law) { return model.map && law.mechanism->acts_in_blocks_alone(law.parameters); });
  return laws;
}

/// An input between samples as the laws on it see it.
class LawInput {
 public:
  LawInput(const IntervalSignal& input, double sample_period_s)
      : signal_(interleaved(input)),
        driver_(interleaved_driver(input)),
        stamps_(interleaved_stamps(input.start.size(), sample_period_s)) {}

  IntervalSignal behind(std::span<const Law> laws, LawContext context, std::size_t samples) const {
    std::vector<double> signal(signal_.begin(), signal_.begin() + static_cast<std::ptrdiff_t>(2 * samples));
    context.time_s = std::span(stamps_).first(2 * samples);
    context.driver = std::span(driver_).first(2 * samples);
    run_laws(laws, Place::kInput, context, signal);
    return intervals(signal);
  }

 private:
  std::vector<double> signal_, driver_, stamps_;
};

Result<std::vector<double>> run(const Model& model, const IntervalSignal& input, double sample_period_s,
                                std::span<const double> measured, const InitialState& initial, Horizon horizon,
                                const Surroundings& around) {
  if (model.mechanisms.empty()) return simulate(model, input, sample_period_s, measured, initial, horizon);
  auto all = laws_of(model, around);
  if (!all) return tl::unexpected(all.error());
  const auto changed = reshaped(model, *all);
  if (!changed) return tl::unexpected(changed.error());
  const std::vector<Law> laws = signal_laws_of(model, std::move(*all));

  // Laws ahead of a volume see what goes on within a sample, those behind it what is read at the sample.
  const double inner_period_s = sample_period_s / static_cast<double>(runs_per_sample(*changed));
  const IntervalSignal inner_input = inner_intervals(*changed, input);
  LawContext context = common_context(model, around);
  const std::vector<double> inner_stamps = law_stamps(inner_input.start.size(), inner_period_s);
  context.time_s = inner_stamps;
  context.input = inner_input.start;
  const double gain = model.map ? 1 : static_gain(model.dynamics);
  if (!model.map) {
    const bool on_position = any_at(laws, Place::kPosition);
    if (on_position && (gain == 0 || !std::isfinite(gain))) {
      return fail("no_static_gain", "a law on the position needs a model with a static gain");
    }
    const auto bare = free_run(*changed, {}, inner_input, sample_period_s, measured, initial, horizon);
    if (!bare) return tl::unexpected(bare.error());
    context.output_range = range_of(*bare);
    context.rest_input = model.input_offset;
    context.secant = gain;
    context.input_middle = model.input_offset;
  }

  SignalLaws signal_laws{.memories = memories_of(laws)};
  if (any_at(laws, Place::kPosition)) {
    // The position of a linear model is its output over its static gain, about the operating point.
    const double offset = model.map ? 0 : model.input_offset;
    signal_laws.at_position = [&, gain, offset](const LawMemories& memories, std::span<double> x) {
      for (double& value : x) value = value / gain + offset;
      run_laws(with_memories(laws, memories), Place::kPosition, context, x);
      for (double& value : x) value = (value - offset) * gain;
    };
  }
  const bool at_steady = any_at(laws, Place::kSteady);
  if (at_steady && model.map) {
    signal_laws.at_steady = [&](std::span<double> m) { run_laws(laws, Place::kSteady, context, m); };
  }
  const std::vector<double> stamps = law_stamps(input.start.size(), sample_period_s);
  if (any_at(laws, Place::kOutput) || any_at(laws, Place::kReading) || (at_steady && !model.map)) {
    signal_laws.at_output = [&](std::span<const double> steady, std::span<double> y) {
      LawContext here = context;
      here.time_s = stamps;
      here.input = input.start;
      if (!model.map) run_laws(laws, Place::kSteady, here, y);
      here.steady = steady;
      run_laws(laws, Place::kOutput, here, y);
      run_laws(laws, Place::kReading, here, y);
    };
  }
  std::optional<LawInput> law_input;
  if (any_at(laws, Place::kInput)) {
    law_input.emplace(inner_input, inner_period_s);
    signal_laws.at_input = [&](const LawMemories& memories, std::size_t intervals) {
      return law_input->behind(with_memories(laws, memories), context, intervals);
    };
  }
  return free_run(*changed, signal_laws, inner_input, sample_period_s, measured, initial, horizon);
}

}  // namespace

Result<Model> with_reshaped_blocks(const Model& model) {
  std::vector<Law> laws;
  for (const MechanismUse& use : model.mechanisms) {
    const Mechanism* mechanism = find_mechanism(use.cause);
    if (!mechanism) return fail("unknown_cause", fmt::format("there is no cause '{}'", use.cause));
    if (auto checked = check_parameters(*mechanism, use); !checked) return tl::unexpected(checked.error());
    laws.push_back({mechanism, use.parameters});
  }
  return reshaped(model, laws);
}

Model with_channels_at(const std::function<double(std::string_view)>& value_of, Model model) {
  double offset = 0;
  std::erase_if(model.mechanisms, [&](const MechanismUse& use) {
    if (use.cause != "side_input") return false;
    offset += use.parameters[0] * (value_of(use.channel) - use.parameters[1]);
    return true;
  });
  // Behind every other law, as what it stands for.
  if (offset != 0) model.mechanisms.push_back({.cause = "sensor_offset", .parameters = {offset}, .channel = ""});
  return model;
}

std::vector<double> interleaved(const IntervalSignal& signal) {
  std::vector<double> both(2 * signal.start.size());
  for (std::size_t i = 0; i < signal.start.size(); ++i) {
    both[2 * i] = signal.start[i];
    both[2 * i + 1] = signal.end[i];
  }
  return both;
}

IntervalSignal intervals(std::span<const double> interleaved) {
  IntervalSignal signal{std::vector<double>(interleaved.size() / 2), std::vector<double>(interleaved.size() / 2)};
  for (std::size_t i = 0; i < signal.start.size(); ++i) {
    signal.start[i] = interleaved[2 * i];
    signal.end[i] = interleaved[2 * i + 1];
  }
  return signal;
}

std::vector<double> interleaved_driver(const IntervalSignal& signal) {
  const std::vector<double> gated = loop_driver(signal, loop_gate(signal));
  std::vector<double> driver(2 * gated.size());
  for (std::size_t i = 0; i < gated.size(); ++i) {
    driver[2 * i] = gated[i];
    const bool is_held = signal.end[i] == signal.start[i] || i + 1 == gated.size();
    driver[2 * i + 1] = is_held ? gated[i] : gated[i + 1];
  }
  return driver;
}

std::vector<double> law_stamps(std::size_t samples, double sample_period_s) {
  std::vector<double> stamps(samples);
  for (std::size_t i = 0; i < samples; ++i) stamps[i] = static_cast<double>(i) * sample_period_s;
  return stamps;
}

std::vector<double> interleaved_stamps(std::size_t samples, double sample_period_s) {
  std::vector<double> stamps(2 * samples);
  for (std::size_t i = 0; i < samples; ++i) {
    stamps[2 * i] = static_cast<double>(i) * sample_period_s;
    stamps[2 * i + 1] = static_cast<double>(i + 1) * sample_period_s;
  }
  return stamps;
}

Result<std::vector<double>> simulate_extended(const Model& model, const IntervalSignal& input, double sample_period_s,
                                              std::span<const double> measured, const InitialState& initial,
                                              Horizon horizon) {
  if (model.machine) return simulate(model, input, sample_period_s, measured, initial, horizon);
  return run(model, input, sample_period_s, measured, initial, horizon, {});
}

Result<std::vector<double>> simulate_extended(const Model& model, const Recording& recording,
                                              const InitialState& initial, Horizon horizon) {
  // A machine's chain holds its laws itself.
  if (model.machine) return simulate(model, recording, initial, horizon);
  return run(model, model_input(model, recording), recording.sample_period_s, first_outputs(recording, initial),
             initial, horizon, {.side = recording.side, .recording = recording.name});
}

}  // namespace valvetriage
