"""Measure the similarity of two sets of images: real and synthetic, or synthetic before and after a change.

A set is a manifest, a folder of images, or a data set that generate wrote. A network trained on ImageNet
turns every image into a vector of unit length; the similarity of two images is the cosine of theirs. The
cosines within one set show what to expect between two.
"""

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from laesi_tf.cli.arguments import make_parser
from laesi_tf.cli.console import run_command
from laesi_tf.cli.tensorflow_setup import load_tensorflow
from laesi_tf.common.atomic_files import require_writable, write_csv, write_json, write_text
from laesi_tf.common.errors import InputError
from laesi_tf.common.parsing import positive_int
from laesi_tf.data.image_sets import find_images, load_images

_SIZE = (224, 224)
_NETWORKS = ("resnet50", "small", "large", "large_minimalistic")
_PAIRS = 100
_MIN_IMAGES = 3


def main(arguments: Sequence[str]) -> None:
    """Embed both sets, compare them, draw the charts. Raises InputError."""
    options = _make_parser().parse_args(arguments)
    require_writable(options.out / "similarity.csv")
    image_sets = {
        "a": find_images(options.a, split=options.split_a),
        "b": find_images(options.b, split=options.split_b),
    }
    for image_set in image_sets.values():
        _require_enough(image_set.path, image_set.count)
    load_tensorflow()
    from laesi_tf.evaluation.feature_similarity import compare_sets, find_closest_pairs, summarise_scores
    from laesi_tf.models.image_embedding import load_embedder
    from laesi_tf.reporting.similarity_charts import draw_pairs, import_umap, plot_umap, plot_violins

    import_umap()
    images, names = {}, {}
    for key, image_set in image_sets.items():
        images[key], names[key], errors = load_images(image_set, size=_SIZE, count=options.count)
        for error in errors:
            print(f"skipped: {error}")
        _require_enough(image_set.path, len(images[key]))
    embed = load_embedder(options.network, size=_SIZE, weights=options.weights)
    features = {key: embed(pixels) for key, pixels in images.items()}
    cosines = features["a"] @ features["b"].T
    scores = compare_sets(features["a"], features["b"])
    metrics = {
        "a": str(options.a),
        "b": str(options.b),
        "network": embed.origin,
        "n_a": len(features["a"]),
        "n_b": len(features["b"]),
        "mean_all_pairs": float(cosines.mean()),
        **summarise_scores(scores),
    }
    title = f"a: {options.a}\nb: {options.b}\n{embed.origin}"
    plot_violins(options.out / "violins.png", scores, title=title)
    plot_umap(options.out / "umap.png", features, title=title)
    pairs = find_closest_pairs(cosines, _PAIRS)
    draw_pairs(options.out / "pairs.png", images, names, pairs)
    rows = ((names["a"][i], names["b"][j], f"{cosine:.6f}") for i, j, cosine in pairs)
    write_csv(options.out / "similarity.csv", ("a", "b", "cosine"), rows)
    table = _format_table(metrics)
    write_text(options.out / "similarity.txt", table + "\n")
    if options.json:
        write_json(options.json, metrics)
    print(table)


def _require_enough(path: Path, count: int) -> None:
    if count < _MIN_IMAGES:
        raise InputError(f"{path} has {count} images to compare; at least {_MIN_IMAGES} are needed")


def _format_table(metrics: Mapping[str, Any]) -> str:
    lines = [
        f"a: {metrics['n_a']} images of {metrics['a']}",
        f"b: {metrics['n_b']} images of {metrics['b']}",
        f"network: {metrics['network']}",
        f"mean cosine of all pairs between the sets  {metrics['mean_all_pairs']:.4f}",
        f"{'cosine to the nearest image':32}{'p10':>9}{'median':>9}{'p90':>9}",
    ]
    for key in ("a_to_b", "b_to_a", "within_a", "within_b"):
        values = "".join(f"{metrics[f'{key}_{name}']:9.4f}" for name in ("p10", "median", "p90"))
        lines.append(f"{key.replace('_', ' '):32}{values}")
    return "\n".join(lines)


def _make_parser() -> argparse.ArgumentParser:
    parser = make_parser("similarity", __doc__)
    parser.add_argument("a", type=Path, metavar="A", help="manifest or folder of the first set")
    parser.add_argument("b", type=Path, metavar="B", help="manifest or folder of the second set")
    parser.add_argument("--split-a", metavar="NAME", help="split of A's manifest")
    parser.add_argument("--split-b", metavar="NAME", help="split of B's manifest")
    parser.add_argument(
        "--network",
        choices=_NETWORKS,
        default="resnet50",
        help="network that embeds the images",
    )
    parser.add_argument(
        "--weights",
        default="imagenet",
        metavar="imagenet|PATH",
        help="Keras's own weights, or a file of this network",
    )
    parser.add_argument(
        "--count",
        type=positive_int,
        default=500,
        metavar="N",
        help="images of each set at most, evenly spaced",
    )
    parser.add_argument(
        "--out", type=Path, default=Path("similarity"), metavar="DIR", help="folder for charts and tables"
    )
    return parser


if __name__ == "__main__":
    run_command(main)
