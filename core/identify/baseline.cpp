#include "core/identify/baseline.h"

namespace valvetriage {
namespace {

/// A baseline is to be the linear machine behind the recording, not a flexible curve through its nonlinearity.
constexpr int kLargestSelfOrder = 5;

constexpr int kPaperOrder = 7;  // Eqs 18 and 19
constexpr int kPaperZeros = 6;

Result<FittedBaseline> fit(std::span<const Recording> recordings, const IdentifyOptions& options) {
  std::vector<const Recording*> pointers;
  for (const Recording& recording : recordings) pointers.push_back(&recording);
  auto identification = identify(pointers, options);
  if (!identification) return tl::unexpected(identification.error());
  FittedBaseline baseline;
  baseline.model = to_model(*identification);
  if (identification->run) baseline.simulated = identification->run->simulated;
  baseline.identification = std::move(*identification);
  return baseline;
}

}  // namespace

Result<FittedBaseline> fit_self_baseline(std::span<const Recording> recordings) {
  IdentifyOptions options;
  options.largest_order = kLargestSelfOrder;
  options.offsets = OffsetSharing::kShared;
  return fit(recordings, options);
}

Result<FittedBaseline> fit_paper_baseline(std::span<const Recording> recordings) {
  IdentifyOptions options;
  options.method = IdentificationMethod::kRls;
  options.order = kPaperOrder;
  options.zeros = kPaperZeros;
  options.delay_samples = 1;
  return fit(recordings, options);
}

}  // namespace valvetriage
