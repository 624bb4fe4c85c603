#include "server/wire/machine_c.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <numbers>

#include "core/model/free_run.h"
#include "server/wire/c_source.h"

namespace valvetriage {
namespace {

/// A law as C: `{n}` is the number of its block, `{width}` and the like its parameters by name. Of sections
/// `{sections}` is their number, `{states}` that of their states, which is one at least, `{direct}` the weight of what
/// enters them. T, t (the time), side and the others are names of the file.
struct LawText {
  MachineLaw law;
  std::string_view does;
  std::string_view state;
  std::string_view begin;
  std::string_view code;
};

constexpr std::array<LawText, kMachineLaws> kLawTexts{{
    {MachineLaw::kLinear, "sections behind each other, a sum of their states",
     "cascade_state forward{n}[{states}];",  //
     "cascade_begin({sections}, m->forward{n}, x);",
     "cascade_step({sections}, forward_rows{n}, m->forward{n}, x);\n"
     "  if (m->samples % SETTLE_EVERY == 0) cascade_settle({sections}, m->forward{n});\n"
     "  x = cascade_output({sections}, forward_rows{n}, m->forward{n}) + {direct} * x;"},
    {MachineLaw::kAffine, "scale and offset", "", "", "x = {scale} * x + {offset};"},
    {MachineLaw::kPlay, "lost motion", "double held{n};", "m->held{n} = x;",
     "m->held{n} = larger(x - {width} / 2, smaller(x + {width} / 2, m->held{n}));\n"
     "  x = m->held{n};"},
    {MachineLaw::kStickSlip, "holds until it is off by more than breakaway", "double held{n};", "m->held{n} = x;",
     "if (fabs(x - m->held{n}) > {breakaway}) {\n"
     "    m->held{n} = x - copysign(smaller({kinetic}, {breakaway}), x - m->held{n});\n"
     "  }\n"
     "  x = m->held{n};"},
    {MachineLaw::kLoop, "a loop, the mean of plays", "double held{n}[LOOP_PLAYS];",
     "for (int k = 0; k < LOOP_PLAYS; ++k) m->held{n}[k] = x;",
     "{\n"
     "    double sum = 0;\n"
     "    for (int k = 0; k < LOOP_PLAYS; ++k) {\n"
     "      const double half = {reach} * (k + 1) / LOOP_PLAYS;\n"
     "      m->held{n}[k] = larger(x - half, smaller(x + half, m->held{n}[k]));\n"
     "      sum += m->held{n}[k] - x;\n"
     "    }\n"
     "    x += {width} / ({reach} * (LOOP_PLAYS + 1) / LOOP_PLAYS) / LOOP_PLAYS * sum;\n"
     "  }"},
    {MachineLaw::kDeadBand, "no change inside a band", "", "",
     "{\n"
     "    const double z = x - {centre}, half = {width} / 2;\n"
     "    x = {centre} + (z > half ? z - half : z < -half ? z + half : 0);\n"
     "  }"},
    {MachineLaw::kUpperLimit, "not above its level", "", "", "x = {level} + soft_minimum(x - {level}, {softness});"},
    {MachineLaw::kLowerLimit, "not below its level", "", "", "x = {level} - soft_minimum({level} - x, {softness});"},
    {MachineLaw::kCurve, "a parabola beside the straight line", "", "",
     "{\n"
     "    const double q = (x - {zero}) / {range};\n"
     "    x += {curvature} * {range} * q * (1 - q);\n"
     "  }"},
    {MachineLaw::kMagnitude, "folded", "", "", "x = {fold} + fabs(x - {fold});"},
    {MachineLaw::kRateLimit, "no faster than its limit", "double out{n};", "m->out{n} = x;",
     "m->out{n} += between(x - m->out{n}, -({limit_per_s} * T), {limit_per_s} * T);\n"
     "  x = m->out{n};"},
    {MachineLaw::kLag, "a lag of its own upwards and downwards", "double out{n};", "m->out{n} = x;",
     "m->out{n} = x + (x > m->out{n} ? exp(-T / {rising_s}) : exp(-T / {falling_s})) * (m->out{n} - x);\n"
     "  x = m->out{n};"},
    {MachineLaw::kSpring, "y = G x + H (y - centre)^3",
     "cascade_state forward{n}[{states}], back{n}[{states}];\n  double y{n};",
     "cascade_begin({sections}, m->forward{n}, x);\n"
     "    cascade_begin({sections}, m->back{n}, 1);\n"
     "    m->y{n} = spring_at_rest(cascade_output({sections}, forward_rows{n}, m->forward{n}) + {direct} * x,\n"
     "                             cascade_output({sections}, back_rows{n}, m->back{n}), {centre});\n"
     "    cascade_begin({sections}, m->back{n}, cube(m->y{n} - {centre}));",
     "cascade_step({sections}, forward_rows{n}, m->forward{n}, x);\n"
     "  cascade_step({sections}, back_rows{n}, m->back{n}, cube(m->y{n} - {centre}));\n"
     "  x = cascade_output({sections}, forward_rows{n}, m->forward{n}) + {direct} * x +\n"
     "      cascade_output({sections}, back_rows{n}, m->back{n});\n"
     "  m->y{n} = x = in_range(m->y{n}, x);"},
    {MachineLaw::kRestoringLoop, "y = G x + H h, dh/dt = dy/dt - beta |dy/dt| h - delta dy/dt |h|",
     "cascade_state forward{n}[{states}], back{n}[{states}];\n  double y{n}, before{n}, long_before{n}, h{n};",
     "cascade_begin({sections}, m->forward{n}, x);\n"
     "    cascade_begin({sections}, m->back{n}, 0);\n"
     "    m->y{n} = cascade_output({sections}, forward_rows{n}, m->forward{n}) + {direct} * x;\n"
     "    m->before{n} = m->long_before{n} = m->y{n};\n"
     "    m->h{n} = 0;",
     "{\n"
     "    const double turn = turning_point(m->long_before{n}, m->before{n}, m->y{n});\n"
     "    m->h{n} = loop_after(m->h{n}, turn - m->before{n}, {beta}, {delta});\n"
     "    m->h{n} = loop_after(m->h{n}, m->y{n} - turn, {beta}, {delta});\n"
     "    m->long_before{n} = m->before{n};\n"
     "    m->before{n} = m->y{n};\n"
     "    cascade_step({sections}, forward_rows{n}, m->forward{n}, x);\n"
     "    cascade_step({sections}, back_rows{n}, m->back{n}, m->h{n});\n"
     "    x = cascade_output({sections}, forward_rows{n}, m->forward{n}) + {direct} * x +\n"
     "        cascade_output({sections}, back_rows{n}, m->back{n});\n"
     "    m->y{n} = x = in_range(m->y{n}, x);\n"
     "    if (m->samples == 0) m->before{n} = m->long_before{n} = x;\n"
     "  }"},
    {MachineLaw::kMotion, "a mass on a spring with friction", "double x{n}, v{n}, before{n};",
     "m->x{n} = {stiffness} > 0 ? (({gain} + {gain_before}) * x + {bias}) / {stiffness} : 0;\n"
     "    m->v{n} = 0;\n"
     "    m->before{n} = x;",
     "{\n"
     "    const double h = T / SUB_STEPS, drag = 1 + h * {damping};\n"
     "    const double push = {gain} * x + {gain_before} * m->before{n} + {bias};\n"
     "    m->before{n} = x;\n"
     "    x = !(fabs(m->x{n}) < LEAVES) ? NAN : {shows_speed} != 0 ? m->v{n} : m->x{n};\n"
     "    for (int k = 0; k < SUB_STEPS; ++k) {\n"
     "      const double moved = (m->v{n} + h * (push - {stiffness} * m->x{n})) / drag, slide = h / drag * {coulomb};\n"
     "      const double hold = m->v{n} == 0 ? h / drag * larger({breakaway}, {coulomb}) : slide;\n"
     "      m->v{n} = fabs(moved) <= hold ? 0 : moved - copysign(smaller(slide, fabs(moved)), moved);\n"
     "      m->x{n} += h * m->v{n};\n"
     "    }\n"
     "  }"},
    {MachineLaw::kTanks, "tanks that feed each other", "double upper{n}, lower{n};",
     "const double inflow = larger(0, {gain} * (x - {closed})), rim = larger({rim_lower} - {zero}, 1e-6);\n"
     "    m->upper{n} = smaller(pow(inflow / {outflow_upper}, 1 / {exponent_upper}), {rim_upper});\n"
     "    m->lower{n} = {tanks} > 1 ? {outflow_upper} * outflow(m->upper{n}, {exponent_upper}) : inflow;\n"
     "    m->lower{n} = smaller(pow(m->lower{n} / {outflow_lower}, 1 / {exponent}), rim);",
     "{\n"
     "    const double h = T / SUB_STEPS, rim = larger({rim_lower} - {zero}, 1e-6);\n"
     "    const double inflow = larger(0, {gain} * (x - {closed}));\n"
     "    x = m->lower{n} + {zero};\n"
     "    for (int k = 0; k < SUB_STEPS; ++k) {\n"
     "      double feed = inflow;\n"
     "      if ({tanks} > 1) {\n"
     "        const double passed =\n"
     "            smaller({outflow_upper} * outflow(m->upper{n}, {exponent_upper}), m->upper{n} / h + inflow);\n"
     "        m->upper{n} += h * (inflow - passed);\n"
     "        feed = passed + {share} * (larger(0, m->upper{n} - {rim_upper}) / h);\n"
     "        m->upper{n} = smaller(m->upper{n}, {rim_upper});\n"
     "      }\n"
     "      m->lower{n} += h * (feed - {outflow_lower} * outflow(m->lower{n}, {exponent}));\n"
     "      m->lower{n} = between(m->lower{n}, 0, rim);\n"
     "    }\n"
     "  }"},
    {MachineLaw::kTone, "a disturbance of one frequency", "", "",
     "x += {sine} * sin(TWO_PI * {frequency_hz} * t) + {cosine} * cos(TWO_PI * {frequency_hz} * t);"},
    {MachineLaw::kDrift, "a drift", "", "", "x += {rate_per_s} * t;"},
    {MachineLaw::kWarming, "a gain that changes as it warms up", "", "",
     "x = {centre} + (x - {centre}) * (1 - {gain_change} * expm1(-t / {time_constant_s}));"},
    {MachineLaw::kGainStep, "a gain that changes at an instant", "", "",
     "if (t >= {time_s}) x = {centre} + (x - {centre}) * (1 + {gain_change});"},
    {MachineLaw::kSide, "a side channel", "", "", "x += {coefficient} * (side - {centre});"},
}};

constexpr bool stand_in_order() {
  for (std::size_t i = 0; i < kLawTexts.size(); ++i) {
    if (kLawTexts[i].law != static_cast<MachineLaw>(i) || kLawTexts[i].code.empty()) return false;
  }
  return true;
}
static_assert(stand_in_order(), "a law of the machine has no text, or not in its place");

constexpr CLaw kDelay{.state = "double late{n}[{delay}];",
                      .begin = "for (int k = 0; k < {delay}; ++k) m->late{n}[k] = x;",
                      .code = "x = delayed({delay}, m->late{n}, m->samples, x);"};

/// What laws call.
constexpr CFunction kLawFunctions[] = {
    {"smaller", R"c(
static double smaller(double a, double b) { return b < a ? b : a; }
)c"},
    {"larger", R"c(
static double larger(double a, double b) { return a < b ? b : a; }
)c"},
    {"between", R"c(
static double between(double x, double low, double high) { return x < low ? low : high < x ? high : x; }
)c"},
    {"cube", R"c(
static double cube(double x) { return x * x * x; }
)c"},
    {"in_range", R"c(
/* A run that has left its range does not come back. */
static double in_range(double before, double x) { return isnan(before) || !(fabs(x) < LEAVES) ? NAN : x; }
)c"},
    {"delayed", R"c(
static double delayed(int delay, double *late, size_t samples, double x) {
  double *place = late + samples % (size_t)delay;
  const double before = *place;
  *place = x;
  return before;
}
)c"},
    {"cascade_begin", R"c(
/* Sections behind each other, each at its level y with the difference v to the level before:
 * v = keep v + f (x - y), y = y + v. Their rows: keep, f, the weight of y and that of v in the sum. */
static void cascade_begin(int sections, cascade_state *at, double rest) {
  for (int s = 0; s < sections; ++s) {
    at[s].level = rest;
    at[s].difference = 0;
  }
}
)c"},
    {"cascade_step", R"c(
static void cascade_step(int sections, const double (*row)[4], cascade_state *at, double x) {
  for (int s = 0; s < sections; ++s) {
    at[s].difference = row[s][0] * at[s].difference + row[s][1] * (x - at[s].level);
    x = at[s].level += at[s].difference;
  }
}
)c"},
    {"cascade_settle", R"c(
static void cascade_settle(int sections, cascade_state *at) {
  for (int s = 0; s < sections; ++s) {
    if (fabs(at[s].level) + fabs(at[s].difference) < SETTLED) at[s].level = at[s].difference = 0;
  }
}
)c"},
    {"cascade_output", R"c(
static double cascade_output(int sections, const double (*row)[4], const cascade_state *at) {
  double sum = 0;
  for (int s = sections - 1; s >= 0; --s) {
    sum += row[s][2] * at[s].level;
    sum += row[s][3] * at[s].difference;
  }
  return sum;
}
)c"},
    {"spring_at_rest", R"c(
/* y of y = linear + curved (y - centre)^3, by Newton from the linear answer. */
static double spring_at_rest(double linear, double curved, double centre) {
  double y = linear;
  for (int i = 0; i < 50; ++i) {
    const double z = y - centre, slope = 1 - 3 * curved * z * z;
    if (fabs(slope) < 1e-9) break;
    y -= (y - linear - curved * cube(z)) / slope;
  }
  return isfinite(y) ? y : linear;
}
)c"},
    {"turning_point", R"c(
/* Where a parabola through three values turns between the last two; the earlier of these where it does not. */
static double turning_point(double long_before, double before, double now) {
  const double rise = 0.5 * (now - long_before), bend = now - 2 * before + long_before, at = -rise / bend;
  return at > 0 && at < 1 ? before + 0.5 * rise * at : before;
}
)c"},
    {"loop_grown", R"c(
/* h after dh/dx = 1 - rate h over a length of x. */
static double loop_grown(double h, double rate, double length) {
  const double bent = rate * length;
  return h * exp(-bent) + (fabs(bent) < STRAIGHT ? length : -expm1(-bent) / rate);
}
)c"},
    {"loop_after", R"c(
/* h after a straight move of y: between the signs of the move and of h its equation is linear. */
static double loop_after(double h, double move, double beta, double delta) {
  const double to = move < 0 ? -1 : 1, rate = beta - delta;
  double left = fabs(move), along = to * h;
  if (along < 0) {
    const double to_none = fabs(rate * along) < STRAIGHT ? -along : log1p(-rate * along) / rate;
    if (!(to_none < left)) return to * loop_grown(along, rate, left);
    left -= to_none;
    along = 0;
  }
  return to * loop_grown(along, beta + delta, left);
}
)c"},
    {"soft_minimum", R"c(
/* min(x, 0), rounded over s. */
static double soft_minimum(double x, double s) {
  if (s <= 0 || x < -30 * s) return smaller(x, 0);
  return x > 30 * s ? 0 : x - s * log1p(exp(x / s));
}
)c"},
    {"outflow", R"c(
static double outflow(double level, double exponent) {
  if (level <= 0) return 0;
  return exponent == 0.5 ? sqrt(level) : pow(level, exponent);
}
)c"},
};

constexpr std::string_view kStep = R"c(
void valvetriage_start(valvetriage_model *m, double input, double input_noise) {
  (void)input;
  (void)input_noise;
  m->samples = 0;
}

double valvetriage_step(valvetriage_model *m, double input, int is_step, double side) {
  const double y = chain(m, input, side);
  (void)is_step;
  ++m->samples;
  return y;
}
)c";

constexpr std::string_view kStepOfMeans = R"c(
void valvetriage_start(valvetriage_model *m, double input, double input_noise) {
  (void)input;
  (void)input_noise;
  m->samples = 0;
  m->is_running = 0;
}

double valvetriage_step(valvetriage_model *m, double input, int is_step, double side) {
  double y;
  if (m->is_running) {
    /* the sample before, now that the interval behind it has ended */
    y = chain(m, is_step ? m->input : 0.5 * (m->input + input), m->side);
    ++m->samples;
  } else {
    y = chain(m, input, side);
    m->is_running = 1;
  }
  m->input = input;
  m->side = side;
  return y;
}
)c";

