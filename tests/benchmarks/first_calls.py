"""How long the first call of everything takes, the next one, and the first with a cache.

Run as ``python tests/benchmarks/first_calls.py [words] [--repeats N] [--write]``: with words
only what has one of them in its name. Each entry is the median of processes of its own, which
take turns and find nothing compiled. The third figure is the first call of a process that
finds what another one compiled, in the folder of ``JAX_COMPILATION_CACHE_DIR``; commands
always keep what they compile, so their second figure is of that kind. Beside it stand what was
last written into ``first_calls.json`` and the tables of ``docs/speed_and_accuracy.md`` and the
README with ``--write``, and the bar; what is over the bar is marked. Float64.
"""

import argparse
import json
import math
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

FILE = Path(__file__).with_suffix(".json")
ROOT = FILE.parents[2]
PAGE = ROOT / "docs" / "speed_and_accuracy.md"
README = ROOT / "README.md"
BEGIN = "<!-- first calls: begin -->\n"
END = "<!-- first calls: end -->\n"
PYTHON = "{}.{}".format(*sys.version_info)
NONE = (math.inf, math.inf)


def respond(motion, factor=1.0):
    import jaxrock as jr

    motion = jr.Sine(4.0, 0.5) if motion == "pulse" else jr.example_record()
    motion = motion if factor == 1.0 else motion.scaled(factor)
    block = jr.Block(0.2, 5.0)
    duration = float(motion.end) + 10
    return lambda c: jr.respond(block, c, motion, duration)


def called(f):
    return lambda: f(0.7)


def closed(name, differentiated=False):
    import jax

    import jaxrock as jr

    scene = wall()
    if name == "critical_intensity":
        return lambda: jr.critical_intensity(scene.block, 0.7)
    f = getattr(jr, name)
    return lambda: (jax.grad(f) if differentiated else f)(scene)


def slope(transformation):
    import jax

    f = respond("pulse")
    return getattr(jax, transformation)(lambda c: f(c).peak_rotation)


def scaled():
    import jax.numpy as jnp

    import jaxrock as jr

    record = jr.example_record().scaled(jnp.linspace(0.5, 3.0, 1000))
    return jr.Block(0.2, 5.0), 0.9, record


def batch():
    import jaxrock as jr

    arguments = scaled()
    return lambda: jr.respond_batch(*arguments)


def within():
    import jaxrock as jr

    arguments = scaled()
    return lambda: jr.respond_within(*arguments, 1e-6)


def amplitude(differentiated=False):
    import jax

    import jaxrock as jr

    block = jr.Block(0.1, 5.0)
    if not differentiated:
        return lambda: jr.critical_amplitude(block, 0.9, jr.Sine, 0.5)
    f = jax.grad(lambda t: jr.critical_amplitude(block, 0.9, jr.Sine, t).value[0])
    return lambda: f(0.5)


def boundaries():
    import jax.numpy as jnp

    import jaxrock as jr

    block = jr.Block(0.1, 5.0)
    record = jr.example_record()
    tried = jnp.linspace(0.5, 2.0, 31)
    return lambda: jr.overturning_boundaries(block, 0.9, record, "factor", tried)


def wall():
    import jaxrock as jr

    return jr.Scene(jr.Block.from_size(width=0.8, height=4.0), restitution=0.7, intensity=0.15)


def of_wall(name, *arguments):
    import jaxrock as jr

    block = wall().block
    f = getattr(jr if name in jr.__all__ else jr.resonance, name)
    return lambda c: f(block, c, *arguments)


def phase():
    import jaxrock as jr

    return of_wall("pulsed_phase", jr.HalfSine(2.5, 0.05))


def pulsed():
    import jaxrock as jr

    return of_wall("critical_pulsed_amplitude", jr.HalfSine, 0.05)


def of_scene(name, answer, *arguments):
    import jaxrock as jr

    scene = wall()
    f = getattr(jr.sensitivity, name)
    answer = getattr(jr, answer)
    return lambda: f(answer, scene, *arguments)


def slopes():
    import jax.numpy as jnp

    import jaxrock as jr

    widths = jr.Scene(jr.Block(jnp.linspace(0.2, 0.6, 1_000_000), 5.0), 0.7, 0.15)
    return lambda: jr.value_and_slopes(jr.rotation_ratio)(widths)


