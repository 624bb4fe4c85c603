#include "server/wire/model_c.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <span>

#include "core/mechanisms/simulate_extended.h"
#include "core/model/free_run.h"
#include "server/wire/c_source.h"
#include "server/wire/machine_c.h"

namespace valvetriage {
namespace {

/// A law as C: `{n}` is its number, `{0}`, `{1}`, ... its parameters; R, T and the others are constants of the file.
struct LawText {
  std::string_view cause;
  std::string_view state;
  std::string_view begin;
  std::string_view code;
};

constexpr LawText kLawTexts[] = {
    {"friction", "double held{n};", "m->held{n} = driver;",
     "{ const double share = fmax(1 + {3} * (m->held{n} - MIDDLE), 0.05);\n"
     "    if (fabs(driver - m->held{n}) > share * {0})\n"
     "      m->held{n} = driver - copysign(share * fmin({1}, {0}), driver - m->held{n}); }\n"
     "  x -= driver - m->held{n};"},
    {"backlash", "double held{n};", "m->held{n} = x + ({2}) * 0.5 * ({0}) * fmax(1 + {1} * (x - MIDDLE), 0.05);",
     "{ const double half = 0.5 * ({0}) * fmax(1 + {1} * (x - MIDDLE), 0.05);\n"
     "    m->held{n} = fmin(fmax(m->held{n}, x - half), x + half); }\n"
     "  x -= x - m->held{n};"},
    {"hysteresis", "double stop{n}[8], last{n};",
     "m->last{n} = driver;\n"
     "    for (int k = 0; k < 8; ++k) m->stop{n}[k] = ({2}) * ({1}) * (k + 1) / 8;",
     "double sum{n} = 0;\n"
     "  for (int k = 0; k < 8; ++k) {\n"
     "    const double bound = ({1}) * (k + 1) / 8;\n"
     "    m->stop{n}[k] = fmin(fmax(m->stop{n}[k] + (driver - m->last{n}), -bound), bound);\n"
     "    sum{n} += m->stop{n}[k];\n"
     "  }\n"
     "  m->last{n} = driver;\n"
     "  x -= ({0}) * sum{n} / (({1}) * 9);"},
    {"dead_band", "", "",
     "if (x - {0} > 0.5 * ({1})) x -= 0.5 * ({1});\n"
     "  else if (x - {0} < -0.5 * ({1})) x += 0.5 * ({1});\n"
     "  else if ({1} > 0) x = {0};"},
    {"saturation", "", "", "x = -clamped(-clamped(x, {0}), -({1}));"},
    {"gain_loss", "", "", "x *= {0};"},
    {"static_curve", "", "", "x += {0} * x * (1 - x / R);"},
    {"rectified_sensor", "", "", "x = fabs(x);"},
    {"extra_lag", "double in{n}, out{n}, slope{n};", "m->in{n} = m->out{n} = x; m->slope{n} = 0;",
     "if (m->samples > 0 && {0} > 0) {\n"
     "    const double w = T / ({0}), a = exp(-w), r = (x - m->in{n}) / w, b = (r - m->slope{n}) / w;\n"
     "    const double s = r - 0.5 * b * w - b;\n"
     "    m->out{n} = a * m->out{n} + ((m->in{n} - s) * -expm1(-w) + s * w + 0.5 * b * w * w);\n"
     "    m->slope{n} = r;\n"
     "  } else {\n"
     "    m->out{n} = x;\n"
     "  }\n"
     "  m->in{n} = x;\n"
     "  x = m->out{n};"},
    {"resonance", "double in{n}, out{n}, rate{n}, slope{n};", "m->in{n} = m->out{n} = x; m->rate{n} = m->slope{n} = 0;",
     "if (m->samples > 0) {\n"
     "    const double w = 6.283185307179586 * ({0}) * T, z = {1}, u = 1 - z * z, q = sqrt(fabs(u)), g = exp(-z * w);\n"
     "    const double even = q > 1e-8 ? (u > 0 ? cos(q * w) : cosh(q * w)) : 1;\n"
     "    const double odd = q > 1e-8 ? (u > 0 ? sin(q * w) : sinh(q * w)) / q : w;\n"
     "    const double r = (x - m->in{n}) / w, b = (r - m->slope{n}) / w;\n"
     "    const double s = r - 0.5 * b * w - 2 * z * b, settled = m->in{n} - 2 * z * s - b;\n"
     "    const double y0 = m->out{n} - settled, v0 = m->rate{n} - s;\n"
     "    m->out{n} = settled + s * w + 0.5 * b * w * w + g * ((even + z * odd) * y0 + odd * v0);\n"
     "    m->rate{n} = s + b * w + g * (-odd * y0 + (even - z * odd) * v0);\n"
     "    m->slope{n} = r;\n"
     "  }\n"
     "  m->in{n} = x;\n"
     "  x = m->out{n};"},
    {"rate_limit", "double out{n};", "m->out{n} = x;",
     "if (x - m->out{n} > {0} * H) m->out{n} += {0} * H;\n"
     "  else if (x - m->out{n} < -({0} * H)) m->out{n} -= {0} * H;\n"
     "  else m->out{n} = x;\n"
     "  x = m->out{n};"},
    {"stiffening_spring", "", "",
     "{ const double s = sqrt(3 * fabs({0})), f = 1.5 * s * SECANT * (x - REST);\n"
     "    x = REST + 2 / s * ({0} > 0 ? sinh(asinh(f) / 3) : sin(asin(fmin(fmax(f, -1), 1)) / 3)) / SECANT; }"},
    {"self_oscillation", "double size{n}, phase{n};", "m->size{n} = 1e-3; m->phase{n} = {6};",
     "{ const double from = x - ({2}), drive = fmax(1 - from / ({3}) * (from / ({3})), -1), g = {5} * T, r = "
     "m->size{n};\n"
     "    if (r > 1e-3) x += {1} * r * cos(m->phase{n});\n"
     "    m->size{n} = fabs(drive) < 1e-9 ? r / sqrt(1 + 2 * g * r * r)\n"
     "                                    : sqrt(drive / (1 + (drive / (r * r) - 1) * exp(-2 * g * drive)));\n"
     "    if (m->size{n} > 1e-3) m->phase{n} += 6.283185307179586 * ({0}) * T * (1 + {4} / R * from);\n"
     "    else { m->size{n} = 1e-3; m->phase{n} = {6}; } }"},
    {"periodic_disturbance", "", "", "x += {1} * sin(6.283185307179586 * ({0}) * ((double)m->samples * T) + ({2}));"},
    {"thermal_drift", "double warmth{n};", "m->warmth{n} = 0;",
     "x *= 1 + {0} * m->warmth{n};\n"
     "  m->warmth{n} += -expm1(-H / ({1})) * (1 - ({2}) + {2} * square_of_heating(m) - m->warmth{n});"},
    {"sensor_offset", "", "", "x += {0};"},
    {"sensor_drift", "", "", "x += {0} * ((double)m->samples * T);"},
    {"intermittent", "", "", "x *= 1 + {1} * fmin(fmax(((double)m->samples * T - ({0})) / T + 0.5, 0), 1);"},
    {"side_input", "", "", "x += {0} * (side - {1});"},
};

/// What laws call.
constexpr CFunction kLawFunctions[] = {
    {"clamped",
     "\n/* A clamp from above, its corner a parabola over one thousandth of the range to both sides. */\n"
     "static double clamped(double x, double level) {\n  const double knee = 1e-3 * R;\n"
     "  if (!(x > level - knee)) return x;\n  if (x >= level + knee) return level;\n"
     "  return x - (x - level + knee) * (x - level + knee) / (4 * knee);\n}\n"},
    {"square_of_heating",
     "\nstatic double square_of_heating(const valvetriage_model *m) {\n"
     "  const double over = MIDDLE != 0 ? m->input / MIDDLE : 1;\n  return over * over;\n}\n"},
};

const LawText* text_of(std::string_view cause) {
  const auto found = std::find_if(std::begin(kLawTexts), std::end(kLawTexts),
                                  [&](const LawText& text) { return text.cause == cause; });
  return found == std::end(kLawTexts) ? nullptr : found;
}

std::vector<CMark> marks_of(std::size_t n, std::span<const double> parameters) {
  std::vector<CMark> marks{{"n", std::to_string(n)}};
  for (std::size_t j = 0; j < parameters.size(); ++j) marks.push_back(parameter_mark(std::to_string(j), parameters[j]));
  return marks;
}

bool is_neutral(const Mechanism& law, const std::vector<double>& parameters) {
  return law.size_parameter < parameters.size() && parameters[law.size_parameter] == law.neutral &&
         law.cause != "saturation";
}

/// The laws of one place.
CLaws laws_at(const Model& model, Place place) {
  CLaws laws;
  for (std::size_t n = 0; n < model.mechanisms.size(); ++n) {
    const MechanismUse& use = model.mechanisms[n];
    const Mechanism& law = *find_mechanism(use.cause);
    const LawText* text = text_of(use.cause);
    const bool is_inside = model.map && law.acts_in_blocks_alone(use.parameters);
    if (law.place != place || !text || is_inside || is_neutral(law, use.parameters)) continue;
    laws.add({text->state, text->begin, text->code}, fmt::format("{}: {}", law.cause, law.wrong),
             marks_of(n, use.parameters));
  }
  return laws;
}

Result<void> check(const Model& model) {
  std::size_t channels = 0;
  for (const MechanismUse& use : model.mechanisms) {
    if (use.cause == "side_input") ++channels;
    const bool needs_range = use.cause == "static_curve" || use.cause == "self_oscillation";
    if (!model.map && needs_range) {
      return fail("needs_range", fmt::format("{} of a linear model is told in shares of an output range that only a "
                                             "recording has: it cannot be exported",
                                             use.cause));
    }
  }
  if (channels > 1) return fail("too_many", "only one side channel can be exported");
  const auto spool = to_valve_dynamics(model.dynamics);
  if (model.friction && (!spool || spool->lag_s.size() > 1)) {
    return fail("not_exportable", "friction needs a spool of second order, perhaps with a lag before it");
  }
  if (!is_stable(model.dynamics)) return fail("unstable", "the model is unstable and cannot be exported");
  return {};
}

/// The linear system in observer chain form behind its delay; `rise` is how far the input goes over an interval.
constexpr const char* kFilter = R"c(
typedef struct {
  double x[ORDER + 1], u_before, rise_before, late_start[DELAY + 1], late_rise[DELAY + 1];
  size_t oldest;
} ahead_state;

/* What the filter sees at this sample: the start of the interval of DELAY intervals ago. */
static double ahead_now(const ahead_state *f, double start) {
  return DELAY > 0 ? f->late_start[f->oldest] : start;
}

/* y = x[0] + direct . (u, rise, u before, rise before); the rise of this interval is known at the next sample. */
static double ahead_output(const ahead_state *f, double start) {
  double y = ORDER > 0 ? f->x[0] : 0;
  y += direct[0] * ahead_now(f, start);
  if (COLUMNS == 4) y += direct[2] * f->u_before + direct[3] * f->rise_before;
  return y;
}

/* Over an interval. The whole part of the delay: intervals go in as they end, the one of DELAY intervals ago comes
   out. */
static void ahead_advance(ahead_state *f, double start, double rise) {
  double before = 0, u = start, climb = rise;
  int j;
  if (DELAY > 0) {
    u = f->late_start[f->oldest];
    climb = f->late_rise[f->oldest];
    f->late_start[f->oldest] = start;
    f->late_rise[f->oldest] = rise;
    f->oldest = (f->oldest + 1) % (DELAY > 0 ? DELAY : 1);
  }
  for (j = 0; j < ORDER; ++j) {
    const double *w = input_row + j * COLUMNS;
    double next = diagonal[j] * f->x[j] + lower[j] * before + (j + 1 < ORDER ? f->x[j + 1] : 0) + w[0] * u;
    if (COLUMNS >= 2) next += w[1] * climb;
    if (COLUMNS == 4) next += w[2] * f->u_before + w[3] * f->rise_before;
    before = f->x[j];
    f->x[j] = fabs(next) < 1e-200 ? 0 : next;
  }
  f->u_before = u;
  f->rise_before = climb;
}

/* At rest under a constant input. */
static void ahead_begin(ahead_state *f, double start) {
  int j;
  for (j = 0; j < ORDER; ++j) f->x[j] = at_rest[j] * start;
  for (j = 0; j < DELAY; ++j) f->late_start[j] = start;
  f->u_before = start;
}
)c";

/// core/model/sampled_mode.cpp in C.
constexpr const char* kMode = R"c(
typedef struct {
  double rate, at, seen[4], late_start[MODE_DELAY + 1], late_end[MODE_DELAY + 1];
  size_t oldest;
} behind_state;

static double behind_output(const behind_state *f, double start) {
  (void)start;
  return f->at;
}

static void behind_advance(behind_state *f, double start, double rise) {
  double head_start = start, head_end = start + rise, sum, rate, at;
  const double *w, *gain;
  int k;
  if (MODE_DELAY > 0) {
    head_start = f->late_start[f->oldest];
    head_end = f->late_end[f->oldest];
    f->late_start[f->oldest] = start;
    f->late_end[f->oldest] = start + rise;
    f->oldest = (f->oldest + 1) % (MODE_DELAY > 0 ? MODE_DELAY : 1);
  }
  f->seen[0] = f->seen[2];
  f->seen[1] = f->seen[3];
  f->seen[2] = head_start;
  f->seen[3] = head_end;
  sum = f->seen[0] + f->seen[1] + f->seen[2] + f->seen[3];
  w = 0.25 * sum < f->at ? falling : rising;
  gain = 0.25 * sum < f->at ? falling_gain : rising_gain;
  rate = w[0] * f->rate + w[1] * f->at;
  at = w[2] * f->rate + w[3] * f->at;
  for (k = 0; k < 4; ++k) {
    rate += gain[2 * k] * f->seen[k];
    at += gain[2 * k + 1] * f->seen[k];
  }
  f->rate = rate;
  f->at = at;
}

static void behind_begin(behind_state *f, double start) {
  int j;
  f->at = start;
  for (j = 0; j < 4; ++j) f->seen[j] = start;
  for (j = 0; j < MODE_DELAY; ++j) f->late_start[j] = f->late_end[j] = start;
}
)c";

