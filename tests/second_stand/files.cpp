#include "tests/second_stand/files.h"

#include <fmt/format.h>

#include <algorithm>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <sstream>
#include <stdexcept>

namespace valvetriage::second_stand {
namespace {

using Json = nlohmann::ordered_json;

void write(const std::filesystem::path& file, const std::string& text) {
  if (file.has_parent_path()) std::filesystem::create_directories(file.parent_path());
  std::ofstream out(file, std::ios::binary);
  out << text;
  out.close();
  if (!out) throw std::runtime_error("cannot write " + file.string());
}

std::string recording_csv(const Order& order, const Log& log) {
  fmt::memory_buffer text;
  const auto out = std::back_inserter(text);
  for (const auto& [key, value] : {std::pair{"serial", order.serial},
                                   {"lot", order.lot},
                                   {"valve_type", order.valve_type},
                                   {"condition", order.condition},
                                   {"test", log.test},
                                   {"stand", order.stand}})
    fmt::format_to(out, "# {}: {}\n", key, value);
  fmt::format_to(out, "time_s,current_A,pressure_psi,temperature_C,supply_psi\n");
  for (std::size_t k = 0; k < log.time_s.size(); ++k)
    fmt::format_to(out, "{:.6f},{:.6f},{:.4f},{:.3f},{:.3f}\n", log.time_s[k], log.current_a[k], log.pressure_psi[k],
                   log.temperature_c[k], log.supply_psi[k]);
  return fmt::to_string(text);
}

std::string clean_csv(const Log& log) {
  fmt::memory_buffer text;
  const auto out = std::back_inserter(text);
  fmt::format_to(out, "time_s,pressure_psi,command_A\n");
  for (std::size_t k = 0; k < log.time_s.size(); ++k)
    fmt::format_to(out, "{:.6f},{:.6f},{:.6f}\n", log.time_s[k], log.clean_psi[k], log.command_a[k]);
  return fmt::to_string(text);
}

Json effect_json(const HiddenEffect& effect) {
  Json parameters = Json::object();
  for (const Parameter& p : effect.parameters) parameters[p.name] = {{"value", p.value}, {"unit", p.unit}};
  return {{"effect", effect.kind.name},
          {"family", effect.kind.family},
          {"origin", effect.kind.origin},
          {"in_vocabulary", effect.kind.family != "outside"},
          {"size", effect.size},
          {"size_meaning", effect.kind.size_meaning},
          {"recording", effect.recording.empty() ? Json() : Json(effect.recording + ".csv")},
          {"parameters", parameters}};
}

Json unit_json(const Unit& unit) {
  return {
      {"breakaway_A", unit.breakaway_a}, {"loop_width_A", unit.loop_width_a},    {"loss_fraction", unit.leak_fraction},
      {"latency_s", unit.latency_s},     {"laminar_share", unit.laminar_share},  {"air_share_at_26_psi", unit.air},
      {"volume", unit.volume},           {"trimmed_psi_at_1.6_A", unit.trim_psi}};
}

std::vector<std::string> cells_of(std::string line) {
  std::erase(line, '\r');
  std::vector<std::string> cells;
  std::istringstream stream(line);
  for (std::string cell; std::getline(stream, cell, ',');) cells.push_back(cell);
  return cells;
}

std::size_t place_of(const std::vector<std::string>& header, const std::string& name) {
  const auto found = std::find(header.begin(), header.end(), name);
  if (found == header.end()) throw std::invalid_argument("the input has no column " + name);
  return static_cast<std::size_t>(found - header.begin());
}

double number_at(const std::vector<std::string>& cells, std::size_t place, int line) {
  std::size_t used = 0;
  double value = 0;
  try {
    value = std::stod(cells.at(place), &used);
  } catch (const std::logic_error&) {
    used = 0;
  }
  if (used == 0 || used != cells[place].size())
    throw std::invalid_argument(fmt::format("line {} of the input: a number is missing", line));
  return value;
}

}  // namespace

void write_recordings(const std::filesystem::path& folder, const Session& session) {
  for (const Log& log : session.logs) write(folder / (log.name + ".csv"), recording_csv(session.order, log));
}

void write_clean(const std::filesystem::path& folder, const Session& session) {
  for (const Log& log : session.logs) write(folder / (log.name + ".csv"), clean_csv(log));
}

void write_truth(const std::filesystem::path& file, const Session& session) {
  const Order& order = session.order;
  Json truth = {{"serial", order.serial},       {"lot", order.lot},
                {"unit_seed", order.unit_seed}, {"noise_seed", order.noise_seed},
                {"noise_psi", order.noise_psi}, {"decoys", Json::object()},
                {"effects", Json::array()},     {"healthy_unit", unit_json(session.unit)},
                {"recordings", Json::array()}};
  for (const Asked& decoy : order.decoys) truth["decoys"][decoy.name] = decoy.size;
  for (const HiddenEffect& effect : session.truth) truth["effects"].push_back(effect_json(effect));
  for (const Log& log : session.logs) truth["recordings"].push_back(log.name + ".csv");
  write(file, truth.dump(1) + "\n");
}

Command read_command(const std::filesystem::path& path) {
  std::ifstream file(path);
  if (!file) throw std::invalid_argument("cannot read " + path.string());
  std::vector<std::string> header;
  std::vector<double> instant_s, value_a;
  int number = 0;
  for (std::string line; std::getline(file, line);) {
    ++number;
    if (line.empty() || line[0] == '#') continue;
    const auto cells = cells_of(line);
    if (header.empty()) {
      header = cells;
      continue;
    }
    instant_s.push_back(number_at(cells, place_of(header, "time_s"), number));
    value_a.push_back(number_at(cells, place_of(header, "current_A"), number));
    if (instant_s.size() > 1 && !(instant_s.back() > instant_s[instant_s.size() - 2]))
      throw std::invalid_argument(fmt::format("line {} of the input: time does not increase", number));
  }
  if (instant_s.size() < 2) throw std::invalid_argument("the input needs at least two rows");
  return given_command(path.stem().string(), std::move(instant_s), std::move(value_a));
}

}  // namespace valvetriage::second_stand
