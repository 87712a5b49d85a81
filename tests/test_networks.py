import keras
import numpy as np
import pytest
import tensorflow as tf

from laesi_tf.common.errors import InputError
from laesi_tf.models import area_network, batch_norm, mask_network
from laesi_tf.models.backbone import BACKBONES, FROM_SCRATCH, build_backbone, features_at_stride

SIZE = (64, 96)


def small(*, size=SIZE, alpha=0.35, weights="none", kind="small"):
    return build_backbone(kind, size=size, alpha=alpha, weights=weights)[0]


def make_images(count=4, *, size=SIZE, seed=0):
    return np.random.default_rng(seed).integers(0, 256, (count, *size, 3)).astype(np.uint8)


@pytest.fixture
def offline(monkeypatch):
    def refuse(*_, **__):
        raise Exception("URL fetch failure on https://example.org/weights.h5: None -- [Errno -2] unknown")

    monkeypatch.setattr("keras.src.utils.file_utils.get_file", refuse)


@pytest.mark.parametrize("kind", sorted(BACKBONES))
def test_features_are_taken_where_a_stride_ends(kind):
    base = small(kind=kind)
    for stride in (2, 4, 8, 16):
        feature = features_at_stride(base, stride)
        assert feature.shape[1:3] == (64 // stride, 96 // stride)
        position = [layer.output is feature for layer in base.layers].index(True)
        after = base.layers[position + 2].output.shape[1]  # the padding, then the strided convolution
        assert after == 64 // stride // 2
    assert base.output.shape[1:3] == (2, 3)


@pytest.mark.parametrize("size", [(32, 32), (33, 50), (64, 47)])
@pytest.mark.parametrize("task", ["area", "mask"])
def test_any_side_from_32_bytes_or_floats(size, task):
    base = small(size=size)
    model = (
        area_network.build_area_network(base, transform="log")
        if task == "area"
        else mask_network.build_mask_network(base)
    )
    images = make_images(2, size=size)
    output = model(images, training=False).numpy()
    assert output.shape == ((2, 3) if task == "area" else (2, *size, 1))
    np.testing.assert_allclose(output, model(images.astype(np.float32), training=False), atol=1e-6)
    assert np.isfinite(output).all()


def test_masks_are_probabilities_and_keras_saves_and_loads_the_network(tmp_path):
    keras.utils.set_random_seed(1)
    model = mask_network.build_mask_network(small())
    for variable in model.trainable_variables:  # far from the initial 0.5
        variable.assign(variable * 3.0)
    images = make_images()
    output = model(images, training=False).numpy()
    assert output.min() >= 0.0
    assert output.max() <= 1.0
    assert np.ptp(output) > 0.0
    model.save(tmp_path / "model.keras")
    again = keras.models.load_model(tmp_path / "model.keras", compile=False)
    np.testing.assert_allclose(again(images, training=False), output, atol=1e-6)


def test_lr_aspp_adds_gated_features_detail_and_edge():
    model = mask_network.build_mask_network(small())
    images = make_images(2)
    names = ("head_relu", "gate", "gated", "from_gated", "from_detail", "from_margin")
    taps = {name: model.get_layer(name) for name in names}
    probe = keras.Model(model.input, {name: layer.output for name, layer in taps.items()})
    found = {name: value.numpy() for name, value in probe(images, training=False).items()}
    assert found["gate"].shape == (2, 1, 1, 128)
    np.testing.assert_allclose(found["gated"], found["head_relu"] * found["gate"], rtol=1e-5)
    coarse = found["from_gated"] + found["from_detail"]
    sharper = tf.image.resize(coarse, found["from_margin"].shape[1:3]) + found["from_margin"]
    logits = tf.image.resize(sharper, SIZE)
    np.testing.assert_allclose(model(images, training=False), tf.sigmoid(logits), atol=1e-5)


@pytest.mark.parametrize("transform", area_network.TRANSFORMS)
def test_transforms_invert_and_start_at_a_typical_leaf(transform):
    areas = np.array([0.01, 0.5, 25.0, 400.0])
    back = area_network.to_area_cm2(
        area_network.transform_area(tf.constant(areas), transform).numpy(), transform
    )
    np.testing.assert_allclose(back, areas, rtol=1e-6)
    model = area_network.build_area_network(small(), transform=transform)
    for name in ("scale", "share"):
        model.get_layer(name).kernel.assign(tf.zeros_like(model.get_layer(name).kernel))
    found = model(make_images(1), training=False).numpy()
    start = area_network.to_area_cm2(found[:, 0], transform)
    np.testing.assert_allclose(start, area_network.TYPICAL_AREA_CM2, rtol=1e-5)
    scale, share = np.exp(found[:, 1]), np.exp(found[:, 2])
    pixels = make_images(1).shape[1] * make_images(1).shape[2]
    np.testing.assert_allclose(share * pixels / scale**2 / 100, area_network.TYPICAL_AREA_CM2, rtol=1e-4)


@pytest.mark.parametrize("transform", area_network.TRANSFORMS)
def test_extreme_outputs_give_areas_within_bounds(transform):
    wild = area_network.to_area_cm2(np.array([-1e30, -5.0, 1e30, np.inf]), transform)
    assert ((wild >= area_network.SMALLEST_CM2) & (wild <= area_network.LARGEST_CM2)).all()
    assert np.isnan(area_network.to_area_cm2(np.array([np.nan]), transform)).all()


@pytest.mark.parametrize("transform", area_network.TRANSFORMS)
def test_l1_is_the_relative_error_of_a_typical_leaf(transform):
    true = tf.constant([[area_network.TYPICAL_AREA_CM2, np.nan, np.nan]])
    output = tf.concat([area_network.transform_area(true[:, :1] * 1.01, transform), [[3.0, 3.0]]], axis=1)
    loss = area_network.area_loss(output, true, transform=transform, loss="l1")
    assert float(loss) == pytest.approx(0.01, rel=0.01)


def test_known_factors_are_weighted_by_their_effect_on_the_area():
    exact = tf.constant([[0.0, np.log(2.0), np.log(0.1)]], tf.float32)
    true = tf.constant([[1.0, 2.0, 0.1]])
    assert float(area_network.area_loss(exact, true, transform="log", loss="l1")) == pytest.approx(
        0.0, abs=1e-6
    )
    scale_off = exact + tf.constant([[0.0, 0.01, 0.0]])
    share_off = exact + tf.constant([[0.0, 0.0, 0.01]])
    of_scale = float(area_network.area_loss(scale_off, true, transform="log", loss="l1"))
    of_share = float(area_network.area_loss(share_off, true, transform="log", loss="l1"))
    assert of_scale == pytest.approx(2 * of_share, rel=1e-3)
    assert of_share > 0


def test_huber_is_quadratic_then_linear():
    errors = np.array([0.0, 0.05, 0.1, 0.5, -0.5], np.float32)
    found = [
        float(
            area_network.area_loss(
                tf.constant([[error, 0.0, 0.0]]), tf.ones([1, 3]), transform="log", loss="huber"
            )
        )
        for error in errors
    ]
    reference = keras.losses.Huber(delta=0.1)
    expected = [float(reference([[error]], [[0.0]])) / 0.1 for error in errors]
    np.testing.assert_allclose(found, expected, rtol=1e-5)


def test_mask_losses_equal_those_of_keras():
    random = np.random.default_rng(1)
    leaf = random.uniform(0.01, 0.99, (3, 20, 20, 1)).astype(np.float32)
    mask = random.integers(0, 2, (3, 20, 20)).astype(np.uint8)
    crossed = float(keras.losses.BinaryCrossentropy()(mask[..., None].astype(np.float32), leaf))
    assert float(mask_network.mask_loss(leaf, mask, loss="bce")) == pytest.approx(crossed, rel=1e-4)
    dice = np.mean(
        [
            1 - (2 * (p[..., 0] * m).sum() + 1) / (p.sum() + m.sum() + 1)
            for p, m in zip(leaf, mask, strict=True)
        ]
    )
    assert float(mask_network.mask_loss(leaf, mask, loss="bce_dice")) == pytest.approx(
        crossed + dice, rel=1e-4
    )


def test_weights_are_loaded_from_a_file(tmp_path):
    saved = small()
    for variable in saved.variables:
        variable.assign(tf.random.stateless_uniform(variable.shape, (1, 2)) + 0.5)
    saved.save_weights(tmp_path / "w.weights.h5")
    loaded, origin = build_backbone(
        "small", size=(32, 32), alpha=0.35, weights=str(tmp_path / "w.weights.h5")
    )
    for one, other in zip(saved.variables, loaded.variables, strict=True):
        np.testing.assert_array_equal(one, other)
    assert "w.weights.h5" in origin


def test_weights_that_do_not_fit_are_refused(tmp_path):
    path = tmp_path / "w.weights.h5"
    with pytest.raises(InputError, match="no weights file"):
        small(weights=str(path))
    path.write_bytes(b"not HDF5")
    with pytest.raises(InputError, match="not hold weights of MobileNetV3 small of width 0"):
        small(weights=str(path))
    small(alpha=0.75).save_weights(path)
    with pytest.raises(InputError, match="--alpha"):
        small(weights=str(path))
    keras.Sequential([keras.Input((4,)), keras.layers.Dense(2)]).save_weights(path)
    with pytest.raises(InputError, match="does not hold"):
        small(weights=str(path))


def test_auto_falls_back_to_random_weights_with_one_warning(offline):
    with pytest.warns(UserWarning, match="training from scratch") as warned:
        base, origin = build_backbone("small", size=(32, 32), weights="auto")
    assert len(warned) == 1
    assert origin == FROM_SCRATCH
    assert base.output.shape[1:] == (1, 1, 576)
    with pytest.raises(InputError, match="no ImageNet weights for small"):
        build_backbone("small", size=(32, 32), weights="imagenet")


def test_recalibrated_statistics_are_those_of_all_imagestogether():
    inputs = keras.Input((8, 8, 3))
    layer = keras.layers.BatchNormalization()
    model = keras.Model(inputs, layer(inputs))
    batches = [
        tf.constant(make_images(5, size=(8, 8), seed=seed), tf.float32) * (1.0 + seed) for seed in range(3)
    ]
    batch_norm.make_recalibrator(model)(lambda: batches)
    values = np.concatenate(batches).reshape(-1, 3).astype(np.float64)
    np.testing.assert_allclose(layer.moving_mean, values.mean(0), rtol=1e-5)
    np.testing.assert_allclose(layer.moving_variance, values.var(0), rtol=1e-4)


def test_frozen_layers_neither_learn_nor_drift():
    base = small()
    batch_norm.freeze(base)
    model = mask_network.build_mask_network(base)
    frozen = [layer for layer in batch_norm.batch_norm_layers(model) if layer.name != "head_bn"]
    assert len(frozen) > 10
    before = [variable.numpy() for layer in frozen for variable in layer.variables]
    head = model.get_layer("head_bn").moving_mean.numpy()
    learned = {id(variable) for variable in model.trainable_variables}
    batch_norm.make_recalibrator(model)(lambda: [make_images()])
    assert not any(id(variable) in learned for layer in frozen for variable in layer.variables)
    for one, other in zip(before, [v for layer in frozen for v in layer.variables], strict=True):
        np.testing.assert_array_equal(one, other)
    assert not np.allclose(head, model.get_layer("head_bn").moving_mean)
