#include "core/residual/findings.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <complex>
#include <limits>
#include <numeric>
#include <optional>

#include "core/identify/spectrum.h"
#include "core/model/magnetic_loop.h"
#include "core/statistics/distributions.h"

namespace valvetriage {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr int kBins = 8;
constexpr std::size_t kShortestBlock = 50;
constexpr std::size_t kFewestBlocks = 30;
constexpr double kFewestFreedoms = 3;  // below, a t says nothing
constexpr int kDependences = 11;       // that pay for each other

using Column = std::vector<double>;

/// All valid samples of all recordings, one after the other, in blocks.
struct Samples {
  Column e, level, simulated, direction, rate;
  std::vector<int> block, recording;
  std::vector<std::size_t> at;  ///< sample inside its recording
  int blocks = 0;
  double structured = 0;  ///< sum of squares above the noise floors

  std::size_t size() const { return e.size(); }
};

/// Lag at which the autocorrelation of a residual, freed of its mean, falls below a tenth.
std::size_t correlation_length(std::span<const double> e) {
  const double mean =
      std::accumulate(e.begin(), e.end(), 0.0) / static_cast<double>(std::max<std::size_t>(e.size(), 1));
  double power = 0;
  for (const double value : e) power += (value - mean) * (value - mean);
  const std::size_t most = e.size() / 8;
  for (std::size_t lag = 1; lag < most; ++lag) {
    double sum = 0;
    for (std::size_t i = lag; i < e.size(); ++i) sum += (e[i] - mean) * (e[i - lag] - mean);
    if (sum < 0.1 * power) return lag;
  }
  return std::max<std::size_t>(most, 1);
}

/// Ten correlation lengths, but never so long that too few blocks are left to tell a spread from.
std::size_t block_length(std::span<const ResidualView> views) {
  std::size_t total = 0, longest = 1;
  for (const ResidualView& view : views) {
    total += view.residual.size();
    longest =
        std::max(longest, correlation_length(view.residual.first(std::min<std::size_t>(view.residual.size(), 4096))));
  }
  const std::size_t most = std::max<std::size_t>(total / kFewestBlocks, 8);
  return std::min(std::max(10 * longest, kShortestBlock), most);
}

/// The side the level was last reached from: +1, −1, 0 before the input first moved.
Column last_direction(const Column& driver) {
  Column direction(driver.size(), 0.0);
  double last = 0;
  for (std::size_t i = 1; i < driver.size(); ++i) {
    if (driver[i] != driver[i - 1]) last = driver[i] > driver[i - 1] ? 1 : -1;
    direction[i] = last;
  }
  return direction;
}

Samples gather(std::span<const ResidualView> views) {
  Samples all;
  const std::size_t length = block_length(views);
  double floor = 0, total = 0;
  for (std::size_t r = 0; r < views.size(); ++r) {
    const Recording& recording = *views[r].recording;
    const IntervalSignal input = noise_free_input(recording);
    const Column driver = loop_driver(input, loop_gate(input));
    const Column direction = last_direction(driver);
    const std::size_t n = std::min({views[r].residual.size(), driver.size(), recording.output.values.size()});
    const std::size_t blocks = std::max<std::size_t>(n / length, 1);
    for (std::size_t i = 0; i < n; ++i) {
      if (!recording.is_valid(i)) continue;
      const auto simulated = [&](std::size_t k) { return recording.output.values[k] - views[r].residual[k]; };
      const std::size_t before = i > 0 ? i - 1 : 0, after = std::min(i + 1, n - 1);
      all.e.push_back(views[r].residual[i]);
      all.level.push_back(driver[i]);
      all.direction.push_back(direction[i]);
      all.simulated.push_back(simulated(i));
      all.rate.push_back((simulated(after) - simulated(before)) /
                         (static_cast<double>(std::max<std::size_t>(after - before, 1)) * recording.sample_period_s));
      all.block.push_back(all.blocks + static_cast<int>(std::min(i / length, blocks - 1)));
      all.recording.push_back(static_cast<int>(r));
      all.at.push_back(i);
      floor += views[r].noise_floor * views[r].noise_floor;
      total += views[r].residual[i] * views[r].residual[i];
    }
    all.blocks += static_cast<int>(blocks);
  }
  all.structured = std::max(total - floor, 0.0);
  return all;
}

/// A clustered t: scores and weights summed by block.
struct Clustered {
  double effect = 0;  ///< coefficient of the regressor
  double t = 0;
  double p = 1;
  double explained = 0;  ///< sum of squares, freed of what noise would explain
};

/// t of Σ x e with x given per sample (0 where it takes no part).
///
///   β = Σ x e / Σ x²,  u_b = Σ_{t∈b} x (e − β x),  V = Σ u_b² + Σ u_b u_{b+1},  t = Σ x e / √V
Clustered clustered_t(const Samples& all, const Column& e, const Column& x) {
  Column score(static_cast<std::size_t>(all.blocks), 0.0), weight = score;
  double sum = 0, square = 0;
  for (std::size_t i = 0; i < all.size(); ++i) {
    const auto b = static_cast<std::size_t>(all.block[i]);
    score[b] += x[i] * e[i];
    weight[b] += x[i] * x[i];
    sum += x[i] * e[i];
    square += x[i] * x[i];
  }
  Clustered result;
  if (!(square > 0)) return result;
  result.effect = sum / square;
  double fourth = 0, variance = 0, neighbours = 0, before = 0;
  for (std::size_t b = 0; b < score.size(); ++b) {
    const double u = score[b] - result.effect * weight[b];
    variance += u * u;
    neighbours += u * before;
    before = u;
    fourth += weight[b] * weight[b];
  }
  const double carriers = square * square / fourth;
  const double freedoms = carriers - 1;
  if (freedoms < kFewestFreedoms) return result;
  // Blocks that answer each other in turn must not make the sum look certain.
  variance = std::max(variance + neighbours, variance) * carriers / freedoms;
  if (!(variance > 0)) return result;
  result.t = sum / std::sqrt(variance);
  result.p = 2 * student_t_upper_tail(freedoms, std::abs(result.t));
  result.explained = std::max((sum * sum - variance) / square, 0.0);
  return result;
}

/// A bin per sample, −1 for none.
struct Bins {
  std::vector<int> of;
  int count = 0;
  double low = 0, width = 0;

