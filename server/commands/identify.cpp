#include <fmt/format.h>
#include <unistd.h>

#include <cmath>
#include <iostream>
#include <memory>
#include <numbers>

#include "core/identify/identification.h"
#include "server/commands/commands.h"
#include "server/commands/recording_options.h"
#include "server/wire/identify_json.h"
#include "server/wire/live_rows.h"

namespace valvetriage {
namespace {

struct IdentifyArguments {
  std::string file;
  std::string method;
  std::string form = "incremental";
  std::optional<int> order, zeros, delay_samples;
  double lambda = 1;
  bool follow = false;
  std::size_t every = 1;
  bool json = false;
  RecordingOptions recording;
};

IdentificationMethod method_of(const std::string& name) {
  if (name == "rls") return IdentificationMethod::kRls;
  if (name == "arx") return IdentificationMethod::kArx;
  if (name == "oe") return IdentificationMethod::kOutputError;
  return name == "asymptotic" ? IdentificationMethod::kAsymptotic : IdentificationMethod::kRational;
}

RlsForm form_of(const std::string& name) {
  if (name == "extended") return RlsForm::kExtended;
  return name == "absolute" ? RlsForm::kAbsolute : RlsForm::kIncremental;
}

Result<ReadRecording> read_input(const IdentifyArguments& arguments) {
  auto options = read_options(arguments.recording);
  if (!options) return tl::unexpected(options.error());
  if (arguments.file != "-") return read_recording_file(arguments.file, *options);
  options->name = "standard input";
  return read_recording_descriptor(STDIN_FILENO, *options);
}

/// A root in z as the rate it stands for: s = ln z / T.
std::string root_text(std::complex<double> z, double sample_time_s) {
  std::string text = fmt::format("{:>11.6f} {:>+11.6f}i", z.real(), z.imag());
  if (std::abs(z) == 0) return text + "   (whole samples of delay)";
  const std::complex<double> s = std::log(z) / sample_time_s;
  const double magnitude = std::abs(s);
  return text + fmt::format("   {:>10.5g} rad/s  {:>10.5g} Hz  damping {:>6.3f}", magnitude,
                            magnitude / (2 * std::numbers::pi), magnitude > 0 ? -s.real() / magnitude : 0);
}

void print_coefficients(const Identification& id) {
  const auto line = [](char name, std::size_t i, double value, double error) {
    fmt::print("  {}{:<2} {:>14.7g} ± {:.2g}\n", name, i, value, error);
  };
  for (std::size_t i = 1; i < id.coefficients.a.size(); ++i) line('a', i, id.coefficients.a[i], id.std_errors.a[i]);
  for (std::size_t i = 0; i < id.coefficients.b.size(); ++i) line('b', i, id.coefficients.b[i], id.std_errors.b[i]);
}

void print_tried(const Identification& id) {
  if (id.tried.empty()) return;
  fmt::print("\ntried    order  zeros    delay_s  held-out rmse\n");
  for (const TriedStructure& one : id.tried) {
    fmt::print("         {:>5}  {:>5}  {:>9.5g}  {:>13.5g}\n", one.structure.order, one.structure.zeros, one.delay_s,
               one.rmse_heldout);
  }
}

/// A root in s, in rad/s and in Hz, with its standard error.
std::string root_text(std::complex<double> s, double std_error, bool pole) {
  constexpr double kTwoPi = 2 * std::numbers::pi;
  const double magnitude = std::abs(s);
  std::string text = fmt::format("{:>11.5g} {:>+11.5g}i rad/s ± {:<8.2g} {:>10.5g} Hz ± {:<8.2g}", s.real(), s.imag(),
                                 std_error, magnitude / kTwoPi, std_error / kTwoPi);
  if (pole || s.imag() != 0) text += fmt::format(" damping {:.3f}", magnitude > 0 ? -s.real() / magnitude : 0);
  return text;
}

/// The gain of G = gain prod(s - zero) / prod(s - pole): s in rad/s, or in Hz (2 pi rad/s each).
double gain_in_hz(const TransferFunction& g) {
  return g.gain *
         std::pow(2 * std::numbers::pi, static_cast<double>(g.zeros.size()) - static_cast<double>(g.poles.size()));
}

void print_continuous(const Identification& id) {
  const TransferFunction& g = id.transfer_function;
  const ResponseModel& model = id.frequency->model;
  fmt::print("\npoles (s)\n");
  for (std::size_t i = 0; i < g.poles.size(); ++i) {
    fmt::print("{}\n", root_text(g.poles[i], model.pole_std_errors[i], true));
  }
  fmt::print("zeros (s), gain {:.7g} with roots in rad/s, {:.7g} with roots in Hz\n", g.gain, gain_in_hz(g));
  for (std::size_t i = 0; i < g.zeros.size(); ++i) {
    fmt::print("{}\n", root_text(g.zeros[i], model.zero_std_errors[i], false));
  }
  if (model.steps) {
    fmt::print(
        "steps: asymptote J = {:.4g} (Eqs 4 to 6), V = {:.4g} from its breakpoints, {:.4g} at the minimum (Eq 1)\n",
        model.steps->j, model.steps->v_start, model.steps->v);
  }
  fmt::print("\ntried    order  zeros    delay_s  held-out rmse    BIC\n");
  for (const TriedResponseOrder& one : id.frequency->tried) {
    fmt::print("         {:>5}  {:>5}  {:>9.5g}  {:>13.5g}  {:>7.1f}\n", one.order, one.zeros, one.delay_s,
               one.rmse_heldout, one.criterion);
  }
}

void print_response(const FrequencyResponse& response) {
  fmt::print("response: {} frequencies from {:.4g} to {:.4g} Hz by {}, amplitude {:.4g} about {:.4g}\n",
             response.points.size(), response.points.front().frequency_hz, response.points.back().frequency_hz,
             to_string(response.method), response.input_amplitude, response.input_mean);
  if (!response.distortion) return;
  fmt::print("nonlinear: of the linear output {:.3g} % odd, {:.3g} % even, {:.3g} % noise per line\n",
             100 * response.distortion->odd_ratio, 100 * response.distortion->even_ratio,
             100 * response.distortion->noise_ratio);
}

void print_report(const Identification& id, const Recording& recording) {
  const TransferFunction& g = id.transfer_function;
  fmt::print("{}: {} samples at {:.6g} Hz\n", recording.name, recording.samples(), recording.sample_rate_hz());
  fmt::print("method {}, order {}, delay {:.6g} s, {}; {}\n", to_string(id.method), id.structure.order, g.delay_s,
             id.stable ? "stable" : "unstable", id.termination);
  fmt::print("why this order: {}\n", id.order_reason);
  if (id.run) fmt::print("free run: fit {:.2f} %, rmse {:.5g} {}\n", id.run->fit_percent, id.run->rmse, id.output_unit);
  fmt::print("static gain {:.6g} ± {:.2g}\n", id.static_gain, id.std_errors.static_gain);
  if (id.step) {
    fmt::print("step: rise time {:.5g} s, settling time {:.5g} s, overshoot {:.1f} %\n", id.step->rise_time_s,
               id.step->settling_time_s, 100 * id.step->overshoot_ratio);
  }
  if (id.frequency) {
    print_response(id.frequency->response);
    print_continuous(id);
    for (const std::string& note : id.notes) fmt::print("note: {}\n", note);
    return;
  }
  fmt::print("\npoles (z)\n");
  for (const auto& pole : g.poles) fmt::print("{}\n", root_text(pole, g.sample_time_s));
  fmt::print("zeros (z), gain {:.7g}\n", g.gain);
  for (const auto& zero : g.zeros) fmt::print("{}\n", root_text(zero, g.sample_time_s));
  fmt::print("coefficients, with standard errors\n");
  print_coefficients(id);
  print_tried(id);
  for (const std::string& note : id.notes) fmt::print("note: {}\n", note);
}

ExitStatus identify_file(const IdentifyArguments& arguments, IdentificationMethod method) {
  const auto read = read_input(arguments);
  if (!read) return ended_by(read.error());
  IdentifyOptions options;
  options.method = method;
  options.order = arguments.order;
  options.zeros = arguments.zeros;
  options.delay_samples = arguments.delay_samples;
  options.rls_form = form_of(arguments.form);
  options.lambda = arguments.lambda;
  const Recording* const recordings[] = {&read->recording};
  const auto identification = identify(recordings, options);
  if (!identification) {
    Error error = identification.error();
    error.file = read->recording.name;
    return ended_by(error);
  }
  if (arguments.json) {
    fmt::print("{}\n", dump_json(to_json(*identification), true));
  } else {
    print_report(*identification, read->recording);
  }
  return kDone;
}

void print_estimate(const RecursiveLeastSquares& rls, std::size_t row, double time_s, bool json) {
  if (json) {
    fmt::print("{}\n", dump_json(estimate_json(rls, row, time_s)));
  } else {
    fmt::print("{:>8} {:>10.4f} s", row, time_s);
    const auto names = rls.parameter_names();
    const Eigen::MatrixXd covariance = rls.noise_variance() * rls.covariance();
    for (std::size_t i = 0; i < names.size(); ++i) {
      const auto at = static_cast<Eigen::Index>(i);
      fmt::print("  {} {:.5g} ± {:.2g}", names[i], rls.theta_hat()[i], std::sqrt(covariance(at, at)));
    }
    fmt::print("\n");
  }
  std::fflush(stdout);
}

/// The recursion on rows as they come. A bad row is told and left out: a stand does not stop for it, the exit status
/// says that it happened. A bad header ends it.
ExitStatus follow(const IdentifyArguments& arguments, IdentificationMethod method) {
  if (arguments.file != "-" || method != IdentificationMethod::kRls) {
    return ended_by(fail("bad_option",
                         "--follow takes rows from standard input with the recursion: identify - --follow "
                         "--method rls")
                        .value());
  }
  const auto read = read_options(arguments.recording);
  if (!read) return ended_by(read.error());
  RlsOptions options;
  options.form = form_of(arguments.form);
  options.order = arguments.order.value_or(options.order);
  options.input_terms = arguments.zeros.value_or(options.order - 1) + 1;
  options.delay_samples = arguments.delay_samples.value_or(1);
  options.lambda = arguments.lambda;
  auto rls = RecursiveLeastSquares::create(options);
  if (!rls) return ended_by(rls.error());

  LiveRows rows(read->mapping, read->metadata);
  ExitStatus status = kDone;
  double last_time_s = 0;
  bool printed = false;
  for (std::string line; std::getline(std::cin, line);) {
    const auto row = rows.take(line);
    if (!row) {
      if (rows.rows() == 0) return ended_by(row.error());
      print_error(row.error());
      status = kBadInput;
      continue;
    }
    if (!row->has_value()) continue;
    if (auto done = rls->update((*row)->input, (*row)->output); !done) {
      print_error(done.error());
      status = kBadInput;
      continue;
    }
    last_time_s = (*row)->time_s;
    printed = rows.rows() % arguments.every == 0;
    if (printed) print_estimate(*rls, rows.rows(), last_time_s, arguments.json);
  }
  if (rows.rows() == 0) return ended_by(fail("no_samples", "standard input ended before the first row").value());
  if (!printed) print_estimate(*rls, rows.rows(), last_time_s, arguments.json);
  return status;
}

ExitStatus run(const IdentifyArguments& arguments) {
  const IdentificationMethod method = method_of(arguments.method);
  return arguments.follow ? follow(arguments, method) : identify_file(arguments, method);
}

}  // namespace

void add_identify_command(CLI::App& app, int& exit_status) {
  CLI::App* verb = app.add_subcommand("identify", "A linear model of a recording, with how sure it is");
  auto arguments = std::make_shared<IdentifyArguments>();
  verb->add_option("FILE", arguments->file, "Recording; - is standard input")->required();
  verb->add_option(
          "--method", arguments->method,
          "rls (the paper's recursion), arx (batch), oe (free run); of a sweep's frequency response: asymptotic (the "
          "paper's real poles and zeros), rational (complex ones and a delay)")
      ->required()
      ->check(CLI::IsMember({"rls", "arx", "oe", "asymptotic", "rational"}));
  verb->add_option("--order", arguments->order, "Number of poles; chosen on held-out data when not said")
      ->check(CLI::Range(1, kMaxIdentifiedOrder));
  verb->add_option("--zeros", arguments->zeros, "Number of zeros; chosen when not said")
      ->check(CLI::Range(0, kMaxIdentifiedOrder));
  verb->add_option("--delay-samples", arguments->delay_samples,
                   "First input lag k of the difference equation; chosen when not said")
      ->check(CLI::Range(0, kMaxRlsDelay));
  verb->add_option("--form", arguments->form, "Of rls: incremental (as printed), extended (with c1) or absolute")
      ->check(CLI::IsMember({"incremental", "extended", "absolute"}))
      ->capture_default_str();
  verb->add_option("--lambda", arguments->lambda, "Forgetting factor of rls, above 0 and at most 1")
      ->capture_default_str();
  verb->add_flag("--follow", arguments->follow, "Rows from standard input as they come, the estimate as it goes");
  verb->add_option("--every", arguments->every, "With --follow: print after so many rows")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  verb->add_flag("--json", arguments->json, "Print JSON (with --follow one line each time)");
  add_column_options(*verb, arguments->recording);
  add_metadata_options(*verb, arguments->recording);
  verb->callback([arguments, &exit_status] { exit_status = run(*arguments); });
}

}  // namespace valvetriage
