"""Which cells of the closed forms do not meet their bounds, and by how much."""

import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np
from corners import (
    CORNERS,
    DIGITS_OF_WEAK,
    FLUSHED,
    FUNCTIONS,
    MODELS,
    OF_DERIVATIVES,
    PRECISIONS,
    STEP,
    Exact,
    Function,
    arguments,
    scales,
    scene,
    speed_ratio,
    velocity_of,
)
from references import closed_forms
from tables import frozen

import jaxrock as jr


def answers(function, numbers, reverse=False):
    """Value, gradient and Hessian at all rows of numbers; forward, or forward over reverse."""
    mode = jax.jacrev if reverse else jax.jacfwd

    def of(row):
        value = function.ours(*row)
        return value, value

    def first(row):
        slope, value = mode(of, has_aux=True)(row)
        return slope, (value, slope)

    second = jax.jit(jax.vmap(jax.jacfwd(first, has_aux=True)))
    hessian, (value, gradient) = second(numbers)
    return tuple(np.asarray(part) for part in (value, gradient, hessian))


def frozen_truth(name, precision, corner, row):
    """What `corners.expected` said when the table was written."""
    asked, answer = frozen.entry("corners", name, precision, corner)
    x, undecided, value, gradient, hessian = answer
    assert asked == list(row), (
        f"{corner} is another one: python tests/tools/freezing.py corners"
    )
    if gradient is not None:
        gradient = [frozen.number(digits) for digits in gradient]
        below = iter(map(frozen.number, hessian))
        hessian = [[mp.mpf(0)] * len(row) for _ in row]
        for i in range(len(row)):
            for j in range(i + 1):
                hessian[i][j] = hessian[j][i] = next(below)
    return Exact(frozen.number(x), undecided, frozen.number(value), gradient, hessian)


def failures(name: str, precision: str, reverse: bool = False) -> dict[tuple[str, str], str]:
    """Corner and quantity of the cells that fail, with what is wrong."""
    function = FUNCTIONS[name]
    dtype = PRECISIONS[precision]
    rows = [arguments(corner, function.model_name, dtype) for corner in CORNERS]
    found = answers(function, jnp.asarray(np.array(rows), dtype), reverse)
    assert all(part.dtype == dtype for part in found)
    failed = {}
    for corner, row, value, gradient, hessian in zip(CORNERS, rows, *found, strict=True):
        exact = frozen_truth(name, precision, corner, row)
        with mp.workdps(50):
            wrong = {
                "value": _value_is_wrong(exact, row, value),
                "gradient": _gradient_is_wrong(function, exact, row, value, gradient),
                "Hessian": _hessian_is_wrong(function, exact, row, value, hessian),
            }
        failed |= {(corner, what): why for what, why in wrong.items() if why}
    return failed


def count_failures(model_name: str, precision: str) -> dict[tuple[str, str], str]:
    """The same of `overturning_half_cycle`, whose derivatives are 0.

    The velocity of that half-cycle reaches the critical one, and that of the one before does
    not, up to what rounding may change in them and in the count.
    """
    dtype = PRECISIONS[precision]
    model = MODELS[model_name]
    rows = [arguments(corner, model_name, dtype) for corner in CORNERS]
    function = Function(
        lambda *a: jr.overturning_half_cycle(scene(*a), model),
        lambda *a: None,
        model_name,
        "count",
    )
    failed = {}
    found = answers(function, jnp.asarray(np.array(rows), dtype))
    for corner, row, value, gradient, hessian in zip(CORNERS, rows, *found, strict=True):
        with mp.workdps(DIGITS_OF_WEAK):
            if not _is_overturning_half_cycle(value, tuple(map(mp.mpf, row)), model_name):
                failed[corner, "value"] = f"{value} is not the half-cycle"
        for what, derivatives in (("gradient", gradient), ("Hessian", hessian)):
            if (derivatives != 0).any():
                failed[corner, what] = f"{derivatives} instead of 0"
    return failed


