"""The command that regenerates the paper."""

from pathlib import Path

from ..host import write_whole
from ..reports import paper as report_of_paper
from .answers import Answer
from .options import FileOutput, Folder


def paper(*, out: Folder = Path("paper"), output: FileOutput = FileOutput()) -> Answer:
    """Regenerate the paper's tables and figures and compare them with what it prints.

    Writes report.md, the tables as CSV and the figures as PNG. Exits with 1 if anything
    disagrees that is not a known fault of the paper.

    Example: jaxrock paper --out paper

    Parameters
    ----------
    out
        Folder to write to; made if it is missing.
    """
    with write_whole("out", out, report_of_paper.FILES, output.force) as folder:
        report = report_of_paper.regenerate()
        report_of_paper.write(report, folder)
    files = [out / name for name in report_of_paper.FILES]
    count = report.summarize()
    # By the exit code a test run can tell that something disagrees.
    code = 1 if count["mismatches"] else 0
    return Answer(str(report), count, output, files, code=code)
