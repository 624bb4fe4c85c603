#include "tests/unit/wire/schema_check.h"

#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <sstream>
#include <valijson/adapters/nlohmann_json_adapter.hpp>
#include <valijson/schema.hpp>
#include <valijson/schema_parser.hpp>
#include <valijson/validation_results.hpp>
#include <valijson/validator.hpp>

namespace valvetriage {
namespace {

using nlohmann::json;

/// The document behind a `$ref` to another schema of the folder.
const json* fetch(const std::string& uri) {
  return new json(json::parse(text_of(schema_folder() / std::filesystem::path(uri).filename())));
}

}  // namespace

std::filesystem::path schema_folder() {
  return std::filesystem::path(VALVETRIAGE_SOURCE_DIR) / "schemas";
}

std::string text_of(const std::filesystem::path& file) {
  std::ifstream stream(file, std::ios::binary);
  std::ostringstream text;
  text << stream.rdbuf();
  return text.str();
}

std::string schema_violations(const std::string& name, const std::string& json_text) {
  const json schema_document = json::parse(text_of(schema_folder() / (name + ".schema.json")));
  const json document = json::parse(json_text);
  valijson::Schema schema;
  valijson::SchemaParser parser;
  const valijson::adapters::NlohmannJsonAdapter schema_adapter(schema_document);
  parser.populateSchema(schema_adapter, schema, fetch, [](const json* fetched) { delete fetched; });
  valijson::ValidationResults results;
  const valijson::adapters::NlohmannJsonAdapter target(document);
  if (valijson::Validator().validate(schema, target, &results)) return {};
  std::string violations;
  for (valijson::ValidationResults::Error error; results.popError(error);) {
    for (const std::string& step : error.context) violations += step;
    violations += ": " + error.description + "\n";
  }
  return violations;
}

}  // namespace valvetriage
