"""Analysis of a finished sweep: tables, effects, rankings, charts and findings."""
