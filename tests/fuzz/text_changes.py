# SPDX-License-Identifier: Apache-2.0
"""Changes of JSON, YAML and TOML that know the format."""

from __future__ import annotations

import json
import random
from typing import Any

__all__ = ["change_json", "change_toml", "change_yaml"]

_JSON_VALUES = (
    "Infinity", "-Infinity", "NaN", "9" * 5000, "1e999", "-1", "0", "7", "0.5", "null", "true",
    "[]", "{}", '"x"', '"' + "x" * 3000 + '"', "[" * 3000 + "]" * 3000, "1e300", "1e-300",
    "99999999999", "-0.0", "[1, 2]", "4611686018427387904", "[[1e999]]", '{"a": {"b": []}}',
    "3.000001",
)  # fmt: skip

_ALIASES = "a: &a [1, 1, 1, 1, 1, 1, 1, 1, 1]\n" + "".join(
    f"{b}: &{b} [{', '.join([f'*{a}'] * 9)}]\n" for a, b in zip("abcdefgh", "bcdefghi", strict=True)
)
_MERGES = "a: &a {x: 1}\n" + "".join(
    f"{b}: &{b} {{<<: [{', '.join([f'*{a}'] * 9)}]}}\n"
    for a, b in zip("abcdefgh", "bcdefghi", strict=True)
)

_YAML_VALUES = (
    "!!python/object/apply:os.mkdir [made]", "!!python/name:os.mkdir", "!!python/tuple [0, 0, 0]",
    "2001-99-01", "2001-12-14t99:59:43.10-05:00", "1:99:99", "!!int ''", "!!float x", "!!bool x",
    "!!binary '*'", "!!timestamp x", "!!set {a, b}", "!!omap [a: 1]", "!!null ''", "[", "{", "'",
    "[" * 3000, "{a: " * 1500, "&a [*a]", "*unknown", "|\n  text", "9" * 5000, "0o17", "017",
    "0b11", "1e-05", ".inf", "-.inf", ".nan", "1_000", "~", "~/m.pgm", "yes", "no", "-", "<<: 1",
    "? a", "\t", "[1, 2, 3]", "[1e308, 1e308, 0]", "{a: 1}", "!x 1", "%YAML 9.9",
    "!<tag:yaml.org,2002:int> 'x'", "../m.pgm", "/dev/null", ".", "m.pgm\\0", '"\\0"',
    '"\\ud800"', "x" * 3000, "1e300", "1e-300", "-5",
)  # fmt: skip

_TOML_VALUES = (
    "inf", "-inf", "nan", "9" * 5000, "1" + "0" * 400, "1e300", "1e-300", "1e9", "1e-9", "-1",
    "0", "1", "-0.0", "true", '"x"', '""', "[]", "{}", "[" * 3000 + "]" * 3000,
    "{a=" * 1500 + "1" + "}" * 1500, "2001-02-03", "07:32:00", "0x10", "0o7", "1_0", "'''x",
    "[1, 2, 3]", "[-1e300, 0, 1e300]", "1e22", "9223372036854775807", "9223372036854775808",
    "1e16", "0.5", "1e-16", "[1, 2, nan]", "100", "5e-324", "1e5", "1e-5", '"' + "x" * 3000 + '"',
    "[inf, inf, inf]", "3", "1.0", "[[1]]",
)  # fmt: skip


def change_json(rng: random.Random, content: bytes) -> tuple[bytes, str]:
    """Put another value somewhere in the tree, or take one out."""
    tree = json.loads(content)
    places = list(_places(tree, ()))
    place = rng.choice(places)
    holder: Any = tree
    for step in place[:-1]:
        holder = holder[step]
    if rng.random() < 0.15:
        del holder[place[-1]]
        return json.dumps(tree).encode(), f"{place} left out"
    value = rng.choice(_JSON_VALUES)
    holder[place[-1]] = "@@"
    return json.dumps(tree).replace('"@@"', value).encode(), f"{place} becomes {value[:30]}"


def _places(tree: Any, path: tuple[Any, ...]) -> Any:
    items = tree.items() if isinstance(tree, dict) else enumerate(tree)
    for key, value in list(items):
        yield (*path, key)
        if isinstance(value, dict | list):
            yield from _places(value, (*path, key))


def change_yaml(rng: random.Random, content: bytes) -> tuple[bytes, str]:
    """Give a key another value, or put something odd beside the keys."""
    lines = content.decode().splitlines()
    at = rng.randrange(len(lines))
    key = lines[at].split(":")[0]
    if rng.random() < 0.2:
        odd = rng.choice(
            (_ALIASES, _MERGES, "---", "...", f"{key}: 1", "? [a]\n: 1", "- a", "a: b: c")
        )
        lines.insert(rng.choice((0, len(lines))), odd)
        return "\n".join(lines).encode(), f"beside the keys {odd[:30]!r}"
    value = rng.choice(_YAML_VALUES)
    lines[at] = f"{key}: {value}"
    return "\n".join(lines).encode(), f"{key} becomes {value[:40]!r}"


def change_toml(rng: random.Random, content: bytes) -> tuple[bytes, str]:
    """Give a field another value, or put something odd beside the fields."""
    lines = content.decode().splitlines()
    fields = [i for i, line in enumerate(lines) if "=" in line]
    if rng.random() < 0.1:
        odd = rng.choice(
            ("a." * 20_000 + "a = 1", "[a" + ".a" * 3000 + "]", "[[map]]", "[map]", "=", "x = 1")
        )
        lines.insert(rng.choice((0, len(lines))), odd)
        return "\n".join(lines).encode(), f"beside the fields {odd[:30]!r}"
    what = []
    for at in rng.sample(fields, rng.choice((1, 1, 1, 2))):
        key = lines[at].split("=")[0].strip()
        value = rng.choice(_TOML_VALUES)
        lines[at] = f"{key} = {value}"
        what.append(f"{key} becomes {value[:30]}")
    return "\n".join(lines).encode(), ", ".join(what)
