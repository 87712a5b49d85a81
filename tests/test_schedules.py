import keras
import numpy as np
import pytest
import tensorflow as tf

from laesi_tf.training.optimizers import OPTIMIZERS, make_optimizer
from laesi_tf.training.schedules import SCHEDULES

ENDS = {"peak": 1e-3, "final": 1e-9, "steps": 1000}


def rates(name):
    follow = tf.function(lambda step: SCHEDULES[name](step, **ENDS))
    return np.array([follow(tf.constant(step)).numpy() for step in range(ENDS["steps"])])


@pytest.mark.parametrize("name", sorted(set(SCHEDULES) - {"constant"}))
def test_from_peak_to_final(name):
    found = rates(name)
    assert found.max() == pytest.approx(1e-3, rel=1e-4)
    assert found[-1] == pytest.approx(1e-9, rel=1e-2)
    assert (np.diff(found[found.argmax() :]) <= 1e-10).all()


def test_piecewise_is_the_papers_seven_powers_of_ten():
    found, counts = np.unique(rates("piecewise").round(12), return_counts=True)
    assert found == pytest.approx([10.0**-power for power in range(9, 2, -1)], rel=1e-2)
    assert counts[-2:].sum() == pytest.approx(800, abs=2)


def test_cosine_rises_then_falls_as_a_half_period():
    found = rates("cosine")
    assert found[0] == pytest.approx(1e-3 / 50)
    assert found.argmax() == pytest.approx(50, abs=1)
    assert found[525] == pytest.approx(0.5e-3, rel=1e-2)


def test_exponential_and_linear_fall_evenly():
    assert np.diff(np.log(rates("exponential"))) == pytest.approx(np.log(1e-6) / 999, rel=1e-2)
    assert np.diff(rates("linear")) == pytest.approx(-1e-3 / 999, rel=1e-2)


def test_constant_stays():
    assert (rates("constant") == np.float32(1e-3)).all()


@pytest.mark.parametrize("steps", [1, 2])
@pytest.mark.parametrize("name", sorted(SCHEDULES))
def test_the_shortest_run_starts_at_a_rate_that_learns(name, steps):
    assert SCHEDULES[name](tf.constant(0), peak=1e-3, final=1e-9, steps=steps).numpy() == pytest.approx(1e-3)


@pytest.mark.parametrize("name", sorted(OPTIMIZERS))
def test_optimizers_follow_the_schedule_and_descend(name):
    follower = make_optimizer(name, schedule="linear", peak=0.05, final=1e-4, steps=100)
    weight = keras.Variable([3.0])
    for _ in range(100):
        with tf.GradientTape() as tape:
            loss = tf.reduce_sum(tf.square(weight.value))
        follower.apply([tape.gradient(loss, weight.value)], [weight])
    assert float(follower.learning_rate) == pytest.approx(1e-4, rel=1e-2)
    assert abs(float(weight.numpy()[0])) < 1.5
