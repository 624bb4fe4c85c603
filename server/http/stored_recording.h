#pragma once

#include <semaphore>
#include <string>
#include <vector>

#include "core/recording/recording.h"
#include "server/http/service.h"

namespace valvetriage::http {

/// One of the places for work inside the server, held as long as it lives.
class ComputationPlace {
 public:
  /// Waits a moment for a place. Errors `busy`.
  static Result<ComputationPlace> take(Service& service);
  ComputationPlace(ComputationPlace&& other) noexcept : service_(std::exchange(other.service_, nullptr)) {}
  ComputationPlace& operator=(ComputationPlace&&) = delete;
  ~ComputationPlace() {
    if (service_) service_->computations.release();
  }

 private:
  explicit ComputationPlace(Service* service) : service_(service) {}
  Service* service_;
};

/// A stored recording as the analysis reads it: with the options of its newest job and the labels it was accepted with.
///
/// A MAT file is read by a child, for this process never opens one.
///
/// Errors  those of read_recording; `not_available` where the child gave no answer
Result<Recording> read_stored_recording(Service& service, const RecordingRow& row);

}  // namespace valvetriage::http
