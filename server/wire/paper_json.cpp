#include "server/wire/paper_json.h"

namespace valvetriage {

Json to_json(std::span<const PaperLine> lines) {
  Json document{{"lines", Json::array()}};
  for (const PaperLine& line : lines) {
    Json figures = Json::array();
    for (const PaperFigure& figure : line.figures) {
      figures.push_back({{"name", figure.name}, {"value", figure.value}, {"unit", figure.unit}});
    }
    document["lines"].push_back({{"where", line.where},
                                 {"as_printed", line.as_printed},
                                 {"recomputed", line.recomputed},
                                 {"does_not_hold", line.does_not_hold},
                                 {"figures", figures}});
  }
  return document;
}

}  // namespace valvetriage
