"""How long the first call of everything takes, the next one, and the first with a cache.

Run as ``python tests/benchmarks/first_calls.py [words] [--repeats N] [--write]``: with words
only what has one of them in its name. Each entry is the median of processes of its own, which
take turns and find nothing compiled. The third figure is the first call of a process that
finds what another one compiled, in the folder of ``JAX_COMPILATION_CACHE_DIR``; commands
always keep what they compile, so their second figure is of that kind. With ``--write`` they go
into ``first_calls.json`` and the tables of ``docs/speed_and_accuracy.md`` and the README. Float64.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

FILE = Path(__file__).with_suffix(".json")
ROOT = FILE.parents[2]
BEGIN = "<!-- first calls: begin -->\n"
END = "<!-- first calls: end -->\n"
PYTHON = "{}.{}".format(*sys.version_info)

# In each process, before the time of a first call begins: all imports, and cheap scenes.
SETUP = """
import json, subprocess, sys
import jax, jax.numpy as jnp, numpy as np
jax.config.update("jax_enable_x64", True)
import jaxrock as jr
[getattr(jr, name) for name in jr.__all__ if name != "plot"]
block, slim, pulse = jr.Block(0.2, 5.0), jr.Block(0.1, 5.0), jr.Sine(4.0, 0.5)
wall = jr.Scene(jr.Block.from_size(width=0.8, height=4.0), 0.7, 0.15)
"""
RESPOND = "respond = lambda c: jr.respond(block, c, pulse, 10.5).peak_rotation"
BATCH = "many = block, 0.9, jr.example_record().scaled(jnp.linspace(0.5, 3.0, 1000))"
AMPLITUDE = "amplitude = lambda t: jr.critical_amplitude(slim, 0.9, jr.Sine, t).value[0]"
RATE = """
statue = jr.Block.from_size(width=0.6, height=2.4)
suite = jr.example_suite()
site = jr.risk.Site(suite, jr.risk.Hazard([0.1, 0.3, 1.0, 3.0], [2e-2, 2e-3, 1e-4, 4e-6]))
rate = lambda block, c: jr.risk.overturning_rate(block, c, site).rate
"""
# Another process makes the measurement, so that nothing is compiled in this one.
MEASUREMENT = f"""
code = {SETUP!r} + '''
response = jr.respond(block, 0.85, jr.Sine(2.5, 0.8), 4.0)
print(json.dumps(response.history(np.linspace(0, 4, 101))[0].tolist()))
'''
rotation = json.loads(subprocess.check_output([sys.executable, "-c", code]))
test = np.linspace(0, 4, 101), rotation, block, jr.Sine(2.5, 0.8)
"""
# What is prepared, and what is called.
CASES = {
    "rotation_ratio": ("", "jr.rotation_ratio(wall)"),
    "grad of rotation_ratio": ("", "jax.grad(jr.rotation_ratio)(wall)"),
    "critical_intensity": ("", "jr.critical_intensity(wall.block, 0.7)"),
    "respond, pulse": ("", "jr.respond(block, 0.7, pulse, 10.5)"),
    "respond, record": (
        "record = jr.example_record()",
        "jr.respond(block, 0.7, record, 70.0)",
    ),
    "jacfwd of respond": (f"{RESPOND}\nslope = jax.jacfwd(respond)", "slope(0.7)"),
    "grad of respond": (f"{RESPOND}\nslope = jax.grad(respond)", "slope(0.7)"),
    "respond_batch, 1,000 blocks": (BATCH, "jr.respond_batch(*many)"),
    "respond_within": (BATCH, "jr.respond_within(*many, 1e-6)"),
    "critical_amplitude": ("", "jr.critical_amplitude(slim, 0.9, jr.Sine, 0.5)"),
    "grad of critical_amplitude": (f"{AMPLITUDE}\nslope = jax.grad(amplitude)", "slope(0.5)"),
    "overturning_boundaries, record": (
        "record, factors = jr.example_record(), jnp.linspace(0.5, 2.0, 31)",
        "jr.overturning_boundaries(slim, 0.9, record, 'factor', factors)",
    ),
    "pulsed_phase": ("", "jr.steady.pulsed_phase(wall.block, 0.7, jr.HalfSine(2.5, 0.05))"),
    "critical_pulsed_amplitude": (
        "",
        "jr.steady.critical_pulsed_amplitude(wall.block, 0.7, jr.HalfSine, 0.05)",
    ),
    "worst_train": ("", "jr.worst_train(wall.block, 0.7, 3)"),
    "sensitivities": ("", "jr.sensitivities(jr.rotation_ratio, wall)"),
    "value_and_slopes": (
        "walls = jr.Scene(jr.Block(jnp.linspace(0.2, 0.6, 1_000_000), 5.0), 0.7, 0.15)",
        "jr.value_and_slopes(jr.rotation_ratio)(walls)",
    ),
    "resonance_spectrum": (
        "slenderness = jnp.linspace(3, 10, 141)",
        "jr.resonance_spectrum(slenderness, [0.4, 0.8, 1.2], [0.6, 0.8], 0.15)",
    ),
    "fragility, 20 records": (
        f"{RATE}\nlevels = jnp.geomspace(0.1, 3.0, 20)",
        "jr.risk.fragility(statue, 0.8, suite, levels)",
    ),
    "overturning_rate, 20 records": (RATE, "rate(statue, 0.8)"),
    "grad of overturning_rate": (
        f"{RATE}\nslopes = jax.value_and_grad(rate, (0, 1))",
        "slopes(statue, 0.8)",
    ),
    "fit_free_rocking": (
        "times = [0.788, 1.483, 1.999, 2.411, 2.755, 3.040, 3.288, 3.502]",
        "jr.calibration.fit_free_rocking(times, slim)",
    ),
    "fit_driven_rocking": (
        MEASUREMENT,
        "jr.calibration.fit_driven_rocking(*test).restitution",
    ),
    "harmonic_orbit": ("", "jr.steady.harmonic_orbit(block, 0.9, 1.5, 12.0)"),
}
WALL = ("--width", "0.8", "--height", "4", "--restitution", "0.7")
FROM_A_FILE = ("--record", "record.csv", "--unit", "m/s2", "--force")
COMMANDS = {
    "jaxrock assess": ["assess", *WALL, "--intensity", "0.15"],
    "jaxrock respond, file": ["respond", *WALL, *FROM_A_FILE],
}
# What the README quotes.
QUOTED = ("rotation_ratio", "grad of rotation_ratio", "respond, record")
QUOTED += ("fragility, 20 records", "jaxrock assess")


def prepare(name, cases=CASES):
    """Prepare a call in this process."""
    setup, call = cases[name]
    names = {}
    exec(f"{SETUP}\n{setup}\ncall = lambda: {call}", names)
    return names["call"]


def print_times(name):
    """Print how long the first call takes, and the median of three more, in this process."""
    import jax

    call = prepare(name)
    times = []
    for _ in range(4):
        begin = time.perf_counter()
        jax.block_until_ready(call())
        times.append(time.perf_counter() - begin)
    print(json.dumps([times[0], statistics.median(times[1:])]))


def clean_environment():
    """The environment without what users tell JAX, where nothing is compiled yet."""
    return {name: value for name, value in os.environ.items() if not name.startswith("JAX_")}


def run(*arguments, **variables):
    """Run Python where nothing is compiled yet; what it printed last."""
    done = subprocess.run(
        [sys.executable, *arguments],
        env=clean_environment() | variables,
        check=True,
        stdout=subprocess.PIPE,
        text=True,
        cwd=variables.get("HOME"),
    )
    return (done.stdout.splitlines() or [""])[-1]


def time_command(arguments):
    """Seconds that a command takes for a user who never ran one, and when it is run again."""
    seconds = []
    with tempfile.TemporaryDirectory() as home:
        write = (
            "t = 0.01 * np.arange(6001); table = np.c_[t, jr.example_record().acceleration]"
        )
        write += "; np.savetxt('record.csv', table, delimiter=',', header='time [s],acc',"
        homes = dict.fromkeys(("HOME", "LOCALAPPDATA", "XDG_CACHE_HOME"), home)
        run("-c", f"{SETUP}\n{write} comments='')", **homes)
        for _ in range(2):
            begin = time.perf_counter()
            run("-m", "jaxrock", *arguments, **homes)
            seconds.append(time.perf_counter() - begin)
    return seconds


def measure(name):
    """First, next, and first call with a cache, in seconds; fewer for a command."""
    if name in COMMANDS:
        return time_command(COMMANDS[name])
    seconds = json.loads(run(__file__, "--measure", name))
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(2):
            cached = run(__file__, "--measure", name, JAX_COMPILATION_CACHE_DIR=folder)
    return [*seconds, json.loads(cached)[0]]


def format_seconds(value):
    """As many digits as count."""
    return f"{value:.1f}" if value > 0.95 else f"{value:.{2 if value > 0.0095 else 1}g}"


def make_table(written, names):
    """The table in Markdown: each column for the newest and for the oldest Python."""
    rows = ["| seconds | first | with a cache | next |", "|---|---|---|---|"]
    for name in names:
        pairs = zip(written["3.13"][name], written["3.11"][name], strict=True)
        first, *others = [" / ".join(map(format_seconds, pair)) for pair in pairs]
        following, cached = others if name in CASES else ("", *others)
        function, _, what = name.partition(", ")
        shown = " of ".join(f"`{word}`" for word in function.split(" of "))
        shown += f", {what}" if what and name in CASES else ""
        rows.append(f"| {shown} | {first} | {cached} | {following} |")
    return "\n".join([*rows, ""])


def write_all(medians):
    """Write the figures, and the tables of the page and of the README."""
    written = json.loads(FILE.read_text(encoding="utf-8"))
    written[PYTHON] |= {name: [float(f"{t:.3g}") for t in m] for name, m in medians.items()}
    FILE.write_text(format_json(written), encoding="utf-8")
    pages = {"docs/speed_and_accuracy.md": [*CASES, *COMMANDS], "README.md": QUOTED}
    for page, names in pages.items():
        text = (ROOT / page).read_text(encoding="utf-8")
        before, after = text.split(BEGIN)
        table = BEGIN + make_table(written, names) + END
        (ROOT / page).write_text(before + table + after.split(END)[1], encoding="utf-8")


def format_json(written):
    """The figures, a line for each call."""
    pythons = []
    for python, figures in written.items():
        rows = (f"  {json.dumps(name)}: {json.dumps(row)}" for name, row in figures.items())
        pythons.append(f' "{python}": {{\n' + ",\n".join(rows) + "\n }")
    return "{\n" + ",\n".join(pythons) + "\n}\n"


def main():
    """Print the table, and write it if asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("words", nargs="*")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--measure", choices=CASES, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.measure:
        return print_times(given.measure)
    names = [*CASES, *COMMANDS]
    names = [n for n in names if not given.words or any(word in n for word in given.words)]
    times = {name: [] for name in names}
    for _ in range(given.repeats):
        for name in names:
            times[name].append(measure(name))
    medians = {
        name: [statistics.median(t) for t in zip(*times[name], strict=True)] for name in names
    }
    print(f"{'seconds, Python ' + PYTHON:32}{'first':>9}{'next':>9}{'cached':>9}")
    for name, row in medians.items():
        print(f"{name:32}" + "".join(f"{value:9.3f}" for value in row))
    if given.write:
        write_all(medians)


if __name__ == "__main__":
    main()
