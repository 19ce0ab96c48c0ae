"""ASCII files of the European Strong-Motion database and ITACA: keys, then one value a line.

The headers, DYNA 1.0 and 1.2 and an older one of ITACA, differ only in keys that are not
needed here. They are described at https://esm-db.eu/#/data_and_services (format DYNA 1.2).
"""

from ...tables import TextFile
from .components import Caller, Component, NotAcceleration, make_component
from .fields import read_free

ESM_TITLE = r"\s*EVENT_NAME:"


def read_esm(text: TextFile, caller: Caller, _: int) -> tuple[list[Component], int]:
    """Read the component of a file."""
    top = next((k for k, line in enumerate(text.lines) if ":" not in line), len(text.lines))
    pairs = (line.partition(":") for line in text.lines[:top])
    keys = {key.strip(): word.strip() for key, _, word in pairs}
    kind = keys.get("DATA_TYPE", "").lower()
    if kind.removeprefix("un").removeprefix("processed ") != "acceleration":
        raise NotAcceleration(str(text.error(f"its DATA_TYPE is {kind!r}, no acceleration")))
    try:
        step, points = float(keys["SAMPLING_INTERVAL_S"]), int(keys["NDATA"])
    except (KeyError, ValueError) as error:
        raise text.error(f"a number is missing in its header: {error}") from None
    # COMPONENT in old files, which have U, WE and NS.
    channel = keys.get("STREAM") or keys.get("COMPONENT", "")
    unit = keys.get("UNITS", "")
    values = read_free(text, top, points)
    component = make_component(text, caller, values, unit=unit, step=step, channel=channel)
    return [component], len(text.lines)
