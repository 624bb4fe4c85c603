#include "core/identify/rational_fit.h"

#include <fmt/format.h>
#include <Eigen/Core>

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <limits>
#include <numbers>
#include <numeric>

#include "core/linear_algebra/solve.h"
#include "core/model/polynomial.h"

namespace valvetriage {
namespace {

using Complex = std::complex<double>;
using Eigen::Index;

constexpr double kTwoPi = 2 * std::numbers::pi;
constexpr double kRelativeFloor = 1e-4;   // no stand's gain is known better than that
constexpr double kFewImagesBelow = 0.15;  // of the sampling rate: there the images are a few percent
constexpr int kFewImages = 1, kManyImages = 4;
constexpr double kReachBelow = 3;   // poles lie no further below the band: what is slower is a constant there
constexpr double kReachAbove = 30;  // and no further above it
constexpr double kLeastDamping = 1e-4;
constexpr double kLargestStep = 1.0;  // e-folds of a pole's coefficient in one iteration
constexpr double kConverged = 1e-8;   // relative change of the misfit
constexpr int kFirstIterations = 3;   // of every way out
constexpr int kScreenIterations = 8;  // after which one start is enough to tell
constexpr std::array<double, 5> kDelayShares{0, 0.2, 0.4, 0.6, 0.9};  // of all the phase
constexpr int kVectorFittingIterations = 12;                          // fewer where the poles stand still
constexpr std::array<double, 4> kDelayMoves{-0.1, 0.05, 0.1, 0.2};
constexpr std::size_t kScreened = 4;   // starts that are refined before the best is taken
constexpr int kRounds = 3;             // of ways out of a local minimum
constexpr double kWorthARound = 1e-4;  // of the misfit
constexpr std::array<double, 5> kSpreadShares{0.1, 0.3, 0.5, 0.7, 0.9};  // of the band, logarithmic

/// s² + a1 s + a0 with a1 = e^log_a1, a0 = e^log_a0; or s + a0 where `single`.
struct Section {
  double log_a1 = 0, log_a0 = 0;
  bool single = false;
};

/// A point of the search, in scaled frequency and gain.
struct Candidate {
  std::vector<Section> sections;
  Eigen::VectorXd numerator;
  double delay = 0;
  double cost = std::numeric_limits<double>::infinity();
  int iterations = 0;
  Termination termination = Termination::kIterationLimit;
};

int images_for(const FrequencyResponse& response) {
  if (!(response.sample_period_s > 0)) return 0;
  return response.points.back().frequency_hz * response.sample_period_s < kFewImagesBelow ? kFewImages : kManyImages;
}

/// The delay that would make all of the phase.
double phase_delay_s(const FrequencyResponse& response) {
  const auto phase_deg = unwrapped_phase_deg(response.points);
  const double drop = (phase_deg.front() - phase_deg.back()) * std::numbers::pi / 180;
  return std::max(0.0, drop / (kTwoPi * (response.points.back().frequency_hz - response.points.front().frequency_hz)));
}

/// The least-squares problem: scaled so that the band's middle and the gain's size are 1.
class Problem {
 public:
  Problem(const FrequencyResponse& response, const RationalFitOptions& options) : options_(options) {
    const auto& points = response.points;
    omega_scale_ = kTwoPi * std::sqrt(points.front().frequency_hz * points.back().frequency_hz);
    double sum = 0;
    for (const ResponsePoint& p : points) sum += std::norm(p.gain);
    gain_scale_ = std::sqrt(sum / static_cast<double>(points.size()));
    lowest_ = kTwoPi * points.front().frequency_hz / omega_scale_;
    highest_ = kTwoPi * points.back().frequency_hz / omega_scale_;
    phase_delay_ = phase_delay_s(response) * omega_scale_;
    const auto n = static_cast<Index>(points.size());
    weight_.resize(n);
    target_.resize(n);
    for (Index k = 0; k < n; ++k) {
      const ResponsePoint& p = points[static_cast<std::size_t>(k)];
      const double floor = kRelativeFloor * std::abs(p.gain);
      weight_(k) = std::numbers::sqrt2 * gain_scale_ / std::hypot(p.std_error, floor);
      target_(k) = p.gain / gain_scale_;
      omega_.push_back(kTwoPi * p.frequency_hz / omega_scale_);
    }
    for (int j = 0; j < options.zeros; ++j) corners_.push_back(at_share_of_band((j + 0.5) / options.zeros));
    read_images(response);
  }

