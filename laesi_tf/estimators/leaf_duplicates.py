"""Keep each leaf once of the candidates that overlapping crops show, and neighbours apart."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from laesi_tf.estimators.leaf_candidates import LeafCandidate


def remove_duplicates(candidates: Sequence[LeafCandidate]) -> list[LeafCandidate]:
    """Return `candidates`, largest first, without small fragments and without parts of larger ones.

    Neighbours that merge in fewer crops than show them apart are kept apart.
    """
    kept: list[LeafCandidate] = []
    ordered = sorted(candidates, key=lambda candidate: -candidate.area)
    for index, candidate in enumerate(ordered):
        is_fragment = bool(kept) and candidate.area < candidate.params.min_area_of_largest * kept[0].area
        if (
            not is_fragment
            and not candidate.is_covered_by(kept)
            and not _is_merged(candidate, ordered[index + 1 :], candidates)
        ):
            kept.append(candidate)
    return [replace(candidate, sightings=candidate.count_sightings(candidates)) for candidate in kept]


def _is_merged(
    candidate: LeafCandidate, smaller: Sequence[LeafCandidate], candidates: Sequence[LeafCandidate]
) -> bool:
    """Return whether more crops show two or more of the `smaller` candidates in place of `candidate`."""
    params, pixel = candidate.params, candidate.pixel_size
    least, most = (share * candidate.area for share in params.part_area)
    start, end = candidate.box[0] - pixel, candidate.box[1] + pixel
    inside = [
        part
        for part in smaller
        if least <= part.area <= most and (part.box[0] >= start).all() and (part.box[1] <= end).all()
    ]
    if len(inside) < 2:
        return False
    count = candidate.count_sightings(candidates)
    parts: list[LeafCandidate] = []
    for part in inside:
        if part.count_sightings(candidates) > count and not part.is_covered_by(parts):
            parts.append(part)
    if len(parts) < 2:
        return False
    centres = candidate.pixel_centres()
    covered = np.any([part.contains(centres) for part in parts], axis=0)
    return bool(covered.mean() >= params.merged_cover)
