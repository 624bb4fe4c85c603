#include "core/statistics/distributions.h"

#include <boost/math/distributions/chi_squared.hpp>
#include <boost/math/distributions/fisher_f.hpp>
#include <boost/math/distributions/normal.hpp>
#include <boost/math/distributions/students_t.hpp>

namespace valvetriage {

using boost::math::cdf, boost::math::complement, boost::math::quantile;
using boost::math::chi_squared, boost::math::fisher_f, boost::math::normal, boost::math::students_t;

double normal_upper_tail(double x) {
  return cdf(complement(normal(), x));
}

double normal_upper_quantile(double p) {
  return quantile(complement(normal(), p));
}

double student_t_upper_tail(double degrees_of_freedom, double t) {
  return cdf(complement(students_t(degrees_of_freedom), t));
}

double student_t_upper_quantile(double degrees_of_freedom, double p) {
  return quantile(complement(students_t(degrees_of_freedom), p));
}

double student_t_half_width95(double degrees_of_freedom) {
  return quantile(students_t(degrees_of_freedom), 0.975);
}

double chi_squared_upper_tail(double degrees_of_freedom, double x) {
  return cdf(complement(chi_squared(degrees_of_freedom), x));
}

double chi_squared_quantile(double degrees_of_freedom, double p) {
  return quantile(chi_squared(degrees_of_freedom), p);
}

double chi_squared_upper_quantile(double degrees_of_freedom, double p) {
  return quantile(complement(chi_squared(degrees_of_freedom), p));
}

double fisher_f_upper_tail(double degrees_of_freedom_above, double degrees_of_freedom_below, double f) {
  return cdf(complement(fisher_f(degrees_of_freedom_above, degrees_of_freedom_below), f));
}

}  // namespace valvetriage