std::string mode_text(const SampledMode& mode) {
  std::string text = fmt::format("#define MODE_DELAY {}\n", mode.whole_delay());
  for (const bool falls : {false, true}) {
    const SampledMode::Step& step = mode.step(falls);
    std::vector<double> transition, gain;
    for (const auto& row : step.transition) transition.insert(transition.end(), row.begin(), row.end());
    for (const auto& column : step.gain) gain.insert(gain.end(), column.begin(), column.end());
    const std::string_view name = falls ? "falling" : "rising";
    text += c_array(name, transition) + c_array(fmt::format("{}_gain", name), gain);
  }
  return text + kMode;
}

/// Without a mode the volume follows the map.
constexpr const char* kNoMode = R"c(
typedef struct { char none; } behind_state;
static double behind_output(const behind_state *f, double start) { (void)f; return start; }
static void behind_advance(behind_state *f, double start, double rise) { (void)f; (void)start; (void)rise; }
static void behind_begin(behind_state *f, double start) { (void)f; (void)start; }
)c";

std::string filter_text(const LinearFilter& filter) {
  const ChainForm& chain = filter.chain();
  std::vector<double> rows;
  for (Eigen::Index j = 0; j < chain.input.rows(); ++j) {
    for (Eigen::Index c = 0; c < chain.input.cols(); ++c) rows.push_back(chain.input(j, c));
  }
  const FilterState rest = filter.steady(1.0).value_or(filter.rest());
  const std::vector<double> direct(chain.direct.begin(), chain.direct.end());
  return fmt::format("#define ORDER {}\n#define COLUMNS {}\n#define DELAY {}\n", filter.order(), chain.input.cols(),
                     filter.delay_samples()) +
         c_array("diagonal", chain.diagonal) + c_array("lower", chain.lower) + c_array("input_row", rows) +
         fmt::format("static const double direct[4] = {{{}}};\n", c_numbers(direct)) + c_array("at_rest", rest.x) +
         kFilter;
}

