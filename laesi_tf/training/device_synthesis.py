"""Render training batches on the accelerator that trains, in place of the processor's cores.

The renderer is plain TensorFlow, so the same graph runs there: the same pictures but for the last bits of
rounding, and none is copied from the processor. A processor renders one picture per core at a time; an
accelerator is given a whole batch.
"""

from collections.abc import Callable, Iterator

import tensorflow as tf

from laesi_tf.common.errors import InputError
from laesi_tf.data.sample import Sample
from laesi_tf.training.trainer import Batches

AUTO, CPU = "auto", "cpu"
"""The accelerator where there is one; the input pipeline on the processor's cores."""

Example = tuple[tf.Tensor, tf.Tensor]


def find_synthesis_device(name: str) -> str | None:
    """Return the device that renders, such as `/device:GPU:0`; None for the input pipeline.

    Raises InputError for a device that TensorFlow does not see.
    """
    if name == CPU:
        return None
    found = [device.name for device in tf.config.list_logical_devices()]
    if name == AUTO:
        return next((device for device in found if ":GPU:" in device or ":TPU:" in device), None)
    matching = [device for device in found if device.lower().removeprefix("/device:") == name.lower()]
    if not matching:
        raise InputError(f"there is no device {name!r}; there are auto, cpu, {', '.join(found)}")
    return matching[0]


def render_batches(
    device: str,
    render: Callable[[tf.Tensor], Sample],
    make_examples: Callable[[tf.Tensor, Sample], Example],
    *,
    batch_size: int,
    start: int,
) -> Batches:
    """Yield batches of examples without end, rendered on `device`, whose first has the index `start`.

    `render` takes an index, int64 [], and `make_examples` the index and its sample.
    """
    render_images = _make_batch_renderer(render, make_examples, batch_size)
    render_batch = tf.function(render_images, autograph=False)

    def batches() -> Iterator[Example]:
        index = tf.constant(start, tf.int64)
        while True:
            with tf.device(device):
                batch = render_batch(index)
            yield batch
            index += batch_size

    return batches()


def render_on_replicas(
    strategy: tf.distribute.Strategy,
    render: Callable[[tf.Tensor], Sample],
    make_examples: Callable[[tf.Tensor, Sample], Example],
    *,
    batch_size: int,
    start: int,
) -> Batches:
    """Yield batches as `render_batches`, each device rendering the part that it trains on.

    An image and its target are distributed values with one part per device of this process.
    """
    size = batch_size // strategy.num_replicas_in_sync
    render_images = _make_batch_renderer(render, make_examples, size)

    def render_part(first: tf.Tensor) -> Example:
        replica = tf.distribute.get_replica_context().replica_id_in_sync_group
        return render_images(first + size * tf.cast(replica, tf.int64))

    @tf.function(autograph=False)
    def render_parts(first: tf.Tensor) -> Example:
        return strategy.run(render_part, args=(first,))

    def batches() -> Iterator[Example]:
        index = tf.constant(start, tf.int64)
        while True:
            yield render_parts(index)
            index += batch_size

    return batches()


def _make_batch_renderer(
    render: Callable[[tf.Tensor], Sample],
    make_examples: Callable[[tf.Tensor, Sample], Example],
    size: int,
) -> Callable[[tf.Tensor], Example]:
    """Return the function from an index, int64 [], to the examples of the `size` indices from it on."""

    def render_example(index: tf.Tensor) -> Example:
        return make_examples(index, render(index))

    image, target = tf.nest.map_structure(
        lambda tensor: tf.TensorSpec(tensor.shape, tensor.dtype),
        tf.function(render_example).get_concrete_function(tf.TensorSpec([], tf.int64)).structured_outputs,
    )

    def render_images(first: tf.Tensor) -> Example:
        indices = first + tf.range(size, dtype=tf.int64)
        signature = {"fn_output_signature": (image, target), "parallel_iterations": size}
        return tf.map_fn(render_example, indices, **signature)

    return render_images
