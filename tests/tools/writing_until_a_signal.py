"""Writes into a folder until a signal comes, in a process of its own.

Usage: writing_until_a_signal.py FOLDER
"""

import sys
import time
from pathlib import Path

from jaxrock.host import write_whole

NAMES = ("first", "second", "third")

folder = Path(sys.argv[1])
for target, waits in ((folder / "done", False), (folder / "deep" / "er", True)):
    with write_whole("out", target, NAMES, False) as scratch:
        for name in NAMES:
            (scratch / name).write_text("x")
        if waits:
            print("ready", flush=True)
            time.sleep(600)
