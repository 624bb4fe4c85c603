#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <stdexcept>

#include "tests/second_stand/command.h"

namespace valvetriage::second_stand {
namespace {

TEST(Command, EveryTestOfTheRepertoireIsUniformAndWithinTheRange) {
  for (const std::string& test : repertoire())
    for (const Command& command : commands_of(test)) {
      ASSERT_EQ(command.value_a.size(), command.instant_s.size());
      for (std::size_t k = 0; k < command.value_a.size(); ++k) {
        ASSERT_NEAR(command.instant_s[k], 0.005 * static_cast<double>(k), 1e-9);
        ASSERT_GE(command.value_a[k], 0.99);
        ASSERT_LE(command.value_a[k], 2.01);
      }
    }
}

TEST(Command, FullSessionHasSixRecordingsOf4000Samples) {
  for (const std::string& test : full_session()) EXPECT_EQ(commands_of(test).front().value_a.size(), 4000u) << test;
  EXPECT_EQ(full_session().size(), 6u);
}

TEST(Command, JumpsAreAtTheirInstantAndRampsBetween) {
  const Command command = given_command("plan", {0, 1, 2, 3}, {1.0, 1.0, 1.4, 1.4});
  CommandReader jump(command);
  EXPECT_DOUBLE_EQ(jump.mean(1.5, 2.0), 1.0);
  EXPECT_DOUBLE_EQ(jump.mean(2.0, 2.5), 1.4);
  const Command ramp = given_command("plan", {0, 1, 2, 3}, {1.0, 1.1, 1.2, 1.3});
  EXPECT_DOUBLE_EQ(CommandReader(ramp).mean(0.5, 2.5), 1.15);
}

TEST(Command, MeansAddUpToTheWhole) {
  const Command command = commands_of("steps").front();
  CommandReader fine(command), coarse(command);
  double sum = 0;
  for (int k = 0; k < 20000; ++k) sum += 0.00101 * fine.mean(0.00101 * k, 0.00101 * (k + 1));
  EXPECT_NEAR(sum, 20.2 * coarse.mean(0, 20.2), 1e-9);
}

TEST(Command, MultisineHasOddLinesAloneAndLeavesSomeOut) {
  const Command command = commands_of("multisine").front();
  const auto amplitude = [&](int line) {
    double in_phase = 0, quadrature = 0;
    for (std::size_t k = 0; k < 1000; ++k) {
      const double turn = 2 * std::numbers::pi * line * static_cast<double>(k) / 1000;
      in_phase += (command.value_a[k] - 1.6) * std::cos(turn);
      quadrature += (command.value_a[k] - 1.6) * std::sin(turn);
    }
    return std::hypot(in_phase, quadrature) / 500;
  };
  EXPECT_GT(amplitude(1), 0.005);
  EXPECT_GT(amplitude(3), 0.005);
  EXPECT_NEAR(amplitude(2), 0, 1e-9);
  EXPECT_NEAR(amplitude(5), 0, 1e-9);
}

TEST(Command, UnknownTestIsRefused) {
  EXPECT_THROW(commands_of(std::string("jump")), std::invalid_argument);
}

}  // namespace
}  // namespace valvetriage::second_stand
