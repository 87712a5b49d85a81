"""inpaint --model controlnet: a tiny pipeline with random weights goes all the way of the real one."""

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from record_sets import SPEC, render_samples
from tiny_diffusion import save_tiny_models

from laesi_tf import inpaint
from laesi_tf.common.errors import InputError
from laesi_tf.data import tfrecords
from laesi_tf.data.canny import species_prompt
from laesi_tf.data.dataset_spec import DatasetSpec, start_dataset
from laesi_tf.data.decoding import decode_mask, decode_photo
from laesi_tf.data.image_folders import merge_manifests, write_shard_folder
from laesi_tf.data.manifest import MANIFEST_FILE, read_manifest
from laesi_tf.data.mixture_sources import RecordsSource, SourceContext
from laesi_tf.data.stored_samples import StoredSample, read_records
from laesi_tf.inpainting import diffusion_models
from laesi_tf.inpainting.base import MaskedImage
from laesi_tf.inpainting.controlnet import ControlNetInpainter, ControlNetSettings, working_size

Run = Callable[..., Path]
OPTIONS = ("--size", "64", "--steps", "2")


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    base, controlnet = save_tiny_models(tmp_path_factory.mktemp("models"))
    return ["--base", str(base), "--controlnet", str(controlnet)]


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three shards of 4, 4 and 2 images of oaks and beeches."""
    folder = tmp_path_factory.mktemp("source") / "set"
    write_source(folder, SPEC)
    return folder


def write_source(folder: Path, spec: DatasetSpec) -> None:
    start_dataset(folder, spec)
    pairs = [(sample, species(number)) for number, sample in enumerate(render_samples())]
    for shard in range(spec.shards):
        write = write_shard_folder if spec.format == "folder" else tfrecords.write_samples
        write(folder / spec.shard_name(shard), iter([pairs[i] for i in spec.sample_indices(shard)]), spec)
    if spec.format == "folder":
        merge_manifests(folder, spec)


def species(number: int) -> str:
    return "oak" if number % 2 else "beech"


@pytest.fixture(scope="module")
def run(source: Path, models: list[str], tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Return a function that repaints `source`, by default into a new folder."""

    def call(*arguments: str, out: Path | None = None, dataset: Path = source) -> Path:
        out = out or tmp_path_factory.mktemp("repainted") / "set"
        inpaint.main([str(dataset), "--out", str(out), *models, *OPTIONS, *arguments])
        return out

    return call


@pytest.fixture(scope="module")
def repainted(run: Run) -> Path:
    return run("--batch", "3")


def stored(folder: Path) -> list[StoredSample]:
    return [sample for path in sorted(folder.glob("*.tfrecord")) for sample in read_records(path)]


def shards(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.suffix == ".tfrecord"}


def test_only_the_leaf_changes(source: Path, repainted: Path) -> None:
    for before, after in zip(stored(source), stored(repainted), strict=True):
        mask, old, new = before.decode_mask(), before.decode_image(), after.decode_image()
        np.testing.assert_array_equal(new[~mask], old[~mask])
        assert (new[mask] != old[mask]).mean() > 0.9
        assert (after.mask, after.edges) == (before.mask, before.edges)
        assert before.values.items() <= after.values.items()


def test_each_record_says_how_it_was_painted(repainted: Path, models: list[str]) -> None:
    samples = stored(repainted)
    for number, sample in enumerate(samples):
        assert sample.values["prompt"] == species_prompt(species(number))
        assert sample.values["inpaint_model"] == f"{models[3]} + {models[1]}"
        assert sample.values["inpaint_strength"] == 1
        assert sample.values["imperfection"] == ""
    assert len({sample.values["inpaint_seed"] for sample in samples}) == len(samples)
    settings = json.loads((repainted / "inpainting.json").read_text())
    assert settings["steps"] == 2 and settings["model"] == "controlnet" and "batch" not in settings


