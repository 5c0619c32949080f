# SPDX-License-Identifier: Apache-2.0
"""Where the scans of a recording are, so that some can be read without those before them."""

from __future__ import annotations

from array import array
from collections.abc import Iterable

import numpy as np

from oddsmap.recordings.recording import START, Place

__all__ = ["ScanPlaces"]


class ScanPlaces:
    """The topics and places of messages, in the order of the recording: 20 bytes each."""

    def __init__(self) -> None:
        self._numbers: dict[str, int] = {}
        self._topics, self._files, self._places = array("i"), array("q"), array("q")

    def add(self, topic: str, place: Place) -> None:
        """Take the next message."""
        self._topics.append(self._numbers.setdefault(topic, len(self._numbers)))
        self._files.append(place[0])
        self._places.append(place[1])

    def before(self, topics: Iterable[str], number: int) -> tuple[Place, int]:
        """Where to begin to read the messages of some topics to get at one of them.

        Args:
            topics: their names; messages of others are not counted.
            number: of the message, from 0; it may be one that is not there.

        Returns:
            The place, and the number of the first message there.
        """
        keys = [self._numbers[topic] for topic in topics if topic in self._numbers]
        if number <= 0 or not keys:
            return START, 0
        own = np.flatnonzero(np.isin(np.frombuffer(self._topics, np.int32), keys))
        files = np.frombuffer(self._files, np.int64)[own]
        places = np.frombuffer(self._places, np.int64)[own]
        at = min(number, len(own) - 1)
        same = (files == files[at]) & (places == places[at])
        return (int(files[at]), int(places[at])), int(np.argmax(same))
