"""Find the leaves on a photo: segment an overview, then zoom in on every component that may be a leaf.

The mask network was trained on images that a leaf fills to a third or more. In the overview of a whole sheet
small leaves are blurred and merge, but most are visible. The photo is cropped around each, closer and closer,
until the leaf fills its crop as in training. The overview misses some of several leaves: the photo is
searched again for what stands out from the sheet, for what has the colour of the leaves found, and in tiles
where leaves turn out to be small.
"""

from collections.abc import Callable, Iterator, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from laesi_tf.common.arrays import FloatMap, Points, RgbImage
from laesi_tf.common.geometry import ImageSize
from laesi_tf.data.letterbox import Letterbox, letterbox_image
from laesi_tf.estimators.boxes import largest_iou, square_around, stack_boxes
from laesi_tf.estimators.leaf_candidates import LeafCandidate, LeafDetectorParams, extract_candidates
from laesi_tf.estimators.leaf_colour import MAX_MEDIAN_SIDE, find_leaf_colour, largest_channel
from laesi_tf.estimators.leaf_duplicates import remove_duplicates
from laesi_tf.estimators.photo_pyramid import PhotoPyramid

MaskPredictor = Callable[[NDArray[np.uint8]], NDArray[np.float32]]
"""A mask network: uint8 [N, h, w, 3] -> leaf probability, float32 [N, h, w, 1]."""


