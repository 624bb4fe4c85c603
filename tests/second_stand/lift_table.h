#pragma once

#include <cstddef>
#include <vector>

namespace valvetriage::second_stand {

/// A function of lift from a table at equal distances, by cubic pieces that keep its monotony (Steffen 1990). Constant
/// outside the table.
class LiftTable {
 public:
  LiftTable() = default;
  LiftTable(double first_mm, double last_mm, std::vector<double> values);

  double operator()(double lift_mm) const;
  /// Where a rising table has this value.
  double lift_of(double value) const;

  std::size_t size() const { return value_.size(); }
  double lift_mm(std::size_t k) const { return first_mm_ + static_cast<double>(k) * spacing_mm_; }

 private:
  double first_mm_ = 0, spacing_mm_ = 1;
  std::vector<double> value_, slope_;
};

}  // namespace valvetriage::second_stand
