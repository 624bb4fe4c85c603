#include "core/model/linear_filter.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace valvetriage {
namespace {

constexpr int kMaxUnrolledOrder = 10;

// A response that decays to nothing would spend its days in subnormal numbers, a hundred times slower; below this it is
// zero to any output that matters. Looked at once per block.
constexpr double kNegligibleState = 1e-200;
constexpr std::size_t kFlushBlock = 512;

// z-domain delays are written in seconds: a whole number of samples up to this much rounding.
constexpr double kSampleTolerance = 1e-6;

/// Everything a kernel reads: coefficients, and the delayed input with its rise, each valid from index −1.
struct Job {
  std::size_t order;
  const double* diagonal;
  const double* lower;
  const double* input;   // order × columns
  const double* direct;  // columns
  const double* u;
  const double* rise;
};

template <int Columns>
inline double weighted(const double* weight, const double* u, const double* rise, std::size_t k) {
  double sum = weight[0] * u[k];
  if constexpr (Columns >= 2) sum += weight[1] * rise[k];
  if constexpr (Columns == 4) sum += weight[2] * u[k - 1] + weight[3] * rise[k - 1];
  return sum;
}

// x_j⁺ = diagonal_j x_j + lower_j x_{j−1} + x_{j+1} + input_j · columns,  y = x_0 + direct · columns
template <int Order, int Columns>
void advance(const Job& job, double* state, std::size_t begin, std::size_t end, double* y) {
  constexpr int kOrder = Order;
  std::array<double, kOrder + 2> x{};  // x[0] and x[Order + 1] stay zero
  std::array<double, kOrder> diagonal, lower;
  std::array<double, kOrder * Columns> weight;
  std::array<double, Columns> direct;
  std::copy_n(state, Order, x.begin() + 1);
  std::copy_n(job.diagonal, Order, diagonal.begin());
  std::copy_n(job.lower, Order, lower.begin());
  std::copy_n(job.input, Order * Columns, weight.begin());
  std::copy_n(job.direct, Columns, direct.begin());
  for (std::size_t k = begin; k < end; ++k) {
    y[k] = x[1] + weighted<Columns>(direct.data(), job.u, job.rise, k);
    double before = 0;
    for (int j = 0; j < Order; ++j) {
      const double next = diagonal[j] * x[j + 1] + lower[j] * before + x[j + 2] +
                          weighted<Columns>(weight.data() + j * Columns, job.u, job.rise, k);
      before = x[j + 1];
      x[j + 1] = next;
    }
  }
  std::copy_n(x.begin() + 1, Order, state);
}

// The same for orders beyond the unrolled ones.
template <int Columns>
void advance_any(const Job& job, double* state, std::size_t begin, std::size_t end, double* y) {
  for (std::size_t k = begin; k < end; ++k) {
    y[k] = (job.order > 0 ? state[0] : 0.0) + weighted<Columns>(job.direct, job.u, job.rise, k);
    double before = 0;
    for (std::size_t j = 0; j < job.order; ++j) {
      const double above = j + 1 < job.order ? state[j + 1] : 0.0;
      const double next = job.diagonal[j] * state[j] + job.lower[j] * before + above +
                          weighted<Columns>(job.input + j * Columns, job.u, job.rise, k);
      before = state[j];
      state[j] = next;
    }
  }
}

using Kernel = void (*)(const Job&, double*, std::size_t, std::size_t, double*);

template <int Columns, int... Orders>
constexpr std::array<Kernel, sizeof...(Orders)> kernels(std::integer_sequence<int, Orders...>) {
  return {&advance<Orders + 1, Columns>...};
}

template <int Columns>
Kernel kernel_for(std::size_t order) {
  static constexpr auto kTable = kernels<Columns>(std::make_integer_sequence<int, kMaxUnrolledOrder>{});
  return order >= 1 && order <= kTable.size() ? kTable[order - 1] : &advance_any<Columns>;
}

Kernel kernel_for(std::size_t order, Eigen::Index columns) {
  if (columns == 1) return kernel_for<1>(order);
  return columns == 2 ? kernel_for<2>(order) : kernel_for<4>(order);
}

/// The input behind the whole part of the delay, from index −1, and its rise over each interval.
class DelayedInput {
 public:
  DelayedInput(std::span<const double> input, std::size_t delay, double past) : values_(input.size() + 1, past) {
    const std::size_t seen = input.size() - std::min(delay, input.size());
    std::copy_n(input.begin(), seen, values_.end() - static_cast<std::ptrdiff_t>(seen));
  }
  void add_rises(std::span<const double> input, std::span<const double> end, std::size_t delay) {
    rise_.assign(values_.size(), 0.0);
    for (std::size_t i = 0; i + delay < input.size(); ++i) rise_[i + delay + 1] = end[i] - input[i];
  }
  const double* values() const { return values_.data() + 1; }
  const double* rise() const { return rise_.data() + 1; }

