"""Tables as the run folder has them: trajectories, commands, images."""

from __future__ import annotations

import csv
import math
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import numpy as np
from numpy.typing import NDArray

from . import _native
from ._optional import needed
from .errors import DataError, InputError

if TYPE_CHECKING:
    import pandas as pd

Floats = NDArray[np.float64]
AXES = "xyz"


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Keypoints over time, as ``trajectory.csv`` has them; world frame, x to the right and z up in the picture.

    Attributes:
        time_s: [s], shape (N,).
        keypoints: their names, length K; ``q1_rad`` and the like are encoders.
        position_m: [m], shape (N, K, 3); NaN where nothing was seen, or never along that axis. An encoder has its angle as the way of a
            pointer of 0.125 m in place of x.
        std_m: one sigma per axis [m], shape (N, K); ``None`` where the file states none.
    """

    time_s: Floats
    keypoints: list[str]
    position_m: Floats
    std_m: Floats | None = None

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Trajectory:
        """Reads a ``trajectory.csv``, as strictly as ``rig fit`` does."""
        return cls(*_native.read_trajectory(path))

    def columns(self) -> dict[str, Floats]:
        """The columns as the file names them, each of shape (N,); without what was never observed."""
        found = {"time_s": self.time_s}
        for place, name in enumerate(self.keypoints):
            if name.endswith("_rad"):
                found[name] = self.position_m[:, place, 0] / POINTER_M
                continue
            for axis, letter in enumerate(AXES):
                along = self.position_m[:, place, axis]
                if not np.isnan(along).all():
                    found[f"{name}_{letter}_m"] = along
        if self.std_m is not None:
            for place, name in enumerate(self.keypoints):
                if not np.isnan(self.std_m[:, place]).all():
                    found[f"{name}_std_m"] = self.std_m[:, place]
        return found

    def write(self, path: str | os.PathLike[str]) -> None:
        """Writes it as a ``trajectory.csv``; what is NaN is an empty cell."""
        Path(path).write_text(text_of(self.columns()))

    def pandas(self) -> pd.DataFrame:
        """As a table with the file's columns, indexed by ``time_s``."""
        return frame(self.columns())

    def __len__(self) -> int:
        return len(self.time_s)

    def __repr__(self) -> str:
        return f"Trajectory({len(self)} images, {', '.join(self.keypoints)})"


# Length that turns an encoder's angle into the way of a pointer [m]; as `sim::model::POINTER_M`.
POINTER_M = 0.125


@dataclass(frozen=True, eq=False)
class Servo:
    """What the drives were told, as ``servo.csv`` has it: straight lines between rows.

    Attributes:
        time_s: [s], shape (N,), strictly rising.
        actuators: names, length A.
        angle_rad: [rad], shape (N, A).
    """

    time_s: Floats
    actuators: list[str]
    angle_rad: Floats

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Servo:
        """Reads the commands of a ``servo.csv``."""
        actuators, time_s, angle_rad = _native.read_command(path)
        return cls(time_s, actuators, angle_rad)

    def columns(self) -> dict[str, Floats]:
        """The columns as the file names them, each of shape (N,)."""
        angles = {f"{name}_rad": self.angle_rad[:, place] for place, name in enumerate(self.actuators)}
        return {"time_s": self.time_s, **angles}

    def pandas(self) -> pd.DataFrame:
        """As a table with the file's columns, indexed by ``time_s``."""
        return frame(self.columns())

    def __len__(self) -> int:
        return len(self.time_s)

    def __repr__(self) -> str:
        return f"Servo({len(self)} rows, {', '.join(self.actuators)})"