  double omega_scale() const { return omega_scale_; }
  double gain_scale() const { return gain_scale_; }
  Index points() const { return target_.size(); }
  double lowest() const { return lowest_; }
  double highest() const { return highest_; }
  double phase_delay() const { return phase_delay_; }
  /// The narrowest resonance that the points resolve, 2 |Re p| by their distance there.
  double least_log_a1(double log_a0) const {
    const double omega = std::exp(0.5 * log_a0);
    const auto above = std::upper_bound(omega_.begin() + 1, omega_.end() - 1, omega);
    return std::log(std::max(2 * kLeastDamping * omega, options_.narrowest * (*above - *(above - 1))));
  }
  double at_share_of_band(double share) const { return lowest_ * std::pow(highest_ / lowest_, share); }
  const std::vector<double>& corners() const { return corners_; }
  Index parameters(const Candidate& c) const {
    return pole_parameters(c) + static_cast<Index>(c.numerator.size()) + (options_.fit_delay ? 1 : 0);
  }
  static Index pole_parameters(const Candidate& c) {
    Index n = 0;
    for (const Section& section : c.sections) n += section.single ? 1 : 2;
    return n;
  }

  /// Values of the numerator's basis.
  void basis(Complex s, Eigen::RowVectorXcd& values) const {
    values(0) = 1;
    for (std::size_t j = 0; j < corners_.size(); ++j) {
      values(static_cast<Index>(j) + 1) = values(static_cast<Index>(j)) * (s / corners_[j] + 1.0);
    }
  }

  /// The numerator by linear least squares, everything else given.
  void solve_numerator(Candidate& c) const {
    const Eigen::ArrayXcd carrier = carrier_of(c);
    Eigen::MatrixXd rows(2 * points(), basis_.cols());
    for (Index j = 0; j < basis_.cols(); ++j) set_real_rows(carrier * basis_.col(j), rows.col(j));
    Eigen::VectorXd right(2 * points());
    right << weight_ * target_.real(), weight_ * target_.imag();
    c.numerator = scaled_least_squares(rows, right);
    c.cost = (right - rows * c.numerator).squaredNorm();
  }

  /// Weighted residual H − G as real rows, real parts above imaginary ones, and its negative derivative where wanted.
  double residual(const Candidate& c, Eigen::VectorXd& e, Eigen::MatrixXd* jacobian) const {
    const Eigen::ArrayXcd carrier = carrier_of(c);
    const Eigen::ArrayXcd g = carrier * (basis_.matrix() * c.numerator.cast<Complex>()).array();
    e.resize(2 * points());
    set_real_rows(-g, e);
    e.head(points()).array() += weight_ * target_.real();
    e.tail(points()).array() += weight_ * target_.imag();
    if (jacobian) set_sensitivities(c, carrier, g, *jacobian);
    return e.squaredNorm();
  }

  Candidate moved(const Candidate& c, const Eigen::VectorXd& step) const {
    Candidate next = c;
    Index column = 0;
    const double least = std::log(lowest_ / kReachBelow), most = std::log(highest_ * kReachAbove);
    for (Section& section : next.sections) {
      if (!section.single) section.log_a1 += std::clamp(step(column++), -kLargestStep, kLargestStep);
      section.log_a0 += std::clamp(step(column++), -kLargestStep, kLargestStep);
      const double power = section.single ? 1 : 2;
      section.log_a0 = std::clamp(section.log_a0, power * least, power * most);
      if (section.single) continue;
      section.log_a1 = std::clamp(section.log_a1, least_log_a1(section.log_a0), most);
    }
    next.numerator += step.segment(column, c.numerator.size());
    column += c.numerator.size();
    if (options_.fit_delay) next.delay = std::max(0.0, next.delay + step(column));
    return next;
  }

  double weight(Index point) const { return weight_(point); }

