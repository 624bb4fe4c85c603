#include "server/wire/frequency_json.h"

#include <cmath>

#include "server/wire/json_fields.h"
#include "server/wire/model_json.h"

namespace valvetriage {
namespace {

Json numbers(const std::vector<double>& values) {
  Json list = Json::array();
  for (const double value : values) list.push_back(finite_or_null(value));
  return list;
}

/// The measured response; arrays of equal length, empty where there is none.
void add_points(const FrequencyResponse& response, Json& json) {
  for (const char* name : {"frequency_hz", "gain", "coherence", "band95"}) json[name] = Json::array();
  for (const ResponsePoint& p : response.points) {
    const double gain = std::abs(p.gain), half = gain_half_width95(p);
    json["frequency_hz"].push_back(p.frequency_hz);
    json["gain"].push_back(finite_or_null(gain));
    json["coherence"].push_back(finite_or_null(p.coherence));
    json["band95"].push_back(Json::array({finite_or_null(std::max(0.0, gain - half)), finite_or_null(gain + half)}));
  }
  json["gain_normalised"] = numbers(normalised_gain(response.points));
  json["phase_deg"] = numbers(unwrapped_phase_deg(response.points));
}

Json unusable_json(const FrequencyResponse& response) {
  Json list = Json::array();
  for (const UnusableBand& band : response.unusable) {
    list.push_back(Json{{"from_hz", band.from_hz}, {"to_hz", band.to_hz}, {"reason", band.reason}});
  }
  return list;
}

Json lines_json(const DistortionLines& lines) {
  return Json{{"frequency_hz", lines.frequency_hz}, {"level", numbers(lines.level)}};
}

Json distortion_json(const std::optional<Distortion>& d) {
  if (!d) return nullptr;
  return Json{{"noise_ratio", d->noise_ratio},   {"odd_ratio", d->odd_ratio},     {"even_ratio", d->even_ratio},
              {"linear", lines_json(d->linear)}, {"noise", lines_json(d->noise)}, {"odd", lines_json(d->odd)},
              {"even", lines_json(d->even)}};
}

Json amplitude_json(const std::optional<AmplitudeDependence>& d) {
  if (!d) return nullptr;
  return Json{{"amplitude_low", d->amplitude_low},           {"amplitude_high", d->amplitude_high},
              {"change_rms", finite_or_null(d->change_rms)}, {"expected_rms", finite_or_null(d->expected)},
              {"p_value", finite_or_null(d->p_value)},       {"points", d->points}};
}

Json tried_json(const std::vector<TriedResponseOrder>& tried) {
  Json list = Json::array();
  for (const TriedResponseOrder& one : tried) {
    list.push_back(Json{{"order", one.order},
                        {"zeros", one.zeros},
                        {"delay_s", one.delay_s},
                        {"rmse_heldout", finite_or_null(one.rmse_heldout)},
                        {"bic", finite_or_null(one.criterion)}});
  }
  return list;
}

}  // namespace

Json to_json(const FrequencyResult& result, std::span<const RecordingSummary> recordings) {
  Json json{{"recordings", Json::array()}, {"refused", result.refused.empty() ? Json(nullptr) : Json(result.refused)}};
  for (const std::size_t r : result.recordings) json["recordings"].push_back(recordings[r].sha256);
  json["method"] = to_string(result.response.method);
  json["input_mean"] = finite_or_null(result.response.input_mean);
  json["input_amplitude"] = finite_or_null(result.response.input_amplitude);
  add_points(result.response, json);
  json["unusable"] = unusable_json(result.response);
  json["distortion"] = distortion_json(result.response.distortion);
  json["amplitude_dependence"] = amplitude_json(result.amplitude_dependence);
  json["transfer_function"] = result.model ? to_json(result.model->transfer_function) : Json(nullptr);
  json["order"] = result.model ? Json(result.model->transfer_function.poles.size()) : Json(nullptr);
  json["order_reason"] = result.order_reason;
  json["tried"] = tried_json(result.tried);
  json["fit_percent"] = finite_or_null(result.fit_percent);
  json["features"] = Json::object();
  for (const ResponseFeature& feature : result.features) {
    json["features"][feature.name] = Json{{"value", finite_or_null(feature.value)},
                                          {"std_error", finite_or_null(feature.std_error)},
                                          {"unit", feature.unit}};
  }
  return json;
}

}  // namespace valvetriage
