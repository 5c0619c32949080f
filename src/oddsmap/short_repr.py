# SPDX-License-Identifier: Apache-2.0
"""What things say of themselves at a prompt: a line or two, however much they hold.

`repr` is called by people, notebooks, debuggers and failing tests: it reads no file, decodes no
map, and raises nothing, not even of a thing that is only half made.
"""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable, Iterable, Mapping
from enum import Enum
from typing import Any

import numpy as np
import numpy.typing as npt

__all__ = ["FEW_CELLS", "counted", "described", "extent_of", "grid_facts", "in_bytes", "short_repr"]

_LONGEST = 300  # characters
_TEXT = 60
_FEW = 4  # as many numbers or things are written out
FEW_CELLS = 1 << 20
"""More than these are not gone through for a `repr`: that would take milliseconds."""


def described(thing: object, facts: Callable[[], Iterable[str]]) -> str:
    """`<Kind fact, fact, ...>`; of what cannot be asked for its facts, the kind alone.

    Args:
        thing: what is described.
        facts: makes them; what comes last is left out first.
    """
    name = type(thing).__name__
    try:
        kept, room = [], _LONGEST - len(name) - 3
        for fact in facts():
            room -= len(fact) + 2
            if room < 0:
                break
            kept.append(fact)
    except Exception:  # a thing that is half made, in a debugger
        return f"<{name}>"
    return f"<{name} {', '.join(kept)}>" if kept else f"<{name}>"


def short_repr(self: Any) -> str:
    """The `__repr__` of dataclasses: fields as they are made, arrays as their type and shape.

    Fields that hold nothing, as by default, are left out, and functions.
    """
    name = type(self).__name__
    try:
        parts, room = [], _LONGEST - len(name) - 6
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if not field.repr or _is_nothing(field, value) or inspect.isroutine(value):
                continue
            part = f"{field.name}={_short(value)}"
            room -= len(part) + 2
            if room < 0:
                parts.append("...")
                break
            parts.append(part)
    except Exception:
        return f"<{name}>"
    return f"{name}({', '.join(parts)})"


def _is_nothing(field: dataclasses.Field[Any], value: object) -> bool:
    """Whether a field holds nothing, as by default."""
    if field.default_factory is not dataclasses.MISSING:
        return isinstance(value, Mapping | tuple | list) and not value
    return (value is None and field.default is None) or (
        isinstance(value, str | tuple) and not value and field.default == value
    )


def _short(value: object) -> str:
    """A value in about as many characters as a person reads of it."""
    if isinstance(value, np.ndarray):
        return _of_array(value)
    if isinstance(value, Enum):
        return f"{type(value).__name__}.{value.name}"
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float):
        return f"{value:.10g}" if abs(value) >= 1e4 else f"{value:.6g}"
    if isinstance(value, str):
        return repr(value if len(value) <= _TEXT else value[: _TEXT - 3] + "...")
    if isinstance(value, Mapping):
        if len(value) > _FEW:
            return f"{{{len(value)} entries}}"
        return f"{{{', '.join(f'{_short(key)}: {_short(of)}' for key, of in value.items())}}}"
    if isinstance(value, tuple | list):
        if len(value) > _FEW or sum(map(len, map(_short, value))) > 2 * _TEXT:
            kinds = {type(item).__name__ for item in value}
            return f"({len(value):,} x {kinds.pop() if len(kinds) == 1 else 'thing'})"
        return f"({', '.join(map(_short, value))}{',' * (len(value) == 1)})"
    text = repr(value)
    if len(text) > 2 * _TEXT or " at 0x" in text:
        return f"{type(value).__name__}(...)"
    return text


def _of_array(value: npt.NDArray[Any]) -> str:
    if value.ndim == 1 and value.size <= _FEW:
        return f"[{', '.join(_short(item) for item in value)}]"
    text = f"{value.dtype}[{', '.join(map(str, value.shape))}]"
    if not 0 < value.size <= FEW_CELLS or value.dtype.kind not in "iuf":
        return text
    finite = value[np.isfinite(value)] if value.dtype.kind == "f" else value
    if not finite.size:
        return text
    low, high = (_short(item) for item in (finite.min(), finite.max()))
    return f"{text} of {low}" + (f" to {high}" if low != high else " each")


def grid_facts(
    ndim: int,
    resolution: float,
    cells: int | None,
    bounds: tuple[npt.ArrayLike, npt.ArrayLike] | None,
) -> list[str]:
    """Dimensions, side of a cell, what is known, and where.

    Args:
        ndim: 2 or 3.
        resolution: side of a cell [m].
        cells: how many are known; None: not counted.
        bounds: the box of cells, first and past the last, x first; None: there is none.
    """
    facts = [f"{ndim}D", f"cells of {resolution:g} m"]
    if cells is not None:
        size = cells * resolution**ndim
        facts.append(f"{cells:,} known ({_amount(size)} m{'²' if ndim == 2 else '³'})")
    if bounds is not None:
        low, high = (np.asarray(corner, np.float64) * resolution for corner in bounds)
        facts.append(extent_of(low, high))
    return facts


def extent_of(low: npt.ArrayLike, high: npt.ArrayLike) -> str:
    """A box in words: `x -1 to 5.2, y 0 to 3 m`; corners in metres, shape (d,)."""
    pairs = zip("xyz", np.asarray(low), np.asarray(high), strict=False)
    return ", ".join(f"{axis} {_metres(a)} to {_metres(b)}" for axis, a, b in pairs) + " m"


def counted(number: int, noun: str) -> str:
    """`1 beam`, `1,234 beams`."""
    return f"{number:,} {noun}{'' if number == 1 else 's'}"


def in_bytes(number: int) -> str:
    """A size in memory: `812 B`, `1.3 MB`."""
    size, unit = float(number), "B"
    for larger in ("kB", "MB", "GB", "TB"):
        if size < 999.5:
            break
        size, unit = size / 1000.0, larger
    return f"{size:.3g} {unit}"


def _metres(length: float) -> str:
    return f"{round(float(length), 2) + 0.0:.10g}"  # + 0.0: no "-0"


def _amount(size: float) -> str:
    return f"{size:,.0f}" if size >= 100.0 else f"{size:.3g}"
