#pragma once

#include <filesystem>
#include <string>

namespace valvetriage {

/// Checks a JSON text against schemas/<name>.schema.json; empty where it fits, else what does not.
std::string schema_violations(const std::string& name, const std::string& json_text);

/// The folder schemas/ of this source tree.
std::filesystem::path schema_folder();

/// A file as it stands.
std::string text_of(const std::filesystem::path& file);

}  // namespace valvetriage
