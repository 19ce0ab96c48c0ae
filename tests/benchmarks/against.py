"""Whether this tree has become slower than another commit: first calls and next ones.

Run as ``python tests/benchmarks/against.py REVISION [words] [--repeats N] [--margin X]``: with
words only questions that have one of them in their name. Both trees answer the same questions,
those of this file, on the same Python. In each repeat each tree has a process of its own, where
nothing is compiled. The two take turns, so that a ratio is of the same seconds. Processor time
counts, of all threads of a process; that of a first call includes the imports. What takes longer
than the margin allows, and longer in most repeats, is marked; with one repeat that may be chance.
"""

import argparse
import io
import json
import statistics
import subprocess
import sys
import tarfile
import tempfile
import time
from pathlib import Path

import first_calls

ROOT = Path(__file__).parents[2]
TURNS = 7  # of next calls, in each repeat
LEAST = 0.1  # seconds of a turn, which has as many calls as that takes
PULSES = """
random = np.random.default_rng(0)
blocks = jr.Block(random.uniform(0.1, 0.5, 2000), random.uniform(3, 8, 2000))
pulses = jr.Sine(9.81 * random.uniform(1.2, 4, 2000) / np.asarray(blocks.slenderness), 0.5)
"""
SHARED = (
    *("respond, pulse", "jacfwd of respond", "respond_batch, 1,000 blocks", "respond_within"),
    *("critical_amplitude", "overturning_boundaries, record", "fragility, 20 records"),
    *("overturning_rate, 20 records", "harmonic_orbit", "pulsed_phase"),
)
QUESTIONS = {name: first_calls.CASES[name] for name in SHARED} | {
    "respond, record x 1.5": (
        "record = jr.example_record().scaled(1.5)",
        "jr.respond(block, 0.7, record, 70.0)",
    ),
    "respond_batch, pulses": (PULSES, "jr.respond_batch(blocks, 0.7, pulses, 1.0)"),
    "respond_within, pulses": (PULSES, "jr.respond_within(blocks, 0.7, pulses, 1e-6, 1.0)"),
    "worst_train, 8 pulses": ("", "jr.worst_train(wall.block, 0.7, 8)"),
    "rotation_ratio, a million": (
        "walls = jr.Scene(jr.Block(jnp.linspace(0.2, 0.6, 1_000_000), 5.0), 0.7, 0.15)",
        "jr.rotation_ratio(walls)",
    ),
}


def answer(name):
    """In a process of its own: answer once, then for a turn whenever a line comes in.

    Prints seconds of processor time, first with the imports, then of one call.
    """
    import jax

    call = first_calls.prepare(name, QUESTIONS)
    jax.block_until_ready(call())
    print(json.dumps([sys.modules["jaxrock"].__file__, time.process_time()]), flush=True)
    for _ in sys.stdin:
        begin = time.process_time()
        seconds = 0.0
        calls = 0
        while seconds < LEAST:
            jax.block_until_ready(call())
            calls += 1
            seconds = time.process_time() - begin
        print(json.dumps(seconds / calls), flush=True)


class Process:
    """A process that answers one question by the package of one tree."""

    def __init__(self, tree, name):
        self._process = subprocess.Popen(
            [sys.executable, __file__, "--answer", name],
            env=first_calls.clean_environment() | {"PYTHONPATH": str(tree)},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        imported, self.first = self._read()
        if tree not in Path(imported).parents:
            raise RuntimeError(f"jaxrock comes from {imported}, not from {tree}")

    def _read(self):
        line = self._process.stdout.readline()
        if not line:
            raise ChildProcessError("it failed, see above")
        return json.loads(line)

    def take_turn(self):
        """Processor time of a next call [s]."""
        print(file=self._process.stdin, flush=True)
        return self._read()

    def stop(self):
        self._process.communicate()


def compare(trees, name, repeats):
    """Processor times of both trees [s]: pairs of first calls, and of next ones."""
    first = []
    following = []
    for repeat in range(repeats):
        processes = {}
        order = (0, 1) if repeat % 2 == 0 else (1, 0)
        try:
            for k in order:
                processes[k] = Process(trees[k], name)
            first.append([processes[k].first for k in (0, 1)])
            turns = [{k: processes[k].take_turn() for k in order} for _ in range(TURNS)]
            # One pair: how a process lies in memory may make 15 % for all of its turns.
            following.append([statistics.median(turn[k] for turn in turns) for k in (0, 1)])
        finally:
            for process in processes.values():
                process.stop()
    return first, following


def describe(pairs, margin):
    """Both times [ms], the median ratio with its quartiles, and a mark above the margin."""
    ratios = sorted(this / that for this, that in pairs)
    median = statistics.median(ratios)
    low = ratios[len(ratios) // 4]
    high = ratios[-1 - len(ratios) // 4]
    times = [1e3 * statistics.median(column) for column in zip(*pairs, strict=True)]
    mark = " SLOWER" if median > margin and low > 1 else ""
    ratio = f"{median:5.2f} ({low:.2f} to {high:.2f})"
    return f"{times[0]:9.3f} /{times[1]:9.3f} {ratio}{mark:7}"


def unpack(revision, folder):
    """Write the package as it was in a commit into a folder, of which git keeps no note."""
    archive = ["git", "-C", str(ROOT), "archive", "--format=tar", revision, "jaxrock"]
    packed = subprocess.run(archive, check=True, capture_output=True).stdout
    with tarfile.open(fileobj=io.BytesIO(packed)) as files:
        files.extractall(folder, filter="data")
    return Path(folder).resolve()


def main():
    """Print the table."""
    if sys.argv[1:2] == ["--answer"]:  # what the processes are started with
        return answer(sys.argv[2])
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("revision", help="commit, tag or branch to compare with")
    parser.add_argument("words", nargs="*")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--margin", type=float, default=1.1)
    given = parser.parse_args()
    names = [n for n in QUESTIONS if not given.words or any(word in n for word in given.words)]
    slower = []
    print(
        f"first and next calls [ms], this tree / {given.revision}, and ratios with quartiles"
    )
    with tempfile.TemporaryDirectory() as folder:
        trees = (ROOT, unpack(given.revision, folder))
        # Else whoever imports first would do this.
        packages = [tree / "jaxrock" for tree in trees]
        subprocess.run([sys.executable, "-m", "compileall", "-q", *packages], check=True)
        for name in names:
            try:
                times = compare(trees, name, given.repeats)
            except (
                ChildProcessError
            ) as error:  # a question that one of the trees does not know
                print(f"{name:31}{error}", flush=True)
                continue
            cells = [describe(pairs, given.margin) for pairs in times]
            print(f"{name:31}{'  '.join(cells)}", flush=True)
            if any("SLOWER" in cell for cell in cells):
                slower.append(name)
    print(f"slower by more than {given.margin:g}: {', '.join(slower) or 'nothing'}")


if __name__ == "__main__":
    main()
