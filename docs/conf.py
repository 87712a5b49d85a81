"""Configuration of Sphinx: `make docs` builds docs/_build/html; every warning is an error."""

import dataclasses
import os
import re
import sys
from importlib.metadata import version as installed_version
from pathlib import Path
from typing import Any

# TensorFlow reads this when it is imported.
os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT))

import tensorflow as tf  # noqa: E402

# The gallery makes a dozen images: compiling for them takes three times as long as all of it without.
tf.config.run_functions_eagerly(True)

project = "laesi_tf"
author = "the laesi_tf contributors"
copyright = "2026, the laesi_tf contributors"
release = version = installed_version("laesi_tf")

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.viewcode",
    "sphinx_design",
    "sphinx_gallery.gen_gallery",
]
exclude_patterns = [
    *("_build", "gallery", "sample", "auto_examples/**.ipynb", "**sg_execution_times.rst"),
    # Written by `python -m experiments.table`, without a title; a download.
    "results/table.md",
]
templates_path = ["_templates"]

myst_enable_extensions = ["colon_fence", "deflist"]
myst_heading_anchors = 3
highlight_language = "none"

autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
autodoc_default_options = {"undoc-members": True}
autosummary_generate = True
autosummary_ignore_module_all = True

html_theme = "pydata_sphinx_theme"
html_title = "laesi_tf"
html_static_path = ["_static"]
html_css_files = ["laesi.css"]
html_show_sourcelink = False
# Pages without neighbours have no section to navigate.
html_sidebars = {page: [] for page in ("results/index", "contributing", "changelog")}
html_theme_options = {
    "navbar_align": "left",
    "show_prev_next": False,
    "show_toc_level": 2,
    "navigation_with_keys": False,
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": ["copyright"],
    "footer_end": [],
}

sphinx_gallery_conf = {
    "examples_dirs": "gallery",
    "gallery_dirs": "auto_examples",
    "filename_pattern": r"\.py$",
    "within_subsection_order": "FileNameSortKey",
    "download_all_examples": False,
    "show_memory": False,
    "show_signature": False,
    "min_reported_time": 1,
    "remove_config_comments": True,
    "abort_on_example_error": False,
    "default_thumb_file": str(ROOT / "docs" / "scenes.jpg"),
}


def _to_restructured_text(
    app: Any, what: str, name: str, obj: object, options: Any, lines: list[str]
) -> None:
    """Turn a docstring's Markdown into reStructuredText, in place: `code` and indented blocks.

    Docstrings are written for people who read the source: code stands in single backquotes, and signs that
    reStructuredText gives a meaning, such as the asterisk of a product, mean themselves.
    """
    text = "\n".join(line if line.startswith("    ") else _convert_line(line) for line in lines)
    text = re.sub(r":\n\n(?= {4}\S)", "::\n\n", text)
    lines[:] = text.split("\n")


def _convert_line(line: str) -> str:
    parts = re.split(r"(`+[^`]+`+)", line)
    for index, part in enumerate(parts):
        if index % 2:
            parts[index] = f"``{part.strip('`')}``"
        else:
            parts[index] = re.sub(r"([*|\\])|(?<=\w)(_)(?!\w)", r"\\\1\2", part)
    # Text must not touch a literal's closing marks, as in `Window`s.
    return re.sub(r"(``[^`]+``)(?=\w)", r"\1\\ ", "".join(parts))


def _hide_dataclass_signature(
    app: Any, what: str, name: str, obj: object, options: Any, signature: str | None, returns: str | None
) -> tuple[str, None] | None:
    """Leave out the signature of a dataclass: its fields follow, one by one with their meaning."""
    return ("", None) if what == "class" and dataclasses.is_dataclass(obj) else None


def setup(app: Any) -> None:
    """Register the conversion of docstrings and signatures."""
    app.connect("autodoc-process-signature", _hide_dataclass_signature)
    app.connect("autodoc-process-docstring", _to_restructured_text)
