"""Training in mixed precision: 16 bits in the backbone, 32 in all that is kept."""

from pathlib import Path

import numpy as np
import pytest
from disc_runs import disc_stream, fit_discs, read_history, tiny_config

from laesi_tf.common.errors import InputError
from laesi_tf.common.run_files import STATE_FILE
from laesi_tf.models.saved_model import load_run
from laesi_tf.training import loop
from laesi_tf.training.replicas import ONE_DEVICE
from laesi_tf.training.replicated_trainer import make_trainer

pytestmark = pytest.mark.usefixtures("tiny_backbone")


def test_a_run_in_float16_has_finite_losses_and_is_read_in_float32(tmp_path: Path) -> None:
    config = tiny_config(steps=4, schedule="constant", precision="mixed_float16")
    fit_discs(config, tmp_path)
    for row in read_history(tmp_path):
        assert all(np.isfinite(float(value)) for key, value in row.items() if key != "images_per_s")
    assert {variable.dtype for variable in load_run(tmp_path).model.variables} == {"float32"}
    with np.load(tmp_path / STATE_FILE) as state:
        values = [state[name] for name in state.files if name.startswith("variable_")]
    scale = 2.0**15
    # The factor on the loss is a part of the state; it is halved whenever a gradient overflows.
    assert any(value.shape == () and 0 < value <= scale and np.log2(value) % 1 == 0 for value in values)
    with pytest.raises(InputError, match="differs in precision"):
        fit_discs(tiny_config(steps=4, schedule="constant"), tmp_path)


@pytest.mark.parametrize("precision", ["mixed_float16", "mixed_bfloat16"])
def test_only_the_backbone_computes_in_16_bits(precision: str) -> None:
    trainer, _ = make_trainer(tiny_config(precision=precision), ONE_DEVICE)
    assert trainer.model.get_layer("1_conv").compute_dtype == precision.removeprefix("mixed_")
    assert trainer.model.get_layer("hidden").compute_dtype == trainer.model.output.dtype == "float32"
    assert make_trainer(tiny_config(), ONE_DEVICE)[0].model.get_layer("1_conv").compute_dtype == "float32"


def test_a_run_that_skipped_a_step_is_saved_where_it_is_stopped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = tiny_config(steps=4, validate_every=4, precision="mixed_float16")

    class Stop:
        """Ctrl-C during the third step."""

        def __enter__(self) -> object:
            asked = iter((False, False, True))
            return lambda: next(asked)

        def __exit__(self, *_: object) -> None:
            """Handle no signal."""

    monkeypatch.setattr(loop, "defer_interrupt", lambda _: Stop())
    with pytest.raises(loop.TrainingInterrupted, match="stopped at step 3, saved;"):
        fit_discs(config, tmp_path, train=disc_stream(config))


def test_a_task_without_a_backbone_has_no_mixed_precision() -> None:
    with pytest.raises(InputError, match="task 'ruling' has none"):
        tiny_config(task="ruling", size=64, precision="mixed_float16")