 private:
  std::vector<double> values_, rise_;
};

void advance_flushing(Kernel kernel, const Job& job, std::vector<double>& x, std::span<double> output) {
  for (std::size_t begin = 0; begin < output.size(); begin += kFlushBlock) {
    kernel(job, x.data(), begin, std::min(begin + kFlushBlock, output.size()), output.data());
    for (double& value : x) {
      if (std::abs(value) < kNegligibleState) value = 0;
    }
  }
}

}  // namespace

LinearFilter::LinearFilter(ChainForm chain, int delay_samples)
    : chain_(std::move(chain)), delay_samples_(delay_samples) {
  for (Eigen::Index j = 0; j < chain_.input.rows(); ++j) {
    for (Eigen::Index c = 0; c < chain_.input.cols(); ++c) input_.push_back(chain_.input(j, c));
  }
  direct_.assign(chain_.direct.begin(), chain_.direct.end());
}

Result<LinearFilter> LinearFilter::recursion(const TransferFunction& discrete) {
  const auto system = cascade(discrete);
  if (!system) return tl::unexpected(system.error());
  int delay = 0;
  if (discrete.delay_s != 0) {
    const double samples = discrete.delay_s / discrete.sample_time_s;
    const double nearest = std::round(samples);
    if (!(std::abs(samples - nearest) < kSampleTolerance)) {
      return fail("fractional_delay", fmt::format("the delay {} s is not a whole number of sample times of {} s",
                                                  discrete.delay_s, discrete.sample_time_s));
    }
    delay = static_cast<int>(std::min(nearest, kMostDelaySamples));
  }
  const Eigen::RowVectorXd direct = Eigen::RowVectorXd::Constant(1, system->d);
  return LinearFilter(chain_form(system->a, system->b, system->c, direct, system->blocks), delay);
}

Result<LinearFilter> LinearFilter::sampled(const TransferFunction& continuous, double sample_time_s) {
  const auto system = sample(continuous, sample_time_s);
  if (!system) return tl::unexpected(system.error());
  return LinearFilter(chain_form(system->phi, system->gamma, system->c, system->direct, system->blocks),
                      split_delay(continuous.delay_s, sample_time_s).whole);
}

FilterState LinearFilter::rest() const {
  return {std::vector<double>(order(), 0.0), 0};
}

std::optional<FilterState> LinearFilter::steady(double input) const {
  FilterState state{std::vector<double>(order(), 0.0), input};
  // A constant input enters through the value columns only.
  const auto drive = [&](Eigen::Index row) {
    return input * (chain_.input(row, 0) + (chain_.input.cols() == 4 ? chain_.input(row, 2) : 0.0));
  };
  auto row = static_cast<Eigen::Index>(order());
  double above = 0;
  for (auto block = chain_.blocks.rbegin(); block != chain_.blocks.rend(); ++block) {
    const double gap = 1 - block->re;
    if (block->is_pair()) {
      row -= 2;
      const double square = block->im * block->im;
      const double first = drive(row), second = drive(row + 1) + above;
      const double determinant = gap * gap + square;
      state.x[row] = (gap * first + second) / determinant;
      state.x[row + 1] = (gap * second - square * first) / determinant;
    } else {
      if (gap == 0) return std::nullopt;
      --row;
      state.x[row] = (drive(row) + above) / gap;
    }
    above = state.x[row];
  }
  return state;
}

void LinearFilter::run(FilterState& state, std::span<const double> input, std::span<const double> end,
                       std::span<double> output) const {
  if (input.empty()) return;
  const Eigen::Index columns = chain_.input.cols();
  const Kernel kernel = kernel_for(order(), columns);
  Job job{order(), chain_.diagonal.data(), chain_.lower.data(), input_.data(), direct_.data(), input.data(), nullptr};
  if (columns == 1 && delay_samples_ == 0) {
    advance_flushing(kernel, job, state.x, output);
  } else {
    const auto delay = static_cast<std::size_t>(delay_samples_);
    DelayedInput delayed(input, delay, state.past);
    if (columns > 1) delayed.add_rises(input, end, delay);
    job.u = delayed.values();
    job.rise = delayed.rise();
    advance_flushing(kernel, job, state.x, output);
  }
  state.past = input.back();
}

}  // namespace valvetriage
