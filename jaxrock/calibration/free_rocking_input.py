"""What is measured in a test of free rocking and what is known of the block, checked."""

from typing import Any

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
import numpy as np

from ..block import Block
from ..resonance import Linearized, RockingModel
from ..validation import FINITE, POSITIVE, Number, as_real, check, check_kind
from .impact_numbers import MAX_REPAIRS, Numbering
from .least_squares import ANGLE, FREQUENCY, Known, Measured, Noises

_ANY_SHAPE = 5.0  # slenderness where none is known: the linearized equation has no shape


def measurements(impact_times: Any, peak_rotations: Any) -> tuple[Measured, bool]:
    """The measurements as they are given, and whether they are traced; if not, in NumPy."""
    if impact_times is None and peak_rotations is None:
        raise ValueError("impact_times or peak_rotations must be given, got neither")
    times = None if impact_times is None else as_real("impact_times", impact_times)
    peaks = None if peak_rotations is None else as_real("peak_rotations", peak_rotations)
    given = [part for part in (times, peaks) if part is not None]
    for name, values in (("impact_times", times), ("peak_rotations", peaks)):
        if values is not None and values.ndim != 1:
            raise ValueError(
                f"{name} must be one-dimensional, got an array of shape {values.shape}"
            )
    if times is not None and peaks is not None and peaks.size != times.size - 1:
        raise ValueError(
            f"peak_rotations must be one less than impact_times, {times.size - 1}, got {peaks.size}"
        )
    traced = any(isinstance(part, jax.core.Tracer) for part in given)
    if not traced:
        _check_times(times)
        _check_peaks(peaks)
    numpy: Any = jnp if traced else np
    dtype = given[0].dtype
    t = numpy.zeros(1, dtype) if times is None else numpy.asarray(times)
    a = numpy.zeros(0, dtype) if peaks is None else numpy.abs(numpy.asarray(peaks, dtype))
    known = ~numpy.isnan(a)
    return Measured(
        times=t,
        time_counts=numpy.full(t.shape, times is not None),
        impacts=np.arange(t.size),
        peaks=numpy.where(known, a, 0),
        peak_counts=known,
        arcs=np.arange(a.size),
        room=max(t.size, a.size + 1) + MAX_REPAIRS,
    ), traced


def _check_times(times: Any) -> None:
    if times is None:
        return
    values = np.asarray(times)
    check("impact_times", values, FINITE)
    steps = np.diff(values)
    if (steps <= 0).any():
        at = int(np.argmax(steps <= 0))
        raise ValueError(
            "impact_times must increase from each to the next,"
            f" got {values[at]:.6g} and then {values[at + 1]:.6g}"
        )


def _check_peaks(peaks: Any) -> None:
    if peaks is None:
        return
    values = np.asarray(peaks)
    wrong = (values == 0) | (abs(values) > np.pi / 2)
    if wrong.any():
        raise ValueError(
            "peak_rotations must be between -pi / 2 and pi / 2 and not 0, or NaN where unknown,"
            f" got {values[wrong][0]:g}"
        )


