#include "core/model/paper_models.h"

#include <cmath>

namespace valvetriage {
namespace {

// Both quadratics are squared in Eqs 16 and 17.
void add_squared_quadratic(std::vector<std::complex<double>>& roots, double corner, double damping_ratio) {
  const std::complex<double> upper(-damping_ratio * corner, corner * std::sqrt(1 - damping_ratio * damping_ratio));
  for (int power = 0; power < 2; ++power) {
    roots.push_back(upper);
    roots.push_back(std::conj(upper));
  }
}

}  // namespace

TransferFunction cancelled(const PaperBodeModel& model) {
  TransferFunction g{.domain = Domain::kS, .zeros = {-model.zero}, .poles = {-model.pole}};
  for (int lag = 0; lag < model.lags_at_ten; ++lag) g.poles.emplace_back(-10.0);
  g.gain = 1 / static_gain(g);
  return g;
}

TransferFunction transfer_function_of(const PaperBodeModel& model, double zero_damping_ratio,
                                      double pole_damping_ratio) {
  TransferFunction g = cancelled(model);
  add_squared_quadratic(g.zeros, model.quadratic_corner, zero_damping_ratio);
  add_squared_quadratic(g.poles, model.quadratic_corner, pole_damping_ratio);
  return g;
}

PaperDiscreteModel paper_equation_18() {
  constexpr double kThirdDigit = 0.0005;
  return {.numerator = {-0.001, 0, 0, 0.002, 0, 0.05},
          .denominator = {{1, 0},
                          {-2.501, kThirdDigit},
                          {2.209, kThirdDigit},
                          {-1, 0.5},  // printed "1": read as widely as its digits allow
                          {0.464, kThirdDigit},
                          {-0.208, kThirdDigit},
                          {0.078, kThirdDigit},
                          {-0.007, kThirdDigit}}};
}

PaperDiscreteModel paper_equation_19() {
  return {.numerator = {0, 0, 0, 0.001, 0.001},
          .denominator = {{1, 0},
                          {-5.058, 0.0005},
                          {11.2, 0.05},
                          {-14.6, 0.05},
                          {12.93, 0.005},
                          {-8.539, 0.0005},
                          {4.261, 0.0005},
                          {-1.416, 0.0005}}};
}

RationalCoefficients coefficients_of(const PaperDiscreteModel& model) {
  RationalCoefficients c{.domain = Domain::kZ, .sample_time_s = 1, .b = model.numerator};
  for (const PrintedCoefficient& a : model.denominator) c.a.push_back(a.value);
  return c;
}

TransferFunction transfer_function_of(const PaperDiscreteModel& model) {
  return *to_transfer_function(coefficients_of(model));
}

}  // namespace valvetriage