def test_readers_and_mixtures_take_the_result(repainted: Path) -> None:
    samples = list(tfrecords.read_samples(repainted).as_numpy_iterator())
    assert [int(sample["index"]) for sample in samples] == list(range(SPEC.count))
    np.testing.assert_array_equal(samples[3]["image"], stored(repainted)[3].decode_image())
    context = SourceContext(
        folder=repainted.parent,
        size=SPEC.size,
        seed=0,
        needs_masks=True,
        needs_leaf=True,
        ranges="",
        textures=None,
    )
    stream = RecordsSource(kind="records", folder=repainted.name, count=SPEC.count).open(context)
    drawn = list(stream(0).take(SPEC.count).as_numpy_iterator())
    assert {int(sample["index"]) for sample in drawn} == set(range(SPEC.count))


def test_a_record_gives_the_same_picture_in_any_batch(run: Run, repainted: Path) -> None:
    for one, other in zip(stored(run("--batch", "1")), stored(repainted), strict=True):
        difference = one.decode_image().astype(int) - other.decode_image()
        # Sums of another order round differently, rarely across a half.
        assert np.abs(difference).max() <= 1 and (difference != 0).mean() < 0.01


def test_parts_of_many_machines_equal_the_whole(run: Run, repainted: Path) -> None:
    out = run("--batch", "3", "--shard", "1/2")
    assert len(shards(out)) == 1
    run("--batch", "3", "--shard", "0/2", out=out)
    assert shards(out) == shards(repainted)


