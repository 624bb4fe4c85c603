-- What the simulation leaves of an analysis' recordings, coarse: a compressed JSON object by test, of the analyses that a
-- lot compares (conclusion `none` or `unexplained`). Those made before have no row.
CREATE TABLE analysis_residuals (
  analysis_seq INTEGER PRIMARY KEY REFERENCES analyses (seq),
  residuals BLOB NOT NULL
) STRICT;
