"""Quantities: words, symbol, unit and domain, by the names that they have in the code."""

import re
from typing import NamedTuple

from ..validation import AT_LEAST_ONE, FINITE, NON_NEGATIVE, POSITIVE, UNIT_INTERVAL, Domain


def print_unit(unit: str) -> str:
    """Print a unit in the style of CF, ``m s-2``, as ``m/s2``, and ``1`` as ``-``."""
    # What has a negative power moves behind a stroke.
    printed = re.sub(r"(?:^| )([a-z]+)-1?(\d?)", r"/\1\2", unit)
    return "-" if unit == "1" else re.sub("^/", "1/", printed)


class Quantity(NamedTuple):
    """A quantity as axes, legends, heads of columns and attributes of datasets show it.

    Attributes
    ----------
    words : str
        Its name in words.
    symbol : str
        Its symbol in TeX, without dollar signs; empty for none.
    unit : str
        In the style of the CF conventions, such as ``m s-2``; ``1`` for a ratio.
    domain : Domain
        Values that it may have along an axis.
    """

    words: str
    symbol: str = ""
    unit: str = "1"
    domain: Domain = FINITE


QUANTITIES = {
    # Parameters.
    "slenderness": Quantity("slenderness", r"\lambda", domain=POSITIVE),
    "width": Quantity("width", "2b", "m", POSITIVE),
    "height": Quantity("height", "2a", "m", POSITIVE),
    "half_width": Quantity("half-width", "b", "m", POSITIVE),
    "free_period": Quantity("period of the block", r"2\pi/p", "s", POSITIVE),
    "inertia_ratio": Quantity("inertia ratio", r"\kappa", domain=AT_LEAST_ONE),
    "restitution": Quantity("restitution", "C", domain=UNIT_INTERVAL),
    "intensity": Quantity("pulse intensity", "I", "m s-1", NON_NEGATIVE),
    "amplitude": Quantity("amplitude", "", "m s-2", NON_NEGATIVE),
    "amplitude_ratio": Quantity("amplitude over uplift amplitude", domain=NON_NEGATIVE),
    "duration": Quantity("pulse duration", "", "s", POSITIVE),
    "frequency": Quantity("frequency of the floor", "", "rad s-1", POSITIVE),
    "frequency_ratio": Quantity("frequency of the pulse over p", domain=POSITIVE),
    "factor": Quantity("factor on the motion"),
    "record": Quantity("index of the record", domain=NON_NEGATIVE),
    "pga": Quantity("peak ground acceleration", "", "m s-2", POSITIVE),
    "pgv": Quantity("peak ground velocity", "", "m s-1", POSITIVE),
    # Answers.
    "stabilized_rotation": Quantity("peak rotation", r"\alpha^*_{max}", "rad"),
    "peak_rotation": Quantity("peak rotation", r"\alpha^*_{max}", "rad"),
    "rotation_ratio": Quantity("rotation ratio", r"\alpha^*_{max}/\alpha_c"),
    "stabilized_period": Quantity("stabilized period", "T^*", "s"),
    "amplification": Quantity("amplification", r"\zeta"),
    "margin": Quantity("overturning margin"),
    "overturning_margin": Quantity("overturning margin"),
    "critical_intensity": Quantity("critical intensity", "", "m s-1"),
    "width_at_this_height": Quantity("width at this height", "2b", "m"),
    "width_at_this_slenderness": Quantity("width at this slenderness", "2b", "m"),
    "height_at_this_width": Quantity("height at this width", "2a", "m"),
    # Motion and fits.
    "time": Quantity("time", "", "s"),
    "residual": Quantity("residual", "", "s"),
    "rotation_residual": Quantity("residual of the rotation", "", "rad"),
    "restitution_error": Quantity("standard error of the restitution"),
    "velocity_before": Quantity("velocity before the impact", "", "rad s-1"),
    "velocity_ratio": Quantity("velocity before the impact over the critical one"),
}
# As heads and messages print them: m/s2, and - for a ratio.
UNITS = {name: print_unit(quantity.unit) for name, quantity in QUANTITIES.items()}


def write_label(name: str, words: str = "", unit: str | None = None) -> str:
    """Write name, symbol and unit of a quantity, for an axis or a legend.

    `words` and `unit` replace those of the table. An unknown name becomes words itself.
    """
    known = QUANTITIES.get(name, Quantity(name.replace("_", " "), unit=""))
    symbol = f"{',' * bool(words)} ${known.symbol}$" if known.symbol else ""
    printed = print_unit(known.unit if unit is None else unit).replace("/s2", "/s²")
    return f"{words or known.words}{symbol}" + f" [{printed}]" * bool(printed)
