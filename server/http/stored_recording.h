#pragma once

#include <semaphore>
#include <string>
#include <vector>

#include "core/recording/recording.h"
#include "server/http/service.h"

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

/// A stored recording as the analysis reads it: with the options of its newest job and the labels it was accepted with.
///
/// A MAT file is read by a child, for this process never opens one.
///
/// Errors  those of read_recording; `not_available` where the child gave no answer
Result<Recording> read_stored_recording(Service& service, const RecordingRow& row);

}  // namespace valvetriage::http
