#include "server/wire/residuals_json.h"

#include <fmt/format.h>

#include <cmath>
#include <limits>

#include "server/wire/json_fields.h"

namespace valvetriage {
namespace {

/// No curve on a page shows more digits; they make most of what is stored.
Json rounded(double value) {
  return std::isfinite(value) ? Json(std::stod(fmt::format("{:.5g}", value))) : Json(nullptr);
}

Result<BinnedResidual> binned_from(JsonFields fields, const std::optional<Error>& error) {
  BinnedResidual residual;
  residual.white_sd = fields.number("white_sd");
  residual.time_s = fields.numbers("time_s");
  const Json& values = fields.raw("value");
  if (!values.is_array() || values.size() != residual.time_s.size()) {
    fields.refuse("value", "out_of_range", "needs a number or null for each time");
  }
  if (error) return tl::unexpected(*error);
  residual.value.resize(Eigen::Index(values.size()));
  for (std::size_t k = 0; k < values.size(); ++k) {
    residual.value(Eigen::Index(k)) =
        values[k].is_number() ? values[k].get<double>() : std::numeric_limits<double>::quiet_NaN();
  }
  return residual;
}

}  // namespace

std::string residuals_to_json(const std::map<std::string, BinnedResidual>& residuals) {
  Json document = Json::object();
  for (const auto& [test, residual] : residuals) {
    Json values = Json::array(), times = Json::array();
    for (const double value : residual.value) values.push_back(rounded(value));
    for (const double time_s : residual.time_s) times.push_back(rounded(time_s));
    document[test] = {
        {"value", std::move(values)}, {"time_s", std::move(times)}, {"white_sd", rounded(residual.white_sd)}};
  }
  return dump_json(document);
}

Result<std::map<std::string, BinnedResidual>> residuals_from_json(std::string_view text) {
  const auto document = parse_json(text);
  if (!document) return tl::unexpected(document.error());
  std::map<std::string, BinnedResidual> residuals;
  if (!document->is_object()) return fail("wrong_type", "residuals are an object by test");
  for (const auto& [test, entry] : document->items()) {
    std::optional<Error> error;
    auto residual = binned_from(JsonFields(entry, "/" + test, error), error);
    if (!residual) return tl::unexpected(residual.error());
    residuals.emplace(test, std::move(*residual));
  }
  return residuals;
}

}  // namespace valvetriage
