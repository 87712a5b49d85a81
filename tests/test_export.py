"""An exported run predicts what its run predicts; the shipped runs are small."""

import json

import numpy as np
import pytest
from scenes import only

from laesi_tf.common.errors import InputError
from laesi_tf.common.run_files import (
    BEST_MODEL_FILE,
    CONFIG_FILE,
    EXPORTED_WEIGHTS_FILE,
    PRETRAINED,
    RANGES_FILE,
)
from laesi_tf.export import main
from laesi_tf.exporting.float16 import compute_test_metrics, export_float16
from laesi_tf.models.saved_model import load_run
from laesi_tf.training import config_files
from laesi_tf.training.config import TrainConfig
from laesi_tf.training.initialisation import initialise_network

SIMPLE = f"without = {sorted(only('ruling').without)}\n"
"""Ranges with one component, in TOML."""
KERAS = ["--format", "keras", "--run"]


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    path = tmp_path_factory.mktemp("runs") / "area"
    config = TrainConfig(task="area", size=(64, 64), alpha=0.5, weights="none", ranges="rendering_2")
    model, origin = initialise_network(config)
    config_files.save_config(path / CONFIG_FILE, config, {"weights_origin": origin})
    model.save(path / BEST_MODEL_FILE)
    (path / RANGES_FILE).write_text(SIMPLE)
    return path


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ("--format keras --precision int8", "--precision has no effect with --format keras; .* litert"),
        (
            "--format package --precision float16",
            "--precision has no effect with --format package; .* litert",
        ),
        ("--format keras --scenes 16", "--scenes has no effect with --format keras; .* litert or package"),
        ("--format keras --photos p.csv", "--photos has no effect with --format keras; .* litert or package"),
        ("--format keras --split test", "--split has no effect with --format keras; .* litert or package"),
        ("--split test", "--split has no effect without --photos"),
        ("--format package --split test", "--split has no effect without --photos"),
        ("--photos p.csv --scenes 16", "--scenes has no effect with --photos"),
        ("--format package --photos p.csv --scenes 3", "--scenes has no effect with --photos"),
        ("--ruling-run r --precision int8", "--ruling-run has no effect with --precision int8"),
    ],
)
def test_options_without_effect_are_errors(options, message, tmp_path):
    with pytest.raises(InputError, match=message):
        main([*options.split(), "--out", str(tmp_path / "out")])
    assert not (tmp_path / "out").exists()


def test_an_exported_run_is_small_and_predicts_the_same(run, tmp_path):
    main([*KERAS, str(run), "--out", str(tmp_path / "small"), "--json", str(tmp_path / "figures.json")])
    images = np.random.default_rng(0).integers(0, 256, (3, 64, 64, 3)).astype(np.float32)
    first, second = (load_run(path).model(images, training=False) for path in (run, tmp_path / "small"))
    np.testing.assert_allclose(first, second, rtol=5e-3, atol=5e-3)
    figures = json.loads((tmp_path / "figures.json").read_text())
    assert figures["bytes"] == (tmp_path / "small" / EXPORTED_WEIGHTS_FILE).stat().st_size
    assert figures["bytes"] < 0.6 * (run / BEST_MODEL_FILE).stat().st_size
    assert figures["exported"]["mre"] == pytest.approx(figures["original"]["mre"], rel=0.02)


def test_a_ranges_file_is_exported_too(run, tmp_path, monkeypatch):
    trained = tmp_path / "trained"
    trained.mkdir()
    (trained / BEST_MODEL_FILE).write_bytes((run / BEST_MODEL_FILE).read_bytes())
    config = TrainConfig(
        task="area", size=(64, 64), alpha=0.5, weights="none", ranges="gone.toml", textures="/home/me/leaves"
    )
    config_files.save_config(trained / CONFIG_FILE, config, {"weights_origin": "none"})
    (trained / RANGES_FILE).write_text(f"lighting_passes = 1\n{SIMPLE}")
    monkeypatch.chdir(tmp_path)
    main([*KERAS, str(trained), "--out", "small"])
    exported = config_files.load_config(tmp_path / "small" / CONFIG_FILE)
    assert (exported.ranges, exported.textures) == ("ranges.toml", "leaves")
    assert set(compute_test_metrics(load_run("small"))) == {"mre", "median", "p90"}


def test_nothing_but_an_export_is_overwritten(run, tmp_path):
    original = load_run(run)
    for other in (run, run.parent):
        with pytest.raises(InputError, match="neither empty nor an exported run"):
            export_float16(original, other)
    export_float16(original, tmp_path / "small")
    export_float16(original, tmp_path / "small")


def test_a_broken_export_is_named(run, tmp_path):
    main([*KERAS, str(run), "--out", str(tmp_path)])
    whole = (tmp_path / EXPORTED_WEIGHTS_FILE).read_bytes()
    (tmp_path / EXPORTED_WEIGHTS_FILE).write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match=r"weights\.npz is broken"):
        load_run(tmp_path)


def test_the_shipped_models_are_small():
    assert sum(file.stat().st_size for file in PRETRAINED.rglob("*") if file.is_file()) < 14e6
