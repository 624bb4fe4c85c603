#include "server/store/sqlite/lanes.h"

#include <algorithm>

namespace valvetriage::sqlite {
namespace {

/// Keeps one transaction short enough that the first in it does not wait for a crowd.
constexpr std::size_t kMaxBatch = 64;

bool is_failed_sync(int code) {
  return code == SQLITE_IOERR_FSYNC || code == SQLITE_IOERR_DIR_FSYNC;
}

/// A rollback that fails changes nothing: the transaction is not committed either way.
void roll_back(Connection& connection) {
  if (connection.in_transaction()) sqlite3_exec(connection.handle(), "ROLLBACK", nullptr, nullptr, nullptr);
}

Error broken_by(const SqliteError& error) {
  return {.code = "store_broken",
          .message = std::string("the disk failed to keep the database (") + error.what() +
                     "): check the disk, then start the server again"};
}

}  // namespace

WriterLane::WriterLane(std::unique_ptr<Connection> connection)
    : connection_(std::move(connection)), thread_([this] { loop(); }) {}

WriterLane::~WriterLane() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  work_waits_.notify_one();
  thread_.join();
}

std::optional<Error> WriterLane::submit(const Work& work) {
  Ticket ticket{.work = &work};
  std::unique_lock lock(mutex_);
  waiting_.push_back(&ticket);
  work_waits_.notify_one();
  work_done_.wait(lock, [&] { return ticket.finished; });
  return ticket.failure;
}

void WriterLane::loop() {
  std::unique_lock lock(mutex_);
  for (;;) {
    work_waits_.wait(lock, [&] { return stopping_ || !waiting_.empty(); });
    if (waiting_.empty()) return;
    const auto count = static_cast<std::ptrdiff_t>(std::min(waiting_.size(), kMaxBatch));
    const std::vector<Ticket*> batch(waiting_.begin(), waiting_.begin() + count);
    waiting_.erase(waiting_.begin(), waiting_.begin() + count);
    lock.unlock();
    run_batch(batch);
    lock.lock();
    for (Ticket* ticket : batch) ticket->finished = true;
    work_done_.notify_all();
  }
}

void WriterLane::run_batch(const std::vector<Ticket*>& batch) {
  std::optional<Error> failure = broken_;
  if (!failure) {
    try {
      run_in_transaction(batch);
      return;
    } catch (const SqliteError& error) {
      roll_back(*connection_);
      if (is_failed_sync(error.code())) broken_ = broken_by(error);
      failure = broken_ ? *broken_ : to_error(error);
    }
  }
  for (Ticket* ticket : batch) ticket->failure = failure;
}

void WriterLane::run_in_transaction(const std::vector<Ticket*>& batch) {
  connection_->run("BEGIN IMMEDIATE");
  for (Ticket* ticket : batch) run_one(*ticket);
  connection_->run("COMMIT");
}

void WriterLane::run_one(Ticket& ticket) {
  connection_->run("SAVEPOINT work");
  bool keep = false;
  try {
    keep = (*ticket.work)(*connection_);
  } catch (const SqliteError& error) {
    // Full disks and I/O errors end the whole transaction, and with it what the others did.
    if (!connection_->in_transaction()) throw;
    ticket.failure = to_error(error);
  } catch (const std::exception& error) {
    ticket.failure =
        Error{.code = "store_broken", .message = std::string("a change could not be made: ") + error.what()};
  }
  if (!keep) connection_->run("ROLLBACK TO work");
  connection_->run("RELEASE work");
}

ReaderPool::ReaderPool(const std::string& file, int connections) {
  for (int i = 0; i < connections; ++i) {
    connections_.push_back(std::make_unique<Connection>(file, Access::kRead));
    free_.push_back(connections_.back().get());
  }
}

Connection* ReaderPool::take() {
  std::unique_lock lock(mutex_);
  one_is_free_.wait(lock, [&] { return !free_.empty(); });
  Connection* connection = free_.back();
  free_.pop_back();
  return connection;
}

void ReaderPool::give_back(Connection* connection) {
  {
    const std::lock_guard lock(mutex_);
    free_.push_back(connection);
  }
  one_is_free_.notify_one();
}

}  // namespace valvetriage::sqlite
