"""Importing changes nothing outside the package; commands import TensorFlow only after parsing."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from laesi_tf.__main__ import COMMANDS

ROOT = Path(__file__).parents[1]
PACKAGES = ("laesi_tf", "experiments", "sweeps")

# Third-party packages are imported first: what they change is not ours.
IMPORT_EACH = """
import importlib, json, logging, os, socket, sys, warnings
third_party, modules = map(json.loads, sys.argv[1:])
for name in third_party:
    importlib.import_module(name)

def observe():
    loggers = [logging.getLogger(), *map(logging.getLogger, sorted(logging.root.manager.loggerDict))]
    return {
        "environment": dict(os.environ),
        "descriptors": sorted(os.listdir("/proc/self/fd")) if os.path.isdir("/proc/self/fd") else [],
        "warnings": [str(warnings.filters), str(warnings.showwarning)],
        "log levels": {logger.name: logger.level for logger in loggers if logger.level},
        "socket timeout": socket.getdefaulttimeout(),
        "working folder": os.getcwd(),
    }

changes = []
before = observe()
for name in modules:
    importlib.import_module(name)
    after = observe()
    changes += [f"{name} changes {key}" for key in before if before[key] != after[key]]
    before = after
print(json.dumps(changes))
"""
THIRD_PARTY = [
    "tensorflow",
    "keras",
    "cv2",
    "matplotlib.figure",
    "optuna",
    "PIL.Image",
    "setuptools.command.build_py",
    "sqlalchemy",
    "scipy.stats",
]


def all_modules():
    paths = [path for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py"))]
    names = [".".join(path.relative_to(ROOT).with_suffix("").parts) for path in paths]
    return sorted({name.removesuffix(".__init__") for name in names})


@pytest.mark.parametrize("stderr", ["open", "closed"])
def test_importing_any_module_changes_nothing_outside(stderr):
    arguments = [sys.executable, "-c", IMPORT_EACH, json.dumps(THIRD_PARTY), json.dumps(all_modules())]
    if stderr == "closed":
        arguments = ["sh", "-c", 'exec "$@" 2>&-', "sh", *arguments]
    done = subprocess.run(
        arguments, capture_output=True, text=True, cwd=ROOT, env=os.environ | {"PYTHONPATH": str(ROOT)}
    )
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout.splitlines()[-1]) == []


CLONE_COMMANDS = [
    *(f"experiments.{name}" for name in ("run", "table")),
    *(
        f"sweeps.{name}"
        for name in (
            "run",
            "grid",
            "dashboard",
            "analysis",
            "benchmark",
            "load_test",
            "learning_rates",
            "screening",
        )
    ),
]


@pytest.mark.parametrize("module", CLONE_COMMANDS)
def test_wrong_flags_of_experiments_and_sweeps_need_no_tensorflow(module):
    done = subprocess.run(
        [sys.executable, "-X", "importtime", "-m", module, "--no-such-flag"],
        capture_output=True,
        text=True,
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
    )
    # A missing required flag is named before an unknown one.
    assert done.returncode == 2 and "\nerror: " in done.stderr, done.stderr[-500:]
    assert " tensorflow" not in done.stderr and " keras" not in done.stderr


@pytest.mark.parametrize("command", COMMANDS)
def test_help_and_wrong_flags_need_no_tensorflow(command):
    for flag, status in (("--help", 0), ("--no-such-flag", 2)):
        arguments = [sys.executable, "-X", "importtime", "-m", "laesi_tf", command, flag]
        done = subprocess.run(
            arguments, capture_output=True, text=True, cwd=ROOT, env=os.environ | {"PYTHONPATH": str(ROOT)}
        )
        assert done.returncode == status, done.stderr[-500:]
        assert " tensorflow" not in done.stderr and " keras" not in done.stderr
