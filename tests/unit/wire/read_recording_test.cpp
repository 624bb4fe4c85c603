#include "server/wire/read_recording.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <matio.h>
#include <unistd.h>
#include <zlib.h>
#include <zstd.h>

#include <filesystem>
#include <fstream>
#include <ostream>

#include "core/recording/limits.h"
#include "server/wire/sha256.h"

namespace valvetriage {
namespace {

std::string csv_text(std::size_t rows = 60) {
  std::string text = "# serial: 7\ntime_s,current_A,pressure_psi\n";
  for (std::size_t i = 0; i < rows; ++i)
    text += fmt::format("{},{},{}\n", 0.005 * static_cast<double>(i), i < 20 ? 1.0 : 1.2, (i * 7) % 13);
  return text;
}

std::string json_text() {
  std::string time, current, pressure;
  for (int i = 0; i < 60; ++i) {
    time += fmt::format("{}{}", i > 0 ? "," : "", 5 * i);
    current += fmt::format("{}{}", i > 0 ? "," : "", i < 20 ? 1000 : 1200);
    pressure += fmt::format("{}{}", i > 0 ? ", " : "", (i * 7) % 13);
  }
  return fmt::format(R"({{"metadata": {{"serial": "7", "hours": 4120, "lot": null}},
 "columns": {{"time_ms": [{}], "note": ["a", true, null], "current_mA": [{}], "pressure_psi": [{}]}}}})",
                     time, current, pressure);
}

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

Result<ReadRecording> read(const std::string& bytes, ReadOptions options = {}) {
  if (options.name.empty()) options.name = "valve";
  return read_recording_memory(bytes, options);
}

class TemporaryFile {
 public:
  TemporaryFile()
      : path_(std::filesystem::temp_directory_path() / fmt::format("valvetriage-{}-{}", ::getpid(), ++count)) {}
  ~TemporaryFile() { std::filesystem::remove(path_); }
  std::string path() const { return path_.string(); }
  std::string bytes() const {
    std::ifstream file(path_, std::ios::binary);
    return {std::istreambuf_iterator<char>(file), {}};
  }

 private:
  static inline int count = 0;
  std::filesystem::path path_;
};

TEST(ReadRecording, TellsTheFormatByTheBytesAndHashesThemExpanded) {
  const std::string text = csv_text();
  for (const std::string& bytes : {text, gzip(text), zstd(text)}) {
    const auto read_back = read(bytes);
    ASSERT_TRUE(read_back) << read_back.error().message;
    EXPECT_EQ(read_back->sha256, sha256_hex(text));
    EXPECT_EQ(read_back->expanded_bytes, text.size());
    EXPECT_EQ(read_back->recording.samples(), 60u);
    EXPECT_EQ(*read_back->recording.metadata.serial, "7");
  }
  EXPECT_EQ(format_of("\xEF\xBB\xBF \n{"), RecordingFormat::kJson);
  EXPECT_EQ(format_of("# {"), RecordingFormat::kCsv);
  EXPECT_EQ(format_of(""), RecordingFormat::kCsv);
}

TEST(ReadRecording, ReadsFilesDescriptorsAndPipesAlike) {
  const TemporaryFile file;
  std::ofstream(file.path()) << csv_text();
  const auto of_file = read_recording_file(file.path(), {});
  ASSERT_TRUE(of_file);
  EXPECT_EQ(of_file->recording.name, std::filesystem::path(file.path()).filename());

  int ends[2];
  ASSERT_EQ(::pipe(ends), 0);
  const std::string text = csv_text();
  ASSERT_EQ(::write(ends[1], text.data(), text.size()), static_cast<ssize_t>(text.size()));
  ::close(ends[1]);
  const auto of_pipe = read_recording_descriptor(ends[0], {});
  ::close(ends[0]);
  ASSERT_TRUE(of_pipe);
  EXPECT_EQ(of_pipe->sha256, of_file->sha256);
  EXPECT_EQ(of_pipe->recording.output.values, of_file->recording.output.values);
}

TEST(ReadRecording, SaysWhatItCannotOpen) {
  EXPECT_EQ(read_recording_file("/nonexistent/valve.csv", {}).error().code, "cannot_read");
  EXPECT_EQ(read_recording_file("/nonexistent/valve.csv", {}).error().file, "valve.csv");
  EXPECT_EQ(read_recording_file("/", {}).error().code, "cannot_read");
}