/// core/model/spool_friction.cpp in C; the intervals of its delay in a ring.
constexpr const char* kSlidingSpool = R"c(
/* The force on the spool at a time in samples, delayed. */
static double spool_input(const valvetriage_model *m, double time) {
  const double t = time - SPOOL_DELAY;
  size_t interval;
  if (t <= 0) return m->first;
  interval = (size_t)t;
  return m->from[interval % INTERVALS] +
         (m->to[interval % INTERVALS] - m->from[interval % INTERVALS]) * (t - (double)interval);
}

/* Friction: sticks until the force difference passes breakaway, then slips (Stribeck); one trapezoidal step. */
static void spool_step(valvetriage_model *m, double samples, double commanded) {
  const double h = H * samples, stiff = 0.25 * h * h * NATURAL * NATURAL, damp = h * DAMPING * NATURAL;
  const double keep = 1 - stiff - damp, push = h * NATURAL * NATURAL;
  const double half_way = COIL_LAG > 0 ? -expm1(-0.5 * h / COIL_LAG) : 1;
  const double relative = m->spool_v / STRIBECK, share = fmax(1 + GROWTH * (m->spool_x - MIDDLE), 0.05);
  const double force =
      share * (KINETIC + (relative * relative < 30 ? (BREAKAWAY - KINETIC) * exp(-relative * relative) : 0));
  const double most = push * force, in_time = 1 / (1 + stiff + damp);
  double u, free_v, moved, moving = 1;
  m->lagged += half_way * (commanded - m->lagged);
  u = m->lagged;
  m->lagged += half_way * (commanded - m->lagged);
  if (fabs(commanded - m->lagged) < 1e-9) m->lagged = commanded;
  free_v = m->spool_v * keep + push * (u - m->spool_x);
  moved = in_time * (free_v - fmin(fmax(free_v, -most), most));
  if (m->spool_v != 0 && moved == 0) {
    moving = m->spool_v / (m->spool_v - in_time * (free_v - copysign(most, m->spool_v)));
  }
  m->spool_x += 0.5 * h * (m->spool_v * moving + moved);
  m->spool_v = moved;
}

