#pragma once

#include <CLI/CLI.hpp>

#include "core/result.h"

namespace valvetriage {

/// Exit statuses of the contract.
enum ExitStatus : int { kDone = 0, kFailure = 1, kBadInput = 2, kVerdictNotGood = 3 };

/// Each verb is one file and adds itself to the application. When the verb was called, its callback runs it and sets
/// `exit_status`. Results go to standard output, messages to standard error, progress to a terminal only.
/// The list in main.cpp is the list of verbs.
// clang-format off
#define VALVETRIAGE_COMMANDS(X) \
  X(analysis_child) \
  X(analyze) \
  X(backup) \
  X(check) \
  X(classify) \
  X(export) \
  X(identify) \
  X(learning_child) \
  X(migrate) \
  X(paper) \
  X(plan) \
  X(reading_child) \
  X(reference) \
  X(report) \
  X(restore) \
  X(rule_base) \
  X(serve) \
  X(simulate) \
  X(submit) \
  X(token)
// clang-format on

#define X(verb) void add_##verb##_command(CLI::App& app, int& exit_status);
VALVETRIAGE_COMMANDS(X)
#undef X

/// For verbs that fit valves, before they begin: a fit takes and frees the same few signals thousands of times. By
/// default the C library gives signals of a session's length back to the system each time, and their pages are faulted
/// in and zeroed anew: a third of an analysis.
void keep_freed_memory();

/// Prints an error the way every verb does: "valvetriage: FILE: message" on standard error.
void print_error(const Error& error);

/// Prints the error and gives the exit status it ends a verb with: kFailure where the machine failed (`cannot_write`,
/// `internal`), kBadInput where the input or the call was wrong.
ExitStatus ended_by(const Error& error);

}  // namespace valvetriage
