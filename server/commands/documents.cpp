#include "server/commands/documents.h"

#include <fmt/format.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iostream>

#include "server/wire/model_json.h"
#include "server/wire/reference_json.h"

namespace valvetriage {
namespace {

Error cannot_write(const std::string& file) {
  Error error{.code = "cannot_write", .message = fmt::format("cannot be written: {}", std::strerror(errno))};
  error.file = file;
  return error;
}

}  // namespace

Result<std::string> read_text_file(const std::string& file, std::size_t most) {
  std::ifstream opened;
  if (file != "-") opened.open(file, std::ios::binary);
  std::istream& in = file == "-" ? std::cin : opened;
  std::string text;
  char buffer[65536];
  while (in.read(buffer, sizeof buffer) || in.gcount() > 0) {
    text.append(buffer, static_cast<std::size_t>(in.gcount()));
    if (text.size() > most) {
      return tl::unexpected(in_file(file)({.code = "too_large", .message = fmt::format("more than {} bytes", most)}));
    }
  }
  if (in.bad() || (file != "-" && !opened.is_open())) {
    return tl::unexpected(in_file(file)({.code = "cannot_read", .message = "the file cannot be read"}));
  }
  return text;
}

Result<Model> open_model(const std::string& file) {
  return read_text_file(file)
      .and_then([](const std::string& text) { return parse_json(text); })
      .and_then([](const Json& document) { return model_from_json(document); })
      .map_error(in_file(file));
}

Result<Reference> open_reference(const std::string& file) {
  return read_text_file(file)
      .and_then([](const std::string& text) { return parse_json(text); })
      .and_then(reference_from_json)
      .map_error(in_file(file));
}

Result<void> write_output(const std::string& file, const std::string& text) {
  if (file.empty() || file == "-") {
    const bool is_written = std::fwrite(text.data(), 1, text.size(), stdout) == text.size();
    if (!is_written || std::fflush(stdout) != 0) return tl::unexpected(cannot_write("standard output"));
    return {};
  }
  std::error_code ignored;
  const bool regular = !std::filesystem::exists(file, ignored) || std::filesystem::is_regular_file(file, ignored);
  const std::string written = regular ? fmt::format("{}.{}.part", file, ::getpid()) : file;
  std::ofstream out(written, std::ios::binary);
  out << text;
  out.close();
  if (!out || (regular && std::rename(written.c_str(), file.c_str()) != 0)) {
    const Error error = cannot_write(file);
    if (regular) std::remove(written.c_str());
    return tl::unexpected(error);
  }
  return {};
}

}  // namespace valvetriage
