"""Every closed-form function and all its first derivatives, against mpmath.

The reference is evaluated at exactly the floating-point arguments, once for all runs, see
`tools/freezing.py`. The bound on a value is
2 units in the last place times (1 + condition number), the condition number being the sum
of the relative sensitivities to all arguments (4 units along paths over time). A
derivative is compared relative to itself; along a path, where derivatives change sign,
relative to all of them.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest
from tables import frozen
from tables.closed_form_cases import (
    CASES,
    EDGES,
    NAMES,
    NUMBER,
    ON_SCENES,
    evaluate,
    read_samples,
)
from tools.selection import first_by_default


class Truth(NamedTuple):
    values: list
    gradients: list

    def condition(self, samples, index):
        total = mp.mpf(0)
        for argument, slope in zip(samples.arguments, self.gradients[index], strict=True):
            total += abs(mp.mpf(float(argument[index])) * slope)
        return float(total / abs(self.values[index]))


def frozen_truth(name, dtype):
    """Samples of a case, with values and gradients; none where those are complex."""
    samples, answers = read_samples(name, np.dtype(dtype).name)
    values = [frozen.number(value) for value, _ in answers]
    return samples, Truth(
        values, [[frozen.number(s) for s in slopes] for _, slopes in answers]
    )


def check_values(name, samples, truth, ours, dtype):
    eps = float(np.finfo(dtype).eps)
    compared = 0
    for index, (value, exact) in enumerate(zip(ours, truth.values, strict=True)):
        if exact is None:  # rounding the arguments took it past the verge
            continue
        condition = truth.condition(samples, index)
        if condition * eps > 0.01:  # the condition number says nothing any more
            continue
        ulp = mp.mpf(2) ** mp.floor(mp.log(abs(exact), 2)) * eps
        error = abs(mp.mpf(float(value)) - exact) / ulp
        arguments = [a[index] for a in samples.arguments]
        bound = CASES[name].ulps * (1 + condition)
        assert error <= bound, (arguments, value, exact, condition)
        compared += 1
    assert ours.dtype == dtype
    assert compared > 0.7 * NUMBER


@pytest.mark.parametrize("name", first_by_default(CASES, 6))
def test_value_in_float32(name):
    samples, truth = frozen_truth(name, np.float32)
    check_values(name, samples, truth, evaluate(CASES[name], samples, np.float32), np.float32)


def check_edges(edges, *found):
    """Slopes in either mode: arguments, edges."""
    for slopes in found:
        for (edge, (_, exact)), gradient in zip(edges.items(), slopes.T, strict=True):
            for position, (slope, digits) in enumerate(zip(gradient, exact, strict=True)):
                theirs = frozen.number(digits)
                assert np.isfinite(slope), (edge, position)
                wrong = abs(mp.mpf(float(slope)) - theirs)
                assert wrong <= 1e-10 * abs(theirs) + 1e-50, (edge, position)


@pytest.mark.float64
@pytest.mark.parametrize("name", NAMES)
def test_value_and_derivatives_in_float64(name):
    """Slopes to 1e-10, and near the verge to what the rounding of the speed ratio x allows.

    One program does for the samples and the edges.
    """
    samples, truth = frozen_truth(name, np.float64)
    function = CASES[name].ours
    which = range(len(samples.arguments))
    edges = {edge: frozen.entry("edges", name, edge) for edge in EDGES if name in ON_SCENES}

    @jax.jit
    @jax.vmap
    def of_sample(*arguments):
        value, slopes = jax.value_and_grad(function, which)(*arguments)
        forward = jax.vmap(lambda *along: jax.jvp(function, arguments, along)[1])
        return value, slopes, forward(*jnp.eye(len(arguments)))

    arguments = samples.arguments
    if edges:
        on_edges = np.transpose([asked for asked, _ in edges.values()])
        arguments = tuple(map(np.append, arguments, on_edges))
    values, reverse, forward = jax.tree.map(np.asarray, of_sample(*arguments))
    check_values(name, samples, truth, values[:NUMBER], np.float64)
    forward = forward.T
    check_edges(edges, np.stack(reverse)[:, NUMBER:], forward[:, NUMBER:])
    eps = float(np.finfo(np.float64).eps)
    for index, gradient in enumerate(truth.gradients):
        left = 1 - min(samples.x[index], 1 - 1e-13) ** 2
        numbers = [mp.mpf(float(a[index])) for a in samples.arguments]
        total = sum(abs(a * (g or 0)) for a, g in zip(numbers, gradient, strict=True))
        for position, exact in enumerate(gradient):
            if exact is None:
                continue
            ours = float(reverse[position][index])
            other = float(forward[position][index])
            where = ([a[index] for a in samples.arguments], position, ours, other, exact)
            if exact == 0:  # does not depend on it at all
                assert ours == other == 0, where
                continue
            scale = total / numbers[position] if CASES[name].path else abs(exact)
            assert abs(mp.mpf(ours) - exact) <= (1e-10 + 100 * eps / left) * scale, where
            assert abs(ours - other) <= 1e-13 * scale, where
