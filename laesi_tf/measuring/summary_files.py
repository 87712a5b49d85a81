"""Write the files that summarise a folder of results: the page, the provenance, and the figures as JSON."""

import datetime
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from laesi_tf.common.atomic_files import write_json
from laesi_tf.common.result_files import PAGE_FILE, PROVENANCE_FILE
from laesi_tf.measuring.provenance import write_provenance
from laesi_tf.measuring.results_folder import ResultsFolder
from laesi_tf.reporting.folder_page import PagePhoto, write_page


def write_summary_files(
    results: ResultsFolder, models: Mapping[str, Path | str], *, json: Path | None, passed_over: str
) -> None:
    """Bring the tables into order and write the summary files; nothing if no photo could be read.

    Raises InputError where they cannot be written.
    """
    if not results.is_written:
        return
    results.sort_tables()
    if json is not None:
        records = (record for entry in results.read_entries() for record in entry.records)
        write_json(json, [record.to_values() for record in records])
    settings = results.settings
    facts = {name: str(value) for name, value in _list_facts(settings) if value is not None}
    facts["date"] = datetime.datetime.now(datetime.UTC).date().isoformat()
    write_page(
        results.folder / PAGE_FILE,
        (PagePhoto(entry.records, entry.thumbnail) for entry in results.read_all_entries()),
        title=f"Leaf areas in {results.folder.absolute().name}",
        facts=facts,
        passed_over=passed_over,
    )
    write_provenance(
        results.folder / PROVENANCE_FILE,
        settings,
        models,
        table=results.table,
        photos=results.count_measured() + results.count_others(),
    )


def _list_facts(settings: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield settings by the names that people read."""
    yield "laesi_tf, version", settings["version"]
    yield "digest of its code", settings["code"]
    for task, digest in settings["models"].items():
        yield f"digest of the model, {task}" if task != "background" else "background", digest
    yield "scale given, px/mm", settings["px_per_mm"]
    yield "resolution given, dpi", settings["dpi"]
    yield "distance of the lines given, mm", settings["grid_mm"]
