import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxleg.leg import energy

RNG = np.random.default_rng(0)


@pytest.mark.parametrize(("speed", "net", "positive", "absolute"), [(2.0, 42.28, 42.28, 42.28), (-2.0, -37.72, 2.28, 42.28)])
def test_power_by_hand(pegasus, speed, net, positive, absolute):
    motor = pegasus.__class__(**(vars(pegasus) | {"torque_constant": jnp.array(0.2), "gear_ratio": jnp.array(100.0)}))
    power = energy.motor_power(motor, jnp.array([20.0]), jnp.array([speed]))  # 1 A through 2.28 Ohm
    values = [energy.electrical(power, convention)[0] for convention in energy.CONVENTIONS]
    assert_allclose(values, [net, positive, absolute])


def random_power(robot):
    torque, speed = (jnp.array(RNG.normal(size=(20, 12))) for _ in range(2))
    return torque, speed, energy.motor_power(robot, torque, speed)


def test_absolute_is_the_magnitude_of_mechanical_power(pegasus):
    torque, speed, power = random_power(pegasus)
    assert_allclose(energy.electrical(power, "absolute") - power.joule, np.abs(torque * speed), atol=1e-12)


def test_conventions_are_ordered(pegasus):
    _, _, power = random_power(pegasus)
    net, positive, absolute = (energy.electrical(power, convention) for convention in energy.CONVENTIONS)
    assert np.all(net <= positive)
    assert np.all(positive <= absolute)
    assert np.any(net < positive)


def test_conventions_hold_for_sums_as_for_samples(pegasus):
    _, _, power = random_power(pegasus)
    total = energy.Power(*(jnp.sum(part, axis=0) for part in power))
    for convention in energy.CONVENTIONS:
        assert_allclose(energy.electrical(total, convention), energy.electrical(power, convention).sum(axis=0), atol=1e-12)


def test_joule_heat_does_not_depend_on_signs_and_is_quadratic(pegasus):
    torque, speed, power = random_power(pegasus)
    for scale in (-1.0, 3.0):
        assert_allclose(energy.motor_power(pegasus, scale * torque, -speed).joule, scale**2 * power.joule)


@pytest.mark.parametrize(("watts", "speed", "printed"), [(31.8, 0.012, 7.68), (35.2, 0.0124, 8.2)])
def test_cost_of_transport_is_the_papers(pegasus, watts, speed, printed):
    assert_allclose(energy.cost_of_transport(watts / speed, pegasus.mass), printed, rtol=5e-3)
