#include <gtest/gtest.h>
#include <zlib.h>
#include <zstd.h>

#include <filesystem>

#include "core/recording/limits.h"
#include "server/wire/sha256.h"
#include "tests/contract/bad_inputs.h"
#include "tests/contract/http_fixture.h"
#include "tests/contract/mat_file.h"

namespace valvetriage {
namespace {

std::string gzip(const std::string& text) {
  z_stream stream{};
  deflateInit2(&stream, 6, Z_DEFLATED, 15 + 16, 8, Z_DEFAULT_STRATEGY);
  std::string out(deflateBound(&stream, text.size()), '\0');
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(text.data()));
  stream.avail_in = static_cast<uInt>(text.size());
  stream.next_out = reinterpret_cast<Bytef*>(out.data());
  stream.avail_out = static_cast<uInt>(out.size());
  deflate(&stream, Z_FINISH);
  out.resize(stream.total_out);
  deflateEnd(&stream);
  return out;
}

std::string zstd(const std::string& text) {
  std::string out(ZSTD_compressBound(text.size()), '\0');
  out.resize(ZSTD_compress(out.data(), out.size(), text.data(), text.size(), 3));
  return out;
}

std::string part(const std::string& boundary, const std::string& file_name, const std::string& content) {
  return "--" + boundary + "\r\nContent-Disposition: form-data; name=\"file\"; filename=\"" + file_name + "\"\r\n\r\n" +
         content + "\r\n";
}

std::string code_of(const RawAnswer& answer) {
  return json_of(answer).value("code", "");
}

constexpr const char* kMultipart = "multipart/form-data; boundary=b1";

TEST(HttpUpload, IsAcceptedWithItsHashItsLabelsAndItsLocation) {
  TestServer server({});
  const std::string csv = good_csv("EFC-1");
  const RawAnswer answer = server.post("/v1/recordings?name=a.csv&stand=stand-3", csv);
  ASSERT_EQ(answer.status, 202) << answer.body;
  const Json recording = json_of(answer);
  EXPECT_EQ(answer.header("Location"), "/v1/recordings/" + recording["id"].get<std::string>());
  EXPECT_EQ(recording["state"], "queued");
  EXPECT_EQ(recording["name"], "a.csv");
  EXPECT_EQ(recording["sha256"], sha256_hex(csv));
  EXPECT_EQ(recording["serial"], "EFC-1");
  EXPECT_EQ(recording["lot"], "lot-1");
  EXPECT_EQ(recording["test"], "step");
  EXPECT_EQ(recording["stand"], "stand-3");
  EXPECT_EQ(server.get(answer.header("Location") + "/raw").body, csv);
}

TEST(HttpUpload, OfAMatFileIsAnalysedInAChildThatMayWriteNothing) {
  TestServer server({.workers = 1});
  const RawAnswer answer = server.post("/v1/recordings?name=a.mat", test::good_mat({}));
  ASSERT_EQ(answer.status, 202) << answer.body;
  const Json recording = server.await(answer.header("Location"));
  EXPECT_EQ(recording["state"], "done") << recording.dump();
}

TEST(HttpUpload, OfAMatFileIsKnownByTheLabelsInsideItFromTheFirstAnswerOn) {
  TestServer server({.workers = 1});
  const std::string mat =
      test::good_mat({{"serial", "EFC-9"}, {"lot", "lot-9"}, {"stand", "stand-3"}, {"test", "step"}});
  const RawAnswer answer = server.post("/v1/recordings?name=a.mat&valve_type=type-1", mat);
  ASSERT_EQ(answer.status, 202) << answer.body;
  const Json recording = json_of(answer);
  EXPECT_EQ(recording["serial"], "EFC-9");
  EXPECT_EQ(recording["lot"], "lot-9");
  EXPECT_EQ(recording["stand"], "stand-3");
  EXPECT_EQ(recording["test"], "step");
  EXPECT_EQ(recording["valve_type"], "type-1");
  EXPECT_EQ(server.await(answer.header("Location"))["state"], "done");
  EXPECT_EQ(json_of(server.get("/v1/submissions?serial=EFC-9"))["items"].size(), 1u);
  EXPECT_EQ(json_of(server.get("/v1/lots/lot-9"))["valves"], 1);
  const RawAnswer again = server.post("/v1/recordings?name=a.mat&valve_type=type-1", mat);
  EXPECT_EQ(again.status, 200);
  EXPECT_EQ(json_of(again)["id"], recording["id"]);
  const RawAnswer contradicted = server.post("/v1/recordings?name=a.mat&serial=EFC-10", mat);
  EXPECT_EQ(contradicted.status, 422);
  EXPECT_EQ(code_of(contradicted), "contradicting_metadata");
  EXPECT_EQ(json_of(contradicted)["file"], "a.mat");
}

TEST(HttpUpload, OfAMatFileIsDrawnLikeTheSameNumbersAsCsv) {
  TestServer server({.workers = 1});
  const Json from_mat = json_of(server.post("/v1/recordings?name=a.mat", test::good_mat({{"serial", "EFC-9"}})));
  const Json from_csv = json_of(server.post("/v1/recordings?name=a.csv", good_csv("EFC-10")));
  for (const char* what : {"input", "measured"}) {
    const Json mat = json_of(server.get(from_mat["links"]["series"].get<std::string>() + "?what=" + what));
    const Json csv = json_of(server.get(from_csv["links"]["series"].get<std::string>() + "?what=" + what));
    EXPECT_EQ(mat["unit"], csv["unit"]);
    EXPECT_EQ(mat["time_s"], csv["time_s"]) << what;
    ASSERT_EQ(mat["values"].size(), csv["values"].size());
    for (std::size_t i = 0; i < mat["values"].size(); ++i) {
      EXPECT_NEAR(mat["values"][i].get<double>(), csv["values"][i].get<double>(), 0.0005);  // its CSV has three digits
    }
  }
  EXPECT_EQ(server.get(from_mat["links"]["marks"].get<std::string>()).status, 200);
}

TEST(HttpUpload, OfADamagedMatFileIsAcceptedWithoutLabelsAndRejectedByItsJob) {
  TestServer server({.workers = 1});
  const std::string mat = test::good_mat({{"serial", "EFC-9"}});
  const RawAnswer answer = server.post("/v1/recordings?name=a.mat", mat.substr(0, mat.size() / 2));
  ASSERT_EQ(answer.status, 202);
  EXPECT_TRUE(json_of(answer)["serial"].is_null());
  EXPECT_EQ(server.await(answer.header("Location"))["state"], "rejected");
}

TEST(HttpUpload, OfJsonIsKnownByItsLabelsAlsoWhereTheyStandBehindTheColumns) {
  TestServer server({});
  Json columns{{"time_s", Json::array()}, {"current_A", Json::array()}, {"pressure_psi", Json::array()}};
  for (int i = 0; i < 100; ++i) {
    columns["time_s"].push_back(0.005 * i);
    columns["current_A"].push_back(i < 50 ? 1.2 : 1.4);
    columns["pressure_psi"].push_back(20 + i % 7);
  }
  const Json recording{{"columns", columns}, {"metadata", {{"serial", "EFC-9"}, {"lot", "lot-9"}}}};
  const Json accepted = json_of(server.post("/v1/recordings?name=a.json", recording.dump()));
  EXPECT_EQ(accepted["serial"], "EFC-9");
  EXPECT_EQ(accepted["lot"], "lot-9");
}

TEST(HttpUpload, OfTheSameBytesForTheSameLotAndSerialIsTheFirstRecording) {
  TestServer server({});
  const Json first = json_of(server.post("/v1/recordings", good_csv("EFC-1")));
  const RawAnswer again = server.post("/v1/recordings", good_csv("EFC-1"));
  EXPECT_EQ(again.status, 200);
  EXPECT_EQ(json_of(again)["id"], first["id"]);
  EXPECT_EQ(server.post("/v1/recordings", good_csv("EFC-2")).status, 202);
}

/// A recording whose columns nobody has named yet, sent and rejected.
class OtherColumns : public testing::Test {
 protected:
  OtherColumns() {
    csv_.replace(csv_.find("time_s,current_A,pressure_psi"), 29, "t_s,u,y");
    self_ = "/v1/recordings/" + json_of(server_.post("/v1/recordings?name=a.csv", csv_))["id"].get<std::string>();
    EXPECT_EQ(server_.await(self_)["state"], "rejected");
  }

