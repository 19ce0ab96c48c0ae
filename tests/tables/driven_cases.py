"""Blocks under the shipped record, with the answers of `references/stepping.py`."""

import csv

from references import stepping

import jaxrock as jr


def cases(stable):
    with open(stepping.CASES, encoding="utf-8") as file:
        rows = [
            {k: v if k == "component" else float(v) for k, v in row.items()}
            for row in csv.DictReader(file)
        ]
    return [row for row in rows if row["stable"] == stable]


def motion_of(row):
    return jr.example_record(row["component"], vertical=bool(row["vertical"])).scaled(
        row["scale"]
    )
