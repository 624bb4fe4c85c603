#include "tests/stand/files.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <stdexcept>
#include <vector>

namespace valvetriage::stand {
namespace {

void append_fixed(std::string& text, double value, int decimals, char after) {
  char buffer[48];
  const int length = std::snprintf(buffer, sizeof buffer, "%.*f%c", decimals, value, after);
  text.append(buffer, static_cast<std::size_t>(length));
}

std::string quoted(const std::string& text) {
  std::string out = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') out += '\\';
    out += c;
  }
  return out + '"';
}

std::string number(double value) {
  char buffer[40];
  std::snprintf(buffer, sizeof buffer, "%.12g", value);
  return buffer;
}

std::string effect_json(const HiddenEffect& effect) {
  const EffectInfo& info = effect.info;
  std::string text = "{\"effect\": " + quoted(info.effect) + ", \"family\": " + quoted(info.family) +
                     ", \"origin\": " + quoted(info.origin) +
                     ", \"in_vocabulary\": " + (info.in_vocabulary ? "true" : "false") +
                     ", \"size\": " + number(effect.size) + ", \"size_meaning\": " + quoted(info.size_meaning) +
                     ", \"recording\": " + (effect.recording.empty() ? "null" : quoted(effect.recording + ".csv")) +
                     ", \"parameters\": {";
  std::string separator;
  for (const EffectParameter& p : effect.parameters) {
    text += separator + quoted(p.name) + ": {\"value\": " + number(p.value) + ", \"unit\": " + quoted(p.unit) + "}";
    separator = ", ";
  }
  return text + "}}";
}

std::string unit_json(const Unit& unit) {
  return "{\"breakaway_A\": " + number(unit.breakaway_a) + ", \"loop_width_A\": " + number(unit.loop_width_a) +
         ", \"loss_fraction\": " + number(unit.leak_fraction) + ", \"delay_s\": " + number(unit.delay_s) +
         ", \"time_constant_120psi_s\": " + number(unit.time_constant_120psi_s) +
         ", \"outflow_exponent\": " + number(unit.outflow_exponent) + ", \"map_gain\": " + number(unit.map_gain) +
         ", \"map_shift_A\": " + number(unit.map_shift_a) + "}";
}

std::vector<std::string> split(const std::string& line) {
  std::vector<std::string> cells(1);
  for (const char c : line) {
    if (c == ',')
      cells.emplace_back();
    else if (c != '\r')
      cells.back() += c;
  }
  return cells;
}

std::size_t column_named(const std::vector<std::string>& header, const std::string& name) {
  const auto found = std::find(header.begin(), header.end(), name);
  if (found == header.end()) throw std::invalid_argument("the input has no column '" + name + "'");
  return static_cast<std::size_t>(found - header.begin());
}

double cell_value(const std::vector<std::string>& cells, std::size_t column, std::size_t line) {
  const std::string& text = column < cells.size() ? cells[column] : std::string();
  char* end = nullptr;
  const double value = std::strtod(text.c_str(), &end);
  if (text.empty() || *end != '\0' || !std::isfinite(value))
    throw std::invalid_argument("input line " + std::to_string(line) + ": '" + text + "' is not a number");
  return value;
}

}  // namespace

std::string recording_csv(const SessionOptions& options, const StandRecording& recording, Columns columns) {
  const bool valve = columns == Columns::kValve;
  std::string text = "# serial: " + options.serial + "\n# lot: " + options.lot +
                     "\n# valve_type: " + options.valve_type + "\n# condition: " + options.condition +
                     "\n# test: " + recording.test + "\n# stand: " + options.stand +
                     "\n# tested_at: " + options.tested_at +
                     (valve ? "\ntime_s,current_A,pressure_psi,temperature_C,supply_psi\n" : "\ntime_s,u,y\n");
  text.reserve(text.size() + recording.time_s.size() * 48);
  for (std::size_t k = 0; k < recording.time_s.size(); ++k) {
    append_fixed(text, recording.time_s[k], 6, ',');
    append_fixed(text, recording.current_a[k], 6, ',');
    append_fixed(text, recording.pressure_psi[k], valve ? 4 : 6, valve ? ',' : '\n');
    if (!valve) continue;
    append_fixed(text, recording.temperature_c[k], 3, ',');
    append_fixed(text, recording.supply_psi[k], 3, '\n');
  }
  return text;
}