TEST(ReadRecording, AddsMetadataOptionsAndRefusesContradictions) {
  EXPECT_EQ(*read(csv_text(), {.metadata = {.lot = "L"}})->recording.metadata.lot, "L");
  const auto contradiction = read(csv_text(), {.name = "a.csv", .metadata = {.serial = "8"}});
  ASSERT_FALSE(contradiction);
  EXPECT_EQ(contradiction.error().code, "contradicting_metadata");
  EXPECT_EQ(contradiction.error().file, "a.csv");
}

TEST(ReadRecording, BoundsTheExpandedBytes) {
  const std::string text = csv_text();
  EXPECT_TRUE(read(gzip(text), {.max_expanded_bytes = text.size()}));
  EXPECT_EQ(read(gzip(text), {.max_expanded_bytes = text.size() - 1}).error().code, "too_large");
  EXPECT_EQ(read(gzip(std::string(100'000'000, '\n')), {.max_expanded_bytes = 10'000'000}).error().code, "too_large");
}

TEST(ReadRecording, RefusesDamagedAndTruncatedCompression) {
  for (const std::string& whole : {gzip(csv_text()), zstd(csv_text())}) {
    EXPECT_EQ(read(whole.substr(0, whole.size() / 2)).error().code, "malformed_encoding");
    EXPECT_EQ(read(whole.substr(0, whole.size() - 1)).error().code, "malformed_encoding");
  }
}

TEST(JsonRecording, ReadsTheContractsForm) {
  const auto from_json = read(json_text());
  ASSERT_TRUE(from_json) << from_json.error().message;
  const Recording& recording = from_json->recording;
  EXPECT_EQ(*recording.metadata.serial, "7");
  EXPECT_EQ(*recording.metadata.hours, "4120");
  EXPECT_FALSE(recording.metadata.lot);
  const Recording from_csv = read(csv_text())->recording;
  EXPECT_EQ(recording.output.values, from_csv.output.values);
  for (std::size_t i = 0; i < 60; ++i) EXPECT_DOUBLE_EQ(recording.input.values[i], from_csv.input.values[i]);
}

TEST(JsonRecording, ReadsAnObjectMetadataAfterTheColumnsToo) {
  const auto swapped =
      read(R"({"columns": {"current_A": [1,)" + std::string("2]}, \"metadata\": {\"test\": \"jump\"}}"));
  EXPECT_EQ(swapped.error().code, "bad_metadata");
  EXPECT_EQ(swapped.error().field, "/metadata/test");
}

struct BadJson {
  const char* text;
  const char* code;
  const char* field;

  friend void PrintTo(const BadJson& bad, std::ostream* out) { *out << bad.code; }
};

class JsonRecordingRefuses : public testing::TestWithParam<BadJson> {};

TEST_P(JsonRecordingRefuses, WithAPointerToWhatIsWrong) {
  const auto result = read(GetParam().text);
  ASSERT_FALSE(result);
  EXPECT_EQ(result.error().code, GetParam().code) << result.error().message;
  EXPECT_EQ(result.error().field, GetParam().field);
  EXPECT_FALSE(result.error().expected.empty());
}

INSTANTIATE_TEST_SUITE_P(
    Texts, JsonRecordingRefuses,
    testing::Values(BadJson{"{\"columns\": {\"time_s\": [0,\n 1, \"x\"]}}", "not_a_number", "/columns/time_s/2"},
                    BadJson{"{\"columns\": {\"time_s\": [null]}}", "not_a_number", "/columns/time_s/0"},
                    BadJson{"{\"columns\": {\"time_s\": [1e999]}}", "not_finite", "/columns/time_s/0"},
                    BadJson{"{\"columns\": {\"time_s\": [NaN]}}", "not_finite", "/columns/time_s/0"},
                    BadJson{"{\"columns\": {\"time_s\": [[1]]}}", "malformed_recording", "/columns/time_s/0"},
                    BadJson{"{\"columns\": {\"time_s\": 1}}", "malformed_recording", "/columns/time_s"},
                    BadJson{"{\"columns\": {\"a/b~\": [0], \"a/b~\": [0]}}", "duplicate_column", "/columns/a~1b~0"},
                    BadJson{"{\"columns\": {}, \"columns\": {}}", "duplicate_key", "/columns"},
                    BadJson{"{\"rows\": {}}", "unknown_key", "/rows"},
                    BadJson{"{\"metadata\": {}}", "missing_column", "/columns"},
                    BadJson{"[1]", "malformed_recording", ""}, BadJson{"{\"columns\": {", "malformed_json", "/columns"},
                    BadJson{"{\"metadata\": {\"serial\": {}}}", "bad_metadata", "/metadata/serial"},
                    BadJson{"{\"columns\": {\"time_s\": [0,1], \"current_A\": [1], \"pressure_psi\": [1,2]}}",
                            "ragged_columns", "/columns/current_A"},
                    BadJson{"{\"columns\": {\"time_s\": [0,1,1], \"current_A\": [1,1,1], \"pressure_psi\": [1,2,3]}}",
                            "time_not_increasing", "/columns/time_s/2"}));