/// Weights of a cascade's basis as rows of its sections, and what is left for the signal that enters.
struct CascadeRows {
  std::string rows;
  double direct = 0;
};

CascadeRows cascade_rows(std::span<const Section> sections, std::span<const double> weights) {
  CascadeRows cascade;
  const auto next = [&] {
    if (weights.empty()) return 0.0;
    const double weight = weights.front();
    weights = weights.subspan(1);
    return weight;
  };
  for (auto section = sections.rbegin(); section != sections.rend(); ++section) {
    const SectionState state(*section, 0);
    const double level = next(), difference = section->order == 2 ? next() : 0;
    const std::string row = "{" + c_numbers(std::array{state.keep, state.f, level, difference}) + "}";
    cascade.rows = row + (cascade.rows.empty() ? "" : ",\n  ") + cascade.rows;
  }
  if (cascade.rows.empty()) cascade.rows = "{0}";
  cascade.direct = next();
  return cascade;
}

std::string rows_text(const std::string& name, const CascadeRows& cascade) {
  return fmt::format("static const double {}[][4] = {{{}}};\n", name, cascade.rows);
}

bool has_sections(MachineLaw law) {
  return law == MachineLaw::kLinear || law == MachineLaw::kSpring || law == MachineLaw::kRestoringLoop;
}

