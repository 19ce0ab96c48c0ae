"""The result of a fit to free rocking: parameters, their errors, and remarks."""

from typing import Any, ClassVar

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from ..block import Block
from ..host import Shown
from ..validation import Booleans, Integers, Reals
from .free_rocking_motion import PARAMETERS

SIGNIFICANT = 3.0  # number of standard errors above which there is a remark
NEGLIGIBLE = 1e-6  # change of C without a remark: under exact times any change is significant
_UNITS = {
    "restitution": "",
    "frequency_parameter": "1/s",
    "critical_angle": "rad",
    "launch_ratio": "",
    "first_impact": "s",
    "time_noise": "s",
    "rotation_noise": "rad",
}


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
        Standard errors by the names above; 0 for a parameter that was given, NaN for one that
        is unknown.
    covariance : Array, shape (5, 5)
        Covariance of the parameters, in the order of `names`.
    time_residuals, rotation_residuals : Array
        Computed minus measured times [s] and peaks [rad]; NaN where a measurement was left
        out.
    time_noise, rotation_noise : Array
        Standard deviations of a measured time [s] and peak [rad], given or estimated.
    impact_times : Array, shape (n,)
        The times as they were given [s].
    impact_numbers : Array of int, shape (n,)
        Number of the impact that each time belongs to, from 0 on.
    used : Array of bool, shape (n,)
        Whether the fit uses the time.
    velocity_ratios, restitutions, restitution_errors : Array, shape (n - 2,)
        For each impact except the first and the last: velocity before it over the critical
        velocity, C of this impact alone, and the standard error of this C; NaN next to
        missing impacts.
    restitution_change, restitution_change_error : Array
        C of the largest impact minus C of the smallest one, if C is linear in the velocity,
        and its standard error.
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
    degrees_of_freedom: Reals
    block: Block | None
    model: str = eqx.field(static=True)
    repairs: tuple[str, ...] = eqx.field(static=True)
    notes: tuple[str, ...] = eqx.field(static=True, default=())

    picture: ClassVar[str] = "plot_free_rocking_fit"

    @property
    def names(self) -> tuple[str, ...]:
        """The names of rows and columns of `covariance`."""
        return PARAMETERS

    @property
    def is_constant(self) -> bool:
        """Whether one constant C explains the data: its change is less than 3 of its errors."""
        change = abs(float(self.restitution_change))
        least = max(SIGNIFICANT * float(self.restitution_change_error), NEGLIGIBLE)
        return not change > least

    @property
    def remarks(self) -> tuple[str, ...]:
        """Remarks to read before using the results."""
        # Repairs of the measurements come first: all results depend on them.
        sentences = [*self.repairs, *self.notes]
        if not self.is_constant:
            sentences.append(
                f"one constant C does not explain the data: from the largest to the smallest"
                f" impact it changes by {-float(self.restitution_change):.3g} +-"
                f" {float(self.restitution_change_error):.2g}"
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
        # A restitution compares the half-cycles before and after an impact; the first and the
        # last time have only one of them.
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
        names = (*_UNITS, "restitution_change", "restitution_change_error")
        numbers = {name: float(getattr(self, name)) for name in names}
        counts = {"impacts": self.used.size, "used": int(self.used.sum())}
        counts["degrees_of_freedom"] = int(self.degrees_of_freedom)
        errors = {name: float(error) for name, error in self.standard_errors.items()}
        lists = {"standard_errors": errors, "remarks": list(self.remarks)}
        return {"model": self.model, **counts, **numbers, **lists}

    def __str__(self) -> str:
        lines = []
        for name, unit in _UNITS.items():
            value = float(getattr(self, name))
            error = float(self.standard_errors.get(name, np.nan))
            # No errors of the noises are known.
            known = "given" if error == 0 else f"+- {error:.2g}" if error > 0 else ""
            if not np.isnan(value):
                line = f"{name.replace('_', ' '):20}{value:.6g} {unit}".rstrip()
                lines.append(f"{line} {known}".rstrip())
        return "\n".join([*lines, f"by the {self.model} model", *self.remarks])
