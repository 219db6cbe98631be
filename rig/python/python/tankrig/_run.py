"""Run folders."""

from __future__ import annotations

import html
import os
from functools import cached_property
from pathlib import Path

from ._model import Model
from ._results import Diagnosis, Fit, Record, record_at, shown_page
from ._tables import Images, Servo, Trajectory
from .errors import DataError, InputError


class Run:
    """A run folder: what ``rig run`` leaves, or ``rig replay``. Parts are read when they are asked for.

    Attributes:
        path: the folder.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        if not self.path.is_dir():
            raise InputError(f"{self.path} is no run folder: it is not there, or no folder")
        if not any((self.path / name).is_file() for name in ("start.json", "trajectory.csv")):
            raise InputError(f"{self.path} is no run folder: it has neither start.json nor trajectory.csv")

    @property
    def id(self) -> str:
        """Its name, such as ``20261120T101503Z-ab12cd``."""
        return self.path.resolve().name

    @cached_property
    def start(self) -> Record:
        """``start.json``: all that was known before."""
        return record_at(self.path / "start.json", "`rig run`")

    @cached_property
    def stop(self) -> Record | None:
        """``stop.json``: how it ended; ``None`` for a run that is incomplete."""
        path = self.path / "stop.json"
        return record_at(path, "`rig run`") if path.exists() else None

    @cached_property
    def trajectory(self) -> Trajectory:
        """Keypoints over time."""
        return Trajectory.read(self._file("trajectory.csv", "`rig replay` extracts it"))

    @cached_property
    def servo(self) -> Servo:
        """What the drives were told."""
        return Servo.read(self._file("servo.csv", "only runs with a drive have one"))

    @cached_property
    def images(self) -> Images:
        """What became of each image, and the pictures."""
        return Images.read(self.path)

    @cached_property
    def fit(self) -> Fit:
        """The fit to this run."""
        return Fit(self.path, self.path)

    @cached_property
    def diagnosis(self) -> Diagnosis:
        """What the simulation of this run gets wrong."""
        return Diagnosis(self.path, self.path)

    @property
    def model(self) -> Model:
        """The calibrated model."""
        return Model(self._file("model.xml", "a fit writes it"))

    @property
    def report(self) -> Path:
        """The report, a page for a browser."""
        return self.path / "report.html"

    def _file(self, name: str, hint: str) -> Path:
        path = self.path / name
        if not path.is_file():
            raise DataError(f"{path} is not there: {hint}")
        return path

    def _repr_html_(self) -> str:
        return shown_page(self.report) or f"<pre>{html.escape(repr(self))}</pre>"

    def __repr__(self) -> str:
        return f"Run({str(self.path)!r})"
