"""Look at pictures as a reader does: which texts lie on one another, or outside."""

import itertools

from matplotlib.text import Text

_TOUCH = 1.0  # pixels by which boxes may lie on one another: they are wider than the letters


def find_clashes(figure):
    """Find the texts of a figure that lie on one another or reach beyond the figure."""
    figure.draw_without_rendering()
    hidden = set()
    for ax in [each for outer in figure.axes for each in (outer, *outer.child_axes)]:
        for axis in (ax.xaxis, ax.yaxis):
            low, high = sorted(axis.get_view_interval())
            # Ticks beyond the limits are not seen; of rounding alone, they are.
            for tick in (*axis.get_major_ticks(), *axis.get_minor_ticks()):
                if not low - 1e-9 * abs(low) <= tick.get_loc() <= high + 1e-9 * abs(high):
                    hidden |= {tick.label1, tick.label2}
    boxes = [
        (text.get_text(), text.get_window_extent())
        for text in figure.findobj(Text)
        if text not in hidden and text.get_visible() and text.get_text().strip()
    ]
    width, height = figure.bbox.size
    clashes = [
        f"{name!r} is cut"
        for name, box in boxes
        if min(box.x0, box.y0, width - box.x1, height - box.y1) < -_TOUCH
    ]
    return clashes + [
        f"{one!r} lies on {other!r}"
        for (one, first), (other, second) in itertools.combinations(boxes, 2)
        if min(first.x1, second.x1) - max(first.x0, second.x0) > _TOUCH
        and min(first.y1, second.y1) - max(first.y0, second.y0) > _TOUCH
    ]
