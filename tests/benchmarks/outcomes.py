"""Scores of predicted outcomes on 490 shaking-table tests of two rocks.

They make the table of docs/validation.md. The data are the folder
``data/Shake_Table_Response`` of the repository
https://github.com/ZhiangChen/virtual_shake_robot_pybullet, under the GNU General Public License
3.0; nothing of them is in jaxrock. Tests whose table acceleration is not in the folder are left
out. Reading its workbooks needs openpyxl::

    pip install openpyxl
    python tests/benchmarks/outcomes.py FOLDER [--rock 1] [--splits 40] [--seed 0] [--names]

With other seeds the tests are halved in other ways, and another sample of blocks is drawn. With
``--names`` the groups are the names of earthquakes, some of which have several records.
"""

import argparse
import importlib
import re
import time
from pathlib import Path

import jax
import numpy as np

jax.config.update("jax_enable_x64", True)

import jaxrock as jr
from jaxrock.calibration import check_campaign, fit_and_score

GRAVITY = 9.81
STEP = 0.005  # seconds, after the mean of four samples
# Columns of the workbook: the outcome of each rock, and those of the discrete elements.
OUTCOMES = {1: 0, 2: 1}
DISCRETE_ELEMENTS = {1: range(2, 7), 2: range(7, 15)}


def read_workbook(path: Path) -> dict[int, tuple[object, ...]]:
    """Read the rows of a workbook that begin with the number of a test."""
    openpyxl = importlib.import_module("openpyxl")
    sheet = openpyxl.load_workbook(path, data_only=True).worksheets[0]
    rows = sheet.iter_rows(values_only=True)
    return {row[0]: row[1:] for row in rows if isinstance(row[0], int)}


def read_acceleration(path: Path) -> np.ndarray:
    """Read a table acceleration [m/s2]: median off, mean of four samples of 800 per second."""
    columns = np.loadtxt(path, skiprows=1, usecols=(0, 1))
    assert abs(columns[1, 0] - columns[0, 0] - STEP / 4) < 1e-9
    samples = columns[:, 1] - np.median(columns[:, 1])
    whole = len(samples) // 4 * 4
    return GRAVITY * samples[:whole].reshape(-1, 4).mean(axis=1)


def read_tests(folder: Path, by_name: bool) -> tuple[jr.Suite, np.ndarray, list[str]]:
    """Read motions, outcomes (a row for each test) and the group of each motion."""
    outcomes = read_workbook(folder / "Results_Granite.xlsx")
    names = read_workbook(folder / "Earthquake_Records_Info.xlsx")
    records = {}
    groups = []
    for number in sorted(names):
        path = folder / f"Test{number:03}.txt"
        # Some stored copies lack files.
        if not path.exists() or number not in outcomes:
            continue
        records[f"test {number}"] = jr.Record(read_acceleration(path), STEP)
        sequence = re.search(r"RSN(\d+)_([A-Za-z0-9]+)", str(names[number][2]))
        assert sequence is not None
        groups.append(sequence[2].rstrip("x").upper() if by_name else sequence[1])
    rows = [outcomes[int(name.split()[1])] for name in records]
    return jr.Suite(list(records.values()), list(records)), np.array(rows, float), groups


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--rock", type=int, choices=(1, 2), default=1)
    parser.add_argument("--splits", type=int, default=40)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--names", action="store_true")
    options = parser.parse_args()
    suite, table, groups = read_tests(options.folder, options.names)
    overturned = table[:, OUTCOMES[options.rock]] > 0
    print(f"{len(suite)} tests, {len(set(groups))} groups, {overturned.sum()} overturned")
    began = time.perf_counter()
    campaign = check_campaign(suite, overturned, groups, seed=options.seed)
    fit, scores = fit_and_score(campaign, options.splits)
    elapsed = time.perf_counter() - began
    for predictor in scores.predictor.values:
        rows = scores.sel(predictor=predictor)
        pairs = {name: rows[name] for name in ("brier", "log_score", "accuracy")}
        cells = [f"{name} {x.mean():.4f} +- {x.std():.4f}" for name, x in pairs.items()]
        print(f"{predictor:18} {', '.join(cells)}")
    # The stiffness of the discrete elements is that which is best on the fitted half.
    agrees = (table[:, list(DISCRETE_ELEMENTS[options.rock])] > 0) == overturned[:, None]
    names = np.unique(groups)
    accuracies = []
    for split in range(options.splits):
        order = np.random.default_rng(options.seed + split).permutation(len(names))
        fitted = np.isin(groups, names[order[: len(names) // 2]])
        accuracies.append(agrees[~fitted, agrees[fitted].mean(axis=0).argmax()].mean())
    right = np.mean(accuracies)
    print(f"discrete elements  brier {1 - right:.4f}, accuracy {right:.4f}")
    print(fit)
    print(f"{scores.attrs['blocks']} blocks; {elapsed:.0f} s")


if __name__ == "__main__":
    main()
