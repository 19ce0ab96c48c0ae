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
    arguments,
    scales,
    scene,
    speed_ratio,
    velocity_of,
    with_derivatives,
)
from references import closed_forms
from tables import frozen

import jaxrock as jr


def compute_cells(function, model_name, precision, mode=jax.jacfwd):
    """The numbers of all corners, and value, gradient and Hessian there."""
    dtype = PRECISIONS[precision]
    rows = [arguments(corner, model_name, dtype) for corner in CORNERS]
    compiled = jax.jit(
        jax.vmap(with_derivatives(lambda numbers: function(*numbers), mode=mode))
    )
    found = [np.asarray(cell) for cell in compiled(jnp.asarray(np.array(rows), dtype))]
    assert all(cell.dtype == dtype for cell in found)
    return zip(CORNERS, rows, *found, strict=True)


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


def failures(name: str, precision: str, mode=jax.jacfwd) -> dict[tuple[str, str], str]:
    """Corner and quantity of the cells that fail, with what is wrong."""
    function = FUNCTIONS[name]
    failed = {}
    cells = compute_cells(function.ours, function.model_name, precision, mode)
    for corner, row, value, gradient, hessian in cells:
        exact = frozen_truth(name, precision, corner, row)
        with mp.workdps(50):
            wrong = {
                "value": _value_is_wrong(exact, row, value),
                "gradient": _derivative_is_wrong(function, exact, row, value, gradient),
                "Hessian": _derivative_is_wrong(function, exact, row, value, hessian),
            }
        failed |= {(corner, what): why for what, why in wrong.items() if why}
    return failed


def count_failures(model_name: str, precision: str) -> dict[tuple[str, str], str]:
    """The same of `overturning_half_cycle`, whose derivatives are 0.

    The velocity of that half-cycle reaches the critical one, and that of the one before does
    not, up to what rounding may change in them and in the count.
    """

    def count(*numbers):
        return jr.overturning_half_cycle(scene(*numbers), MODELS[model_name])

    failed = {}
    for corner, row, value, *derivatives in compute_cells(count, model_name, precision):
        with mp.workdps(DIGITS_OF_WEAK):
            if not _is_overturning_half_cycle(value, tuple(map(mp.mpf, row)), model_name):
                failed[corner, "value"] = f"{value} is not the half-cycle"
        for what, derivative in zip(("gradient", "Hessian"), derivatives, strict=True):
            if (derivative != 0).any():
                failed[corner, what] = f"{derivative} instead of 0"
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


def _derivative_is_wrong(function, exact, row, value, ours):
    """An entry of the gradient, relative to itself, or of the Hessian, relative to all of it."""
    if exact.gradient is None or np.isnan(value):
        # NaN or infinite; on the verge, where it should be neither, at least finite.
        if np.isfinite(value):
            return None if exact.undecided and np.isfinite(ours).all() else "not 0"
        return None if (ours == 0).all() else f"{ours} instead of 0"
    # What rounding takes from 1 - x^2.
    left = 1 - exact.x**2 if function.kind == "standing" else 1
    relative = OF_DERIVATIVES * float(np.finfo(ours.dtype).eps) / left
    theirs = np.array(exact.gradient if ours.ndim == 1 else exact.hessian)
    scale = np.array(scales(row))
    if ours.ndim == 1:
        size = abs(theirs)
    else:
        scale = np.outer(scale, scale)
        size = abs(scale * theirs).sum() / scale
    for place in np.ndindex(ours.shape):
        if not np.isfinite(ours[place]):
            return f"{ours[place]} instead of {mp.nstr(theirs[place], 8)} in {place}"
        bound = relative * size[place] + _nothing(exact, scale[place], ours.dtype)
        error = abs(mp.mpf(float(ours[place])) - theirs[place])
        if error > bound:
            return _times(error, bound, ours[place], theirs[place]) + f" in {place}"
    return None


def _nothing(exact, scale, dtype):
    """What may as well be 0: numbers that are flushed, and the error of the differences."""
    return FLUSHED * float(np.finfo(dtype).tiny) + 10**10 * STEP * abs(exact.value) / scale


def _times(error, bound, ours, theirs):
    return (
        f"{mp.nstr(error / bound, 3)} times the bound: {ours} instead of {mp.nstr(theirs, 8)}"
    )
