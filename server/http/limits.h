#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>

namespace valvetriage::http {

/// Limits that the HTTP front sets on the outside world, each with its reason. nginx in front sets tighter ones.

/// Bodies and files are read and sent in pieces of this size.
inline constexpr std::size_t kPieceBytes = 64 * 1024;
inline constexpr std::size_t kMaxHeadBytes = 16 * 1024;  ///< a browser behind two proxies sends about 4 kB
inline constexpr std::size_t kMaxHeaders = 100;          ///< a browser sends about 20
inline constexpr std::size_t kMaxChunkLineBytes = 256;   ///< chunk size and extensions; senders use at most 16
inline constexpr std::size_t kMaxTrailerBytes = 4 * 1024;

/// Recordings of one submission: one valve's session is six; a whole lot in one folder is a mistake of the caller's.
inline constexpr std::size_t kMaxFilesPerSubmission = 256;
/// JSON documents other than recordings (references with maps, covariances and the tests of
/// their valves are the largest, 1 MB of six tests of 4000 samples, 10 MB of the most samples that are fitted).
inline constexpr std::size_t kMaxDocumentBytes = 16 * 1024 * 1024;
/// Good valves of one reference that is learned here: seconds each while its sender waits, a quarter of an hour. So
/// many tell a spread to 4 %; the verb `reference learn` takes more.
inline constexpr std::size_t kMaxReferenceSubmissions = 300;
inline constexpr std::size_t kMaxMultipartHeaderBytes = 8 * 1024;

/// Connections that hold a socket but no thread while they are idle or still sending a head.
inline constexpr std::size_t kMaxConnections = 1000;
/// A head comes whole in this time, however it drips.
inline constexpr std::chrono::seconds kHeadDeadline{5};
/// Idle time between two requests of one connection.
inline constexpr std::chrono::seconds kIdleDeadline{30};
/// A body may take kBodyGrace plus its bytes at kMinBodyBytesPerSecond: the slowest shop-floor link, not a drip.
inline constexpr std::chrono::seconds kBodyGrace{10};
inline constexpr std::uint64_t kMinBodyBytesPerSecond = 16 * 1024;
/// The same for an answer that a client reads slowly.
inline constexpr std::chrono::seconds kAnswerGrace{10};
/// Unread rest of a refused body that is still taken in so that the client gets to see the answer.
inline constexpr std::size_t kLingerBytes = 64 * 1024 * 1024;
inline constexpr std::chrono::seconds kLingerDeadline{5};
/// Longest wait for an event: shorter than any proxy's patience.
inline constexpr double kMaxEventWaitSeconds = 30;
/// A waiting request looks this often: a person does not notice, the database does not either.
inline constexpr std::chrono::milliseconds kEventInterval{150};
inline constexpr int kListenBacklog = 1024;
/// A server that is told to stop answers what is under way for so long; its jobs are handed back at once.
inline constexpr std::chrono::seconds kStopPatience{20};

/// Points of a series: more than any screen has pixels.
inline constexpr std::size_t kMaxSeriesPoints = 20000;
inline constexpr std::size_t kDefaultSeriesPoints = 2000;
/// Points of a curve on paper; a printed page resolves no more.
inline constexpr std::size_t kReportPoints = 1000;
/// Segments, and places of quality items, that a plot marks: more lines than these would be a grey field.
inline constexpr std::size_t kReportStretches = 200;
inline constexpr std::size_t kMaxMarks = 2000;
/// Newest named valves of a lot whose parameters are shown together: a second's reading.
inline constexpr std::size_t kMaxNamedValves = 1000;
/// Newest valves of a lot whose own fits are held against good valves: a second's reading.
inline constexpr std::size_t kMaxShiftValves = 1000;
/// Newest unexplained valves of a lot whose residuals are laid beside each other: two seconds and 150 MB where there
/// are so many, measured. Of those whose analysis kept no residuals (it is of an earlier version) the newest few are
/// simulated, a tenth of a second each; and good valves beside them.
inline constexpr std::size_t kMaxPatternValves = 3000;
inline constexpr std::size_t kMaxSimulatedValves = 40;
inline constexpr std::size_t kPatternGoodValves = 8;
/// Newest sessions that tell how the stands are doing: some days of a plant.
inline constexpr std::size_t kStandSessions = 2000;
/// Newest teardown findings of the confusion table, each with the reading of one analysis; serials named in a cell.
inline constexpr std::size_t kMaxConfusionFindings = 2000;
inline constexpr std::size_t kMaxCellSerials = 50;
/// Recordings a report draws: a session has six; a hundred would be a book.
inline constexpr std::size_t kMaxReportPlots = 24;
inline constexpr std::size_t kDefaultPageItems = 100;

}  // namespace valvetriage::http
