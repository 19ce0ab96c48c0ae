"""Figures: functions that take ``ax=None`` and return the axes they drew on.

Three draw several panels, in the place of `ax` or in a new figure, and return this part or
figure: `plot_free_rocking_fit`, `plot_spectrum` and `plot_rocking_spectrum`. `plot_curves` draws
one panel of `plot_spectrum`.
"""

from .calibration import plot_free_rocking_fit
from .fragility import plot_fragility
from .harmonic import plot_harmonic
from .inventory import plot_inventory
from .outcome_probabilities import plot_outcome_probabilities, plot_sobol_indices
from .outcomes import plot_outcomes, plot_reliability
from .overturning import plot_boundaries, plot_critical_intensity
from .pulses import plot_overturning_map, plot_resonance
from .response import plot_response
from .sensitivity import plot_sensitivity_map, plot_tornado
from .spectra import plot_curves, plot_rocking_spectrum, plot_spectrum
from .tradeoff import plot_tradeoff

__all__ = [
    "plot_boundaries",
    "plot_critical_intensity",
    "plot_curves",
    "plot_fragility",
    "plot_free_rocking_fit",
    "plot_harmonic",
    "plot_inventory",
    "plot_outcome_probabilities",
    "plot_outcomes",
    "plot_overturning_map",
    "plot_reliability",
    "plot_resonance",
    "plot_response",
    "plot_rocking_spectrum",
    "plot_sensitivity_map",
    "plot_sobol_indices",
    "plot_spectrum",
    "plot_tornado",
    "plot_tradeoff",
]
