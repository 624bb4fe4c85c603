#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>

#include "core/mechanisms/mechanism.h"

namespace valvetriage {
namespace {

std::string file(const std::string& path) {
  std::ifstream in(std::string(VALVETRIAGE_SOURCE_DIR) + "/" + path);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

std::string_view place_name(Place place) {
  switch (place) {
    case Place::kInput:
      return "acts on the input";
    case Place::kPosition:
      return "acts on the position";
    case Place::kSteady:
      return "acts on the steady output";
    case Place::kPhysics:
      return "acts inside the valve";
    case Place::kOutput:
      return "acts on the reading";
    case Place::kReading:
      return "acts on the reading, behind every other law";
  }
  return "";
}

std::string joined(std::span<const std::string_view> words) {
  std::string text;
  for (const std::string_view word : words) text += fmt::format("{}`{}`", text.empty() ? "" : ", ", word);
  return text;
}

std::string parameters_of(const Mechanism& law) {
  std::string text;
  for (const MechanismParameter& p : law.parameters) {
    text += fmt::format("{}`{}`{}: {}", text.empty() ? "" : "; ", p.name,
                        p.unit.empty() ? "" : fmt::format(" [{}]", p.unit), p.meaning);
  }
  return text.empty() ? "none" : text;
}

/// core/mechanisms/README.md as it must be.
std::string table_of_causes() {
  std::string text =
      "# Physical causes\n\n"
      "One file is one cause: `<cause>.cpp`, its name the cause's name; CMake makes the list of all of them from the "
      "names. This page is made from the code (`tests/unit/mechanisms/table_test.cpp` fails when it is stale and says "
      "how to write it). A new cause is\n\n"
      "- its file here: law, bounds, starts, source, and its place in the `order` of all;\n"
      "- its name in the two lists of `schemas` and in the contract's list of that test;\n"
      "- in `core/discrepancy/valve_catalogue.cpp` where it is looked for, if not from the file's own starts (a tone, "
      "an "
      "instant, a channel);\n"
      "- in `core/discrepancy/machine_trials.cpp` a trial, if it is to be found without a reference;\n"
      "- an effect of richer physics in `tests/stand`, so that the suites hide it.\n\n"
      "A law acts on the input, on the spool's position, on the steady output behind the static map, inside the "
      "valve's "
      "own blocks, or on the reading:\n\n"
      "```\n"
      "u -> [input] -> magnetic loop, delay, spool -> [position] -> map -> [steady output] -> volume -> [reading] -> "
      "y\n"
      "```\n";
  for (const Mechanism* law : all_mechanisms()) {
    text += fmt::format("\n## {}\n\n{}.\n\n", law->cause, law->wrong);
    text += fmt::format("- Family {}, origin {}, {}\n", law->family, law->origin, place_name(law->place));
    text += fmt::format("- Law: {}\n", law->law);
    text += fmt::format("- Parameters: {}\n", parameters_of(*law));
    text += fmt::format("- Looks like: {}\n", law->signature);
    text += fmt::format("- Confused with: {}\n", joined(law->confused_with));
    text += fmt::format("- Source: {}\n", law->source);
  }
  return text;
}

TEST(MechanismTable, IsTheContractsInItsOrder) {
  const std::vector<std::string> contract{"friction",
                                          "backlash",
                                          "hysteresis",
                                          "dead_band",
                                          "saturation",
                                          "gain_loss",
                                          "static_curve",
                                          "rectified_sensor",
                                          "transport_delay",
                                          "extra_lag",
                                          "resonance",
                                          "rate_limit",
                                          "asymmetric_response",
                                          "leakage",
                                          "orifice_flow",
                                          "stiffening_spring",
                                          "self_oscillation",
                                          "periodic_disturbance",
                                          "thermal_drift",
                                          "sensor_offset",
                                          "sensor_drift",
                                          "intermittent",
                                          "side_input"};
  std::vector<std::string> causes;
  for (const Mechanism* law : all_mechanisms()) causes.emplace_back(law->cause);
  EXPECT_EQ(causes, contract);
  EXPECT_EQ(find_mechanism("cosmic_rays"), nullptr);
}

TEST(MechanismTable, TheSchemasListTheSameCauses) {
  std::vector<std::string> causes;
  for (const Mechanism* law : all_mechanisms()) causes.emplace_back(law->cause);
  for (const char* name : {"schemas/analysis.schema.json", "schemas/model.schema.json"}) {
    const auto schema = nlohmann::json::parse(file(name));
    EXPECT_EQ(schema["definitions"]["cause"]["enum"].get<std::vector<std::string>>(), causes) << name;
  }
}

TEST(MechanismTable, EveryEntryIsWhole) {
  const std::set<std::string_view> families{"memory", "static", "timing", "flow", "disturbance", "slow"};
  const std::set<std::string_view> origins{"valve", "stand", "either"};
  int order = 0;
  for (const Mechanism* law : all_mechanisms()) {
    SCOPED_TRACE(law->cause);
    EXPECT_EQ(find_mechanism(law->cause), law);
    EXPECT_EQ(law->order, ++order);
    EXPECT_TRUE(families.contains(law->family));
    EXPECT_TRUE(origins.contains(law->origin));
    for (const std::string_view text : {law->wrong, law->law, law->source, law->signature}) EXPECT_FALSE(text.empty());
    EXPECT_FALSE(law->confused_with.empty());
    for (const std::string_view rival : law->confused_with) {
      EXPECT_NE(find_mechanism(rival), nullptr) << rival;
      EXPECT_NE(rival, law->cause);
    }
    EXPECT_EQ(law->place == Place::kPhysics, law->apply == nullptr);
    EXPECT_TRUE(law->place != Place::kPhysics || law->reshape != nullptr);
    EXPECT_TRUE(law->place != Place::kReading || law->tangent == nullptr) << "only what is added stands there";
    EXPECT_LE(law->size_parameter, law->parameters.size());
    ASSERT_NE(law->bounds, nullptr);
  }
}

TEST(MechanismTable, TheReadmeIsTheOneMadeFromTheCode) {
  const std::string made = table_of_causes();
  if (std::getenv("VALVETRIAGE_WRITE_TABLE") != nullptr) {
    std::ofstream(VALVETRIAGE_SOURCE_DIR "/core/mechanisms/README.md") << made;
  }
  EXPECT_EQ(file("core/mechanisms/README.md"), made)
      << "write it anew: VALVETRIAGE_WRITE_TABLE=1 build/ci/unit_mechanisms";
}

}  // namespace
}  // namespace valvetriage
