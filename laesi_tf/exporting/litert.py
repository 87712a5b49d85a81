"""Convert networks, and the whole measurement, to LiteRT graphs of several precisions.

A graph of kind `photo` is the whole measurement of `estimators.graph`; `guidance` says what is missing in a
preview; kinds `area` and `mask` are one network. The geometry of `photo` stays float32 in every variant, so
int8 is for the networks alone.
"""

import math
import warnings
from collections.abc import Callable, Sequence
from typing import Any

import tensorflow as tf
from tensorflow.lite.tools import flatbuffer_utils

from laesi_tf.common.arrays import RgbImage
from laesi_tf.common.errors import InputError
from laesi_tf.estimators.graph.guidance_graph import GuidanceGraph, Hint
from laesi_tf.estimators.graph.guidance_measures import PART_PLACES, TILE_PX, VIEW_PX
from laesi_tf.estimators.graph.photo_graph import GRID_NODES, PhotoGraph
from laesi_tf.estimators.ruling.codes import CUT_OFF, TOUCHED, PitchNote, Refusal
from laesi_tf.estimators.ruling.ruling_graph import RulingGraph
from laesi_tf.exporting.half_weights import halve_weights
from laesi_tf.models.area_network import LARGEST_CM2, SMALLEST_CM2
from laesi_tf.models.inference import freeze_network
from laesi_tf.models.ruling_cells import FRAME_PX
from laesi_tf.models.saved_model import Run

VARIANTS = {
    "photo": ("float32", "float16", "dynamic"),
    "area": ("float32", "float16", "dynamic", "int8"),
    "mask": ("float32", "float16", "dynamic", "int8"),
}
"""Precisions by kind. `dynamic` has int8 weights and computes in float; `int8` computes in int8."""

_FLOAT_OPERATIONS = ["FULLY_CONNECTED", "EXP", "LOGISTIC", "RESIZE_BILINEAR"]
_STEM_OPERATIONS = 6

Calibration = Sequence[RgbImage]
"""Images, uint8 [h, w, 3] of the network's size, from which the ranges of int8 activations are taken."""


class NetworkGraph(tf.Module):
    """One network as a graph of one image."""

    def __init__(self, run: Run) -> None:
        """Take a run of task `area` or `mask`."""
        super().__init__(name=run.spec.task)
        self._network = freeze_network(run.model)
        self._transform = run.spec.transform
        finish = {"area": self._to_area, "mask": self._to_mask}[run.spec.task]
        photo = tf.TensorSpec([*run.spec.size, 3], tf.uint8, "photo")
        self.predict: Any = tf.function(
            lambda photo: finish(self._network(tf.cast(photo, tf.float32)[tf.newaxis])),
            input_signature=[photo],
            autograph=False,
        )

    def _to_area(self, output: tf.Tensor) -> dict[str, tf.Tensor]:
        """Return cm2 from the transformed area, as `to_area_cm2`."""
        value = output[0, 0]
        if self._transform == "log":
            value = tf.exp(tf.clip_by_value(value, tf.math.log(SMALLEST_CM2), tf.math.log(LARGEST_CM2)))
        elif self._transform == "sqrt":
            value = tf.maximum(value, 0.0) ** 2
        area = tf.clip_by_value(value, SMALLEST_CM2, LARGEST_CM2)
        px_per_mm = tf.exp(output[0, 1]) if output.shape[1] > 1 else tf.constant(math.nan)
        return {"area_cm2": area, "px_per_mm": px_per_mm}

    def _to_mask(self, output: tf.Tensor) -> dict[str, tf.Tensor]:
        return {"leaf": output[0, ..., 0]}


def build_graph(kind: str, mask_run: Run, ruling_run: Run, area_run: Run) -> Any:
    """Return the concrete function of a kind. Raises InputError for a network that a photo's graph cannot
    hold."""
    if kind == "guidance":
        return GuidanceGraph(mask_run.model, ruling_run.model).guide.get_concrete_function()
    if kind != "photo":
        return NetworkGraph({"area": area_run, "mask": mask_run}[kind]).predict.get_concrete_function()
    height, width = mask_run.spec.size
    if height != width or height % 56:
        raise InputError(
            f"{mask_run.path} has an input of {height} x {width} pixels; the graph needs a square of a "
            "multiple of 56, such as 224"
        )
    return PhotoGraph(mask_run.model, RulingGraph(ruling_run.model)).measure.get_concrete_function()


