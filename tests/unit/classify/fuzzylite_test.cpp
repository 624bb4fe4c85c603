#include <fl/Headers.h>
#include <gtest/gtest.h>

#include <cmath>
#include <memory>

#include "core/classify/inference.h"
#include "server/wire/rule_base_json.h"

namespace valvetriage {
namespace {

/// fuzzylite's centroid samples the output axis at this many points over 2 units.
constexpr int kResolution = 4000;

fl::Term* term_of(const std::string& name, const Trapezoid& shape) {
  // fuzzylite's trapezoid has no open shoulder: one far outside the grid is the same there.
  const double left = std::isfinite(shape.a) ? shape.a : -1e6;
  const double left_top = std::isfinite(shape.b) ? shape.b : -1e6;
  const double right_top = std::isfinite(shape.c) ? shape.c : 1e6;
  const double right = std::isfinite(shape.d) ? shape.d : 1e6;
  return new fl::Trapezoid(name, left, left_top, right_top, right);
}

/// The same sets and rules in fuzzylite; the engine owns what it is given.
std::unique_ptr<fl::Engine> engine_of(const RuleBase& base, const LevelRules& level) {
  auto engine = std::make_unique<fl::Engine>("oracle");
  auto* error = new fl::InputVariable("error", 0, 10);
  for (std::size_t s = 0; s < level.inputs[0].sets.size(); ++s) {
    error->addTerm(term_of("set" + std::to_string(s), level.inputs[0].sets[s].shape));
  }
  engine->addInputVariable(error);
  auto* verdict = new fl::OutputVariable("verdict", -0.5, 1.5);
  for (const OutputSet& set : level.output) verdict->addTerm(term_of(std::string(to_string(set.verdict)), set.shape));
  verdict->setAggregation(new fl::Maximum);
  verdict->setDefuzzifier(new fl::Centroid(kResolution));
  engine->addOutputVariable(verdict);
  auto* rules = new fl::RuleBlock;
  rules->setActivation(new fl::General);
  if (base.implication == Implication::kMinimum) {
    rules->setImplication(new fl::Minimum);
  } else {
    rules->setImplication(new fl::AlgebraicProduct);
  }
  for (const Rule& rule : level.rules) {
    const std::string text =
        "if error is set" + std::to_string(*rule.sets[0]) + " then verdict is " + std::string(to_string(rule.then));
    rules->addRule(fl::Rule::parse(text, engine.get()));
  }
  engine->addRuleBlock(rules);
  return engine;
}

void expect_the_same(const RuleBase& base) {
  for (const LevelRules& level : base.levels) {
    const auto engine = engine_of(base, level);
    for (int i = 0; i <= 500; ++i) {
      const double error = 0.004 * i;
      engine->getInputVariable("error")->setValue(error);
      engine->process();
      const auto ours = classify_level(base, level, {.level_a = level.level_a, .error_eq20 = error}).value();
      // Steps of 2 / 4000, each off by at most half a step: the moments of straight pieces are exact to its square.
      EXPECT_NEAR(engine->getOutputVariable("verdict")->getValue(), ours.centroid, 1e-5)
          << level.name << " at " << error;
      for (std::size_t r = 0; r < ours.rules.size(); ++r) {
        EXPECT_NEAR(engine->getRuleBlock(0)->getRule(r)->getActivationDegree(), ours.rules[r].strength, 1e-5);
      }
    }
  }
}

TEST(FuzzyLite, AgreesOnThePaper) {
  expect_the_same(embedded_rule_base("paper").value());
}

TEST(FuzzyLite, AgreesOnCalibrated) {
  expect_the_same(embedded_rule_base("calibrated").value());
}

TEST(FuzzyLite, AgreesWithScaledConclusionsToo) {
  RuleBase base = embedded_rule_base("paper").value();
  base.implication = Implication::kProduct;
  expect_the_same(base);
}

}  // namespace
}  // namespace valvetriage
