#pragma once

#include <string>

#include "core/result.h"

namespace valvetriage {

/// Prints an HTML page to a PDF file by the Chromium that is installed, without a window and with a profile of its own.
///
/// Errors  `no_chromium` where there is none; `cannot_write` where it failed
Result<void> print_pdf(const std::string& html, const std::string& pdf_file);

}  // namespace valvetriage