def spectrum():
    import jax.numpy as jnp

    import jaxrock as jr

    slenderness = jnp.linspace(3, 10, 141)
    return lambda: jr.resonance_spectrum(slenderness, [0.4, 0.8, 1.2], [0.6, 0.8], 0.15)


def statue():
    import jaxrock as jr

    return jr.Block.from_size(width=0.6, height=2.4), 0.8, jr.example_suite()


def fragility():
    import jax.numpy as jnp

    import jaxrock as jr

    levels = jnp.geomspace(0.1, 3.0, 20)
    return lambda: jr.risk.fragility(*statue(), levels)


def rate(moving=False):
    import jax

    import jaxrock as jr

    hazard = jr.risk.Hazard(levels=[0.1, 0.3, 1.0, 3.0], rates=[2e-2, 2e-3, 1e-4, 4e-6])
    block, c, suite = statue()
    site = jr.risk.Site(suite, hazard)

    def at(block, c):
        return jr.risk.overturning_rate(block, c, site).rate

    return lambda: jax.value_and_grad(at, (0, 1))(block, c) if moving else at(block, c)


def fit():
    import jaxrock as jr

    times = [0.788, 1.483, 1.999, 2.411, 2.755, 3.040, 3.288, 3.502]
    slim = jr.Block(half_width=0.1, slenderness=5.0)
    return lambda: (
        jr.calibration.fit_free_rocking(times, slim, model=jr.Nonlinear()).restitution
    )


MEASUREMENT = """
import json, jax
jax.config.update("jax_enable_x64", True)
import jaxrock as jr, numpy as np
block, pulse = jr.Block(0.2, 5.0), jr.Sine(amplitude=2.5, duration=0.8)
response = jr.respond(block, 0.85, pulse, 4.0)
print(json.dumps(response.history(np.linspace(0, 4, 101))[0].tolist()))
"""


def driven_fit():
    import numpy as np

    import jaxrock as jr

    block = jr.Block(0.2, 5.0)
    pulse = jr.Sine(amplitude=2.5, duration=0.8)
    time = np.linspace(0, 4, 101)
    # By another process, so that nothing is compiled in this one.
    rotation = json.loads(run(["-c", MEASUREMENT])[0])
    return lambda: jr.calibration.fit_driven_rocking(time, rotation, block, pulse).restitution


def floor():
    import jaxrock as jr

    return lambda: jr.steady.harmonic_orbit(
        jr.Block(0.2, 5.0), 0.9, amplitude=1.5, frequency=12.0
    )


class Case(NamedTuple):
    """What makes a call, and the bars for the first one (by Python) and the next one [s]."""

    prepare: Callable
    first: tuple[float, float] = NONE  # on 3.13 and later; before
    following: tuple[float, float] = NONE


def same(bar):
    return (bar, bar)


CASES = {
    "rotation_ratio": Case(lambda: closed("rotation_ratio")),
    "grad of rotation_ratio": Case(lambda: closed("rotation_ratio", True)),
    "critical_intensity": Case(lambda: closed("critical_intensity")),
    "respond, pulse": Case(lambda: called(respond("pulse")), (2, 3)),
    "respond, record": Case(lambda: called(respond("record")), (2, 3)),
    "jacfwd of respond": Case(lambda: called(slope("jacfwd")), (4, 6)),
    "grad of respond": Case(lambda: called(slope("grad")), (4, 6)),
    "respond_batch, 1,000 blocks": Case(batch, (1.5, 2.5)),
    "respond_within": Case(within, (3, 5)),
    "critical_amplitude": Case(amplitude, (2, 3)),
    "grad of critical_amplitude": Case(lambda: amplitude(True), (3.5, 6)),
    "overturning_boundaries, record": Case(boundaries, following=same(0.15)),
    "pulsed_phase": Case(lambda: called(phase()), (3, 5)),
    "critical_pulsed_amplitude": Case(lambda: called(pulsed()), (5, 8)),
    "worst_train": Case(lambda: called(of_wall("worst_train", 3)), same(3), same(0.3)),
    "sensitivities": Case(
        lambda: of_scene("sensitivities", "rotation_ratio"), following=same(0.01)
    ),
    "value_and_slopes": Case(slopes),
    "resonance_spectrum": Case(spectrum),
    "fragility, 20 records": Case(fragility, (4, 5), (0.15, 0.3)),
    "overturning_rate, 20 records": Case(rate, (4.5, 7), (1, 2)),
    "grad of overturning_rate": Case(lambda: rate(True), (9, 14), (2, 4)),
    "fit_free_rocking": Case(fit, (2, 2.5)),
    "fit_driven_rocking": Case(driven_fit, (8, 12)),
    "harmonic_orbit": Case(floor),
}

