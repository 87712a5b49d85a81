"""Write a web page that measures leaves on the phone that opens it; photos never leave the phone.

The folder holds static files for any web server that speaks HTTPS, which browsers demand for cameras and for
use without a network. Nothing is loaded from elsewhere, and once visited, the page works offline. --serve
shows it on this machine.
"""

from collections.abc import Sequence
from pathlib import Path

from laesi_tf.cli.arguments import make_parser
from laesi_tf.cli.console import run_command
from laesi_tf.cli.tensorflow_setup import load_tensorflow, suppress_stderr
from laesi_tf.common.atomic_files import require_writable, write_json
from laesi_tf.common.errors import InputError
from laesi_tf.common.network import parse_port_or_any
from laesi_tf.common.tensorflow import require_tensorflow


def main(arguments: Sequence[str]) -> None:
    """Run the command. Raises InputError for a file or a folder that cannot be used."""
    parser = make_parser("web", __doc__)
    parser.add_argument("--out", type=Path, metavar="DIR", help="folder to write")
    parser.add_argument(
        "--model",
        type=Path,
        metavar="FILE.tflite",
        help="the measurement, as laesi export writes it (default: convert the shipped networks)",
    )
    parser.add_argument("--serve", action="store_true", help="show the page on this machine until Ctrl-C")
    parser.add_argument(
        "--port", type=parse_port_or_any, default=8080, metavar="N", help="port of --serve, 0 for a free one"
    )
    parser.add_argument(
        "--fetch-runtime",
        action="store_true",
        help="first fetch LiteRT.js with npm, where the installation could not",
    )
    options = parser.parse_args(arguments)
    from laesi_tf.exporting.web.site import fetch_runtime, find_runtime, require_own_folder

    if options.fetch_runtime:
        fetch_runtime()
        if options.out is None:
            print("LiteRT.js is installed")
            return
    if options.out is None:
        raise InputError("name the folder to write with --out DIR; see --help")
    require_tensorflow()
    find_runtime()
    require_own_folder(options.out)
    require_writable(options.out / "index.html")
    size = _write(options.out, options.model)
    print(f"written: {options.out}, {size / 1e6:.1f} MB; it needs HTTPS on a phone")
    if options.json is not None:
        write_json(options.json, {"bytes": size})
    if options.serve:
        _serve(options.out, options.port)


def _write(out: Path, model: Path | None) -> int:
    from laesi_tf.exporting.web.models import PHOTO, read_photo_model

    models = {} if model is None else {PHOTO: read_photo_model(model)}
    load_tensorflow()
    from laesi_tf.exporting.printed_sheet import PAPERS, draw_sheet
    from laesi_tf.exporting.web.models import convert_models
    from laesi_tf.exporting.web.sentences import collect_sentences
    from laesi_tf.exporting.web.site import write_site

    print("converting the shipped networks; this takes a minute or more", flush=True)
    # The converter writes hundreds of lines to stderr.
    with suppress_stderr():
        models |= convert_models(without=models)
    documents = {f"sheet-{name}.pdf": draw_sheet(paper) for name, paper in PAPERS.items()}
    return write_site(out, models=models, documents=documents, sentences=collect_sentences())


def _serve(folder: Path, port: int) -> None:
    from laesi_tf.exporting.web.server import open_server

    with open_server(folder, port) as server:
        print(f"serving: http://localhost:{server.server_port}/", flush=True)
        server.serve_forever()


if __name__ == "__main__":
    run_command(main)
