"""Which cells does a segment pass? Exact, by columns of cells: fast enough for real logs."""

from __future__ import annotations

from tests.naive.mapping import Cell, Point


def passed(start: Point, end: Point) -> set[Cell]:
    """Every cell in which the segment has positive length; equal to `set(mapping.crossed(...))`.

    All four coordinates are whole multiples of one power of two, as floats always are, so
    Python's integers hold everything exactly.
    """
    ratios = [value.as_integer_ratio() for value in (*start, *end)]
    one = max(denominator for _, denominator in ratios)
    x0, y0, x1, y1 = (top * (one // bottom) for top, bottom in ratios)
    if (x0, y0) == (x1, y1):
        return set()
    if x0 == x1:
        return {(x0 // one, row) for row in _rows(y0, y1, one)}
    if x1 < x0:
        x0, y0, x1, y1 = x1, y1, x0, y0
    cells = set()
    for column in range(x0 // one, -(-x1 // one)):
        left, right = max(x0, column * one), min(x1, (column + 1) * one)
        # y of the segment at both, times its width.
        width = x1 - x0
        low = y0 * width + (left - x0) * (y1 - y0)
        high = y0 * width + (right - x0) * (y1 - y0)
        cells |= {(column, row) for row in _rows(low, high, one * width)}
    return cells


def _rows(a: int, b: int, one: int) -> range:
    # Rows in which the way from a to b has positive length; the row that holds it, if a == b.
    low, high = min(a, b), max(a, b)
    return range(low // one, -(-high // one)) if low < high else range(low // one, low // one + 1)
