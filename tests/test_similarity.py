"""Similarity of two sets of images."""

import json
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scenes import only

from laesi_tf import similarity
from laesi_tf.common.errors import InputError
from laesi_tf.data.image_sets import find_images, load_images
from laesi_tf.evaluation.feature_similarity import find_closest_pairs, nearest_cosines
from laesi_tf.generate import main as generate
from laesi_tf.models.backbone import build_backbone
from laesi_tf.models.image_embedding import NETWORKS, load_embedder

SIZE = (64, 64)


@pytest.fixture(scope="module")
def weights(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A file of MobileNetV3 Small with random weights: as good as any to test what is done with features."""
    path = tmp_path_factory.mktemp("weights") / "small.weights.h5"
    build_backbone("small", size=SIZE, weights="none")[0].save_weights(path)
    return path


def folder(path: Path, hues: list[int], *, manifest: bool = False) -> Path:
    """Pictures that differ in colour alone."""
    path.mkdir()
    for number, hue in enumerate(hues):
        image = cv2.cvtColor(np.full((80, 60, 3), (hue, 200, 220), np.uint8), cv2.COLOR_HSV2BGR)
        cv2.imwrite(str(path / f"{number}.png"), image)
    if manifest:
        lines = [f"{number}.png,1,{'val' if number % 2 else 'train'}" for number in range(len(hues))]
        (path / "manifest.csv").write_text("\n".join(["image,area_cm2,split", *lines]))
    return path


@given(seed=st.integers(0, 99), count=st.integers(2, 9), others=st.integers(1, 9))
def test_nearest_is_the_largest_cosine_to_another(seed: int, count: int, others: int) -> None:
    random = np.random.default_rng(seed)
    a, b = (random.normal(size=(n, 5)) for n in (count, others))
    a, b = (x / np.linalg.norm(x, axis=1, keepdims=True) for x in (a, b))
    expected = [max(float(x @ y) for y in b) for x in a]
    np.testing.assert_allclose(nearest_cosines(a, b), expected)
    within = [max(float(a[i] @ a[j]) for j in range(count) if i != j) for i in range(count)]
    np.testing.assert_allclose(nearest_cosines(a), within)


def test_closest_pairs_are_in_order_and_use_an_image_of_a_once() -> None:
    cosines = np.array([[0.9, 0.8], [0.1, 0.95], [0.2, 0.3]])
    assert find_closest_pairs(cosines, 2) == [(1, 1, 0.95), (0, 0, 0.9)]


def test_features_have_unit_length_and_are_close_for_similar_images(weights: Path) -> None:
    random = np.random.default_rng(0)
    images = random.integers(0, 256, (40, *SIZE, 3), np.uint8)
    images[1] = images[0] // 2 * 2
    network = load_embedder("small", size=SIZE, weights=str(weights))
    features = network(images)
    assert "small.weights.h5" in network.origin and features.shape == (40, 576)
    np.testing.assert_allclose(np.linalg.norm(features, axis=1), 1, rtol=1e-5)
    assert int(np.argmax(features[0] @ features[1:].T)) == 0
    one_by_one = np.concatenate([network(images[i : i + 1]) for i in range(3)])
    np.testing.assert_allclose(features[:3], one_by_one, atol=1e-5)


@pytest.mark.parametrize("weights", ["none", "auto"])
def test_an_untrained_network_is_refused(weights: str) -> None:
    with pytest.raises(InputError, match="use imagenet or a file"):
        load_embedder("small", size=SIZE, weights=weights)


def test_weights_of_another_network_are_refused(weights: Path) -> None:
    with pytest.raises(InputError, match="does not hold weights of ResNet50"):
        load_embedder("resnet50", size=SIZE, weights=str(weights))


def test_sets_come_as_folders_manifests_and_records(tmp_path: Path) -> None:
    plain = folder(tmp_path / "plain", list(range(0, 100, 10)))
    (plain / "broken.png").write_bytes(b"not an image")
    images, names, unread = load_images(find_images(plain), size=SIZE, count=20)
    assert images.shape == (10, *SIZE, 3) and len(names) == 10
    assert len(unread) == 1 and "broken.png" in unread[0]
    images, names, _ = load_images(find_images(plain), size=SIZE, count=3)
    assert len(images) == 2 and names == ["0.png", "5.png"]  # the last of the three is the broken one
    listed = folder(tmp_path / "listed", [0, 50, 100], manifest=True)
    assert load_images(find_images(listed, split="val"), size=SIZE, count=9)[1] == ["1.png"]
    ranges = tmp_path / "simple.toml"
    ranges.write_text(f"without = {sorted(only('ruling').without)}\n")
    options = ["--count", "6", "--per-shard", "4", "--size", "48", "--ranges", str(ranges)]
    generate([*options, "--out", str(tmp_path / "records")])
    images, names, _ = load_images(find_images(tmp_path / "records"), size=SIZE, count=3)
    assert images.shape == (3, *SIZE, 3) and names == ["image 0", "image 2", "image 5"]


def test_what_is_no_set_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no images at"):
        find_images(tmp_path / "nothing")
    empty = tmp_path / "empty"
    empty.mkdir()
    with pytest.raises(InputError, match="no images in"):
        find_images(empty)
    with pytest.raises(InputError, match="no split 'val'"):
        find_images(empty, split="val")
    (empty / "broken.png").write_bytes(b"not an image")
    with pytest.raises(InputError, match=r"no image in .* can be read; the first: .*broken\.png"):
        load_images(find_images(empty), size=SIZE, count=3)


def test_an_empty_folder_is_refused_before_tensorflow_starts(tmp_path: Path) -> None:
    reds = folder(tmp_path / "reds", [0, 1, 2, 3])
    (tmp_path / "empty").mkdir()
    script = (
        "import sys\n"
        "from laesi_tf import similarity\n"
        "from laesi_tf.common.errors import InputError\n"
        "try: similarity.main(sys.argv[1:])\n"
        "except InputError as error: print(error, 'tensorflow' in sys.modules)\n"
    )
    arguments = [str(reds), str(tmp_path / "empty"), "--out", str(tmp_path / "out")]
    done = subprocess.run([sys.executable, "-c", script, *arguments], capture_output=True, text=True)
    assert "no images in" in done.stdout and done.stdout.endswith("False\n"), done.stderr


def test_the_command_offers_every_network() -> None:
    assert similarity._NETWORKS == NETWORKS


def test_similar_sets_have_higher_cosines(weights: Path, tmp_path: Path, capsys) -> None:
    reds = folder(tmp_path / "reds", [0, 1, 2, 3])
    also_reds = folder(tmp_path / "also_reds", [0, 1, 2, 4])
    blues = folder(tmp_path / "blues", [110, 112, 114, 116])
    figures = {}
    for name, other in (("alike", also_reds), ("unlike", blues)):
        out = tmp_path / name
        network = ["--network", "small", "--weights", str(weights)]
        similarity.main(
            [str(reds), str(other), *network, "--out", str(out), "--json", str(tmp_path / f"{name}.json")]
        )
        figures[name] = json.loads((tmp_path / f"{name}.json").read_text())
        assert {path.name for path in out.iterdir()} >= {"violins.png", "umap.png", "pairs.png"}
        assert len((out / "similarity.csv").read_text().splitlines()) == 5
    assert "small.weights.h5" in capsys.readouterr().out
    assert figures["alike"]["a_to_b_median"] > figures["unlike"]["a_to_b_median"]
    assert figures["alike"]["a_to_b_p10"] <= figures["alike"]["a_to_b_median"] <= 1 + 1e-6