  std::string place(int bin, std::string_view unit) const {
    return fmt::format("{:.4g} to {:.4g}{}{}", low + bin * width, low + (bin + 1) * width, unit.empty() ? "" : " ",
                       unit);
  }
};

Bins bins_of(const Column& values) {
  Bins bins{.of = std::vector<int>(values.size(), 0), .count = 1};
  const auto [low, high] = std::minmax_element(values.begin(), values.end());
  if (values.empty() || !(*high > *low)) return bins;
  bins.count = kBins;
  bins.low = *low;
  bins.width = (*high - *low) / kBins;
  for (std::size_t i = 0; i < values.size(); ++i) {
    bins.of[i] = std::min(static_cast<int>((values[i] - bins.low) / bins.width), kBins - 1);
  }
  return bins;
}

/// A column with the mean of each bin taken off.
Column freed_of(const Column& x, const Bins& bins) {
  Column sum(static_cast<std::size_t>(bins.count), 0.0), number = sum;
  for (std::size_t i = 0; i < x.size(); ++i) {
    sum[static_cast<std::size_t>(bins.of[i])] += x[i];
    number[static_cast<std::size_t>(bins.of[i])] += 1;
  }
  Column freed = x;
  for (std::size_t i = 0; i < x.size(); ++i) {
    const auto b = static_cast<std::size_t>(bins.of[i]);
    freed[i] -= sum[b] / number[b];
  }
  return freed;
}

double bonferroni(double p, double tried) {
  return std::min(1.0, p * tried);
}

class Search {
 public:
  Search(std::span<const ResidualView> views, double significance)
      : views_(views), all_(gather(views)), level_bins_(bins_of(all_.level)), limit_(significance / kDependences) {}