/* Where the force jumps inside a step, that is taken in two. */
static void spool_advance(valvetriage_model *m, double start, double end) {
  const size_t interval = m->runs - 1;
  int k;
  m->from[interval % INTERVALS] = start;
  m->to[interval % INTERVALS] = end;
  for (k = 0; k < SUBSTEPS; ++k) {
    const double from = (double)interval + (double)k / SUBSTEPS, to = from + 1.0 / SUBSTEPS;
    const double last = to - SPOOL_DELAY;
    const size_t late = last < 1 ? 0 : (size_t)last;
    const double edge = (double)late + SPOOL_DELAY;
    const int is_inside = late > 0 && late <= interval && edge > from && edge < to;
    if (is_inside && m->from[late % INTERVALS] != m->to[(late - 1) % INTERVALS]) {
      spool_step(m, edge - from, spool_input(m, 0.5 * (from + edge)));
      spool_step(m, to - edge, spool_input(m, 0.5 * (edge + to)));
    } else {
      spool_step(m, 1.0 / SUBSTEPS, spool_input(m, from + 0.5 / SUBSTEPS));
    }
  }
}

static void spool_begin(valvetriage_model *m, double start) {
  m->first = m->lagged = m->spool_x = start;
}

static double spool_output(const valvetriage_model *m, double y) {
  (void)y;
  return m->spool_x;
}
)c";