@dataclass(frozen=True, eq=False)
class Images:
    """The images of a run: what became of each, and its picture.

    ``images[3]`` is the picture of row 3 as an array of brightness, shape (height, width), 0 to 255; ``images[10:20]`` a list of ten.

    Attributes:
        time_s: mid-exposure [s], shape (N,).
        sequence: the camera's count, shape (N,).
        status: ``ok``, ``doubtful``, ``rejected`` and so on, length N.
        reason: why an image was refused, length N; empty where it was not.
    """

    folder: Path
    time_s: Floats
    sequence: NDArray[np.int64]
    status: list[str]
    reason: list[str]
    _all: dict[str, list[str]] = field(repr=False)

    @classmethod
    def read(cls, folder: Path) -> Images:
        """Reads ``frames.csv`` of a run folder."""
        path = folder / "frames.csv"
        try:
            with path.open(newline="") as file:
                rows = list(csv.DictReader(file))
        except OSError as error:
            raise DataError(f"reading {path}: {error.strerror}; `rig replay` makes it from the recording") from error
        whole = {name: [row[name] for row in rows] for name in (rows[0] if rows else ())}
        try:
            time_s = np.array(whole.get("time_s", []), float)
            sequence = np.array(whole.get("sequence", []), np.int64)
            status, reason = whole.get("status", []), whole.get("reason", [])
        except ValueError as error:
            raise InputError(f"reading {path}: {error}") from error
        return cls(folder, time_s, sequence, status, reason, whole)

    def pandas(self) -> pd.DataFrame:
        """As a table, one row an image, with the columns of ``frames.csv``."""
        library = needed("pandas", "a table of images")
        table: pd.DataFrame = library.DataFrame(self._all).assign(time_s=self.time_s, sequence=self.sequence)
        return table

    def __len__(self) -> int:
        return len(self.time_s)

    @overload
    def __getitem__(self, place: int) -> NDArray[np.uint8]: ...
    @overload
    def __getitem__(self, place: slice) -> list[NDArray[np.uint8]]: ...
    def __getitem__(self, place: int | slice) -> NDArray[np.uint8] | list[NDArray[np.uint8]]:
        if isinstance(place, slice):
            return self._pictures(self.sequence[place])
        return self._pictures(self.sequence[[place]])[0]

    def _pictures(self, sequences: NDArray[np.int64]) -> list[NDArray[np.uint8]]:
        found = dict(_native.read_pictures(self.folder, {int(sequence) for sequence in sequences}))
        pictures = []
        for sequence in sequences:
            picture = found.get(str(sequence), "it is not in the recording")
            if isinstance(picture, str):
                raise DataError(f"image {sequence} of {self.folder}: {picture}")
            pictures.append(picture)
        return pictures

    def __repr__(self) -> str:
        return f"Images({len(self)} of {self.folder})"


def frame(columns: Mapping[str, Any]) -> pd.DataFrame:
    """A table indexed by time."""
    table: pd.DataFrame = needed("pandas", "a table").DataFrame(dict(columns)).set_index("time_s")
    return table


def text_of(columns: Mapping[str, Iterable[float]]) -> str:
    """CSV of columns of equal length, every bit of each number in it; empty cells for NaN."""
    cells = [[float(number) for number in column] for column in columns.values()]
    if len({len(column) for column in cells}) > 1:
        raise InputError(f"columns of unequal lengths: {', '.join(f'{name} {len(c)}' for name, c in zip(columns, cells))}")
    rows = (",".join("" if math.isnan(number) else repr(number) for number in row) for row in zip(*cells))
    return "\n".join([",".join(columns), *rows, ""])


def columns_of(table: Any, what: str) -> dict[str, Any]:
    """The columns of a mapping or of a pandas table, the index as ``time_s`` where it is called so."""
    if isinstance(table, (Trajectory, Servo)):
        return dict(table.columns())
    if hasattr(table, "reset_index") and getattr(getattr(table, "index", None), "name", None) == "time_s":
        table = table.reset_index()
    if not hasattr(table, "keys") or not hasattr(table, "__getitem__"):
        raise InputError(f"{what} is {type(table).__name__}: wanted is a path, or a table with columns by name")
    found = {str(name): np.asarray(table[name], float) for name in table.keys()}
    wrong = [name for name, column in found.items() if column.ndim != 1]
    if wrong:
        raise InputError(f"{what}: column {wrong[0]} has shape {found[wrong[0]].shape}; wanted is one number a row")
    if "time_s" not in found:
        raise InputError(f"{what} has no column time_s, but {', '.join(found)}")
    return {"time_s": found.pop("time_s"), **found}
