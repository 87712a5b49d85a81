"""A step of the package's build, editable or as a wheel: fetch LiteRT.js, so that a wheel contains it.

Setuptools loads this file by its path before the package exists; nothing else imports it.
"""

import importlib.util
import sys
from pathlib import Path
from typing import Any

from setuptools.command.build_py import build_py


def _load_fetcher() -> Any:
    path = Path(__file__).with_name("litert_js.py")
    spec = importlib.util.spec_from_file_location("laesi_litert_js", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class BuildWithLiteRtJs(build_py):
    """Fetch what is missing, then build; without npm or a network, build without it."""

    def run(self) -> None:
        """Run the step."""
        litert_js = _load_fetcher()
        if not litert_js.list_files():
            try:
                litert_js.fetch()
            except litert_js.FetchError as error:
                print(f"warning: laesi web will lack LiteRT.js: {error}", file=sys.stderr)
        super().run()
