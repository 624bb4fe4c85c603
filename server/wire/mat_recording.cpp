#include "server/wire/mat_recording.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <matio.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <fstream>
#include <memory>
#include <optional>
#include <vector>

#include "core/recording/columns.h"
#include "core/recording/limits.h"
#include "core/recording/metadata.h"
#include "core/recording/text.h"

namespace valvetriage {
namespace {

constexpr std::string_view kHdf5 = "\x89HDF\r\n\x1a\n";
constexpr std::size_t kMaxVariables = kMaxColumns + kMaxMetadataPairs;

tl::unexpected<Error> mat_error(std::string code, std::string_view variable, std::string found, std::string expected) {
  Error error{.code = std::move(code)};
  error.field = shown(variable);
  error.message = fmt::format("MAT file{}{}: found {}, expected {}", variable.empty() ? "" : ", variable ", error.field,
                              found, expected);
  error.found = std::move(found);
  error.expected = std::move(expected);
  return tl::unexpected(error);
}

/// The bytes as a file without a name: libmatio opens paths only.
class AnonymousFile {
 public:
  AnonymousFile() : descriptor_(::memfd_create("recording.mat", MFD_CLOEXEC)) {}
  ~AnonymousFile() {
    if (descriptor_ >= 0) ::close(descriptor_);
  }
  AnonymousFile(const AnonymousFile&) = delete;
  AnonymousFile& operator=(const AnonymousFile&) = delete;

  Result<void> take(ByteSource& source) {
    std::array<char, 65'536> buffer;
    for (;;) {
      const auto got = source.read(buffer);
      if (!got) return tl::unexpected(got.error());
      if (*got == 0) return {};
      for (std::size_t written = 0; written < *got;) {
        const ssize_t count = ::write(descriptor_, buffer.data() + written, *got - written);
        if (count <= 0) return fail("cannot_read", "no memory for a copy of the MAT file");
        written += static_cast<std::size_t>(count);
      }
    }
  }
  std::string path() const { return fmt::format("/proc/self/fd/{}", descriptor_); }

