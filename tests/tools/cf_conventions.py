"""What the CF conventions ask of a NetCDF file like ours, by their conformance document."""

import re

import netCDF4
import numpy as np

TYPES = {"i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8", "f4", "f8"}  # from version 1.9 on
UNITS = {"1", "m", "s", "rad", "m s-1", "rad s-1", "m s-2", "Hz"}  # UDUNITS has all


def assert_follows_cf(path):
    assert path.suffix == ".nc"  # 2.1
    with netCDF4.Dataset(path) as file:
        assert file.Conventions == "CF-1.9"  # 2.6.1
        assert isinstance(file.title, str)  # 2.6.2
        assert isinstance(file.source, str)
        assert "coordinates" not in file.ncattrs()  # an attribute of variables
        names = [*file.variables, *file.dimensions]
        names += [name for variable in file.variables.values() for name in variable.ncattrs()]
        for name in {*names, *file.ncattrs()} - {"_FillValue"}:
            assert re.fullmatch("[A-Za-z][A-Za-z0-9_]*", name)  # 2.3
        assert len({name.lower() for name in file.variables}) == len(file.variables)  # 2.3
        for name, variable in file.variables.items():
            _check(file, name, variable)


def _check(file, name, variable):
    attributes = variable.ncattrs()
    assert variable.dtype is str or variable.dtype.str[1:] in TYPES  # 2.2
    assert len(set(variable.dimensions)) == len(variable.dimensions)  # 2.4
    assert variable.long_name  # 3
    if variable.dtype is not str and "flag_values" not in attributes:
        assert variable.units in UNITS  # 3.1
    if "_FillValue" in attributes:  # 2.5.1
        assert variable.getncattr("_FillValue").dtype == variable.dtype
    if "flag_values" in attributes:  # 3.5
        assert variable.flag_values.dtype == variable.dtype
        assert len(variable.flag_meanings.split()) == len(variable.flag_values)
    others = variable.coordinates.split() if "coordinates" in attributes else []
    for other in others:  # 5
        assert set(file.variables[other].dimensions) <= set(variable.dimensions)
    if variable.dimensions == (name,) or name in _scalars(file):  # 5
        assert not {"_FillValue", "missing_value"} & set(attributes)
        steps = np.diff(np.atleast_1d(variable[...]))
        assert (steps > 0).all() or (steps < 0).all()


def _scalars(file):
    return {
        other
        for variable in file.variables.values()
        for other in getattr(variable, "coordinates", "").split()
    }