def known_of(
    block: Block | None, measured: Measured, model: RockingModel, frequency_known: bool
) -> Known:
    """What need not be fitted."""
    timed, peaked = measured.times.size > 1, measured.peaks.size > 0
    if block is None and not isinstance(model, Linearized):
        raise ValueError("block must be given for the nonlinear model, which depends on its shape")
    if block is None and not timed:
        raise ValueError("block must be given with peak_rotations alone, got None")
    if block is not None:
        check_kind("block", block, Block)
    shape = Block(0.2, _ANY_SHAPE) if block is None else block
    if jnp.ndim(shape.critical_angle):
        raise ValueError("block must be one block, got several; jax.vmap takes many")
    dtype = measured.times.dtype
    free = [timed, True, True, timed and (block is None or not frequency_known)]
    free += [block is None and peaked, False]
    numbers: Any = np.zeros(6, dtype)
    if block is not None:
        values = block.frequency_parameter, block.critical_angle
        traced = any(isinstance(value, jax.core.Tracer) for value in values)
        numpy: Any = jnp if traced else np
        logarithms = numpy.log(numpy.stack(values)).astype(dtype)
        numbers = numpy.concatenate([numbers[:FREQUENCY], logarithms, numbers[ANGLE + 1 :]])
    unknowns = sum(free)
    of_times, of_peaks = measured.times.size * timed, measured.peaks.size
    if of_times + of_peaks <= unknowns:
        name, given = ("impact_times", of_times) if timed else ("peak_rotations", of_peaks)
        least = unknowns + 1 - (of_peaks if timed else 0)
        raise ValueError(f"{name} must be at least {least} to fit {unknowns} numbers, got {given}")

    def converted(leaf: Any) -> Any:
        return leaf if isinstance(leaf, jax.core.Tracer) else np.asarray(leaf, dtype)

    return Known(jax.tree.map(converted, shape), numbers, np.array(free))


def noises_of(measured: Measured, times: Number | None, rotations: Number | None) -> Noises:
    """As given, or of the right size to begin with."""
    sizes = []
    for name, value in (("time_noise", times), ("rotation_noise", rotations)):
        array = as_real(name, 1.0 if value is None else value)
        check(name, array, POSITIVE)
        if array.ndim:
            raise ValueError(f"{name} must be one number, got an array of shape {array.shape}")
        traced = isinstance(array, jax.core.Tracer)
        sizes.append(array if traced else np.asarray(array, measured.times.dtype))
    numpy: Any = np if isinstance(measured.times, np.ndarray) else jnp
    span = (measured.times[-1] - measured.times[0]) / measured.times.size
    largest = numpy.max(measured.peaks, initial=0)
    for k, (value, guess) in enumerate(((times, span), (rotations, largest))):
        if value is None:
            sizes[k] = numpy.asarray(sizes[k] * numpy.where(guess > 0, 0.01 * guess, 1))
    return Noises(sizes[0], sizes[1], (times is not None, rotations is not None))


def padded(measured: Measured) -> Measured:
    """With measurements that do not count behind the others, so that few sizes are compiled."""
    times, peaks = measured.times.size, measured.peaks.size
    room = max(8, 1 << (max(times, peaks + 1) - 1).bit_length())
    more = {"times": room - times if times > 1 else 0, "peaks": room - 1 - peaks if peaks else 0}

    def wide(values: Any, kind: str) -> Any:
        return np.pad(values, (0, more[kind]), mode="edge")

    return Measured(
        times=wide(measured.times, "times"),
        time_counts=np.pad(measured.time_counts, (0, more["times"])),
        impacts=wide(measured.impacts, "times"),
        peaks=np.pad(measured.peaks, (0, more["peaks"])),
        peak_counts=np.pad(measured.peak_counts, (0, more["peaks"])),
        arcs=np.pad(measured.arcs, (0, more["peaks"])),
        room=room + MAX_REPAIRS,
    )


def with_numbers(measured: Measured, numbering: Numbering) -> Measured:
    """The measurements with their numbers; peaks count between impacts in succession."""
    impacts, used = numbering.impacts, numbering.used
    more, peaks = measured.times.size - impacts.size, measured.peaks.size
    new: dict[str, Any] = {
        "impacts": np.pad(impacts, (0, more), mode="edge"),
        "time_counts": np.pad(used, (0, more)),
    }
    if peaks:
        whole = used[:-1] & used[1:] & (np.diff(impacts) == 1)
        room = (0, peaks - whole.size)
        new["arcs"] = np.pad(impacts[:-1], room)
        new["peak_counts"] = measured.peak_counts & np.pad(whole, room)
    names = tuple(new)
    return eqx.tree_at(lambda m: [getattr(m, name) for name in names], measured, [*new.values()])
