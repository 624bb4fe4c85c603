#include "server/jobs/reading_child.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <iostream>
#include <iterator>
#include <new>
#include <optional>
#include <utility>

#include "core/recording/metadata.h"
#include "server/jobs/child_process.h"
#include "server/jobs/child_protocol.h"
#include "server/wire/json.h"
#include "server/wire/json_fields.h"
#include "server/wire/json_recording.h"
#include "server/wire/read_recording.h"

namespace valvetriage {
namespace {

constexpr std::int64_t kPatienceMs = 30'000, kProcessor_s = 20;
constexpr std::size_t kMaxAnswerBytes = std::size_t{512} << 20;
constexpr std::size_t kValuesPerLine = 4096;

// The answer: {"metadata":{...}}, then for each channel {"channel":{...}} and any number of {"values":[...]}; or
// {"refused":{...}}.

void say(const Json& line) {
  const std::string text = dump_json(line) + "\n";
  std::fwrite(text.data(), 1, text.size(), stdout);
}

void say_channel(std::string_view role, const Channel& channel) {
  say({{"channel",
        {{"role", role},
         {"name", channel.name},
         {"quantity", channel.quantity},
         {"unit", channel.unit},
         {"file_unit", channel.file_unit},
         {"file_unit_scale", channel.file_unit_scale}}}});
  for (std::size_t at = 0; at < channel.values.size(); at += kValuesPerLine) {
    const auto from = channel.values.begin() + static_cast<std::ptrdiff_t>(at);
    const std::size_t count = std::min(kValuesPerLine, channel.values.size() - at);
    say({{"values", std::vector<double>(from, from + static_cast<std::ptrdiff_t>(count))}});
  }
}

Result<RawRecording> read_here(const FileToRead& file) {
  auto options = read_options_of(file);
  if (!options) return tl::unexpected(options.error());
  options->allow_mat = true;  // the child is there for that
  try {
    return read_raw_recording_file(file.path, *options);
  } catch (const std::bad_alloc&) {
    return fail("out_of_memory", "the file needs more memory than reading one may have");
  }
}

/// Takes the lines of a child apart. The file may have made the child say anything.
class Answer {
 public:
  void take(std::string_view line) {
    const auto said = parse_json(line);
    if (!said) return refuse(said.error());
    std::optional<Error> error;
    JsonFields fields(*said, "", error);
    if (fields.has("metadata")) {
      take_metadata(fields.raw("metadata"));
    } else if (fields.has("channel")) {
      begin(fields.object("channel"));
    } else if (fields.has("values") && channel_) {
      const std::vector<double> values = fields.numbers("values");
      channel_->values.insert(channel_->values.end(), values.begin(), values.end());
    } else {
      refuse(refusal_from(fields.object("refused")));
    }
    if (error) refuse(*error);
  }

  Result<RawRecording> result(const std::string& name) && {
    if (error_) return tl::unexpected(std::move(*error_));
    if (!has_metadata_ || !is_even()) return fail("unreadable", "the process that read the file gave no whole answer");
    raw_.name = name;
    return std::move(raw_);
  }

 private:
  void refuse(const Error& error) {
    if (!error_) error_ = error;
  }

  bool is_even() const {
    const std::size_t rows = raw_.input.values.size();
    const auto fits = [&](const Channel& channel) { return channel.values.size() == rows; };
    return (raw_.time.values.empty() || fits(raw_.time)) && fits(raw_.output) && std::ranges::all_of(raw_.side, fits);
  }

  void take_metadata(const Json& metadata) {
    has_metadata_ = true;
    for (const auto& [key, value] : metadata.items()) {
      const std::string text = value.is_string() ? value.get<std::string>() : "";
      if (auto set = set_metadata(raw_.metadata, key, text); !set) refuse(set.error());
    }
  }

  void begin(JsonFields fields) {
    const std::string role = fields.text("role");
    channel_ = role == "time"     ? &raw_.time
               : role == "input"  ? &raw_.input
               : role == "output" ? &raw_.output
                                  : &raw_.side.emplace_back();
    channel_->name = fields.text("name");
    channel_->quantity = fields.text("quantity");
    channel_->unit = fields.text("unit");
    channel_->file_unit = fields.text("file_unit");
    channel_->file_unit_scale = fields.number("file_unit_scale");
  }

  RawRecording raw_;
  Channel* channel_ = nullptr;
  bool has_metadata_ = false;
  std::optional<Error> error_;
};

}  // namespace

Result<RawRecording> read_in_child(const FileToRead& file, WhatToRead what, std::function<bool()> keep_going,
                                   std::vector<std::string> command) {
  if (command.empty()) command = {"/proc/self/exe", std::string(kReadingVerb)};
  const std::string asked = dump_json({{"file", to_json(file)}, {"labels_only", what == WhatToRead::kLabels}});
  const ChildLimits limits{.cpu_s = kProcessor_s, .wall_ms = kPatienceMs, .answer_bytes = kMaxAnswerBytes};
  Answer answer;
  const auto ended = run_child_process(
      command, asked, limits,
      {.on_line = [&](std::string_view line) { answer.take(line); }, .keep_going = std::move(keep_going)});
  if (!ended) return tl::unexpected(ended.error());
  if (ended->end == ChildEnd::kStopped) return fail("draining", "the server is shutting down; try again");
  // A machine that is busy passes; a file that takes more processor than one may have does not.
  if (ended->end == ChildEnd::kTimeout && ended->status == 0) {
    return fail("reading_timeout", "the file could not be read within the time that reading one may have; try again");
  }
  if (ended->end != ChildEnd::kExited || ended->status != 0) {
    return fail("unreadable",
                "the file could not be read within the processor time and memory that reading "
                "one may have");
  }
  return std::move(answer).result(file.name);
}

int run_reading_child() {
  const std::string text{std::istreambuf_iterator<char>(std::cin), {}};
  const Json document = parse_json(text).value_or(Json());
  std::optional<Error> error;
  JsonFields fields(document, "", error);
  JsonFields of_file = fields.object("file");
  const FileToRead file = file_to_read_from(of_file);
  const bool labels_only = fields.flag("labels_only");
  if (error) {
    fmt::print(stderr, "what to read could not be read: {}\n", error->message);
    return 1;
  }
  const auto raw = read_here(file);
  if (!raw) {
    say({{"refused", refusal_json(raw.error())}});
    return 0;
  }
  say({{"metadata", metadata_json(raw->metadata)}});
  if (labels_only) return 0;
  for (const auto& [role, channel] :
       {std::pair("time", &raw->time), std::pair("input", &raw->input), std::pair("output", &raw->output)}) {
    say_channel(role, *channel);
  }
  for (const Channel& channel : raw->side) say_channel("side", channel);
  return 0;
}

}  // namespace valvetriage
