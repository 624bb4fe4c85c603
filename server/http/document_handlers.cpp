#include <fmt/format.h>

#include <charconv>

#include "core/recording/metadata.h"
#include "server/http/handlers.h"
#include "server/http/limits.h"
#include "server/http/receive.h"
#include "server/http/stored_recording.h"
#include "server/http/views.h"
#include "server/jobs/learning_child.h"
#include "server/wire/json_fields.h"
#include "server/wire/reference_json.h"
#include "server/wire/rule_base_json.h"

namespace valvetriage::http {
namespace {

Result<Response> list_documents(Service& service, Request& request, DocumentKind kind) {
  const auto rows = service.store.list_documents(kind, request.captures[0]);
  if (!rows) return tl::unexpected(rows.error());
  std::vector<Json> items;
  for (const DocumentRow& row : *rows) items.push_back(view(row));
  return whole_list_response(request, std::move(items));
}

Result<Response> add_document(Service& service, Request& request, DocumentKind kind, const Json& body,
                              const std::string& sha256) {
  Metadata named;
  if (auto sound = set_metadata(named, "valve_type", request.captures[0]); !sound) return tl::unexpected(sound.error());
  const auto row = service.store.add_document(kind, request.captures[0], dump_json(body), sha256, request.actor);
  if (!row) return tl::unexpected(row.error());
  const Json document = view(*row);
  Response response = json_response(document, 201);
  response.set_header("Location", document["links"]["self"].get<std::string>());
  return response;
}

/// A version by its number, or `newest`.
Result<Response> get_document(Service& service, Request& request, DocumentKind kind) {
  const std::string& text = request.captures[1];
  std::optional<int> version;
  if (text != "newest") {
    int number = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
    if (error != std::errc() || end != text.data() + text.size()) {
      return fail("bad_parameter", "a version is a number, or 'newest'");
    }
    version = number;
  }
  auto document = service.store.document(kind, request.captures[0], version);
  if (!document) return tl::unexpected(document.error());
  Response response;
  // The body tells its version, and one content may be stored under several.
  const std::string tag = fmt::format("{}-{}", document->row.version, document->row.sha256);
  if (is_known(request, tag, response)) return response;
  // A reference carries its version: the one under which the store keeps it.
  auto body = parse_json(document->body_json);
  if (body && body->contains("version")) {
    (*body)["version"] = document->row.version;
    response.body = dump_json(*body);
  } else {
    response.body = std::move(document->body_json);
  }
  return response;
}

Result<GoodValve> good_valve(Service& service, const std::string& submission_id) {
  const auto rows = service.store.recordings_of(submission_id);
  if (!rows) return tl::unexpected(rows.error());
  if (rows->empty()) return fail("not_found", fmt::format("there is no submission '{}'", submission_id));
  GoodValve valve{.serial = rows->front().labels.serial.value_or(submission_id), .files = {}};
  for (const RecordingRow& row : *rows) {
    auto file = file_of(service, row);
    if (!file) return tl::unexpected(file.error());
    valve.files.push_back(std::move(*file));
  }
  return valve;
}

Result<Reference> learn_from(Service& service, const Json& document, const std::string& valve_type) {
  std::optional<Error> error;
  const auto ids = JsonFields(document, "", error).texts("submissions");
  if (error) return tl::unexpected(*error);
  if (ids.size() > kMaxReferenceSubmissions) {
    return fail("out_of_range", fmt::format("{} submissions: at most {} can be learned from over HTTP, more by "
                                            "'valvetriage reference learn'",
                                            ids.size(), kMaxReferenceSubmissions));
  }
  const auto place = PlaceForWork::take(service.learning);
  if (!place) return tl::unexpected(place.error());
  std::vector<GoodValve> valves;
  for (const std::string& id : ids) {
    auto valve = good_valve(service, id);
    if (!valve) return tl::unexpected(valve.error());
    valves.push_back(std::move(*valve));
  }
  auto learned = learn_in_child(valves, valve_type, [&] { return !service.stopping(); });
  if (!learned && service.stopping()) return fail("draining", "the server is shutting down; try again");
  return learned;
}

}  // namespace

Result<Response> list_references(Service& service, Request& request) {
  return list_documents(service, request, DocumentKind::kReference);
}

Result<Response> get_reference(Service& service, Request& request) {
  return get_document(service, request, DocumentKind::kReference);
}

Result<Response> post_reference(Service& service, Request& request) {
  const auto document = receive_json(request, kMaxDocumentBytes);
  if (!document) return tl::unexpected(document.error());
  const std::string& valve_type = request.captures[0];
  const bool learned = document->is_object() && document->contains("submissions");
  const auto reference = learned ? learn_from(service, *document, valve_type) : reference_from_json(*document);
  if (!reference) return tl::unexpected(reference.error());
  if (reference->valve_type != valve_type) {
    Error error{.code = "contradicting_metadata"};
    error.field = "/valve_type";
    error.found = reference->valve_type;
    error.expected = valve_type;
    error.message = fmt::format("the document is for valve type '{}', the path says '{}'", error.found, error.expected);
    return tl::unexpected(error);
  }
  return add_document(service, request, DocumentKind::kReference, to_json(*reference), reference_sha256(*reference));
}

Result<Response> list_rule_bases(Service& service, Request& request) {
  return list_documents(service, request, DocumentKind::kRuleBase);
}

Result<Response> get_rule_base(Service& service, Request& request) {
  return get_document(service, request, DocumentKind::kRuleBase);
}

Result<Response> post_rule_base(Service& service, Request& request) {
  const auto text = receive_document(request, kMaxRuleBaseBytes);
  if (!text) return tl::unexpected(text.error());
  const auto rule_base = rule_base_from_json(*text);
  if (!rule_base) return tl::unexpected(rule_base.error());
  return add_document(service, request, DocumentKind::kRuleBase, to_json(*rule_base), rule_base_sha256(*rule_base));
}

}  // namespace valvetriage::http
