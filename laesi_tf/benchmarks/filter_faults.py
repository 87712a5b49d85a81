"""Benchmark `filter`: which faults of repainted leaves the consistency filter rejects."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from laesi_tf.benchmarks.repainting_faults import FAULTS, PaintedLeaf
from laesi_tf.benchmarks.timing import format_row
from laesi_tf.common.hardware import describe_hardware
from laesi_tf.common.progress import progress_bar
from laesi_tf.data import synthetic
from laesi_tf.inpainting.base import MaskedImage, image_seed, restore_background
from laesi_tf.inpainting.consistency import LeafSegmenter, mask_deviation
from laesi_tf.inpainting.donor_leaves import load_donors
from laesi_tf.inpainting.exemplar import ExemplarInpainter


def measure_filter(
    *,
    count: int,
    seed: int,
    size: tuple[int, int],
    ranges: str,
    max_deviation: float,
    mask_run: Path | None = None,
    textures: Path | None = None,
    textures_split: str | None = None,
) -> dict[str, Any]:
    """Render `count` scenes, spoil each leaf in every way, and count what the filter rejects.

    With `textures`, the leaves are repainted from photos first (`ExemplarInpainter`, without imperfections).
    Returns the figures of each kind and severity: `missing`, the mean share of the mask that shows paper;
    `deviation`, the median that the filter measures; `rejected`, the share of images. Raises InputError.
    """
    segmenter = LeafSegmenter(mask_run)
    inpainter = None
    if textures is not None:
        inpainter = ExemplarInpainter(load_donors(textures, split=textures_split))
    cases = [(kind, severity) for kind, fault in FAULTS.items() for severity in fault.severities]
    missing, deviations = (np.zeros((len(cases), count)) for _ in range(2))
    scenes = synthetic.synthetic_samples(seed=seed, size=size, ranges=ranges, count=count, passes=1)
    for number, scene in enumerate(progress_bar(scenes.as_numpy_iterator(), total=count, unit="scene")):
        image, mask = scene["image"], scene["mask"] > 0
        own_seed = image_seed(seed, seed, number)
        if inpainter is not None:
            masked = MaskedImage(image=image, mask=mask, prompt="", species=None, seed=own_seed)
            image = restore_background(inpainter.repaint([masked])[0].image, image, mask)
        painted = PaintedLeaf(image, mask, np.random.default_rng(own_seed))
        faulty = [FAULTS[kind].apply(painted, severity) for kind, severity in cases]
        found = segmenter.segment([case.image for case in faulty])
        missing[:, number] = [1 - case.leaf.sum() / mask.sum() for case in faulty]
        deviations[:, number] = [mask_deviation(leaf, mask) for leaf in found]
    return {
        "count": count,
        "seed": seed,
        "size": list(size),
        "ranges": ranges,
        "leaves": "scenes" if textures is None else "exemplar",
        "max_deviation": max_deviation,
        "cases": [
            {
                "kind": kind,
                "severity": severity,
                "missing": float(missing[row].mean()),
                "deviation": float(np.median(deviations[row])),
                "rejected": float((deviations[row] > max_deviation).mean()),
            }
            for row, (kind, severity) in enumerate(cases)
        ],
        **describe_hardware(),
    }


def format_table(metrics: Mapping[str, Any]) -> str:
    """Format the figures of `measure_filter`."""
    lines = [format_row("fault", "missing", "deviation", "rejected")]
    cases: Sequence[Mapping[str, Any]] = metrics["cases"]
    for case in cases:
        name = f"{case['kind']} {case['severity']:.0%} {FAULTS[case['kind']].unit}".strip()
        cells = (f"{case[key]:.1%}" for key in ("missing", "deviation", "rejected"))
        lines.append(format_row("faithful" if case["kind"] == "faithful" else name, *cells))
    lines += [
        "missing: mean share of the mask that shows paper; deviation: median of what the filter measures;",
        f"rejected: images with a deviation above {metrics['max_deviation']:.0%}",
        "{count} images of {size[0]} x {size[1]} pixels each, seed {seed}, ranges {ranges}, "
        "leaves of {leaves}; {machine}, {cores} cores, {date}".format_map(metrics),
    ]
    return "\n".join(lines)
