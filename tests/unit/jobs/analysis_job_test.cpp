#include "server/jobs/analysis_job.h"

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <random>

#include "server/wire/residuals_json.h"
#include "server/wire/sha256.h"

namespace valvetriage {
namespace {

class AnalysisJob : public testing::Test {
 protected:
  AnalysisJob() { std::filesystem::create_directories(folder_); }
  ~AnalysisJob() override { std::filesystem::remove_all(folder_); }

  /// The job of one recording: a first-order machine on steps for 20 s, whose output stops at `stop`.
  NewAnalysis run(double stop) {
    std::mt19937 random(5);
    std::normal_distribution<double> noise(0, 0.05);
    std::string csv = "# serial: EFC-1\n# test: step\ntime_s,current_A,pressure_psi\n";
    double y = 0;
    for (int i = 0; i < 2000; ++i) {
      const double u = 1.0 + 0.2 * (i / 250 % 4);
      y += 0.05 * (50 * (u - 1.0) - y);
      csv += fmt::format("{:.3f},{:.4f},{:.4f}\n", 0.01 * i, u, std::min(y, stop) + noise(random));
    }
    const std::string path = folder_ / "steps.csv";
    std::ofstream(path) << csv;
    JobSpec spec;
    spec.files = {
        {.name = "steps.csv", .sha256 = sha256_hex(csv), .path = path, .test = "step", .metadata_json = "{}"}};
    auto analysis = run_analysis_job(spec, [](double, std::string_view) {});
    EXPECT_TRUE(analysis) << analysis.error().message;
    return analysis ? *analysis : NewAnalysis{};
  }

 private:
  std::filesystem::path folder_ =
      std::filesystem::path(testing::TempDir()) / fmt::format("analysis_job_{}", ::getpid());
};

TEST_F(AnalysisJob, KeepsTheResidualsOfAValveInWhichNothingIsWrong) {
  const NewAnalysis analysis = run(1e9);
  ASSERT_EQ(analysis.summary.conclusion, "none");
  const auto residuals = residuals_from_json(analysis.residuals_json);
  ASSERT_TRUE(residuals) << residuals.error().message;
  ASSERT_TRUE(residuals->contains("step, 20.0 s"));
  const BinnedResidual& residual = residuals->at("step, 20.0 s");
  ASSERT_EQ(residual.value.size(), 64);
  // Means of 31 samples of noise of 0.05: 0.009; five times that, and what the fit leaves.
  EXPECT_LT(residual.value.cwiseAbs().maxCoeff(), 0.06);
}

TEST_F(AnalysisJob, KeepsNoneWhereACauseIsOffered) {
  const NewAnalysis analysis = run(24);
  ASSERT_TRUE(analysis.summary.conclusion == "named" || analysis.summary.conclusion == "ambiguous")
      << analysis.summary.conclusion.value_or("");
  EXPECT_EQ(analysis.residuals_json, "");
}

}  // namespace
}  // namespace valvetriage