TEST(JsonRecording, SaysLineAndColumn) {
  const auto bad = read("{\"columns\": {\"time_s\": [0,\n 1, \"x\"]}}");
  EXPECT_EQ(bad.error().line, 2u);
  EXPECT_EQ(bad.error().file, "valve");
}

TEST(JsonRecording, DoesNotRecurseIntoADeepDocument) {
  EXPECT_EQ(read("{\"columns\": {\"x\": " + std::string(1'000'000, '[')).error().code, "malformed_recording");
}

/// A MAT file with `rows` values of each kind of number.
std::string mat_bytes(mat_ft version, std::size_t rows, bool is_complex = false) {
  const TemporaryFile file;
  mat_t* mat = Mat_CreateVer(file.path().c_str(), nullptr, version);
  if (mat == nullptr) return "";
  std::vector<double> time(rows), imaginary(rows);
  std::vector<float> pressure(rows);
  std::vector<std::int16_t> current(rows);
  for (std::size_t i = 0; i < rows; ++i) {
    time[i] = 0.005 * static_cast<double>(i);
    current[i] = static_cast<std::int16_t>(i < 20 ? 1000 : 1200);
    pressure[i] = static_cast<float>((i * 7) % 13);
  }
  std::size_t column[2] = {rows, 1}, row[2] = {1, rows}, text[2] = {1, 3};
  mat_complex_split_t split{time.data(), imaginary.data()};
  char serial[] = "S-7";
  matvar_t* variables[] = {is_complex
                               ? Mat_VarCreate("time_s", MAT_C_DOUBLE, MAT_T_DOUBLE, 2, column, &split, MAT_F_COMPLEX)
                               : Mat_VarCreate("time_s", MAT_C_DOUBLE, MAT_T_DOUBLE, 2, column, time.data(), 0),
                           Mat_VarCreate("current_mA", MAT_C_INT16, MAT_T_INT16, 2, row, current.data(), 0),
                           Mat_VarCreate("pressure_psi", MAT_C_SINGLE, MAT_T_SINGLE, 2, column, pressure.data(), 0),
                           Mat_VarCreate("serial", MAT_C_CHAR, MAT_T_UINT8, 2, text, serial, 0)};
  for (matvar_t* variable : variables) {
    Mat_VarWrite(mat, variable, MAT_COMPRESSION_ZLIB);
    Mat_VarFree(variable);
  }
  Mat_Close(mat);
  return file.bytes();
}

TEST(MatRecording, ReadsRealVectorsOfAnyNumberTypeAndTextAsMetadata) {
  const auto from_mat = read(mat_bytes(MAT_FT_MAT5, 60), {.allow_mat = true});
  ASSERT_TRUE(from_mat) << from_mat.error().message;
  EXPECT_EQ(*from_mat->recording.metadata.serial, "S-7");
  EXPECT_DOUBLE_EQ(from_mat->recording.input.values[30], 1.2);
  EXPECT_EQ(from_mat->recording.output.values, read(csv_text())->recording.output.values);
}

TEST(MatRecording, IsRefusedWhereTheProcessIsNotTheReadersOwn) {
  EXPECT_EQ(read(mat_bytes(MAT_FT_MAT5, 60)).error().code, "mat_not_allowed");
}

