#include "server/wire/identify_json.h"

#include "server/wire/model_json.h"

namespace valvetriage {
namespace {

Json with_error(double value, double std_error) {
  return Json{{"value", value}, {"std_error", std_error}};
}

Json coefficients_json(const std::vector<double>& values, const std::vector<double>& errors) {
  Json list = Json::array();
  for (std::size_t i = 0; i < values.size(); ++i) list.push_back(with_error(values[i], errors[i]));
  return list;
}

Json tried_json(const std::vector<TriedStructure>& tried) {
  Json list = Json::array();
  for (const TriedStructure& one : tried) {
    list.push_back(Json{{"order", one.structure.order},
                        {"delay_s", one.delay_s},
                        {"rmse_heldout", one.rmse_heldout},
                        {"zeros", one.structure.zeros}});
  }
  return list;
}

Json step_json(const std::optional<StepMetrics>& step) {
  if (!step) return nullptr;
  return Json{{"rise_time_s", step->rise_time_s},
              {"settling_time_s", step->settling_time_s},
              {"overshoot_ratio", step->overshoot_ratio}};
}

Json tried_json(const std::vector<TriedResponseOrder>& tried) {
  Json list = Json::array();
  for (const TriedResponseOrder& one : tried) {
    list.push_back(Json{{"order", one.order},
                        {"delay_s", one.delay_s},
                        {"rmse_heldout", one.rmse_heldout},
                        {"zeros", one.zeros},
                        {"bic", one.criterion}});
  }
  return list;
}

Json errors_json(const std::vector<double>& errors) {
  Json list = Json::array();
  for (const double error : errors) list.push_back(finite_or_null(error));
  return list;
}

/// What the methods of the frequency domain add.
Json frequency_json(const FrequencyIdentification& frequency) {
  const FrequencyResponse& r = frequency.response;
  Json unusable = Json::array();
  for (const UnusableBand& band : r.unusable) {
    unusable.push_back(Json{{"from_hz", band.from_hz}, {"to_hz", band.to_hz}, {"reason", band.reason}});
  }
  Json json{{"method", to_string(r.method)},
            {"points", r.points.size()},
            {"from_hz", r.points.front().frequency_hz},
            {"to_hz", r.points.back().frequency_hz},
            {"unusable", std::move(unusable)},
            {"pole_std_errors_rad_s", errors_json(frequency.model.pole_std_errors)},
            {"zero_std_errors_rad_s", errors_json(frequency.model.zero_std_errors)},
            {"delay_std_error_s", frequency.model.delay_std_error_s}};
  if (const auto& steps = frequency.model.steps) {
    json["steps"] = Json{{"j", steps->j}, {"v_start", steps->v_start}, {"v", steps->v}};
  }
  return json;
}

}  // namespace

Json to_json(const Identification& id) {
  Json json{{"method", to_string(id.method)},
            {"order", id.structure.order},
            {"transfer_function", to_json(id.transfer_function)},
            {"stable", id.stable},
            {"fit_percent", id.run ? Json(id.run->fit_percent) : Json(nullptr)},
            {"tried", id.frequency ? tried_json(id.frequency->tried) : tried_json(id.tried)}};
  json["input_unit"] = id.input_unit;
  json["output_unit"] = id.output_unit;
  json["input_offset"] = id.run ? id.run->input_offset : 0;
  json["output_offset"] = id.output_offset();
  json["rmse"] = id.run ? Json(id.run->rmse) : Json(nullptr);
  json["static_gain"] = with_error(id.static_gain, id.std_errors.static_gain);
  if (id.frequency) json["frequency_response"] = frequency_json(*id.frequency);
  if (!id.frequency)
    json["coefficients"] = Json{{"a", coefficients_json(id.coefficients.a, id.std_errors.a)},
                                {"b", coefficients_json(id.coefficients.b, id.std_errors.b)},
                                {"delay_samples", id.coefficients.delay_samples}};
  json["step"] = step_json(id.step);
  json["order_reason"] = id.order_reason;
  json["termination"] = id.termination;
  json["notes"] = id.notes;
  return json;
}

Json estimate_json(const RecursiveLeastSquares& rls, std::size_t row, double time_s) {
  const double variance = rls.noise_variance();
  Json json{{"row", row}, {"time_s", time_s}, {"updates", rls.updates()}};
  json["prediction_error"] = rls.prediction_error();
  json["noise_variance"] = variance;  // not finite while there are fewer updates than parameters: null
  const auto names = rls.parameter_names();
  for (std::size_t i = 0; i < names.size(); ++i) json["theta_hat"][names[i]] = rls.theta_hat()[i];
  const Eigen::MatrixXd covariance = variance * rls.covariance();
  for (const auto& line : covariance.rowwise())
    json["covariance"].push_back(std::vector<double>(line.begin(), line.end()));
  return json;
}

}  // namespace valvetriage
