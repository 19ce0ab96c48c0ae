"""The README's quickstart runs and gives the numbers that stand beside it."""

import ast
import re
from pathlib import Path

import numpy as np
import pytest

README = Path(__file__).parent.parent / "README.md"


@pytest.mark.float64
def test_quickstart():
    code = re.search(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)[1]
    namespace, compared = {}, 0
    for statement in ast.parse(code).body:
        source = ast.get_source_segment(code, statement)
        if not isinstance(statement, ast.Expr):
            exec(source, namespace)
            continue
        value = eval(source, namespace)
        comment = code.splitlines()[statement.end_lineno - 1].partition("#")[2]
        for number, found in zip(
            re.findall(r"\b0?\d\.\d+", comment), np.ravel(value), strict=False
        ):
            assert f"{found:.{len(number.partition('.')[2])}f}" == number, source
            compared += 1
    assert compared == 7


BLOCKS = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)
BEGIN = "\n".join(BLOCKS[0].splitlines()[:8]) + "\n"


@pytest.mark.float64
def test_driven_motion():
    namespace = {}
    exec(BEGIN + BLOCKS[1], namespace)
    assert namespace["response"].impacts > 1000


@pytest.mark.float64
@pytest.mark.thorough
def test_inverse_design(capsys):
    record = next(line for line in BLOCKS[1].splitlines() if line.startswith("record = "))
    exec(BEGIN + record + "\n" + BLOCKS[2], {})
    printed = capsys.readouterr().out
    edges = re.findall(r"\w+ beyond [\d.]+\d", BLOCKS[2])
    assert len(edges) == 3
    for edge in edges:
        assert edge in printed
