"""Real files of networks against parsers of a dozen lines each, which know nothing of jaxrock.

    python tests/benchmarks/real_files.py FOLDER

Below FOLDER stands a folder for each network, named as in `NETWORKS`, with files as they were
published. Every file is read by `read_record`, component by component, or by `read_hazard`, and
compared with what the plain parser of its network finds. The parsers trust a file where jaxrock
checks it: what they read is not all worth reading.

A network's line tells how many of its files are read equal, within the printed digits; how many
are refused, those without an acceleration or a hazard of PGA or PGV apart; and how many are read
otherwise. Refusals follow, grouped by their reason, each with the name of one file.
"""

import collections
import math
import re
import sys
import warnings
from pathlib import Path

import jax
import numpy as np

import jaxrock as jr

jax.config.update("jax_enable_x64", True)

G = 9.80665
NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[EeDd][-+]?\d+)?"
FACTORS = {"g": G, "g/10": G / 10, "mm/s/s": 1e-3, "mm/s/s,": 1e-3}
FACTORS |= dict.fromkeys(("cm/sec2", "cm/sec/sec", "cm/s^2", "cm/s/s", "gal"), 0.01)


def split_columns(lines, width, count):
    """Read numbers in columns of a width from the first lines that hold so many of them."""
    words = []
    for line in lines:
        line = line.rstrip()
        words += [line[k : k + width] for k in range(0, len(line), width)]
        if len(words) >= count:
            break
    return np.array([float(word) for word in words[:count]])


def read_words(lines):
    """Read all numbers between blanks."""
    return np.array([float(word) for line in lines for word in line.split()])


def take_pairs(values, factor):
    """Split times and accelerations that alternate, as those digitized from film do."""
    times = values[::2]
    steps = np.diff(times)
    # A scan of film is uneven: no record with one step.
    if np.ptp(steps) > 1e-6:
        return []
    return [(factor * values[1::2], float(np.mean(steps)))]


def parse_cosmos(lines):
    """COSMOS strong-motion data format 1.20, tables 5 and 6 for the headers."""
    components = []
    for k, line in enumerate(lines):
        if match := re.match(r"\s*(\d+)\s+Real-header.*\(\d+F(\d+)\.", line, re.I):
            milliseconds = split_columns(lines[k + 1 :], int(match[2]), int(match[1]))[61]
        data = r"\s*(\d+)\s+acceleration pts.*units=\s*([^\s(,]+).*\(\d+[FE](\d+)\."
        if match := re.match(data, line, re.I):
            factor = FACTORS[match[2].lower().rstrip(".")]
            values = split_columns(lines[k + 1 :], int(match[3]), int(match[1]))
            components.append((factor * values, milliseconds / 1000))
    return components


def parse_csmip(lines):
    """Volumes 1 and 2 of California's program and USC: unit, step and columns above the values."""
    pattern = (
        r"\s*(?P<points>\d+)\s*(?:accelerogram points at (?P<rate>\S+) pts/sec"
        r"|points of acc(?:el)? data equally spaced at\s+(?P<step>\S+) sec)"
        r".*?(?:units:|in units(?: of)?|, in)\s+(?P<unit>[^\s)]+)(?:.*\(\d+f(?P<width>\d+))?"
    )
    components = []
    for k, line in enumerate(lines):
        if match := re.match(pattern, line, re.I):
            step = float(match["step"] or 1 / float(match["rate"]))
            unit = match["unit"].lower().rstrip(".")
            # Old files do not state the width of a column.
            width = int(match["width"] or (9 if unit == "g" else 10))
            values = split_columns(lines[k + 1 :], width, int(match["points"]))
            components.append((FACTORS[unit] * values, step))
    return components


