"""Arguments that carry a unit, as quantities of pint, astropy and unyt do.

Which unit an argument has is declared where the argument is.
"""

import re
from collections.abc import Mapping
from typing import Any

import numpy as np

# Angles in names of units.
_ANGLES = r"rad|deg|\u00b0|arcmin|arcsec|rev|turn|rpm|cycle"


def carries_unit(value: object) -> bool:
    """Return whether a value, or one in a list, carries a unit."""
    # By the class: a module of ours, or a Python number, has no such attribute. Of a list one
    # of each class, since it may be a million numbers.
    if isinstance(value, list | tuple):
        return any(map(carries_unit, {type(part): part for part in value}.values()))
    return hasattr(type(value), "units") or hasattr(type(value), "unit") or bool(_label(value))


# None of the packages is imported here, so that the class of a value is not known.
def convert_to_si(name: str, value: Any, unit: str | None) -> Any:
    """Convert a value that carries a unit to a plain number or array in SI.

    Parameters
    ----------
    name : str
        Name of the argument, for the message.
    value : quantity, or a list of quantities and numbers
    unit : str or None
        Unit of the argument in SI, such as "m/s2"; "" if it is a plain number. None if the
        argument takes no quantity with a unit.

    Returns
    -------
    value : array_like

    Raises
    ------
    ValueError
        If the argument takes no unit, or the value cannot be converted to it.
    """
    if isinstance(value, list | tuple):
        return [
            convert_to_si(name, part, unit) if carries_unit(part) else part for part in value
        ]
    words = " ".join(str(value).split())
    given = words if len(words) <= 60 else f"{words[:57]}..."
    if unit is None:
        raise ValueError(f"{name} must be a number without a unit, in SI, got {given}")
    unit = _spell(unit)
    if label := _label(value):
        # An array of xarray says its unit in words: it is taken if these are the same unit.
        if _spell(label) != unit:
            raise ValueError(
                f"{name} must be in {unit}, got an array whose attribute units is {label!r}"
            )
        return np.asarray(value)
    # Packages take angles for plain numbers: to them a frequency of 1 Hz is 1 rad/s, and 1
    # degree a slenderness of 0.017.
    carried = str(getattr(value, "units", "") or getattr(value, "unit", ""))
    angular = re.search(_ANGLES, carried, re.I) is not None
    if angular != (unit in ("rad", "rad/s")) and (angular or unit == "rad/s"):
        hint = "; a frequency f in Hz is 2 pi f rad/s" if unit == "rad/s" else ""
        raise ValueError(f"{name} must be in the unit {unit}, got {given}{hint}")
    # As all of the packages read it: m/s**2 for m/s2, nothing for 1.
    target = "" if unit == "1" else re.sub(r"(?<=[a-z])(\d)", r"**\1", unit)
    try:
        if hasattr(value, "to_value"):  # astropy, unyt
            return value.to_value(target)
        return value.to(target).magnitude  # pint
    except (AttributeError, TypeError, ValueError):
        raise ValueError(
            f"{name} must be a number in SI, or one with a unit like {unit}, got {given}"
        ) from None


def _label(value: object) -> str:
    """Return the unit that an array of xarray is labelled with; empty if there is none."""
    attributes = getattr(value, "attrs", None)
    if not isinstance(attributes, Mapping) or not hasattr(value, "dims"):
        return ""
    return str(attributes.get("units", ""))


def _spell(unit: str) -> str:
    """Spell a unit as messages do: m/s2 for m/s**2 and m s-2, 1 for no unit."""
    if unit in ("", "1", "-"):
        return "1"
    spelled = (
        unit.replace("\u00b2", "2").replace("**", "").replace("^", "").replace(" s-", "/s")
    )
    return spelled.removesuffix("1")
