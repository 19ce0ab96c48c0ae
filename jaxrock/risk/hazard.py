"""Seismic hazard: the rates per year at which levels of shaking are exceeded."""

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..host import Printed
from ..validation import (
    NON_NEGATIVE,
    POSITIVE,
    Checked,
    Number,
    Numbers,
    Reals,
    as_field,
    as_name,
    as_real,
    as_text,
    is_traced,
    quantity,
)

# Measures that a hazard curve can have. Ratios to a block's threshold are none of them.
HAZARD_MEASURES = ("pgv", "pga")


def as_hazard_measure(measure: object) -> str | None:
    """Return the name of a measure of hazards, or None; a `ValueError` if it is no such name."""
    if measure is None:
        return None
    return as_name("measure", measure, HAZARD_MEASURES, or_none=True)


# How much longer a return period than the target's a hazard should reach.
_REACH = 2.5


class Hazard(Printed, Checked):
    """A hazard curve: the rate per year at which levels of an intensity measure are exceeded.

    Log-log linear between its points, NaN outside. Plateaus and trailing rates of 0 are
    allowed. From the last positive rate to the first 0 the rate falls linearly with the
    logarithm of the level; above, it is 0. Rates below the smallest normal floating-point
    number count as 0.

    Parameters
    ----------
    levels : array_like, shape (n,)
        Increasing levels of the measure, greater than 0 [m/s2 or m/s].
    rates : array_like, shape (n,)
        Rates of exceedance [1/yr], not increasing; at least the first two are greater than 0,
        and the last one is less than the first.
    measure : {"pgv", "pga"}, optional
        The intensity measure of the curve; functions that take the curve refuse any other
        measure.
    statistic : str, optional
        Statistic over the logic tree, or part of the hazard, where it is known: "mean",
        "max", "quantile-0.85", "rlz-000", "source FAULT" and so on. It is printed.

    Raises
    ------
    ValueError
        If the measure is unknown, if there are less than two points or not as many rates as
        levels, if a value is out of range, if the levels do not increase, or if the rates
        rise or never fall.

    Examples
    --------
    >>> import jaxrock as jr
    >>> hazard = jr.Hazard(levels=[0.1, 1.0], rates=[1e-2, 1e-4])
    >>> print(f"{hazard(0.3162):.5f} 1/yr")
    0.00100 1/yr
    """

    levels: Reals = quantity(POSITIVE)
    rates: Reals = quantity(NON_NEGATIVE)
    measure: str | None = eqx.field(static=True, default=None)
    statistic: str = eqx.field(static=True, default="")

    _reader: ClassVar[str] = "read_hazard"  # for messages, as in `check_kind`

    def __init__(
        self,
        levels: Numbers,
        rates: Numbers,
        measure: str | None = None,
        statistic: str = "",
    ):
        self.measure = as_hazard_measure(measure)
        self.statistic = as_text(statistic)
        self.levels = as_field(Hazard, "levels", levels)
        self.rates = as_field(Hazard, "rates", rates)
        shape = self.levels.shape
        of_rates = self.rates.shape
        if len(shape) != 1 or shape[0] < 2:
            raise ValueError(
                "levels must be one-dimensional, of at least two values,"
                f" got an array of shape {shape}"
            )
        if of_rates != shape:
            raise ValueError(
                f"rates must have as many values as levels, {shape[0]}, got shape {of_rates}"
            )
        self.check()
        _check_order(self.levels, self.rates)
        if not is_traced(self.rates):
            of_rates = np.asarray(self.rates)
            second = of_rates[1]
            if second < np.finfo(of_rates.dtype).tiny:
                counts = f", which counts as 0 in {of_rates.dtype}" if second else ""
                raise ValueError(
                    f"the first two rates must be greater than 0, got {second:.6g}{counts}"
                )
            if of_rates[0] == of_rates[-1]:
                raise ValueError(
                    f"rates must fall with the level, got {of_rates[0]:.6g} at all levels"
                )

    def __str__(self) -> str:
        last = len(self.levels) - 1 if is_traced(self.rates) else find_last_point(self)
        low, high = self.levels[::last][:2]
        often, seldom = self.rates[::last][:2]
        of = f" of {self.measure}" if self.measure else ""
        statistic = f"{self.statistic} " if self.statistic else ""
        return (
            f"{statistic}hazard{of} from {often:.4g} 1/yr at {low:.4g}"
            f" to {seldom:.4g} 1/yr at {high:.4g}"
        )

    def __call__(self, level: Number) -> Reals:
        """Interpolate the rate of exceedance.

        Parameters
        ----------
        level : array_like
            Of the intensity measure.

        Returns
        -------
        Array, shape (...)
            [1/yr]; NaN outside of the levels of the curve.
        """
        level = as_real("level", level)
        return _interpolate(self.levels, self.rates, level)


