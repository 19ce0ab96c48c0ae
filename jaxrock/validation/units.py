"""Arguments that carry a unit, as quantities of pint, astropy and unyt do."""

import re
from collections.abc import Mapping
from typing import Any

import numpy as np

# A name means the same in the whole package, and so does its unit. "" is a plain number. What
# is not here has no unit of its own: levels, for example, which are those of a measure.
_UNITS = {
    **dict.fromkeys(("width", "height", "half_width"), "m"),
    **dict.fromkeys(("time", "times", "duration", "start", "delay", "time_step"), "s"),
    "impact_times": "s",
    **dict.fromkeys(("acceleration", "vertical", "amplitude", "gravity"), "m/s**2"),
    **dict.fromkeys(("intensity", "intensities"), "m/s"),
    **dict.fromkeys(("rotation", "initial_rotation", "rotation_noise"), "rad"),
    **dict.fromkeys(("peak_rotations", "critical_angle"), "rad"),
    **dict.fromkeys(("velocity", "initial_velocity"), "rad/s"),
    **dict.fromkeys(("frequency", "angular_frequency"), "rad/s"),
    "period": "s",
    **dict.fromkeys(("slenderness", "restitution", "inertia_ratio", "damping_ratio"), ""),
    **dict.fromkeys(("scale", "factor", "factors"), ""),
}


# Angles in names of units.
_ANGLES = r"rad|deg|\u00b0|arcmin|arcsec|rev|turn|rpm|cycle"


def carries_unit(value: object) -> bool:
    """Tell whether a value, or one in a list, carries a unit."""
    # By the class: a module of ours, or a Python number, has no such attribute. Of a list one
    # of each class, since it may be a million numbers.
    if isinstance(value, list | tuple):
        return any(map(carries_unit, {type(each): each for each in value}.values()))
    return hasattr(type(value), "units") or hasattr(type(value), "unit") or bool(_label(value))


# None of the packages is imported here, so that the class of a value is not known.
def convert_to_si(name: str, value: Any) -> Any:
    """Convert a value that carries a unit to a plain number or array in SI.

    Raises
    ------
    ValueError
        If the argument has no unit of its own, or the value cannot be converted to it.
    """
    if isinstance(value, list | tuple):
        return [convert_to_si(name, each) if carries_unit(each) else each for each in value]
    unit = _UNITS.get(name)
    said = " ".join(str(value).split())
    got = said if len(said) <= 60 else f"{said[:57]}..."
    if unit is None:
        raise ValueError(f"{name} must be a number without a unit, in SI, got {got}")
    if label := _label(value):
        # An array of xarray says its unit in words: it is taken if these are the same unit.
        if _spell(label) != _spell(unit):
            must = f"{name} must be in {_show(unit)}"
            raise ValueError(f"{must}, got an array whose attribute units is {label!r}")
        return np.asarray(value)
    # Packages take angles for plain numbers: to them a frequency of 1 Hz is 1 rad/s, and 1
    # degree a slenderness of 0.017.
    carried = str(getattr(value, "units", "") or getattr(value, "unit", ""))
    angular = re.search(_ANGLES, carried, re.I) is not None
    if angular != (unit in ("rad", "rad/s")) and (angular or unit == "rad/s"):
        hint = "; a frequency f in Hz is 2 pi f rad/s" if unit == "rad/s" else ""
        raise ValueError(f"{name} must be in {_show(unit)}, got {got}{hint}")
    try:
        if hasattr(value, "to_value"):  # astropy, unyt
            return value.to_value(unit)
        return value.to(unit).magnitude  # pint
    except (AttributeError, TypeError, ValueError):
        must = f"{name} must be a number in SI, or one with a unit like {_show(unit)}"
        raise ValueError(f"{must}, got {got}") from None


def _label(value: object) -> str:
    """Return the unit that an array of xarray is labelled with; empty if there is none."""
    attributes = getattr(value, "attrs", None)
    if not isinstance(attributes, Mapping) or not hasattr(value, "dims"):
        return ""
    return str(attributes.get("units", ""))


def _spell(unit: str) -> str:
    """Spell a unit in one way of many: m/s**2, m/s2 and m s-2 are the same."""
    if unit in ("", "1", "-"):
        return "1"
    spelled = (
        unit.replace("\u00b2", "2").replace("**", "").replace("^", "").replace(" s-", "/s")
    )
    return spelled.removesuffix("1")


def _show(unit: str) -> str:
    """Write a unit as messages do."""
    return unit.replace("**", "") or "1"
