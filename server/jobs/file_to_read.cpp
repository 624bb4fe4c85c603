#include "server/jobs/file_to_read.h"

#include "core/recording/columns.h"

namespace valvetriage {

Json to_json(const FileToRead& file) {
  return {{"path", file.path}, {"name", file.name}, {"options", file.options_json}, {"test", or_null(file.test)}};
}

FileToRead file_to_read_from(JsonFields& fields) {
  FileToRead file;
  file.path = fields.text("path");
  file.name = fields.text("name");
  file.options_json = fields.text("options");
  file.test = fields.optional_text("test");
  return file;
}

Result<ReadOptions> read_options_of(const FileToRead& file) {
  auto mapping = column_mapping_of(file.options_json);
  if (!mapping) return tl::unexpected(mapping.error());
  ReadOptions options;
  options.name = file.name;
  options.mapping = std::move(*mapping);
  options.metadata.test = file.test;
  return options;
}

Result<ColumnMapping> column_mapping_of(std::string_view options_json) {
  const auto options = parse_json(options_json);
  if (!options) return tl::unexpected(options.error());
  std::optional<Error> error;
  JsonFields fields(*options, "", error);
  auto mapping = parse_column_mapping(fields.text_or("columns", ""));
  if (!mapping) return mapping;
  mapping->sample_rate_hz = fields.optional_number("sample_rate_hz");
  if (error) return tl::unexpected(*error);
  return mapping;
}

}  // namespace valvetriage
