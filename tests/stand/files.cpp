#include "tests/stand/files.h"

#include <cstdio>
#include <fstream>
#include <stdexcept>

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
  std::string text = "{\"effect\": " + quoted(effect.effect) + ", \"family\": " + quoted(effect.family) +
                     ", \"origin\": " + quoted(effect.origin) +
                     ", \"in_vocabulary\": " + (effect.in_vocabulary ? "true" : "false") +
                     ", \"size\": " + number(effect.size) + ", \"size_meaning\": " + quoted(effect.size_meaning) +
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

}  // namespace

std::string recording_csv(const SessionOptions& options, const StandRecording& recording) {
  std::string text =
      "# serial: " + options.serial + "\n# lot: " + options.lot + "\n# valve_type: " + options.valve_type +
      "\n# condition: " + options.condition + "\n# test: " + recording.test + "\n# stand: " + options.stand +
      "\n# tested_at: " + options.tested_at + "\ntime_s,current_A,pressure_psi,temperature_C,supply_psi\n";
  text.reserve(text.size() + recording.time_s.size() * 48);
  for (std::size_t k = 0; k < recording.time_s.size(); ++k) {
    append_fixed(text, recording.time_s[k], 6, ',');
    append_fixed(text, recording.current_a[k], 6, ',');
    append_fixed(text, recording.pressure_psi[k], 4, ',');
    append_fixed(text, recording.temperature_c[k], 3, ',');
    append_fixed(text, recording.supply_psi[k], 3, '\n');
  }
  return text;
}

std::string clean_csv(const StandRecording& recording) {
  std::string text = "time_s,pressure_psi\n";
  for (std::size_t k = 0; k < recording.time_s.size(); ++k) {
    append_fixed(text, recording.time_s[k], 6, ',');
    append_fixed(text, recording.clean_psi[k], 6, '\n');
  }
  return text;
}

std::string truth_json(const Session& session) {
  const SessionOptions& options = session.options;
  std::string text = "{\"serial\": " + quoted(options.serial) + ", \"lot\": " + quoted(options.lot) +
                     ", \"unit_seed\": " + std::to_string(options.unit_seed) +
                     ", \"noise_seed\": " + std::to_string(options.noise_seed) +
                     ", \"noise_psi\": " + number(options.noise_psi) + ",\n \"effects\": [";
  std::string separator;
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

void write_recordings(const std::filesystem::path& folder, const Session& session) {
  for (const StandRecording& recording : session.recordings)
    write_file(folder / (recording.name + ".csv"), recording_csv(session.options, recording));
}

void write_clean(const std::filesystem::path& folder, const Session& session) {
  for (const StandRecording& recording : session.recordings)
    write_file(folder / (recording.name + ".csv"), clean_csv(recording));
}

}  // namespace valvetriage::stand
