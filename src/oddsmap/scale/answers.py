# SPDX-License-Identifier: Apache-2.0
"""How tasks answer: a refusal is an answer, which no other worker is asked for again."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import NamedTuple, ParamSpec, TypeVar

from oddsmap.errors import ConfigError, InputError, MapTooLargeError, OddsmapError, OutputError
from oddsmap.scale.worker_memory import keep_some_memory
from oddsmap.scale.worker_versions import Versions, check_versions, versions_here

__all__ = ["Refusal", "answering", "worker_name"]

P = ParamSpec("P")
T = TypeVar("T")

_KINDS = {kind.__name__: kind for kind in (ConfigError, InputError, MapTooLargeError, OutputError)}


class Refusal(NamedTuple):
    """An error that was raised on purpose, and would be again elsewhere.

    Others, as of a store that is out of reach, are tried again on another worker.
    """

    kind: str
    text: str

    def to_error(self) -> OddsmapError:
        """The error, to be raised by whoever builds the map."""
        return _KINDS.get(self.kind, InputError)(self.text)


def answering(task: Callable[P, T]) -> Callable[..., T | Refusal]:
    """Let a task answer with a refusal, also where this worker has other versions.

    Args:
        task: what is to be done. The task that is made of it takes the versions first.
    """

    @wraps(task)
    def answer(versions: Versions, *args: P.args, **named: P.kwargs) -> T | Refusal:
        try:
            check_versions(versions_here(), versions, worker_name())
            keep_some_memory()
            return task(*args, **named)
        except OddsmapError as error:
            kind = next((name for name, kind in _KINDS.items() if isinstance(error, kind)), "")
            return Refusal(kind, str(error))

    return answer


def worker_name() -> str:
    """The address of the worker that runs this; elsewhere "here"."""
    from distributed import get_worker

    try:
        return str(get_worker().address)
    except ValueError:
        return "here"
