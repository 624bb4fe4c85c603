#include "core/model/orifice_volume.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "tests/unit/model/half_way.h"

namespace valvetriage {
namespace {

using test::kPeriod_s;
constexpr OrificeVolume kTurbulent{.time_constant_s = 0.06, .exponent = 0.5, .supply_psi = 480, .reference_psi = 105};

std::vector<double> run(const OrificeVolume& volume, double first, const std::vector<double>& steady,
                        double period = kPeriod_s) {
  std::vector<double> p(steady.size());
  run_volume(volume, period, first, test::straight_between(steady), p);
  return p;
}

TEST(OrificeVolume, StaysWhereItIsSteady) {
  for (const double m : {-0.5, 0.0, 3.1, 120.0, 210.0}) {
    for (const double p : run(kTurbulent, m, std::vector<double>(100, m))) EXPECT_NEAR(p, m, 1e-12);
  }
}

TEST(OrificeVolume, SettlesAtTheSteadyPressureFromBothSides) {
  for (const double first : {0.0, 210.0})
    EXPECT_NEAR(run(kTurbulent, first, std::vector<double>(1000, 120.0)).back(), 120, 1e-6);
}

TEST(OrificeVolume, ASmallStepAtTheReferenceTakesItsTimeConstant) {
  const auto p = run(kTurbulent, 105, std::vector<double>(13, 105.01));
  EXPECT_NEAR((p[12] - 105) / 0.01, 1 - std::exp(-1.0), 1e-3);
}

TEST(OrificeVolume, IsAPlainLagWhereFlowIsLaminarAndTheSupplyFarAbove) {
  const auto p = run({.time_constant_s = 0.06, .exponent = 1, .supply_psi = 1e9, .reference_psi = 105}, 0,
                     std::vector<double>(60, 150.0));
  for (std::size_t i = 0; i < p.size(); ++i) {
    EXPECT_NEAR(p[i], 150 * (1 - std::exp(-static_cast<double>(i) * kPeriod_s / 0.06)), 1e-5);
  }
}

TEST(OrificeVolume, TakesASupplyOfAnyPressureInBoundedMemory) {
  // As many samples as make tables worth it, on both sides of where they end.
  for (const double supply_psi : {8000.0, 8500.0, 1e300}) {
    std::vector<double> steady(600, 8300.0);
    const auto p =
        run({.time_constant_s = 0.06, .exponent = 0.5, .supply_psi = supply_psi, .reference_psi = 4000}, 0, steady);
    EXPECT_TRUE(std::all_of(p.begin(), p.end(), [](double value) { return std::isfinite(value); })) << supply_psi;
  }
}

TEST(OrificeVolume, IsFasterAtLowPressureThanAtTheReference) {
  const double low = run(kTurbulent, 3, std::vector<double>(5, 3.01))[4] - 3;
  const double mid = run(kTurbulent, 105, std::vector<double>(5, 105.01))[4] - 105;
  EXPECT_GT(low, 1.5 * mid);
}

TEST(OrificeVolume, WithAirInItIsSlowerBelowTheReferenceAndFasterAboveIt) {
  OrificeVolume airy = kTurbulent;
  airy.air_share = 0.05;
  const auto moved = [](const OrificeVolume& volume, double at) {
    return run(volume, at, std::vector<double>(5, at + 0.01))[4] - at;
  };
  // Boyle's law: at 3 psi the air of 105 psi takes (119.7 / 17.7)² times as much, 3.2 times the whole capacity.
  const double capacity = (1 + 0.05 * std::pow(119.7 / 17.7, 2)) / 1.05;
  const double still_to_go = 1 - moved(kTurbulent, 3) / 0.01;
  EXPECT_NEAR(1 - moved(airy, 3) / 0.01, std::pow(still_to_go, 1 / capacity), 2e-3);
  EXPECT_NEAR(moved(airy, 105), moved(kTurbulent, 105), 1e-5);
  EXPECT_GT(moved(airy, 200), 1.02 * moved(kTurbulent, 200));
}

TEST(OrificeVolume, AirChangesNoSteadyPressure) {
  OrificeVolume airy = kTurbulent;
  airy.air_share = 0.3;
  for (const double m : {-0.5, 0.0, 3.1, 120.0}) {
    for (const double p : run(airy, m, std::vector<double>(100, m))) EXPECT_NEAR(p, m, 1e-12);
  }
}

TEST(OrificeVolume, ConvergesWithTheSamplingAtSecondOrder) {
  const auto end = [](int substeps) {
    const auto n = static_cast<std::size_t>(12 * substeps);
    std::vector<double> ramp(n + 1);
    for (std::size_t i = 0; i <= n; ++i) ramp[i] = 200.0 * static_cast<double>(i) / static_cast<double>(n);
    return run(kTurbulent, 0, ramp, kPeriod_s / substeps).back();
  };
  const double exact = end(64);
  const double coarse = std::abs(end(1) - exact);
  EXPECT_LT(coarse, 0.2);                             // half the noise, on a ramp faster than any valve
  EXPECT_LT(std::abs(end(2) - exact), 0.4 * coarse);  // second order would be a quarter
}

TEST(OrificeVolume, ItsTangentIsTheDifferenceOfTwoRuns) {
  std::vector<double> steady(80), moved;
  for (std::size_t i = 0; i < steady.size(); ++i) steady[i] = 100 + 40 * std::sin(0.1 * static_cast<double>(i));
  moved = steady;
  for (double& m : moved) m += 1e-4;
  const auto base = run(kTurbulent, 80, steady);
  const auto other = run(kTurbulent, 80, moved);
  std::vector<double> p(steady.size());
  VolumeTangent tangent;
  run_volume(kTurbulent, kPeriod_s, 80, test::straight_between(steady), p, &tangent);
  double change = 0;
  for (std::size_t i = 0; i + 1 < p.size(); ++i) {
    change = tangent.keep[i] * change + (tangent.begin[i] + tangent.middle[i] + tangent.end[i]) * 1e-4;
    // The tangent leaves out how the step's own length moves: 3 % while far from steady.
    EXPECT_NEAR(change, other[i + 1] - base[i + 1], 0.05 * 1e-4) << i;
  }
}

TEST(OrificeVolume, SeveralSideBySideAreEachAsAlone) {
  const OrificeVolume leaking{
      .time_constant_s = 0.03, .exponent = 0.6, .supply_psi = 400, .reference_psi = 105, .loss_fraction = 0.2};
  const std::array<const OrificeVolume*, 5> volumes{&kTurbulent, &kTurbulent, &leaking, &kTurbulent, &leaking};
  std::vector<std::vector<double>> steady, pressure;
  std::vector<VolumeTangent> tangents(volumes.size());
  std::vector<VolumeRun> runs;
  for (std::size_t k = 0; k < volumes.size(); ++k) {
    steady.emplace_back();
    for (std::size_t i = 0; i < 100 + 150 * k; ++i) {
      steady.back().push_back(i < 60 ? 20 : 100 + 90 * std::sin(0.02 * static_cast<double>((k + 1) * i)));
    }
    pressure.emplace_back(steady.back().size() / 2);
  }
  for (std::size_t k = 0; k < volumes.size(); ++k) {
    runs.push_back({volumes[k], kPeriod_s, 15, steady[k], pressure[k], &tangents[k]});
  }
  run_volumes(runs);
  for (std::size_t k = 0; k < volumes.size(); ++k) {
    std::vector<double> alone(pressure[k].size());
    VolumeTangent tangent;
    run_volume(*volumes[k], kPeriod_s, 15, steady[k], alone, &tangent);
    EXPECT_EQ(pressure[k], alone) << k;
    EXPECT_EQ(tangents[k].keep, tangent.keep) << k;
    EXPECT_EQ(tangents[k].begin, tangent.begin) << k;
    EXPECT_EQ(tangents[k].middle, tangent.middle) << k;
    EXPECT_EQ(tangents[k].end, tangent.end) << k;
  }
}

TEST(OrificeVolume, StandsStillWhereNothingMovesAndGoesOnWhereItDoes) {
  std::vector<double> steady(4000, 120.0);
  for (std::size_t i = 3000; i < steady.size(); ++i) steady[i] = 160;
  std::vector<double> p(steady.size());
  VolumeTangent tangent;
  run_volume(kTurbulent, kPeriod_s, 20, test::straight_between(steady), p, &tangent);
  EXPECT_EQ(p[2900], p[2999]);
  EXPECT_NEAR(p[2999], 120, 1e-8);
  EXPECT_EQ(tangent.keep[2900], tangent.keep[2998]);
  // What creeps by less than it would take to move within a sample is not lost over many.
  for (std::size_t i = 2000; i < 3000; ++i) steady[i] = 120 + 5e-11 * static_cast<double>(i - 2000);
  const auto crept = run(kTurbulent, 20, steady);
  EXPECT_NEAR(crept[2999], 120 + 5e-11 * 999, 2e-9);
  EXPECT_EQ(crept[2500], crept[2501]);  // and nothing is integrated meanwhile
  EXPECT_GT(tangent.keep[2900], 0);
  EXPECT_NEAR(p.back(), 160, 1e-8);
}

TEST(OrificeVolume, FollowsASpoolThatTurnsWithinASampleFarInsideTheNoise) {
  // A spool of 235 rad/s on its way up by 100 psi, from any instant within a sample: a straight line between samples
  // is off by a sixth of the way half-way between them.
  const auto edge = [](double t) {
    const double angle = 235 * std::max(t, 0.0);
    return 20 + 100 * (1 - std::exp(-angle) * (1 + angle));
  };
  for (const double late : {0.0, 0.2, 0.5, 0.8}) {
    constexpr int kFine = 64;
    const auto run_at = [&](int per_sample) {
      std::vector<double> halves, p(static_cast<std::size_t>(40 * per_sample));
      for (int i = 0; i < 80 * per_sample; ++i) {
        halves.push_back(edge((0.5 * i / per_sample - 4 - late) * kPeriod_s));
      }
      run_volume(kTurbulent, kPeriod_s / per_sample, 20, halves, p);
      return p;
    };
    const auto coarse = run_at(1), fine = run_at(kFine);
    double largest = 0;
    for (std::size_t i = 0; i < coarse.size(); ++i) {
      largest = std::max(largest, std::abs(coarse[i] - fine[i * kFine]));
    }
    EXPECT_LT(largest, 0.15) << late;
  }
}

TEST(OrificeVolume, ASteadyPressureAtTheSupplyIsNoSingularity) {
  for (const double p : run(kTurbulent, 470, std::vector<double>(200, 500.0))) EXPECT_TRUE(std::isfinite(p));
}

}  // namespace
}  // namespace valvetriage
