"""Intensity measures of ground motions: one number that says how strong a record is."""

import warnings

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from ..block import Block
from ..numerics import pick_larger, pick_largest
from ..validation import Numbers, Reals, as_name, check_kind, is_traced
from .record import Record

# The measures of `intensity_measure` by name: description, unit, and whether a measure is
# relative to a block.
MEASURES = {
    "pga": ("peak ground acceleration", "m/s2", False),
    "pgv": ("peak ground velocity", "m/s", False),
    "pga_ratio": ("peak ground acceleration over g tan(alpha_c)", "1", True),
    "pgv_ratio": ("peak ground velocity over g tan(alpha_c) / p", "1", True),
}

# Intensities far beyond all ground motions on record [m/s2, m/s]; hazard curves end below.
LARGEST_INTENSITIES = {"pga": 100.0, "pgv": 20.0}


def warn_of_large_intensities(name: str, levels: Numbers, measure: str) -> None:
    """Warn of levels that no earthquake reaches, which are perhaps in another unit.

    Traced levels, and levels of measures relative to a block, are not checked.

    Parameters
    ----------
    name : str
        What has these levels, for the warning.
    levels : array_like
        [m/s2 or m/s]
    measure : str
        One of `MEASURES`.
    """
    if measure not in LARGEST_INTENSITIES or is_traced(levels):
        return
    largest = float(np.max(np.asarray(levels, float), initial=0.0))
    if largest > LARGEST_INTENSITIES[measure]:
        measure_in_words, unit, _ = MEASURES[measure]
        warnings.warn(
            f"{name} reaches a {measure_in_words} of {largest:.4g} {unit}, more than any"
            " earthquake: is the unit right?",
            stacklevel=3,
        )


def intensity_measure(record: Record, measure: str, block: Block | None = None) -> Reals:
    """Measure how strong the horizontal motion of a record is.

    Parameters
    ----------
    record : Record
    measure : str
        ``"pga"``, the peak ground acceleration [m/s2]; ``"pgv"``, the peak ground velocity
        [m/s], integrated from rest, exactly for straight lines between samples;
        ``"pga_ratio"``, PGA / (g tan(alpha_c)) [-], above 1 where horizontal motion lifts a
        block; ``"pgv_ratio"``, p PGV / (g tan(alpha_c)) [-].
    block : Block, optional
        For the two ratios.

    Returns
    -------
    Array
        Has the shape of the scale of the record, broadcast with the block.

    Raises
    ------
    ValueError
        If there is no such measure, or a ratio is asked for without a block.

    Examples
    --------
    >>> import jaxrock as jr
    >>> record = jr.example_record()
    >>> print(f"{jr.ground_motion.intensity_measure(record, 'pgv'):.3f} m/s")
    0.528 m/s
    """
    measure = as_name("measure", measure, MEASURES)
    check_kind("record", record, Record)
    relative = MEASURES[measure][2]
    # A block that the measure does not need is left out: it would add its shape, and a
    # program.
    if relative and block is None:
        raise ValueError(f"block must be given for the measure {measure!r}")
    return _compute_measure(record.bucketed(), measure, block if relative else None)


def describe_strength(record: Record) -> str:
    """Describe the strength of a record on one line, which shows a wrong unit at once."""
    pga, pgv = (float(intensity_measure(record, name)) for name in ("pga", "pgv"))
    duration = float(record.end - record.start)
    return f"PGA {pga:.3g} m/s2 ({pga / 9.81:.3g} g), PGV {pgv:.3g} m/s, {duration:.4g} s long"


@eqx.filter_jit
def _compute_measure(record: Record, measure: str, block: Block | None) -> Reals:
    """Compute a measure of a record; the block only where the measure is relative to one."""
    if measure.startswith("pga"):
        value = pick_largest(abs(record.acceleration))
    else:
        value = record.time_step * _peak_velocity(record.acceleration, record._last_index)
    value = abs(record.scale) * value
    if block is None:
        return value
    uplift = block.gravity / block.slenderness
    if measure == "pga_ratio":
        return value / uplift
    return block.frequency_parameter * value / uplift


def _peak_velocity(samples: Reals, last: int | Reals) -> Reals:
    """Compute the largest magnitude of velocity, over the time step, until the `last` sample."""
    before = samples[..., :-1]
    after = samples[..., 1:]
    # A padded record falls from its last sample to the first zero. This interval would add to
    # the velocity, but does not belong to the motion.
    inside = jnp.arange(before.shape[-1], dtype=samples.dtype) < jnp.asarray(last)
    velocity = jnp.cumsum(jnp.where(inside, 0.5 * (before + after), 0), axis=-1)
    # Where the acceleration changes its sign, the velocity has an extreme between two samples:
    # the velocity at the second one minus the integral from the zero on, a triangle.
    crosses = inside & (before * after < 0)
    # Without a change of sign the divisor is 1: a divisor of 0 would make derivatives NaN.
    triangle = 0.5 * after * after / jnp.where(crosses, before - after, 1)
    extreme = jnp.where(crosses, velocity + triangle, 0)
    return pick_largest(pick_larger(abs(velocity), abs(extreme)))
