"""Settings and fixtures that several test files share."""

import contextlib
import ctypes
import gc
import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

# Property tests draw new examples on a developer's machine and the same ones in continuous integration. A
# busy machine takes as long as it takes: times are no assertions.
settings.register_profile("developer", deadline=None)
settings.register_profile("ci", deadline=None, derandomize=True)
settings.load_profile("ci" if os.environ.get("CI") else "developer")


def pytest_configure(config: pytest.Config) -> None:
    """Compile scenes quickly, and once for all workers and commands: compiling is most of the work.

    Two scenes of 96 px take 46 s of CPU to compile by default, 27 s without the optimisations of LLVM
    and 13 s from the cache, with the same bytes. TensorFlow reads these variables when it is imported; it
    logs each load from the cache as an error.
    """
    # A shell that starts the tests in the background lets them ignore Ctrl-C, which some of them press.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    if config.pluginmanager.hasplugin("cacheprovider"):
        cache: Path = config.cache.mkdir("xla")  # type: ignore[union-attr]
        os.environ.setdefault("TF_XLA_FLAGS", f"--tf_xla_persistent_cache_directory={cache}")
    os.environ.setdefault("XLA_FLAGS", "--xla_backend_optimization_level=0")
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
    # Compiling the map of similarities takes longer than drawing it once.
    os.environ.setdefault("NUMBA_DISABLE_JIT", "1")
    # For the workers, which start later: threads that share their heaps give memory back sooner.
    os.environ.setdefault("MALLOC_ARENA_MAX", "2")


_TOGETHER = {
    **dict.fromkeys(("test_litert_estimator", "test_web_browser"), "converted"),
    **dict.fromkeys(("test_sensitivity", "test_sheet_reader", "test_shipped_networks"), "traced"),
}
"""Files that one worker runs one after the other, by the name of their group: converting the measurement to a
LiteRT file takes a minute, tracing the reader of rulings in TensorFlow over 10 s."""


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Give each file, and the files of a group, to one worker, so that tests share what they compile."""
    if config.getvalue("dist") != "loadfile":
        return None
    from xdist.scheduler import LoadFileScheduling

    class FilesTogether(LoadFileScheduling):
        def _split_scope(self, nodeid: str) -> str:
            file: str = super()._split_scope(nodeid)
            return _TOGETHER.get(Path(file).stem, file)

    return FilesTogether(config, log)


def pytest_collection_finish() -> None:
    """Exclude all that is imported by now from garbage collection, which takes a second with TensorFlow."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="module", autouse=True)
def free_memory() -> Iterator[None]:
    """Drop the networks of a module when its tests are done, and return freed memory to the system."""
    yield
    if "keras" in sys.modules:
        sys.modules["keras"].backend.clear_session()
    gc.collect()
    if sys.platform == "linux":
        with contextlib.suppress(OSError, AttributeError):  # a system without glibc
            ctypes.CDLL("libc.so.6").malloc_trim(0)


@pytest.fixture(scope="session")
def sheet_reader() -> Any:
    """Load the shipped reader of rulings, in LiteRT."""
    from laesi_tf.estimators.factory import load_shipped_reader

    return load_shipped_reader()


@pytest.fixture(scope="session")
def keras_sheet_reader() -> Any:
    """Load the same reader in TensorFlow, which is traced once for all tests that need it."""
    from laesi_tf.estimators.factory import load_shipped_reader

    return load_shipped_reader(in_keras=True)


@pytest.fixture(scope="session")
def photo_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Convert the whole measurement, with a stand-in for the mask network, to a LiteRT file."""
    from litert_files import write_photo_file

    path = tmp_path_factory.mktemp("litert") / "photo.tflite"
    write_photo_file(path)
    return path


@pytest.fixture(scope="session")
def stand_in_networks() -> Iterator[None]:
    """Let `load_run` build the stand-in networks of run directories that `green.save_run` wrote."""
    import green

    from laesi_tf.models import saved_model

    build = saved_model.build_network

    def build_stand_in(spec: Any, **options: str) -> Any:
        if spec.alpha == green.STAND_IN_ALPHA:
            return saved_model.BuiltNetwork(green.STAND_INS[spec.task](spec.size), None, "stand-in")
        return build(spec, **options)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(saved_model, "build_network", build_stand_in)
        yield


@pytest.fixture(scope="module")
def tiny_backbone() -> Iterator[None]:
    """Let networks be built on the stand-in of `tiny_backbone.py` in place of MobileNetV3."""
    from tiny_backbone import build_tiny_backbone

    from laesi_tf.models import backbone

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(backbone, "_build_network", build_tiny_backbone)
        yield


@pytest.fixture(scope="module")
def server() -> Iterator[Any]:
    """Run a PostgreSQL server for the tests of a module."""
    import postgres

    with postgres.run_server() as running:
        yield running
