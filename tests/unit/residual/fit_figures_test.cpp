#include "core/residual/fit_figures.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace valvetriage {
namespace {

TEST(FitFigures, APerfectSimulationFitsAHundredPercent) {
  const std::vector<double> y{1, 2, 4, 8};
  const FitFigures figures = fit_figures(y, y, {});
  EXPECT_EQ(figures.rmse, 0);
  EXPECT_EQ(figures.fit_percent, 100);
  EXPECT_EQ(figures.samples, 4u);
}

TEST(FitFigures, TheMeanAsSimulationFitsNothing) {
  const std::vector<double> y{1, 2, 3, 6};
  const std::vector<double> mean(4, 3.0);
  EXPECT_DOUBLE_EQ(fit_figures(y, mean, {}).fit_percent, 0);
}

TEST(FitFigures, SamplesThatAreNotValidTakeNoPart) {
  const std::vector<double> y{1, 2, 1000, 4};
  const std::vector<double> simulated{1, 2, 3, 4.5};
  const std::vector<std::uint8_t> valid{1, 1, 0, 1};
  const FitFigures figures = fit_figures(y, simulated, valid);
  EXPECT_EQ(figures.samples, 3u);
  EXPECT_DOUBLE_EQ(figures.rmse, 0.5 / std::sqrt(3.0));
}

TEST(FitFigures, AConstantOutputGivesAFiniteFigure) {
  const std::vector<double> y(5, 2.0);
  const std::vector<double> simulated(5, 2.5);
  EXPECT_EQ(fit_figures(y, simulated, {}).fit_percent, -1e6);
}

}  // namespace
}  // namespace valvetriage