 private:
  /// Where the model is read: each point itself and its images, which follow one another.
  void read_images(const FrequencyResponse& response) {
    const int images = images_for(response);
    readings_per_point_ = 2 * images + 1;
    if (images > 0) image_distance_ = Complex(0, kTwoPi / response.sample_period_s / omega_scale_);
    s_.resize(points() * readings_per_point_);
    basis_.resize(s_.size(), options_.zeros + 1);
    Eigen::RowVectorXcd values(basis_.cols());
    Index at = 0;
    for (const ResponsePoint& p : response.points) {
      const Complex own = images > 0 ? hold_factor(response.hold, p.frequency_hz, response.sample_period_s) : 1;
      for (int l = -images; l <= images; ++l, ++at) {
        const double f = images > 0 ? p.frequency_hz + l / response.sample_period_s : p.frequency_hz;
        const Complex factor = images > 0 ? hold_factor(response.hold, f, response.sample_period_s) / own : 1;
        s_(at) = Complex(0, kTwoPi * f / omega_scale_);
        basis(s_(at), values);
        basis_.row(at) = factor * values;
      }
    }
  }

  /// Of the denominator, at every reading.
  Eigen::ArrayXcd factor_of(const Section& section) const {
    const double a0 = std::exp(section.log_a0);
    if (section.single) return s_ + Complex(a0);
    return s_ * (s_ + Complex(std::exp(section.log_a1))) + Complex(a0);
  }

  /// e^(−sτ) over the denominator, at every reading.
  Eigen::ArrayXcd carrier_of(const Candidate& c) const {
    Eigen::ArrayXcd carrier(s_.size());
    const Complex turn = std::exp(-c.delay * image_distance_);  // from one image to the next
    for (Index first = 0; first < s_.size(); first += readings_per_point_) {
      Complex at = std::exp(-c.delay * s_(first));
      for (Index i = first; i < first + readings_per_point_; ++i, at *= turn) carrier(i) = at;
    }
    Eigen::ArrayXcd below = Eigen::ArrayXcd::Ones(s_.size());
    for (const Section& section : c.sections) below *= factor_of(section);
    return carrier / below;
  }

  /// Values at the readings summed over each point's, weighted, real parts above imaginary ones.
  template <typename Rows>
  void set_real_rows(const Eigen::ArrayXcd& at_readings, Rows&& rows) const {
    const Eigen::Map<const Eigen::ArrayXXcd> by_point(at_readings.data(), readings_per_point_, points());
    const Eigen::ArrayXcd sums = by_point.colwise().sum();
    rows.head(points()).array() = weight_ * sums.real();
    rows.tail(points()).array() = weight_ * sums.imag();
  }

  /// ∂G of the sections' coefficients, the numerator's, and of the delay.
  void set_sensitivities(const Candidate& c, const Eigen::ArrayXcd& carrier, const Eigen::ArrayXcd& g,
                         Eigen::MatrixXd& jacobian) const {
    jacobian.resize(2 * points(), parameters(c));
    Index column = 0;
    for (const Section& section : c.sections) {
      const Eigen::ArrayXcd over_factor = g / factor_of(section);
      if (!section.single) {
        set_real_rows(-std::exp(section.log_a1) * s_ * over_factor, jacobian.col(column++));
      }
      set_real_rows(-std::exp(section.log_a0) * over_factor, jacobian.col(column++));
    }
    for (Index j = 0; j < basis_.cols(); ++j) set_real_rows(carrier * basis_.col(j), jacobian.col(column++));
    if (options_.fit_delay) set_real_rows(-s_ * g, jacobian.col(column));
  }

