-- The tables of a history: statements from each version to the next; an empty file has version 0.

-- version 1
CREATE TABLE nights (
    loop TEXT NOT NULL, start REAL NOT NULL, end REAL NOT NULL,
    digest TEXT NOT NULL, verdict TEXT NOT NULL, confidence REAL NOT NULL,
    d REAL, d_low REAL, d_high REAL, source TEXT NOT NULL, limit_of_detection REAL,
    samples INTEGER NOT NULL, interval_s REAL, half_periods INTEGER NOT NULL, detections INTEGER NOT NULL,
    settings TEXT NOT NULL, reasons TEXT NOT NULL, warnings TEXT NOT NULL,
    PRIMARY KEY (loop, start, end)) WITHOUT ROWID;
CREATE TABLE half_periods (
    loop TEXT NOT NULL, night_start REAL NOT NULL, night_end REAL NOT NULL,
    joined INTEGER NOT NULL, start REAL NOT NULL, end REAL NOT NULL,
    dt_s REAL NOT NULL, dy REAL NOT NULL, e_max REAL NOT NULL, d REAL NOT NULL,
    direction INTEGER NOT NULL, accepted INTEGER NOT NULL, why TEXT NOT NULL,
    PRIMARY KEY (loop, night_start, night_end, joined, start, end)) WITHOUT ROWID;
CREATE TABLE runs (
    digest TEXT PRIMARY KEY, first REAL NOT NULL, last REAL NOT NULL, loops INTEGER NOT NULL,
    nights INTEGER NOT NULL, inputs TEXT NOT NULL, failures TEXT NOT NULL, tool TEXT NOT NULL) WITHOUT ROWID;
CREATE TABLE repairs (loop TEXT, time REAL, note TEXT NOT NULL, PRIMARY KEY (loop, time)) WITHOUT ROWID;

-- version 2: a night says what it leaves to the next one, valve travel and details of the evidence, and the nightly job
-- knows which exports it has scanned
ALTER TABLE nights ADD COLUMN travel REAL;
ALTER TABLE nights ADD COLUMN details TEXT NOT NULL DEFAULT '{}';
ALTER TABLE nights ADD COLUMN carry BLOB;
CREATE TABLE exports (name TEXT PRIMARY KEY, fingerprint TEXT NOT NULL) WITHOUT ROWID;

-- version 3: half periods over the cut are worked out when they are asked for
DROP TABLE IF EXISTS joins;
DELETE FROM half_periods WHERE joined;