# What jaxrock lists is imported when it is used first.
USED = "import jaxrock as jr; [getattr(jr, name) for name in jr.__all__ if name != 'plot']"
# The bar for importing jaxrock is what it may add to importing JAX.
IMPORTS = {"import jax": "import jax", "import jaxrock": USED}
ADDED = 0.3
WALL = ("--width", "0.8", "--height", "4", "--restitution", "0.7")
COMMANDS = {
    "jaxrock assess": ["assess", *WALL, "--intensity", "0.15"],
    "jaxrock respond, file": [
        "respond",
        *WALL,
        "--record",
        "record.csv",
        "--unit",
        "m/s2",
        "--force",
    ],
}
COMMAND_BARS = Case(lambda: None, (3, 6), (1.6, 2.5))


def of_all():
    """The derivative of every number in the response."""
    import equinox as eqx
    import jax

    f = respond("pulse")
    return jax.jacfwd(lambda c: eqx.filter(f(c), eqx.is_inexact_array))


PROGRAMS = {  # functions of the restitution
    "respond": lambda: respond("pulse"),
    "jacfwd of respond": of_all,
    "pulsed_phase": phase,
    "critical_pulsed_amplitude": pulsed,
}


def measure(name):
    """Print how long the first call takes, and the median of three more, in this process."""
    import jax

    jax.config.update("jax_enable_x64", True)
    exec(USED, {})  # imports are none of a first call
    call = CASES[name].prepare()
    times = []
    for _ in range(4):
        begin = time.perf_counter()
        jax.block_until_ready(call())
        times.append(time.perf_counter() - begin)
    print(json.dumps([times[0], statistics.median(times[1:])]))


def count(name):
    """Print how many lines the program has that XLA is given."""
    import jax

    jax.config.update("jax_enable_x64", True)
    print(len(jax.jit(PROGRAMS[name]()).lower(0.7).as_text().splitlines()))


def clean_environment():
    """The environment without what users tell JAX, where nothing is compiled yet."""
    return {name: value for name, value in os.environ.items() if not name.startswith("JAX_")}


def run(arguments, **variables):
    """Run Python where nothing is compiled yet; what it printed last, and how long it took."""
    begin = time.perf_counter()
    done = subprocess.run(
        [sys.executable, *map(str, arguments)],
        env=clean_environment() | variables,
        check=True,
        stdout=subprocess.PIPE,
        text=True,
        cwd=variables.get("HOME"),
    )
    taken = time.perf_counter() - begin
    return (done.stdout.splitlines() or [""])[-1], taken


def of_command(arguments):
    """Seconds that a command takes for a user who never ran one, and when it is run again."""
    import numpy as np

    import jaxrock as jr

    with tempfile.TemporaryDirectory() as home:
        record = jr.example_record()
        samples = np.asarray(record.acceleration)
        times = np.arange(samples.size) * float(record.time_step)
        rows = np.stack([times, samples], axis=1)
        header = "time [s],acceleration"
        np.savetxt(Path(home, "record.csv"), rows, delimiter=",", header=header, comments="")
        homes = dict.fromkeys(("HOME", "LOCALAPPDATA", "XDG_CACHE_HOME"), home)
        return [run(["-m", "jaxrock", *arguments], **homes)[1] for _ in range(2)]


def taken(name):
    """First, next, and first call with a cache, in seconds; fewer for what has no others."""
    if name in CASES:
        calls = json.loads(run([__file__, "--measure", name])[0])
        with tempfile.TemporaryDirectory() as folder:
            for _ in range(2):
                found = run([__file__, "--measure", name], JAX_COMPILATION_CACHE_DIR=folder)[0]
        return [*calls, json.loads(found)[0]]
    if name in COMMANDS:
        return of_command(COMMANDS[name])
    return [run(["-c", IMPORTS[name]])[1]]