  RationalFitOptions options_;
  double omega_scale_ = 1, gain_scale_ = 1, lowest_ = 1, highest_ = 1, phase_delay_ = 0;
  std::vector<double> corners_, omega_;
  Eigen::ArrayXd weight_;   ///< per point
  Eigen::ArrayXcd target_;  ///< per point
  int readings_per_point_ = 1;
  Complex image_distance_ = 0;  ///< of s
  Eigen::ArrayXcd s_;           ///< per reading
  Eigen::ArrayXXcd basis_;      ///< of the numerator, per reading and term, with the reading's weight in its point
};

/// Poles as sections: pairs as they are, real ones two by two, the fastest alone where their number is odd. Filled up
/// beyond the band or without the fastest where the number differs.
std::vector<Section> sections_from(std::vector<Complex> poles, int order, const Problem& problem) {
  for (Complex& p : poles) p /= problem.omega_scale();
  std::vector<double> real;
  std::vector<Complex> pairs;
  for (const Complex& p : poles) {
    if (p.imag() > 0) pairs.push_back(p);
    if (p.imag() == 0)
      real.push_back(std::clamp(-p.real(), problem.lowest() / kReachBelow, problem.highest() * kReachAbove));
  }
  const auto by_size = [](const Complex& a, const Complex& b) { return std::abs(a) < std::abs(b); };
  std::sort(pairs.begin(), pairs.end(), by_size);
  std::sort(real.begin(), real.end());
  const auto count = [&] { return static_cast<int>(2 * pairs.size() + real.size()); };
  while (count() > order && !real.empty()) real.pop_back();
  while (count() > order) {
    real.push_back(std::abs(pairs.back()));
    pairs.pop_back();
  }
  for (double extra = 1.5 * problem.highest(); count() < order; extra *= 1.5) real.push_back(extra);
  std::vector<Section> sections;
  for (const Complex& p : pairs) {
    const double log_a0 = std::log(std::norm(p));
    sections.push_back({std::max(std::log(-2 * p.real()), problem.least_log_a1(log_a0)), log_a0, false});
  }
  std::size_t i = 0;
  for (; i + 1 < real.size(); i += 2) {
    sections.push_back({std::log(real[i] + real[i + 1]), std::log(real[i] * real[i + 1]), false});
  }
  if (i < real.size()) sections.push_back({0, std::log(real[i]), true});
  return sections;
}

std::vector<Candidate>::const_iterator lowest_cost(const std::vector<Candidate>& candidates) {
  return std::min_element(candidates.begin(), candidates.end(),
                          [](const Candidate& a, const Candidate& b) { return a.cost < b.cost; });
}

/// Levenberg-Marquardt with columns scaled to one length.
void refine(const Problem& problem, Candidate& c, int iterations) {
  Eigen::VectorXd e;
  Eigen::MatrixXd jacobian;
  double damping = 1e-3;
  c.cost = problem.residual(c, e, &jacobian);
  c.termination = Termination::kIterationLimit;
  for (int iteration = 0; iteration < iterations; ++iteration, ++c.iterations) {
    const Eigen::VectorXd norms = jacobian.colwise().norm().cwiseMax(1e-300);
    const Eigen::MatrixXd scaled = jacobian * norms.cwiseInverse().asDiagonal();
    const Eigen::MatrixXd normal = scaled.transpose() * scaled;
    const Eigen::VectorXd gradient = scaled.transpose() * e;
    bool descended = false;
    double gain = 0;
    for (int attempt = 0; attempt < 8 && !descended; ++attempt) {
      Eigen::MatrixXd damped = normal;
      damped.diagonal().array() += damping;
      const Eigen::VectorXd step = solve_symmetric(damped, gradient).cwiseQuotient(norms);
      Candidate next = problem.moved(c, step);
      Eigen::VectorXd next_e;
      next.cost = problem.residual(next, next_e, nullptr);
      if (next.cost < c.cost) {
        gain = (c.cost - next.cost) / c.cost;
        next.iterations = c.iterations;
        c = std::move(next);
        damping = std::max(damping * 0.2, 1e-12);
        descended = true;
      } else {
        damping *= 5;
      }
    }
    if (!descended) {
      c.termination = Termination::kNoDescent;
      return;
    }
    c.termination = Termination::kIterationLimit;
    if (gain < kConverged) {
      c.termination = Termination::kConverged;
      return;
    }
    problem.residual(c, e, &jacobian);
  }
}

Candidate candidate_at(const Problem& problem, const std::vector<Complex>& poles, double delay_s, int order) {
  Candidate c;
  c.sections = sections_from(poles, order, problem);
  c.delay = delay_s * problem.omega_scale();
  problem.solve_numerator(c);
  return c;
}

std::vector<Candidate> starts_of(const FrequencyResponse& response, const Problem& problem,
                                 const RationalFitOptions& options) {
  std::vector<Candidate> starts;
  for (const TransferFunction& g : options.starts) {
    starts.push_back(candidate_at(problem, g.poles, options.fit_delay ? g.delay_s : 0, options.order));
  }
  if (options.only_given_starts && !starts.empty()) return starts;
  const double all_phase_s = options.fit_delay ? phase_delay_s(response) : 0;
  for (const double share : kDelayShares) {
    const double delay_s = share * all_phase_s;
    if (share > 0 && all_phase_s == 0) break;
    const auto poles = vector_fitting_poles(response.points, options.order, options.zeros == options.order, delay_s,
                                            kVectorFittingIterations);
    starts.push_back(candidate_at(problem, poles, delay_s, options.order));
  }
  return starts;
}

/// Of a pair: negative where it is complex.
double discriminant(const Section& section) {
  const double a1 = std::exp(section.log_a1);
  return 0.25 * a1 * a1 - std::exp(section.log_a0);
}

std::vector<Complex> poles_of(const Candidate& c) {
  std::vector<Complex> poles;
  for (const Section& section : c.sections) {
    const double a0 = std::exp(section.log_a0);
    if (section.single) {
      poles.emplace_back(-a0);
      continue;
    }
    const double a1 = std::exp(section.log_a1), inside = discriminant(section);
    if (inside < 0) {
      poles.emplace_back(-0.5 * a1, std::sqrt(-inside));
      poles.emplace_back(-0.5 * a1, -std::sqrt(-inside));
    } else {
      const double larger = 0.5 * a1 + std::sqrt(inside);
      poles.emplace_back(-larger);
      poles.emplace_back(-a0 / larger);
    }
  }
  return poles;
}

Polynomial numerator_of(const Problem& problem, const Candidate& c) {
  const auto terms = static_cast<std::size_t>(c.numerator.size());
  Polynomial sum(terms, 0), power{1};
  for (std::size_t i = 0; i < terms; ++i) {
    for (std::size_t j = 0; j < power.size(); ++j) {
      sum[terms - power.size() + j] += static_cast<long double>(c.numerator(static_cast<Index>(i))) * power[j];
    }
    if (i + 1 == terms) break;
    Polynomial next(power.size() + 1, 0);  // (s/ν + 1) times what there was
    for (std::size_t j = 0; j < power.size(); ++j) {
      next[j] += power[j] / problem.corners()[i];
      next[j + 1] += power[j];
    }
    power = std::move(next);
  }
  return sum;
}

/// Pairs real poles with their nearest neighbours: two that met in different sections could not become a complex pair.
std::vector<Section> real_sections(const std::vector<Complex>& poles) {
  std::vector<Section> result;
  std::vector<double> real;
  for (const Complex& p : poles) real.push_back(-p.real());
  std::sort(real.begin(), real.end());
  while (real.size() > 1) {
    std::size_t nearest = 0;
    for (std::size_t i = 1; i + 1 < real.size(); ++i) {
      if (real[i + 1] / real[i] < real[nearest + 1] / real[nearest]) nearest = i;
    }
    const double sum = real[nearest] + real[nearest + 1], product = real[nearest] * real[nearest + 1];
    result.push_back({std::log(sum), std::log(product), false});
    const auto at = real.begin() + static_cast<std::ptrdiff_t>(nearest);
    real.erase(at, at + 2);
  }
  if (!real.empty()) result.push_back({0, std::log(real.front()), true});
  return result;
}

/// The candidate's complex pairs, then the given real poles.
std::vector<Section> with_real_poles(const Candidate& c, const std::vector<Complex>& real) {
  std::vector<Section> sections;
  std::copy_if(c.sections.begin(), c.sections.end(), std::back_inserter(sections),
               [](const Section& section) { return !section.single && discriminant(section) < 0; });
  const std::vector<Section> others = real_sections(real);
  sections.insert(sections.end(), others.begin(), others.end());
  return sections;
}

std::vector<Complex> real_poles_of(const Candidate& c) {
  std::vector<Complex> real = poles_of(c);
  std::erase_if(real, [](const Complex& p) { return p.imag() != 0; });
  return real;
}

/// The candidate with other sections, delay moved, and the numerator fitted anew.
Candidate variant_of(const Problem& problem, const Candidate& c, std::vector<Section> sections, double delay_move = 0) {
  Candidate way = c;
  way.sections = std::move(sections);
  way.delay += delay_move;
  problem.solve_numerator(way);
  return way;
}

using Ways = std::vector<Candidate>;

/// A right zero beyond the band read as the delay it imitates, (s − z)/(s + z) ≈ −e^(−2s/z).
Ways zeros_as_delay(const Problem& problem, const Candidate& c) {
  Ways ways;
  const Polynomial numerator = numerator_of(problem, c);
  if (numerator.size() < 2 || numerator.front() == 0) return ways;
  for (const Complex& z : roots(numerator)) {
    if (z.imag() != 0 || !(z.real() > 0.5 * problem.highest())) continue;
    ways.push_back(variant_of(problem, c, c.sections, 2 / z.real()));
  }
  return ways;
}

Ways delay_moved(const Problem& problem, const Candidate& c) {
  Ways ways;
  for (const double share : kDelayMoves) {
    const double move = share * problem.phase_delay();
    if (c.delay + move >= 0) ways.push_back(variant_of(problem, c, c.sections, move));
  }
  return ways;
}

/// The section that matters least (without it, and the numerator fitted anew, the misfit grows least) elsewhere in the
/// band.
Ways section_moved(const Problem& problem, const Candidate& c) {
  Ways without;
  for (std::size_t i = 0; i < c.sections.size(); ++i) {
    std::vector<Section> rest = c.sections;
    rest.erase(rest.begin() + static_cast<std::ptrdiff_t>(i));
    without.push_back(variant_of(problem, c, rest));
  }
  const auto weakest = static_cast<std::size_t>(lowest_cost(without) - without.begin());
  Ways ways;
  for (const double share : kSpreadShares) {
    const double omega = problem.at_share_of_band(share);
    std::vector<Section> sections = c.sections;
    sections[weakest].log_a0 = (sections[weakest].single ? 1 : 2) * std::log(omega);
    sections[weakest].log_a1 = std::log(omega);
    ways.push_back(variant_of(problem, c, sections));
  }
  return ways;
}

/// The real pole that matters least elsewhere in the band. Noise leaves one far below the band beside a zero that
/// cancels it, in one section with a pole that is needed.
Ways real_pole_moved(const Problem& problem, const Candidate& c) {
  std::vector<Complex> real = real_poles_of(c);
  if (real.empty()) return {};
  Ways without;
  for (std::size_t i = 0; i < real.size(); ++i) {
    std::vector<Complex> rest = real;
    rest.erase(rest.begin() + static_cast<std::ptrdiff_t>(i));
    without.push_back(variant_of(problem, c, with_real_poles(c, rest)));
  }
  const auto weakest = static_cast<std::size_t>(lowest_cost(without) - without.begin());
  Ways ways;
  for (const double share : kSpreadShares) {
    real[weakest] = -problem.at_share_of_band(share);
    ways.push_back(variant_of(problem, c, with_real_poles(c, real)));
  }
  return ways;
}

/// Ways out of a local minimum.
Ways ways_out(const Problem& problem, const Candidate& c, bool fit_delay) {
  std::vector<Ways> kinds{{variant_of(problem, c, with_real_poles(c, real_poles_of(c)))},
                          section_moved(problem, c),
                          real_pole_moved(problem, c)};
  if (fit_delay) {
    kinds.push_back(zeros_as_delay(problem, c));
    kinds.push_back(delay_moved(problem, c));
  }
  Ways all;
  for (Ways& ways : kinds) std::move(ways.begin(), ways.end(), std::back_inserter(all));
  return all;
}

/// All of them a few steps, the better ones some more, the best to its end: near copies of where the search stands
/// begin low and stay there, a pole in a new place begins high and falls.
Candidate winner_of(const Problem& problem, std::vector<Candidate> candidates, int first_iterations,
                    int max_iterations) {
  for (Candidate& c : candidates) refine(problem, c, std::min(first_iterations, max_iterations));
  std::sort(candidates.begin(), candidates.end(), [](const auto& a, const auto& b) { return a.cost < b.cost; });
  candidates.resize(std::min(candidates.size(), kScreened));
  for (Candidate& c : candidates) refine(problem, c, std::min(kScreenIterations, max_iterations));
  Candidate best = *lowest_cost(candidates);
  refine(problem, best, max_iterations);
  return best;
}

Candidate best_of(const Problem& problem, std::vector<Candidate> starts, const RationalFitOptions& options) {
  Candidate best = winner_of(problem, std::move(starts), 0, options.max_iterations);
  if (options.only_given_starts) return best;
  for (int round = 0; round < kRounds; ++round) {
    Candidate way =
        winner_of(problem, ways_out(problem, best, options.fit_delay), kFirstIterations, options.max_iterations);
    if (!(way.cost < (1 - kWorthARound) * best.cost)) return best;
    best = std::move(way);
  }
  return best;
}

/// Covariance of the parameters, scaled by the misfit where it is above what the noise explains.
Eigen::MatrixXd covariance_of(const Eigen::MatrixXd& jacobian, double misfit_per_freedom) {
  const Eigen::VectorXd norms = jacobian.colwise().norm().cwiseMax(1e-300);
  const Eigen::MatrixXd scaled = jacobian * norms.cwiseInverse().asDiagonal();
  const Eigen::MatrixXd inverse = pseudo_inverse(scaled.transpose() * scaled);
  const Eigen::VectorXd back = norms.cwiseInverse();
  return std::max(1.0, misfit_per_freedom) * (back.asDiagonal() * inverse * back.asDiagonal());
}

double spread(const Eigen::RowVectorXcd& gradient, const Eigen::MatrixXd& covariance) {
  return std::sqrt(std::max(0.0, (gradient * covariance * gradient.adjoint())(0).real()));
}

/// δp = −(p δa1 + δa0) / (2p + a1), and δp = −δa0 of a single one.
void add_pole_errors(const Candidate& c, const Eigen::MatrixXd& covariance, double omega_scale, RationalFit& fit) {
  const auto poles = poles_of(c);
  std::size_t at = 0;
  Index column = 0;
  for (const Section& section : c.sections) {
    const double a0 = std::exp(section.log_a0), a1 = std::exp(section.log_a1);
    for (int root = 0; root < (section.single ? 1 : 2); ++root, ++at) {
      Eigen::RowVectorXcd gradient = Eigen::RowVectorXcd::Zero(covariance.cols());
      if (section.single) {
        gradient(column) = -a0;
      } else {
        const Complex slope = 2.0 * poles[at] + a1;
        gradient(column) = -poles[at] * a1 / slope;
        gradient(column + 1) = -a0 / slope;
      }
      const double error = spread(gradient, covariance) * omega_scale;
      fit.pole_std_errors.push_back(std::isfinite(error) ? error : std::numeric_limits<double>::infinity());
    }
    column += section.single ? 1 : 2;
  }
}

/// δz = −Σ N_i(z) δc_i / N'(z).
void add_zero_errors(const Problem& problem, const Candidate& c, const std::vector<Complex>& zeros,
                     const Polynomial& numerator, const Eigen::MatrixXd& covariance, RationalFit& fit) {
  const Index first = Problem::pole_parameters(c);
  Eigen::RowVectorXcd values(c.numerator.size());
  for (const Complex& z : zeros) {
    Complex slope = 0;
    const std::size_t degree = numerator.size() - 1;
    for (std::size_t j = 0; j < degree; ++j) {
      slope = slope * z + static_cast<double>(numerator[j] * static_cast<long double>(degree - j));
    }
    problem.basis(z, values);
    Eigen::RowVectorXcd gradient = Eigen::RowVectorXcd::Zero(covariance.cols());
    gradient.segment(first, values.size()) = -values / slope;
    const double error = spread(gradient, covariance) * problem.omega_scale();
    fit.zero_std_errors.push_back(std::isfinite(error) ? error : std::numeric_limits<double>::infinity());
  }
}

void add_static_gain(const Problem& problem, const Candidate& c, const Eigen::MatrixXd& covariance, RationalFit& fit) {
  double denominator = 1;  // at s = 0
  for (const Section& section : c.sections) denominator *= std::exp(section.log_a0);
  const double gain = c.numerator.sum() / denominator;  // every N_i is 1 at s = 0
  Eigen::RowVectorXcd gradient = Eigen::RowVectorXcd::Zero(covariance.cols());
  Index column = 0;
  for (const Section& section : c.sections) {
    if (!section.single) ++column;
    gradient(column++) = -gain;  // d ln a0
  }
  gradient.segment(column, c.numerator.size()).setConstant(1 / denominator);
  fit.static_gain = gain * problem.gain_scale();
  fit.static_gain_std_error = spread(gradient, covariance) * problem.gain_scale();
}

RationalFit describe(const Problem& problem, const Candidate& c, bool fit_delay) {
  RationalFit fit;
  Eigen::VectorXd e;
  Eigen::MatrixXd jacobian;
  fit.chi_square = problem.residual(c, e, &jacobian);
  fit.parameters = static_cast<int>(jacobian.cols());
  fit.misfit_per_freedom = fit.chi_square / static_cast<double>(jacobian.rows() - jacobian.cols());
  fit.iterations = c.iterations;
  fit.termination = c.termination;
  const Eigen::MatrixXd covariance = covariance_of(jacobian, fit.misfit_per_freedom);
  const double omega = problem.omega_scale();

  TransferFunction& g = fit.transfer_function;
  g.domain = Domain::kS;
  g.poles = poles_of(c);
  Polynomial numerator = numerator_of(problem, c);
  while (numerator.size() > 1 && numerator.front() == 0) numerator.erase(numerator.begin());
  g.zeros = numerator.size() > 1 ? roots(numerator) : std::vector<Complex>{};
  const auto excess = static_cast<double>(g.poles.size()) - static_cast<double>(g.zeros.size());
  g.gain = static_cast<double>(numerator.front()) * problem.gain_scale() * std::pow(omega, excess);
  g.delay_s = c.delay / omega;
  add_zero_errors(problem, c, g.zeros, numerator, covariance, fit);
  add_pole_errors(c, covariance, omega, fit);
  add_static_gain(problem, c, covariance, fit);
  for (Complex& z : g.zeros) z *= omega;
  for (Complex& p : g.poles) p *= omega;
  if (fit_delay) fit.delay_std_error_s = std::sqrt(covariance(covariance.rows() - 1, covariance.cols() - 1)) / omega;
  for (Index k = 0; k < problem.points(); ++k) {
    Eigen::MatrixXd both(2, jacobian.cols());
    both << jacobian.row(k), jacobian.row(problem.points() + k);
    const double variance = (both * covariance * both.transpose()).trace();
    fit.response_std_error.push_back(std::sqrt(std::max(0.0, variance)) / problem.weight(k) * problem.gain_scale());
  }
  return fit;
}

Error bad(const char* field, int value, int least, int most) {
  Error error{.code = "bad_option"};
  error.field = field;
  error.found = fmt::to_string(value);
  error.expected = fmt::format("a whole number from {} to {}", least, most);
  error.message = fmt::format("{} must be {}, not {}", field, error.expected, value);
  return error;
}

Result<void> check(const FrequencyResponse& response, const RationalFitOptions& options) {
  if (options.order < 1 || options.order > kMaxIdentifiedOrder) {
    return tl::unexpected(bad("order", options.order, 1, kMaxIdentifiedOrder));
  }
  if (options.zeros < 0 || options.zeros > options.order) {
    return tl::unexpected(bad("zeros", options.zeros, 0, options.order));
  }
  const int parameters = options.order + options.zeros + 1 + (options.fit_delay ? 1 : 0);
  if (2 * response.points.size() < static_cast<std::size_t>(parameters) + 2) {
    return fail("too_few_points", fmt::format("order {} with {} zeros has {} parameters; {} usable frequencies do not "
                                              "support it",
                                              options.order, options.zeros, parameters, response.points.size()));
  }
  return {};
}

}  // namespace

Result<RationalFit> fit_rational(const FrequencyResponse& response, const RationalFitOptions& options) {
  if (auto checked = check(response, options); !checked) return tl::unexpected(checked.error());
  const Problem problem(response, options);
  const Candidate best = best_of(problem, starts_of(response, problem, options), options);
  return describe(problem, best, options.fit_delay);
}

std::vector<Complex> sampled_response(const TransferFunction& g, const FrequencyResponse& response) {
  if (response.points.empty()) return {};
  const int images = images_for(response);
  std::vector<Complex> values;
  for (const ResponsePoint& p : response.points) {
    Complex sum = 0;
    for (int l = -images; l <= images; ++l) {
      const double f = images > 0 ? p.frequency_hz + l / response.sample_period_s : p.frequency_hz;
      const Complex factor = images > 0 ? hold_factor(response.hold, f, response.sample_period_s) /
                                              hold_factor(response.hold, p.frequency_hz, response.sample_period_s)
                                        : 1;
      sum += factor * frequency_response(g, std::span(&f, 1))[0];
    }
    values.push_back(sum);
  }
  return values;
}

}  // namespace valvetriage
