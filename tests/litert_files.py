"""LiteRT files of the graphs, with a stand-in for the mask network."""

import subprocess
import sys
from pathlib import Path

SIZE = (224, 224)


def write_photo_file(path: Path) -> None:
    """Convert the graph in a process of its own: it takes 3 GB, which a worker would keep."""
    command = f"import litert_files, pathlib; litert_files.convert_photo_file(pathlib.Path({str(path)!r}))"
    subprocess.run([sys.executable, "-c", command], check=True, cwd=Path(__file__).parent)


def write_guidance_file(path: Path) -> None:
    """Convert the graph of hints, with the same stand-in."""
    from green import mask_network

    from laesi_tf.common.run_files import PRETRAINED
    from laesi_tf.estimators.graph.guidance_graph import GuidanceGraph
    from laesi_tf.estimators.litert_file import write_litert_file
    from laesi_tf.exporting.litert import convert, describe
    from laesi_tf.models.saved_model import load_run

    graph = GuidanceGraph(mask_network(SIZE), load_run(PRETRAINED / "ruling").model)
    model = convert(graph.guide.get_concrete_function(), "float32")
    write_litert_file(path, model, describe("guidance", {}))


def convert_photo_file(path: Path) -> None:
    """Convert the graph here."""
    from green import mask_network

    from laesi_tf.common.run_files import PRETRAINED
    from laesi_tf.estimators.graph.photo_graph import PhotoGraph
    from laesi_tf.estimators.keras_networks import load_run_of
    from laesi_tf.estimators.litert_file import write_litert_file
    from laesi_tf.estimators.ruling.ruling_graph import RulingGraph
    from laesi_tf.exporting.litert import convert, describe

    graph = PhotoGraph(mask_network(SIZE), RulingGraph(load_run_of("ruling", PRETRAINED / "ruling").model))
    model = convert(graph.measure.get_concrete_function(), "float32")
    write_litert_file(path, model, describe("photo", {}))
