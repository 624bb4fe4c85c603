// Sample-and-hold equivalents: transfer functions between the s and the z domain.
#include <fmt/format.h>

#include <cmath>
#include <unsupported/Eigen/MatrixFunctions>

#include "core/model/state_space.h"
#include "core/model/transfer_function.h"

namespace valvetriage {
namespace {

using Complex = std::complex<double>;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::RowVectorXd;
using Eigen::VectorXd;

// A logarithm's rounding stands where a true continuous system has no term; at the Nyquist rate this much is nothing.
constexpr double kLogarithmRounding = 1e-10;

/// x⁺ = Φ x + now u_k + before u_{k−1},  y = C x + direct_now u_k + direct_before u_{k−1}
struct TwoTap {
  MatrixXd phi;
  VectorXd now, before;
  RowVectorXd c;
  double direct_now = 0, direct_before = 0;
  std::vector<PoleBlock> blocks;
  bool has_before = false;
};

TransferFunction transfer_function_of(const TwoTap& system) {
  if (!system.has_before) {
    const RowVectorXd direct = RowVectorXd::Constant(1, system.direct_now);
    return chain_transfer_function(chain_form(system.phi, system.now, system.c, direct, system.blocks), Domain::kZ, 0);
  }
  // The previous input is a state in front of all others, with its pole at z = 0.
  const Index n = system.phi.rows();
  MatrixXd phi = MatrixXd::Zero(n + 1, n + 1);
  phi.block(1, 0, n, 1) = system.before;
  phi.bottomRightCorner(n, n) = system.phi;
  VectorXd gamma(n + 1);
  gamma << 1, system.now;
  RowVectorXd c(n + 1);
  c << system.direct_before, system.c;
  std::vector<PoleBlock> blocks = system.blocks;
  blocks.push_back({0, 0});
  const RowVectorXd direct = RowVectorXd::Constant(1, system.direct_now);
  return chain_transfer_function(chain_form(phi, gamma, c, direct, blocks), Domain::kZ, 0);
}

TransferFunction with_clock(TransferFunction g, double sample_time_s, int delay_samples) {
  g.sample_time_s = sample_time_s;
  g.delay_s = delay_samples * sample_time_s;
  return g;
}

Result<void> require_continuous(const TransferFunction& g) {
  if (g.domain == Domain::kS) return {};
  return fail("wrong_domain", "the transfer function is discrete already; a continuous one is needed");
}

}  // namespace

Result<TransferFunction> discretise_zoh(const TransferFunction& continuous, double sample_time_s) {
  if (const auto ok = require_continuous(continuous); !ok) return tl::unexpected(ok.error());
  const auto sampled = sample(continuous, sample_time_s);
  if (!sampled) return tl::unexpected(sampled.error());
  TwoTap system{.phi = sampled->phi,
                .now = sampled->gamma.col(0),
                .before = {},
                .c = sampled->c,
                .direct_now = sampled->direct[0],
                .blocks = sampled->blocks};
  if (sampled->gamma.cols() == 4) {
    system.has_before = true;
    system.before = sampled->gamma.col(2);
    system.direct_before = sampled->direct[2];
  }
  return with_clock(transfer_function_of(system), sample_time_s, split_delay(continuous.delay_s, sample_time_s).whole);
}

Result<TransferFunction> discretise_foh(const TransferFunction& continuous, double sample_time_s) {
  if (const auto ok = require_continuous(continuous); !ok) return tl::unexpected(ok.error());
  const auto sampled = sample(continuous, sample_time_s);
  if (!sampled) return tl::unexpected(sampled.error());
  // ξ = x − γ₁ u_k takes the next sample u_{k+1} out of the state equation.
  const auto column = [&](Index i) -> VectorXd { return sampled->gamma.col(i); };
  TwoTap system{.phi = sampled->phi,
                .now = sampled->phi * column(1) + column(0) - column(1),
                .before = {},
                .c = sampled->c,
                .direct_now = sampled->c * column(1) + sampled->direct[0],
                .blocks = sampled->blocks};
  if (sampled->gamma.cols() == 4) {
    system.has_before = true;
    system.now += column(3);
    system.before = column(2) - column(3);
    system.direct_now += sampled->direct[3];
    system.direct_before = sampled->direct[2] - sampled->direct[3];
  }
  return with_clock(transfer_function_of(system), sample_time_s, split_delay(continuous.delay_s, sample_time_s).whole);
}

Result<TransferFunction> continuous_from_zoh(const TransferFunction& discrete) {
  if (discrete.domain != Domain::kZ || !(discrete.sample_time_s > 0)) {
    return fail("wrong_domain", "a discrete transfer function with its sample time is needed");
  }
  for (const Complex& p : discrete.poles) {
    if (p.imag() == 0 && p.real() <= 0) {
      return fail("no_continuous_equivalent",
                  fmt::format("the model has a pole at z = {:.6g}: no continuous system sampled with a hold has a pole "
                              "at zero or on the negative real axis",
                              p.real()));
    }
  }
  const auto system = cascade(discrete);
  if (!system) return tl::unexpected(system.error());
  const Index n = system->a.rows();
  MatrixXd augmented = MatrixXd::Identity(n + 1, n + 1);
  augmented.topLeftCorner(n, n) = system->a;
  augmented.topRightCorner(n, 1) = system->b;
  const MatrixXd logarithm = augmented.log();
  std::vector<PoleBlock> blocks;
  for (const PoleBlock& block : system->blocks) {
    const Complex s = std::log(Complex(block.re, block.im));
    blocks.push_back({s.real(), s.imag()});
  }
  const VectorXd input = logarithm.topRightCorner(n, 1);
  const RowVectorXd direct = RowVectorXd::Constant(1, system->d);
  TransferFunction g = chain_transfer_function(
      chain_form(logarithm.topLeftCorner(n, n), input, system->c, direct, blocks), Domain::kS, kLogarithmRounding);
  g.gain *= std::pow(discrete.sample_time_s, static_cast<double>(g.zeros.size()) - static_cast<double>(n));
  for (Complex& z : g.zeros) z /= discrete.sample_time_s;
  for (Complex& p : g.poles) p /= discrete.sample_time_s;
  g.delay_s = discrete.delay_s;
  return g;
}

}  // namespace valvetriage