  std::vector<Finding> run() {
    if (all_.size() == 0) return {};
    const Recording& first = *views_.front().recording;
    on_bins("depends on the input's level", level_bins_, first.input.unit);
    on_bins("depends on the output", bins_of(all_.simulated), first.output.unit);
    on_regressor("depends on the sign of the input's change", all_.direction, level_bins_,
                 [](double effect) { return effect > 0 ? "higher after a rise" : "higher after a fall"; });
    on_regressor("depends on the rate of the output", all_.rate, level_bins_, [](double effect) {
      return fmt::format("{} by {:.2g} ms", effect > 0 ? "ahead" : "behind", 1000 * std::abs(effect));
    });
    on_time_since_step();
    on_time();
    on_side_channels();
    on_lines();
    on_places("is larger in one recording", true);
    on_places("is larger in one segment", false);
    on_local_variance();
    std::stable_sort(found_.begin(), found_.end(), [](const Finding& a, const Finding& b) {
      const auto share = [](const Finding& f) {
        return std::isnan(f.share_of_structured_residual) ? -1 : f.share_of_structured_residual;
      };
      return share(a) > share(b);
    });
    return found_;
  }

 private:
  double share(double explained) const {
    const double whole = std::max(all_.structured, explained);
    return whole > 0 ? explained / whole : 0;
  }

  void add(std::string what, std::string where, double statistic, double p, double share_of_residual) {
    if (p < limit_) found_.push_back({std::move(what), std::move(where), statistic, p, share_of_residual});
  }

  /// The bin that stands out most tells where; all of them tell the share.
  void on_bins(const char* what, const Bins& bins, const std::string& unit) {
    Clustered most;
    int at = 0;
    double explained = 0;
    for (int bin = 0; bin < bins.count; ++bin) {
      Column inside(all_.size());
      for (std::size_t i = 0; i < inside.size(); ++i) inside[i] = bins.of[i] == bin ? 1 : 0;
      const Clustered t = clustered_t(all_, all_.e, inside);
      explained += t.explained;
      if (t.p < most.p) {
        most = t;
        at = bin;
      }
    }
    add(what, fmt::format("{}: {:+.3g} on average", bins.place(at, unit), most.effect), most.t,
        bonferroni(most.p, bins.count), share(explained));
  }

  /// What the bins explain is taken from both sides first, so that it neither counts nor spreads.
  template <typename Where>
  void on_regressor(const char* what, const Column& x, const Bins& bins, Where where) {
    const Clustered t = clustered_t(all_, freed_of(all_.e, bins), freed_of(x, bins));
    add(what, where(t.effect), t.t, t.p, share(t.explained));
  }

  /// Windows behind the steps, the residual counted in the direction of the step.
  void on_time_since_step() {
    constexpr double kEdges_s[] = {0, 0.03, 0.1, 0.3, 1.0, 3.0};
    constexpr int kWindows = 5;
    Column since(all_.size(), -1), sign(all_.size(), 0.0);
    for (std::size_t i = 0; i < all_.size(); ++i) {
      const Recording& recording = *views_[static_cast<std::size_t>(all_.recording[i])].recording;
      for (const Segment& segment : recording.segments) {
        if (segment.kind != SegmentKind::kStep || all_.at[i] < segment.begin || all_.at[i] >= segment.end) continue;
        since[i] = static_cast<double>(all_.at[i] - segment.begin) * recording.sample_period_s;
        sign[i] = segment.level > segment.from_level ? 1 : -1;
      }
    }
    Clustered most;
    int at = 0;
    double explained = 0;
    for (int w = 0; w < kWindows; ++w) {
      Column inside(all_.size(), 0.0);
      for (std::size_t i = 0; i < inside.size(); ++i) {
        if (since[i] >= kEdges_s[w] && since[i] < kEdges_s[w + 1]) inside[i] = sign[i];
      }
      const Clustered t = clustered_t(all_, all_.e, inside);
      explained += t.explained;
      if (t.p < most.p) {
        most = t;
        at = w;
      }
    }
    add("depends on the time since a step",
        fmt::format("{:g} to {:g} s after it: {:+.3g} in its direction", kEdges_s[at], kEdges_s[at + 1], most.effect),
        most.t, bonferroni(most.p, kWindows), share(explained));
  }

