"""A small data set of TFRecords."""

from functools import cache
from pathlib import Path

import numpy as np
from scenes import only

from laesi_tf.data import dataset_spec, synthetic, tfrecords
from laesi_tf.data.dataset_spec import DatasetSpec

SIZE = (48, 64)
SPEC = DatasetSpec(count=10, size=SIZE, per_shard=4, seed=3, ranges="")


@cache
def render_samples(count: int = SPEC.count) -> list[dict[str, np.ndarray]]:
    """Render the first samples of the data set, once a process."""
    samples = synthetic.synthetic_samples(seed=3, size=SIZE, ranges=only("ruling"), count=count, passes=1)
    return list(samples.as_numpy_iterator())


def write_dataset(folder: Path, spec: DatasetSpec = SPEC) -> None:
    """Write all shards of a data set as `spec` describes it."""
    samples = render_samples(spec.count)
    dataset_spec.start_dataset(folder, spec)
    for shard in range(spec.shards):
        records = [
            tfrecords.encode_record(samples[index], seed=3, prompt="oak")
            for index in spec.sample_indices(shard)
        ]
        tfrecords.write_shard(folder / spec.shard_name(shard), records)