def find_last_point(hazard: Hazard) -> int:
    """Find the first point with a rate of 0, or else the last point."""
    rates = np.asarray(hazard.rates)
    positive = rates >= np.finfo(rates.dtype).tiny
    return min(int(np.count_nonzero(positive)), len(rates) - 1)


def compute_return_periods(hazard: Hazard, levels: np.ndarray) -> np.ndarray:
    """Compute return periods of levels [yr]: inf at a rate of 0, NaN outside of the curve."""
    low, high = np.asarray(hazard.levels)[[0, -1]]
    # Levels that were found from the rates at the ends are outside by rounding.
    near = np.clip(levels, low, high)
    inside = np.isclose(near, levels, rtol=1e-6, atol=0)
    with np.errstate(divide="ignore"):
        periods = 1 / np.asarray(hazard(near.astype(low.dtype)))
    return np.where(inside, periods, np.nan)


def write_years(years: float) -> str:
    """Write a number of years with separators of thousands: 2,475, or 0.5."""
    return f"{years:,.0f}" if years >= 10 else f"{years:.3g}"


def describe_end(last_rate: float, target: float) -> str:
    """Describe where a hazard ends that ends before a target, and what would help."""
    return (
        f"the hazard ends at once in {write_years(1 / last_rate)} years; continue it to"
        f" {write_years(_REACH / target)} or ask for a target above it"
    )


def _check_order(levels: Reals, rates: Reals) -> None:
    """Raise a `ValueError` if levels do not increase, or rates rise.

    Steps of traced curves cannot be looked at: these are taken as they are.
    """
    if not is_traced(levels):
        _refuse_steps("levels must increase", np.asarray(levels), np.less_equal)
    if not is_traced(rates):
        _refuse_steps("rates must not rise with the level", np.asarray(rates), np.greater)


def _refuse_steps(rule: str, values: np.ndarray, breaks: np.ufunc) -> None:
    """Raise a `ValueError` that names the first value that breaks a rule after the one before."""
    for k in np.flatnonzero(breaks(values[1:], values[:-1])):
        raise ValueError(f"{rule}, got {values[k + 1]:.6g} after {values[k]:.6g}")


@jax.jit
def _interpolate(levels: Reals, rates: Reals, level: Reals) -> Reals:
    """Interpolate rates by straight lines between logarithms; NaN outside."""
    inside = (level >= levels[0]) & (level <= levels[-1])
    # A level outside, and a rate of 0, are replaced before the logarithm: the derivative of the
    # branch that is not taken must not be NaN either.
    points = jnp.log(levels)
    at = jnp.log(jnp.where(inside, level, levels[0]))
    # What is not normal may be 0 to one operation and not to another.
    positive = rates >= jnp.finfo(rates.dtype).tiny
    # In logarithms the rate would never come down to 0, whatever the first level with 0 is.
    falls_to_zero = (at >= points[positive.sum() - 1]) & ~positive[-1]
    in_logarithms = jnp.exp(jnp.interp(at, points, jnp.log(jnp.where(positive, rates, 1))))
    rate = jnp.where(falls_to_zero, jnp.interp(at, points, rates), in_logarithms)
    return jnp.where(inside, rate, jnp.nan)