bool has_delay(MachineLaw law) {
  return has_sections(law) || law == MachineLaw::kMotion || law == MachineLaw::kTanks;
}

/// The blocks as C: their constants beside their laws.
struct Chain {
  std::string constants;
  CLaws laws;

  void add(std::size_t n, const MachineBlock& block) {
    const LawText& text = kLawTexts[static_cast<std::size_t>(block.law)];
    const std::string number = std::to_string(n);
    const auto names = parameter_names(block.law);
    std::vector<CMark> marks{{"n", number}};
    for (std::size_t j = 0; j < names.size(); ++j) marks.push_back(parameter_mark(names[j], block.parameters[j]));
    if (has_delay(block.law) && block.delay_samples > 0) {
      laws.add(kDelay, fmt::format("block {}, its delay", n),
               std::array{marks.front(), CMark{"delay", std::to_string(block.delay_samples)}});
    }
    if (has_sections(block.law)) {
      const CascadeRows forward = cascade_rows(block.sections, block.numerator);
      const CascadeRows back = cascade_rows(block.sections, block.feedback);
      constants += rows_text("forward_rows" + number, forward);
      if (block.law != MachineLaw::kLinear) constants += rows_text("back_rows" + number, back);
      marks.push_back({"sections", std::to_string(block.sections.size())});
      marks.push_back({"states", std::to_string(std::max<std::size_t>(block.sections.size(), 1))});
      marks.push_back(parameter_mark("direct", forward.direct));
    }
    laws.add({text.state, text.begin, text.code}, fmt::format("block {}, {}: {}", n, name_of(block.law), text.does),
             marks);
  }
};