constexpr const char* kFreeSpool = R"c(
static void spool_advance(valvetriage_model *m, double start, double end) { (void)m; (void)start; (void)end; }
static void spool_begin(valvetriage_model *m, double start) { (void)m; (void)start; }
static double spool_output(const valvetriage_model *m, double y) { (void)m; return y; }
)c";

constexpr const char* kMap = R"c(
static double steady_output(double x) {
  int low = 0, high = KNOTS - 1;
  while (high - low > 1) {
    const int middle = (low + high) / 2;
    if (map_input[middle] <= x) low = middle; else high = middle;
  }
  return map_output[low] + (map_output[high] - map_output[low]) / (map_input[high] - map_input[low]) * (x - map_input[low]);
}
)c";

/// core/model/orifice_volume.cpp in C.
constexpr const char* kVolume = R"c(
/* (p + e)^n - e^n and its slope, the tangent below zero: laminar at drops below e = 0.1 psi. */
static double orifice(double p, double n, double *slope) {
  const double e = 0.1, zero = pow(e, n);
  if (p < 0) {
    *slope = n * zero / e;
    return *slope * p;
  }
  *slope = n * pow(p + e, n) / (p + e);
  return pow(p + e, n) - zero;
}

/* The metering edge is sharp. */
static double drop_of(double p, double *slope) {
  const double drop = fmax(SUPPLY - p, 1), flow = sqrt(drop);
  *slope = -0.5 * flow / drop;
  return flow;
}

/* What flows in under a drop of 1 psi where a steady pressure is asked for. */
static double inflow_of(double steady) {
  double ignored;
  steady = fmin(steady, STOP);
  return orifice(steady, EXPONENT, &ignored) / drop_of(steady, &ignored);
}

/* Entrained air: divides by the capacity at p over that at the reference. */
static void soften(double p, double *rate, double *slope) {
  const double reference = REFERENCE + 14.7, q = reference / (fmax(p, 0) + 14.7);
  const double per_capacity = (1 + AIR_SHARE) / (1 + AIR_SHARE * q * q);
  const double rise = p > 0 ? per_capacity * per_capacity * 2 * AIR_SHARE * q * q * q / (reference * (1 + AIR_SHARE)) : 0;
  *slope = *slope * per_capacity + *rate * rise;
  *rate *= per_capacity;
}

/* dp/dt and its slope over p. */
static double volume_rate(double p, double inflow, double *slope) {
  double out_slope, loss_slope, drop_slope, rate;
  const double out = DRAIN_SHARE * orifice(p, DRAIN_EXPONENT, &out_slope);
  const double loss = LOSS_SHARE * orifice(p, 0.5, &loss_slope), drop = drop_of(p, &drop_slope);
  rate = SCALE * (drop * inflow - (out + loss));
  *slope = SCALE * (inflow * drop_slope - (DRAIN_SHARE * out_slope + LOSS_SHARE * loss_slope));
  soften(p, &rate, slope);
  if (rate < 0) {
    rate /= FALL_RATIO;
    *slope /= FALL_RATIO;
  }
  return rate;
}

