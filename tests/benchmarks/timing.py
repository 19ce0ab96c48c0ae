"""Times of calls that take turns, so that a ratio of them is of the same seconds."""

import statistics
import time

import jax


def time_in_turn(calls, rounds=7, repeats=3, clock=time.perf_counter):
    """Median seconds of each call by its name; a ratio of two is what counts.

    In a turn, the first call is not counted: it compiles, or pays for memory that another one
    gave back.
    """
    seconds = {name: [] for name in calls}
    for _ in range(rounds):
        for name, call in calls.items():
            for repeat in range(repeats + 1):
                begin = clock()
                jax.block_until_ready(call())
                if repeat:
                    seconds[name].append(clock() - begin)
    return {name: statistics.median(times) for name, times in seconds.items()}


def measure(call, repeats=21, clock=time.perf_counter):
    """Median seconds of a call, after one that compiles."""
    return time_in_turn({"": call}, 1, repeats, clock)[""]
