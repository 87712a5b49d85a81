"""Settings and fixtures that several test files share."""

import os
from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import settings

# Property tests draw new examples on a developer's machine and the same ones in continuous integration.
settings.register_profile("ci", derandomize=True)
if os.environ.get("CI"):
    settings.load_profile("ci")


@pytest.fixture(scope="session")
def stand_in_networks() -> Iterator[None]:
    """Let `load_run` build the stand-in networks of run directories that `green.save_run` wrote."""
    import green

    from laesi_tf.models import saved_model

    build = saved_model.build_network

    def build_stand_in(spec: Any, **options: str) -> Any:
        if spec.alpha == green.STAND_IN_ALPHA:
            return green.STAND_INS[spec.task](spec.size), "stand-in"
        return build(spec, **options)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(saved_model, "build_network", build_stand_in)
        yield
