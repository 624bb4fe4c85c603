-- Which database this is: the folder of its recordings holds the same id, so that neither is taken for another's.
CREATE TABLE store_identity (
  id TEXT NOT NULL
) STRICT;
INSERT INTO store_identity (id) VALUES (lower(hex(randomblob(16))));