  void on_time() {
    Column t(all_.size());
    for (std::size_t i = 0; i < t.size(); ++i) {
      const Recording& recording = *views_[static_cast<std::size_t>(all_.recording[i])].recording;
      const double middle = 0.5 * static_cast<double>(recording.samples() - 1);
      t[i] = (static_cast<double>(all_.at[i]) - middle) * recording.sample_period_s;
    }
    on_regressor("depends on time", t, by_recording(level_bins_),
                 [](double effect) { return fmt::format("{:+.3g} per second of each recording", effect); });
  }

  /// The same bins, for each recording its own.
  Bins by_recording(Bins bins) const {
    for (std::size_t i = 0; i < bins.of.size(); ++i) bins.of[i] += all_.recording[i] * bins.count;
    bins.count *= static_cast<int>(views_.size());
    return bins;
  }

  /// Channels by name, each less its mean in the recording.
  void on_side_channels() {
    std::vector<std::string> names;
    for (const ResidualView& view : views_) {
      for (const Channel& channel : view.recording->side) {
        if (std::find(names.begin(), names.end(), channel.name) == names.end()) names.push_back(channel.name);
      }
    }
    for (const std::string& name : names) {
      const Bins recordings = by_recording({.of = std::vector<int>(all_.size(), 0), .count = 1});
      const Clustered t = clustered_t(all_, freed_of(all_.e, recordings), freed_of(side_column(name), recordings));
      add("depends on a side channel", fmt::format("{}: {:+.3g} per unit", name, t.effect), t.t,
          bonferroni(t.p, static_cast<double>(names.size())), share(t.explained));
    }
  }

  Column side_column(const std::string& name) const {
    Column x(all_.size(), 0.0);
    for (std::size_t r = 0; r < views_.size(); ++r) {
      const auto& side = views_[r].recording->side;
      const auto channel = std::find_if(side.begin(), side.end(), [&](const Channel& c) { return c.name == name; });
      if (channel == side.end() || channel->values.empty()) continue;
      const double mean = std::accumulate(channel->values.begin(), channel->values.end(), 0.0) /
                          static_cast<double>(channel->values.size());
      for (std::size_t i = 0; i < x.size(); ++i) {
        if (all_.recording[i] == static_cast<int>(r)) x[i] = channel->values[all_.at[i]] - mean;
      }
    }
    return x;
  }

  /// The strongest line of any recording against the mean of its neighbours: with 2M of them and noise that is smooth
  /// over them, P(ratio > q) = (1 + q / M)^−M (an F of 2 and 2M degrees). A line that the simulation has as well is the
  /// input's doing: of a multisine every misfit is one, and so is ripple that the sampling folds back into its log.
  void on_lines() {
    struct Line {
      double p = 1, frequency_hz = 0, ratio = 0, power = 0;
      std::size_t recording = 0;
    } strongest;
    double tried = 0;
    for (std::size_t r = 0; r < views_.size(); ++r) {
      const auto [power, n] = periodogram(*views_[r].recording, views_[r].residual);
      constexpr std::size_t kReach = 20, kGuard = 2;
      if (power.size() < 2 * kReach + 10) continue;
      const auto of_simulation = periodogram(*views_[r].recording, simulated(views_[r])).first;
      for (std::size_t k = kReach; k + kReach < power.size(); ++k) {
        double around = 0;
        for (std::size_t j = k - kReach; j <= k + kReach; ++j) {
          if (j + kGuard < k || j > k + kGuard) around += power[j];
        }
        constexpr double kNeighbours = 2 * (kReach - kGuard);
        const double ratio = around > 0 ? power[k] / (around / kNeighbours) : 0;
        const double p = std::pow(1 + ratio / kNeighbours, -kNeighbours);
        tried += 1;
        if (p < strongest.p && !is_line_of(of_simulation, k, kReach, power[k])) {
          const double period_s = views_[r].recording->sample_period_s;
          strongest = {p, static_cast<double>(k) / (static_cast<double>(n) * period_s), ratio, power[k], r};
        }
      }
    }
    if (tried == 0) return;
    const std::string where =
        fmt::format("{:.4g} Hz in {}", strongest.frequency_hz, views_[strongest.recording].recording->name);
    add("has a line", where, strongest.ratio, bonferroni(strongest.p, tried), share(strongest.power));
  }

