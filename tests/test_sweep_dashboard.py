"""The dashboard, in a real browser."""

import json
import threading
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import chromium
import numpy as np
import pytest
from sweep_studies import write_finished_study

from laesi_tf.common.errors import InputError
from sweeps import dashboard

POINTS = "document.querySelectorAll('#graph-pareto-front .point').length"


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    folder = tmp_path_factory.mktemp("sweep")
    random = np.random.default_rng(0)
    values = np.stack([random.uniform(20, 90, 1425), random.choice([1.5, 4.0], 1425)], axis=1)
    write_finished_study(str(folder / "study.db"), values)
    server = dashboard.make_dashboard_server(str(folder / "study.db"), None, host="127.0.0.1", port=0)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}"
    server.shutdown()


@pytest.mark.skipif(chromium.binary() is None, reason="no Chromium; apt-get install chromium")
def test_the_study_opens_with_all_trials_and_the_pareto_front(address: str) -> None:
    with chromium.Browser() as browser:
        started = time.monotonic()
        browser.call("Page.navigate", url=f"{address}/dashboard/studies/1")
        browser.wait_until(f"document.querySelector('#graph-pareto-front') && {POINTS} == 1425", 60)
        # Run with -s on an idle machine to see it.
        print(f"opened in {time.monotonic() - started:.2f} s")
        text = browser.evaluate("document.body.innerText")
    assert "grid (id=1)" in text and "MRE, %" in text and "inference, ms" in text


def test_it_serves_the_trials(address: str) -> None:
    with urllib.request.urlopen(f"{address}/api/studies/1", timeout=30) as answer:
        study = json.load(answer)
    assert len(study["trials"]) == 1425 and {trial["state"] for trial in study["trials"]} == {"Complete"}
    assert study["best_trials"]


def test_it_listens_on_this_machine_alone_by_default() -> None:
    assert dashboard._make_parser().parse_args([]).host == "127.0.0.1"


def test_bad_input_is_refused(address: str, tmp_path: Path) -> None:
    def serve(storage: Path, port: int, folder: Path | None = None) -> None:
        dashboard.make_dashboard_server(str(storage), folder, host="127.0.0.1", port=port)

    with pytest.raises(InputError, match="no storage"):
        serve(tmp_path / "none.db", 0)
    (tmp_path / "study.db").touch()
    with pytest.raises(InputError, match="is a file; name a folder"):
        serve(tmp_path / "study.db", 0, tmp_path / "study.db")
    for port in (int(address.rpartition(":")[2]), 99999):
        with pytest.raises(InputError, match="choose another --port"):
            serve(tmp_path / "study.db", port)
