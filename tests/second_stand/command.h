#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace valvetriage::second_stand {

/// The set-point of the current driver as the stand plays it: `value_a[k]` is reached at `instant_s[k]`, linearly from
/// the value before or, where `jumps[k]`, at once. Before the first instant it has its first value, after the last its
/// last.
struct Command {
  std::string name;  ///< file name without suffix
  std::string test;  ///< the contract's word: step staircase triangle sweep other
  std::vector<double> instant_s, value_a;
  std::vector<char> jumps;
};

/// What the repertoire holds; README.
const std::vector<std::string>& repertoire();

/// The six recordings of a full session.
std::vector<std::string> full_session();

/// The commands of one test, 200 values a second. Throws std::invalid_argument for a name that is not in the
/// repertoire.
std::vector<Command> commands_of(const std::string& test);

/// A given current on its own instants; a change of more than 20 mA between neighbours that stand still is a jump.
Command given_command(const std::string& name, std::vector<double> instant_s, std::vector<double> value_a);

/// Exact means of a command over short intervals that follow each other in time.
class CommandReader {
 public:
  explicit CommandReader(const Command& command) : command_(&command) {}
  /// Mean over (from_s, to_s]; intervals come in order.
  double mean(double from_s, double to_s);

 private:
  /// ∫ of the command over [from_s, to_s], which lies within segment `segment_` (that ends at its instant).
  double inside(double from_s, double to_s) const;

  const Command* command_;
  std::size_t segment_ = 0;
};

}  // namespace valvetriage::second_stand