  static Column simulated(const ResidualView& view) {
    Column y(view.residual.size());
    for (std::size_t i = 0; i < y.size(); ++i) y[i] = view.recording->output.values[i] - view.residual[i];
    return y;
  }

  /// Whether a spectrum has a line at k which may be the cause of `power` there: above the quietest quarter of its
  /// neighbours (beside a fold lie the multisine's own lines), and as strong.
  static bool is_line_of(const Column& spectrum, std::size_t k, std::size_t reach, double power) {
    constexpr double kAbove = 10, kAsStrong = 0.25;
    if (spectrum[k] < kAsStrong * power) return false;
    const auto at = spectrum.begin() + static_cast<std::ptrdiff_t>(k);
    Column around(at - static_cast<std::ptrdiff_t>(reach), at + static_cast<std::ptrdiff_t>(reach) + 1);
    const auto quarter = around.begin() + static_cast<std::ptrdiff_t>(around.size() / 4);
    std::nth_element(around.begin(), quarter, around.end());
    return spectrum[k] > kAbove * *quarter;
  }

  /// Sum of squares at each frequency of a signal freed of its straight line, on a length that the FFT is quick at.
  static std::pair<Column, std::size_t> periodogram(const Recording& recording, std::span<const double> signal) {
    const std::size_t n = smooth_length_below(std::max<std::size_t>(signal.size(), 1));
    if (n < 64) return {{}, n};
    std::vector<double> e(n);
    double sum = 0, moment = 0;
    const double middle = 0.5 * static_cast<double>(n - 1);
    for (std::size_t i = 0; i < n; ++i) {
      e[i] = recording.is_valid(i) ? signal[i] : 0;
      sum += e[i];
      moment += (static_cast<double>(i) - middle) * e[i];
    }
    const double count = static_cast<double>(n);
    const double slope = moment / (count * (count * count - 1) / 12);
    for (std::size_t i = 0; i < n; ++i) e[i] -= sum / count + slope * (static_cast<double>(i) - middle);
    const std::vector<std::complex<double>> lines = spectrum(e);
    Column power(n / 2);
    for (std::size_t k = 0; k < power.size(); ++k) power[k] = 2 * std::norm(lines[k]) / count;
    return {power, n};
  }

  struct Place {
    std::string name;
    std::vector<char> inside;  ///< by block
  };

  /// Log mean square of each block; `differenced` takes smooth structure out of it first.
  Column log_power(bool differenced) const {
    Column sum(static_cast<std::size_t>(all_.blocks), 0.0), number = sum;
    for (std::size_t i = 2; i < all_.size(); ++i) {
      if (all_.block[i] != all_.block[i - 2]) continue;
      const double value = differenced ? all_.e[i] - 2 * all_.e[i - 1] + all_.e[i - 2] : all_.e[i];
      sum[static_cast<std::size_t>(all_.block[i])] += value * value;
      number[static_cast<std::size_t>(all_.block[i])] += 1;
    }
    for (std::size_t b = 0; b < sum.size(); ++b)
      sum[b] = number[b] > 4 && sum[b] > 0 ? std::log(sum[b] / number[b]) : kNaN;
    return sum;
  }

  /// Welch's t between the blocks inside and the others; one-sided, for larger inside.
  static Clustered larger_inside(const Column& values, const std::vector<char>& inside, bool both_sides) {
    double n[2] = {0, 0}, mean[2] = {0, 0}, square[2] = {0, 0};
    for (std::size_t b = 0; b < values.size(); ++b) {
      if (std::isnan(values[b])) continue;
      const int side = inside[b] ? 1 : 0;
      n[side] += 1;
      mean[side] += values[b];
      square[side] += values[b] * values[b];
    }
    Clustered result;
    if (n[0] < 4 || n[1] < 4) return result;
    double error = 0, fourth = 0;
    for (int side = 0; side < 2; ++side) {
      mean[side] /= n[side];
      const double variance = std::max(square[side] / n[side] - mean[side] * mean[side], 0.0) * n[side] / (n[side] - 1);
      error += variance / n[side];
      fourth += std::pow(variance / n[side], 2) / (n[side] - 1);
    }
    if (!(error > 0)) return result;
    result.t = (mean[1] - mean[0]) / std::sqrt(error);
    const double freedoms = std::max(error * error / fourth, 1.0);
    result.p =
        both_sides ? 2 * student_t_upper_tail(freedoms, std::abs(result.t)) : student_t_upper_tail(freedoms, result.t);
    result.effect = std::exp(0.5 * (mean[1] - mean[0]));
    return result;
  }

