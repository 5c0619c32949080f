# SPDX-License-Identifier: Apache-2.0
"""The settings that logs are mapped by, which are added to a saved map."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from oddsmap.cli.setting_layers import SettingLayers
    from oddsmap.config.config import Config
    from oddsmap.evidence_map import EvidenceMap
    from oddsmap.scans.log import Log

__all__ = ["configs_to_append", "empty_like"]


def empty_like(output: Path) -> EvidenceMap:
    """What a saved map says of itself, without its evidence."""
    from oddsmap.cli.files import HISTORY
    from oddsmap.evidence.store import read_empty
    from oddsmap.evidence_map import EvidenceMap

    if output.suffix.lower() == HISTORY:
        return EvidenceMap.history(output).like()
    return read_empty(output, EvidenceMap)


def configs_to_append(output: Path, layers: SettingLayers, logs: list[Log]) -> list[Config]:
    """The configurations for logs that are added to a saved map.

    Args:
        output: the map.
        layers: what the user sets.
        logs: the logs.

    Raises:
        ConfigError: settings of the map itself differ from what it was made with, a log is of
            another kind of sensor, or the map's evidence fades by numbers of scans.
    """
    from oddsmap.errors import ConfigError

    stored = empty_like(output).config
    if stored.map.half_life_scans is not None:
        raise ConfigError(
            f"{output}: its evidence fades with the numbers of scans of one log "
            "(map.half_life_scans), and another log would count them anew: build a map of its own"
        )
    configs = [layers.resolve_added(stored, log) for log in logs]
    for section in ("map", "posterior"):
        own = getattr(stored, section)
        for name in sorted(layers.fields(section)):
            theirs = getattr(getattr(configs[0], section), name)
            if theirs != getattr(own, name):
                raise ConfigError(
                    f"{section}.{name} is {theirs} here, and {getattr(own, name)} in "
                    f"{output}, whose settings stand with --append: leave it out, or build a "
                    "map of its own"
                )
    return configs
