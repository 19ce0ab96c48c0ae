"""Whether this tree has become slower than another commit: first calls and next ones.

Run as ``python tests/benchmarks/against.py REVISION [words] [--repeats N] [--margin X]
[--python PATH]``: with words only questions that have one of them in their name. Both trees
answer the same questions, those of this file, on the same Python. In each repeat each tree has a
process of its own, where nothing is compiled. The two take turns, so that a ratio is of the same
seconds, whatever else the machine does. Processor time counts, of all threads of a process; that
of a first call includes the imports. What takes longer than the margin allows, and longer in most
repeats, is marked; with one repeat that may be chance. Float64.
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
from first_calls import CASES, called, clean_environment, of_wall, respond

ROOT = Path(__file__).parents[2]
TURNS = 7  # of next calls, in each repeat
LEAST = 0.1  # seconds of a turn, which has as many calls as that takes


def pulses():
    """The arguments of 2,000 random blocks under sines."""
    import numpy as np

    import jaxrock as jr

    random = np.random.default_rng(0)
    size = 2000
    blocks = jr.Block(random.uniform(0.1, 0.5, size), random.uniform(3, 8, size))
    restitution = random.uniform(0.5, 0.95, size)
    amplitude = 9.81 * random.uniform(1.2, 4, size) / np.asarray(blocks.slenderness)
    return blocks, restitution, jr.Sine(amplitude, 0.5)


def batch_of_pulses():
    import jaxrock as jr

    arguments = pulses()
    return lambda: jr.respond_batch(*arguments, 1.0)


def pulses_within():
    import jaxrock as jr

    arguments = pulses()
    return lambda: jr.respond_within(*arguments, 1e-6, 1.0)


def million():
    import jax.numpy as jnp

    import jaxrock as jr

    scenes = jr.Scene(jr.Block(jnp.linspace(0.2, 0.6, 1_000_000), 5.0), 0.7, 0.15)
    return lambda: jr.rotation_ratio(scenes)


def taken_over(*names):
    """Questions that `first_calls.py` asks as well."""
    return {name: CASES[name].prepare for name in names}


QUESTIONS = {
    "respond, record x 1.5": lambda: called(respond("record", 1.5)),
    **taken_over("respond, pulse", "jacfwd of respond"),
    "respond_batch, record": CASES["respond_batch, 1,000 blocks"].prepare,
    "respond_batch, pulses": batch_of_pulses,
    "respond_within, record": first_calls.within,
    "respond_within, pulses": pulses_within,
    **taken_over("critical_amplitude", "overturning_boundaries, record"),
    **taken_over("fragility, 20 records", "overturning_rate, 20 records"),
    "worst_train, 8 pulses": lambda: called(of_wall("worst_train", 8)),
    **taken_over("harmonic_orbit", "pulsed_phase"),
    "rotation_ratio, a million": million,
}


def answer(name):
    """In a process of its own: answer once, then for a turn whenever a line comes in.

    Prints seconds of processor time, first with the imports, then of one call.
    """
    import jax

    jax.config.update("jax_enable_x64", True)
    import jaxrock

    tree = Path(jaxrock.__file__).parents[1]
    call = QUESTIONS[name]()
    jax.block_until_ready(call())
    print(json.dumps([str(tree), time.process_time()]), flush=True)
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

    def __init__(self, python, tree, name):
        begin = time.perf_counter()
        self._process = subprocess.Popen(
            [python, __file__, "--answer", name],
            env=clean_environment() | {"PYTHONPATH": str(tree)},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        imported, self.first = self._read()
        self.wall = time.perf_counter() - begin
        if not Path(imported).samefile(tree):
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


def compare(python, trees, name, repeats):
    """Times of both trees: wall time and processor time of first calls, and of next ones [s]."""
    wall = []
    first = []
    following = []
    for repeat in range(repeats):
        processes = {}
        try:
            order = (0, 1) if repeat % 2 == 0 else (1, 0)
            for k in order:
                processes[k] = Process(python, trees[k], name)
            wall.append([processes[k].wall for k in (0, 1)])
            first.append([processes[k].first for k in (0, 1)])
            turns = []
            for _ in range(TURNS):
                seconds = {k: processes[k].take_turn() for k in order}
                turns.append([seconds[0], seconds[1]])
            # One pair: how a process lies in memory may make 15 % for all of its turns.
            following.append(medians(turns))
        finally:
            for process in processes.values():
                process.stop()
    return wall, first, following


def describe(pairs, margin):
    """The median ratio with its quartiles, and a mark where it is above the margin."""
    ratios = sorted(this / that for this, that in pairs)
    median = statistics.median(ratios)
    low = ratios[len(ratios) // 4]
    high = ratios[-1 - len(ratios) // 4]
    mark = " SLOWER" if median > margin and low > 1 else ""
    return f"{median:5.2f} ({low:.2f} to {high:.2f}){mark:7}"


def medians(pairs):
    """The median of both trees."""
    return [statistics.median(column) for column in zip(*pairs, strict=True)]


def show(name, times, margin):
    """Print the line of a question; return whether something in it is marked."""
    wall, first, following = times
    walls = " /".join(f"{seconds:6.2f}" for seconds in medians(wall))
    calls = " /".join(f"{1e3 * seconds:9.3f}" for seconds in medians(following))
    ratios = describe(first, margin), describe(following, margin)
    print(f"{name:31}{walls}  {ratios[0]:30}{calls}  {ratios[1]}", flush=True)
    return any("SLOWER" in ratio for ratio in ratios)


def unpack(revision, folder):
    """Write the package as it was in a commit into a folder, of which git keeps no note."""
    archive = ["git", "-C", str(ROOT), "archive", "--format=tar", revision, "jaxrock"]
    packed = subprocess.run(archive, check=True, capture_output=True).stdout
    with tarfile.open(fileobj=io.BytesIO(packed)) as files:
        files.extractall(folder, filter="data")
    return Path(folder)


def main():
    """Print the table."""
    if sys.argv[1:2] == ["--answer"]:  # what the processes are started with
        return answer(sys.argv[2])
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("revision", help="commit, tag or branch to compare with")
    parser.add_argument("words", nargs="*")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--margin", type=float, default=1.1)
    parser.add_argument("--python", default=sys.executable)
    given = parser.parse_args()
    names = [n for n in QUESTIONS if not given.words or any(word in n for word in given.words)]
    with tempfile.TemporaryDirectory() as folder:
        tree = unpack(given.revision, folder)
        # Else whoever imports first would do this.
        compiler = [given.python, "-m", "compileall", "-q"]
        subprocess.run([*compiler, ROOT / "jaxrock", tree / "jaxrock"], check=True)
        compare_all(names, (ROOT, tree), given)


def compare_all(names, trees, given):
    """Print a line for each question."""
    print(f"this tree / {given.revision}, and the ratio of processor times with its quartiles")
    print(f"{'':31}{'first [s]':15} {'ratio':30}{'next [ms]':21}  ratio")
    slower = []
    for name in names:
        try:
            times = compare(given.python, trees, name, given.repeats)
        except ChildProcessError as error:  # a question that one of the trees does not know
            print(f"{name:31}{error}", flush=True)
            continue
        if show(name, times, given.margin):
            slower.append(name)
    print(f"slower by more than {given.margin:g}: {', '.join(slower) or 'nothing'}")


if __name__ == "__main__":
    main()