static double relaxed(double x) { return fabs(x) < 1e-9 ? 1 : -expm1(-x) / x; }

static double volume_settled(double steady) {
  double low, high, ignored;
  int halving;
  steady = fmin(steady, STOP);
  if (IS_HEALTHY) return fmin(steady, CEILING);
  low = fmin(steady, 0) - 1;
  high = fmax(SUPPLY, steady + 1);
  for (halving = 0; halving < 80; ++halving) {
    const double middle = 0.5 * (low + high);
    if (volume_rate(middle, inflow_of(steady), &ignored) > 0) low = middle; else high = middle;
  }
  return fmin(0.5 * (low + high), CEILING);
}

/* One sample, its inflow by Simpson's rule: half a step with the slope at its start, then the whole with the slope at
   the middle. */
static double volume_advance(double p, double steady, double half_way, double next_steady) {
  const double inflow = (inflow_of(steady) + 4 * inflow_of(half_way) + inflow_of(next_steady)) / 6;
  double slope, rate = volume_rate(p, inflow, &slope), half;
  half = p + 0.5 * T * rate * relaxed(-0.5 * T * slope);
  rate = volume_rate(half, inflow, &slope);
  return fmin(p + T * relaxed(-T * slope) * (rate + slope * (p - half)), CEILING);
}
)c";

constexpr const char* kLoop = R"c(
/* Prandtl-Ishlinskii: what the loop holds back of the force. */
static double loop_held_back(valvetriage_model *m, double driver) {
  double held_back = 0;
  int k;
  for (k = 0; k < 4; ++k) {
    m->stop[k] = fmin(fmax(m->stop[k] + (driver - m->loop_driver), -loop_threshold[k]), loop_threshold[k]);
    held_back += 0.5 * LOOP_WIDTH * loop_share[k] / loop_threshold[k] * m->stop[k];
  }
  m->loop_driver = driver;
  return held_back;
}
)c";

/// From the input's value at this sample to what has entered G, then through the rest of the chain.
constexpr const char* kStep = R"c(
static double gated(double at, double input, double noise) {
  return fmin(fmax(at, input - noise), input + noise);
}

void valvetriage_start(valvetriage_model *m, double input, double input_noise) {
  *m = (valvetriage_model){0};
  m->input = m->driver = input;
  m->noise = input_noise;
}

/* The steady pressure that the input asks for. */
static double asked_for(valvetriage_model *m, double input, int is_step) {
  const double driver_before = m->driver;
  double start, y;
  int is_held = 0;
  m->driver = gated(m->driver, input, m->noise);
  if (m->runs > 0) {
    /* the interval that ends here */
    const double end_raw = is_step ? m->input : input;
    const double end_driver = end_raw == m->input ? driver_before : m->driver;
    double end = input_laws(m, end_raw, end_driver, 0);
    m->input = input;
    start = input_laws(m, input, m->driver, 0);
    {
      const double bare_end = end, bare_start = start, held_before = m->held_back;
      m->force_driver = gated(m->force_driver, start, m->noise);
      m->held_back = loop_held_back(m, m->force_driver);
      start -= m->held_back;
      end = bare_end == bare_start ? start : bare_end - held_before;
    }
    start -= INPUT_OFFSET;
    end -= INPUT_OFFSET;
    is_held = !IS_SLOWED && end == m->start;
    ahead_advance(&m->ahead, m->start, end - m->start);
    spool_advance(m, m->start, end);
  } else {
    start = input_laws(m, input, m->driver, 1);
    m->force_driver = m->loop_driver = start;
    m->held_back = loop_held_back(m, start);
    start -= m->held_back + INPUT_OFFSET;
    ahead_begin(&m->ahead, start);
    spool_begin(m, start);
  }
  m->start = start;
  y = spool_output(m, ahead_output(&m->ahead, start));
  y = position_laws(m, y, m->runs == 0);
  y = fmin(map_laws(m, steady_output(y), m->runs == 0), MAP_STOP);
  if (m->runs == 0) behind_begin(&m->behind, y);
  else behind_advance(&m->behind, m->mapped, is_held ? 0 : y - m->mapped);
  m->mapped = y;
  ++m->runs;
  return behind_output(&m->behind, y);
}

