#include "core/model/gauge.h"

namespace valvetriage {

void read_behind_lag(double lag_s, double sample_period_s, std::span<double> signal) {
  if (!(lag_s > 0) || signal.size() < 2) return;
  GaugeLag<double> lag(lag_s, sample_period_s, signal.front());
  for (double& value : signal.subspan(1)) value = lag.next(value);
}

}  // namespace valvetriage
