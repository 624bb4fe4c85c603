#include "server/http/handlers.h"
#include "server/http/lot_shifts.h"
#include "server/http/stored_history.h"
#include "server/http/views.h"

namespace valvetriage::http {
namespace {

Json view(const report::FigureShift& found) {
  const auto [low, high] = found.difference_ci95();
  return Json{{"name", found.figure.name},
              {"unit", found.figure.unit},
              {"level_A", or_null(found.figure.level_a)},
              {"words", report::figure_words(found.figure)},
              {"good_mean", found.good_mean()},
              {"lot_mean", found.lot_mean()},
              {"shift", found.difference()},
              {"ci95", Json::array({low, high})},
              {"p_value", found.shift.p_value},
              {"p_adjusted", found.p_adjusted},
              {"largest_single_sd", found.shift.largest_single}};
}

}  // namespace

Result<Response> get_lot_shifts(Service& service, Request& request) {
  const auto lot = service.store.lot(request.captures[0]);
  if (!lot) return tl::unexpected(lot.error());
  const auto history = stored_history(service.store, {.lot = lot->lot});
  if (!history) return tl::unexpected(history.error());
  const auto shifts = lot_shifts(service.store, *history);
  if (!shifts) return tl::unexpected(shifts.error());
  Json items = Json::array();
  for (const report::FigureShift& found : shifts->figures) items.push_back(view(found));
  return json_response(Json{{"lot", lot->lot},
                            {"valves", shifts->valves},
                            {"good_valves", shifts->good_valves},
                            {"scope", report::shift_scope(*shifts)},
                            {"sentences", report::shift_sentences(*shifts)},
                            {"items", std::move(items)}});
}

}  // namespace valvetriage::http