def convert(function: Any, variant: str, calibration: Calibration = ()) -> bytes:
    """Convert a concrete function, such as that of `build_graph`, to a variant; int8 needs `calibration`."""
    # Its weights are constants, so that no module need hold them; of a module, each function is traced anew.
    converter = tf.lite.TFLiteConverter.from_concrete_functions([function], tf.Module())
    # A hash of the file in the file, for which Python takes the whole graph apart twice.
    converter.exclude_conversion_metadata = True
    if variant == "float16":
        return halve_weights(bytes(converter.convert()))
    if variant != "float32":
        converter.optimizations = [tf.lite.Optimize.DEFAULT]
    if variant == "int8":
        converter.representative_dataset = lambda: ([tf.constant(image)] for image in calibration)
        return _quantise_selectively(converter)
    return bytes(converter.convert())


def _quantise_selectively(converter: Any) -> bytes:
    """Return a graph that computes in int8, but for operations that int8 breaks and that cost little.

    A logarithm of an area in steps of 1/255 of its range is 2 % off, so dense layers, sigmoids and the mask's
    resizing stay float. So do the convolutions of squeeze-excite branches: of some, all weights are about 0,
    and LiteRT refuses scales of 1e-9.
    """
    lite = tf.lite.experimental
    # It warns of the interpreter that it uses itself.
    warnings.filterwarnings("ignore", message=".*tf.lite.Interpreter is deprecated", category=UserWarning)
    debugger = lite.QuantizationDebugger(converter=converter, debug_dataset=converter.representative_dataset)
    calibrated = flatbuffer_utils.convert_bytearray_to_object(bytearray(debugger.calibrated_model))
    (graph,) = calibrated.subgraphs
    outputs = [graph.tensors[operator.outputs[0]] for operator in graph.operators]
    stem = outputs[:_STEM_OPERATIONS]
    shapes = [[] if tensor.shape is None else list(tensor.shape) for tensor in outputs]
    small = [
        tensor
        for tensor, shape in zip(outputs, shapes, strict=True)
        if math.prod(shape) <= (shape or [1])[-1]
    ]
    debugger.options = lite.QuantizationDebugOptions(
        denylisted_ops=_FLOAT_OPERATIONS, denylisted_nodes=[tensor.name.decode() for tensor in stem + small]
    )
    return bytes(debugger.get_nondebug_quantized_model())


def describe(kind: str, runs: dict[str, str]) -> dict[str, Any]:
    """Return the metadata of a file of `kind`; `runs` names each network's origin by task."""
    shared = {
        "format": "laesi_tf",
        "version": 1,
        "kind": kind,
        "licence": "Apache-2.0",
        "networks": runs,
    }
    return shared | _DESCRIPTIONS[kind]()


def _describe_photo() -> dict[str, Any]:
    return {
        "input_size": [FRAME_PX, FRAME_PX],
        "inputs": {
            "photo": f"uint8 [{FRAME_PX}, {FRAME_PX}, 3] RGB, upright, shrunk by area means to at most "
            f"{FRAME_PX} pixels in the upper left corner; the rest is 0",
            "size": "int32 [2], height and width of the photo in it",
            "grid_mm": "float32, distance of the finest lines in mm; 0 where unknown",
            "px_per_mm": "float32, pixels of the frame per mm where known, such as a scanner's; 0 reads the "
            "ruling",
        },
        "outputs": {
            "count": "int32, number of leaves, at most 16; they come first, the largest before the others",
            "area_cm2": "float32 [16], flat one-sided area, cm2; 0 where refused",
            "uncertainty_cm2": "float32 [16], one standard deviation, cm2",
            "length_mm": "float32 [16], along the main axis",
            "width_mm": "float32 [16], across it",
            "leaf_px_per_mm": "float32 [16], scale at the leaf, pixels of the frame",
            "mask": "uint8 [16, s, s], probability of leaf x 255",
            "square": "float32 [16, 3], left, top and side of the mask in the frame, pixels",
            "flags": "int32 [16], bits: "
            + f"{CUT_OFF} the photo's border cuts the leaf off, {TOUCHED} something not paper touches it",
            "refusal": "int32, see refusals; no areas unless 0",
            "note": "int32, see notes",
            "beside": "int32, possible leaves beside the ruled sheet, or parts of other things, not counted",
            "uncounted": "int32, things on the sheet that have a leaf's colour, not counted",
            "uncounted_share": "float32, their area over that of the leaves",
            "px_per_mm": "float32, scale at the largest leaf, pixels of the frame",
            "tilt_deg": "float32, between the camera's axis and the paper's normal",
            "confidence": "float32 0..1, how well the lines follow the fit",
            "sheet": "float32 [14], from frame to lines, see SheetModel: lines lie at whole numbers",
            "grid": f"float32 [{GRID_NODES}, {GRID_NODES}, 2], how many lines lie left of and above points "
            "at equal distances over the photo, for drawing",
            "pitch_mm": "float32, distance of those lines, mm; 0 without a ruling",
            "period_px": "float32, distance of the finest lines that were seen, pixels of the frame",
        },
        "refusals": {str(int(code)): code.name.lower() for code in Refusal},
        "notes": {str(int(code)): code.name.lower() for code in PitchNote},
    }


