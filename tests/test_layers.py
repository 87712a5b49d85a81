"""Importing a module changes nothing outside the package; commands import TensorFlow only after they have parsed."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from laesi_tf.__main__ import COMMANDS

ROOT = Path(__file__).parents[1]
PACKAGES = ("laesi_tf", "experiments", "sweeps")

# Third-party packages are imported first: what they change is theirs.
IMPORT_ALL = """
import importlib, json, logging, os, socket, sys, warnings
third_party, own = json.loads(sys.argv[1]), json.loads(sys.argv[2])
for name in third_party:
    importlib.import_module(name)

def state():
    loggers = [logging.getLogger(), *map(logging.getLogger, sorted(logging.root.manager.loggerDict))]
    return {
        "environment": dict(os.environ),
        "descriptors": sorted(os.listdir("/proc/self/fd")) if os.path.isdir("/proc/self/fd") else [],
        "warning filters": [str(entry) for entry in warnings.filters],
        "showwarning": str(warnings.showwarning),
        "log levels": {logger.name: logger.level for logger in loggers},
        "socket timeout": socket.getdefaulttimeout(),
        "working folder": os.getcwd(),
    }

before = state()
changed = []
for name in own:
    importlib.import_module(name)
    after = state()
    known = before["log levels"]
    after["log levels"] = {key: level for key, level in after["log levels"].items() if level or key in known}
    before["log levels"] = {key: level for key, level in known.items()}
    for key in after:
        if key == "log levels":
            if any(known.get(logger, 0) != level for logger, level in after[key].items()):
                changed.append((name, key))
        elif after[key] != before[key]:
            changed.append((name, key))
    before = after
print(json.dumps(changed))
"""
THIRD_PARTY = [
    "tensorflow",
    "keras",
    "cv2",
    "matplotlib.figure",
    "optuna",
    "PIL.Image",
    "sqlalchemy",
    "scipy.stats",
]


def all_modules():
    paths = [path for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py"))]
    names = [".".join(path.relative_to(ROOT).with_suffix("").parts) for path in paths]
    return sorted({name.removesuffix(".__init__") for name in names})


@pytest.mark.parametrize("stderr", ["open", "closed"])
def test_importing_any_module_changes_nothing_outside(stderr):
    arguments = [sys.executable, "-c", IMPORT_ALL, json.dumps(THIRD_PARTY), json.dumps(all_modules())]
    done = subprocess.run(
        arguments,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        preexec_fn=(lambda: os.close(2)) if stderr == "closed" else None,
    )
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout.splitlines()[-1]) == []


@pytest.mark.parametrize("command", COMMANDS)
def test_help_and_wrong_flags_need_no_tensorflow(command):
    for flag, status in (("--help", 0), ("--no-such-flag", 2)):
        arguments = [sys.executable, "-X", "importtime", "-m", "laesi_tf", command, flag]
        done = subprocess.run(
            arguments, capture_output=True, text=True, cwd=ROOT, env=os.environ | {"PYTHONPATH": str(ROOT)}
        )
        assert done.returncode == status, done.stderr[-500:]
        assert " tensorflow" not in done.stderr and " keras" not in done.stderr
