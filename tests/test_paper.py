"""The paper recomputed; each comparison is also broken once, to see that it notices."""

import math

import numpy as np
import pytest

import jaxrock as jr
from jaxrock.reports import paper

pytestmark = pytest.mark.float64


@pytest.fixture(scope="module")
def report():
    return paper.regenerate()


def test_nothing_disagrees_but_the_known_fault(report):
    assert report.summarize() == {
        "printed": 94,
        "agreeing": 93,
        "known_faults_in_tables": 1,
        "claims": {"holds": 6, "holds for C <= 0.6": 3, "rests on Eq. 13": 1},
        "faults": {"reproduced": 6},
        "mismatches": [],
    }
    (wrong,) = [row for row in report.entries if not row["agrees"]]
    assert [wrong["table"], wrong["row"]] == ["Table III", "C = 0.9"]
    assert math.isnan(wrong["computed"])
    for row in report.entries:
        if row["table"] in ("Table I", "Table II") and row["row"] != "all":
            assert 0 < row["nonlinear"] / row["computed"] - 1 < 0.02


@pytest.mark.parametrize(
    ("quantity", "at", "printed", "agrees"),
    [
        ("peak_rotation", {"width": 0.4, "slenderness": 3}, "3.83e-3", True),  # 3.8267e-3
        ("peak_rotation", {"width": 0.4, "slenderness": 3}, "3.82e-3", False),
        ("elastic_amplification", {"damping_ratio": 0.0}, "inf", True),
        ("elastic_amplification", {"damping_ratio": 0.01}, "inf", False),
        ("overturning_margin", {"restitution": 0.9}, "overturning", False),
    ],
)
def test_agreement_to_the_digits_printed(quantity, at, printed, agrees):
    at = {"width": 1.2, "slenderness": 4} | at
    table = {"quantity": quantity, "at": at, "unit": 1e-5, "printed": [[printed]]}
    (row,) = paper.compare({"table": "", "title": "", "rows": [""], "columns": [""]} | table)
    assert row["agrees"] == agrees


def test_how_far_claims_hold(report):
    """Each verdict with a limit has a number that says why, computed here by other ways."""
    limited = {row["where"]: row for row in report.claims if row["verdict"] != "holds"}
    assert set(limited) == {"Fig. 3", "Fig. 4", "Figs. 6 to 8", "Table III"}

    def scene_of(slenderness, width, restitution):
        return jr.Scene(jr.Block(width / 2, slenderness), restitution, 0.15)

    for restitution in (0.6, 0.7):
        narrow, wide = (
            jr.stabilized_period(scene_of(10.0, width, restitution)) for width in (0.4, 1.2)
        )
        effect = f"{100 * (narrow / wide - 1):.0f} % at C = {restitution}"
        assert effect in limited["Fig. 3"]["figure"]
        stocky, slender = (
            jr.amplification(scene_of(s, 0.4, restitution)) for s in (3.0, 10.0)
        )
        effect = f"{100 * (slender / stocky - 1):.0f} % at C = {restitution}"
        assert effect in limited["Fig. 4"]["figure"]
    restitution = math.exp(-0.05 / (2 * 0.34))  # of -0.34 ln(C squared)
    assert f"{restitution:.3f}" in limited["Table III"]["figure"]
    assert float(jr.overturning_margin(scene_of(4.0, 1.2, restitution))) < 0
    # Fig. 8 is rounded from where the block falls.
    (claim,) = [row for row in report.claims if row["where"] == "Fig. 8"]
    for width, limit in ((0.4, 4.82), (0.6, 7.09), (0.8, 9.39), (1.0, 11.7)):
        assert f"{limit} ({width} m)" in claim["figure"]
        slenderness = limit + 0.1 ** (2 if limit < 10 else 1) * np.array([-0.51, 0.51])
        ratio = jr.rotation_ratio(scene_of(slenderness, width, 0.8))
        assert np.isnan(ratio).tolist() == [False, True]
