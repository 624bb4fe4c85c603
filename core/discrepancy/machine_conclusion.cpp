#include "core/discrepancy/machine_conclusion.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/discrepancy/machine_leftover.h"
#include "core/discrepancy/machine_report.h"
#include "core/discrepancy/machine_shape.h"
#include "core/discrepancy/settled.h"
#include "core/mechanisms/mechanism.h"

namespace valvetriage {
namespace {

// Margins between held-out errors that served well on recordings of ten machines: a linear
// truth gained 1.1 at most.
constexpr double kOverLinear = 1.3;
constexpr double kOverNextFamily = 1.2;
constexpr double kOverSameFamily = 1.08;
constexpr double kOverSingle = 1.15;
constexpr double kRemovedBySecond = 0.3;  // of what the single leaves above the floor, in squares
// Of what a law explains: no second cause (lesson of the valve's laws).
constexpr double kLeftOfLaw = 0.05, kLeftOfMemory = 0.15;
constexpr double kPooledGain = 1.5;
constexpr double kOverLinearWhitened = 1.1;  // of what a linear machine with more freedom gains at most in slow noise
constexpr double kAddedShare = 0.1;          // of the squared error that a second cause takes away
constexpr double kBeyondDoubt = 2;           // times closer: no consistency over blocks is asked for
constexpr double kFarBeyondDoubt = 10;       // times closer: less than a hundredth of the squares is left
constexpr double kConsistent = 0.1;
constexpr double kNearFloor = 2;  // noise floors that a confident name may leave without a wider margin
constexpr double kClearlySignificant = 0.01;
constexpr double kAboveFloors = 1.5;
constexpr double kBlackBoxBetter = 1.3;
constexpr double kSignificant = 0.05;
constexpr double kExcludedWeight = 0.01;
constexpr double kOverLinearOfFeedback = 1.5;
constexpr double kLeastDriven = 0.05;  // of the output's power, by the input
constexpr double kBend = 1e-3;         // of a spring's force at the output's deviation: its cubic part
constexpr double kLoopBend = 0.1;      // of a loop's slope over the output's range
// Odds of 40 to 1 at a factor 1.2: a probability of 0.95 is met only where the margins are.
const double kSteepness = std::log(40.0) / std::log(kOverNextFamily);

/// Stick-slip whose kinetic level is its breakaway is lost motion: the simpler name stands.
bool is_degenerate(const MachineScore& score) {
  for (const MachineBlock& block : score.fit.machine.blocks) {
    if (block.law == MachineLaw::kStickSlip && block.parameters[1] > 0.9 * block.parameters[0]) return true;
    if (block.law == MachineLaw::kLoop && block.parameters[0] < 0.02 * block.parameters[1]) return true;
  }
  return false;
}

bool same_causes(const MachineScore& a, const MachineScore& b) {
  return a.name() == b.name();
}

/// A dead band at the far end of the input that is no closer than a stop, which has one parameter less.
bool is_only_a_stop(const MachineScore& score, const MachineSearch& search, const MachineData& data) {
  constexpr double kNoCloser = 0.01;  // of the held-out error
  const auto& blocks = score.fit.machine.blocks;
  const auto band = std::ranges::find(blocks, MachineLaw::kDeadBand, &MachineBlock::law);
  if (band == blocks.end() || data.records.empty()) return false;
  MachineScore stop{.causes = score.causes};
  std::ranges::replace(stop.causes, "dead_band", "saturation");
  const bool is_known = std::ranges::any_of(search.scores, [&](const MachineScore& other) {
    return other.held_out && same_causes(other, stop) && other.mean < score.mean + kNoCloser;
  });
  return is_known &&
         is_at_far_end(data, score.fit, static_cast<std::size_t>(band - blocks.begin()), search.ground.input_zero);
}

/// Whether a law that was held out is one that could be named.
bool is_possible(const MachineScore& score, const MachineSearch& search, const MachineData& data) {
  return score.held_out && !is_degenerate(score) && has_effect(score, data, search.ground) &&
         !is_only_a_stop(score, search, data);
}

std::string family_set(const MachineScore& score) {
  std::vector<std::string> families;
  for (const std::string& cause : score.causes) families.push_back(family_of(cause));
  std::sort(families.begin(), families.end());
  std::string all;
  for (const std::string& family : families) all += family + "+";
  return all;
}

/// A rival that has all of the winner's causes and more: no other explanation, only a longer one.
bool contains(const MachineScore& rival, const MachineScore& winner) {
  return rival.causes.size() > winner.causes.size() &&
         std::all_of(winner.causes.begin(), winner.causes.end(), [&](const std::string& cause) {
           return std::find(rival.causes.begin(), rival.causes.end(), cause) != rival.causes.end();
         });
}

/// A rival is out of the race where the winner is clearly and consistently closer. One that was not held out is out
/// only where its fit to all samples is clearly worse: the search stopped there for want of effort, not of merit.
bool excluded(const MachineScore& rival, const MachineScore& winner) {
  if (contains(rival, winner)) return true;
  if (!rival.held_out) return rival.fit.rms() >= kOverNextFamily * winner.fit.rms();
  const BlockComparison comparison = compare_blocks(winner.log_rms, rival.log_rms);
  const double ratio = std::exp(comparison.log_gain);
  if (ratio >= kBeyondDoubt) return true;
  const double needed = family_set(rival) == family_set(winner) ? kOverSameFamily : kOverNextFamily;
  return ratio >= needed && comparison.p_value < kConsistent;
}

double squares_of(const MachineScore& score, std::size_t group) {
  return std::exp(2 * score.log_rms[group]);
}

/// Better where it matters and worse nowhere: what acts in few blocks only cannot win most of them. The squared error
/// that it adds anywhere must be small against what it takes away.
bool wins_where_it_acts(const MachineScore& pair, const MachineScore& single) {
  double taken = 0, added = 0, before = 0;
  for (std::size_t i = 0; i < pair.log_rms.size(); ++i) {
    const double change = squares_of(single, i) - squares_of(pair, i);
    (change > 0 ? taken : added) += std::abs(change);
    before += squares_of(single, i);
  }
  return taken - added > (1 - 1 / (kPooledGain * kPooledGain)) * before && added < kAddedShare * taken;
}

double sum_of_squares(const MachineScore& score) {
  double sum = 0;
  for (std::size_t i = 0; i < score.log_rms.size(); ++i) sum += squares_of(score, i);
  return sum;
}

/// Whether a second law removes more than the first may leave of its own effect: that is an idealisation, and what
/// remembers is run from sample to sample.
bool removes_more_than_a_law_leaves(const MachineScore& pair, const MachineScore& single, const MachineScore& linear) {
  const bool remembers = std::any_of(single.causes.begin(), single.causes.end(),
                                     [](const std::string& cause) { return family_of(cause) == "memory"; });
  const double share = remembers ? kLeftOfMemory : kLeftOfLaw;
  const double explained = sum_of_squares(linear) - sum_of_squares(single);
  return sum_of_squares(single) - sum_of_squares(pair) > share * share * explained;
}

/// Whether a pair earns its second cause beside the best single. Where the single leaves no more than the noise, there
/// is nothing to earn; where it leaves no more of what it explains than a law may, neither.
bool pays(const MachineScore& pair, const MachineScore& single, const MachineScore& linear, double floor) {
  if (single.rms() <= floor) return false;
  if (!removes_more_than_a_law_leaves(pair, single, linear)) return false;
  const double left = std::max(std::exp(2 * single.mean) - floor * floor, 1e-18);
  const double removed = std::exp(2 * single.mean) - std::exp(2 * pair.mean);
  const bool most_blocks =
      pair.mean < single.mean - std::log(kOverSingle) && sign_test(pair.log_rms, single.log_rms) < 2 * kSignificant;
  return removed > kRemovedBySecond * left && (most_blocks || wins_where_it_acts(pair, single));
}

/// What a law must have over the linear machine, and how sure of it one must be.
struct Margin {
  double gain = kOverLinear;
  double significant = kSignificant;
};

/// Whether a law beats the linear machine by its margin: in the held-out error, consistently over the blocks, and where
/// slow wander counts once.
bool beats_linear(const MachineScore& score, const MachineScore& linear, const Margin& margin) {
  if (!(score.mean < linear.mean - std::log(margin.gain))) return false;
  if (!(compare_blocks(score.log_rms, linear.log_rms).p_value < margin.significant)) return false;
  const BlockComparison whitened = compare_whitened(score, linear);
  return whitened.log_gain > std::log(kOverLinearWhitened) && whitened.p_value < margin.significant;
}

/// The best explanation: a single cause, or a pair where that pays. One that does not beat the linear machine is no
/// rung to measure the next one against; it is returned only where nothing else is left.
const MachineScore* best_of(const MachineSearch& search, const MachineData& data, double floor, const Margin& margin) {
  const MachineScore *single = nullptr, *pair = nullptr, *any = nullptr;
  for (const MachineScore& score : search.scores) {
    if (!is_possible(score, search, data)) continue;
    if (!any || score.mean < any->mean) any = &score;
    if (!beats_linear(score, search.linear, margin)) continue;
    const MachineScore*& best = score.causes.size() > 1 ? pair : single;
    if (best && score.mean >= best->mean) continue;
    // What one of two laws adds without a size of its own is a better place of the other one, or chance.
    if (score.causes.size() > 1 && !have_certain_sizes(score.causes, data, score.fit)) continue;
    best = &score;
  }
  if (!pair || !single) return pair ? pair : (single ? single : any);
  return pays(*pair, *single, search.linear, floor) ? pair : single;
}

/// A law of the restoring force beats the linear machine without the effect that its name says: a spring that gives
/// way, a loop without memory. Structure that has no name here. Where a law with a name beats the linear machine too,
/// a spring that gives way must be closer than that, by the margin and as consistently as a rival has to be; a loop
/// without memory may harden, and says nothing against a spring that does.
bool bends_without_a_name(const MachineSearch& search, const MachineData& data, const Margin& margin,
                          const MachineScore* named) {
  const auto bends = [&](const MachineBlock& block) {
    if (block.law == MachineLaw::kSpring) {
      return std::abs(gain_seen(data, block.sections, block.feedback)) > kBend;
    }
    return block.law == MachineLaw::kRestoringLoop && !named &&
           std::abs(block.parameters[1]) * search.ground.output_range() > kLoopBend;
  };
  return std::any_of(search.scores.begin(), search.scores.end(), [&](const MachineScore& score) {
    const auto& blocks = score.fit.machine.blocks;
    return score.held_out && score.causes.size() == 1 && beats_linear(score, search.linear, margin) &&
           (!named || excluded(*named, score)) && std::any_of(blocks.begin(), blocks.end(), bends) &&
           !has_effect(score, data, search.ground);
  });
}

/// Causes that could stand in the place of the winner's: from rivals that share everything else with it.
std::vector<std::vector<std::string>> alternatives_of(const MachineSearch& search, const MachineData& data,
                                                      const MachineScore& winner) {
  std::vector<std::vector<std::string>> alternatives(winner.causes.size());
  const auto offer = [&](std::size_t place, const std::string& cause) {
    auto& list = alternatives[place];
    if (cause == winner.causes[place] || std::find(list.begin(), list.end(), cause) != list.end()) return;
    list.push_back(cause);
  };
  for (const MachineScore& rival : search.scores) {
    if (same_causes(rival, winner) || excluded(rival, winner)) continue;
    if (!is_possible(rival, search, data)) continue;
    if (rival.mean > search.linear.mean - std::log(kOverLinear) / 2) continue;
    for (std::size_t i = 0; i < winner.causes.size(); ++i) {
      const bool elsewhere_same =
          std::all_of(winner.causes.begin(), winner.causes.end(), [&](const std::string& cause) {
            return cause == winner.causes[i] ||
                   std::find(rival.causes.begin(), rival.causes.end(), cause) != rival.causes.end();
          });
      if (!elsewhere_same) continue;
      for (const std::string& cause : rival.causes) {
        if (std::find(winner.causes.begin(), winner.causes.end(), cause) == winner.causes.end()) offer(i, cause);
      }
    }
    if (winner.causes.size() == 1 && rival.causes.size() == 1) offer(0, rival.causes[0]);
  }
  if (!search.ground.one_rate) return alternatives;
  for (std::size_t i = 0; i < winner.causes.size(); ++i) {
    if (family_of(winner.causes[i]) != "memory") continue;
    for (const char* cause : {"hysteresis", "backlash", "friction", "extra_lag"}) offer(i, cause);
  }
  return alternatives;
}

bool is_settled(const std::vector<std::vector<std::string>>& alternatives) {
  return std::all_of(alternatives.begin(), alternatives.end(), [](const auto& list) { return list.empty(); });
}

Candidate row(const std::string& cause, double rms) {
  return {.cause = cause, .probability = 0, .rmse_heldout = rms};
}

/// Every explanation once, with a weight by its held-out error; probabilities sum to 1. Where nothing was added, what
/// is concluded about the linear machine outweighs the rest: a black box closer on the mean, but on too few blocks,
/// does not outweigh `none`; structure without a name is `unknown`, however far a black box is from it.
std::vector<Candidate> weigh(const MachineSearch& search, const MachineData& data, const MachineScore* winner,
                             const std::vector<std::vector<std::string>>& alternatives, Conclusion conclusion) {
  constexpr double kDecided = 20, kUndecided = 0.5;
  const bool supported = conclusion == Conclusion::kNamed || conclusion == Conclusion::kAmbiguous;
  const double reference = winner && supported ? winner->mean : search.linear.mean - std::log(kOverLinear);
  std::vector<Candidate> rows;
  std::vector<double> weights;
  const auto add = [&](Candidate candidate, double weight) {
    for (const Candidate& known : rows) {
      if (known.cause == candidate.cause) return;
    }
    rows.push_back(std::move(candidate));
    weights.push_back(weight);
  };
  const auto weight = [&](double mean) { return std::min(1.0, std::exp(-kSteepness * (mean - reference))); };
  const double none_bonus = std::log(kOverLinear / kOverNextFamily);
  double nameless = 0;  // of a law without the effect of its name: structure, and close
  for (const MachineScore& score : search.scores) {
    Candidate candidate =
        row(score.name(), score.held_out ? held_out_rms(score) : std::numeric_limits<double>::quiet_NaN());
    if (!score.held_out) candidate.reason = "its fit to all samples was far from the best: not held out";
    double w = score.held_out ? weight(score.mean) : 0;
    if (&score != winner && winner && supported && excluded(score, *winner)) w = std::min(w, kExcludedWeight);
    if (is_degenerate(score) || is_only_a_stop(score, search, data)) {
      candidate.reason = "fits as the simpler law that it contains";
      w = std::min(w, kExcludedWeight);
    } else if (&score != winner && score.held_out && !has_effect(score, data, search.ground)) {
      candidate.reason = "its fit has none of the effect that its name says";
      if (w > kExcludedWeight) nameless = std::max(nameless, w);
      w = std::min(w, kExcludedWeight);
    }
    if (!supported) w = std::min(w, 0.02);
    add(std::move(candidate), w);
  }
  add(row("none", held_out_rms(search.linear)), supported ? weight(search.linear.mean - none_bonus) : 1);
  const double unknown = std::log(search.black_box_rms);
  Candidate black_box = row("unknown", black_box_held_out_rms(search));
  black_box.reason = "a flexible black box, held out the same way";
  double unknown_weight = std::min(0.02, weight(unknown));
  if (conclusion == Conclusion::kNone) {
    unknown_weight = std::exp(kSteepness * (search.linear.mean - std::log(kOverLinear) - unknown));
    unknown_weight = std::min(unknown_weight, kUndecided);
  }
  if (supported) unknown_weight = std::max(unknown_weight, nameless);
  if (conclusion == Conclusion::kUnexplained) unknown_weight = kDecided;
  add(std::move(black_box), unknown_weight);
  for (const auto& list : alternatives) {
    for (const std::string& cause : list) {
      for (std::size_t i = 0; i < rows.size(); ++i) {
        if (rows[i].cause == cause) weights[i] = std::max(weights[i], 0.3);
      }
    }
  }
  double sum = 0;
  for (const double w : weights) sum += w;
  for (std::size_t i = 0; i < rows.size(); ++i) rows[i].probability = weights[i] / sum;
  return rows;
}

bool is_part_of(const std::string& cause, const std::string& explanation) {
  return ("+" + explanation + "+").find("+" + cause + "+") != std::string::npos;
}

/// Whether a cause may stand in one place of a pair: not what the other place has, or has as its own rival.
bool stands_elsewhere(const MachineVerdict& verdict, std::size_t place, const std::string& cause) {
  for (std::size_t i = 0; i < verdict.winner->causes.size(); ++i) {
    const auto& list = verdict.alternatives[i];
    if (verdict.winner->causes[i] == cause) return true;
    if (i != place && std::find(list.begin(), list.end(), cause) != list.end()) return true;
  }
  return false;
}

/// An entry that nothing stands beside looks settled. Where the explanations without it weigh too much for that, the
/// heaviest of them that offers another cause in its place gives its rival.
void add_runners_up(MachineVerdict& verdict) {
  constexpr double kLeastProbability = 0.05;  // of one explanation: less is no rival but a crowd
  for (std::size_t i = 0; i < verdict.winner->causes.size(); ++i) {
    if (!verdict.alternatives[i].empty()) continue;
    double probability = 0, heaviest = kLeastProbability;
    std::string rival;
    for (const Candidate& candidate : verdict.candidates) {
      if (is_part_of(verdict.winner->causes[i], candidate.cause)) {
        probability += candidate.probability;
        continue;
      }
      if (candidate.cause == "none" || candidate.cause == "unknown" || candidate.probability < heaviest) continue;
      std::string cause;
      for (std::size_t at = 0; at <= candidate.cause.size(); at += cause.size() + 1) {
        cause = candidate.cause.substr(at, candidate.cause.find('+', at) - at);
        if (stands_elsewhere(verdict, i, cause)) continue;
        rival = cause;
        heaviest = candidate.probability;
        break;
      }
    }
    if (probability < kSettledProbability && !rival.empty()) verdict.alternatives[i].push_back(rival);
  }
}

/// A drift that the linear machine's own slow mode follows, from the start that is fitted to it.
bool follows_drift(const MachineSearch& search, const MachineData& data) {
  if (data.records.empty() || search.linear.fit.machine.blocks.empty()) return false;
  const auto& sections = search.linear.fit.machine.blocks[0].sections;
  const std::vector<double> seen = seen_at_rest(data, sections, 1);
  return !sections.empty() && seen.front() == 0;
}

/// Why a cause of the vocabulary has no explanation among those that were tried.
Candidate untried(const std::string& cause, const MachineGround& ground) {
  constexpr auto kNotIdentifiable = CandidateStatus::kNotIdentifiable;
  constexpr auto kNotExcited = CandidateStatus::kNotExcited;
  const auto as = [&](CandidateStatus status, const char* reason) {
    Candidate candidate = row(cause, std::numeric_limits<double>::quiet_NaN());
    candidate.status = status;
    candidate.reason = reason;
    return candidate;
  };
  const auto is_one_of = [&](std::initializer_list<const char*> list) {
    return std::find(list.begin(), list.end(), cause) != list.end();
  };
  if (is_one_of({"gain_loss", "transport_delay", "sensor_offset"}))
    return as(kNotIdentifiable, "the linear machine has a gain, a delay and an offset of its own and absorbs it");
  if (is_one_of({"extra_lag", "resonance"}))
    return as(kNotIdentifiable, "the linear machine has lags and modes of its own and absorbs it");
  if (is_one_of({"leakage", "self_oscillation"}))
    return as(kNotIdentifiable, "only a reference of good valves tells it");
  if (cause == "side_input" && ground.sides.empty()) return as(kNotExcited, "no side channel that moves was recorded");
  if (ground.one_rate) return as(kNotIdentifiable, "at one rate it looks like a lag or a memory");
  if (cause == "rectified_sensor") return as(kNotExcited, "the readings are not folded at a level");
  if (is_one_of({"intermittent", "thermal_drift", "periodic_disturbance"}) && !ground.single_recording)
    return as(kNotIdentifiable, "it has a time of its own, and is looked for in a single recording only");
  if (cause == "periodic_disturbance")
    return as(CandidateStatus::kTested, "no tone stands out of what the linear machine leaves");
  if (cause == "intermittent")
    return as(CandidateStatus::kTested, "the gain changes at no instant of what the linear machine leaves");
  return as(CandidateStatus::kTested, "no fit of it came near");
}

void add_untested(const MachineSearch& search, const MachineData& data, MachineVerdict& verdict) {
  std::vector<Candidate>& rows = verdict.candidates;
  for (const Mechanism* mechanism : all_mechanisms()) {
    const std::string cause(mechanism->cause);
    const bool is_known = std::any_of(rows.begin(), rows.end(), [&](const Candidate& c) { return c.cause == cause; });
    if (!is_known) rows.push_back(untried(cause, search.ground));
  }
  if (search.ground.one_rate && !verdict.winner && verdict.conclusion == Conclusion::kNone) {
    for (Candidate& candidate : rows) {
      if (family_of(candidate.cause) != "memory") continue;
      candidate.status = CandidateStatus::kNotIdentifiable;
      candidate.reason = "at one rate a memory looks like the lag that the linear machine has";
    }
  }
  const bool entered = verdict.winner && is_part_of("sensor_drift", verdict.winner->name());
  if (entered || !follows_drift(search, data)) return;
  const auto drift =
      std::find_if(rows.begin(), rows.end(), [](const Candidate& c) { return c.cause == "sensor_drift"; });
  drift->status = CandidateStatus::kNotIdentifiable;
  drift->reason = "the linear machine has a mode slower than the recording, whose start follows a drift";
}

/// The closest single cause out of those of a pair; null where none was held out.
const MachineScore* first_of(const MachineSearch& search, const MachineScore& pair) {
  const MachineScore* first = nullptr;
  for (const MachineScore& score : search.scores) {
    if (!score.held_out || score.causes.size() != 1 || !contains(pair, score)) continue;
    if (!first || score.rms() < first->rms()) first = &score;
  }
  return first;
}

/// Whether the second of two causes leaves so much of what the first one leaves that it may be no cause, only what the
/// first law gets wrong.
bool mends_the_first(const MachineSearch& search, const MachineScore& best, double noise_rms) {
  constexpr double kMostLeft = 0.25;  // of the squares above the noise
  const MachineScore* first = best.causes.size() < 2 ? nullptr : first_of(search, best);
  const auto above = [&](double rms) { return rms * rms - noise_rms * noise_rms; };
  return first && above(best.rms()) > kMostLeft * above(first->rms());
}

/// Whether a static law of the fit leaves what another map in its place would take up.
bool has_another_shape(const MachineData& data, const MachineFit& fit) {
  constexpr double kLeastShare = 0.1;
  const LeftAnswer left = answer_by_shape(data, fit);
  return left.share > kLeastShare && left.over_chance > 1;
}

/// What a name needs beside its margins before it is given with confidence: evidence that chance gives once in a
/// hundred, and either nearly nothing left unexplained or twice the accuracy of the next family. What leaves much
/// structure behind can be beaten by a law that is not in the vocabulary.
bool is_beyond_doubt(const MachineSearch& search, const MachineData& data, const MachineScore& best, double noise_rms,
                     const MachineVerdict& verdict) {
  if (verdict.p_value >= kClearlySignificant) return false;
  if (!have_certain_sizes(best.causes, data, best.fit)) return false;
  // Rounded stops that nothing comes to rest at are a curve, and most curves have no name.
  if (!has_true_stops(data, best.fit) || has_another_shape(data, best.fit)) return false;
  if (best.rms() > kAboveFloors * noise_rms && mends_the_first(search, best, noise_rms)) return false;
  if (best.rms() <= kNearFloor * noise_rms) return true;
  // Damping of any kind looks like a memory, and most kinds have no name: but none so much that the memory takes nearly
  // all of what it leaves.
  const auto remembers = [](const std::string& cause) { return family_of(cause) == "memory"; };
  const bool memory = std::any_of(best.causes.begin(), best.causes.end(), remembers);
  const double closer = memory ? kFarBeyondDoubt : kBeyondDoubt;
  if (memory && search.linear.rms() < closer * best.rms()) return false;
  if (search.black_box_rms < closer * best.rms()) return false;
  return std::all_of(search.scores.begin(), search.scores.end(), [&](const MachineScore& rival) {
    if (!rival.held_out || contains(rival, best) || family_set(rival) == family_set(best)) return true;
    if (!is_possible(rival, search, data)) return true;
    return rival.rms() >= closer * best.rms();
  });
}

/// Single causes that are not among the winner's own.
std::vector<const MachineScore*> singles_beside(const MachineSearch& search, const MachineScore& best) {
  std::vector<const MachineScore*> singles;
  for (const MachineScore& rival : search.scores) {
    if (rival.causes.size() != 1) continue;
    const bool own = std::find(best.causes.begin(), best.causes.end(), rival.causes[0]) != best.causes.end();
    if (!own) singles.push_back(&rival);
  }
  return singles;
}

/// What to doubt in the last of the winner's causes where nothing stands beside it: the closest other cause, as long as
/// it can be said to be close. Else nothing that was tried comes near, and what can look like that cause in a recording
/// is its rival, the closest of these first. Empty where no other cause was held out.
std::string rival_of(const MachineSearch& search, const MachineData& data, const MachineScore& best) {
  const auto singles = singles_beside(search, best);
  const auto next = std::find_if(singles.begin(), singles.end(),
                                 [&](const MachineScore* rival) { return is_possible(*rival, search, data); });
  if (next == singles.end()) return {};
  if ((*next)->rms() < kBeyondDoubt * best.rms()) return (*next)->causes[0];
  const Mechanism* law = find_mechanism(best.causes.back());
  const auto looks_alike = [&](const MachineScore* rival) {
    return law && std::find(law->confused_with.begin(), law->confused_with.end(), rival->causes[0]) !=
                      law->confused_with.end();
  };
  const auto alike = std::find_if(singles.begin(), singles.end(), looks_alike);
  return (alike == singles.end() ? *next : *alike)->causes[0];
}

/// Whether what the linear machine leaves of the recordings from end to end, far above the noise, is none: it answers
/// the input though no law says how (a gain or a time constant that moves, a map or a memory of another shape), or it
/// comes in bursts. Wander and drift that the input has no part in are noise, however slow.
bool leaves_structure(const MachineSearch& search, const MachineRuns& runs, double noise_rms) {
  constexpr double kLeastShare = 0.15, kLeastBursts = 0.1;
  // Coloured noise is up to three times its floor, and loops hide in quantisation.
  constexpr double kFarAboveFloors = 5;
  // Times what chance does. A wander that is slow against the records follows their states for a while, curves hardly.
  constexpr double kBlocksOverChance = 1.5, kCurvesOverChance = 1.25;
  constexpr std::size_t kManyBlocks = 12, kFewBlocks = 4;
  if (runs.data.records.empty() || search.ground.one_rate) return false;
  if (runs.linear.rms() < kFarAboveFloors * noise_rms) return false;
  const auto is_answer = [&](const LeftAnswer& left, double over_chance) {
    return left.share > kLeastShare && left.over_chance > over_chance;
  };
  return is_answer(local_answer(runs.data, runs.linear, kManyBlocks), kBlocksOverChance) ||
         is_answer(local_answer(runs.data, runs.linear, kFewBlocks), kBlocksOverChance) ||
         is_answer(curved_answer(runs.data, runs.linear), kCurvesOverChance) ||
         share_of_bursts(runs.data, runs.linear) > kLeastBursts;
}

/// A law far closer than the linear machine on the mean, though not on enough blocks to be given as a cause: the linear
/// machine does not leave nothing.
bool is_far_from_a_law(const MachineSearch& search) {
  return std::any_of(search.scores.begin(), search.scores.end(), [&](const MachineScore& score) {
    return score.held_out && score.mean < search.linear.mean - std::log(kBeyondDoubt);
  });
}

void decline(MachineVerdict& verdict, bool structure) {
  verdict.winner = nullptr;
  verdict.alternatives.clear();
  verdict.conclusion = structure ? Conclusion::kUnexplained : Conclusion::kNone;
}

/// What can be said with this explanation as the best.
MachineVerdict conclude_with(const MachineScore* best, const MachineSearch& search, const MachineData& data,
                             const MachineRuns& runs, double noise_rms, bool feedback, const Margin& margin) {
  MachineVerdict verdict;
  const double linear = search.linear.rms();
  const bool above_floor = linear > kAboveFloors * noise_rms;
  bool supported = best && beats_linear(*best, search.linear, margin);
  if (best) verdict.p_value = compare_blocks(best->log_rms, search.linear.log_rms).p_value;
  const double explained = supported ? best->rms() : linear;
  const double excess = std::max(linear * linear - noise_rms * noise_rms, 1e-18);
  const double closed = (linear * linear - explained * explained) / excess;
  const bool black_box_wins =
      search.black_box_rms * kBlackBoxBetter < explained && above_floor &&
      sign_test(search.black_box_log_rms, supported ? best->log_rms : search.linear.log_rms) < kSignificant;
  if (supported &&
      (black_box_wins || (explained > kAboveFloors * noise_rms && closed < 1 - 1 / (kOverLinear * kOverLinear)))) {
    supported = false;
  }
  if (supported && bends_without_a_name(search, data, margin, best)) supported = false;
  // What the output does without the input is no law of a machine's.
  const bool is_on_its_own = supported && !runs.data.records.empty() && share_driven(data, best->fit) < kLeastDriven;
  if (is_on_its_own) supported = false;
  if (!supported) {
    const Margin open_loop{.gain = kOverLinear, .significant = margin.significant};
    const bool law_wins = feedback && best && beats_linear(*best, search.linear, open_loop);
    // A linear machine that reaches the noise over all recordings leaves nothing, however badly a part of them
    // foretells the others.
    const bool is_left = above_floor && runs.linear.rms() > kAboveFloors * noise_rms;
    const bool held_out_structure =
        is_left && (black_box_wins || law_wins || bends_without_a_name(search, data, margin, nullptr) ||
                    is_far_from_a_law(search));
    decline(verdict, held_out_structure || is_on_its_own || (!feedback && leaves_structure(search, runs, noise_rms)));
    verdict.candidates = weigh(search, data, best, {}, verdict.conclusion);
    add_untested(search, data, verdict);
    return verdict;
  }
  verdict.winner = best;
  verdict.alternatives = alternatives_of(search, data, *best);
  if (feedback) {
    for (std::size_t i = 0; i < best->causes.size(); ++i) {
      for (const char* cause : {"friction", "backlash", "hysteresis"}) {
        auto& list = verdict.alternatives[i];
        const bool known = best->causes[i] == cause || std::find(list.begin(), list.end(), cause) != list.end();
        if (!known && family_of(best->causes[i]) == "memory") list.emplace_back(cause);
      }
    }
  }
  verdict.candidates = weigh(search, data, best, verdict.alternatives, Conclusion::kNamed);
  const bool settled = is_settled(verdict.alternatives);
  const auto own = std::find_if(verdict.candidates.begin(), verdict.candidates.end(),
                                [&](const Candidate& c) { return c.cause == best->name(); });
  verdict.conclusion = Conclusion::kNamed;
  if (!settled) verdict.conclusion = Conclusion::kAmbiguous;
  if (settled && (feedback || own->probability < kSettledProbability ||
                  !is_beyond_doubt(search, data, *best, noise_rms, verdict))) {
    // Nothing stands beside it and yet it is not sure: it is given a rival. Without one it is structure that no law
    // accounts for.
    const std::string rival = rival_of(search, data, *best);
    if (rival.empty()) {
      decline(verdict, true);
      verdict.candidates = weigh(search, data, best, {}, verdict.conclusion);
      add_untested(search, data, verdict);
      return verdict;
    }
    verdict.alternatives.back().push_back(rival);
    verdict.candidates = weigh(search, data, best, verdict.alternatives, Conclusion::kNamed);
    verdict.conclusion = Conclusion::kAmbiguous;
  }
  if (verdict.conclusion == Conclusion::kAmbiguous) add_runners_up(verdict);
  add_untested(search, data, verdict);
  return verdict;
}

}  // namespace

MachineVerdict conclude(const MachineSearch& search, const MachineData& data, const MachineRuns& runs, double noise_rms,
                        bool feedback) {
  // A law that gains its margin leaves the linear machine that far above the noise; where it is no farther, chance must
  // be ruled out more clearly.
  const bool above_floor = search.linear.rms() > kAboveFloors * noise_rms;
  const Margin margin{.gain = feedback ? kOverLinearOfFeedback : kOverLinear,
                      .significant = above_floor ? kSignificant : kClearlySignificant};
  const MachineScore* best = best_of(search, data, noise_rms, margin);
  MachineVerdict verdict = conclude_with(best, search, data, runs, noise_rms, feedback, margin);
  if (verdict.conclusion != Conclusion::kAmbiguous || !mends_the_first(search, *best, noise_rms)) return verdict;
  if (!is_settled(alternatives_of(search, data, *best))) return verdict;
  // Nothing stands in the second cause's place, and yet it may be no cause: where the first is certain without it, that
  // one is what there is to say.
  MachineVerdict alone = conclude_with(first_of(search, *best), search, data, runs, noise_rms, feedback, margin);
  return alone.conclusion == Conclusion::kNamed ? alone : verdict;
}

MachineVerdict conclude_without_effect(const MachineVerdict& verdict, const MachineSearch& search,
                                       const MachineData& data) {
  MachineVerdict declined = verdict;
  decline(declined, true);
  declined.candidates = weigh(search, data, verdict.winner, {}, declined.conclusion);
  for (Candidate& candidate : declined.candidates) {
    if (candidate.cause == verdict.winner->name())
      candidate.reason = "fitted to every sample it has none of its effect";
  }
  add_untested(search, data, declined);
  return declined;
}

MachineVerdict conclude_sticking(MachineVerdict by_free_runs, const MachineScore& friction, const StickingLoop& loop) {
  constexpr double kLeastRival = 0.1, kMostRival = 0.5;  // of friction's weight: a loop settles no name
  MachineVerdict verdict = std::move(by_free_runs);
  verdict.conclusion = Conclusion::kAmbiguous;
  verdict.winner = &friction;
  verdict.alternatives = {{"backlash", "hysteresis"}};
  verdict.p_value = loop.p_value;
  const double play = std::clamp(std::exp(loop.log_gain_play - loop.log_gain), kLeastRival, kMostRival);
  double sum = 0;
  for (const char* cause : {"friction", "backlash", "hysteresis"}) {
    const bool known = std::any_of(verdict.candidates.begin(), verdict.candidates.end(),
                                   [&](const Candidate& candidate) { return candidate.cause == cause; });
    if (!known) verdict.candidates.push_back(row(cause, std::numeric_limits<double>::quiet_NaN()));
  }
  for (Candidate& candidate : verdict.candidates) {
    double weight = candidate.cause == "none" ? std::exp(-loop.log_gain) : 0;
    if (candidate.cause == "backlash" || candidate.cause == "hysteresis") weight = play;
    if (candidate.cause == "friction") {
      weight = 1;
      candidate.rmse_heldout = held_out_rms(friction);
      candidate.reason.clear();
    }
    candidate.probability = weight;
    sum += weight;
  }
  for (Candidate& candidate : verdict.candidates) candidate.probability /= sum;
  return verdict;
}

}  // namespace valvetriage
