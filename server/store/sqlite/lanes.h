#pragma once

#include <condition_variable>
#include <deque>
#include <exception>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "core/result.h"
#include "server/store/sqlite/connection.h"

namespace valvetriage::sqlite {

/// The one connection that writes, commits and checkpoints, on a thread of its own. What waits when a transaction
/// begins goes into it together and is answered after the common commit, so that a crowd of writers shares one fsync.
/// Each piece of work stands in its own savepoint: if it fails it leaves nothing, the others go on.
///
/// A failed fsync is the end: the kernel may have dropped the pages, a second try may lie. The lane then refuses
/// everything.
class WriterLane {
 public:
  explicit WriterLane(std::unique_ptr<Connection> connection);
  ~WriterLane();
  WriterLane(const WriterLane&) = delete;
  WriterLane& operator=(const WriterLane&) = delete;

  /// Runs `work(Connection&)`, which gives a Result; returns it when it is durable.
  template <typename Work>
  auto run(const Work& work) -> decltype(work(std::declval<Connection&>())) {
    std::optional<decltype(work(std::declval<Connection&>()))> result;
    const auto failure = submit([&](Connection& connection) {
      result.emplace(work(connection));
      return result->has_value();
    });
    if (failure) return tl::unexpected(*failure);
    return std::move(*result);
  }

 private:
  /// False: undo what it did.
  using Work = std::function<bool(Connection&)>;
  struct Ticket {
    const Work* work = nullptr;
    std::optional<Error> failure{};
    bool finished = false;
  };

  /// What the lane itself has to say against it; nothing if the work ran and its own result stands.
  std::optional<Error> submit(const Work& work);
  void loop();
  void run_batch(const std::vector<Ticket*>& batch);
  void run_in_transaction(const std::vector<Ticket*>& batch);
  void run_one(Ticket& ticket);

  std::unique_ptr<Connection> connection_;
  std::mutex mutex_;
  std::condition_variable work_waits_;
  std::condition_variable work_done_;
  std::deque<Ticket*> waiting_;
  bool stopping_ = false;
  std::optional<Error> broken_;
  std::thread thread_;
};

/// Connections that only read; a call waits for a free one.
class ReaderPool {
 public:
  ReaderPool(const std::string& file, int connections);

  /// Runs `work(Connection&)` in one read transaction: it sees one state.
  template <typename Work>
  auto run(const Work& work) -> decltype(work(std::declval<Connection&>())) {
    const Loan loan(*this);
    try {
      loan.connection->script("BEGIN");
      auto result = work(*loan.connection);
      loan.connection->script("COMMIT");
      return result;
    } catch (const SqliteError& error) {
      loan.abandon();
      return tl::unexpected(to_error(error));
    } catch (const std::exception& error) {
      loan.abandon();
      return fail("store_broken", std::string("a row could not be read: ") + error.what());
    }
  }

 private:
  struct Loan {
    explicit Loan(ReaderPool& from) : pool(from), connection(pool.take()) {}
    ~Loan() { pool.give_back(connection); }
    Loan(const Loan&) = delete;
    Loan& operator=(const Loan&) = delete;
    /// Ends the transaction, if it is still open: the next borrower begins its own.
    void abandon() const {
      if (connection->in_transaction()) sqlite3_exec(connection->handle(), "ROLLBACK", nullptr, nullptr, nullptr);
    }
    ReaderPool& pool;
    Connection* connection;
  };

  Connection* take();
  void give_back(Connection* connection);

  std::vector<std::unique_ptr<Connection>> connections_;
  std::mutex mutex_;
  std::condition_variable one_is_free_;
  std::vector<Connection*> free_;
};

}  // namespace valvetriage::sqlite