double valvetriage_step(valvetriage_model *m, double input, int is_step, double side) {
  double y, steady;
  if (IS_HELD) is_step = 1;
  if (m->samples == 0) {
    steady = asked_for(m, input, is_step);
    m->pressure = volume_settled(steady);
  } else {
#if HAS_VOLUME
    const double end = is_step ? m->input : input;
    const double half_way = asked_for(m, m->input + 0.5 * (end - m->input), 0);
#else
    const double half_way = 0;
#endif
    steady = asked_for(m, input, is_step);
    m->pressure = volume_advance(m->pressure, m->steady, half_way, steady);
  }
  m->steady = steady;
  y = output_laws(m, m->pressure + OUTPUT_OFFSET, m->samples == 0, side);
  ++m->samples;
  return y;
}
)c";

/// Healthy flows as the volume's class has them: κ, and the shares of another drain and of a loss.
std::string volume_constants(const OrificeVolume& v) {
  constexpr double kLaminar = 0.1;  // as in the text above
  const auto flow = [](double p, double n) { return std::pow(p + kLaminar, n) - std::pow(kLaminar, n); };
  const double n = v.exponent, reference = v.reference_psi;
  const double drop = std::max(v.supply_psi - reference, 1.0);
  const double slope = n * std::pow(reference + kLaminar, n - 1) + flow(reference, n) * 0.5 / drop;
  const double drain = v.drain_excess_exponent != 0 ? std::max(n + v.drain_excess_exponent, 0.05) : n;
  const double highest = v.highest_psi > 0 ? v.highest_psi : 2 * reference;
  return c_define("SUPPLY", v.supply_psi) + c_define("EXPONENT", n) + c_define("DRAIN_EXPONENT", drain) +
         c_define("DRAIN_SHARE", flow(reference, n) / flow(reference, drain)) +
         c_define("LOSS_SHARE", v.loss_fraction * flow(highest, n) / flow(highest, 0.5)) +
         c_define("SCALE", 1 / (v.time_constant_s * slope)) + c_define("FALL_RATIO", v.fall_to_rise_ratio) +
         c_define("CEILING", v.ceiling_psi) + c_define("STOP", v.stop_psi) + c_define("REFERENCE", reference) +
         c_define("AIR_SHARE", v.air_share) +
         c_define("IS_HEALTHY", v.drain_excess_exponent == 0 && v.loss_fraction == 0 ? 1 : 0);
}

/// A sliding spool's, as core/model/spool_friction.cpp derives them.
std::string spool_constants(const ValveDynamics& spool, const SpoolFriction& friction, double period_s) {
  const int substeps = sliding_substeps(spool, period_s);
  const double lag_s = spool.lag_s.empty() ? 0 : spool.lag_s.front();
  const double delay = spool.delay_s / period_s;
  return fmt::format("#define SUBSTEPS {}\n#define INTERVALS {}\n", substeps, static_cast<long>(delay) + 2) +
         c_define("SPOOL_DELAY", delay) + c_define("NATURAL", spool.natural_frequency_rad_s) +
         c_define("DAMPING", spool.damping_ratio) + c_define("BREAKAWAY", friction.breakaway_a) +
         c_define("KINETIC", std::min(friction.kinetic_a, friction.breakaway_a)) +
         c_define("STRIBECK", friction.stribeck_a_per_s) + c_define("GROWTH", friction.growth.per_a) +
         c_define("COIL_LAG", lag_s);
}

std::string law_function(std::string_view name, std::string_view extra, const std::string& code) {
  return fmt::format("\nstatic double {}(valvetriage_model *m, double x, {}) {{\n  (void)m;\n{}  return x;\n}}\n", name,
                     extra, code);
}

}  // namespace

