-- The first schema. Times are milliseconds since 1970, UTC, except where a column says steady.
-- States: queued running done failed rejected poisoned cancelled.

-- The recordings of one valve that are analysed together. The summary columns repeat its newest analysis, so that no list
-- opens a body. content_key: what makes two submissions the same; absent without a serial.
CREATE TABLE submissions (
  seq INTEGER PRIMARY KEY,
  id TEXT NOT NULL UNIQUE,
  job_id TEXT NOT NULL,
  state TEXT NOT NULL,
  received_at INTEGER NOT NULL,
  lot TEXT,
  serial TEXT,
  valve_type TEXT,
  condition TEXT,
  stand TEXT,
  recordings INTEGER NOT NULL,
  content_key TEXT UNIQUE,
  verdict TEXT,
  reason TEXT,
  action TEXT,
  conclusion TEXT,
  top_cause TEXT,
  top_cause_probability REAL,
  errors TEXT NOT NULL DEFAULT '[]',
  problem TEXT
) STRICT;
CREATE INDEX submissions_by_time ON submissions (received_at);
CREATE INDEX submissions_by_lot ON submissions (lot, received_at);
CREATE INDEX submissions_by_serial ON submissions (serial, received_at);
CREATE INDEX submissions_by_valve_type ON submissions (valve_type, received_at);
CREATE INDEX submissions_by_stand ON submissions (stand, received_at);
CREATE INDEX submissions_by_verdict ON submissions (verdict, received_at);
CREATE INDEX submissions_by_cause ON submissions (top_cause, received_at);

-- One stored file. same_key: set for the first recording of these bytes, lot and serial; absent without a serial.
CREATE TABLE recordings (
  seq INTEGER PRIMARY KEY,
  id TEXT NOT NULL UNIQUE,
  submission_seq INTEGER NOT NULL REFERENCES submissions (seq),
  name TEXT NOT NULL,
  sha256 TEXT NOT NULL,
  size_bytes INTEGER NOT NULL,
  test TEXT,
  metadata TEXT NOT NULL,
  same_key TEXT UNIQUE
) STRICT;
CREATE INDEX recordings_by_submission ON recordings (submission_seq);
CREATE INDEX recordings_by_sha256 ON recordings (sha256);

-- not_before and lease_until are steady milliseconds, which start again with the machine: a server that starts resets them.
-- fence grows with every start of the job; only the holder of the newest may finish it.
CREATE TABLE jobs (
  seq INTEGER PRIMARY KEY,
  id TEXT NOT NULL UNIQUE,
  submission_seq INTEGER NOT NULL REFERENCES submissions (seq),
  state TEXT NOT NULL,
  created_at INTEGER NOT NULL,
  started_at INTEGER,
  finished_at INTEGER,
  not_before INTEGER NOT NULL,
  attempt INTEGER NOT NULL DEFAULT 0,
  crashes INTEGER NOT NULL DEFAULT 0,
  timeouts INTEGER NOT NULL DEFAULT 0,
  options TEXT NOT NULL,
  progress REAL NOT NULL DEFAULT 0,
  progress_note TEXT NOT NULL DEFAULT '',
  problem TEXT,
  worker TEXT,
  lease_until INTEGER,
  fence INTEGER NOT NULL DEFAULT 0
) STRICT;
CREATE INDEX jobs_waiting ON jobs (not_before, seq) WHERE state = 'queued';
CREATE INDEX jobs_oldest_waiting ON jobs (created_at) WHERE state = 'queued';
CREATE INDEX jobs_leased ON jobs (lease_until) WHERE state = 'running';

-- Jobs by state, kept by triggers so that admission and metrics need not count.
CREATE TABLE job_counts (
  state TEXT PRIMARY KEY,
  jobs INTEGER NOT NULL
) STRICT, WITHOUT ROWID;
CREATE TRIGGER jobs_counted AFTER INSERT ON jobs BEGIN
  INSERT INTO job_counts VALUES (NEW.state, 1) ON CONFLICT (state) DO UPDATE SET jobs = jobs + 1;
END;
CREATE TRIGGER jobs_recounted AFTER UPDATE OF state ON jobs WHEN OLD.state <> NEW.state BEGIN
  UPDATE job_counts SET jobs = jobs - 1 WHERE state = OLD.state;
  INSERT INTO job_counts VALUES (NEW.state, 1) ON CONFLICT (state) DO UPDATE SET jobs = jobs + 1;
END;

-- One result per job at most: job_id is unique. Never changed.
CREATE TABLE analyses (
  seq INTEGER PRIMARY KEY,
  id TEXT NOT NULL UNIQUE,
  submission_seq INTEGER NOT NULL REFERENCES submissions (seq),
  job_id TEXT NOT NULL UNIQUE REFERENCES jobs (id),
  created_at INTEGER NOT NULL,
  engine_version TEXT NOT NULL,
  settings_sha256 TEXT NOT NULL,
  result_sha256 TEXT NOT NULL,
  verdict TEXT,
  reason TEXT,
  action TEXT,
  conclusion TEXT,
  top_cause TEXT,
  top_cause_probability REAL,
  errors TEXT NOT NULL
) STRICT;
CREATE INDEX analyses_by_submission ON analyses (submission_seq);
CREATE TRIGGER analyses_stay BEFORE UPDATE ON analyses BEGIN SELECT RAISE(ABORT, 'an analysis is never changed'); END;

