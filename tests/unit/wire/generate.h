#pragma once

#include <rapidcheck.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "core/analysis/analysis.h"
#include "core/mechanisms/mechanism.h"
#include "server/wire/json.h"
#include "server/wire/sha256.h"

namespace valvetriage::generate {

/// A document as it is read back once it was written.
inline Json through_text(const Json& document) {
  return parse_json(dump_json(document)).value();
}

inline double number() {
  return *rc::gen::suchThat(rc::gen::arbitrary<double>(), [](double x) { return std::isfinite(x); });
}
inline double positive() {
  return std::abs(number()) + 1e-3;
}
inline double share() {
  return *rc::gen::inRange(0, 1001) / 1000.0;
}
inline std::string hash() {
  return sha256_hex(std::to_string(*rc::gen::arbitrary<int>()));
}
inline int small(int least, int most) {
  return *rc::gen::inRange(least, most + 1);
}
inline std::string text() {
  return *rc::gen::container<std::string>(rc::gen::inRange(' ', '\x7f'));
}
inline std::optional<double> maybe_number() {
  return small(0, 1) ? std::optional<double>(number()) : std::nullopt;
}

inline std::vector<double> numbers(std::size_t n) {
  std::vector<double> values(n);
  std::generate(values.begin(), values.end(), number);
  return values;
}

/// Real roots and conjugate pairs, n of them or one fewer.
inline std::vector<std::complex<double>> roots(int n) {
  std::vector<std::complex<double>> values;
  while (static_cast<int>(values.size()) + 1 < n) {
    const std::complex<double> root(number(), number());
    values.push_back(root);
    values.push_back(std::conj(root));
  }
  if (small(0, 1) && static_cast<int>(values.size()) < n) values.emplace_back(number(), 0.0);
  return values;
}

inline TransferFunction transfer_function() {
  TransferFunction g;
  g.domain = small(0, 1) ? Domain::kS : Domain::kZ;
  g.sample_time_s = g.domain == Domain::kZ ? positive() : 0;
  g.poles = roots(small(0, 8));
  g.zeros = g.poles;
  g.gain = number();
  g.delay_s = g.domain == Domain::kZ ? small(0, 20) * g.sample_time_s : positive();
  return g;
}

inline StaticMap static_map() {
  StaticMap map;
  const int knots = small(2, 12);
  double input = small(-5, 5), output = small(-5, 5);
  for (int i = 0; i < knots; ++i) {
    map.input.push_back(input += small(1, 5) * 0.1);
    map.output.push_back(output += small(0, 5) * 0.1);
  }
  return map;
}

inline Model model(bool with_map) {
  Model m;
  m.kind = with_map ? "valve" : "linear";
  m.input_unit = with_map ? "A" : "";
  m.output_unit = with_map ? "psi" : "";
  if (with_map) {
    m.map = static_map();
    m.loop = MagneticLoop{.width_a = positive()};
    if (small(0, 1)) m.loop->reach = positive();
    const double reference = positive();
    m.volume = OrificeVolume{positive(), positive(), reference + positive(), reference};
  }
  m.dynamics = transfer_function();
  m.input_offset = number();
  m.output_offset = number();
  if (small(0, 1)) m.input_between = InputBetween::kHeld;
  for (const Mechanism* law : all_mechanisms()) {
    if (small(0, 9) > 0) continue;
    const auto parameters = law->as_written(numbers(law->parameters.size()), m.volume);
    m.mechanisms.push_back({std::string(law->cause), parameters, small(0, 1) ? text() : ""});
  }
  return m;
}

inline Machine machine() {
  Machine m{.sample_period_s = positive(), .interval_means = small(0, 1) == 1, .blocks = {}};
  MachineBlock linear;
  linear.sections = {{.order = 2, .e = 0.5, .f = 0.25}, {.order = 1, .f = share() + 0.1}};
  linear.numerator = {number(), number(), number(), number()};
  linear.delay_samples = small(0, 9);
  MachineBlock limit;
  limit.law = MachineLaw::kUpperLimit;
  limit.parameters = {number(), positive()};
  MachineBlock side;
  side.law = MachineLaw::kSide;
  side.parameters = {number(), number()};
  side.channel = text();
  m.blocks = {linear, limit, side};
  return m;
}

inline Reference plain_reference() {
  Reference r;
  r.valve_type = "type-" + text();
  r.version = small(0, 9);
  r.sha256 = hash();
  for (int i = small(3, 6); i > 0; --i)
    r.members.push_back({text(), small(1, 9), positive(), positive(), small(0, 1) == 1});
  r.valves = static_cast<int>(r.members.size());
  r.sample_period_s = positive();
  r.model = model(true);
  const std::size_t knots = r.model.map->input.size();
  r.map_sd.assign(knots, positive());
  for (int i = small(1, 4); i > 0; --i) {
    r.parameters.push_back({"p" + text(), text(), small(0, 1) ? "log" : "linear", number(), positive()});
  }
  const std::size_t p = r.parameters.size() + knots;
  r.covariance = numbers(p * p);
  r.prior_degrees_of_freedom = positive();
  r.noise_floor = positive();
  r.input_min = number();
  r.input_max = number();
  r.bandwidth_hz = positive();
  r.tests = {"step", "sweep"};
  r.window = {positive(), positive()};
  for (int i = small(0, 5); i > 0; --i) {
    r.levels.push_back({number(), positive(), positive(), number(), positive(), positive(), positive()});
  }
  return r;
}

inline Reference reference() {
  Reference r = plain_reference();
  if (small(0, 1)) {
    OnKnownTests known{.tests = {}, .reference = plain_reference()};
    // Neither is written where it stands inside another one.
    known.reference.version = 0;
    known.reference.sha256.clear();
    for (int i = small(1, 3); i > 0; --i) {
      const auto samples = static_cast<std::size_t>(small(1, 5));
      known.tests.push_back({positive(), numbers(samples), numbers(samples)});
    }
    r.on_known_tests.push_back(std::move(known));
  }
  return r;
}

inline LevelVerdict level_verdict(int i) {
  LevelVerdict level;
  level.level = "level " + std::to_string(i);
  level.verdict = "Good";
  level.memberships = {{"good", share()}, {"severe", share()}};
  level.rules = {{text(), share()}, {text(), share()}};
  return level;
}

inline ClassificationResult classification() {
  ClassificationResult c;
  if (small(0, 1)) {
    c.verdict = "Severe";
    c.memberships = {{"good", share()}, {"malfunctioned", share()}, {"severe", share()}};
    for (int i = small(0, 3); i > 0; --i) c.per_level.push_back(level_verdict(i));
    c.rule_base_name = "from " + text();
    c.rule_base_version = text();
    c.rule_base_sha256 = hash();
  } else {
    c.reason = NoVerdict::kLevelMissing;
  }
  c.explanation = text();
  c.action = small(0, 1) ? "retest" : "engineer";
  return c;
}

inline ParameterEstimate parameter_estimate() {
  ParameterEstimate p{.value = number(), .std_error = positive(), .ci95 = {number(), number()}, .unit = "A"};
  if (small(0, 1)) p.population_mean = p.population_sd = std::nan("");
  if (small(0, 3) == 0) {
    p.text = "temperature_C";
    p.value = 0;
  }
  return p;
}

inline NamedCause named_cause() {
  return {.cause = "friction",
          .family = "memory",
          .origin = "valve",
          .probability = share(),
          .family_probability = share(),
          .alternatives = {"backlash"},
          .parameters = {{"breakaway_A", parameter_estimate()}, {"kinetic_A", parameter_estimate()}},
          .severity_in_population_sd = small(0, 1) ? positive() : std::nan(""),
          .error_eq20_caused = {{"1.4", number()}},
          .rmse_before = positive(),
          .rmse_after = positive(),
          .p_value = share(),
          .evidence = {text(), text()}};
}

inline Discrepancy discrepancy() {
  Discrepancy d;
  d.conclusion = static_cast<Conclusion>(small(0, 3));
  for (int i = small(0, 3); i > 0; --i) d.findings.push_back({text(), text(), number(), share(), share()});
  for (int i = small(0, 2); i > 0; --i) d.causes.push_back(named_cause());
  for (int i = small(0, 3); i > 0; --i) {
    d.candidates.push_back({"friction+leakage",
                            share(),
                            positive(),
                            static_cast<CandidateStatus>(small(0, 2)),
                            text(),
                            {{"width_A", positive()}}});
  }
  d.gain = {text(), positive(), positive(), std::nan(""), positive(), share(), {share(), share()}, {}};
  if (small(0, 1)) d.gain.transfer.push_back({"step", "sweep", positive(), positive()});
  if (small(0, 1)) d.next_test = NextTest{"triangle", text(), {"hysteresis", "friction"}, share(), "time_s,current_A"};
  return d;
}

inline Analysis analysis() {
  Analysis a;
  for (int i = small(1, 4); i > 0; --i) {
    RecordingSummary r;
    r.name = text();
    r.sha256 = hash();
    r.samples = static_cast<std::size_t>(small(1, 1000000));
    r.sample_rate_hz = positive();
    r.test = TestKind::kStaircase;
    r.quality.push_back({"clipped", text(), static_cast<std::size_t>(small(0, 100))});
    a.recordings.push_back(r);
    a.simulation.per_recording.push_back({r.name, number(), number(), number()});
  }
  a.baseline.kind = small(0, 1) ? BaselineKind::kReference : BaselineKind::kSelf;
  a.baseline.reason = text();
  a.baseline.model = model(small(0, 1) == 1);
  if (a.baseline.kind == BaselineKind::kReference) {
    a.baseline.reference = reference();
    a.baseline.on_known_tests = !a.baseline.reference->on_known_tests.empty();
  }
  a.simulation.rmse = number();
  a.simulation.fit_percent = number();
  a.simulation.noise_floor = number();
  for (int i = small(0, 5); i > 0; --i) {
    a.simulation.by_level.push_back({number(), maybe_number(), maybe_number(), maybe_number()});
  }
  a.classification = classification();
  if (small(0, 1)) a.discrepancy = discrepancy();
  a.extended_model = model(small(0, 1) == 1);
  if (small(0, 2) == 0) {
    a.extended_model = model(false);
    a.extended_model.kind = "machine";
    a.extended_model.machine = machine();
  }
  return a;
}

}  // namespace valvetriage::generate