TEST(MatRecording, RefusesOtherVersionsAndOtherKindsOfVariables) {
  const ReadOptions options{.allow_mat = true};
  EXPECT_EQ(read("\x89HDF\r\n\x1a\n" + std::string(2000, '\0'), options).error().code, "mat_version");
  EXPECT_EQ(read("MATLAB 7.3 MAT-file" + std::string(2000, ' '), options).error().code, "mat_version");
  EXPECT_EQ(read(mat_bytes(MAT_FT_MAT5, 60, true), options).error().code, "not_a_number");
  EXPECT_EQ(read(mat_bytes(MAT_FT_MAT5, kMinSamples - 1), options).error().code, "too_few_samples");
  const std::string whole = mat_bytes(MAT_FT_MAT5, 60);
  for (const std::size_t size : {std::size_t{20}, std::size_t{128}, whole.size() / 2}) {
    EXPECT_FALSE(read(whole.substr(0, size), options)) << size;
  }
}

#ifdef VALVETRIAGE_REAL_DATA
Result<ReadRecording> read_real(const std::string& file, ColumnMapping mapping = {}) {
  return read_recording_file(std::string(VALVETRIAGE_REAL_DATA) + "/" + file, {.mapping = std::move(mapping)});
}

const QualityItem* find_quality(const Recording& recording, const std::string& code) {
  for (const QualityItem& item : recording.quality) {
    if (item.code == code) return &item;
  }
  return nullptr;
}

TEST(RealRecordings, ServovalvePressureGainIsQuantisedAndClipped) {
  const auto read_back = read_real("servovalve/pressure_gain.csv");
  ASSERT_TRUE(read_back) << read_back.error().message;
  const Recording& recording = read_back->recording;
  EXPECT_EQ(recording.samples(), 54900u);
  EXPECT_NEAR(recording.sample_rate_hz(), 100, 1e-6);
  EXPECT_TRUE(recording.has_valve_units());
  EXPECT_EQ(recording.segments.size(), 3u);
  const QualityItem* quantised = find_quality(recording, "quantised");
  ASSERT_NE(quantised, nullptr);
  EXPECT_NE(quantised->detail.find("steps of 100 psi"), std::string::npos) << quantised->detail;  // 6.9 bar
  const QualityItem* clipped = find_quality(recording, "clipped");
  ASSERT_NE(clipped, nullptr);
  EXPECT_NE(clipped->detail.find("-3000 psi"), std::string::npos) << clipped->detail;  // 206.8 bar
  EXPECT_EQ(recording.quality.size(), 2u);
}

TEST(RealRecordings, ServovalveFlowAndLeakageReadWithAMapping) {
  const ColumnMapping mapping{.time = "time_s", .input = "current_mA", .output = "flow_lpm", .side = {}};
  for (const char* file : {"flow_gain", "leakage_period_020", "leakage_period_050", "leakage_period_100",
                           "leakage_period_200", "leakage_period_500"}) {
    const auto read_back = read_real(fmt::format("servovalve/{}.csv", file), mapping);
    ASSERT_TRUE(read_back) << read_back.error().message;
    EXPECT_EQ(read_back->recording.test, TestKind::kTriangle) << file;
    EXPECT_EQ(read_back->recording.output.unit, "");
    EXPECT_EQ(read_back->recording.input.unit, "A");
    EXPECT_EQ(find_quality(read_back->recording, "feedback"), nullptr);
  }
  EXPECT_EQ(read_real("servovalve/flow_gain.csv").error().code, "missing_column");
}

TEST(RealRecordings, TanksAndArmReadWithAMapping) {
  const ColumnMapping mapping{.time = "t_s", .input = "u", .output = "y", .side = {}};
  for (const char* file : {"cascaded_tanks/estimation.csv", "cascaded_tanks/validation.csv"}) {
    const auto tanks = read_real(file, mapping);
    ASSERT_TRUE(tanks) << tanks.error().message;
    EXPECT_EQ(tanks->recording.sample_rate_hz(), 0.25);
    EXPECT_NE(find_quality(tanks->recording, "clipped"), nullptr);  // the overflow at 10 V
    EXPECT_EQ(tanks->recording.quality.size(), 1u);
  }
  const auto arm = read_real("robot_arm/robot_arm.csv", mapping);
  ASSERT_TRUE(arm);
  EXPECT_EQ(arm->recording.samples(), 1024u);
  EXPECT_TRUE(arm->recording.quality.empty());
}
#endif

}  // namespace
}  // namespace valvetriage
