-- Figures of a valve's frequency response as a JSON object, {"bandwidth_hz": 2.3, ...}: of the newest result, and of
-- each analysis.
ALTER TABLE analyses ADD COLUMN features TEXT NOT NULL DEFAULT '{}';
ALTER TABLE submissions ADD COLUMN features TEXT NOT NULL DEFAULT '{}';
