#include "core/identify/asymptotic_bode.h"

#include <fmt/format.h>
#include <Eigen/Core>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>

#include "core/linear_algebra/solve.h"

namespace valvetriage {
namespace {

using Complex = std::complex<double>;
using Eigen::Index;

constexpr double kTwoPi = 2 * std::numbers::pi;
constexpr int kPlaces = 12;            // where a new breakpoint is tried
constexpr int kPairPlaces = 6;         // where a pole and a zero side by side are
constexpr int kPlaceIterations = 2;    // after which a place is known to be good or not
constexpr double kReach = 1;           // e-folds beyond the band: further out a corner is a constant
constexpr double kPlacesBeyond = 0.7;  // e-folds beyond the band that new breakpoints are tried in
constexpr std::size_t kTrialPoints = 40;
constexpr int kAsymptoteIterations = 15;
constexpr int kCurveIterations = 40;
constexpr double kConverged = 1e-9;
constexpr double kLargestStep = 0.7;  // e-folds in one iteration

/// Measured x = ln ω and ln|Y|, and the trapezoid's weights for Eq 6.
struct LogGain {
  std::vector<double> x, y, dx;
};

LogGain log_gain_of(const FrequencyResponse& response) {
  LogGain data;
  for (const ResponsePoint& p : response.points) {
    data.x.push_back(std::log(kTwoPi * p.frequency_hz));
    data.y.push_back(std::log(std::abs(p.gain)));
  }
  const std::size_t n = data.x.size();
  for (std::size_t k = 0; k < n; ++k) {
    const double left = k > 0 ? data.x[k] - data.x[k - 1] : 0, right = k + 1 < n ? data.x[k + 1] - data.x[k] : 0;
    data.dx.push_back(0.5 * (left + right));
  }
  return data;
}

/// Eq 3 of one breakpoint in corner form, ½ ln(1 + e^(2 (x − x_i))) without overflow, and its slope.
double corner(double distance) {
  return distance > 0 ? distance + 0.5 * std::log1p(std::exp(-2 * distance)) : 0.5 * std::log1p(std::exp(2 * distance));
}
double corner_slope(double distance) {
  return 1 / (1 + std::exp(-2 * distance));
}

enum class Curve { kAsymptote, kExact };

/// Breakpoints and ln gain, with the objective they reach.
struct State {
  std::vector<Breakpoint> breakpoints;
  double log_gain = 0;
  double objective = std::numeric_limits<double>::infinity();
  int iterations = 0;
  Termination termination = Termination::kIterationLimit;
};

double value_at(Curve curve, std::span<const Breakpoint> breakpoints, double x) {
  return curve == Curve::kAsymptote ? asymptote_log_gain(breakpoints, x) : log_gain(breakpoints, x);
}

/// Residual of Eq 6 or Eq 1 as √weight (measured − model); returns the objective.
double residual(Curve curve, const LogGain& data, const State& state, Eigen::VectorXd& e, Eigen::MatrixXd* jacobian) {
  const auto n = static_cast<Index>(data.x.size());
  const auto p = static_cast<Index>(state.breakpoints.size());
  e.resize(n);
  if (jacobian) jacobian->resize(n, p + 1);
  for (Index k = 0; k < n; ++k) {
    const auto at = static_cast<std::size_t>(k);
    const double weight = curve == Curve::kAsymptote ? std::sqrt(data.dx[at]) : 1;
    e(k) = weight * (data.y[at] - state.log_gain - value_at(curve, state.breakpoints, data.x[at]));
    if (!jacobian) continue;
    for (Index i = 0; i < p; ++i) {
      const Breakpoint& b = state.breakpoints[static_cast<std::size_t>(i)];
      const double distance = data.x[at] - b.x;
      const double slope = curve == Curve::kAsymptote ? (distance > 0 ? 1.0 : 0.0) : corner_slope(distance);
      (*jacobian)(k, i) = weight * b.t * slope;
    }
    (*jacobian)(k, p) = weight;
  }
  return 0.5 * e.squaredNorm();
}

/// The gain that suits given breakpoints best.
void fit_gain(Curve curve, const LogGain& data, State& state) {
  double sum = 0, weights = 0;
  for (std::size_t k = 0; k < data.x.size(); ++k) {
    const double weight = curve == Curve::kAsymptote ? data.dx[k] : 1;
    sum += weight * (data.y[k] - value_at(curve, state.breakpoints, data.x[k]));
    weights += weight;
  }
  state.log_gain = sum / weights;
  Eigen::VectorXd e;
  state.objective = residual(curve, data, state, e, nullptr);
}

void minimise(Curve curve, const LogGain& data, State& state, int iterations) {
  Eigen::VectorXd e, next_e;
  Eigen::MatrixXd jacobian;
  double damping = 1e-3;
  state.objective = residual(curve, data, state, e, &jacobian);
  const double least = data.x.front() - kReach, most = data.x.back() + kReach;
  state.termination = Termination::kIterationLimit;
  for (int iteration = 0; iteration < iterations; ++iteration, ++state.iterations) {
    const Eigen::MatrixXd normal = jacobian.transpose() * jacobian;
    const Eigen::VectorXd gradient = jacobian.transpose() * e;
    const double ridge = normal.diagonal().maxCoeff();
    bool descended = false;
    double gain = 0;
    for (int attempt = 0; attempt < 6 && !descended; ++attempt, damping *= 6) {
      Eigen::MatrixXd damped = normal;
      damped.diagonal().array() += damping * ridge * 1e-2 + damping * normal.diagonal().array();
      const Eigen::VectorXd step = solve_symmetric(damped, gradient);
      State next = state;
      for (std::size_t i = 0; i < next.breakpoints.size(); ++i) {
        const double move = std::clamp(step(static_cast<Index>(i)), -kLargestStep, kLargestStep);
        next.breakpoints[i].x = std::clamp(next.breakpoints[i].x + move, least, most);
      }
      next.log_gain += step(step.size() - 1);
      next.objective = residual(curve, data, next, next_e, nullptr);
      if (!(next.objective < state.objective)) continue;
      gain = (state.objective - next.objective) / state.objective;
      state = std::move(next);
      damping *= 0.02;
      descended = true;
    }
    if (!descended) {
      state.termination = Termination::kNoDescent;
      return;
    }
    if (gain < kConverged) {
      state.termination = Termination::kConverged;
      return;
    }
    residual(curve, data, state, e, &jacobian);
  }
}

/// Measured points, and fewer of them to try places on.
struct Measured {
  LogGain all, few;
};

Measured measured_from(const FrequencyResponse& response) {
  Measured measured{log_gain_of(response), {}};
  FrequencyResponse few;
  const std::size_t stride = (response.points.size() + kTrialPoints - 1) / kTrialPoints;
  for (std::size_t k = 0; k < response.points.size(); k += stride) few.points.push_back(response.points[k]);
  measured.few = log_gain_of(few);
  return measured;
}

/// One breakpoint more: tried at every place, the best refined.
State with_one_more(Curve curve, const Measured& data, const State& parent, double t) {
  std::vector<State> children;
  const double from = data.few.x.front() - kPlacesBeyond, to = data.few.x.back() + kPlacesBeyond;
  for (int place = 0; place < kPlaces; ++place) {
    State child = parent;
    child.iterations = 0;
    child.breakpoints.push_back({from + (to - from) * place / (kPlaces - 1), t});
    fit_gain(curve, data.few, child);
    minimise(curve, data.few, child, kPlaceIterations);
    children.push_back(std::move(child));
  }
  State& best = *std::min_element(children.begin(), children.end(),
                                  [](const State& x, const State& y) { return x.objective < y.objective; });
  minimise(curve, data.all, best, curve == Curve::kAsymptote ? kAsymptoteIterations : kCurveIterations);
  return best;
}

/// A pole and a zero more, side by side: what neither alone could begin.
State with_a_pair(Curve curve, const Measured& data, const State& parent) {
  State best;
  const double from = data.few.x.front(), to = data.few.x.back(), apart = (to - from) / kPairPlaces;
  for (int place = 0; place < kPairPlaces; ++place) {
    for (const double t : {1.0, -1.0}) {
      State child = parent;
      child.iterations = 0;
      child.breakpoints.push_back({from + apart * place, t});
      child.breakpoints.push_back({from + apart * (place + 1), -t});
      fit_gain(curve, data.few, child);
      minimise(curve, data.few, child, kPlaceIterations);
      if (child.objective < best.objective) best = std::move(child);
    }
  }
  minimise(curve, data.all, best, curve == Curve::kAsymptote ? kAsymptoteIterations : kCurveIterations);
  return best;
}

/// Sign of the gain and delay from what phase the minimum-phase model leaves: −ω τ, and π where the gain is negative.
void add_sign_and_delay(const FrequencyResponse& response, AsymptoticFit& fit) {
  TransferFunction& g = fit.transfer_function;
  std::vector<double> f;
  for (const ResponsePoint& p : response.points) f.push_back(p.frequency_hz);
  const auto model = frequency_response(g, f);
  if ((response.points.front().gain / model.front()).real() < 0) {
    g.gain = -g.gain;
    fit.static_gain = -fit.static_gain;
  }
  const double sign = g.gain < 0 ? -1 : 1;
  double phase = 0, cross = 0, square = 0;
  Complex before = sign;
  std::vector<double> lag;
  for (std::size_t k = 0; k < f.size(); ++k) {
    const Complex excess = response.points[k].gain / model[k];
    phase += std::arg(excess / before);
    before = excess;
    lag.push_back(-phase);
    const double sigma = std::max(response.points[k].std_error / std::abs(response.points[k].gain), 1e-4);
    cross += lag.back() * kTwoPi * f[k] / (sigma * sigma);
    square += kTwoPi * f[k] * kTwoPi * f[k] / (sigma * sigma);
  }
  g.delay_s = std::max(0.0, cross / square);
  double misfit = 0;
  for (std::size_t k = 0; k < f.size(); ++k) {
    const double sigma = std::max(response.points[k].std_error / std::abs(response.points[k].gain), 1e-4);
    misfit += std::pow((lag[k] - kTwoPi * f[k] * g.delay_s) / sigma, 2) / static_cast<double>(f.size());
  }
  fit.delay_std_error_s = std::sqrt(std::max(0.5, misfit) / square);
}

AsymptoticFit describe(const FrequencyResponse& response, const LogGain& data, const State& asymptote,
                       const State& start, const State& curve) {
  AsymptoticFit fit;
  fit.asymptote = asymptote.breakpoints;
  std::sort(fit.asymptote.begin(), fit.asymptote.end(), [](const auto& a, const auto& b) { return a.x < b.x; });
  fit.asymptote_log_gain = asymptote.log_gain;
  fit.j = asymptote.objective;
  fit.v_start = start.objective;
  fit.v = curve.objective;
  fit.iterations = curve.iterations;
  fit.termination = curve.termination;
  fit.parameters = static_cast<int>(curve.breakpoints.size()) + 1;
  Eigen::VectorXd e;
  Eigen::MatrixXd jacobian;
  residual(Curve::kExact, data, curve, e, &jacobian);
  const double freedoms = std::max<double>(1, static_cast<double>(data.x.size()) - fit.parameters);
  const Eigen::MatrixXd covariance = 2 * fit.v / freedoms * pseudo_inverse(jacobian.transpose() * jacobian);
  TransferFunction& g = fit.transfer_function;
  g.domain = Domain::kS;
  for (std::size_t i = 0; i < curve.breakpoints.size(); ++i) {
    const Breakpoint& b = curve.breakpoints[i];
    const double omega = std::exp(b.x);
    const double error = omega * std::sqrt(covariance(static_cast<Index>(i), static_cast<Index>(i)));
    (b.t > 0 ? g.poles : g.zeros).emplace_back(-omega);
    (b.t > 0 ? fit.pole_std_errors : fit.zero_std_errors).push_back(error);
  }
  fit.static_gain = std::exp(curve.log_gain);
  fit.static_gain_std_error = fit.static_gain * std::sqrt(covariance(covariance.rows() - 1, covariance.cols() - 1));
  g.gain = fit.static_gain / static_gain(g);
  add_sign_and_delay(response, fit);
  return fit;
}

State state_of(const AsymptoticFit& fit) {
  State state;
  for (const Complex& p : fit.transfer_function.poles) state.breakpoints.push_back({std::log(-p.real()), 1});
  for (const Complex& z : fit.transfer_function.zeros) state.breakpoints.push_back({std::log(-z.real()), -1});
  state.log_gain = std::log(std::abs(fit.static_gain));
  return state;
}

struct Cell {
  State asymptote, start, curve;
};

/// From an asymptote to the curve: V from J's minimum.
Cell cell_from(const LogGain& data, State asymptote) {
  Cell cell{asymptote, asymptote, {}};
  cell.start.iterations = 0;
  fit_gain(Curve::kExact, data, cell.start);
  cell.curve = cell.start;
  minimise(Curve::kExact, data, cell.curve, kCurveIterations);
  return cell;
}

std::size_t index_of(int poles, int zeros) {
  return static_cast<std::size_t>(poles * (poles + 1) / 2 + zeros);
}

/// One cell from those with a breakpoint or a pair less: the asymptote's way, and from the smaller curve itself.
void grow(const Measured& data, std::vector<Cell>& cells, int poles, int zeros) {
  std::vector<State> asymptotes, curves;
  const auto from = [&](const Cell& parent, double t) {
    asymptotes.push_back(with_one_more(Curve::kAsymptote, data, parent.asymptote, t));
    curves.push_back(with_one_more(Curve::kExact, data, parent.curve, t));
  };
  if (zeros < poles) from(cells[index_of(poles - 1, zeros)], 1);
  if (zeros > 0) from(cells[index_of(poles, zeros - 1)], -1);
  if (zeros > 0) {
    const Cell& parent = cells[index_of(poles - 1, zeros - 1)];
    asymptotes.push_back(with_a_pair(Curve::kAsymptote, data, parent.asymptote));
    curves.push_back(with_a_pair(Curve::kExact, data, parent.curve));
  }
  const auto lower = [](const State& x, const State& y) { return x.objective < y.objective; };
  Cell& cell = cells[index_of(poles, zeros)];
  cell = cell_from(data.all, *std::min_element(asymptotes.begin(), asymptotes.end(), lower));
  const State& other = *std::min_element(curves.begin(), curves.end(), lower);
  if (other.objective < cell.curve.objective) cell.curve = other;
}

}  // namespace

double log_gain(std::span<const Breakpoint> breakpoints, double x) {
  double sum = 0;
  for (const Breakpoint& b : breakpoints) sum -= b.t * corner(x - b.x);
  return sum;
}

double asymptote_log_gain(std::span<const Breakpoint> breakpoints, double x) {
  double sum = 0;
  for (const Breakpoint& b : breakpoints) sum -= b.t * std::max(0.0, x - b.x);
  return sum;
}

AsymptoteSearch::AsymptoteSearch(const FrequencyResponse& response, int most_poles) : most_poles_(most_poles) {
  const Measured data = measured_from(response);
  std::vector<Cell> cells(index_of(most_poles + 1, 0));
  fits_.resize(cells.size());
  fit_gain(Curve::kAsymptote, data.all, cells[0].asymptote);
  fit_gain(Curve::kExact, data.all, cells[0].curve);
  for (int poles = 1; poles <= most_poles; ++poles) {
    for (int zeros = 0; zeros <= poles; ++zeros) {
      grow(data, cells, poles, zeros);
      const Cell& cell = cells[index_of(poles, zeros)];
      fits_[index_of(poles, zeros)] = describe(response, data.all, cell.asymptote, cell.start, cell.curve);
    }
  }
}

const AsymptoticFit& AsymptoteSearch::at(int poles, int zeros) const {
  return fits_[index_of(poles, zeros)];
}

AsymptoticFit refit_asymptotic(const FrequencyResponse& response, const AsymptoticFit& start, int max_iterations) {
  const LogGain data = log_gain_of(response);
  const State from = state_of(start);
  State curve = from;
  minimise(Curve::kExact, data, curve, max_iterations);
  AsymptoticFit fit = describe(response, data, from, from, curve);
  fit.asymptote = start.asymptote;
  fit.asymptote_log_gain = start.asymptote_log_gain;
  fit.j = start.j;
  fit.v_start = start.v_start;
  return fit;
}

Result<AsymptoticFit> fit_asymptotic(const FrequencyResponse& response, const AsymptoticFitOptions& options) {
  if (options.poles < 1 || options.poles > kMaxIdentifiedOrder || options.zeros < 0 || options.zeros > options.poles) {
    return fail("bad_option", fmt::format("the asymptotic method takes 1 to {} poles and no more zeros than poles, not "
                                          "{} and {}",
                                          kMaxIdentifiedOrder, options.poles, options.zeros));
  }
  if (response.points.size() < static_cast<std::size_t>(options.poles + options.zeros) + 3) {
    return fail("too_few_points", fmt::format("{} poles and {} zeros are not supported by {} usable frequencies",
                                              options.poles, options.zeros, response.points.size()));
  }
  return AsymptoteSearch(response, options.poles).at(options.poles, options.zeros);
}

}  // namespace valvetriage
