#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <set>

#include "server/wire/analysis_json.h"
#include "server/wire/model_json.h"
#include "server/wire/reference_json.h"
#include "server/wire/rule_base_json.h"
#include "tests/unit/wire/generate.h"
#include "tests/unit/wire/schema_check.h"

namespace valvetriage {
namespace {

/// An example is named <schema>_<what>.json; a schema's own name may hold underscores.
std::string schema_of(const std::filesystem::path& example, const std::set<std::string>& schemas) {
  const std::string stem = example.stem().string();
  for (std::size_t cut = stem.rfind('_'); cut != std::string::npos && cut > 0; cut = stem.rfind('_', cut - 1)) {
    if (schemas.contains(stem.substr(0, cut))) return stem.substr(0, cut);
  }
  return {};
}

std::set<std::string> schema_names() {
  constexpr std::string_view kEnding = ".schema.json";
  std::set<std::string> names;
  for (const auto& entry : std::filesystem::directory_iterator(schema_folder())) {
    const std::string file = entry.path().filename().string();
    if (file.ends_with(kEnding)) names.insert(file.substr(0, file.size() - kEnding.size()));
  }
  return names;
}

/// Runs `check(schema, text, example)` over a folder of examples and tells which schemas it met.
template <typename Check>
std::set<std::string> for_each_example(const std::string& folder, Check check) {
  const std::set<std::string> schemas = schema_names();
  std::set<std::string> met;
  for (const auto& entry : std::filesystem::directory_iterator(schema_folder() / "examples" / folder)) {
    const std::string schema = schema_of(entry.path(), schemas);
    EXPECT_FALSE(schema.empty()) << entry.path().filename() << " is named after no schema";
    if (schema.empty()) continue;
    check(schema, text_of(entry.path()), entry.path().filename().string());
    met.insert(schema);
  }
  return met;
}

TEST(Schemas, AcceptEveryValidExampleAndEverySchemaHasOne) {
  const auto met = for_each_example("valid", [](const auto& schema, const auto& text, const auto& example) {
    EXPECT_EQ(schema_violations(schema, text), "") << example;
  });
  EXPECT_EQ(met, schema_names());
}

TEST(Schemas, RefuseEveryInvalidExampleAndEverySchemaHasOne) {
  const auto met = for_each_example("invalid", [](const auto& schema, const auto& text, const auto& example) {
    EXPECT_NE(schema_violations(schema, text), "") << example;
  });
  EXPECT_EQ(met, schema_names());
}

/// Whether the product reads a document, where it reads that kind at all.
std::optional<bool> is_read(const std::string& schema, const Json& document) {
  if (schema == "model" || schema == "identify") return model_from_json(document).has_value();
  if (schema == "reference") return reference_from_json(document).has_value();
  if (schema == "rule_base") return rule_base_from_json(dump_json(document)).has_value();
  if (schema == "analysis") return analysis_from_json(document).has_value();
  return std::nullopt;
}

TEST(Schemas, AgreeWithTheReadersOnTheExamples) {
  for_each_example("valid", [](const auto& schema, const auto& text, const auto& example) {
    EXPECT_TRUE(is_read(schema, parse_json(text).value()).value_or(true)) << example;
  });
  for_each_example("invalid", [](const auto& schema, const auto& text, const auto& example) {
    // The readers take only the transfer function of one, and nothing of the discrepancy of the other.
    if (schema == "identify" || example == "analysis_unknown_cause.json") return;
    EXPECT_FALSE(is_read(schema, parse_json(text).value()).value_or(false)) << example;
  });
}

RC_GTEST_PROP(Schemas, AcceptEveryModelThatIsWritten, ()) {
  RC_ASSERT(schema_violations("model", dump_json(to_json(generate::model(generate::small(0, 1) == 1)))) == "");
}

RC_GTEST_PROP(Schemas, AcceptEveryReferenceThatIsWritten, ()) {
  RC_ASSERT(schema_violations("reference", dump_json(to_json(generate::reference()))) == "");
}

RC_GTEST_PROP(Schemas, AcceptEveryAnalysisThatIsWritten, ()) {
  const AnalysisMaking making{
      .engine_version = "0.1.0", .settings_sha256 = generate::hash(), .timing_s = {{"total", 1}}};
  RC_ASSERT(schema_violations("analysis", dump_json(to_json(generate::analysis(), making))) == "");
}

}  // namespace
}  // namespace valvetriage