  static constexpr const char* kNamed = "columns=time%3Dt_s,input%3Du,output%3Dy";
  TestServer server_{{.workers = 1}};
  std::string csv_ = good_csv("EFC-1"), self_;
};

TEST_F(OtherColumns, AreReadWhereTheRecordingIsSentAgainWithTheirNames) {
  const RawAnswer again = server_.post(std::string("/v1/recordings?name=a.csv&") + kNamed, csv_);
  EXPECT_EQ(again.status, 200) << again.body;
  EXPECT_EQ("/v1/recordings/" + json_of(again)["id"].get<std::string>(), self_);
  EXPECT_EQ(server_.await(self_)["state"], "done");
}

TEST_F(OtherColumns, AreReadWhereTheyAreAskedForAndRememberedFromThenOn) {
  EXPECT_EQ(server_.post(self_ + "/reanalyze?columns=t_s", "").status, 422);
  EXPECT_EQ(server_.post(self_ + "/reanalyze?" + kNamed, "").status, 202);
  EXPECT_EQ(server_.await(self_)["state"], "done");
  EXPECT_EQ(server_.get(self_ + "/series?what=measured").status, 200);
  const Json wrong = json_of(server_.post(self_ + "/reanalyze?columns=time%3Dt_s,input%3Dno_such,output%3Dy", ""));
  EXPECT_EQ(server_.await("/v1/jobs/" + wrong["id"].get<std::string>())["state"], "rejected");
  EXPECT_EQ(server_.get(self_ + "/series?what=measured").status, 200) << "what is shown was read otherwise";
  const Json again = json_of(server_.post(self_ + "/reanalyze", ""));
  EXPECT_EQ(server_.await("/v1/jobs/" + again["id"].get<std::string>())["state"], "done");
}

TEST(HttpUpload, ToAServerWhoseFolderIsGoneIsTheServersFault) {
  TestServer server({});
  std::filesystem::remove_all(server.folder() + "/incoming");
  const RawAnswer refused = server.post("/v1/recordings?name=a.csv", good_csv("EFC-1"));
  EXPECT_EQ(refused.status, 500);
  EXPECT_EQ(refused.body.find(server.folder()), std::string::npos) << "nobody outside is told of paths";
}

TEST(HttpUpload, WhoseStoredBytesWereCutShortIsNotGivenOutAsIfItWereWhole) {
  TestServer server({});
  const Json stored = json_of(server.post("/v1/recordings?name=a.csv", good_csv("EFC-1")));
  const std::string sha256 = stored["sha256"];
  const std::string blob = server.folder() + "/blobs/" + sha256.substr(0, 2) + "/" + sha256;
  std::filesystem::permissions(blob, std::filesystem::perms::owner_write, std::filesystem::perm_options::add);
  std::filesystem::resize_file(blob, 100);
  const RawAnswer refused = server.get("/v1/recordings/" + stored["id"].get<std::string>() + "/raw");
  EXPECT_EQ(refused.status, 500);
  EXPECT_EQ(json_of(refused)["code"], "blob_damaged");
}

TEST(HttpUpload, WithoutASerialIsNeverADuplicate) {
  TestServer server({});
  const std::string csv = good_csv("").substr(good_csv("").find("time_s"));
  const Json first = json_of(server.post("/v1/recordings", csv));
  const RawAnswer again = server.post("/v1/recordings", csv);
  EXPECT_EQ(again.status, 202);
  EXPECT_NE(json_of(again)["id"], first["id"]);
}

TEST(HttpUpload, RepeatedUnderItsIdempotencyKeyIsAnsweredAsTheFirstTime) {
  TestServer server({});
  const Headers key{{"Idempotency-Key", "k-1"}};
  const RawAnswer first = server.post("/v1/recordings", good_csv("EFC-1"), key);
  const RawAnswer again = server.post("/v1/recordings", good_csv("EFC-1"), key);
  EXPECT_EQ(first.status, 202);
  EXPECT_EQ(first.header("Idempotency-Replayed"), "");
  EXPECT_EQ(again.status, 202);
  EXPECT_EQ(again.header("Idempotency-Replayed"), "true");
  EXPECT_EQ(json_of(again)["id"], json_of(first)["id"]);
  const RawAnswer other = server.post("/v1/recordings", good_csv("EFC-9"), key);
  EXPECT_EQ(other.status, 422);
  EXPECT_EQ(code_of(other), "idempotency_conflict");
}

TEST(HttpUpload, MayBeCompressedByEncodingOrByName) {
  TestServer server({});
  const std::string csv = good_csv("EFC-1"), hash = sha256_hex(csv);
  EXPECT_EQ(json_of(server.post("/v1/recordings?lot=lot-1", gzip(csv), {{"Content-Encoding", "gzip"}}))["sha256"],
            hash);
  EXPECT_EQ(json_of(server.post("/v1/recordings", zstd(csv), {{"Content-Encoding", "zstd"}}))["sha256"], hash);
  const std::string other = good_csv("EFC-2");
  const Json by_name = json_of(server.post("/v1/recordings?name=a.csv.gz", gzip(other)));
  EXPECT_EQ(by_name["sha256"], sha256_hex(other));
  EXPECT_EQ(by_name["name"], "a.csv");
  // Whatever the file is called, and whatever it says of itself: the bytes tell.
  const std::string third = good_csv("EFC-3");
  const Json by_bytes = json_of(server.post("/v1/recordings?name=a.csv", gzip(third)));
  EXPECT_EQ(by_bytes["sha256"], sha256_hex(third));
  EXPECT_EQ(by_bytes["serial"], "EFC-3");
  const Json shouted = json_of(server.post("/v1/recordings?name=A.CSV.ZST", zstd(good_csv("EFC-4"))));
  EXPECT_EQ(shouted["serial"], "EFC-4");
  EXPECT_EQ(shouted["name"], "A.CSV");
  const Json twice =
      json_of(server.post("/v1/recordings?name=a.csv.gz", gzip(good_csv("EFC-5")), {{"Content-Encoding", "gzip"}}));
  EXPECT_EQ(twice["serial"], "EFC-5");
  const RawAnswer unknown = server.post("/v1/recordings", csv, {{"Content-Encoding", "br"}});
  EXPECT_EQ(unknown.status, 415);
  EXPECT_EQ(code_of(unknown), "unsupported_encoding");
}

TEST(HttpUpload, OfSeveralFilesIsOneSubmission) {
  TestServer server({});
  const std::string second = good_csv("EFC-1") + "2.0000,1.4,30\n";
  const std::string body =
      part("b1", "C:\\stand\\a.csv", good_csv("EFC-1")) + part("b1", "b.csv.gz", gzip(second)) + "--b1--";
  const RawAnswer answer = server.post("/v1/submissions", body, {{"Content-Type", kMultipart}});
  ASSERT_EQ(answer.status, 202) << answer.body;
  const Json submission = json_of(answer);
  ASSERT_EQ(submission["recordings"].size(), 2u);
  EXPECT_EQ(submission["recordings"][0]["name"], "a.csv");
  EXPECT_EQ(submission["recordings"][1]["name"], "b.csv");
  EXPECT_EQ(submission["recordings"][1]["sha256"], sha256_hex(second));
  const std::string self = answer.header("Location");
  EXPECT_EQ(code_of(server.get(self + "/raw")), "recording_needed");
  EXPECT_EQ(server.get(self + "/raw?recording=" + submission["recordings"][1]["id"].get<std::string>()).body, second);
}

TEST(HttpUpload, OfFilesThatContradictEachOtherOrTheQueryIsRefused) {
  TestServer server({});
  const std::string body =
      part("b1", "a.csv", good_csv("EFC-1")) + part("b1", "b.csv", good_csv("EFC-2")) + "--b1--\r\n";
  const RawAnswer mixed = server.post("/v1/submissions", body, {{"Content-Type", kMultipart}});
  EXPECT_EQ(mixed.status, 422);
  EXPECT_EQ(code_of(mixed), "contradicting_metadata");
  const RawAnswer query = server.post("/v1/recordings?serial=EFC-9", good_csv("EFC-1"));
  EXPECT_EQ(query.status, 422);
  EXPECT_EQ(json_of(query)["field"], "serial");
  EXPECT_EQ(json_of(query)["found"], "EFC-1");
}

TEST(HttpUpload, ThatIsNoMultipartWhereItSaysSoIsRefused) {
  TestServer server({});
  const std::string good = part("b1", "a.csv", good_csv("EFC-1"));
  const std::vector<std::pair<std::string, std::string>> bodies{
      {"no boundary in it", "malformed_multipart"},
      {good, "malformed_multipart"},  // never ends
      {"--b1--\r\n", "no_files"},
      {"--b1\r\nContent-Disposition: form-data; name=\"other\"\r\n\r\nx\r\n--b1--\r\n", "malformed_multipart"},
      {"--b1\r\nX: " + std::string(20'000, 'x') + "\r\n\r\nx\r\n--b1--\r\n", "malformed_multipart"},
      {good + part("b1", "b.csv", good_csv("EFC-1")) + "--b1--\r\n", "too_many_files"}};
  for (const auto& [body, code] : bodies) {
    EXPECT_EQ(code_of(server.post("/v1/recordings", body, {{"Content-Type", kMultipart}})), code) << body.substr(0, 80);
  }
  EXPECT_EQ(server.post("/v1/recordings", good, {{"Content-Type", "multipart/form-data"}}).status, 415);
}

TEST(HttpUpload, OfMoreThanTheBoundIsRefusedHoweverItIsSent) {
  TestServer server({});
  const std::string bomb = gzip(std::string(kMaxExpandedBytes + 1, '1'));
  const RawAnswer refused = server.post("/v1/recordings", bomb, {{"Content-Encoding", "gzip"}});
  EXPECT_EQ(refused.status, 413);
  EXPECT_EQ(code_of(refused), "too_large");

  std::string chunked =
      "POST /v1/recordings HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\nTransfer-Encoding: chunked\r\n\r\n";
  const std::string piece(std::size_t{1} << 20, '1');
  for (std::size_t sent = 0; sent <= kMaxExpandedBytes; sent += piece.size()) chunked += "100000\r\n" + piece + "\r\n";
  const RawAnswer cut = send_raw(server.port(), chunked + "0\r\n\r\n");
  EXPECT_EQ(cut.status, 413);
  EXPECT_EQ(server.post("/v1/recordings", good_csv("EFC-1")).status, 202);
}

TEST(HttpUpload, BeyondTheQueuesBoundIsTurnedAwayUntilThereIsRoom) {
  TestServer::Options options;
  options.limits.max_queued_jobs = 2;
  TestServer server(options);
  EXPECT_EQ(server.post("/v1/recordings", good_csv("EFC-1")).status, 202);
  const Json second = json_of(server.post("/v1/recordings", good_csv("EFC-2")));
  const RawAnswer refused = server.post("/v1/recordings", good_csv("EFC-3"));
  EXPECT_EQ(refused.status, 503);
  EXPECT_EQ(code_of(refused), "overloaded");
  EXPECT_GE(std::stoi(refused.header("Retry-After")), 1);
  EXPECT_EQ(server.post("/v1/jobs/" + second["job_id"].get<std::string>() + "/cancel", "").status, 200);
  EXPECT_EQ(server.post("/v1/recordings", good_csv("EFC-3")).status, 202);
}

TEST(HttpUpload, IsAnalysedAndItsResultIsFoundEverywhere) {
  TestServer server({.tokens_required = false, .workers = 1, .limits = {}});
  const RawAnswer accepted = server.post("/v1/recordings?name=a.csv", good_csv("EFC-1"));
  ASSERT_EQ(accepted.status, 202);
  const std::string self = accepted.header("Location");
  const Json done = server.await(self);
  EXPECT_EQ(done["state"], "done") << done.dump(1);
  EXPECT_EQ(done["verdict"], "Good");
  EXPECT_EQ(json_of(server.get(self + "/analysis"))["schema"], "valvetriage.analysis/1");
  EXPECT_EQ(json_of(server.get(self + "/analyses"))["items"].size(), 1u);
  EXPECT_EQ(json_of(server.get("/v1/recordings?verdict=Good&lot=lot-1"))["items"].size(), 1u);
  EXPECT_EQ(json_of(server.get("/v1/recordings?verdict=Severe"))["items"].size(), 0u);
  const RawAnswer analysis = server.get(self + "/analysis");
  const std::string tag = analysis.header("ETag");
  for (const std::string& held : {tag, "W/" + tag, "\"other\", " + tag, std::string("*")}) {
    const RawAnswer unchanged = server.get(self + "/analysis", {{"If-None-Match", held}});
    EXPECT_EQ(unchanged.status, 304) << held;
    EXPECT_EQ(unchanged.body, "") << held;
  }
  EXPECT_EQ(server.get(self + "/analysis", {{"If-None-Match", "\"other\""}}).status, 200);
  EXPECT_EQ(json_of(server.get("/v1/lots/lot-1"))["verdicts"]["Good"], 1);
  EXPECT_EQ(json_of(server.get("/v1/lots/lot-1/history"))["valves"].size(), 1u);
  EXPECT_EQ(json_of(server.get("/v1/valves/EFC-1"))["submissions"].size(), 1u);
  const Json series = json_of(server.get(self + "/series?what=measured&points=50"));
  EXPECT_EQ(series["samples"], 400);
  EXPECT_LE(series["values"].size(), 50u);

  const RawAnswer again = server.post(self + "/reanalyze", "");
  EXPECT_EQ(again.status, 202);
  EXPECT_EQ(server.await(again.header("Location"))["state"], "done");
  EXPECT_EQ(json_of(server.get(self + "/analyses"))["items"].size(), 2u);
}

TEST(HttpUpload, OfBadInputIsRejectedWithItsPositionAndAGoodOneFollows) {
  TestServer server({.tokens_required = false, .workers = 1, .limits = {}});
  int serial = 0;
  for (const BadInput& bad : bad_inputs()) {
    SCOPED_TRACE(bad.name);
    const RawAnswer answer = server.post("/v1/recordings?name=" + bad.name + ".csv", bad.text);
    Json problem = json_of(answer);
    if (answer.status == 202) {
      const Json rejected = server.await(answer.header("Location"));
      EXPECT_EQ(rejected["state"], "rejected");
      problem = rejected["error"];
    } else {
      EXPECT_EQ(answer.status, 422);
      EXPECT_EQ(answer.header("Content-Type"), "application/problem+json");
    }
    ASSERT_TRUE(problem.is_object());
    EXPECT_EQ(problem["code"], bad.code) << problem.dump();
    if (bad.line) {
      EXPECT_EQ(problem.value("line", 0u), *bad.line) << problem.dump();
    }
    if (bad.column) {
      EXPECT_EQ(problem.value("column", 0u), *bad.column) << problem.dump();
    }
    const RawAnswer good = server.post("/v1/recordings", good_csv("EFC-" + std::to_string(++serial)));
    ASSERT_EQ(good.status, 202);
    EXPECT_EQ(server.await(good.header("Location"))["state"], "done");
  }
}

}  // namespace
}  // namespace valvetriage
