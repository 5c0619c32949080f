# SPDX-License-Identifier: Apache-2.0
"""Pictures of views that have several quantities for each cell, of which one is drawn."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from pathlib import Path
from typing import TYPE_CHECKING, Generic, TypeVar

from oddsmap.map_files.fields import Grid
from oddsmap.plot.thumbnail import Pictured

if TYPE_CHECKING:
    from typing import Unpack

    from matplotlib.axes import Axes

    from oddsmap.plot.layout import FrameOptions
    from oddsmap.plot.on_axes import PlotOptions

__all__ = ["DrawnQuantities"]

Q = TypeVar("Q", bound=str)


class DrawnQuantities(Pictured, ABC, Generic[Q]):
    """Draws a quantity that is chosen by its name, one of `Q`. Made to be derived from."""

    @abstractmethod
    def _plane(self, show: Q) -> Grid:
        """A quantity with its place in the world (InputError: a 3D map)."""

    @abstractmethod
    def _label(self, show: Q) -> str:
        """What its scale says."""

    @abstractmethod
    def _limits(self, show: Q) -> tuple[float, float] | None:
        """Ends of its scale; None: those of what is drawn."""

    # All views have a mean, which a type variable cannot say.
    def save_png(
        self,
        path: str | os.PathLike[str],
        *,
        show: Q = "mean",  # type: ignore[assignment]
        force: bool = False,
        **options: Unpack[FrameOptions],
    ) -> None:
        """Draw a quantity as `.png`, `.pdf` or `.svg`: see `oddsmap.plot.quantity.save_quantity`.

        Args:
            path: the file to write.
            show: what to draw.
            force: True where an existing file may be replaced.
            options: title, trajectory, crop, size, whole: see
                `oddsmap.plot.layout.FrameOptions`.

        Raises:
            InputError: a 3D map.
        """
        from oddsmap.plot.quantity import save_quantity

        save_quantity(
            self._plane(show), Path(path), label=self._label(show), limits=self._limits(show),
            force=force, **options,
        )  # fmt: skip

    def plot(
        self,
        ax: Axes | None = None,
        *,
        show: Q = "mean",  # type: ignore[assignment]
        **options: Unpack[PlotOptions],
    ) -> Axes:
        """Draw a quantity into axes of Matplotlib: see `oddsmap.plot.on_axes.plot_quantity`.

        Args:
            ax: where; None: the current axes of pyplot.
            show: what to draw.
            options: title, trajectory, crop, whole, colour_bar, cmap: see
                `oddsmap.plot.on_axes.PlotOptions`.

        Raises:
            InputError: a 3D map.
        """
        from oddsmap.plot.on_axes import plot_quantity

        return plot_quantity(
            self._plane(show), ax, label=self._label(show), limits=self._limits(show), **options
        )
