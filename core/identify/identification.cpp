#include "core/identify/identification.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "core/identify/arx.h"

namespace valvetriage {
namespace {

/// A standard error beyond this share of the static gain says that the data do not fix the gain.
constexpr double kUnknownGainRatio = 0.5;

Result<OrderChoice> structure_for(std::span<const Recording* const> recordings, const IdentifyOptions& options) {
  const bool given = options.order && options.zeros && options.delay_samples;
  if (given && options.method != IdentificationMethod::kOutputError) {
    OrderChoice choice;
    choice.structure = {*options.order, *options.zeros, *options.delay_samples};
    choice.reason = "as asked for";
    return choice;
  }
  OrderOptions order;
  order.offsets = options.offsets;
  order.order = options.order;
  order.zeros = options.zeros;
  order.delay_samples = options.delay_samples;
  order.largest_order = options.largest_order;
  return choose_order(recordings, order);
}

Result<void> take_coefficients(Identification& result, RationalCoefficients coefficients) {
  auto g = to_transfer_function(coefficients);
  if (!g) return tl::unexpected(g.error());
  result.transfer_function = std::move(*g);
  result.coefficients = std::move(coefficients);
  return {};
}

double static_gain_of(const RationalCoefficients& c) {
  return std::accumulate(c.b.begin(), c.b.end(), 0.0) / std::accumulate(c.a.begin(), c.a.end(), 0.0);
}

/// Standard errors of a recursion: P times the noise variance, carried to Σb / Σa by its gradient.
CoefficientErrors errors_of(const RecursiveLeastSquares& rls) {
  const auto order = static_cast<Eigen::Index>(rls.options().order);
  const auto used = order + static_cast<Eigen::Index>(rls.options().input_terms);
  const Eigen::MatrixXd covariance = rls.noise_variance() * rls.covariance().topLeftCorner(used, used);
  const Eigen::VectorXd errors = covariance.diagonal().cwiseSqrt();
  const RationalCoefficients c = rls.coefficients(0);
  const double denominator = std::accumulate(c.a.begin(), c.a.end(), 0.0);
  Eigen::VectorXd gradient = Eigen::VectorXd::Constant(used, 1 / denominator);
  gradient.head(order).setConstant(-static_gain_of(c) / denominator);
  CoefficientErrors result;
  result.a.assign(1, 0.0);
  result.a.insert(result.a.end(), errors.begin(), errors.begin() + order);
  result.b.assign(errors.begin() + order, errors.end());
  result.static_gain = std::sqrt(gradient.dot(covariance * gradient));
  return result;
}

Result<void> identify_by_rls(std::span<const Recording* const> recordings, const IdentifyOptions& options,
                             Identification& result) {
  RlsOptions settings;
  settings.form = options.rls_form;
  settings.order = result.structure.order;
  settings.input_terms = result.structure.zeros + 1;
  settings.delay_samples = result.structure.delay_samples;
  settings.lambda = options.lambda;
  auto rls = RecursiveLeastSquares::create(settings);
  if (!rls) return tl::unexpected(rls.error());
  for (const Recording* recording : recordings) {
    rls->forget_past();
    for (std::size_t t = 0; t < recording->samples(); ++t) {
      if (!recording->is_valid(t)) {
        rls->forget_past();
        continue;
      }
      if (auto done = rls->update(recording->input.values[t], recording->output.values[t]); !done) return done;
    }
  }
  result.std_errors = errors_of(*rls);
  result.termination = "converged";
  if (settings.form == RlsForm::kIncremental) {
    result.notes.emplace_back(
        "the paper's incremental form: noise in the output biases it; compare with --form absolute or --method oe");
  }
  return take_coefficients(result, rls->coefficients(recordings.front()->sample_period_s));
}

Result<void> identify_by_arx(std::span<const Recording* const> recordings, Identification& result) {
  auto fit = fit_arx(recordings, result.structure);
  if (!fit) return tl::unexpected(fit.error());
  result.std_errors = std::move(fit->std_errors);
  result.termination = to_string(fit->full_rank ? Termination::kConverged : Termination::kNotExcited);
  return take_coefficients(result, std::move(fit->coefficients));
}

Result<void> identify_by_output_error(std::span<const Recording* const> recordings, const IdentifyOptions& options,
                                      const OrderChoice& choice, Identification& result) {
  OutputErrorOptions settings;
  settings.offsets = options.offsets;
  TransferFunction start;
  start.poles = choice.poles;
  settings.starts.push_back(std::move(start));
  auto fit = fit_output_error(recordings, result.structure, settings);
  if (!fit) return tl::unexpected(fit.error());
  result.transfer_function = std::move(fit->transfer_function);
  result.coefficients = std::move(fit->coefficients);
  result.std_errors = std::move(fit->std_errors);
  result.run = std::move(fit->run);
  result.termination = to_string(fit->termination);
  return {};
}

Result<void> identify_by_response(std::span<const Recording* const> recordings, const IdentifyOptions& options,
                                  Identification& result) {
  if (options.delay_samples) {
    return fail("bad_option", "the delay of a frequency response is fitted in seconds: leave out --delay-samples");
  }
  auto response = estimate_frequency_response(recordings);
  if (!response) return tl::unexpected(response.error());
  ResponseOrderOptions order;
  order.kind =
      options.method == IdentificationMethod::kRational ? ResponseModelKind::kRational : ResponseModelKind::kAsymptotic;
  order.order = options.order;
  order.zeros = options.zeros;
  auto choice = choose_response_order(*response, order);
  if (!choice) return tl::unexpected(choice.error());
  const ResponseModel& model = choice->model;
  result.transfer_function = model.transfer_function;
  result.structure.order = static_cast<int>(model.transfer_function.poles.size());
  result.structure.zeros = static_cast<int>(model.transfer_function.zeros.size());
  result.structure.delay_samples = 0;
  result.std_errors.static_gain = model.static_gain_std_error;
  result.static_gain = model.static_gain;
  result.order_reason = choice->reason;
  result.notes = choice->notes;
  result.termination = to_string(model.termination);
  for (const UnusableBand& band : response->unusable) {
    result.notes.push_back(
        fmt::format("no response from {:.4g} to {:.4g} Hz: {}", band.from_hz, band.to_hz, band.reason));
  }
  if (auto run = free_run_of_response(recordings, result.transfer_function, response->hold))
    result.run = std::move(*run);
  result.frequency = FrequencyIdentification{std::move(*response), std::move(choice->model), std::move(choice->tried)};
  return {};
}

bool works_on_a_response(IdentificationMethod method) {
  return method == IdentificationMethod::kAsymptotic || method == IdentificationMethod::kRational;
}

void judge(std::span<const Recording* const> recordings, Identification& result) {
  if (!result.frequency) result.static_gain = static_gain_of(result.coefficients);
  result.stable = is_stable(result.transfer_function);
  if (!result.stable) {
    double largest = 0;
    for (const auto& pole : result.transfer_function.poles) largest = std::max(largest, std::abs(pole));
    result.notes.push_back(
        fmt::format("unstable: the largest pole has modulus {:.4f}, so no free run is made", largest));
    return;
  }
  if (!result.run && !result.frequency) {
    if (auto run = free_run(recordings, result.coefficients)) result.run = std::move(*run);
  }
  if (auto step = step_metrics(result.transfer_function)) result.step = *step;
  if (result.termination == to_string(Termination::kNotExcited)) {
    result.notes.emplace_back("the input does not excite every parameter: some combinations of them are arbitrary");
  }
  if (result.std_errors.static_gain > kUnknownGainRatio * std::abs(result.static_gain)) {
    result.notes.emplace_back("the static gain is not determined: the recording is short beside the slowest mode");
  }
}

}  // namespace

std::string to_string(IdentificationMethod method) {
  switch (method) {
    case IdentificationMethod::kRls:
      return "rls";
    case IdentificationMethod::kArx:
      return "arx";
    case IdentificationMethod::kOutputError:
      return "oe";
    case IdentificationMethod::kAsymptotic:
      return "asymptotic";
    case IdentificationMethod::kRational:
      return "rational";
  }
  return "unknown";
}

double Identification::output_offset() const {
  if (!run || run->output_offsets.empty()) return 0;
  const double sum = std::accumulate(run->output_offsets.begin(), run->output_offsets.end(), 0.0);
  return sum / static_cast<double>(run->output_offsets.size());
}

Result<FreeRun> free_run_of_response(std::span<const Recording* const> recordings, const TransferFunction& continuous,
                                     Hold hold) {
  const double period_s = recordings.front()->sample_period_s;
  const auto sampled =
      hold == Hold::kLinear ? discretise_foh(continuous, period_s) : discretise_zoh(continuous, period_s);
  if (!sampled) return tl::unexpected(sampled.error());
  const auto coefficients = to_coefficients(*sampled);
  if (!coefficients) return tl::unexpected(coefficients.error());
  return free_run(recordings, *coefficients);
}

Result<Identification> identify(std::span<const Recording* const> recordings, const IdentifyOptions& options) {
  if (works_on_a_response(options.method)) {
    Identification result;
    result.method = options.method;
    result.input_unit = recordings.front()->input.unit;
    result.output_unit = recordings.front()->output.unit;
    if (auto done = identify_by_response(recordings, options, result); !done) return tl::unexpected(done.error());
    judge(recordings, result);
    return result;
  }
  auto choice = structure_for(recordings, options);
  if (!choice) return tl::unexpected(choice.error());
  Identification result;
  result.method = options.method;
  result.structure = choice->structure;
  result.input_unit = recordings.front()->input.unit;
  result.output_unit = recordings.front()->output.unit;
  result.order_reason = choice->reason;
  Result<void> done;
  switch (options.method) {
    case IdentificationMethod::kRls:
      done = identify_by_rls(recordings, options, result);
      break;
    case IdentificationMethod::kArx:
      done = identify_by_arx(recordings, result);
      break;
    case IdentificationMethod::kOutputError:
      done = identify_by_output_error(recordings, options, *choice, result);
      break;
    case IdentificationMethod::kAsymptotic:
    case IdentificationMethod::kRational:
      break;  // above
  }
  if (!done) return tl::unexpected(done.error());
  result.tried = std::move(choice->tried);
  judge(recordings, result);
  return result;
}

Model to_model(const Identification& identification) {
  Model model;
  model.kind = "linear";
  model.input_unit = identification.input_unit;
  model.output_unit = identification.output_unit;
  model.dynamics = identification.transfer_function;
  model.input_offset = identification.run ? identification.run->input_offset : 0;
  model.output_offset = identification.output_offset();
  return model;
}

}  // namespace valvetriage