  std::vector<Place> places(bool recordings) const {
    std::vector<Place> list;
    for (std::size_t r = 0; r < views_.size(); ++r) {
      const Recording& recording = *views_[r].recording;
      if (recordings) {
        list.push_back({recording.name, inside(r, 0, recording.samples())});
        continue;
      }
      for (const Segment& segment : recording.segments) {
        list.push_back({fmt::format("{}, {:.4g} to {:.4g} s", recording.name,
                                    static_cast<double>(segment.begin) * recording.sample_period_s,
                                    static_cast<double>(segment.end) * recording.sample_period_s),
                        inside(r, segment.begin, segment.end)});
      }
    }
    return list;
  }

  std::vector<char> inside(std::size_t recording, std::size_t begin, std::size_t end) const {
    std::vector<char> blocks(static_cast<std::size_t>(all_.blocks), 0);
    for (std::size_t i = 0; i < all_.size(); ++i) {
      const bool is = all_.recording[i] == static_cast<int>(recording) && all_.at[i] >= begin && all_.at[i] < end;
      if (is) blocks[static_cast<std::size_t>(all_.block[i])] = 1;
    }
    return blocks;
  }

  void on_places(const char* what, bool recordings) {
    const Column power = log_power(false);
    const std::vector<Place> list = places(recordings);
    Clustered most;
    const Place* at = nullptr;
    for (const Place& place : list) {
      const Clustered t = larger_inside(power, place.inside, false);
      if (t.p < most.p) {
        most = t;
        at = &place;
      }
    }
    if (!at) return;
    double inside_square = 0, floor = 0;
    for (std::size_t i = 0; i < all_.size(); ++i) {
      if (!at->inside[static_cast<std::size_t>(all_.block[i])]) continue;
      inside_square += all_.e[i] * all_.e[i];
      floor += std::pow(views_[static_cast<std::size_t>(all_.recording[i])].noise_floor, 2);
    }
    add(what, fmt::format("{}: {:.2g} times the rms elsewhere", at->name, most.effect), most.t,
        bonferroni(most.p, static_cast<double>(list.size())), share(std::max(inside_square - floor, 0.0)));
  }

  /// Blocks by the bin of their mean level.
  void on_local_variance() {
    Column level(static_cast<std::size_t>(all_.blocks), 0.0), number = level;
    for (std::size_t i = 0; i < all_.size(); ++i) {
      level[static_cast<std::size_t>(all_.block[i])] += all_.level[i];
      number[static_cast<std::size_t>(all_.block[i])] += 1;
    }
    for (std::size_t b = 0; b < level.size(); ++b) level[b] /= std::max(number[b], 1.0);
    const Bins bins = bins_of(level);
    const Column power = log_power(true);
    Clustered most;
    int at = 0;
    for (int bin = 0; bin < bins.count; ++bin) {
      std::vector<char> inside(level.size());
      for (std::size_t b = 0; b < level.size(); ++b) inside[b] = bins.of[b] == bin;
      const Clustered t = larger_inside(power, inside, true);
      if (t.p < most.p) {
        most = t;
        at = bin;
      }
    }
    add("its noise depends on the input's level",
        fmt::format("{}: {:.2g} times as large", bins.place(at, views_.front().recording->input.unit), most.effect),
        most.t, bonferroni(most.p, bins.count), kNaN);
  }

  std::span<const ResidualView> views_;
  Samples all_;
  Bins level_bins_;
  double limit_;
  std::vector<Finding> found_;
};

}  // namespace

std::vector<Finding> find_dependences(std::span<const ResidualView> recordings, const FindingOptions& options) {
  if (recordings.empty()) return {};
  return Search(recordings, options.significance).run();
}

}  // namespace valvetriage