Result<std::string> to_c(const Model& given, double sample_period_s) {
  if (!(sample_period_s > 0)) return fail("not_positive", "the sample period must be positive");
  if (given.machine) return machine_to_c(given, sample_period_s);
  const auto model = with_reshaped_blocks(given);
  if (!model) return tl::unexpected(model.error());
  if (auto checked = check(*model); !checked) return tl::unexpected(checked.error());
  const double inner_period_s = sample_period_s / static_cast<double>(runs_per_sample(*model));
  const auto dynamics = run_dynamics(*model, inner_period_s);
  if (!dynamics) return tl::unexpected(dynamics.error());

  const double gain = model->map ? 1 : static_gain(model->dynamics);
  const bool is_valve = model->map.has_value(), is_held = model->input_between == InputBetween::kHeld;
  const double low_a = is_valve ? model->map->input.front() : given.input_offset;
  const double high_a = is_valve ? model->map->input.back() : given.input_offset;
  const double rise = is_valve ? model->map->output.back() - model->map->output.front() : 0;

  std::string text =
      c_head({.title = is_valve ? "Simulation of a valve." : "Simulation of a linear machine.",
              .sample_period_s = sample_period_s,
              .input_unit = given.input_unit,
              .is_step = is_held ? "does not count: the command is held between all of its samples"
                                 : "1 where the command was held until this sample and jumped here, 0 where it went "
                                   "straight",
              .side = "the side channel; does not count where the model has none",
              .input_noise = "is the standard deviation of the noise on\n * the input, 0 for a command",
              .more = ""});
  text += c_define("T", sample_period_s) + c_define("H", inner_period_s) +
          fmt::format("#define HAS_VOLUME {}\n#define IS_HELD {}\n#define IS_SLOWED {}\n", model->volume ? 1 : 0,
                      is_held ? 1 : 0, dynamics->spool ? 1 : 0);
  text += c_define("INPUT_OFFSET", given.input_offset) + c_define("OUTPUT_OFFSET", given.output_offset);
  text += c_define("R", std::abs(rise)) + c_define("MIDDLE", 0.5 * (low_a + high_a)) + c_define("REST", low_a) +
          c_define("SECANT", is_valve ? rise / (high_a - low_a) : gain);
  text += c_define("LOOP_WIDTH", model->loop ? model->loop->width_a : 0);
  const OrificeVolume volume = model->volume.value_or(OrificeVolume{});
  text += c_define("MAP_STOP", (dynamics->behind ? volume : without_stop(volume)).stop_psi);
  if (model->volume) text += volume_constants(dynamics->behind ? without_stop(volume) : volume);
  const bool slides = is_valve && model->friction && dynamics->spool;
  if (slides) text += spool_constants(*dynamics->spool, *model->friction, inner_period_s);
  text += c_array("loop_threshold", model->loop.value_or(MagneticLoop{}).thresholds_a()) +
          c_array("loop_share", model->loop ? model->loop->shares : MagneticLoop::kEqualShares);
  if (is_valve) {
    text += fmt::format("#define KNOTS {}\n", model->map->input.size());
    text += c_array("map_input", model->map->input) + c_array("map_output", model->map->output);
  }

  const CLaws input = laws_at(*model, Place::kInput), position = laws_at(*model, Place::kPosition),
              steady = laws_at(*model, Place::kSteady);
  CLaws output = laws_at(*model, Place::kOutput);
  const CLaws reading = laws_at(*model, Place::kReading);
  output.state += reading.state;
  output.code += reading.code;
  text += filter_text(dynamics->ahead);
  text += dynamics->behind ? mode_text(*dynamics->behind) : kNoMode;
  text +=
      "\ntypedef struct {\n  size_t samples, runs;\n  double input, driver, force_driver, loop_driver, noise, start, "
      "held_back, stop[4];\n  ahead_state ahead;\n  behind_state behind;\n  double mapped, steady, pressure;\n" +
      std::string(slides ? "  double from[INTERVALS], to[INTERVALS], first, lagged, spool_x, spool_v;\n" : "") +
      input.state + position.state + steady.state + output.state + "} valvetriage_model;\n";
  text += kCInterface;
  text += called_functions(kLawFunctions, output.code + steady.code);
  const char* begin = "  (void)is_first;\n";
  const std::string to_position = is_valve ? "" : "  x = x / SECANT + REST;\n";
  const std::string from_position = is_valve ? "" : "  x = (x - REST) * SECANT;\n";
  text +=
      law_function("input_laws", "double driver, int is_first", "  (void)driver;\n" + std::string(begin) + input.code);
  text += law_function("position_laws", "int is_first",
                       begin + (position.code.empty() ? "" : to_position + position.code + from_position));
  text += law_function("map_laws", "int is_first", begin + (is_valve ? steady.code : ""));
  text += law_function("output_laws", "int is_first, double side",
                       begin + std::string("  (void)side;\n") + (is_valve ? "" : steady.code) + output.code);
  text += is_valve ? kMap : "\nstatic double steady_output(double x) { return x; }\n";
  text += model->volume ? kVolume
                        : "\nstatic double volume_settled(double steady) { return steady; }\n"
                          "static double volume_advance(double p, double before, double half_way, double steady) {\n"
                          "  (void)p;\n  (void)before;\n  (void)half_way;\n  return steady;\n}\n";
  text += kLoop;
  text += slides ? kSlidingSpool : kFreeSpool;
  text += kStep;
  return text += kCMain;
}

}  // namespace valvetriage
