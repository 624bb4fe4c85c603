#include "server/wire/analysis_json.h"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <limits>

#include "server/wire/model_json.h"
#include "tests/unit/wire/generate.h"

namespace valvetriage {
namespace {

const AnalysisMaking kMaking{.engine_version = "0.1.0", .settings_sha256 = "ab", .timing_s = {{"total", 0.5}}};

RC_GTEST_PROP(AnalysisJson, ReadsBackWhatItWrote, ()) {
  const Json written = to_json(generate::analysis(), kMaking);
  const auto read = analysis_from_json(generate::through_text(written));
  RC_ASSERT(read.has_value());
  RC_ASSERT(to_json(read->analysis, read->making) == written);
}

RC_GTEST_PROP(AnalysisJson, TheHashLeavesOutTimesAndNamesAlone, ()) {
  Analysis analysis = generate::analysis();
  // Findings tell where they are by the recording's name.
  const auto call_first = [&](const std::string& name) {
    analysis.recordings[0].name = analysis.simulation.per_recording[0].name = name;
    if (!analysis.discrepancy) return;
    for (Finding& finding : analysis.discrepancy->findings) finding.where = "5.8 Hz in " + name;
  };
  call_first("multisine.csv");
  const Json before = to_json(analysis, kMaking);
  AnalysisMaking slower = kMaking;
  slower.timing_s["total"] = 9;
  call_first("renamed.csv");
  RC_ASSERT(to_json(analysis, slower)["result_sha256"] == before["result_sha256"]);
  analysis.recordings[0].samples += 1;
  RC_ASSERT(to_json(analysis, kMaking)["result_sha256"] != before["result_sha256"]);
}

RC_GTEST_PROP(AnalysisJson, TheResultsHashDoesNotKnowTheNumberAStoreGaveTheReference, ()) {
  Analysis analysis = generate::analysis();
  analysis.baseline.reference.emplace();
  const Json in_a_file = to_json(analysis, kMaking);
  analysis.baseline.reference->version = 3;
  RC_ASSERT(to_json(analysis, kMaking)["result_sha256"] == in_a_file["result_sha256"]);
  analysis.baseline.reference->sha256 = "another";
  RC_ASSERT(to_json(analysis, kMaking)["result_sha256"] != in_a_file["result_sha256"]);
}

RC_GTEST_PROP(AnalysisJson, TheBaselinesModelIsAModelByItself, ()) {
  const Json document = to_json(generate::analysis(), kMaking);
  RC_ASSERT(model_from_json(document["baseline"]["model"]).has_value());
  RC_ASSERT(model_from_json(document["extended_model"]).has_value());
}

RC_GTEST_PROP(AnalysisJson, AnAnalysisThatWasChangedIsRefused, ()) {
  Json document = to_json(generate::analysis(), kMaking);
  document["recordings"][0]["samples"] = 77777777;
  RC_ASSERT(analysis_from_json(document).error().code == "result_changed");
}

RC_GTEST_PROP(AnalysisJson, AFigureThatIsNotFiniteIsNull, ()) {
  Analysis analysis = generate::analysis();
  analysis.simulation.rmse = std::numeric_limits<double>::infinity();
  analysis.simulation.fit_percent = std::numeric_limits<double>::quiet_NaN();
  const Json document = to_json(analysis, kMaking);
  RC_ASSERT(document["simulation"]["rmse"].is_null());
  RC_ASSERT(document["simulation"]["fit_percent"].is_null());
  RC_ASSERT(analysis_from_json(generate::through_text(document)).has_value());
}

TEST(AnalysisJson, AnotherDocumentIsRefused) {
  EXPECT_EQ(analysis_from_json(Json::object()).error().code, "not_an_analysis");
}

TEST(AnalysisJson, EveryBaselineKindHasItsName) {
  for (const BaselineKind kind : {BaselineKind::kReference, BaselineKind::kSelf, BaselineKind::kPaper}) {
    EXPECT_EQ(baseline_kind_from(to_string(kind)), kind);
  }
  EXPECT_EQ(baseline_kind_from("other"), std::nullopt);
}

}  // namespace
}  // namespace valvetriage
