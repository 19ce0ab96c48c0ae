"""Look at pictures as a reader does: which texts lie on one another, or outside."""

import itertools

from matplotlib.text import Text

_TOUCH = 1.0  # pixels by which boxes may lie on one another: they are wider than the letters


def find_clashes(figure):
    """Find the texts of a figure that lie on one another or reach beyond the figure."""
    figure.draw_without_rendering()
    boxes = [(text.get_text(), text.get_window_extent()) for text in _list_texts(figure)]
    width, height = figure.bbox.size
    clashes = [
        f"{name!r} is cut"
        for name, box in boxes
        if box.x0 < -_TOUCH or box.y0 < -_TOUCH or box.x1 > width + 1 or box.y1 > height + 1
    ]
    return clashes + [
        f"{one!r} lies on {other!r}"
        for (one, first), (other, second) in itertools.combinations(boxes, 2)
        if min(first.x1, second.x1) - max(first.x0, second.x0) > _TOUCH
        and min(first.y1, second.y1) - max(first.y0, second.y0) > _TOUCH
    ]


def _list_texts(figure):
    """List the texts that are seen; ticks beyond the limits of an axis are not."""
    hidden = set()
    for ax in _list_axes(figure):
        for axis in (ax.xaxis, ax.yaxis):
            low, high = sorted(axis.get_view_interval())
            # Of rounding alone, on a logarithmic axis as well.
            low -= 1e-9 * abs(low)
            high += 1e-9 * abs(high)
            for tick in (*axis.get_major_ticks(), *axis.get_minor_ticks()):
                if not low <= tick.get_loc() <= high:
                    hidden |= {tick.label1, tick.label2}
    return [
        text
        for text in figure.findobj(Text)
        if text not in hidden and text.get_visible() and text.get_text().strip()
    ]


def _list_axes(figure):
    """List the axes of a figure, with those that lie in others."""
    return [each for ax in figure.axes for each in (ax, *ax.child_axes)]