std::string clean_csv(const StandRecording& recording) {
  std::string text = "time_s,pressure_psi,command_A\n";
  for (std::size_t k = 0; k < recording.time_s.size(); ++k) {
    append_fixed(text, recording.time_s[k], 6, ',');
    append_fixed(text, recording.clean_psi[k], 6, ',');
    append_fixed(text, recording.command_a[k], 6, '\n');
  }
  return text;
}

std::string signature_csv(const StandRecording& healthy, const StandRecording& spoiled) {
  std::string text = "time_s,command_A,healthy_psi,effect_psi\n";
  for (std::size_t k = 0; k < healthy.time_s.size(); ++k) {
    append_fixed(text, healthy.time_s[k], 6, ',');
    append_fixed(text, healthy.command_a[k], 6, ',');
    append_fixed(text, healthy.clean_psi[k], 6, ',');
    append_fixed(text, spoiled.clean_psi[k], 6, '\n');
  }
  return text;
}

std::string truth_json(const Session& session) {
  const SessionOptions& options = session.options;
  std::string text = "{\"serial\": " + quoted(options.serial) + ", \"lot\": " + quoted(options.lot) +
                     ", \"unit_seed\": " + std::to_string(options.unit_seed) +
                     ", \"noise_seed\": " + std::to_string(options.noise_seed) +
                     ", \"noise_psi\": " + number(options.noise_psi) + ",\n \"decoys\": {";
  std::string separator;
  for (const auto& [decoy, size] : options.decoys) {
    text += separator + quoted(decoy) + ": " + number(size);
    separator = ", ";
  }
  text += "},\n \"effects\": [";
  separator.clear();
  for (const HiddenEffect& effect : session.truth) {
    text += separator + effect_json(effect);
    separator = ",\n  ";
  }
  text += "],\n \"healthy_unit\": " + unit_json(session.unit) + ",\n \"recordings\": [";
  separator.clear();
  for (const StandRecording& recording : session.recordings) {
    text += separator + quoted(recording.name + ".csv");
    separator = ", ";
  }
  return text + "]}\n";
}

void write_file(const std::filesystem::path& path, const std::string& text) {
  if (path.has_parent_path()) std::filesystem::create_directories(path.parent_path());
  std::ofstream file(path, std::ios::binary);
  file << text;
  file.close();
  if (!file) throw std::runtime_error("cannot write '" + path.string() + "'");
}

void write_recordings(const std::filesystem::path& folder, const Session& session, Columns columns) {
  for (const StandRecording& recording : session.recordings)
    write_file(folder / (recording.name + ".csv"), recording_csv(session.options, recording, columns));
}

void write_clean(const std::filesystem::path& folder, const Session& session) {
  for (const StandRecording& recording : session.recordings)
    write_file(folder / (recording.name + ".csv"), clean_csv(recording));
}

Command read_command(const std::filesystem::path& path) {
  std::ifstream file(path);
  if (!file) throw std::invalid_argument("cannot read '" + path.string() + "'");
  std::vector<double> time_s, current_a;
  std::size_t time_column = 0, current_column = 0, number_of_line = 0;
  bool header = true;
  for (std::string line; std::getline(file, line);) {
    ++number_of_line;
    if (line.empty() || line[0] == '#') continue;
    const std::vector<std::string> cells = split(line);
    if (header) {
      time_column = column_named(cells, "time_s");
      current_column = column_named(cells, "current_A");
      header = false;
      continue;
    }
    time_s.push_back(cell_value(cells, time_column, number_of_line));
    current_a.push_back(cell_value(cells, current_column, number_of_line));
  }
  if (time_s.size() < 2 || !(time_s.back() > time_s.front()))
    throw std::invalid_argument("'" + path.string() + "' needs at least two rows of increasing time");
  const double period_s = (time_s.back() - time_s.front()) / static_cast<double>(time_s.size() - 1);
  for (std::size_t k = 1; k < time_s.size(); ++k)
    if (std::abs(time_s[k] - time_s[k - 1] - period_s) > 0.01 * period_s)
      throw std::invalid_argument("'" + path.string() + "': row " + std::to_string(k + 1) + " is off the uniform grid");
  return command_of_samples(path.stem().string(), period_s, std::move(current_a));
}

}  // namespace valvetriage::stand
