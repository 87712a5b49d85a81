"""The ruling network's shapes, targets and losses."""

import math

import numpy as np
import pytest
import tensorflow as tf

from laesi_tf.models import ruling_network as network
from laesi_tf.models.ruling_cells import BINS_PER_OCTAVE, DIRECTION_BINS, FINEST_PX, PERIOD_BINS


def targets(readable: np.ndarray, **values: np.ndarray) -> network.RulingTargets:
    shape = readable.shape
    filled = {
        "finest_uncertain": np.zeros(shape, np.int32),
        "log_period": np.full(shape, math.log(6.0), np.float32),
        "log_heaviest": np.full(shape, math.log(30.0), np.float32),
        "direction": np.full(shape, 0.3, np.float32),
    }
    return network.RulingTargets(readable, **(filled | values))


def perfect_logits(wanted: network.RulingTargets) -> np.ndarray:
    periods, heaviest = (
        network.share_between_bins(network.to_bin(log), PERIOD_BINS, circular=False)
        for log in (wanted.log_period, wanted.log_heaviest)
    )
    directions = network.share_between_bins(wanted.direction * DIRECTION_BINS, DIRECTION_BINS, circular=True)
    flags = [20.0 * (2.0 * np.asarray(flag) - 1) for flag in (wanted.readable, wanted.finest_uncertain)]
    return np.concatenate(
        [np.stack(flags, -1), *(np.log(np.asarray(part) + 1e-9) for part in (periods, heaviest, directions))],
        -1,
    ).astype(np.float32)


def test_any_size_gives_a_cell_per_16_pixels():
    model = network.build_ruling_network()
    assert 0.4e6 < model.count_params() < 0.6e6
    assert model(np.zeros((2, 64, 96, 3), np.float32)).shape == (2, 4, 6, network.CHANNELS)


def test_answers_are_probabilities():
    answers = network.to_answers(tf.random.stateless_normal([3, 4, network.CHANNELS], [0, 1]))
    np.testing.assert_allclose(tf.reduce_sum(answers.periods, -1), 1, rtol=1e-5)
    np.testing.assert_allclose(tf.reduce_sum(answers.directions, -1), 1, rtol=1e-5)
    assert answers.readable.shape == (3, 4)


def test_an_octave_is_a_whole_number_of_bins():
    bins = network.to_bin(np.log(np.float32([FINEST_PX, 2 * FINEST_PX, 4 * FINEST_PX])))
    np.testing.assert_allclose(bins, [0, BINS_PER_OCTAVE, 2 * BINS_PER_OCTAVE], atol=1e-5)


@pytest.mark.parametrize("circular", [False, True])
def test_shares_put_the_mean_at_the_place(circular):
    shares = network.share_between_bins(tf.constant([0.0, 2.25, 6.9]), 12, circular=circular).numpy()
    np.testing.assert_allclose(shares @ np.arange(12), [0.0, 2.25, 6.9], atol=1e-4)


def test_directions_wrap_around():
    share = network.share_between_bins(tf.constant([11.5]), 12, circular=True).numpy()[0]
    np.testing.assert_allclose(share[[11, 0]], 0.5)


def test_perfect_answers_cost_only_the_spread_over_bins():
    wanted = targets(np.ones((1, 2, 2), np.int32))
    losses = network.ruling_losses(perfect_logits(wanted), wanted)
    assert float(losses["readable"]) < 1e-6
    assert all(float(loss) < math.log(2) for loss in losses.values())
    worse = targets(np.ones((1, 2, 2), np.int32), log_period=np.full((1, 2, 2), math.log(30.0), np.float32))
    assert network.ruling_loss(perfect_logits(wanted), worse) > network.ruling_loss(
        perfect_logits(wanted), wanted
    )


def test_cells_that_are_not_asked_do_not_count():
    logits = np.random.default_rng(0).normal(size=(1, 1, 2, network.CHANNELS)).astype(np.float32)
    changed = logits.copy()
    changed[0, 0, 1] += 3.0
    asked = targets(
        np.array([[[1, network.NOT_ASKED]]], np.int32),
        finest_uncertain=np.array([[[0, network.NOT_ASKED]]], np.int32),
    )
    np.testing.assert_allclose(
        network.ruling_loss(logits, asked), network.ruling_loss(changed, asked), rtol=1e-6
    )


def test_one_step_of_training_lowers_the_loss():
    model = network.build_ruling_network(64, 64)
    picture = tf.random.stateless_uniform([2, 64, 64, 3], [0, 1], maxval=255.0)
    wanted = targets(np.ones((2, 4, 4), np.int32))
    optimizer = keras_sgd()
    losses = []
    for _ in range(3):
        with tf.GradientTape() as tape:
            loss = network.ruling_loss(model(picture, training=True), wanted)
        losses.append(float(loss))
        optimizer.apply_gradients(
            zip(tape.gradient(loss, model.trainable_variables), model.trainable_variables, strict=True)
        )
    assert losses[-1] < losses[0]


def keras_sgd():
    import keras

    return keras.optimizers.SGD(0.02)
