"""The answer of a test of free rocking: numbers, their errors, and remarks on them."""

from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..block import Block
from ..host import Shown, format_fields
from ..validation import Booleans, Integers, Reals
from .free_rocking_motion import NUMBERS

# p-values below which there is a remark.
_SIGNIFICANT = 0.05
OTHER_BLOCK = 0.01
NEGLIGIBLE = 1e-6  # change of C, however significant: exact times make any change so
_SUMMARY = (
    *("time_noise", "rotation_noise", "restitution_change", "restitution_change_error"),
    *("restitution_change_p_value", "frequency_p_value", "degrees_of_freedom"),
)


class FreeRockingFit(Shown, eqx.Module):
    """Parameters of a block fitted to a test of free rocking; see `fit_free_rocking`.

    Attributes
    ----------
    restitution, frequency_parameter, critical_angle : Array
        C [-], p [1/s] and alpha_c [rad], each given or fitted; NaN where unknown.
    launch_ratio, first_impact : Array
        Velocity after the first impact over the critical velocity [-], and the time of that
        impact [s].
    standard_errors : dict of Array
        Standard errors by the names above; 0 for a parameter that was given.
    covariance : Array, shape (5, 5)
        Covariance of the parameters, in the order of `names`.
    time_residuals, rotation_residuals : Array
        Computed minus measured times [s] and peaks [rad]; NaN where a measurement was left
        out.
    time_noise, rotation_noise : Array
        Standard deviations of a measured time [s] and peak [rad], given or estimated.
    impact_times : Array, shape (n,)
        The times as they were given [s]; empty if only peaks were given.
    impact_numbers : Array of int, shape (n,)
        Number of the impact that each time belongs to, from 0 on.
    used : Array of bool, shape (n,)
        Whether the fit uses the time.
    velocity_ratios, restitutions, restitution_errors : Array, shape (n - 2,)
        For each impact except the first and the last: velocity before it over the critical
        velocity, C of this impact alone, and the standard error of this C; NaN next to
        missing impacts.
    restitution_change, restitution_change_error, restitution_change_p_value : Array
        C of the largest impact minus C of the smallest one, if C is linear in the velocity;
        its standard error; and its p-value, the probability of at least this change by chance
        if C is constant.
    frequency_p_value : Array
        p-value of the given p: the probability that by chance another p fits better by at
        least this much if the given p is right; NaN where p is fitted.
    degrees_of_freedom : Array
        Number of measurements minus number of fitted parameters.
    block : Block or None
        The given block, or the block with the fitted p and alpha_c if both are known; else
        None.
    model : str
        The equation of motion, ``"linearized"`` or ``"nonlinear"``.
    repairs : tuple of str
        Which impacts are missing, which times were left out.
    notes : tuple of str
        What the measurements leave in doubt.
    """

    restitution: Reals
    frequency_parameter: Reals
    critical_angle: Reals
    launch_ratio: Reals
    first_impact: Reals
    standard_errors: dict[str, Reals]
    covariance: Float[Array, "*batch 5 5"]
    time_residuals: Reals
    rotation_residuals: Reals
    time_noise: Reals
    rotation_noise: Reals
    impact_times: Reals
    impact_numbers: Integers
    used: Booleans
    velocity_ratios: Reals
    restitutions: Reals
    restitution_errors: Reals
    restitution_change: Reals
    restitution_change_error: Reals
    restitution_change_p_value: Reals
    frequency_p_value: Reals
    degrees_of_freedom: Reals
    block: Block | None
    model: str = eqx.field(static=True)
    repairs: tuple[str, ...] = eqx.field(static=True)
    notes: tuple[str, ...] = eqx.field(static=True, default=())

    picture: ClassVar[str] = "plot_free_rocking_fit"

    @property
    def names(self) -> tuple[str, ...]:
        """The names of rows and columns of `covariance`."""
        return NUMBERS

    @property
    def remarks(self) -> tuple[str, ...]:
        """Remarks to read before using the results."""
        # What was done to the measurements comes first: all other numbers follow from it.
        sentences = [*self.repairs, *self.notes]
        change = abs(float(self.restitution_change)) > NEGLIGIBLE
        if change and float(self.restitution_change_p_value) < _SIGNIFICANT:
            sentences.append(
                f"one constant C does not explain the data: from the largest to the smallest"
                f" impact it changes by {-float(self.restitution_change):.3g} +-"
                f" {float(self.restitution_change_error):.2g}"
                f" (p-value {float(self.restitution_change_p_value):.2g})"
            )
        if float(self.frequency_p_value) < OTHER_BLOCK:
            sentences.append(
                f"the durations are not those of this block, or C is not constant: another p"
                f" explains them better (p-value {float(self.frequency_p_value):.2g});"
                " frequency_known=False fits it"
            )
        if float(self.standard_errors["frequency_parameter"]) > 0.5 * self.frequency_parameter:
            sentences.append("these measurements do not determine p: give the block")
        return tuple(sentences)

    def table(self) -> dict[str, list[Any]]:
        """List a row for each time, with NaN where a column has no value.

        Returns
        -------
        dict of list
        """
        # A restitution compares the half-cycles before and after an impact, which the first
        # and the last time do not have.
        columns = {
            "impact": self.impact_numbers,
            "time": self.impact_times,
            "used": self.used,
            "residual": self.time_residuals,
            "velocity_ratio": np.pad(self.velocity_ratios, 1, constant_values=np.nan),
            "restitution": np.pad(self.restitutions, 1, constant_values=np.nan),
            "restitution_error": np.pad(self.restitution_errors, 1, constant_values=np.nan),
        }
        if self.rotation_residuals.size:
            columns["rotation_residual"] = np.append(self.rotation_residuals, np.nan)
        return {name: np.asarray(column).tolist() for name, column in columns.items()}

    def summarize(self) -> dict[str, object]:
        """Summarize the fit in numbers by name, NaN for those that it does not determine.

        Returns
        -------
        dict
        """
        values = {name: float(getattr(self, name)) for name in self.names}
        errors = {
            name: np.nan if np.isnan(value) else float(self.standard_errors[name])
            for name, value in values.items()
        }
        numbers = {name: float(getattr(self, name)) for name in _SUMMARY}
        counts = {"impacts": self.used.size, "used": int(self.used.sum())}
        lists = {"standard_errors": errors, "remarks": list(self.remarks)}
        return {"model": self.model, **counts, **values, **numbers, **lists}

    def __str__(self) -> str:
        units = dict(zip(NUMBERS, ("s", "", "", "1/s", "rad"), strict=True))
        if jnp.ndim(self.restitution):
            return format_fields(self, **units)
        order = ("restitution", "frequency_parameter", "critical_angle", *NUMBERS[:2])
        lines = []
        for name in order:
            value = float(getattr(self, name))
            error = float(self.standard_errors[name])
            if not np.isnan(value):
                known = f"+- {error:.2g}" if error else "given"
                lines.append(
                    f"{name.replace('_', ' '):20}{value:.6g} {units[name]} {known}".rstrip()
                )
        for name, unit in (("time_noise", "s"), ("rotation_noise", "rad")):
            if np.isfinite(float(getattr(self, name))):
                lines.append(format_fields(self, **{name: unit}))
        why = ", the only one without a block" if self.block is None else ""
        return "\n".join([*lines, f"by the {self.model} model{why}", *self.remarks])