/// The name of the side channel that acts, as it may stand in a comment; empty where none does.
Result<std::string> side_channel(const Machine& machine) {
  const MachineBlock* first = nullptr;
  for (const MachineBlock& block : machine.blocks) {
    if (block.law != MachineLaw::kSide) continue;
    if (first && block.channel != first->channel) return fail("too_many", "only one side channel can be exported");
    first = &block;
  }
  std::string name = first ? "'" + first->channel + "'" : "";
  constexpr std::string_view kEndsComments = "*/\\\r\n?";
  std::replace_if(
      name.begin(), name.end(), [&](char c) { return kEndsComments.find(c) != std::string_view::npos; }, '_');
  return name;
}

CHead head_of(const Model& model, const std::string& channel) {
  const Machine& machine = *model.machine;
  CHead head{
      .title = fmt::format("Simulation of a machine, a chain of {} blocks.", machine.blocks.size()),
      .sample_period_s = machine.sample_period_s,
      .input_unit = model.input_unit,
      .is_step = "not used: what enters the machine are the samples as they stand",
      .side = channel.empty() ? "not used" : "the side channel " + channel + " as it is recorded, not its deviation",
      .input_noise = "is not used",
      .more = fmt::format("\n * A run that leaves its range, {:g} either way, ends in NaN.", Machine::kLeaves)};
  if (machine.interval_means) {
    head.is_step = "1 where the command was held until this sample and jumped here, 0 where it went straight";
    head.more +=
        "\n *\n * What enters the machine is the mean of the input until the next sample, which is known there: a step "
        "returns the\n * output of the sample before this one, the first step that of rest.";
  }
  return head;
}

