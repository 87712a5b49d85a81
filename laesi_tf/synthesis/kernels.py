"""Every XLA-compiled stage of the renderer, in its order, named after the plain function that it compiles.

Op by op, each sum or product of an image is a pass over memory, about sixty of them per image, and
dispatching the ops costs as much again. Compiled, synthesis makes 2.06 times as many images per second on a
CPU; it takes 12.2 instead of 3.9 seconds of CPU to start (224 x 224 pixels, preset `rendering_2`). Each call
costs about 50 microseconds, so stages are few and large.

What XLA makes ten to a thousand times slower stays outside, in plain TensorFlow: adding into cells one by one
(`rasterizer.sum_contributions`), searching a sorted list (`geometry.find_segments`), and cutting a window
from a constant (`recording.cut_sensor_noise`). So does the codec of JPEG (`file.compress`), which XLA lacks.
And what finds the entries of a table must not be compiled together with what looks them up
(`ruling.compute_ruling_cells`, `sheet.paint_sheet_and_desk`).
"""

from laesi_tf.synthesis import scene_layout
from laesi_tf.synthesis.camera import file, imaging, recording
from laesi_tf.synthesis.leaf import outline, painting
from laesi_tf.synthesis.paper import ruling, sheet
from laesi_tf.synthesis.props import drawing
from laesi_tf.synthesis.xla import compile_with_xla

trace_outline = compile_with_xla(outline.trace_outline)
compute_layout = compile_with_xla(scene_layout.compute_layout)
compute_ruling_cells = compile_with_xla(ruling.compute_ruling_cells)
paint_sheet_and_desk = compile_with_xla(sheet.paint_sheet_and_desk)
rasterise_prop = compile_with_xla(drawing.rasterise_prop)
leaf_contributions = compile_with_xla(scene_layout.leaf_contributions)
composite_leaf = compile_with_xla(painting.composite_leaf)
# Where lighting passes share a leaf, `composite_leaf` in two parts:
paint_leaf = compile_with_xla(painting.paint_leaf)
shade_leaf = compile_with_xla(painting.shade_leaf)
apply_light_and_tone = compile_with_xla(imaging.apply_light_and_tone)
apply_focus_blur = compile_with_xla(imaging.apply_focus_blur)
add_sensor_noise = compile_with_xla(recording.add_sensor_noise)
sharpen = compile_with_xla(file.sharpen)
record = compile_with_xla(recording.record)
# Where a file keeps colour at half the resolution, instead of `record`:
subsample_chroma = compile_with_xla(recording.subsample_chroma)
record_with_chroma = compile_with_xla(recording.record_with_chroma)