def _describe_area() -> dict[str, Any]:
    return {
        "inputs": {"photo": "uint8 [h, w, 3] RGB, the whole photo, letterboxed"},
        "outputs": {
            "area_cm2": "float32, area of one leaf, cm2",
            "px_per_mm": "float32, scale at the leaf, pixels of the input; NaN where the network has none",
        },
    }


def _describe_mask() -> dict[str, Any]:
    return {
        "inputs": {"photo": "uint8 [h, w, 3] RGB, letterboxed"},
        "outputs": {"leaf": "float32 [h, w], probability of leaf"},
    }


def _describe_ruling() -> dict[str, Any]:
    return {"inputs": "as RulingGraph.ask_network in estimators.ruling.ruling_graph; images of any size"}


def _describe_reading() -> dict[str, Any]:
    return {
        "inputs": "as the methods of RulingGraph in estimators.ruling.ruling_graph, a signature for each",
        "refusals": {str(int(code)): code.name.lower() for code in Refusal},
        "notes": {str(int(code)): code.name.lower() for code in PitchNote},
    }


def _describe_guidance() -> dict[str, Any]:
    return {
        "input_size": [VIEW_PX, VIEW_PX],
        "frame_size": [FRAME_PX, FRAME_PX],
        "part_size": TILE_PX,
        "part_places": PART_PLACES,
        "inputs": {
            "view": f"uint8 [{VIEW_PX}, {VIEW_PX}, 3] RGB, the preview, shrunk by area means to a longer "
            f"side of {VIEW_PX} pixels, in the upper left corner; the rest is 0",
            "size": "int32 [2], height and width of the preview in it",
            "parts": f"uint8 [{VIEW_PX}, {VIEW_PX}, 3] RGB, four squares of {TILE_PX} pixels around the "
            "places part_places of the preview's height and width, at its own resolution, row by row",
            "frame_px": f"float32, {FRAME_PX} over the preview's longer side in pixels",
        },
        "outputs": {
            "hint": "int32, see hints",
            "brightness": "float32, mean grey level",
            "sharpness": "float32, share of the power of fine detail that is finer still",
            "one_sidedness": "float32, 0 if edges run in all directions, 1 if in one",
            "cells": "float32, cells of 16 pixels that show a ruling",
            "seen": "float32, share of them that shows it in the parts, too",
            "period_px": "float32, distance of the finest lines that are seen, pixels of the photo's frame",
            "hidden": "float32, share of cells that may hide finer lines",
            "tilt_deg": "float32, between the camera's axis and the paper's normal",
            "leaf_share": "float32, share of the view that is leaf",
            "on_border": "float32, network pixels of leaf on the view's border",
            "on_sheet": "float32, share of the leaf on the ruled sheet",
            "evenness": "float32, darkest tenth of the sheet over the brightest",
        },
        "hints": {str(int(code)): code.name.lower() for code in Hint},
    }


_DESCRIPTIONS: dict[str, Callable[[], dict[str, Any]]] = {
    "photo": _describe_photo,
    "area": _describe_area,
    "mask": _describe_mask,
    "ruling": _describe_ruling,
    "reading": _describe_reading,
    "guidance": _describe_guidance,
}
