# SPDX-License-Identifier: Apache-2.0
"""The map that users hold: evidence, with its views and its files.

Every posterior is a view of the evidence, made when it is asked for.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Self

from oddsmap.errors import ConfigError, InputError
from oddsmap.evidence.evidence import Evidence
from oddsmap.integrate.add_more import add_more
from oddsmap.integrate.whole_log import add_whole_log, begin_map
from oddsmap.plot.thumbnail import Pictured, Thumbnail
from oddsmap.scans.log import Log
from oddsmap.scans.measurement import Measurement
from oddsmap.scans.report import Report
from oddsmap.sensors.registry import Sensor

if TYPE_CHECKING:
    from typing import Unpack

    import icechunk
    import numpy.typing as npt
    from matplotlib.axes import Axes

    from oddsmap.evidence.map_history import MapHistory
    from oddsmap.odds import Thresholds
    from oddsmap.plot.on_axes import PlotOptions
    from oddsmap.posterior.calibrated import Calibrated
    from oddsmap.posterior.count_model import CountModel
    from oddsmap.posterior.decay_rate import DecayRate
    from oddsmap.posterior.log_odds import LogOdds
    from oddsmap.posterior.neighbour_model import NeighbourModel
    from oddsmap.posterior.prior import MapLike
    from oddsmap.posterior.reflection import IntervalKind, Reflection
    from oddsmap.scale.build_on_disk import SavedMapOptions
    from oddsmap.scale.saved_map import SavedMap
    from oddsmap.viewer.map_widget import MapWidget
    from oddsmap.viewer.notebook import Bundle

__all__ = ["EvidenceMap", "build_map", "build_saved_map", "load_map"]


class EvidenceMap(Evidence, Pictured):
    """Hits and passes of a field of cells, and what can be made of them.

    A map is `oddsmap.evidence.evidence.Evidence`, with views and files; its arguments are those of
    `oddsmap.evidence.counted_cells.CountedCells`.
    Cell i covers [i * resolution, (i + 1) * resolution) in the map frame, along each axis.
    """

    def add(
        self,
        scans: Measurement | Iterable[Measurement] | Log,
        *,
        number: int | None = None,
        sensor: Sensor | None = None,
        method: str = "rays",
        threads: int = 1,
        progress: Callable[[int], None] | None = None,
    ) -> Report:
        """Add one scan, some, or a whole log; their order changes no bit.

        Many scans in one call take less time than one by one.

        Args:
            scans: a scan, some, or a log that `open_log` returned.
            number: with half_life_scans, the number of the first of these scans in their log, from
                which the others are counted on; None: the scans know their own, as those of a log.
            sensor: the sensor model of these scans; default: the map's.
            method: as in `build_map`, as are threads and progress.
            threads: how many threads to use.
            progress: called with the number of scans done so far.

        Returns:
            What became of these scans: how many were used, and what was skipped, by reason. The
            map's `report` counts those of all calls.

        Raises:
            InputError: what is given holds no scans, one has another dimension than the map, or is
                of a wide beam and the map's sensor is none, or its age is not known where the map
                forgets.
            ConfigError: a number for a map that does not count scans, or for a log.
            MapTooLargeError: the map, or one scan of it, would not fit in memory.
        """
        report = add_more(
            self, scans, number=number, sensor=sensor, method=method, threads=threads,
            progress=progress,
        )  # fmt: skip
        if self.report is None:
            self.report = Report()
        self.report.include(report)
        return report

    def log_odds(
        self,
        *,
        p_hit: float | None = None,
        p_miss: float | None = None,
        prior: float | MapLike | None = None,
        thresholds: Thresholds | None = None,
        clamp: tuple[float, float] | None = None,
    ) -> LogOdds:
        """The posterior of the Bayes filter, a view: see `oddsmap.posterior.log_odds.LogOdds`.

        Args:
            p_hit: p(x | z) of a hit at prior 1/2; default: the map's sensor model.
            p_miss: p(x | z) of a pass at prior 1/2; likewise.
            prior: p(x), a number or a map of it; default: the map's configuration.
            thresholds: from which probabilities a cell is free or occupied; likewise.
            clamp: lowest and highest probability of the view; None: as they are.
        """
        from oddsmap.posterior.log_odds import LogOdds

        return LogOdds(
            self, p_hit=p_hit, p_miss=p_miss, prior=prior, thresholds=thresholds, clamp=clamp
        )

    def calibrated(
        self,
        *,
        prior: float | MapLike | None = None,
        thresholds: Thresholds | None = None,
        clamp: tuple[float, float] | None = None,
        model: CountModel | None = None,
        neighbours: bool | NeighbourModel = False,
    ) -> Calibrated:
        """Probabilities fitted to this map's counts: see `oddsmap.posterior.calibrated`.

        Args:
            prior: p(x), a number or a map of it; default: the fitted share of occupied cells.
            thresholds: from which probabilities a cell is free or occupied; default: the map's.
            clamp: lowest and highest probability of the view; None: as they are.
            model: what was fitted to another map (`Calibrated.model`); None: to this one.
            neighbours: True: also look at the counts around a cell, which tell something of cells
                without evidence, too: see `oddsmap.posterior.neighbour_view`; or what such a view
                has fitted to another map (`NeighbourView.neighbours`), without `model`.

        Raises:
            ConfigError: both `model` and `neighbours`, which fits its own.
        """
        if neighbours is not False:
            from oddsmap.posterior.neighbour_view import NeighbourView

            if model is not None:
                raise ConfigError(
                    "a view with neighbours takes all it needs from neighbours=view.neighbours of "
                    "the other map's view: leave out model"
                )
            given = None if neighbours is True else neighbours
            return NeighbourView(
                self, prior=prior, thresholds=thresholds, clamp=clamp, neighbours=given
            )
        from oddsmap.posterior.calibrated import Calibrated

        return Calibrated(self, prior=prior, thresholds=thresholds, clamp=clamp, model=model)

    def reflection(
        self,
        *,
        a: float = 1.0,
        b: float = 1.0,
        threshold: float = 0.5,
        level: float = 0.95,
        kind: IntervalKind = "equal-tailed",
    ) -> Reflection:
        """How often a beam is reflected: see `oddsmap.posterior.reflection.Reflection`.

        Args:
            a: the Beta prior's weight of hits.
            b: its weight of passes.
            threshold: reflectivity from which a cell counts as occupied.
            level: of credible intervals.
            kind: which interval of that level: "equal-tailed" or "highest-density".
        """
        from oddsmap.posterior.reflection import Reflection

        return Reflection(self, a=a, b=b, threshold=threshold, level=level, kind=kind)

    def decay_rate(
        self, *, shape: float = 1.0, rate: float | None = None, level: float = 0.95
    ) -> DecayRate:
        """How soon beams end in a cell: see `oddsmap.posterior.decay_rate.DecayRate`.

        Args:
            shape: the Gamma prior's weight of hits.
            rate: its length without a hit [m]; None: the side of a cell.
            level: of credible intervals.
        """
        from oddsmap.posterior.decay_rate import DecayRate

        return DecayRate(self, shape=shape, rate=rate, level=level)

    def _thumbnail(self) -> Thumbnail | None:
        return self.log_odds()._thumbnail()

    def plot(self, ax: Axes | None = None, **options: Unpack[PlotOptions]) -> Axes:
        """Draw the view of its log odds into axes of Matplotlib, as `LogOdds.plot` does.

        Args:
            ax: where; None: the current axes of pyplot.
            options: title, trajectory, crop, whole, colour_bar, cmap: see
                `oddsmap.plot.on_axes.PlotOptions`.
        """
        return self.log_odds().plot(ax, **options)

    def widget(self, *, height: int | None = None) -> MapWidget:
        """The live map of `oddsmap view` in a notebook, linked with Python.

        A map at the end of a cell is live, too; of a widget that has a name the sliders are
        attributes, both to be read and to be set. It shows the map as it is now, and holds what
        the page is given (about as much as the saved map) until `widget.close()`.

        Args:
            height: of the widget [pixels of the page]; None: 480.

        Returns:
            See `oddsmap.viewer.map_widget.MapWidget`.

        Raises:
            ConfigError: anywidget is not installed, or the height is less than 240.
            InputError: the map is empty, or too large for the page.
        """
        from oddsmap.viewer.notebook import widget_of

        return widget_of(self, height, self._repr_png_())

    def _repr_mimebundle_(self, **_: object) -> Bundle:
        from oddsmap.viewer.notebook import bundle_of

        return bundle_of(self, self._repr_html_)

    def save(
        self, path: str | os.PathLike[str], *, force: bool = False, append: bool = False
    ) -> None:
        """Write the map as a Zarr folder: see `oddsmap.evidence.store.save_map`.

        Args:
            path: the folder, by custom with the suffix .zarr.
            force: True if an existing map may be replaced.
            append: True: add to the map that is there, exactly, and touch only the shards that are
                reached: see `oddsmap.evidence.append.append_map`.

        Raises:
            OutputError: it exists and neither is True, or is no map, or cannot be written.
            InputError: there is no map to add to, it is damaged, or the two do not add up.
            ConfigError: both are True.
        """
        from oddsmap.evidence.append import append_map
        from oddsmap.evidence.store import save_map

        if append and force:
            raise ConfigError("a map is added to (append) or replaced (force): leave one out")
        if append:
            append_map(self, path)
        else:
            save_map(self, path, force=force)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> EvidenceMap:
        """Read a map that `save` wrote: see `load_map`."""
        return load_map(path)

    @classmethod
    def open(cls, path: str | os.PathLike[str]) -> SavedMap[Self]:
        """A map that `save` wrote, of any size: regions and points of it are read when asked for.

            town = oddsmap.EvidenceMap.open("town.zarr")
            town.crop_box((0.0, 0.0), (40.0, 25.0)).log_odds().save_ros("hall.yaml")

        Raises:
            InputError: not a map, its header is damaged, or it is of a newer format.
        """
        from oddsmap.scale.saved_map import SavedMap

        return SavedMap(path, cls)

    @classmethod
    def history(cls, place: str | os.PathLike[str] | icechunk.Storage) -> MapHistory[Self]:
        """A map that is kept with all that it was, in an Icechunk repository.

            city = oddsmap.EvidenceMap.history("city.icechunk")
            city.add(monday, "Monday's drive")

        Args:
            place: a folder, which the first addition makes, or any storage of Icechunk.
        """
        from oddsmap.evidence.map_history import MapHistory

        return MapHistory(place, cls)


def build_map(
    log: Log | Measurement | Iterable[Measurement],
    resolution: float,
    *,
    sensor: Sensor | None = None,
    votes: str | None = None,
    half_life: float | None = None,
    t_ref_ns: int | None = None,
    half_life_scans: float | None = None,
    ref_scan: int | None = None,
    path_lengths: bool = False,
    method: str = "rays",
    threads: int = 1,
    progress: Callable[[int], None] | None = None,
) -> EvidenceMap:
    """Map a log: the whole way from readings to evidence.

    Args:
        log: what `open_log` returns, any scans, or one.
        resolution: side of a cell [m].
        sensor: the sensor model; by default what the log says about its sensor, which its scans
            know also without it: an `OverheadSensor` for grid scans, a `ConeSensor` where it says
            that beams are wide, otherwise a `BeamSensor`.
        votes: "scan": a cell gets at most one vote per scan, hits before passes (the textbook
            filter: one update per measurement). "beam": every beam votes, weights add up. Default:
            "beam" for cones, where each echo is a measurement, otherwise "scan".
        half_life: evidence of this age weighs half [s], for worlds that change; every scan needs
            a stamp. None: it never fades.
        t_ref_ns: the time at which it weighs 1 [ns]; default: that of the last scan, for which
            the log is read twice.
        half_life_scans: after so many scans evidence weighs half, for logs without stamps. Scans
            that no log has numbered are counted in the order given.
        ref_scan: the number of the scan at which it weighs 1, counted from 0; default: that of the
            last scan, for which the log is read twice.
        path_lengths: True: also keep the length of the beams inside each cell, for
            `EvidenceMap.decay_rate`; needs votes "beam".
        method: how depth images free cells. "rays": exactly, along the ray of every pixel;
            "projective": those whose centre lies before what its pixel sees, which is many times
            faster and approximate (docs/method-depth.md). Hits are the same.
        threads: how many threads to use; does not change the result by a bit.
        progress: called with the number of scans done so far.

    Returns:
        The map, 2D or 3D as the scans are; its `report` says what was used and
        what was skipped.

    Raises:
        InputError: no usable scan, or 2D and 3D scans together.
        ConfigError: a parameter outside its range.
        MapTooLargeError: the map, or one scan of it, would not fit in memory.
    """
    evidence, parts = begin_map(
        EvidenceMap, log, resolution, sensor=sensor, votes=votes, half_life=half_life,
        t_ref_ns=t_ref_ns, half_life_scans=half_life_scans, ref_scan=ref_scan,
        path_lengths=path_lengths,
    )  # fmt: skip
    evidence.report = add_whole_log(
        evidence, parts, method=method, threads=threads, progress=progress
    )
    return evidence


def build_saved_map(
    log: Log | Measurement | Iterable[Measurement],
    resolution: float,
    path: str | os.PathLike[str],
    *,
    memory: int | str | None = None,
    force: bool = False,
    **options: Unpack[SavedMapOptions],
) -> SavedMap[EvidenceMap]:
    """Map a log into a folder, also where the map is larger than memory.

    The map is that of `build_map(...).save(path)`, to the bit. Where it would take more memory than
    it may, what there is of it goes to the disk beside the folder, and is added up in the end,
    shard by shard.

    Args:
        log: what `open_log` returns, any scans, or one.
        resolution: side of a cell [m].
        path: folder to make, by custom with the suffix .zarr.
        memory: bytes that the map may take in memory while it is built, or a text as "4GB"; None:
            half of what is free when this is called. One scan's cells are held whole, and Python
            with its libraries takes 0.2 GB beside that.
        force: True if an existing map may be replaced.
        options: as in `build_map`: sensor, votes, half_life, t_ref_ns, half_life_scans, ref_scan,
            path_lengths, method, threads and progress.

    Returns:
        The saved map; its `report` says what was used and what was skipped.

    Raises:
        InputError, ConfigError, MapTooLargeError: as in `build_map`; memory that is no size, or
            below 32 MB.
        OutputError: the folder cannot be written, or the disk is full.
    """
    from oddsmap.scale.build_on_disk import build_on_disk

    return build_on_disk(EvidenceMap, log, resolution, path, memory=memory, force=force, **options)


def load_map(
    path: str | os.PathLike[str],
    *,
    lo: npt.ArrayLike | None = None,
    hi: npt.ArrayLike | None = None,
    box: tuple[npt.ArrayLike, npt.ArrayLike] | None = None,
) -> EvidenceMap:
    """Read a map, or the cells of a box of it.

    Args:
        path: a folder that `EvidenceMap.save` wrote.
        lo: first cell to read, shape (d,), x first; None: all.
        hi: past the last cell to read, shape (d,); None: all.
        box: in place of both, lowest and highest corner [m], shape (d,) each, as in
            `EvidenceMap.crop_box`.

    Raises:
        InputError: not a map, damaged, or of a newer format; or no such box.
    """
    from oddsmap.evidence.store import read_empty, read_map

    if box is not None:
        if lo is not None or hi is not None:
            raise InputError("a part of a map is given in cells, lo= and hi=, or in metres, box=")
        lo, hi = read_empty(path, EvidenceMap).region_of(*box)

    return read_map(path, EvidenceMap, lo=lo, hi=hi)