 private:
  int descriptor_;
};

/// What the file starts with: its text, or the mark of HDF5.
std::string head_of(const std::string& path) {
  std::string bytes(32, '\0');
  std::ifstream(path, std::ios::binary).read(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  return bytes;
}

using MatFile = std::unique_ptr<mat_t, decltype(&Mat_Close)>;
using MatVariable = std::unique_ptr<matvar_t, decltype(&Mat_VarFree)>;

std::size_t elements_of(const matvar_t& variable) {
  std::size_t count = 1;
  for (int k = 0; k < variable.rank; ++k) {
    if (__builtin_mul_overflow(count, variable.dims[k], &count)) return kMaxRows + 1;
  }
  return count;
}

bool is_vector(const matvar_t& variable) {
  return variable.rank == 2 && (variable.dims[0] == 1 || variable.dims[1] == 1);
}

template <typename Number>
void append(const void* data, std::size_t count, std::vector<double>& values) {
  const auto* numbers = static_cast<const Number*>(data);
  values.assign(numbers, numbers + count);
}

bool copy_numbers(const matvar_t& variable, std::size_t count, std::vector<double>& values) {
  switch (variable.data_type) {
    case MAT_T_DOUBLE:
      append<double>(variable.data, count, values);
      return true;
    case MAT_T_SINGLE:
      append<float>(variable.data, count, values);
      return true;
    case MAT_T_INT8:
      append<std::int8_t>(variable.data, count, values);
      return true;
    case MAT_T_UINT8:
      append<std::uint8_t>(variable.data, count, values);
      return true;
    case MAT_T_INT16:
      append<std::int16_t>(variable.data, count, values);
      return true;
    case MAT_T_UINT16:
      append<std::uint16_t>(variable.data, count, values);
      return true;
    case MAT_T_INT32:
      append<std::int32_t>(variable.data, count, values);
      return true;
    case MAT_T_UINT32:
      append<std::uint32_t>(variable.data, count, values);
      return true;
    case MAT_T_INT64:
      append<std::int64_t>(variable.data, count, values);
      return true;
    case MAT_T_UINT64:
      append<std::uint64_t>(variable.data, count, values);
      return true;
    default:
      return false;
  }
}

std::size_t element_size(matio_types type) {
  return Mat_SizeOf(type);
}

/// Reads one variable whose head was read: real, numeric, a vector, within the limits, its data as long as it says.
Result<std::vector<double>> read_numbers(mat_t* file, matvar_t* variable, std::string_view name) {
  const std::size_t count = elements_of(*variable);
  if (count > kMaxRows) {
    return mat_error("too_large", name, fmt::format("{} values", count), fmt::format("at most {}", kMaxRows));
  }
  if (variable->isComplex || !is_vector(*variable) || variable->class_type < MAT_C_DOUBLE ||
      variable->class_type > MAT_C_UINT64) {
    return mat_error("not_a_number", name, "another kind of variable", "a real numeric vector");
  }
  if (Mat_VarReadDataAll(file, variable) != 0 || variable->data == nullptr) {
    if (count == 0) return std::vector<double>{};
    return mat_error("malformed_mat", name, "damaged data", "a whole MAT v5 file");
  }
  std::vector<double> values;
  if (variable->nbytes < count * element_size(variable->data_type) || !copy_numbers(*variable, count, values)) {
    return mat_error("malformed_mat", name, "data of another size", "a whole MAT v5 file");
  }
  return values;
}

/// The text of a short character vector; nothing where it is something else.
std::optional<std::string> read_text(mat_t* file, matvar_t* variable) {
  const std::size_t count = elements_of(*variable);
  if (variable->class_type != MAT_C_CHAR || !is_vector(*variable) || count > kMaxMetadataValueBytes)
    return std::nullopt;
  if (Mat_VarReadDataAll(file, variable) != 0 || variable->data == nullptr) return std::nullopt;
  if (variable->nbytes < count * element_size(variable->data_type)) return std::nullopt;
  std::string text;
  for (std::size_t i = 0; i < count; ++i) {
    std::uint32_t code = 0;
    if (variable->data_type == MAT_T_UINT8 || variable->data_type == MAT_T_UTF8 || variable->data_type == MAT_T_INT8) {
      text += static_cast<const char*>(variable->data)[i];
      continue;
    }
    if (variable->data_type != MAT_T_UINT16 && variable->data_type != MAT_T_UTF16) return std::nullopt;
    code = static_cast<const std::uint16_t*>(variable->data)[i];
    if (code < 0x80) {
      text += static_cast<char>(code);
    } else if (code < 0x800) {
      text += static_cast<char>(0xC0 | (code >> 6));
      text += static_cast<char>(0x80 | (code & 0x3F));
    } else {
      text += static_cast<char>(0xE0 | (code >> 12));
      text += static_cast<char>(0x80 | ((code >> 6) & 0x3F));
      text += static_cast<char>(0x80 | (code & 0x3F));
    }
  }
  return text;
}

bool is_metadata_key(std::string_view name) {
  return std::ranges::find(metadata_keys(), name, &MetadataKey::name) != metadata_keys().end();
}

struct Variables {
  Metadata metadata;
  std::vector<std::string> names;
  std::vector<std::vector<double>> values;
};

Result<void> take_variable(mat_t* file, matvar_t* variable, const ColumnMapping& mapping, Variables& variables) {
  const std::string name = variable->name;
  if (!is_clean_utf8(name)) return mat_error("bad_text", name, "a name that is no text", "UTF-8 text");
  if (is_metadata_key(name) && !may_be_planned(name, mapping)) {
    const auto text = read_text(file, variable);
    if (!text) return mat_error("bad_metadata", name, "another kind of variable", "a short character vector");
    return trim(*text).empty() ? Result<void>{} : set_metadata(variables.metadata, name, trim(*text));
  }
  if (std::ranges::find(variables.names, name) != variables.names.end()) {
    return mat_error("duplicate_column", name, "the variable twice", "each variable once");
  }
  variables.names.push_back(name);
  variables.values.emplace_back();
  if (!may_be_planned(name, mapping)) return {};
  auto numbers = read_numbers(file, variable, name);
  if (!numbers) return tl::unexpected(numbers.error());
  variables.values.back() = std::move(*numbers);
  return {};
}

Result<Variables> read_variables(mat_t* file, const ColumnMapping& mapping) {
  Variables variables;
  for (std::size_t count = 0;; ++count) {
    const MatVariable variable(Mat_VarReadNextInfo(file), &Mat_VarFree);
    if (!variable) return variables;
    if (count == kMaxVariables)
      return mat_error("too_large", "", "more variables", fmt::format("at most {}", kMaxVariables));
    if (variable->name == nullptr) continue;
    if (auto taken = take_variable(file, variable.get(), mapping, variables); !taken)
      return tl::unexpected(taken.error());
  }
}

Result<RawRecording> parse(const std::string& path, const std::string& name, const ColumnMapping& mapping) {
  if (!head_of(path).starts_with("MATLAB 5.")) {
    return mat_error("mat_version", "", "another version, v7.3 perhaps", "a v5 file; save it with '-v7'");
  }
  const MatFile file(Mat_Open(path.c_str(), MAT_ACC_RDONLY), &Mat_Close);
  if (!file) return mat_error("malformed_mat", "", "a damaged head", "a MAT v5 file");
  auto variables = read_variables(file.get(), mapping);
  if (!variables) return tl::unexpected(variables.error());
  auto plan = plan_columns(variables->names, mapping);
  if (!plan) return tl::unexpected(plan.error());
  for (PlannedColumn& column : *plan) column.channel.values = std::move(variables->values[column.index]);
  RawRecording raw;
  raw.name = name;
  raw.metadata = std::move(variables->metadata);
  place_channels(std::move(*plan), raw);
  return raw;
}

}  // namespace

bool is_mat(std::string_view first_bytes) {
  return first_bytes.starts_with("MATLAB ") || first_bytes.starts_with(kHdf5);
}

Result<RawRecording> parse_mat_file(const std::string& path, const std::string& name, const ColumnMapping& mapping) {
  auto raw = parse(path, name, mapping);
  if (!raw) raw.error().file = name;
  return raw;
}

Result<RawRecording> parse_mat_recording(ByteSource& source, const std::string& name, const ColumnMapping& mapping) {
  AnonymousFile bytes;
  if (auto taken = bytes.take(source); !taken) return tl::unexpected(taken.error());
  return parse_mat_file(bytes.path(), name, mapping);
}

}  // namespace valvetriage
