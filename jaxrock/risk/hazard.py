"""Seismic hazard: the rates per year at which levels of shaking are exceeded."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..host import Printed
from ..tables import parse_unit
from ..validation import (
    POSITIVE,
    AnyArray,
    Checked,
    Number,
    Numbers,
    Reals,
    as_field,
    as_name,
    as_real,
    check,
    check_increasing,
    choose_namespace,
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

    Log-log linear between its points, NaN outside. Plateaus are allowed.

    Parameters
    ----------
    levels : array_like, shape (n,)
        Increasing levels of the measure, greater than 0 [m/s2 or m/s].
    rates : array_like, shape (n,)
        Rates of exceedance [1/yr], greater than 0, not increasing.
    measure : {"pgv", "pga"}, optional
        The intensity measure of the curve; functions that take the curve refuse any other
        measure.
    statistic : str, optional
        Statistic over the logic tree, or part of the hazard, where it is known: "mean",
        "max", "quantile-0.85", "rlz-000", "source FAULT" and so on. It is printed.
    unit : str, optional
        Unit in which levels are printed, such as "g"; it changes no number.

    Raises
    ------
    ValueError
        If the measure is unknown, if there are less than two points or not as many rates as
        levels, if a value is out of range, if the levels do not increase, or if the rates
        rise.

    Examples
    --------
    >>> import jaxrock as jr
    >>> hazard = jr.risk.Hazard(levels=[0.1, 1.0], rates=[1e-2, 1e-4])
    >>> print(f"{hazard(0.3162):.5f} 1/yr")
    0.00100 1/yr
    """

    levels: Reals = quantity(POSITIVE)
    rates: Reals = quantity(POSITIVE)
    measure: str | None = eqx.field(static=True, default=None)
    statistic: str = eqx.field(static=True, default="")
    unit: str = eqx.field(static=True, default="")

    def __init__(
        self,
        levels: Numbers,
        rates: Numbers,
        measure: str | None = None,
        statistic: str = "",
        unit: str = "",
    ):
        self.measure = as_hazard_measure(measure)
        self.statistic = statistic
        self.unit = unit
        self.levels = check_levels("levels", as_field(Hazard, "levels", levels), 2)
        self.rates = as_field(Hazard, "rates", rates)
        shape = self.levels.shape
        if self.rates.shape != shape:
            raise ValueError(
                f"rates must have as many values as levels, {shape[0]}, got shape"
                f" {self.rates.shape}"
            )
        self.check()
        for k in () if is_traced(self.rates) else np.flatnonzero(np.diff(self.rates) > 0):
            before, after = self.rates[k], self.rates[k + 1]
            raise ValueError(
                f"rates must not rise with the level, got {after:.6g} after {before:.6g}"
            )

    def __str__(self) -> str:
        factor = parse_unit(self.unit).factor if self.unit else 1.0
        low, high = (f"{self.levels[k] / factor:.4g} {self.unit}".rstrip() for k in (0, -1))
        often, seldom = self.rates[0], self.rates[-1]
        of = f" of {self.measure}" if self.measure else ""
        span = f"from {often:.4g} 1/yr at {low} to {seldom:.4g} 1/yr at {high}"
        return f"{self.statistic} hazard{of} {span}".lstrip()

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
        curve = (self.levels, self.rates, as_real("level", level))
        # On the host where all is concrete: JAX would compile a program for each number of levels.
        curve = curve if is_traced(curve) else jax.tree.map(np.asarray, curve)
        return jnp.asarray(_interpolate(*curve), curve[1].dtype)


def write_years(years: float) -> str:
    """Write a number of years with separators of thousands: 2,475, or 0.5."""
    return f"{years:,.0f}" if years >= 10 else f"{years:.3g}"


def describe_end(last_rate: float, target: float) -> str:
    """Describe why it is not known whether a rate meets a target, and what would help."""
    if last_rate <= target:
        return "what was not detected may carry the rate across the target"
    return (
        f"the hazard ends at once in {write_years(1 / last_rate)} years; continue it to"
        f" {write_years(_REACH / target)} or ask for a target above it"
    )


def check_levels(name: str, levels: Numbers, least: int = 1) -> Reals:
    """Return levels as an array; a `ValueError` if they do not increase, or are too few."""
    checked = as_real(name, levels)
    check(name, checked, POSITIVE)
    if checked.ndim != 1 or len(checked) < least:
        number = "two values" if least > 1 else "one value"
        raise ValueError(
            f"{name} must be one-dimensional, of at least {number}, got an array of shape"
            f" {checked.shape}"
        )
    check_increasing(name, checked)
    return checked


def _interpolate(levels: AnyArray, rates: AnyArray, level: AnyArray) -> AnyArray:
    """Interpolate rates by straight lines between logarithms; NaN outside."""
    library = choose_namespace((levels, rates, level))
    inside = (level >= levels[0]) & (level <= levels[-1])
    # A level outside is replaced before the logarithm: the derivative of the branch that is not
    # taken must not be NaN either.
    at = library.log(library.where(inside, level, levels[0]))
    rate = library.exp(library.interp(at, library.log(levels), library.log(rates)))
    return library.where(inside, rate, library.nan)
