#include <gtest/gtest.h>

#include <set>
#include <sstream>

#include "server/http/routes.h"
#include "tests/contract/http_fixture.h"
#include "tests/contract/json_schema.h"

namespace valvetriage {
namespace {

Json resolve(const Json& document, const Json& value) {
  if (!value.is_object() || !value.contains("$ref")) return value;
  return document.at(Json::json_pointer(value["$ref"].get<std::string>().substr(1)));
}

/// Every operation of the document: method, path, operation.
struct Operation {
  std::string method, path;
  Json description;
};

std::vector<Operation> operations(const Json& document) {
  std::vector<Operation> all;
  for (const auto& [path, methods] : document["paths"].items()) {
    for (const auto& [method, description] : methods.items()) {
      std::string upper = method;
      for (char& c : upper) c = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
      all.push_back({upper, path, description});
    }
  }
  return all;
}

/// A server that holds one analysed submission; the ids that stand for the examples' own.
class OpenApi : public ::testing::Test {
 protected:
  OpenApi()
      : server_({.tokens_required = false, .workers = 1, .limits = {}}),
        document_(json_of(server_.get("/openapi.json"))) {
    const RawAnswer accepted = server_.post("/v1/recordings?valve_type=type-1", good_csv("EFC-104233", "2026-W31-B"));
    recording_ = server_.await(accepted.header("Location"));
    analysis_id_ = json_of(server_.get(text("links", "self") + "/analyses"))["items"][0]["id"].get<std::string>();
  }

  std::string text(const char* outer, const char* inner) const { return recording_[outer][inner].get<std::string>(); }

  std::string id_for(const std::string& path) const {
    if (path.starts_with("/v1/recordings")) return recording_["id"];
    if (path.starts_with("/v1/submissions")) return recording_["submission_id"];
    if (path.starts_with("/v1/jobs")) return recording_["job_id"];
    return analysis_id_;
  }

  /// The target of an operation with its parameters' examples in it.
  std::string target_of(const Operation& operation) const {
    std::string target = operation.path, query;
    for (const Json& listed : operation.description.value("parameters", Json::array())) {
      const Json parameter = resolve(document_, listed);
      if (!parameter.contains("example")) continue;
      const std::string name = parameter["name"];
      const Json& example = parameter["example"];
      const std::string value = http::percent_encode(example.is_string() ? example.get<std::string>() : example.dump());
      if (parameter["in"] == "query") query += (query.empty() ? "?" : "&") + name + "=" + value;
      const auto at = target.find("{" + name + "}");
      if (parameter["in"] == "path") target.replace(at, name.size() + 2, name == "id" ? id_for(operation.path) : value);
    }
    return target + query;
  }

  /// Status, content type and body are what the document says of this operation.
  void check(const Operation& operation, const RawAnswer& answer, int status) const {
    if (status != 0) {
      EXPECT_EQ(answer.status, status) << answer.body;
    } else {
      EXPECT_LT(answer.status, 300) << answer.body;
    }
    const Json& responses = operation.description["responses"];
    const std::string code = std::to_string(answer.status);
    const std::string key = responses.contains(code) ? code : "default";
    ASSERT_TRUE(responses.contains(key)) << "undescribed status " << code;
    const Json response = resolve(document_, responses[key]);
    const std::string sent_type = answer.header("Content-Type");
    const std::string type = sent_type.substr(0, sent_type.find(';'));
    ASSERT_TRUE(response["content"].contains(type)) << type;
    const Json& media = response["content"][type];
    if (!media.contains("schema") || type.find("json") == std::string::npos) return;
    const Json schema{{"allOf", Json::array({media["schema"]})}, {"components", document_["components"]}};
    EXPECT_EQ(schema_violations(schema, json_of(answer)), "") << answer.body;
  }

  TestServer server_;
  Json document_;
  Json recording_;
  std::string analysis_id_;
};

TEST_F(OpenApi, DescribesExactlyTheRoutesOfTheTableWithTheirScopesAndParameters) {
  std::set<std::string> described, there;
  for (const Operation& operation : operations(document_)) {
    std::string line =
        operation.method + " " + operation.path + " " + operation.description["x-scope"].get<std::string>();
    std::set<std::string> names;
    for (const Json& listed : operation.description.value("parameters", Json::array())) {
      const Json parameter = resolve(document_, listed);
      if (parameter["in"] == "query") names.insert(parameter["name"].get<std::string>());
    }
    for (const std::string& name : names) line += " " + name;
    described.insert(line);
  }
  for (const http::Route& route : http::routes()) {
    std::string line =
        std::string(route.method) + " " + std::string(route.pattern) + " " + std::string(to_text(route.scope));
    std::set<std::string> names;
    std::istringstream words{std::string(route.parameters)};
    for (std::string name; words >> name;) names.insert(name);
    for (const std::string& name : names) line += " " + name;
    there.insert(line);
  }
  EXPECT_EQ(described, there);
}

TEST_F(OpenApi, AnswersEveryExampleAsDescribed) {
  for (const Operation& operation : operations(document_)) {
    SCOPED_TRACE(operation.method + " " + operation.path);
    const std::string target = target_of(operation);
    const int expected = operation.description.value("x-status", 0);
    if (!operation.description.contains("requestBody")) {
      check(operation, request(server_.port(), operation.method, target), expected);
      continue;
    }
    for (const auto& [type, media] : operation.description["requestBody"]["content"].items()) {
      const Json examples = media.value("examples", Json::object());
      for (const auto& [name, example] : examples.items()) {
        SCOPED_TRACE(name);
        const Json& value = example["value"];
        const std::string body = value.is_string() ? value.get<std::string>() : value.dump();
        const RawAnswer answer = request(server_.port(), operation.method, target, body, {{"Content-Type", type}});
        check(operation, answer, example.value("x-status", 0));
      }
    }
  }
}

}  // namespace
}  // namespace valvetriage