def parse_geonet(lines):
    """GeoNet's V1A and V2A: 26 lines of head, and in its numbers the count and the step."""
    components = []
    at = 0
    while at + 26 < len(lines):
        head = split_columns(lines[at + 16 :], 8, 100)
        counts = [int(count) for count in head[33:36]]
        values = split_columns(lines[at + 26 :], 8, counts[0])
        components.append((values / 1000, head[65]))
        at += 26 + sum(-(-count // 10) for count in counts)
    return components


def parse_smc(lines):
    """SMC of the U.S. Geological Survey: 27 lines of head, then comments, then cm/s2."""
    if "ACCELEROGRAM" not in lines[0]:
        return []
    integers = split_columns(lines[11:], 10, 48)
    rate = split_columns(lines[17:], 15, 50)[1]
    top = 27 + max(int(integers[15]), 0)
    width = 14 if "E" in lines[top].upper()[:14] and len(lines[top].rstrip()) == 70 else 10
    values = split_columns(lines[top:], width, int(integers[16]))
    return take_pairs(values, 0.01) if rate > 1e30 else [(0.01 * values, 1 / rate)]


def parse_esm(lines):
    """ESM and ITACA: keys and values, then one number a line."""
    keys = dict(line.split(":", 1) for line in lines if ":" in line)
    keys = {key.strip(): value.strip() for key, value in keys.items()}
    if "SPECTR" in keys.get("DATA_TYPE", "") or keys["UNITS"] not in FACTORS:
        return []
    values = read_words(line for line in lines if re.fullmatch(NUMBER, line.strip()))
    return [(FACTORS[keys["UNITS"]] * values, float(keys["SAMPLING_INTERVAL_S"]))]


def parse_knet(lines):
    """K-NET and KiK-net: 17 lines of head, then counts with a factor in gal."""
    head = {line[:17].strip(): line[17:].strip() for line in lines[:17]}
    gal, counts = re.fullmatch(r"([\d.]+)\(gal\)/([\d.]+)", head["Scale Factor"]).groups()
    rate = float(head["Sampling Freq(Hz)"].removesuffix("Hz"))
    return [(0.01 * float(gal) / float(counts) * read_words(lines[17:]), 1 / rate)]


def parse_at2(lines):
    """PEER's AT2: the unit in the third line, number and step in the fourth."""
    step = next(
        re.search(rf"DT\s*=\s*({NUMBER})", line, re.I) for line in lines if "NPTS" in line
    )
    top = next(k for k, line in enumerate(lines) if "NPTS" in line) + 1
    values = [line for line in lines[top:] if not re.search("[a-df-z]{2}", line, re.I)]
    return [(G * read_words(values), float(step[1]))]


def parse_traces(path):
    """SAC and miniSEED, by obspy; whole numbers are counts of an instrument."""
    import obspy

    traces = obspy.read(str(path))
    if any((trace.data == np.round(trace.data)).all() for trace in traces):
        return []
    return [(trace.data.astype(float), trace.stats.delta) for trace in traces]


# Its parser, and what a user who knows the files would say of unit and step.
NETWORKS = {
    "at2": (parse_at2, {}),
    "cosmos": (parse_cosmos, {}),
    "csmip": (parse_csmip, {}),
    "esm": (parse_esm, {}),
    "geonet": (parse_geonet, {}),
    "knet": (parse_knet, {}),
    "mseed": (parse_traces, {"unit": "m/s2"}),
    "sac": (parse_traces, {"unit": "m/s2"}),
    "smc": (parse_smc, {}),
    "usc": (parse_csmip, {}),
}
# Where the plain parsers stop at what is no file of their format.
STOPS = (ValueError, LookupError, AttributeError, NameError, TypeError, StopIteration)
SITES = {"openquake": "poe-"}


def parse_sites(path, prefix):
    """Curves of OpenQuake: measure and a place, levels and rates of each site."""
    lines = path.read_text().splitlines()
    about = lines[0] if prefix else ""
    measure = re.search(r"imt=['\"](\w+)['\"]", about)
    names, *rows = [line.split(",") for line in lines if not line.startswith("#")]
    columns = [k for k, name in enumerate(names) if re.fullmatch(prefix + NUMBER, name)]
    factor = {"PGA": G, "PGV": 0.01}.get(measure[1] if measure else "", 0 if prefix else G)
    levels = factor * np.array([float(names[k].removeprefix(prefix)) for k in columns])
    place = names.index("lon"), names.index("lat")
    for row in rows:
        values = np.array([float(row[k]) for k in columns])
        if prefix:
            years = float(re.search(rf"investigation_time=({NUMBER})", about)[1])
            with np.errstate(divide="ignore"):
                values = -np.log1p(-values) / years
        yield tuple(float(row[k]) for k in place), levels, values


def read_components(path, options):
    """Read all components that `read_record` reads of a file."""
    try:
        return [jr.read_record(path, **options)]
    except ValueError as error:
        message = str(error)
        # The names of the components stand at the end of the message.
        listed = re.search(r"(?:components are|column names it:) ('.*)$", message)
        if not listed:
            raise
    names = re.findall(r"'([^']*)'", listed[1])
    return [jr.read_record(path, column=name, **options) for name in names]


def compare_record(path, parse, options):
    """Return whether a file is read equal, with too few components, otherwise, or refused."""
    try:
        if parse is parse_traces:
            components = parse(path)
        else:
            components = parse(path.read_text(encoding="latin-1").splitlines())
    except STOPS:
        components = []
    try:
        records = read_components(path, options)
    except ValueError as error:
        return ("refused" if components else "refused, nothing else to read"), str(error)
    left = list(range(len(components)))
    for record in records:
        values = np.asarray(record.acceleration)
        fits = [
            k
            for k in left
            if components[k][0].size == values.size
            and np.allclose(values, components[k][0], rtol=0, atol=1e-6 * abs(values).max())
            and math.isclose(float(record.time_step), components[k][1], rel_tol=1e-3)
        ]
        if not fits:
            return (
                "DIFFERENT",
                f"{values[:3]} m/s2, {float(record.time_step):g} s, of no component",
            )
        left.remove(fits[0])
    if left:
        return "in part", f"{len(records)} of {len(components)} components"
    return "equal", ""


def compare_hazard(path, prefix):
    """Return whether the curves of the first sites of a file are read equal, or are refused."""
    head = path.read_text().partition("\n")[0]
    kind = re.search(r"kind=['\"]([a-z]+)", head)
    for place, levels, rates in [*parse_sites(path, prefix)][:3]:
        try:
            options = {} if prefix else {"measure": "pga", "unit": "g"}
            hazard = jr.risk.read_hazard(path, site=place, **options)
        except ValueError as error:
            right = not levels.any() or not (rates > 0).sum() > 1
            return ("refused, no hazard of pga or pgv" if right else "refused"), str(error)
        finite = np.isfinite(rates)
        same = np.allclose(hazard.levels, levels[finite], rtol=1e-9)
        if not same or not np.allclose(hazard.rates, rates[finite], rtol=1e-9):
            return "DIFFERENT", f"{place}: {hazard}"
        if kind and kind[1] == "std":
            return "DIFFERENT", "the standard deviation is read as a hazard"
    return "equal" if not kind or kind[1] == "mean" else f"equal, kind {kind[1]}", ""


def shorten(message, path):
    """Return the reason of a refusal, without what differs from one file to the next."""
    message = message.replace(str(path), "").removeprefix("''")
    message = re.sub(r"'[^']{30,}'|\d[\d.]*(?:e[-+]?\d+)?", "#", message)
    return re.sub(r"^(?: \S+)?(?:, line #)?[: ]*", "", message)[:110]


def main(folder):
    """Print for each network how its files are read."""
    warnings.simplefilter("ignore")
    for network in sorted(path for path in Path(folder).iterdir() if path.is_dir()):
        outcomes = collections.Counter()
        reasons = collections.defaultdict(list)
        for path in sorted(path for path in network.rglob("*") if path.is_file()):
            if network.name in SITES:
                outcome, reason = compare_hazard(path, SITES[network.name])
            elif network.name in NETWORKS:
                outcome, reason = compare_record(path, *NETWORKS[network.name])
            else:
                continue
            outcomes[outcome] += 1
            if reason:
                reasons[outcome, shorten(reason, path)].append(path.name)
        if not outcomes:
            continue
        counts = "; ".join(f"{count} {outcome}" for outcome, count in sorted(outcomes.items()))
        print(f"{network.name}: {sum(outcomes.values())} files: {counts}")
        for (outcome, reason), names in sorted(reasons.items(), key=lambda row: -len(row[1])):
            print(f"    {outcome}, {len(names)}: {reason} ({names[0]})")


if __name__ == "__main__":
    main(sys.argv[1])
