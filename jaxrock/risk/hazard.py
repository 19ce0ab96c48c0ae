"""Seismic hazard: the yearly rates at which levels of shaking are exceeded."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..host import Printed
from ..validation import (
    POSITIVE,
    Checked,
    Number,
    Numbers,
    Reals,
    as_real,
    is_traced,
    quantity,
)

# Measures that a hazard curve can have. Ratios to a block's threshold are none of them.
HAZARD_MEASURES = ("pgv", "pga")


class Hazard(Printed, Checked):
    """A hazard curve: the yearly rate at which levels of an intensity measure are exceeded.

    Straight between its points in logarithms of both, and without a value beyond them.

    Parameters
    ----------
    levels : array_like, shape (n,)
        Increasing levels of the measure, greater than 0 [m/s2 or m/s].
    rates : array_like, shape (n,)
        Rates of exceedance [1/yr], greater than 0 and falling.
    measure : {"pgv", "pga"}, optional
        The intensity measure of the curve; functions that take the curve refuse another one.

    Raises
    ------
    ValueError
        If the measure is another one, if there are less than two points or not as many rates
        as levels, if a value is not greater than 0, if the levels do not increase or the rates
        do not fall.

    Examples
    --------
    >>> import jaxrock as jr
    >>> hazard = jr.Hazard(levels=[0.1, 1.0], rates=[1e-2, 1e-4])
    >>> print(f"{hazard(0.3162):.5f} 1/yr")
    0.00100 1/yr
    """

    levels: Reals = quantity(POSITIVE)
    rates: Reals = quantity(POSITIVE)
    measure: str | None = eqx.field(static=True, default=None)

    def __init__(self, levels: Numbers, rates: Numbers, measure: str | None = None):
        if measure not in (None, *HAZARD_MEASURES):
            allowed = ", ".join(HAZARD_MEASURES)
            raise ValueError(f"measure must be one of {allowed}, or None, got {measure!r:.60}")
        self.measure = measure
        self.levels = as_real("levels", levels)
        self.rates = as_real("rates", rates)
        shape = self.levels.shape
        of_rates = self.rates.shape
        if len(shape) != 1 or shape[0] < 2:
            must = "levels must be one-dimensional, of at least two values"
            raise ValueError(f"{must}, got an array of shape {shape}")
        if of_rates != shape:
            raise ValueError(f"rates must be as many as levels, {shape[0]}, got {of_rates}")
        self.check()
        # Steps of traced curves cannot be looked at: these are taken as they are.
        for name, values, sign, does in (
            ("levels", self.levels, 1, "increase"),
            ("rates", self.rates, -1, "fall"),
        ):
            if is_traced(values):
                continue
            steps = sign * np.diff(np.asarray(values))
            if (steps <= 0).any():
                at = int(np.argmax(steps <= 0))
                got = f"got {values[at]:.6g} and then {values[at + 1]:.6g}"
                raise ValueError(f"{name} must {does} from each to the next, {got}")

    def __str__(self) -> str:
        low, high = self.levels[:: len(self.levels) - 1]
        often, seldom = self.rates[:: len(self.rates) - 1]
        of = f" of {self.measure}" if self.measure else ""
        return (
            f"hazard{of} from {often:.4g} 1/yr at {low:.4g} to {seldom:.4g} 1/yr at {high:.4g}"
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


@jax.jit
def _interpolate(levels: Reals, rates: Reals, level: Reals) -> Reals:
    """Interpolate rates by straight lines between logarithms; NaN outside."""
    inside = (level >= levels[0]) & (level <= levels[-1])
    # A level outside is replaced before the logarithm: the derivative of the branch that is
    # not taken must not be NaN either.
    at = jnp.log(jnp.where(inside, level, levels[0]))
    rate = jnp.exp(jnp.interp(at, jnp.log(levels), jnp.log(rates)))
    return jnp.where(inside, rate, jnp.nan)
