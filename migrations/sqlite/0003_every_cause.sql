-- Every cause of a result, strongest first, as a JSON array of [cause, probability, settled]: of the newest result, and of
-- each analysis. What is stored already knows its strongest cause alone; it is settled where the result is `named`.
ALTER TABLE submissions ADD COLUMN causes TEXT NOT NULL DEFAULT '[]';
ALTER TABLE analyses ADD COLUMN causes TEXT NOT NULL DEFAULT '[]';
UPDATE submissions SET causes = json_array(json_array(top_cause, coalesce(top_cause_probability, 0), conclusion IS 'named'))
  WHERE top_cause IS NOT NULL;
DROP TRIGGER analyses_stay;
UPDATE analyses SET causes = json_array(json_array(top_cause, coalesce(top_cause_probability, 0), conclusion IS 'named'))
  WHERE top_cause IS NOT NULL;
CREATE TRIGGER analyses_stay BEFORE UPDATE ON analyses BEGIN SELECT RAISE(ABORT, 'an analysis is never changed'); END;

-- The same causes of the newest result as rows, in the order of the lists, so that a cause is found wherever it stands.
CREATE TABLE submission_causes (
  cause TEXT NOT NULL,
  received_at INTEGER NOT NULL,
  submission_seq INTEGER NOT NULL REFERENCES submissions (seq),
  PRIMARY KEY (cause, received_at, submission_seq)
) STRICT, WITHOUT ROWID;
CREATE INDEX submission_causes_by_submission ON submission_causes (submission_seq);
INSERT INTO submission_causes SELECT top_cause, received_at, seq FROM submissions WHERE top_cause IS NOT NULL;
DROP INDEX submissions_by_cause;

-- The settled causes of a lot's valves, each by its newest result.
CREATE TABLE lot_causes (
  lot TEXT NOT NULL,
  cause TEXT NOT NULL,
  valve TEXT NOT NULL,
  PRIMARY KEY (lot, cause, valve)
) STRICT, WITHOUT ROWID;
CREATE INDEX lot_causes_by_valve ON lot_causes (lot, valve);
INSERT INTO lot_causes SELECT v.lot, s.top_cause, v.valve FROM lot_valves v JOIN submissions s ON s.seq = v.result_seq
  WHERE s.conclusion = 'named' AND s.top_cause IS NOT NULL;

-- Verdicts of a lot are counted without the cause, which has its own table now.
DROP TRIGGER lot_valves_counted;
DROP TRIGGER lot_valves_recounted;
DROP TABLE lot_counts;
ALTER TABLE lot_valves DROP COLUMN cause;
CREATE TABLE lot_counts (
  lot TEXT NOT NULL,
  analysed INTEGER NOT NULL,
  verdict TEXT NOT NULL,
  valves INTEGER NOT NULL,
  PRIMARY KEY (lot, analysed, verdict)
) STRICT, WITHOUT ROWID;
INSERT INTO lot_counts SELECT lot, result_seq IS NOT NULL, verdict, count(*) FROM lot_valves GROUP BY 1, 2, 3;
CREATE TRIGGER lot_valves_counted AFTER INSERT ON lot_valves BEGIN
  INSERT INTO lot_counts VALUES (NEW.lot, NEW.result_seq IS NOT NULL, NEW.verdict, 1)
    ON CONFLICT (lot, analysed, verdict) DO UPDATE SET valves = valves + 1;
END;
CREATE TRIGGER lot_valves_recounted AFTER UPDATE ON lot_valves BEGIN
  UPDATE lot_counts SET valves = valves - 1
    WHERE lot = OLD.lot AND analysed = (OLD.result_seq IS NOT NULL) AND verdict = OLD.verdict;
  INSERT INTO lot_counts VALUES (NEW.lot, NEW.result_seq IS NOT NULL, NEW.verdict, 1)
    ON CONFLICT (lot, analysed, verdict) DO UPDATE SET valves = valves + 1;
END;
