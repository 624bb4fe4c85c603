#pragma once

#include <semaphore>
#include <string>
#include <vector>

#include "core/recording/recording.h"
#include "server/http/service.h"
#include "server/jobs/file_to_read.h"

namespace valvetriage::http {

/// One of the places for work of a kind, held as long as it lives.
class PlaceForWork {
 public:
  /// Waits a moment for a place. Errors `busy`.
  static Result<PlaceForWork> take(Places& places);
  PlaceForWork(PlaceForWork&& other) noexcept : places_(std::exchange(other.places_, nullptr)) {}
  PlaceForWork& operator=(PlaceForWork&&) = delete;
  ~PlaceForWork() {
    if (places_) places_->release();
  }

 private:
  explicit PlaceForWork(Places* places) : places_(places) {}
  Places* places_;
};

/// How a stored recording is read: as for the analysis that is shown, for its newest job before there is one. A later
/// job that asked for other columns and came to nothing changes nothing.
Result<std::string> reading_options_of(Store& store, std::string_view submission_id, std::string_view newest_job_id);
Result<FileToRead> file_of(Service& service, const RecordingRow& row);

/// A stored recording as the analysis reads it, with the labels it was accepted with.
///
/// A MAT file is read by a child, for this process never opens one.
///
/// Errors  those of read_recording; `not_available` where the child gave no answer; `reading_timeout`; `draining`
Result<Recording> read_stored_recording(Service& service, const RecordingRow& row);

}  // namespace valvetriage::http
