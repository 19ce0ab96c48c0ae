"""Writes into a folder until a signal comes, in a process of its own.

Usage: writing_until_a_signal.py FOLDER SITUATION
"""

import concurrent.futures
import gc
import sys
import time
from pathlib import Path

from jaxrock.cli.signals import end_on_signals

from jaxrock.host import write_whole


def sleep():
    time.sleep(600)


def collect():
    """In a hook on the garbage collector, as JAX has one: it swallows what is raised there."""
    gc.callbacks.append(lambda *_: time.sleep(0.01))
    while True:
        gc.collect()


def share():
    """In a thread pool, which would be waited for."""
    with concurrent.futures.ThreadPoolExecutor() as pool:
        list(pool.map(lambda _: time.sleep(600), range(4)))


def write():
    while True:
        for k in range(100):
            (scratch / f"file {k}").write_text("x")


def written(folder, situation):
    global scratch
    names = ["first", "second", "third"]
    with write_whole("out", folder, names, False) as scratch:
        for name in names:
            (scratch / name).write_text("x")
        if situation:
            print("ready", flush=True)
            globals()[situation]()


end_on_signals()
written(Path(sys.argv[1]) / "done", None)
written(Path(sys.argv[1]) / "deep" / "er", sys.argv[2])
time.sleep(600)