/// The constants and types that the code speaks of.
std::string definitions_of(const Machine& machine, std::string_view code) {
  const std::array definitions{
      std::pair{"T", c_define("T", machine.sample_period_s)},
      std::pair{"TWO_PI", c_define("TWO_PI", 2 * std::numbers::pi)},
      std::pair{"LEAVES", c_define("LEAVES", Machine::kLeaves)},
      std::pair{"SETTLED", c_define("SETTLED", SectionState::kSettled)},
      std::pair{"STRAIGHT", c_define("STRAIGHT", Machine::kStraight)},
      std::pair{"SETTLE_EVERY", c_count("SETTLE_EVERY", Machine::kSettleEvery)},
      std::pair{"LOOP_PLAYS", c_count("LOOP_PLAYS", Machine::kLoopPlays)},
      std::pair{"SUB_STEPS", c_count("SUB_STEPS", Machine::kSubSteps)},
      std::pair{"cascade_state", std::string("\ntypedef struct { double level, difference; } cascade_state;\n")}};
  std::string text;
  for (const auto& [name, definition] : definitions) {
    if (code.find(name) != std::string_view::npos) text += definition;
  }
  return text;
}

Result<void> check(const Machine& machine, double sample_period_s) {
  if (const auto checked = check_machine(machine); !checked) return checked;
  if (is_same_period(machine.sample_period_s, sample_period_s)) return {};
  return fail("own_period",
              fmt::format("a machine runs on the sample period of {} s that it was found with ({:.6g} Hz) "
                          "and cannot be exported for {} s ({:.6g} Hz)",
                          machine.sample_period_s, 1 / machine.sample_period_s, sample_period_s, 1 / sample_period_s));
}

}  // namespace

Result<std::string> machine_to_c(const Model& model, double sample_period_s) {
  const Machine& machine = *model.machine;
  if (const auto checked = check(machine, sample_period_s); !checked) return tl::unexpected(checked.error());
  const auto channel = side_channel(machine);
  if (!channel) return tl::unexpected(channel.error());
  Chain chain;
  for (std::size_t n = 0; n < machine.blocks.size(); ++n) chain.add(n, machine.blocks[n]);

  std::string code = chain.constants + "\ntypedef struct {\n  size_t samples;\n";
  if (machine.interval_means) code += "  double input, side;\n  int is_running;\n";
  code += chain.laws.state + "} valvetriage_model;\n";
  code += kCInterface;
  code += called_functions(kLawFunctions, chain.laws.code);
  code +=
      "\nstatic double chain(valvetriage_model *m, double x, double side) {\n  const int is_first = m->samples == 0;\n"
      "  const double t = (double)m->samples * T;\n  (void)is_first;\n  (void)t;\n  (void)side;\n" +
      chain.laws.code + "  return x;\n}\n";
  code += machine.interval_means ? kStepOfMeans : kStep;

  return c_head(head_of(model, *channel)) + definitions_of(machine, code) + code + std::string(kCMain);
}

}  // namespace valvetriage
