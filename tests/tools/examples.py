"""Run what help and pages show of the commands, as a newcomer would.

``python tests/tools/examples.py FOLDER`` makes the folder with the files that examples name, and
runs there the examples in the help of each command, then the command lines and scripts of the
pages. ``python tests/tools/examples.py FOLDER help`` runs those of help alone, which need none
of the optional packages; ``pages`` instead of ``help`` runs the others. Ends with 1 if a command
fails, prints nothing, warns, or says anything on standard error but how far it is.
"""

import os
import re
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

import jaxrock as jr
from jaxrock.cli import application

ROOT = Path(__file__).parents[2]
# Times of the impacts of a block 0.2 m wide and 1 m high whose restitution is 0.9, to 1 ms.
IMPACTS = (0.0, 0.964, 1.636, 2.173, 2.623, 3.007, 3.34, 3.632, 3.892, 4.122, 4.324, 4.503)
# Objects of a museum, the hazard at its place, and tests of a block under factors on three records.
FILES = {
    "times.csv": "\n".join(["time [s]", *map(str, IMPACTS)]),
    "objects.csv": "name,width [cm],height [m],restitution\nbust,40,1.6,\nvase,28,0.9,0.88\n",
    "hazard.csv": "pgv [m/s],rate [1/yr]\n0.1,2e-2\n0.3,2e-3\n1,1e-4\n3,4e-6\n",
    "tests.csv": "file,scale,overturned\n"
    + "".join(
        f"records/{k}.csv,{factor},{'yes' if factor > least else 'no'}\n"
        for k, least in enumerate((1.3, 1.4, 0.9))
        for factor in (0.5, 0.8, 1, 1.2, 1.6, 2.4)
    ),
}
# Progress: that a long step has ended, or how long one will take.
PROGRESS = re.compile(
    r"jaxrock: (.+: (?:done in|\d+ % after) \d+ s|timing .* takes some \d+ s"
    r"|computing what goes into the folder .*)"
)
BLOCK = re.compile(r"^```[^\n]*\n(.*?)^```", re.DOTALL | re.MULTILINE)


def list_help_examples():
    """List the command lines in the docstrings of all commands."""
    commands = [command for panel in application.COMMANDS.values() for command in panel]
    documented = (command.__doc__ or "" for command in commands)
    return [line for text in documented for line in re.findall(r"Example: (jaxrock .*)", text)]


def list_page_examples(text):
    """List the command lines of a page, and its scripts, each as a whole."""
    examples = []
    for block in BLOCK.findall(text):
        lines = block.replace("\\\n", " ").splitlines()
        commands = [line for line in lines if line.startswith("jaxrock ")]
        examples += [block] if block.startswith("#!/bin/sh") else commands
    return examples


def make_files(folder):
    """Make a folder with the files that examples name."""
    (folder / "records").mkdir(parents=True)
    for name, content in FILES.items():
        (folder / name).write_text(content, encoding="utf-8")
    for number, record in enumerate(list(jr.example_suite())[:3]):
        times = np.arange(record.samples) * float(record.time_step)
        table = np.column_stack([times, record.acceleration])
        path = folder / "records" / f"{number}.csv"
        heads = "time [s],acceleration [m/s2]"
        np.savetxt(path, table, "%.9g", ",", header=heads, comments="")


def run_example(example, folder):
    """Run an example by a shell; return how it fails, or nothing if it does not."""
    # The command that belongs to this Python is the first one that the shell finds.
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    done = subprocess.run(
        ["sh", "-c", example],
        cwd=folder,
        env=os.environ | {"PATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    complaints = [line for line in done.stderr.splitlines() if not PROGRESS.fullmatch(line)]
    if done.returncode == 0 and done.stdout and not complaints:
        return ""
    return f"exit code {done.returncode}\n{done.stdout}\n{done.stderr}"


def main():
    """Run them all, and those that two places show once only."""
    folder = Path(sys.argv[1])
    examples = [] if "pages" in sys.argv else list_help_examples()
    if "help" not in sys.argv:
        for path in (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))):
            examples += list_page_examples(path.read_text(encoding="utf-8"))
    failed = False
    # Each in a folder of its own, where no file of another is in the way.
    for number, example in enumerate(dict.fromkeys(examples)):
        make_files(folder / str(number))
        start = time.perf_counter()
        fault = run_example(example, folder / str(number))
        print(f"{time.perf_counter() - start:6.1f} s  {example.rstrip()}\n{fault}", flush=True)
        failed = failed or bool(fault)
    sys.exit(failed)


if __name__ == "__main__":
    main()
