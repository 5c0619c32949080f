# SPDX-License-Identifier: Apache-2.0
"""Whether a worker writes to the same place as whoever builds the map: memory:// is never shared.

Workers come and go, so each task looks, before it writes what nobody would find.
"""

from __future__ import annotations

from oddsmap.errors import InputError
from oddsmap.scale.answers import worker_name
from oddsmap.scale.map_places import Place

__all__ = ["check_marked", "mark"]

_MARK = b"oddsmap writes here"


def mark(place: Place, folder: str) -> None:
    """Leave a mark to be seen by workers.

    Args:
        place: where they write.
        folder: the beginning of its name.
    """
    place.put(f"{folder}/mark", _MARK)


def check_marked(place: Place, folder: str) -> None:
    """See the mark.

    Raises:
        InputError: it is not there.
    """
    try:
        seen = place.get(f"{folder}/mark", 0, len(_MARK)) == _MARK
    except OSError:
        seen = False
    if not seen:
        raise InputError(
            f"{place}: worker {worker_name()} does not see it as it is here: give an output that "
            "all workers share, a folder of a file server at the same path or a URL like "
            "s3://bucket/map.zarr"
        )
