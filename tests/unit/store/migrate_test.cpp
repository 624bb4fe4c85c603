#include "server/store/sqlite/migrate.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/file.h>
#include <sys/wait.h>
#include <unistd.h>

#include "server/store/sqlite/sqlite_store.h"
#include "tests/contract/temporary_folder.h"

namespace valvetriage::sqlite {
namespace {

class Migrate : public testing::Test {
 protected:
  std::string file() const { return folder_.file("db"); }

  std::int64_t tables() {
    Connection connection(file(), Access::kWrite);
    return connection.integer("SELECT count(*) FROM sqlite_schema WHERE type = 'table' AND name NOT LIKE 'sqlite_%'");
  }

  test::TemporaryFolder folder_;
};

/// Dies, as by a kill, when the statement number `*left` begins.
int die_in_time(unsigned, void* left, void*, void*) {
  if (--*static_cast<int*>(left) == 0) ::_exit(9);
  return 0;
}

TEST_F(Migrate, TakesEachStepOnce) {
  Connection connection(file(), Access::kWrite);
  EXPECT_EQ(*migrate(connection), static_cast<int>(migrations().size()));
  EXPECT_EQ(*migrate(connection), 0);
  EXPECT_TRUE(check_schema(connection));
}

TEST_F(Migrate, LeavesAWholeSchemaWhereverItIsKilled) {
  bool finished = false;
  for (int statement = 1; !finished; ++statement) {
    const pid_t child = ::fork();
    if (child == 0) {
      Connection connection(file(), Access::kWrite);
      int left = statement;
      sqlite3_trace_v2(connection.handle(), SQLITE_TRACE_STMT, die_in_time, &left);
      ::_exit(migrate(connection) ? 0 : 1);
    }
    int status = 0;
    ASSERT_EQ(::waitpid(child, &status, 0), child);
    finished = WEXITSTATUS(status) == 0;
    const int version = [&] {
      Connection connection(file(), Access::kWrite);
      EXPECT_EQ(connection.query("PRAGMA integrity_check").next(), true);
      const int found = schema_version(connection);
      EXPECT_EQ(connection.integer("SELECT count(*) FROM pragma_table_info('analyses') WHERE name = 'features'"),
                found >= 2 ? 1 : 0);
      return found;
    }();
    EXPECT_EQ(version >= 1, tables() > 0) << "killed at statement " << statement;
    ASSERT_LT(statement, 1000);
    if (version == migrations().back().version) finished = true;
  }
}

TEST_F(Migrate, CarriesTheStrongestCauseOfOlderResultsOverAsAllThatIsKnown) {
  Connection connection(file(), Access::kWrite);
  ASSERT_TRUE(migrate(connection, migrations().first(2)));
  connection.script(
      "INSERT INTO submissions (seq, id, job_id, state, received_at, lot, serial, recordings, verdict, conclusion, "
      "top_cause, top_cause_probability) VALUES (1, 'sub_1', 'job_1', 'done', 5, 'lot-a', 'EFC-1', 1, 'Severe', "
      "'named', 'friction', 0.97), (2, 'sub_2', 'job_2', 'done', 6, 'lot-a', 'EFC-2', 1, 'Good', 'none', NULL, NULL);"
      "INSERT INTO lots (lot, first_received_at, last_received_at, recordings, submissions) VALUES ('lot-a', 5, 6, 2, "
      "2);"
      "INSERT INTO lot_valves VALUES ('lot-a', 'serial EFC-1', 1, 'Severe', 'friction'), "
      "('lot-a', 'serial EFC-2', 2, 'Good', '')");
  ASSERT_TRUE(migrate(connection));
  const auto store = open_sqlite_store(file());
  ASSERT_TRUE(store);
  const auto found = (*store)->list_submissions({.cause = "friction"}, {});
  ASSERT_EQ(found->items.size(), 1u);
  EXPECT_EQ(found->items[0].summary.causes,
            (std::vector<CauseSummary>{{.cause = "friction", .probability = 0.97, .settled = true}}));
  const auto lot = (*store)->lot("lot-a");
  EXPECT_EQ(lot->causes, (std::map<std::string, std::int64_t>{{"friction", 1}}));
  EXPECT_EQ(lot->verdicts, (std::map<std::string, std::int64_t>{{"Good", 1}, {"Severe", 1}}));
  EXPECT_EQ(lot->valves, 2);
}

TEST_F(Migrate, UndoesAStepThatFails) {
  Connection connection(file(), Access::kWrite);
  const Migration steps[] = {{1, "one", "CREATE TABLE a (x) STRICT_NO;"}};
  EXPECT_THROW((void)migrate(connection, steps), SqliteError);
  const Migration half[] = {{1, "one", "CREATE TABLE a (x); CREATE TABLE a (x);"}};
  EXPECT_THROW((void)migrate(connection, half), SqliteError);
  EXPECT_EQ(schema_version(connection), 0);
  EXPECT_EQ(tables(), 0);
}

TEST_F(Migrate, RefusesADatabaseOfANewerVersionAndDoesNotTouchIt) {
  { ASSERT_TRUE(open_sqlite_store(file())); }
  const int newer = migrations().back().version + 1;
  { Connection(file(), Access::kWrite).script("PRAGMA user_version = " + std::to_string(newer)); }
  const auto store = open_sqlite_store(file());
  ASSERT_FALSE(store);
  EXPECT_EQ(store.error().code, "schema_too_new");
  EXPECT_NE(store.error().message.find("run the version that wrote it"), std::string::npos);
  Connection connection(file(), Access::kWrite);
  EXPECT_EQ(schema_version(connection), newer);
}

TEST_F(Migrate, RefusesAnOlderDatabaseWhereItMayNotMigrate) {
  { Connection(file(), Access::kWrite).script("CREATE TABLE old (x)"); }
  EXPECT_EQ(open_sqlite_store(file(), {.migrate = false}).error().code, "schema_too_old");
}

TEST_F(Migrate, LetsOnlyOneServerHaveADatabase) {
  const auto first = open_sqlite_store(file());
  ASSERT_TRUE(first);
  const auto second = open_sqlite_store(file());
  ASSERT_FALSE(second);
  EXPECT_EQ(second.error().code, "store_locked");
}

TEST_F(Migrate, WaitsForTheChildThatAKilledServerLeftBeforeItsExec) {
  const int lock = ::open((file() + ".lock").c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0640);
  ASSERT_EQ(::flock(lock, LOCK_EX | LOCK_NB), 0);
  const pid_t child = ::fork();  // shares the lock until it ends
  if (child == 0) {
    ::usleep(200'000);
    ::_exit(0);
  }
  ::close(lock);
  EXPECT_TRUE(open_sqlite_store(file()));
  ::waitpid(child, nullptr, 0);
}

TEST_F(Migrate, LetsAReaderInBesideTheServerButNotWrite) {
  const auto server = open_sqlite_store(file());
  const auto reader = open_sqlite_reader(file());
  ASSERT_TRUE(reader);
  EXPECT_TRUE((*reader)->queue_stats());
  EXPECT_EQ((*reader)->probe().error().code, "read_only");
}

TEST_F(Migrate, RefusesAFileThatIsNoDatabase) {
  {
    FILE* other = std::fopen(file().c_str(), "w");
    std::fputs(
        "time_s,current_A,pressure_psi, and so on for more than a hundred bytes of something that is no database",
        other);
    std::fclose(other);
  }
  const auto store = open_sqlite_store(file());
  ASSERT_FALSE(store);
  EXPECT_EQ(store.error().code, "store_broken");
}

}  // namespace
}  // namespace valvetriage::sqlite
