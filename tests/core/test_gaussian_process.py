"""Laws of Gaussian processes, against closed forms and the textbook's other formulas."""

from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tjscan.core.frames import Array
from tjscan.core.gaussian_process import (
    Kernel,
    Matern52,
    OrdinaryKriging,
    PeriodicKernel,
    SimpleKriging,
)

X = np.linspace(-0.4, 0.0, 9)
KERNELS = (Matern52(1.3, 0.15), PeriodicKernel(0.7, 0.5))
each_kernel = pytest.mark.parametrize("kernel", KERNELS)


def measured(seed: int = 3) -> tuple[Array, Array]:
    """Values at `X` and their standard deviations."""
    rng = np.random.default_rng(seed)
    return rng.standard_normal(9), rng.uniform(0.05, 0.3, 9)


@each_kernel
def test_kernels_are_symmetric_and_positive(kernel: Kernel) -> None:
    x = np.random.default_rng(0).uniform(-1, 1, 20)
    K = kernel(x[:, None] - x)
    np.testing.assert_array_equal(K, K.T)
    np.testing.assert_allclose(np.diag(K), kernel.sigma_f**2)
    assert np.linalg.eigvalsh(K).min() > -1e-9


def test_known_covariances() -> None:
    r = np.sqrt(5)  # one length apart
    assert Matern52(2.0, 0.3)(np.array(0.3)) == pytest.approx(4 * (1 + r + 5 / 3) * np.exp(-r))
    # Rasmussen and Williams write the periodic kernel with sin² of half the difference.
    d = np.linspace(-4, 4, 9)
    expected = 0.49 * np.exp(-2 * np.sin(d / 2) ** 2 / 0.25)
    np.testing.assert_allclose(PeriodicKernel(0.7, 0.5)(d), expected)


@given(st.floats(-10, 10))
def test_the_periodic_kernel_closes_after_a_turn(d: float) -> None:
    kernel = PeriodicKernel(1.0, 0.5)
    assert kernel(np.array(d + 2 * np.pi)) == pytest.approx(kernel(np.array(d)))


@given(st.floats(-4, 4))
def test_the_periodic_kernels_derivative(d: float) -> None:
    kernel, h = PeriodicKernel(1.0, 0.5), 1e-6
    difference = (kernel(np.array(d + h)) - kernel(np.array(d - h))) / (2 * h)
    assert kernel.derivative(np.array(d)) == pytest.approx(difference, abs=1e-8)


@each_kernel
def test_simple_kriging_is_the_conditional_mean_of_the_joint_normal(kernel: Kernel) -> None:
    y, _ = measured()
    x_star = np.array([-0.33, 0.02, 0.3])
    every = np.concatenate((X, x_star))
    # From the precision of everything at once: E[f*] - m = -P_**^-1 P_*y (y - m).
    joint = kernel(every[:, None] - every) + np.diag(np.repeat((0.04, 1e-8), (9, 3)))
    P = np.linalg.inv(joint)
    expected = y.mean() - np.linalg.solve(P[9:, 9:], P[9:, :9] @ (y - y.mean()))
    fit = SimpleKriging.fit(kernel, X, y, 0.2)
    assert fit.predict_change(-0.33, 0.35) == pytest.approx(expected[1] - expected[0], abs=1e-6)


@each_kernel
@pytest.mark.parametrize("h_star", [1.0, 0.0])
def test_ordinary_kriging_solves_the_kriging_equations(kernel: Kernel, h_star: float) -> None:
    """Cressie (1993), eq. (3.2.9): weights and a Lagrange multiplier, from a bordered matrix."""
    y, sigma_n = measured()
    x_star, start = np.array([-0.33, 0.02, 0.3]), -0.1
    k_star = kernel(X[:, None] - x_star)
    prior = np.full(3, kernel.sigma_f**2)
    if h_star == 0:
        k_star = k_star - kernel(X[:, None] - start)
        prior = 2 * (prior - kernel(x_star - start))
    bordered = np.block(
        [[kernel(X[:, None] - X) + np.diag(sigma_n**2), np.ones((9, 1))], [np.ones((1, 9)), 0.0]]
    )
    solved = np.linalg.solve(bordered, np.vstack((k_star, np.full(3, h_star))))
    weights, multiplier = solved[:9], solved[9]
    variance = prior - np.sum(weights * k_star, axis=0) - h_star * multiplier
    kriging = OrdinaryKriging(X, y, sigma_n, kernel)
    predict = kriging.predict if h_star else partial(kriging.predict_change, start=start)
    values, sigmas = predict(x_star)
    np.testing.assert_allclose(values, weights.T @ y, atol=1e-9)
    np.testing.assert_allclose(sigmas, np.sqrt(variance), atol=1e-9)


def test_one_measured_value_is_all_that_is_known_of_the_mean() -> None:
    kriging = OrdinaryKriging(np.zeros(1), np.array([2.5]), np.array([0.3]), Matern52(1.0, 0.1))
    (near, far), (sigma_near, sigma_far) = kriging.predict(np.array([0.0, 100.0]))
    assert (near, far) == pytest.approx((2.5, 2.5))
    assert sigma_near == pytest.approx(0.3)
    assert sigma_far == pytest.approx(np.sqrt(1 + 1 + 0.3**2))  # of both values and the noise


@settings(max_examples=20)
@given(st.floats(-100, 100))
def test_a_constant_added_to_all_values_is_added_to_the_prediction(c: float) -> None:
    y, sigma_n = measured()
    at, plus = (OrdinaryKriging(X, v, sigma_n, KERNELS[0]).predict(X + 0.01) for v in (y, y + c))
    np.testing.assert_allclose(plus[0], at[0] + c, atol=1e-9)
    np.testing.assert_array_equal(plus[1], at[1])


def test_kriging_returns_what_was_measured_and_forgets_far_away() -> None:
    values = np.sin(10 * X)
    kriging = OrdinaryKriging(X, values, np.full(9, 1e-6), Matern52(1.0, 0.15))
    at, sigma = kriging.predict(X)
    np.testing.assert_allclose(at, values, atol=1e-5)
    assert sigma.max() < 1e-4
    far, far_sigma = kriging.predict(np.array([5.0]))
    assert abs(far[0]) < 1.0
    assert far_sigma[0] > 1.0  # the process's own, and that of its mean
    change, none = kriging.predict_change(np.array([X[3], 0.05]), X[3])
    assert change[0] == pytest.approx(0.0, abs=1e-9)
    assert none[0] == pytest.approx(0.0, abs=1e-6)
    assert change[1] == pytest.approx(kriging.predict(np.array([0.05]))[0][0] - values[3], abs=1e-4)


def test_kriging_averages_noise() -> None:
    rng = np.random.default_rng(4)
    kernel = Matern52(0.3, 0.15)
    off = [
        OrdinaryKriging(X, 3 + rng.standard_normal(9), np.ones(9), kernel).predict(np.zeros(1))[0][
            0
        ]
        - 3
        for _ in range(200)
    ]
    assert np.std(off) < 0.5
    assert abs(np.mean(off)) < 0.1
