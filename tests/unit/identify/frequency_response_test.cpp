#include "core/identify/frequency_response.h"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include "core/identify/spectrum.h"
#include "tests/unit/identify/responses.h"

namespace valvetriage {
namespace {

using test::plant_s;
using test::recording_of;
using test::swept_sine;

constexpr double kRateHz = 200;

Result<FrequencyResponse> estimate(const Recording& recording, const FrequencyResponseOptions& options = {}) {
  const Recording* const one[] = {&recording};
  return estimate_frequency_response(one, options);
}

/// Largest relative deviation from the plant's own response, and the largest in standard errors.
struct Deviation {
  double relative = 0, in_sigmas = 0;
};
Deviation deviation(const FrequencyResponse& response, const TransferFunction& g) {
  Deviation worst;
  for (const ResponsePoint& p : response.points) {
    const auto truth = frequency_response(g, std::span(&p.frequency_hz, 1))[0];
    worst.relative = std::max(worst.relative, std::abs(p.gain - truth) / std::abs(truth));
    worst.in_sigmas = std::max(worst.in_sigmas, std::abs(p.gain - truth) / p.std_error);
  }
  return worst;
}

TransferFunction valve() {
  return plant_s(470, {2.4}, {{25, 0.75}}, {}, 0.004);
}

/// A multisine on odd lines, every fourth of them empty.
std::vector<double> odd_multisine(std::size_t period, std::size_t periods, double line_hz, double to_hz, double rms) {
  test::Normal normal(3);
  std::vector<double> one(period, 0.0);
  int line = 0, used = 0;
  for (int h = 1; h * line_hz < to_hz; h += 2) {
    if (++line % 4 == 0) continue;
    ++used;
    const double phase = 2 * std::numbers::pi * (normal.bits() / 4294967296.0);
    for (std::size_t i = 0; i < period; ++i) {
      one[i] += std::cos(2 * std::numbers::pi * h * static_cast<double>(i) / static_cast<double>(period) + phase);
    }
  }
  std::vector<double> u;
  for (std::size_t p = 0; p < periods; ++p) {
    for (const double v : one) u.push_back(1.6 + rms * std::sqrt(2.0 / used) * v);
  }
  return u;
}

RC_GTEST_PROP(Spectrum, EqualsItsDefinitionAtEveryLength, ()) {
  const auto n = *rc::gen::inRange<std::size_t>(1, 230);
  test::Normal normal(static_cast<std::uint32_t>(n));
  std::vector<double> x(n);
  for (double& v : x) v = normal();
  const auto lines = spectrum(x);
  RC_ASSERT(lines.size() == n / 2 + 1);
  for (std::size_t k = 0; k < lines.size(); ++k) {
    std::complex<double> sum = 0;
    for (std::size_t t = 0; t < n; ++t) {
      sum += x[t] * std::polar(1.0, -2 * std::numbers::pi * static_cast<double>(k * t % n) / static_cast<double>(n));
    }
    RC_ASSERT(std::abs(sum - lines[k]) < 1e-10 * static_cast<double>(n));
  }
}

TEST(FrequencyResponse, OfASweepWithoutNoiseIsThePlantsOwn) {
  const auto g = valve();
  const auto response = estimate(recording_of(g, swept_sine(12000, kRateHz, 0.2, 20, 0.1), kRateHz));
  ASSERT_TRUE(response) << response.error().message;
  EXPECT_EQ(response->method, ResponseMethod::kLocalPolynomial);
  EXPECT_LT(response->points.front().frequency_hz, 0.35);
  EXPECT_GT(response->points.back().frequency_hz, 19);
  // Parabolas over windows of 0.2 Hz and 7 % of the frequency: their third-order remainder is below 1 %.
  EXPECT_LT(deviation(*response, g).relative, 0.01);
}

TEST(FrequencyResponse, NeedsNoSteadyStateAtEitherEnd) {
  // A slow pole that rings through the whole record: the transient is larger than the response at its upper end.
  const auto g = plant_s(10, {0.05, 5}, {});
  auto recording = recording_of(g, swept_sine(6000, kRateHz, 0.3, 20, 0.2), kRateHz);
  for (std::size_t i = 0; i < recording.samples(); ++i) {
    recording.output.values[i] += 5 * std::exp(-2 * std::numbers::pi * 0.05 * static_cast<double>(i) / kRateHz);
  }
  auto response = estimate(recording);
  ASSERT_TRUE(response) << response.error().message;
  // In the first dozen lines the slow pole's transient is no parabola yet; beyond 20 Hz there is no sweep.
  std::erase_if(response->points, [](const ResponsePoint& p) { return p.frequency_hz < 0.7 || p.frequency_hz > 18; });
  EXPECT_LT(deviation(*response, g).relative, 0.01);
}

TEST(FrequencyResponse, StaysWithinItsOwnStandardErrors) {
  const auto g = valve();
  double squares = 0;
  std::size_t points = 0;
  for (std::uint32_t seed = 1; seed <= 5; ++seed) {
    const auto response = estimate(recording_of(g, swept_sine(24000, kRateHz, 0.2, 20, 0.1), kRateHz, 0.35, seed));
    ASSERT_TRUE(response);
    for (const ResponsePoint& p : response->points) {
      const auto truth = frequency_response(g, std::span(&p.frequency_hz, 1))[0];
      squares += std::norm(p.gain - truth) / (p.std_error * p.std_error);
      ++points;
    }
  }
  // Means of F(2, 12) and wider: n / (n − 1) of its noise's freedoms, 1.2 at six of them; 5 × 90 points.
  EXPECT_NEAR(squares / static_cast<double>(points), 1.15, 0.3);
}

TEST(FrequencyResponse, OfAMultisineIsThePlantsOwnWithNoDistortion) {
  const auto g = valve();
  const auto response = estimate(recording_of(g, odd_multisine(1000, 5, 0.2, 15, 0.05), kRateHz, 0.1));
  ASSERT_TRUE(response) << response.error().message;
  EXPECT_EQ(response->method, ResponseMethod::kPeriods);
  EXPECT_EQ(response->periods, 5);
  EXPECT_LT(deviation(*response, g).in_sigmas, 5);
  ASSERT_TRUE(response->distortion);
  EXPECT_LT(response->distortion->odd_ratio, response->distortion->noise_ratio);
  EXPECT_LT(response->distortion->even_ratio, response->distortion->noise_ratio);
}

TEST(FrequencyResponse, TellsEvenFromOddDistortion) {
  const auto g = valve();
  for (const bool odd : {false, true}) {
    auto recording = recording_of(g, odd_multisine(1000, 5, 0.2, 15, 0.05), kRateHz, 0.05);
    for (double& y : recording.output.values) {
      const double about = (y - 100) / 25;
      y += odd ? 0.5 * about * about * about : 0.5 * about * about;
    }
    const auto response = estimate(recording);
    ASSERT_TRUE(response && response->distortion);
    const Distortion& d = *response->distortion;
    EXPECT_GT(odd ? d.odd_ratio : d.even_ratio, 10 * (odd ? d.even_ratio : d.odd_ratio));
    EXPECT_GT(odd ? d.odd_ratio : d.even_ratio, 5 * d.noise_ratio);
  }
}

TEST(FrequencyResponse, ComesFromNoiseAndFromStepsToo) {
  const auto g = plant_s(100, {3}, {});
  test::Normal normal(11);
  std::vector<double> noise(12000);
  for (double& u : noise) u = 1.6 + 0.1 * normal();
  auto from_noise = estimate(recording_of(g, noise, kRateHz, 0.05));
  ASSERT_TRUE(from_noise) << from_noise.error().message;
  // Towards half of the rate images of the input's own spectrum join, here a lag's: (f / (rate − f))³ of the gain.
  std::erase_if(from_noise->points, [](const ResponsePoint& p) { return p.frequency_hz > 0.15 * kRateHz; });
  EXPECT_LT(deviation(*from_noise, g).in_sigmas, 6);

  auto levels = test::random_levels(12000, 40, 5);
  Recording steps;
  steps.sample_period_s = 1 / kRateHz;
  steps.input.values = levels;
  steps.segments = find_segments(levels, steps.sample_period_s);
  steps.output.values.assign(levels.size(), 0.0);
  Model model{.kind = "linear", .dynamics = g};
  steps.output.values = simulate(model, steps, InitialState{}).value();
  for (double& y : steps.output.values) y += 0.05 * normal();
  const auto from_steps = estimate(steps);
  ASSERT_TRUE(from_steps) << from_steps.error().message;
  EXPECT_EQ(from_steps->hold, Hold::kHeld);
  // Held input: images add up to (f/(rate − f))² of the gain at 45 % of the rate; look below a tenth of it.
  for (const ResponsePoint& p : from_steps->points) {
    if (p.frequency_hz > 0.1 * kRateHz) break;
    const auto truth = frequency_response(g, std::span(&p.frequency_hz, 1))[0];
    EXPECT_LT(std::abs(p.gain - truth), 6 * p.std_error + 0.03 * std::abs(truth)) << p.frequency_hz << " Hz";
  }
}

TEST(FrequencyResponse, OfRepeatsHasASmallerErrorThanOfOne) {
  const auto g = valve();
  const auto u = swept_sine(6000, kRateHz, 0.2, 20, 0.1);
  std::vector<Recording> recordings;
  std::vector<const Recording*> repeats;
  for (std::uint32_t seed = 1; seed <= 4; ++seed) recordings.push_back(recording_of(g, u, kRateHz, 0.35, seed));
  for (const Recording& r : recordings) repeats.push_back(&r);
  const auto one = estimate(recordings.front());
  const auto four = estimate_frequency_response(repeats);
  ASSERT_TRUE(one && four);
  ASSERT_EQ(four->repeats, 4);
  const auto middle = [](const FrequencyResponse& r) {
    double sum = 0;
    for (const ResponsePoint& p : r.points)
      sum += p.std_error / std::abs(p.gain) / static_cast<double>(r.points.size());
    return sum;
  };
  EXPECT_NEAR(middle(*one) / middle(*four), 2, 0.6);  // √4, both from few freedoms
}

TEST(FrequencyResponse, ShowsTheSameGainAtBothAmplitudesOfALinearPlantAndNotOfACubicOne) {
  const auto g = valve();
  const auto at = [&](double amplitude, double cubic) {
    auto recording = recording_of(g, swept_sine(6000, kRateHz, 0.2, 20, amplitude), kRateHz, 0.35,
                                  static_cast<std::uint32_t>(1000 * amplitude));
    for (double& y : recording.output.values) {
      const double about = (y - 100) / 100;
      y += cubic * 100 * about * about * about;
    }
    return estimate(recording).value();
  };
  const auto linear = compare_amplitudes(at(0.1, 0), at(0.3, 0));
  ASSERT_TRUE(linear);
  EXPECT_GT(linear->p_value, 0.001);
  EXPECT_LT(linear->change_rms, 0.01);
  const auto cubic = compare_amplitudes(at(0.1, 0.2), at(0.3, 0.2));
  ASSERT_TRUE(cubic);
  EXPECT_LT(cubic->p_value, 1e-6);
  EXPECT_GT(cubic->change_rms, 0.05);
}

TEST(FrequencyResponse, IsNormalisedByItsValueAtTheLowestFrequency) {
  const auto response = estimate(recording_of(valve(), swept_sine(6000, kRateHz, 0.2, 20, 0.1), kRateHz)).value();
  const auto gain = normalised_gain(response.points);
  EXPECT_EQ(gain.front(), 1);
  EXPECT_LT(gain.back(), 0.2);
  const auto phase_deg = unwrapped_phase_deg(response.points);
  EXPECT_LT(phase_deg.back(), -150);
}

TEST(FrequencyResponse, RefusesARecordThatIsTooShort) {
  const auto response = estimate(recording_of(valve(), swept_sine(40, kRateHz, 2, 20, 0.1), kRateHz, 0.1));
  ASSERT_FALSE(response);
  EXPECT_NE(response.error().message.find("usable"), std::string::npos) << response.error().message;
}

TEST(FrequencyResponse, RefusesAnInputWithOneToneAlone) {
  std::vector<double> u(4000);
  for (std::size_t i = 0; i < u.size(); ++i) {
    u[i] = 1.6 + 0.1 * std::sin(2 * std::numbers::pi * 2 * static_cast<double>(i) / kRateHz);
  }
  const auto response = estimate(recording_of(valve(), u, kRateHz, 0.35));
  ASSERT_FALSE(response);
  EXPECT_NE(response.error().message.find("usable"), std::string::npos);
}

TEST(FrequencyResponse, LeavesOutTheBandInWhichTheOutputStoodAtItsLimit) {
  const auto g = valve();
  auto recording = recording_of(g, swept_sine(12000, kRateHz, 0.2, 20, 0.1), kRateHz, 0.1);
  // 47 psi of amplitude at low frequency, below 30 from 3 Hz on.
  for (double& y : recording.output.values) y = std::min(y, 130.0);
  recording.quality.push_back({"clipped", "pressure held at exactly 130 psi", 1});
  const auto response = estimate(recording);
  ASSERT_TRUE(response) << response.error().message;
  EXPECT_GT(response->points.front().frequency_hz, 2);
  ASSERT_FALSE(response->unusable.empty());
  EXPECT_EQ(response->unusable.front().reason, "clipped");

  for (double& y : recording.output.values) y = std::min(y, 102.0);
  const auto refused = estimate(recording);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, "clipped");
  EXPECT_NE(refused.error().message.find("usable"), std::string::npos) << refused.error().message;
}

TEST(PeriodOf, IsFoundInNoiseAndNotInASweep) {
  auto u = odd_multisine(1000, 4, 0.2, 15, 0.05);
  test::Normal normal(1);
  for (double& v : u) v += 0.0005 * normal();
  EXPECT_EQ(period_of(u), 1000u);
  EXPECT_EQ(period_of(swept_sine(4000, kRateHz, 0.2, 20, 0.1)), 0u);
  EXPECT_EQ(period_of(test::random_levels(4000, 40, 1)), 0u);
}

}  // namespace
}  // namespace valvetriage
