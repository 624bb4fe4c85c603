#include "server/store/sqlite/migrate.h"

#include <fmt/format.h>

namespace valvetriage::sqlite {
namespace {

Result<void> refuse_newer(int found, int newest) {
  if (found <= newest) return {};
  return fail("schema_too_new",
              fmt::format("the database has schema {}, this version of valvetriage knows schemas up to {}: "
                          "run the version that wrote it, or a newer one",
                          found, newest));
}

void apply(Connection& connection, const Migration& step) {
  connection.script("BEGIN IMMEDIATE");
  try {
    connection.script(std::string(step.sql));
    connection.script(fmt::format("PRAGMA user_version = {}", step.version));
    connection.script("COMMIT");
  } catch (...) {
    if (connection.in_transaction()) connection.script("ROLLBACK");
    throw;
  }
}

}  // namespace

int schema_version(Connection& connection) {
  return static_cast<int>(connection.integer("PRAGMA user_version"));
}

Result<int> migrate(Connection& connection, std::span<const Migration> steps) {
  const int found = schema_version(connection);
  if (auto known = refuse_newer(found, steps.back().version); !known) return tl::unexpected(known.error());
  int taken = 0;
  for (const Migration& step : steps) {
    if (step.version <= found) continue;
    apply(connection, step);
    ++taken;
  }
  return taken;
}

Result<void> check_schema(Connection& connection) {
  const int newest = migrations().back().version;
  const int found = schema_version(connection);
  if (found < newest) {
    return fail("schema_too_old",
                fmt::format("the database has schema {}, this version of valvetriage works on schema {}: "
                            "stop the server and run `valvetriage migrate`",
                            found, newest));
  }
  return refuse_newer(found, newest);
}

}  // namespace valvetriage::sqlite