def bars(name, import_jax):
    """The bars for the first and for the next call; there is none for a call with a cache."""
    if name in IMPORTS:
        return [import_jax + ADDED if name == "import jaxrock" else math.inf]
    case = CASES.get(name, COMMAND_BARS)
    version = sys.version_info < (3, 13)
    return [case.first[version], case.following[version], math.inf]


def line(name, found, before, bar):
    """A line of the table: for each call what it takes, took and may take."""
    cells = []
    for k, value in enumerate(found):
        was = f"{before[k]:.3g}" if k < len(before) else "-"
        most = f"{bar[k]:.3g}" if math.isfinite(bar[k]) else "-"
        over = "!" if value > bar[k] else " "
        cells.append(f"{value:9.3f}{over}{was:>8} {most:>6}")
    print(f"{name:32}" + " |".join(cells), flush=True)


def seconds(value):
    """As many digits as count."""
    return (
        f"{value:.1f}"
        if value > 0.95
        else f"{value:.2g}"
        if value > 0.0095
        else f"{value:.1g}"
    )


# What the README quotes.
QUOTED = (
    "rotation_ratio",
    "grad of rotation_ratio",
    "respond, record",
    "fragility, 20 records",
    "jaxrock assess",
)


def format_name(name):
    """The name as it stands in a table."""
    function, _, what = name.partition(", ")
    shown = " of ".join(f"`{word}`" for word in function.split(" of "))
    return shown if name in COMMANDS else f"{shown}{', ' * bool(what)}{what}"


def table(written, names=None):
    """The table in Markdown: each column for the newest and for the oldest Python."""
    new = written["3.13"]
    old = written["3.11"]
    rows = ["| seconds | first | with a cache | next |", "|---|---|---|---|"]
    for name in names or [*CASES, *COMMANDS]:
        cells = [
            " / ".join(map(seconds, pair)) for pair in zip(new[name], old[name], strict=True)
        ]
        first, following, cached = cells if name in CASES else (cells[0], "", cells[1])
        rows.append(f"| {format_name(name)} | {first} | {cached} | {following} |")
    return "\n".join([*rows, ""])


def write_table(path, text):
    """Write a table between the marks of a page."""
    page = path.read_text(encoding="utf-8")
    begin, rest = page.split(BEGIN)
    end = rest.split(END)[1]
    path.write_text(begin + BEGIN + text + END + end, encoding="utf-8")


def main():
    """Print the table, and write it if asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("words", nargs="*")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--measure", choices=CASES, help=argparse.SUPPRESS)
    parser.add_argument("--count", choices=PROGRAMS, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.measure or given.count:
        return measure(given.measure) if given.measure else count(given.count)

    names = [*IMPORTS, *CASES, *COMMANDS]
    names = [n for n in names if not given.words or any(word in n for word in given.words)]
    times = {name: [] for name in names}
    for _ in range(given.repeats):
        for name in names:
            times[name].append(taken(name))
    medians = {
        name: [statistics.median(t) for t in zip(*times[name], strict=True)] for name in names
    }
    committed = json.loads(FILE.read_text(encoding="utf-8")) if FILE.exists() else {}
    before = committed.setdefault(PYTHON, {})
    cells = f"{'first':>9} {'was':>8} {'bar':>6}", f"{'next':>9} {'was':>8} {'bar':>6}"
    cells = *cells, f"{'cached':>9} {'was':>8} {'bar':>6}"
    print(f"{'seconds, Python ' + PYTHON:32}" + " |".join(cells))
    import_jax = medians.get("import jax", [math.inf])[0]
    for name, found in medians.items():
        line(name, found, before.get(name, []), bars(name, import_jax))
    lines = {}
    for program in PROGRAMS:
        if not given.words or any(word in program for word in given.words):
            name = f"lines of {program}"
            lines[name] = int(run([__file__, "--count", program])[0])
            print(f"{name:40} {lines[name]:6}, was {before.get(name, '-')}")
    if given.write:
        before.update(
            {name: [float(f"{t:.3g}") for t in found] for name, found in medians.items()}
        )
        before.update(lines)
        FILE.write_text(json.dumps(committed, indent=1) + "\n", encoding="utf-8")
        write_table(PAGE, table(committed))
        write_table(README, table(committed, QUOTED))


if __name__ == "__main__":
    main()
