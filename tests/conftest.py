"""Settings and fixtures that several test files share."""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

# Property tests draw new examples on a developer's machine and the same ones in continuous integration.
settings.register_profile("ci", derandomize=True)
if os.environ.get("CI"):
    settings.load_profile("ci")


def pytest_configure(config: pytest.Config) -> None:
    """Compile scenes quickly, and once for all workers and commands: compiling is most of the work.

    Two scenes of 96 px take 46 s of CPU to compile by default, 27 s without the optimisations of LLVM
    and 13 s from the cache, with the same bytes. TensorFlow reads these variables when it is imported; it
    logs each load from the cache as an error.
    """
    if config.pluginmanager.hasplugin("cacheprovider"):
        cache: Path = config.cache.mkdir("xla")  # type: ignore[union-attr]
        os.environ.setdefault("TF_XLA_FLAGS", f"--tf_xla_persistent_cache_directory={cache}")
    os.environ.setdefault("XLA_FLAGS", "--xla_backend_optimization_level=0")
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")


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
