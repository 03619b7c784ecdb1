"""Summaries of a fleet's rows, in SQL that duckdb, DataFusion and Spark all take.

The rows are a table or view ``verdicts``; ``FLATTEN`` makes a view ``outputs`` of it.
"""

from __future__ import annotations

#: The statement by which each engine makes the view ``outputs``, with a row for each output.
FLATTEN = {
    "duckdb": """
CREATE OR REPLACE TEMP VIEW outputs AS
SELECT file, drive, operator, o.p, o.source, o.seconds, o.items
FROM (SELECT file, drive, operator, unnest(outputs) AS o FROM verdicts)
""",
    "datafusion": """
CREATE OR REPLACE VIEW outputs AS
SELECT file, drive, operator, o['p'] AS p, o['source'] AS source, o['seconds'] AS seconds,
  o['items'] AS items
FROM (SELECT file, drive, operator, unnest(outputs) AS o FROM verdicts)
""",
    "spark": """
CREATE OR REPLACE TEMP VIEW outputs AS
SELECT file, drive, operator, inline(outputs) FROM verdicts
""",
}

_SOURCES = """
WITH bins AS (
  SELECT {key}source, seconds, CAST(sum(items) AS BIGINT) AS n FROM outputs
  GROUP BY {key}source, seconds
), ranked AS (
  SELECT {key}source, seconds, n,
    sum(n) OVER (PARTITION BY {key}source ORDER BY seconds) AS upto,
    sum(n) OVER (PARTITION BY {key}source) AS total,
    sum(n) OVER ({all}) AS everything
  FROM bins
)
SELECT {key}source, CAST(max(total) AS BIGINT) AS items,
  CAST(max(total) AS DOUBLE) / max(everything) AS share,
  min(CASE WHEN upto >= 0.5 * total THEN seconds END) AS p50,
  min(CASE WHEN upto >= 0.9 * total THEN seconds END) AS p90,
  min(CASE WHEN upto >= 0.99 * total THEN seconds END) AS p99,
  max(seconds) AS greatest
FROM ranked GROUP BY {key}source ORDER BY {key}items DESC, source
"""

#: The questions by name.
SUMMARIES = {
    # One row: how much was judged, and how much of it conforms.
    "totals": """
SELECT count(DISTINCT drive) AS drives, count(DISTINCT file) AS files,
  count(error) AS unreadable,
  count(CASE WHEN rule IS NULL AND conforms THEN 1 END) AS conforming,
  count(CASE WHEN NOT conforms AND violations = 0 THEN 1 END) AS doubtful,
  coalesce(sum(seconds), 0) / 3600 AS hours,
  CAST(coalesce(sum(lines), 0) AS BIGINT) AS lines,
  CAST(coalesce(sum(messages), 0) AS BIGINT) AS messages,
  CAST(coalesce(sum(missed), 0) AS BIGINT) AS missed,
  CAST(coalesce(sum(refused), 0) AS BIGINT) AS refused,
  CAST(coalesce(sum(violations), 0) AS BIGINT) AS violations,
  count(DISTINCT judge) AS judges, count(DISTINCT manner) AS manners
FROM verdicts
""",
    # The sources whose results went out, and how long they took, in seconds.
    "sources": _SOURCES.format(key="", all=""),
    "operators": _SOURCES.format(key="operator, ", all="PARTITION BY operator"),
    # The rules that are broken. Only the first 100 violations of a trace have a rule here.
    "rules": """
SELECT rule, count(*) AS violations, count(DISTINCT drive) AS drives, max(late) AS latest
FROM verdicts WHERE rule IS NOT NULL GROUP BY rule ORDER BY violations DESC, rule
""",
    # The doubts about traces that break no rule, unless they are accepted.
    "doubts": """
SELECT doubts, count(*) AS traces, count(DISTINCT drive) AS drives
FROM verdicts WHERE doubts IS NOT NULL AND violations = 0
GROUP BY doubts ORDER BY traces DESC, doubts
""",
    # The drives in which something went wrong: first those with the most violations, then those
    # that most often had no output.
    "worst": """
WITH drives AS (
  SELECT drive, count(DISTINCT file) AS files,
    CAST(coalesce(sum(violations), 0) AS BIGINT) AS violations,
    count(error) AS unreadable,
    count(CASE WHEN NOT conforms AND violations = 0 THEN 1 END) AS doubtful,
    CAST(coalesce(sum(missed), 0) AS BIGINT) AS missed,
    CAST(coalesce(sum(refused), 0) AS BIGINT) AS refused,
    CAST(coalesce(sum(messages), 0) AS BIGINT) AS messages
  FROM verdicts GROUP BY drive
)
SELECT * FROM drives WHERE violations + unreadable + doubtful + missed + refused > 0
ORDER BY violations DESC, unreadable DESC, doubtful DESC, missed + refused DESC, drive LIMIT 50
""",
    # The number of drives by their share of outputs from local: twentieths, the last one whole.
    "on_board": """
WITH shares AS (
  SELECT drive, sum(CASE WHEN p = 0 THEN items ELSE 0 END) * 1.0 / sum(items) AS share
  FROM outputs GROUP BY drive
)
SELECT CAST(floor(share * 20) AS INT) AS twentieth, count(*) AS drives
FROM shares GROUP BY CAST(floor(share * 20) AS INT) ORDER BY twentieth
""",
    # The number of each source's outputs by the seconds that they took at most.
    "responses": """
SELECT source, seconds, CAST(sum(items) AS BIGINT) AS items FROM outputs
GROUP BY source, seconds ORDER BY source, seconds
""",
    # The files that could not be read, and why.
    "unreadable": """
SELECT file, error FROM verdicts WHERE error IS NOT NULL ORDER BY file LIMIT 50
""",
}