class LeafDetector:
    """Finds leaves with a mask network."""

    def __init__(
        self, predict: MaskPredictor, input_size: tuple[int, int], params: LeafDetectorParams | None = None
    ) -> None:
        """Take a mask network and the (height, width) of its input."""
        self._predict = predict
        self._input_size = input_size
        self._params = params or LeafDetectorParams()

    def find_leaves(self, pyramid: PhotoPyramid) -> list[LeafCandidate]:
        """Return the leaves on a photo, the largest first."""
        params = self._params
        longer = float(max(pyramid.size))
        overview, letterbox = pyramid.letterbox_overview(self._input_size)
        probability = self._predict(overview[np.newaxis])[0, ..., 0]
        components = self._extract(pyramid, probability, letterbox, params.overview_probability)
        found = remove_duplicates(self._zoom_in(pyramid, components, params.first_crop_of_photo * longer))
        if not found:
            found = self._add_leaves_from_tiles(pyramid, found, params.blank_overview_leaf * longer)
            found = self._add_leaves_by_contrast(pyramid, found)
            found = found[:1] + self._confirm_at_lower_zoom(pyramid, found[1:])
            # Print and pen strokes look like leaves in tiles.
            return [leaf for leaf in found if not leaf.colour.is_ink(params.colour)]
        typical = float(np.median([candidate.length for candidate in found]))
        found = self._add_leaves_by_contrast(pyramid, found)
        if typical < params.tiled_below * longer:
            found = self._add_leaves_from_tiles(pyramid, found, typical)
        found = found[:1] + self._confirm_at_lower_zoom(pyramid, found[1:])
        return self._add_leaves_by_colour(pyramid, found)

    def _extract(
        self, pyramid: PhotoPyramid, values: FloatMap, letterbox: Letterbox, threshold: float
    ) -> list[Points]:
        """Return the boxes of the components of `values` [h, w] in the overview."""
        components = extract_candidates(pyramid, pyramid.overview, values, letterbox, threshold, self._params)
        return [component.box for component in components]

    def _add_leaves_by_contrast(
        self, pyramid: PhotoPyramid, found: list[LeafCandidate]
    ) -> list[LeafCandidate]:
        """Add leaves that stand out from the sheet; of a single leaf nothing is added.

        The network misses some of several leaves in one crop.
        """
        if len(found) < 2:
            return found
        overview, letterbox = pyramid.letterbox_overview(self._input_size)
        marked = self._segment_by_contrast(overview, letterbox)
        more = self._zoom_in(pyramid, self._extract(pyramid, marked, letterbox, 0.5), 0.0)
        return remove_duplicates(found + self._drop_small(more, found))

    def _add_leaves_by_colour(self, pyramid: PhotoPyramid, found: list[LeafCandidate]) -> list[LeafCandidate]:
        """Add leaves, also small ones, of the colour of those `found`, which other things seldom have.

        What the photo cuts off is none and shows no leaf's colour: desks and rulers end there.
        """
        whole = [candidate for candidate in found if not candidate.is_cut_off(pyramid.size)]
        if not whole:
            return found
        outlines = [candidate.outline() for candidate in found]
        boxes = find_leaf_colour(pyramid, outlines, self._params.colour).find_boxes()
        leaves = np.stack([candidate.colour.lab for candidate in whole])

        def looks_like_leaf(candidate: LeafCandidate) -> bool:
            difference = np.linalg.norm(leaves - candidate.colour.lab, axis=1).min()
            is_alike = difference < self._params.max_difference_from_found
            return bool(is_alike) and not candidate.is_cut_off(pyramid.size)

        return remove_duplicates(found + list(filter(looks_like_leaf, self._zoom_in(pyramid, boxes, 0.0))))

    def _add_leaves_from_tiles(
        self, pyramid: PhotoPyramid, found: list[LeafCandidate], typical: float
    ) -> list[LeafCandidate]:
        """Add leaves of about `typical` photo pixels in length that tiles of the photo show."""
        tiles = list(self._tile_photo(pyramid.size, typical))
        visible = self._segment_crops(pyramid, tiles, self._params.overview_probability)
        boxes = [
            candidate.box
            for candidate in visible
            if candidate.is_inside_crop and not candidate.is_covered_by(found)
        ]
        more = self._zoom_in(pyramid, boxes, self._params.first_crop_of_leaf * typical)
        return remove_duplicates(found + self._drop_small(more, found))

    def _segment_by_contrast(self, overview: RgbImage, letterbox: Letterbox) -> FloatMap:
        """Return 1 where `overview`, uint8 [h, w, 3], differs in colour from the sheet, else 0: float32."""
        side = min(MAX_MEDIAN_SIDE, min(letterbox.extent) // 3 | 1)
        difference = largest_channel(cv2.absdiff(overview, cv2.medianBlur(overview, side)))
        threshold, _ = cv2.threshold(difference, 0, 255, cv2.THRESH_OTSU)
        marked = (difference > max(threshold, self._params.min_contrast)).astype(np.uint8)
        return cv2.morphologyEx(marked, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)).astype(np.float32)

    def _drop_small(
        self, candidates: Sequence[LeafCandidate], found: Sequence[LeafCandidate]
    ) -> list[LeafCandidate]:
        """Return `candidates` without those that are much smaller than the leaves `found` before."""
        areas = [candidate.area for candidate in found or candidates]
        least = self._params.min_area_of_median * float(np.median(areas)) if areas else 0.0
        return [candidate for candidate in candidates if candidate.area >= least]

    def _confirm_at_lower_zoom(
        self, pyramid: PhotoPyramid, candidates: Sequence[LeafCandidate]
    ) -> list[LeafCandidate]:
        """Return the `candidates` that look the same in a wider crop, as print and marks do not."""
        side = self._params.confirmation_side
        boxes = [square_around(candidate.box, side * candidate.length) for candidate in candidates]
        again = self._segment_crops(pyramid, boxes, self._params.leaf_probability)
        seen = stack_boxes([candidate.box for candidate in again])
        least = self._params.confirmation_iou
        return [candidate for candidate in candidates if largest_iou(candidate.box, seen) > least]

    def _tile_photo(self, size: ImageSize, leaf: float) -> Iterator[Points]:
        """Yield overlapping squares [2, 2] over a photo whose leaves are `leaf` pixels long."""
        side = min(self._params.tile_side * leaf, float(min(size)))
        stride = self._params.tile_stride * leaf
        columns, rows = (max(1, int(np.ceil((length - side) / stride)) + 1) for length in size.xy)
        for top in np.linspace(0, size.height - side, rows):
            for left in np.linspace(0, size.width - side, columns):
                yield np.array([[left, top], [left + side, top + side]])

    def _zoom_in(
        self, pyramid: PhotoPyramid, boxes: Sequence[Points], min_side: float
    ) -> list[LeafCandidate]:
        """Crop the photo around `boxes`, closer and closer, until each component fills its crop.

        The first crops have a side of at least `min_side` photo pixels.
        """
        params = self._params
        found: list[LeafCandidate] = []
        tried: list[Points] = []
        waiting = self._drop_similar_boxes(boxes, tried)
        for _ in range(params.max_rounds):
            tried += waiting
            tried_boxes, following = stack_boxes(tried), []
            crops = [self._crop_square(box, min_side) for box in waiting]
            min_side = 0.0
            for candidate in self._segment_crops(pyramid, crops, params.leaf_probability):
                if candidate.fill_ratio < params.negligible_fill:
                    continue
                was_tried = largest_iou(candidate.box, tried_boxes) > params.duplicate_iou
                if not candidate.is_inside_crop:
                    following.append(self._crop_square(candidate.box, 0.0))
                elif was_tried or params.min_fill <= candidate.fill_ratio <= params.max_fill:
                    found.append(candidate)
                else:
                    following.append(candidate.box)
            waiting = self._drop_similar_boxes(following, tried)
        return found

    def _segment_crops(
        self, pyramid: PhotoPyramid, boxes: Sequence[Points], threshold: float
    ) -> list[LeafCandidate]:
        """Return the components above a threshold in a crop of each box."""
        step = self._params.max_crops
        batches = (boxes[first : first + step] for first in range(0, len(boxes), step))
        return [
            candidate for batch in batches for candidate in self._segment_batch(pyramid, batch, threshold)
        ]

    def _segment_batch(
        self, pyramid: PhotoPyramid, boxes: Sequence[Points], threshold: float
    ) -> list[LeafCandidate]:
        sides = {"min_side": self._params.min_crop_px, "max_side": self._params.max_crop_px}
        crops = [pyramid.crop_around(box, **sides) for box in boxes]
        inputs = [letterbox_image(crop.image, self._input_size) for crop in crops]
        probabilities = self._predict(np.stack([image for image, _ in inputs]))[..., 0]
        return [
            candidate
            for crop, probability, (_, letterbox) in zip(crops, probabilities, inputs, strict=True)
            for candidate in extract_candidates(
                pyramid, crop, probability, letterbox, threshold, self._params
            )
        ]

    def _drop_similar_boxes(self, boxes: Sequence[Points], tried: Sequence[Points]) -> list[Points]:
        """Return `boxes` without those that overlap much with another of them or with one of `tried`."""
        most, tried_boxes = self._params.duplicate_iou, stack_boxes(tried)
        kept: list[Points] = []
        for box in boxes:
            if len(kept) == self._params.max_crops:
                break
            if largest_iou(box, tried_boxes) <= most and largest_iou(box, stack_boxes(kept)) <= most:
                kept.append(box)
        return kept

    def _crop_square(self, box: Points, min_side: float) -> Points:
        """Return the square [2, 2] to crop around `box`, at least `min_side` photo pixels wide."""
        side = self._params.crop_side * float((box[1] - box[0]).max())
        return square_around(box, max(min_side, side))
