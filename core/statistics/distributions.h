#pragma once

/// Tails and quantiles of the distributions that tests of significance need, by Boost.Math. They stand behind this
/// header because Boost's own takes longer to compile than most files that need one of them.
///
/// Degrees of freedom are positive and need not be whole. Arguments outside a function's domain, and those for which
/// its value overflows, throw what Boost.Math throws (std::domain_error, std::overflow_error).
namespace valvetriage {

/// P(X > x) of a standard normal deviate.
double normal_upper_tail(double x);
/// What a standard normal deviate exceeds with probability `p`, 0 < p < 1.
double normal_upper_quantile(double p);

/// P(T > t) of Student's t.
double student_t_upper_tail(double degrees_of_freedom, double t);
/// What Student's t exceeds with probability `p`, 0 < p < 1.
double student_t_upper_quantile(double degrees_of_freedom, double p);
/// What the size of Student's t exceeds in 5 % of cases: half the width of an interval of 95 %, in standard errors.
double student_t_half_width95(double degrees_of_freedom);

/// P(X > x) of chi-squared, x >= 0.
double chi_squared_upper_tail(double degrees_of_freedom, double x);
/// What chi-squared stays below with probability `p`, 0 <= p < 1.
double chi_squared_quantile(double degrees_of_freedom, double p);
/// What chi-squared exceeds with probability `p`, 0 < p <= 1.
double chi_squared_upper_quantile(double degrees_of_freedom, double p);

/// P(F > f) of a ratio of two mean squares, f >= 0.
double fisher_f_upper_tail(double degrees_of_freedom_above, double degrees_of_freedom_below, double f);

}  // namespace valvetriage