def _is_overturning_half_cycle(value, numbers, model_name):
    eps = float(np.finfo(value.dtype).eps)
    critical = getattr(closed_forms, model_name).critical_velocity(*numbers[:3])
    limit, _ = speed_ratio(numbers, model_name)
    slack = 11 * eps  # as of any value, see `speed_ratio`
    if value == np.inf:
        return limit < 1 + slack

    def ratio(count):
        return velocity_of(*numbers, int(count)) / critical

    latest = mp.ceil(mp.mpf(float(value)) * (1 + 2 * eps))
    earliest = mp.floor(mp.mpf(float(value)) * (1 - 2 * eps))
    if value == 1:
        return ratio(1) >= 1 - slack
    return ratio(latest) >= 1 - slack and (earliest <= 1 or ratio(earliest - 1) < 1 + slack)


def _value_is_wrong(exact, row, value):
    """More than 2 (1 + condition) units in the last place off."""
    limits = np.finfo(value.dtype)
    if exact.undecided and np.isnan(value):
        return None
    if exact.gradient is None:  # by definition inf, -inf, or NaN
        fine = exact.undecided or np.array_equal(value, float(exact.value), equal_nan=True)
        return None if fine else f"{value} instead of {exact.value}"
    if not np.isfinite(value):
        return f"{value} instead of {mp.nstr(exact.value, 8)}"
    units = mp.mpf(float(limits.eps)) * abs(exact.value)
    # To C through the smaller of C and 1 - C: neither subtraction rounds.
    numbers = list(map(mp.mpf, row))
    numbers[3] = min(numbers[3], 1 - numbers[3])
    felt = sum(abs(n * g) for n, g in zip(numbers, exact.gradient, strict=True))
    bound = 2 * (units + felt * float(limits.eps)) + _nothing(exact, 1, value.dtype)
    error = abs(mp.mpf(float(value)) - exact.value)
    return None if error <= bound else _times(error, bound, value, exact.value)


def _gradient_is_wrong(function, exact, row, value, gradient):
    if exact.gradient is None or np.isnan(value):
        return _must_vanish(exact, value, gradient)
    relative = _lost(function, exact, gradient.dtype)
    for ours, theirs, scale in zip(gradient, exact.gradient, scales(row), strict=True):
        bound = relative * abs(theirs) + _nothing(exact, scale, gradient.dtype)
        if not np.isfinite(ours):
            return f"{ours} instead of {mp.nstr(theirs, 8)}"
        error = abs(mp.mpf(float(ours)) - theirs)
        if error > bound:
            return _times(error, bound, ours, theirs)
    return None


def _hessian_is_wrong(function, exact, row, value, hessian):
    if exact.gradient is None or np.isnan(value):
        return _must_vanish(exact, value, hessian)
    relative = _lost(function, exact, hessian.dtype)
    scale = scales(row)
    size = range(len(row))
    total = sum(abs(scale[i] * scale[j] * exact.hessian[i][j]) for i in size for j in size)
    for i in size:
        for j in size:
            ours = hessian[i, j]
            theirs = exact.hessian[i][j]
            bound = relative * total / (scale[i] * scale[j])
            bound += _nothing(exact, scale[i] * scale[j], hessian.dtype)
            if not np.isfinite(ours):
                return f"{ours} instead of {mp.nstr(theirs, 8)} in {i, j}"
            error = abs(mp.mpf(float(ours)) - theirs)
            if error > bound:
                return _times(error, bound, ours, theirs) + f" in {i, j}"
    return None


def _lost(function, exact, dtype):
    """Relative error that a derivative may have, for what rounding takes from 1 - x^2."""
    eps = float(np.finfo(dtype).eps)
    left = 1 - exact.x**2 if function.kind == "standing" else 1
    return OF_DERIVATIVES * eps / left


def _nothing(exact, scale, dtype):
    """What may as well be 0: numbers that are flushed, and the error of the differences."""
    return FLUSHED * float(np.finfo(dtype).tiny) + 10**10 * STEP * abs(exact.value) / scale


def _must_vanish(exact, value, derivatives):
    """Where the value is NaN or infinite; on the verge, where it should be, at least finite."""
    if np.isfinite(value):
        return None if exact.undecided and np.isfinite(derivatives).all() else "not 0"
    return None if (derivatives == 0).all() else f"{derivatives} instead of 0"


def _times(error, bound, ours, theirs):
    return (
        f"{mp.nstr(error / bound, 3)} times the bound: {ours} instead of {mp.nstr(theirs, 8)}"
    )
