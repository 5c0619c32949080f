# SPDX-License-Identifier: Apache-2.0
"""What other libraries decode of files from elsewhere: one line, whatever they raise.

On damaged input zipfile, lzma, ast, tokenize, Pillow, PyYAML and tomllib raise, beside the errors
they are known by, nearly every other kind (RuntimeError for an encrypted member, TokenError for an
unfinished header, IndexError for an empty number), and other ones with each release. A list of
them would never be complete; so all are taken, around the library's call and nothing else.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from oddsmap.errors import InputError, OddsmapError, as_line

__all__ = ["decoding"]

_LONGEST_REASON = 100


@contextmanager
def decoding(
    where: object, fault: str, advice: str, error: type[OddsmapError] = InputError
) -> Iterator[None]:
    """Turn what a library raises into one line: `where: fault (reason): advice`.

    Put nothing in it but the library's call, or faults of our own would be blamed on the file.

    Args:
        where: the file.
        fault: what is wrong with it where the library gives up.
        advice: what to do.
        error: the kind of error to raise.
    """
    try:
        yield
    except OddsmapError:
        raise
    except RecursionError:
        raise error(f"{where}: {fault} (nested too deeply): {advice}") from None
    except MemoryError:
        # Parsers of nested text raise it, too, where no memory is short.
        raise error(f"{where}: {fault} (too large or too deeply nested): {advice}") from None
    except Exception as raised:
        # Some add where in a text that is not the user's: the sentence comes first.
        several = len(raised.args) > 1 and isinstance(raised.args[0], str)
        text = str(raised.args[0] if several else raised)
        reason = as_line(" ".join(text.split()), _LONGEST_REASON)
        raise error(f"{where}: {fault} ({reason or type(raised).__name__}): {advice}") from None