def test_after_ctrl_c_finished_batches_are_kept(
    run: Run, repainted: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    paint, sizes = ControlNetInpainter.repaint, []

    def interrupted(inpainter: ControlNetInpainter, images: list[MaskedImage]) -> Any:
        if len(sizes) == 3:
            raise KeyboardInterrupt
        sizes.append(len(images))
        return paint(inpainter, images)

    out = tmp_path / "set"
    with monkeypatch.context() as patch:
        patch.setattr(ControlNetInpainter, "repaint", interrupted)
        with pytest.raises(KeyboardInterrupt, match="run the same command again"):
            run("--batch", "3", out=out)
    assert sizes == [3, 1, 3] and len(shards(out)) == 1
    report = tmp_path / "figures.json"
    run("--batch", "3", "--json", str(report), out=out)
    figures = json.loads(report.read_text())
    assert figures["shards_already_there"] == 1 and figures["pictures_painted"] == 3
    assert shards(out) == shards(repainted)
    assert sorted(path.name for path in out.iterdir()) == sorted(path.name for path in repainted.iterdir())


def test_a_finished_data_set_needs_no_model(
    run: Run, repainted: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ControlNetSettings, "load", lambda settings: pytest.fail("was loaded"))
    before = shards(repainted)
    run(out=repainted)
    assert shards(repainted) == before


def test_another_seed_paints_another_leaf(run: Run, repainted: Path) -> None:
    one, other = (stored(folder)[0] for folder in (repainted, run("--seed", "1", "--shard", "0/3")))
    assert (one.decode_image() != other.decode_image())[one.decode_mask()].mean() > 0.3


def test_other_settings_do_not_continue_a_data_set(run: Run, repainted: Path, source: Path) -> None:
    with pytest.raises(InputError, match="repainted with other settings: seed, steps"):
        run("--steps", "3", "--seed", "2", out=repainted)
    with pytest.raises(InputError, match="neither empty nor a repainted data set"):
        shutil.copytree(source, source.with_name("copy"))
        run(out=source.with_name("copy"))
    with pytest.raises(InputError, match="is the data set that is read"):
        run(out=source)


def test_folders_become_folders(run: Run, tmp_path: Path) -> None:
    spec = replace(SPEC, format="folder")
    write_source(tmp_path / "folders", spec)
    out = run(dataset=tmp_path / "folders", out=tmp_path / "out")
    before, after = (read_manifest(path / MANIFEST_FILE) for path in (tmp_path / "folders", out))
    assert len(after) == SPEC.count
    for old, new in zip(before, after, strict=True):
        assert (new.area_cm2, new.px_per_mm, new.species) == (old.area_cm2, old.px_per_mm, old.species)
        assert new.mask is not None and new.image.suffix == ".png"
        mask = decode_mask(new.mask)
        np.testing.assert_array_equal(decode_photo(new.image)[~mask], decode_photo(old.image)[~mask])
    header, row, *_ = (out / MANIFEST_FILE).read_text().splitlines()
    columns = dict(zip(header.split(","), row.split(","), strict=True))
    assert columns["prompt"] == species_prompt("beech") and columns["inpaint_strength"] == "1"


class TestPrompts:
    def paint_prompts(self, monkeypatch: pytest.MonkeyPatch, **settings: Any) -> list[str]:
        monkeypatch.setattr("laesi_tf.inpainting.controlnet.load_pipeline", lambda *_, **__: None)
        inpainter = ControlNetInpainter(ControlNetSettings(device="cpu", **settings))
        blank = {"image": np.zeros((8, 8, 3), np.uint8), "mask": np.ones((8, 8), bool), "seed": 0}
        return [
            inpainter.write_prompt(MaskedImage(**blank, prompt=species_prompt(name), species=name))
            for name in ("oak", "beech")
        ]

    def test_prompts_are_the_papers_by_default(self, monkeypatch: pytest.MonkeyPatch) -> None:
        expected = ["oak leaf on millimeter paper", "beech leaf on millimeter paper"]
        assert self.paint_prompts(monkeypatch) == expected

    def test_prompts_can_be_edited(self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
        path = tmp_path / "prompts.toml"
        path.write_text('oak = "a brown oak leaf"\n')
        found = self.paint_prompts(monkeypatch, prompts=str(path), prompt="{species} leaf, photo")
        assert found == ["a brown oak leaf", "beech leaf, photo"]
        path.write_text("oak = 3\n")
        with pytest.raises(InputError, match=r'oak is 3; write a text, oak = "..."'):
            self.paint_prompts(monkeypatch, prompts=str(path))


class TestDevices:
    @pytest.mark.parametrize("available", ["cuda", "mps", "cpu"])
    def test_auto_takes_what_is_there(self, monkeypatch: pytest.MonkeyPatch, available: str) -> None:
        import torch

        monkeypatch.setattr(torch.cuda, "is_available", lambda: available == "cuda")
        monkeypatch.setattr(torch.backends.mps, "is_available", lambda: available == "mps")
        assert diffusion_models.choose_device("auto") == available
        used: dict[str, Any] = {}
        monkeypatch.setattr(
            "laesi_tf.inpainting.controlnet.load_pipeline", lambda *_, **options: used.update(options)
        )
        ControlNetInpainter(ControlNetSettings())
        assert used == {"device": available, "is_half": available != "cpu"}
        ControlNetInpainter(ControlNetSettings(precision="full"))
        assert not used["is_half"]

    def test_a_device_that_is_missing_is_refused(self, monkeypatch: pytest.MonkeyPatch) -> None:
        import torch

        monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
        with pytest.raises(InputError, match=r"--device cuda is not available .* there is: .*cpu"):
            diffusion_models.choose_device("cuda")


@pytest.mark.parametrize(
    ("size", "side", "expected"),
    [((224, 224), 512, (512, 512)), ((48, 64), 64, (48, 64)), ((90, 160), 512, (288, 512))],
)
def test_images_are_painted_at_a_size_the_model_knows(
    size: tuple[int, int], side: int, expected: tuple[int, int]
) -> None:
    assert working_size(size, side) == expected


class TestModels:
    def test_without_network_one_line_names_the_models(
        self, run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def refuse(*_: Any, **__: Any) -> None:
            raise OSError("Name or service not known")

        monkeypatch.setattr("laesi_tf.inpainting.diffusion_models.socket.create_connection", refuse)
        for proxy in ("HTTPS_PROXY", "https_proxy", "ALL_PROXY", "all_proxy"):
            monkeypatch.delenv(proxy, raising=False)
        with pytest.raises(InputError) as raised:
            run("--base", "nobody/no-such-model", out=tmp_path / "set")
        message = str(raised.value)
        for part in ("nobody/no-such-model", diffusion_models.BASE_ID, diffusion_models.CONTROLNET_ID):
            assert part in message
        assert "--base DIR" in message and "\n" not in message
        assert not (tmp_path / "set").exists()

    def test_pickled_weights_are_refused(self, run: Run, models: list[str], tmp_path: Path) -> None:
        import torch

        pickled = tmp_path / "pickled"
        shutil.copytree(models[1], pickled)
        weights = pickled / "unet" / "diffusion_pytorch_model.safetensors"
        torch.save({"harmful": torch.zeros(1)}, weights.with_suffix(".bin"))
        weights.unlink()
        with pytest.raises(InputError, match=r"pickled cannot be loaded .* weights as safetensors"):
            run("--base", str(pickled), out=tmp_path / "set")

    def test_a_folder_that_is_missing_is_refused_at_once(self, run: Run, tmp_path: Path) -> None:
        with pytest.raises(InputError, match="there is no such folder"):
            run("--base", str(tmp_path / "nowhere"), out=tmp_path / "set")
        assert not (tmp_path / "set").exists()

    def test_a_missing_package_is_named(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
        with pytest.raises(InputError, match=r"torch is not installed; run pip install .*\[inpaint\]"):
            diffusion_models.require_packages()


class TestBadInput:
    def test_what_is_no_data_set(self, run: Run, tmp_path: Path) -> None:
        with pytest.raises(InputError, match="no data set in"):
            run(dataset=tmp_path / "nowhere", out=tmp_path / "set")

    def test_a_truncated_shard(self, run: Run, source: Path, tmp_path: Path) -> None:
        copy = tmp_path / "copy"
        shutil.copytree(source, copy)
        shard = copy / SPEC.shard_name(1)
        shard.write_bytes(shard.read_bytes()[:-9])
        with pytest.raises(InputError, match=f"{shard.name} is truncated"):
            run(dataset=copy, out=tmp_path / "set")

    def test_a_shard_with_wrong_bytes(self, run: Run, source: Path, tmp_path: Path) -> None:
        copy = tmp_path / "copy"
        shutil.copytree(source, copy)
        shard = copy / SPEC.shard_name(0)
        content = bytearray(shard.read_bytes())
        content[200] ^= 255
        shard.write_bytes(content)
        with pytest.raises(InputError, match=f"cannot read .*{shard.name}"):
            run(dataset=copy, out=tmp_path / "set")

    def test_records_of_another_kind(self, run: Run, source: Path, tmp_path: Path) -> None:
        start_dataset(tmp_path / "other", replace(SPEC, count=1))
        tfrecords.write_shard(tmp_path / "other" / replace(SPEC, count=1).shard_name(0), [b"no example"])
        with pytest.raises(InputError, match=r"a record of .* has no image"):
            run(dataset=tmp_path / "other", out=tmp_path / "set")

    def test_an_empty_mask(self, run: Run, tmp_path: Path) -> None:
        spec = replace(SPEC, count=1)
        sample = render_samples()[0]
        start_dataset(tmp_path / "other", spec)
        empty = sample | {"mask": np.zeros_like(sample["mask"])}
        tfrecords.write_samples(tmp_path / "other" / spec.shard_name(0), iter([(empty, "oak")]), spec)
        with pytest.raises(InputError, match=r"the mask of image 0 in .* is empty"):
            run(dataset=tmp_path / "other", out=tmp_path / "set")

    def test_an_option_of_the_other_model(self, run: Run, tmp_path: Path) -> None:
        with pytest.raises(InputError, match="--steps has no effect with --model exemplar"):
            inpaint.main([str(tmp_path), "--out", str(tmp_path), "--model", "exemplar", "--steps", "3"])

    def test_a_value_out_of_range(self, run: Run) -> None:
        with pytest.raises(InputError, match=r"strength = 1.5 must be a number between"):
            run("--strength", "1.5")
