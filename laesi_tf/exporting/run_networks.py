"""Convert the network of a run to the LiteRT file that stands beside its weights in an exported run.

Measuring with such a run needs no TensorFlow. Areas and masks are those of the network. A ruling network
takes images of any size; beside it stands a file with the other stages of the reader of rulings, each a
signature of its own. Two files, so that the memory of one can be given back while the other works.
"""

import tempfile
from collections.abc import Callable
from typing import Any

import tensorflow as tf

from laesi_tf.common.atomic_files import short_sha256
from laesi_tf.common.run_files import EXPORTED_WEIGHTS_FILE, NETWORK_FILE, READING_FILE
from laesi_tf.estimators.litert_file import write_litert_file
from laesi_tf.estimators.litert_networks import LOGITS
from laesi_tf.estimators.ruling.ruling_graph import RulingGraph
from laesi_tf.estimators.ruling.stage import inline_stages
from laesi_tf.exporting.litert import NetworkGraph, convert, describe
from laesi_tf.models.inference import freeze_network
from laesi_tf.models.ruling_cells import CELL_PX, FRAME_CELLS, FRAME_PX, LEVELS
from laesi_tf.models.ruling_network import CHANNELS
from laesi_tf.models.saved_model import Run

_PRECISION = "float32"
"""Areas are to be those of the Keras weights to 0.01 %. Those are float16 already, but the converter merges
them with batch normalisations, and rounding the products again changes areas by up to 0.4 %."""


def write_network(run: Run) -> None:
    """Write the LiteRT file of an exported run into its folder. Raises InputError."""
    task = run.spec.task
    if task == "ruling":
        graph = RulingGraph(run.model).with_network(freeze_network)
        network = _convert_signatures({"ask_network": _trace_network(graph)})
        _write(run, READING_FILE, _convert_signatures(_trace_stages(graph)), "reading")
    else:
        network = convert(NetworkGraph(run).predict.get_concrete_function(), _PRECISION)
    _write(run, NETWORK_FILE, network, task)


def _write(run: Run, name: str, model: bytes, kind: str) -> None:
    weights = f"sha256 {short_sha256(run.path / EXPORTED_WEIGHTS_FILE)}"
    details = describe(kind, {run.spec.task: weights})
    details |= {"variant": _PRECISION, "input_size": list(run.spec.size)}
    write_litert_file(run.path / name, model, details)


def _convert_signatures(signatures: dict[str, Any]) -> bytes:
    # Only from a saved model does the converter take several signatures.
    with tempfile.TemporaryDirectory() as folder:
        tf.saved_model.save(tf.Module(), folder, signatures)
        converter = tf.lite.TFLiteConverter.from_saved_model(folder, signature_keys=list(signatures))
        return bytes(converter.convert())


def _trace_network(graph: RulingGraph) -> Any:
    """Return the concrete function of the network alone."""

    def ask_network(images: tf.Tensor) -> dict[str, tf.Tensor]:
        return {"logits": graph.ask_network(images)}

    # Any size will do: no operation of the network holds it, so that the runner may resize the input.
    return _trace(ask_network, {"images": tf.TensorSpec([1, 8 * CELL_PX, 8 * CELL_PX, 3], tf.float32)})


def _trace_stages(graph: RulingGraph) -> dict[str, Any]:
    """Return the concrete functions of the other stages by name, with the inputs and outputs of
    `litert_networks.LiteRtRulingStages`."""
    frame = {"frame": tf.TensorSpec([FRAME_PX, FRAME_PX, 3], tf.uint8)}
    size = {"size": tf.TensorSpec([2], tf.float32)}
    pixels = sum((FRAME_PX >> level) ** 2 for level in range(1, LEVELS))
    coarser = {"coarser": tf.TensorSpec([pixels, 3], tf.float32)}
    logits = {
        name: tf.TensorSpec([FRAME_CELLS >> level, FRAME_CELLS >> level, CHANNELS], tf.float32)
        for level, name in enumerate(LOGITS)
    }
    coarse = {name: logits[name] for name in LOGITS[1:]}
    options = {"is_full": tf.TensorSpec([], tf.int32), "grid_mm": tf.TensorSpec([], tf.float32)}

    def needs_full_resolution(size: tf.Tensor, **logits: tf.Tensor) -> dict[str, tf.Tensor]:
        is_needed = graph.needs_full_resolution([logits[name] for name in LOGITS[1:]], size)
        return {"is_needed": tf.cast(is_needed, tf.int32)}

    def read(
        frame: tf.Tensor,
        coarser: tf.Tensor,
        size: tf.Tensor,
        is_full: tf.Tensor,
        grid_mm: tf.Tensor,
        **logits: tf.Tensor,
    ) -> dict[str, tf.Tensor]:
        return graph.read(frame, coarser, [logits[name] for name in LOGITS], size, is_full > 0, grid_mm)

    return {
        "needs_full_resolution": _trace(needs_full_resolution, size | coarse),
        "read": _trace(read, frame | coarser | size | options | logits),
    }


def _trace(stage: Callable[..., Any], inputs: dict[str, tf.TensorSpec]) -> Any:
    specs = {name: tf.TensorSpec(spec.shape, spec.dtype, name) for name, spec in inputs.items()}
    with inline_stages():
        return tf.function(stage, autograph=False).get_concrete_function(**specs)
