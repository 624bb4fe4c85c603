#include "tests/contract/mat_file.h"

#include <cmath>
#include <cstdint>
#include <string_view>

namespace valvetriage::test {
namespace {

enum Type : std::uint32_t { kInt8 = 1, kUint16 = 4, kInt32 = 5, kUint32 = 6, kDouble = 9, kMatrix = 14 };
enum Class : std::uint32_t { kCharClass = 4, kDoubleClass = 6 };

template <typename Number>
std::string bytes_of(const std::vector<Number>& numbers) {
  return {reinterpret_cast<const char*>(numbers.data()), numbers.size() * sizeof(Number)};
}

std::string element(Type type, const std::string& data) {
  const std::string padding((8 - data.size() % 8) % 8, '\0');
  return bytes_of<std::uint32_t>({type, static_cast<std::uint32_t>(data.size())}) + data + padding;
}

std::string variable(const std::string& name, Class kind, std::size_t count, Type type, const std::string& data) {
  return element(kMatrix, element(kUint32, bytes_of<std::uint32_t>({kind, 0})) +
                              element(kInt32, bytes_of<std::int32_t>({1, static_cast<std::int32_t>(count)})) +
                              element(kInt8, name) + element(type, data));
}

}  // namespace

std::string mat_file(const std::map<std::string, std::vector<double>>& numbers,
                     const std::map<std::string, std::string>& texts) {
  std::string head = "MATLAB 5.0 MAT-file";
  head.resize(124, ' ');
  std::string file = head + bytes_of<std::uint16_t>({0x0100, 0x4D49});
  for (const auto& [name, values] : numbers)
    file += variable(name, kDoubleClass, values.size(), kDouble, bytes_of(values));
  for (const auto& [name, text] : texts) {
    const std::vector<std::uint16_t> letters(text.begin(), text.end());
    file += variable(name, kCharClass, letters.size(), kUint16, bytes_of(letters));
  }
  return file;
}

std::string good_mat(const std::map<std::string, std::string>& texts) {
  std::vector<double> time, current, pressure;
  double psi = 26;
  for (int i = 0; i < 400; ++i) {
    time.push_back(0.005 * i);
    current.push_back(i < 100 ? 1.2 : i < 250 ? 1.6 : 1.4);
    psi += 0.08 * (26 + 150 * (current.back() - 1.2) - psi);
    pressure.push_back(psi + 0.05 * std::sin(i * i));
  }
  return mat_file({{"time_s", time}, {"current_A", current}, {"pressure_psi", pressure}}, texts);
}

}  // namespace valvetriage::test
