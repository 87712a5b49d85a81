"""Measure how alike two sets of pictures are to a network: real and synthetic, or synthetic before and after.

A set is a manifest, a folder of pictures, or one that generate wrote. Every picture becomes a unit vector,
the features of a network trained on ImageNet; two are as alike as the cosine between theirs. How alike the
pictures of one set are among themselves says what to compare the cosines between the sets with.
"""

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from laesi_tf.cli.arguments import make_parser
from laesi_tf.cli.console import run_command
from laesi_tf.common.atomic_files import require_writable, write_csv, write_json, write_text
from laesi_tf.common.errors import InputError
from laesi_tf.common.parsing import positive_int
from laesi_tf.reporting.captions import add_caption, make_contact_sheet
from laesi_tf.reporting.overlay import write_png

# isort: split
import numpy as np

from laesi_tf.data.image_sets import load_images
from laesi_tf.evaluation.feature_similarity import find_closest_pairs, nearest_cosines
from laesi_tf.models.image_embedding import NETWORKS, load_embedder
from laesi_tf.reporting.similarity_charts import import_umap, plot_umap, plot_violins

_SIZE = (224, 224)
_PAIRS, _PAIR_COLUMNS = 100, 5


def main(arguments: Sequence[str]) -> None:
    """Embed both sets, compare, draw."""
    options = _make_parser().parse_args(arguments)
    for path in (options.out / "similarity.csv", *([options.json] if options.json else [])):
        require_writable(path)
    import_umap()
    pictures, names = {}, {}
    for key, path in (("a", options.a), ("b", options.b)):
        pictures[key], names[key] = _load_set(path, options.count, getattr(options, f"split_{key}"))
    network = load_embedder(options.network, size=_SIZE, weights=options.weights)
    features = {key: network(images) for key, images in pictures.items()}
    scores = {
        "a to b": nearest_cosines(features["a"], features["b"]),
        "b to a": nearest_cosines(features["b"], features["a"]),
        "within a": nearest_cosines(features["a"]),
        "within b": nearest_cosines(features["b"]),
    }
    figures = _summarise(options, network.origin, features, scores)
    title = f"a: {options.a}\nb: {options.b}\n{network.origin}"
    plot_violins(options.out / "violins.png", scores, title=title)
    plot_umap(options.out / "umap.png", features, title=title)
    pairs = find_closest_pairs(features["a"] @ features["b"].T, _PAIRS)
    _draw_pairs(options.out / "pairs.png", pictures, names, pairs)
    rows = ((names["a"][i], names["b"][j], f"{cosine:.6f}") for i, j, cosine in pairs)
    write_csv(options.out / "similarity.csv", ("a", "b", "cosine"), rows)
    text = _format_table(figures)
    write_text(options.out / "similarity.txt", text + "\n")
    if options.json:
        write_json(options.json, figures)
    print(text)


def _load_set(path: Path, count: int, split: str | None) -> tuple[np.ndarray, list[str]]:
    images, names, unread = load_images(path, size=_SIZE, count=count, split=split)
    for line in unread:
        print(f"skipped: {line}")
    if len(images) < 3:
        raise InputError(f"{path} has {len(images)} pictures to compare; it takes three")
    return images, names


def _summarise(
    options: argparse.Namespace,
    network: str,
    features: Mapping[str, np.ndarray],
    scores: Mapping[str, np.ndarray],
) -> dict[str, Any]:
    told: dict[str, Any] = {
        "a": str(options.a),
        "b": str(options.b),
        "network": network,
        "n_a": len(features["a"]),
        "n_b": len(features["b"]),
        "mean_all_pairs": float((features["a"] @ features["b"].T).mean()),
    }
    for name, values in scores.items():
        low, middle, high = np.percentile(values, [10, 50, 90])
        key = name.replace(" ", "_")
        told |= {f"{key}_p10": float(low), f"{key}_median": float(middle), f"{key}_p90": float(high)}
    return told


def _format_table(figures: Mapping[str, Any]) -> str:
    lines = [
        f"a: {figures['n_a']} pictures of {figures['a']}",
        f"b: {figures['n_b']} pictures of {figures['b']}",
        f"network: {figures['network']}",
        f"mean cosine of all pairs between the sets  {figures['mean_all_pairs']:.4f}",
        f"{'cosine to the nearest picture':32}{'p10':>9}{'median':>9}{'p90':>9}",
    ]
    for key in ("a_to_b", "b_to_a", "within_a", "within_b"):
        values = "".join(f"{figures[f'{key}_{name}']:9.4f}" for name in ("p10", "median", "p90"))
        lines.append(f"{key.replace('_', ' '):32}{values}")
    return "\n".join(lines)


def _draw_pairs(
    path: Path,
    pictures: Mapping[str, np.ndarray],
    names: Mapping[str, Sequence[str]],
    pairs: Sequence[tuple[int, int, float]],
) -> None:
    tiles = []
    for i, j, cosine in pairs:
        side_by_side = np.concatenate([pictures["a"][i], pictures["b"][j]], axis=1)
        caption = [f"{cosine:.4f}", f"{names['a'][i]} | {names['b'][j]}"]
        tiles.append(add_caption(side_by_side, caption))
    write_png(path, make_contact_sheet(tiles, columns=_PAIR_COLUMNS))


def _make_parser() -> argparse.ArgumentParser:
    made = make_parser("similarity", __doc__)
    made.add_argument("a", type=Path, metavar="A", help="manifest or folder of the first set")
    made.add_argument("b", type=Path, metavar="B", help="manifest or folder of the second set")
    made.add_argument("--split-a", metavar="NAME", help="split of A's manifest to take")
    made.add_argument("--split-b", metavar="NAME", help="split of B's manifest to take")
    made.add_argument("--network", choices=NETWORKS, default="resnet50", help="whose features are compared")
    made.add_argument(
        "--weights",
        default="imagenet",
        metavar="imagenet|PATH",
        help="Keras's own, or a file of this network",
    )
    made.add_argument(
        "--count", type=positive_int, default=500, metavar="N", help="pictures of each set, evenly spread"
    )
    made.add_argument(
        "--out", type=Path, default=Path("similarity"), metavar="DIR", help="folder of the pictures"
    )
    return made


if __name__ == "__main__":
    run_command(main)
