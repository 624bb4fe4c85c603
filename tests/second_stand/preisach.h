#pragma once

#include <vector>

namespace valvetriage::second_stand {

/// Magnetic memory of the coil's iron: a Preisach model (Mayergoyz 1991) evaluated by its Everett function and the
/// turning points it remembers. Coercive currents are distributed exponentially about w, switching means like
/// 1 + m cos(κ (i - 1.5 A)): the loop is widest at mid range, unlike that of parallel plays.
///
///   h = i + χ (J(i) - J_mean(i)),   J_mean the middle of the branches of the major loop
class Preisach {
 public:
  /// Full width [A] at 1.6 A of the loop between 1.0 A and 2.0 A; 0 for no memory.
  explicit Preisach(double width_a);

  /// The effective current after the current has gone straight to this value.
  double advance(double current_a);

 private:
  double everett(double high_a, double low_a) const;
  /// Width of the loop between 1 A and 2 A at 1.6 A, with coercive current w.
  double loop_width_a(double coercive_a);

  struct Turn {
    double current_a, magnetisation;
  };
  double coercive_a_ = 0;
  std::vector<Turn> turns_;  ///< alternately low and high; the first is far below
  double current_a_;
};

}  // namespace valvetriage::second_stand
