"""Writes into a folder until a signal comes; in a process of its own, without JAX.

Usage: writing_until_a_signal.py PACKAGE FOLDER SITUATION
"""

import concurrent.futures
import gc
import hashlib
import importlib
import os
import sys
import time
import types
from pathlib import Path

package = types.ModuleType("jaxrock")  # whose own imports take seconds
package.__path__ = [sys.argv[1]]
sys.modules["jaxrock"] = package
files = importlib.import_module("jaxrock.host.files")
signals = importlib.import_module("jaxrock.host.signals")


def sleep():
    time.sleep(600)


def compute():
    """In C, where Python does not run any handler."""
    hashlib.pbkdf2_hmac("sha256", b"", b"", 10**9)


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


def move():
    """Just while the files are moved to where they belong."""

    def slowly(source, target, replace=os.replace):
        time.sleep(0.2)
        replace(source, target)

    os.replace = slowly


def finish():
    """And leave something to be taken apart after that."""

    class Apart:
        def __del__(self, write=os.write):
            write(2, b"taken apart")

    sys.apart = Apart()
    signals.finish(3)
    sys.exit(3)


def written(folder, situation):
    global scratch
    names = ["first", "second", "third"]
    with files.written_whole("out", folder, names, False) as scratch:
        for name in names:
            (scratch / name).write_text("x")
        if situation:
            print("ready", flush=True)
            globals()[situation]()


signals.watch()
written(Path(sys.argv[2]) / "done", None)
written(Path(sys.argv[2]) / "deep" / "er", sys.argv[3])
time.sleep(600)
