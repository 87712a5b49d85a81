"""Analysis of a sweep: tables, effects, rankings, charts and a page of findings."""
