#include "server/jobs/worker.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <optional>
#include <utility>

#include "server/store/id.h"

namespace valvetriage {
namespace {

using std::chrono::milliseconds;
using SteadyTime = std::chrono::steady_clock::time_point;

/// How soon a cancelled job's child is noticed.
constexpr milliseconds kLookEvery{1'000};
// Whoever looks at a running job sees a new stage no later.
constexpr milliseconds kTellNoLaterThan{1'000};

SteadyTime now() {
  return std::chrono::steady_clock::now();
}

/// The document that serves this valve type; nothing where there is none.
Result<std::optional<DocumentBody>> serving_document(Store& store, DocumentKind kind, const Labels& labels) {
  if (!labels.valve_type) return std::nullopt;
  auto document = store.document(kind, *labels.valve_type);
  if (document) return std::move(*document);
  if (document.error().code == "not_found") return std::nullopt;
  return tl::unexpected(document.error());
}

Result<JobSpec> gather(Store& store, const BlobStore& blobs, const JobRow& job,
                       const std::optional<std::string>& default_rule_base_json,
                       const std::function<bool()>& keep_going) {
  const auto submission = store.submission(job.submission_id);
  if (!submission) return tl::unexpected(submission.error());
  const auto recordings = store.recordings_of(job.submission_id);
  if (!recordings) return tl::unexpected(recordings.error());
  auto reference = serving_document(store, DocumentKind::kReference, submission->labels);
  if (!reference) return tl::unexpected(reference.error());
  auto rule_base = serving_document(store, DocumentKind::kRuleBase, submission->labels);
  if (!rule_base) return tl::unexpected(rule_base.error());

  JobSpec spec;
  spec.job_id = job.id;
  spec.submission_id = job.submission_id;
  spec.labels = submission->labels;
  spec.options_json = job.options_json;
  if (*reference) {
    spec.reference_json = std::move((*reference)->body_json);
    spec.reference_version = (*reference)->row.version;
  }
  spec.rule_base_json = *rule_base ? std::move((*rule_base)->body_json) : default_rule_base_json;
  for (const RecordingRow& row : *recordings) {
    if (const auto sound = blobs.verify(row.sha256, keep_going); !sound) return tl::unexpected(sound.error());
    spec.files.push_back({row.name, row.sha256, blobs.path_of(row.sha256), row.test, row.metadata_json});
  }
  return spec;
}

/// Bytes that are gone or changed stay so; the rest may be a busy disk or database.
AttemptEnd end_for_gathering(const Error& error) {
  const bool lasting = error.code == "blob_damaged" || error.code == "not_found";
  return lasting ? AttemptEnd::kFailed : AttemptEnd::kFault;
}

/// Keeps one lease alive while its recordings are gathered and its child runs, and says when to stop.
class LeaseKeeper {
 public:
  enum class Stop { kNo, kLost, kDraining };

  LeaseKeeper(Store& store, const JobRow& job, std::int64_t lease_ms, std::function<bool()> draining)
      : store_(store), lease_(job.lease()), lease_ms_(lease_ms), draining_(std::move(draining)) {}

  void note(const ChildProgress& progress) {
    if (progress.note != progress_.note) next_beat_ = std::min(next_beat_, beaten_at_ + kTellNoLaterThan);
    progress_ = progress;
  }
  Stop stop() const { return stop_; }

  bool keep_going() {
    if (stop_ == Stop::kNo && draining_()) stop_ = Stop::kDraining;
    if (stop_ == Stop::kNo && now() >= next_look_) look();
    if (stop_ == Stop::kNo && now() >= next_beat_) beat();
    return stop_ == Stop::kNo;
  }

 private:
  void look() {
    next_look_ = now() + kLookEvery;
    const auto job = store_.job(lease_.job_id);
    if (job && (job->state != JobState::kRunning || job->fence != lease_.fence)) stop_ = Stop::kLost;
  }

  void beat() {
    beaten_at_ = now();
    next_beat_ = beaten_at_ + milliseconds(lease_ms_ / 3);
    const auto beaten = store_.heartbeat(lease_, lease_ms_, progress_.fraction, progress_.note);
    if (beaten) {
      confirmed_at_ = now();
    } else if (beaten.error().code == "lease_lost" || now() - confirmed_at_ > milliseconds(lease_ms_ * 2 / 3)) {
      // Stopping before the lease runs out: the next owner must not find us still at work.
      stop_ = Stop::kLost;
    }
  }

  Store& store_;
  LeaseToken lease_;
  std::int64_t lease_ms_;
  std::function<bool()> draining_;
  ChildProgress progress_;
  Stop stop_ = Stop::kNo;
  SteadyTime confirmed_at_ = now(), beaten_at_ = now();
  SteadyTime next_look_ = now() + kLookEvery;
  SteadyTime next_beat_ = now() + milliseconds(lease_ms_ / 3);
};

struct AttemptResult {
  AttemptEnd end;
  Error problem;
};

/// What an end without an answer means.
AttemptResult judge(const ChildOutcome& outcome) {
  const std::string last_words = outcome.messages.empty() ? "" : ": " + outcome.messages;
  switch (outcome.end) {
    case ChildEnd::kTimeout:
      return {AttemptEnd::kTimeout,
              {.code = "analysis_timeout", .message = "the analysis took longer than one job may"}};
    case ChildEnd::kResource:
      return {AttemptEnd::kFailed,
              {.code = "analysis_too_large", .message = "the analysis gave more output than one job may"}};
    case ChildEnd::kSignal:
      return {AttemptEnd::kCrash,
              {.code = "analysis_crashed",
               .message = fmt::format("the analysis was ended by signal {}{}", outcome.status, last_words)}};
    default:
      return {AttemptEnd::kCrash,
              {.code = "analysis_crashed",
               .message = fmt::format("the analysis ended without an answer, "
                                      "status {}{}",
                                      outcome.status, last_words)}};
  }
}

}  // namespace

WorkerPool::WorkerPool(Store& store, BlobStore& blobs, WorkerOptions options)
    : store_(store), blobs_(blobs), options_(std::move(options)), pool_name_(random_name()) {
  if (options_.child_command.empty()) options_.child_command = {"/proc/self/exe", std::string(kChildVerb)};
  if (const auto released = store_.release_dead_leases(); !released) options_.log(released.error().message);
  for (int number = 0; number < options_.workers; ++number) threads_.emplace_back([this, number] { loop(number); });
}

WorkerPool::~WorkerPool() {
  drain();
}

void WorkerPool::wake() {
  {
    const std::lock_guard lock(mutex_);
    ++wakes_;
  }
  changed_.notify_all();
}

void WorkerPool::drain() {
  {
    const std::lock_guard lock(mutex_);
    draining_ = true;
  }
  changed_.notify_all();
  for (std::thread& thread : threads_) {
    if (thread.joinable()) thread.join();
  }
}

bool WorkerPool::draining() {
  const std::lock_guard lock(mutex_);
  return draining_;
}

void WorkerPool::loop(int number) {
  const std::string name = fmt::format("{}-{}", pool_name_, number);
  while (!draining()) {
    // Counted before the queue is asked: a job that comes while it is asked does not wait for the next look.
    const std::uint64_t seen = wakes();
    if (!run_next(name)) wait_for_work(seen);
  }
}

std::uint64_t WorkerPool::wakes() {
  const std::lock_guard lock(mutex_);
  return wakes_;
}

void WorkerPool::wait_for_work(std::uint64_t seen) {
  std::unique_lock lock(mutex_);
  changed_.wait_for(lock, milliseconds(options_.poll_ms), [&] { return draining_ || wakes_ != seen; });
}

bool WorkerPool::run_next(const std::string& name) {
  if (const auto expired = store_.expire_leases(); !expired) options_.log(expired.error().message);
  const auto claimed = store_.claim(name, options_.lease_ms);
  if (!claimed) options_.log(claimed.error().message);
  if (!claimed || !*claimed) return false;
  ++busy_;
  run(**claimed);
  --busy_;
  return true;
}

void WorkerPool::run(const JobRow& job) {
  const auto end = [&](AttemptEnd how, const std::string& problem) {
    const auto ended = store_.end_attempt(job.lease(), how, problem);
    if (!ended && ended.error().code != "lease_lost") options_.log(ended.error().message);
  };
  LeaseKeeper keeper(store_, job, options_.lease_ms, [this] { return draining(); });
  const auto keep_going = [&] { return keeper.keep_going(); };
  const auto is_stopped = [&] {
    if (keeper.stop() == LeaseKeeper::Stop::kDraining) end(AttemptEnd::kReturned, "");
    return keeper.stop() != LeaseKeeper::Stop::kNo;
  };
  const auto spec = gather(store_, blobs_, job, options_.rule_base_json, keep_going);
  if (!spec && is_stopped()) return;
  if (!spec) return end(end_for_gathering(spec.error()), problem_json(spec.error()));

  ChildMessage answer;
  const auto on_line = [&](std::string_view line) {
    auto message = child_message_from(line);
    if (!message) {
      options_.log(fmt::format("job {}: the analysis said something that is no message", job.id));
    } else if (message->progress) {
      keeper.note(*message->progress);
    } else {
      answer = std::move(*message);
    }
  };
  const auto outcome = run_child_process(options_.child_command, to_json_text(*spec), options_.child,
                                         {.on_line = on_line, .keep_going = keep_going});
  if (!outcome) return end(AttemptEnd::kFault, problem_json(outcome.error()));
  if (is_stopped()) return;

  const bool ended_well = outcome->end == ChildEnd::kExited && outcome->status == 0;
  if (ended_well && answer.rejected_json) return end(AttemptEnd::kRejected, *answer.rejected_json);
  if (ended_well && answer.fault_json) return end(AttemptEnd::kFault, *answer.fault_json);
  if (!ended_well || !answer.done) {
    const AttemptResult judged = judge(*outcome);
    options_.log(fmt::format("job {}: {}", job.id, judged.problem.message));
    return end(judged.end, problem_json(judged.problem));
  }
  const auto finished = store_.finish(job.lease(), *answer.done);
  if (!finished && finished.error().code != "lease_lost") end(AttemptEnd::kFault, problem_json(finished.error()));
}

}  // namespace valvetriage
