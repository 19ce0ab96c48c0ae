"""Tables: the line of heads, units, cells, and what is refused."""

import math

import numpy as np
import pytest

from jaxrock.tables import Column, parse_unit, read_table
from jaxrock.validation import NON_NEGATIVE, POSITIVE

G = 9.80665
COLUMNS = {
    "name": Column(required=True, synonyms=("object",)),
    "width": Column("length", POSITIVE, required=True),
    "period": Column("time", NON_NEGATIVE),
    "damping": Column("ratio"),
    "fixed": Column("flag"),
}
# As a spreadsheet saves it: titles, empty rows and cells, decimal commas, one column more.
SPREADSHEET = (
    "Bl\u00fcten im Museum;;;;;\nS\u00e4le 3, 4;;;;;\n;;;;;\n"
    "Object;Width [cm];Geb\u00e4ude;Fixed;Period (ms);Damping [%];;\n# hier\n"
    '"Vase, ""rot""";20,5;alt;yes;;;;\n;;;;;;;\nB\u00fcste;3e1;;;250;2,5;;\n;;;;;;;\n'
)


@pytest.mark.parametrize(
    ("encoding", "end", "sign"),
    [("utf-8", "\n", ";"), ("utf-8-sig", "\r\n", "\t"), ("utf-16", "\r", ";")],
)
def test_a_table_of_a_spreadsheet(write, encoding, end, sign):
    content = SPREADSHEET.replace(";", sign).replace("\n", end)
    contents = read_table(write(content, encoding=encoding), COLUMNS)
    values = contents.values
    assert values["name"].tolist() == ['Vase, "rot"', "B\u00fcste"]
    np.testing.assert_allclose(values["width"], [0.205, 0.3], rtol=1e-15)
    np.testing.assert_allclose(values["period"], [math.nan, 0.25], rtol=1e-15)
    np.testing.assert_allclose(values["damping"], [math.nan, 0.025], rtol=1e-15)
    assert values["fixed"].tolist() == [True, False]
    assert contents.others == {"Geb\u00e4ude": ["alt", ""]}
    with pytest.raises(ValueError, match=r"a\.csv', line 8: no"):
        contents.require(np.array([True, False]), "no")
    few = read_table(write("width [m],name\n1,a\n"), COLUMNS)
    assert np.isnan(few.values["period"]).all()
    assert few.values["fixed"].tolist() == [False]
    assert few.others == {}


HEAD = "name,width [m],period [s]"
# What is refused, with what the error must contain.
REFUSED = [
    ("", ("text with lines",)),
    (b"PK\3\4\24\0", ("save a spreadsheet as CSV",)),
    ("name,heigth [m]\na,1\n", ("line 1", "name, width [m]", "heigth")),
    ("name,width\na,1\n", ("line 1", "'width'", "'width [m]'")),
    # Cells: of all rows of a column at once.
    (f"{HEAD}\na,1,0\nb,-1,x\nc,,1\n", ("line 3", "width", "'-1'", "line 4", "got ''")),
    (f'{HEAD}\n"a,1,2\n', ("line 2", "cells")),
    (f"{HEAD}\na,1,0.25\nb,1", ("line 3", "3 cells", "got 2")),
]


@pytest.mark.parametrize(("content", "words"), REFUSED)
def test_what_is_refused(write, content, words):
    with pytest.raises(ValueError, match=r"^'.*a\.csv'") as error:
        read_table(write(content), COLUMNS)
    assert all(word in str(error.value) for word in words), str(error.value)


UNITS = [
    ("m/s2, M/s^2, m s^-2, m/(s^2), m/s/s, m/s\u00b2, m s\u207b\u00b2", "acceleration", 1),
    ("cm/sec/sec, gal", "acceleration", 0.01),
    ("g, G", "acceleration", G),
    ("ft, feet", "length", 0.3048),
    ("cm/s, cm s-1", "velocity", 0.01),
    ("ms, msec", "time", 0.001),
    ("1/yr, per year, 1/a", "rate", 1),
    ("yr, years, anni", "years", 1),
    ("%", "ratio", 0.01),
    ("foo, counts, m/s3, V/g, 10 g, kg m/s2, ", "", math.nan),
]


def test_units():
    for spellings, dimension, factor in UNITS:
        for spelling in spellings.split(", "):
            unit = parse_unit(spelling)
            assert unit.dimension == dimension, spelling
            assert unit.factor == pytest.approx(factor, rel=1e-15, nan_ok=True), spelling
