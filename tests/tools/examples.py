"""Run the example of every command as a newcomer would: ``python tests/tools/examples.py FOLDER``.

In a new folder, each in a process of its own, `jaxrock run` with the study of
`docs/commands.md`. Ends with 1 if one of them fails, warns or says anything on standard error but
how long it takes.
"""

import re
import shlex
import subprocess
import sys
import time
from pathlib import Path

from jaxrock.cli.commands import COMMANDS
from jaxrock.cli.study import Run

# Times of the impacts of a block 0.2 m wide and 1 m high whose restitution is 0.9, to 1 ms.
IMPACTS = (0.0, 0.964, 1.636, 2.173, 2.623, 3.007, 3.34, 3.632, 3.892, 4.122, 4.324, 4.503)
# Objects of a museum, and the hazard at its place.
OBJECTS = "name,width [cm],height [m],restitution\nbust,40,1.6,\nvase,28,0.9,0.88\n"
HAZARD = "pgv [m/s],rate [1/yr]\n0.1,2e-2\n0.3,2e-3\n1,1e-4\n3,4e-6\n"
# What a command says of waits: how long something will take, and a line every half a minute.
WAITS = re.compile(r"jaxrock: timing .* takes some \d+ s|jaxrock [a-z-]+: \d+ s(, .*)?")
PAGE = Path(__file__).parents[2] / "docs" / "commands.md"


def main():
    """Run them all."""
    folder = Path(sys.argv[1])
    folder.mkdir()
    study = re.search(r"```toml\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)[1]
    (folder / "study.toml").write_text(study, encoding="utf-8")
    (folder / "times.csv").write_text("\n".join(map(str, IMPACTS)), encoding="utf-8")
    (folder / "objects.csv").write_text(OBJECTS, encoding="utf-8")
    (folder / "hazard.csv").write_text(HAZARD, encoding="utf-8")
    failed = []
    for name, command in {**COMMANDS, "run": Run}.items():
        example = re.search(r"Example: jaxrock (.*)", command.__doc__)[1]
        start = time.perf_counter()
        done = subprocess.run(
            [sys.executable, "-m", "jaxrock", *shlex.split(example)],
            cwd=folder,
            capture_output=True,
            text=True,
            check=False,
        )
        said = [line for line in done.stderr.splitlines() if not WAITS.fullmatch(line)]
        passed = done.returncode == 0 and done.stdout and not said
        print(f"{time.perf_counter() - start:6.1f} s  jaxrock {example}")
        if not passed:
            failed.append(name)
            print(f"exit code {done.returncode}\n{done.stdout}\n{done.stderr}")
    sys.exit(bool(failed))


if __name__ == "__main__":
    main()