-- The document, zstd. Beside its row, so that lists of analyses read no overflow pages; in the database, so that the result
-- and the end of its job are one transaction and a backup is one file.
CREATE TABLE analysis_bodies (
  analysis_seq INTEGER PRIMARY KEY REFERENCES analyses (seq),
  body BLOB NOT NULL
) STRICT;

-- References and rule bases: kind 0 and 1. The body is zstd.
CREATE TABLE documents (
  seq INTEGER PRIMARY KEY,
  kind INTEGER NOT NULL,
  valve_type TEXT NOT NULL,
  version INTEGER NOT NULL,
  sha256 TEXT NOT NULL,
  created_at INTEGER NOT NULL,
  created_by TEXT NOT NULL,
  body BLOB NOT NULL,
  UNIQUE (kind, valve_type, version)
) STRICT;

CREATE TABLE lots (
  seq INTEGER PRIMARY KEY,
  lot TEXT NOT NULL UNIQUE,
  first_received_at INTEGER NOT NULL,
  last_received_at INTEGER NOT NULL,
  recordings INTEGER NOT NULL,
  submissions INTEGER NOT NULL
) STRICT;

-- The valves of a lot with their newest result. result_seq: the submission it is of, absent while there is none.
CREATE TABLE lot_valves (
  lot TEXT NOT NULL,
  valve TEXT NOT NULL,
  result_seq INTEGER,
  verdict TEXT NOT NULL DEFAULT '',
  cause TEXT NOT NULL DEFAULT '',
  PRIMARY KEY (lot, valve)
) STRICT, WITHOUT ROWID;

-- What a lot's page shows, kept by triggers: its cost does not grow with the lot.
CREATE TABLE lot_counts (
  lot TEXT NOT NULL,
  analysed INTEGER NOT NULL,
  verdict TEXT NOT NULL,
  cause TEXT NOT NULL,
  valves INTEGER NOT NULL,
  PRIMARY KEY (lot, analysed, verdict, cause)
) STRICT, WITHOUT ROWID;
CREATE TRIGGER lot_valves_counted AFTER INSERT ON lot_valves BEGIN
  INSERT INTO lot_counts VALUES (NEW.lot, NEW.result_seq IS NOT NULL, NEW.verdict, NEW.cause, 1)
    ON CONFLICT (lot, analysed, verdict, cause) DO UPDATE SET valves = valves + 1;
END;
CREATE TRIGGER lot_valves_recounted AFTER UPDATE ON lot_valves BEGIN
  UPDATE lot_counts SET valves = valves - 1
    WHERE lot = OLD.lot AND analysed = (OLD.result_seq IS NOT NULL) AND verdict = OLD.verdict AND cause = OLD.cause;
  INSERT INTO lot_counts VALUES (NEW.lot, NEW.result_seq IS NOT NULL, NEW.verdict, NEW.cause, 1)
    ON CONFLICT (lot, analysed, verdict, cause) DO UPDATE SET valves = valves + 1;
END;

CREATE TABLE findings (
  seq INTEGER PRIMARY KEY,
  id TEXT NOT NULL UNIQUE,
  serial TEXT NOT NULL,
  cause TEXT NOT NULL,
  found_by TEXT NOT NULL,
  found_at INTEGER NOT NULL,
  note TEXT NOT NULL,
  created_at INTEGER NOT NULL
) STRICT;
CREATE INDEX findings_by_serial ON findings (serial);

CREATE TABLE tokens (
  seq INTEGER PRIMARY KEY,
  id TEXT NOT NULL UNIQUE,
  name TEXT NOT NULL,
  secret_sha256 TEXT NOT NULL UNIQUE,
  scopes TEXT NOT NULL,
  created_at INTEGER NOT NULL,
  revoked_at INTEGER
) STRICT;

-- recording_id: the answer of an upload of one recording. created: 1 was answered 202, 0 was answered 200.
CREATE TABLE idempotency (
  principal TEXT NOT NULL,
  key TEXT NOT NULL,
  request_sha256 TEXT NOT NULL,
  submission_seq INTEGER NOT NULL REFERENCES submissions (seq),
  recording_id TEXT,
  created INTEGER NOT NULL,
  created_at INTEGER NOT NULL,
  PRIMARY KEY (principal, key)
) STRICT, WITHOUT ROWID;

-- Every change, in the order of its commit. Never changed, never deleted.
CREATE TABLE events (
  cursor INTEGER PRIMARY KEY AUTOINCREMENT,
  at INTEGER NOT NULL,
  kind TEXT NOT NULL,
  subject TEXT NOT NULL,
  actor TEXT NOT NULL,
  detail TEXT NOT NULL
) STRICT;
CREATE TRIGGER events_stay BEFORE UPDATE ON events BEGIN SELECT RAISE(ABORT, 'an event is never changed'); END;
CREATE TRIGGER events_remain BEFORE DELETE ON events BEGIN SELECT RAISE(ABORT, 'an event is never deleted'); END;
